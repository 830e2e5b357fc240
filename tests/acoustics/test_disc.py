"""Leaf scattering: closed forms, the Kirchhoff integral by quadrature, limits and bounds."""

import math
import os
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from references.discs import HardDisc, _galerkin_matrix
from references.echoes import scattering_direct
from references.scripts import ROOT, script
from scipy import integrate

from forest_addon.acoustics import disc_table, kept_tables
from forest_addon.acoustics.disc import (
    HANDOVER,
    MODELS,
    amplitude_bound,
    backscatter,
    backscatter_amplitude,
)
from forest_addon.acoustics.disc_table import (
    ERROR,
    FILE,
    LAST,
    MARGIN,
    table_error,
    tabulated,
    tabulated_bound,
    tabulated_ka,
)
from forest_addon.acoustics.gridding import ALIASING, NARROWEST, DelayGrid
from forest_addon.acoustics.kept_tables import VARIABLE, cache_folder, kept_table
from forest_addon.acoustics.nonuniform import sum_delayed


@pytest.mark.parametrize("model", ["paper", "piston"])
def test_scalar_reference(model: str) -> None:
    for ka in (0.0, 1e-3, 0.3, 1.0, 5.0, 28.3, 90.0):
        for incidence in (0.0, 0.02, 0.7, 1.3, math.pi / 2):
            value = backscatter_amplitude(ka, incidence, model)
            expected = scattering_direct(ka, incidence, model)
            assert abs(value - expected) < 1e-12 * max(1.0, ka**2)
            assert backscatter(ka, incidence, model) == pytest.approx(abs(value), rel=1e-14)


@pytest.mark.parametrize("ka", [0.5, 5.0, 20.0])
@pytest.mark.parametrize("incidence", [0.0, 0.4, 1.2])
def test_piston_is_the_kirchhoff_integral(ka: float, incidence: float) -> None:
    """k·f = i k² cosβ/2π ∫ e^{-2ikx sinβ} dS over the disc, x along the tilt; a = 1 here."""
    real, _ = integrate.quad(
        lambda x: 2 * math.sqrt(1 - x * x) * math.cos(2 * ka * x * math.sin(incidence)),
        -1,
        1,
        limit=400,
    )
    expected = 1j * ka**2 * math.cos(incidence) / (2 * math.pi) * real  # odd part vanishes
    assert backscatter_amplitude(ka, incidence, "piston") == pytest.approx(expected, abs=1e-8)


def test_piston_sign_is_that_of_a_mirror() -> None:
    """A disc of some Fresnel zones sends back, on its axis, the mirror image and the edge's wave.

    Rayleigh's integral for the rigid mirror, p = ik/2π ∫ e^{-iks}/s dS, is e^{-ikr} - e^{-iks_edge};
    for a far point it is f·e^{-ikr}/r.
    """
    k, radius, distance = 50.0, 0.3, 4000.0
    edge = math.hypot(distance, radius)
    exact = 1 - np.exp(-1j * k * (edge - distance))  # e^{-ikr} taken off
    far = backscatter_amplitude(k * radius, 0.0, "piston") / (k * distance)
    assert far == pytest.approx(exact, rel=1e-3)


@pytest.mark.parametrize("model", MODELS)
def test_what_is_no_number_stays_so(model: str) -> None:
    found = backscatter(np.array([math.nan, 5.0, 5.0]), np.array([0.1, math.nan, 0.1]), model)
    assert np.isnan(found).tolist() == [True, True, False]


@pytest.mark.parametrize("model", MODELS)
def test_two_faces(model: str) -> None:
    angle = np.linspace(0, math.pi / 2, 7)
    for same in (-angle, math.pi - angle, math.pi + angle, 2 * math.pi - angle):
        np.testing.assert_allclose(
            backscatter(5.0, same, model), backscatter(5.0, angle, model), atol=1e-13
        )


@pytest.mark.parametrize("model", MODELS)
def test_hard_regions(model: str) -> None:
    ka = np.array([0.0, 5e-324, 1e-300, 1e-12, 1e-3, 1e3])[:, None]
    angle = np.array([0.0, 5e-324, 1e-9, 1.0, np.nextafter(math.pi / 2, 0), math.pi / 2])
    value = backscatter(ka, angle, model)
    assert value.shape == (6, 6)
    assert np.isfinite(value).all()
    assert (value[0] == 0).all()
    if model == "piston":
        assert (value[:, -1] <= 1e-15 * ka[:, 0] ** 2).all()  # edge-on
        np.testing.assert_allclose(value[:, 0], ka[:, 0] ** 2 / 2)


@pytest.mark.parametrize("model", MODELS)
def test_bound_holds_over_the_band(model: str) -> None:
    rng = np.random.default_rng(1)
    radius, angle = rng.uniform(0, 0.1, 500), rng.uniform(0, math.pi / 2, 500)
    for lowest, highest in ((1.0, 3000.0), (1100.0, 1480.0), (1.0, 10.0), (900.0, 4000.0)):
        k = np.linspace(lowest, highest, 300)[:, None]
        size = backscatter(k * radius, angle, model) / k
        bound = amplitude_bound(lowest, highest, radius, angle, model)
        assert (size <= bound * (1 + 1e-12)).all()
    assert amplitude_bound(1.0, 2.0, np.zeros(1), np.zeros(1), model) == 0


def test_unknown_model() -> None:
    known = 'leaf model "mirror" is not known; use one of "paper", "piston", "exact"'
    with pytest.raises(ValueError, match=known):
        backscatter(1.0, 0.0, "mirror")
    with pytest.raises(ValueError, match=known):
        amplitude_bound(1.0, 2.0, np.ones(1), np.zeros(1), "mirror")


@pytest.mark.parametrize("model", MODELS)
def test_bound_is_close(model: str) -> None:
    """Over a band it is the largest value in it; a spline's coefficients are somewhat larger than it."""
    rng = np.random.default_rng(2)
    radius, angle = rng.uniform(0.005, 0.08, 500), rng.uniform(0, math.pi / 2 - 0.1, 500)
    k = np.linspace(1100.0, 1480.0, 400)[:, None]
    size = (backscatter(k * radius, angle, model) / k).max(axis=0)
    ratio = size / amplitude_bound(1100.0, 1480.0, radius, angle, model)
    assert np.median(ratio) > (0.85 if model == "exact" else 0.999)
    assert ratio.min() > (0.5 if model == "exact" else 0.99)


@pytest.mark.parametrize("model", MODELS)
def test_bound_at_normal_incidence_holds_for_smaller_and_turned_discs(model: str) -> None:
    rng = np.random.default_rng(3)
    for largest in (1e-4, 0.003, 0.02, 0.12):
        radius, angle = rng.uniform(0, largest, 2000), rng.uniform(0, math.pi / 2, 2000)
        bound = amplitude_bound(1100.0, 1480.0, largest, 0.0, model)
        for k in (1100.0, 1290.0, 1480.0):
            assert (backscatter(k * radius, angle, model) / k <= bound * (1 + 1e-12)).all()


def test_beyond_the_table() -> None:
    """Large discs: optics and edge, and no step where the table ends."""
    angle = np.linspace(0, math.pi / 2, 300)
    for ka, largest in ((LAST - 1, 1e-3), (LAST, 1e-3), (200.0, 5e-4)):
        error = np.abs(backscatter_amplitude(ka, angle) - HardDisc(ka).backscatter(angle))
        assert error.max() < largest * ka**2 / 2
    for edge in (HANDOVER, LAST):
        below, above = (
            backscatter_amplitude(ka, angle)
            for ka in (np.nextafter(edge, 0), np.nextafter(edge, 999))
        )
        assert np.abs(above - below).max() < 1e-6 * edge**2 / 2


def test_models_differ_as_published() -> None:
    """PHYSICS 4.1: rms over directions, piston re exact; the paper at random orientation."""
    angle = np.arccos((np.arange(20000) + 0.5) / 20000)

    def rms_db(ka: float, model: str) -> float:
        return 10 * math.log10(np.mean(backscatter(ka, angle, model) ** 2))

    for ka, expected in ((5, -1.5), (8, -0.5), (32, -0.15)):
        assert rms_db(ka, "piston") - rms_db(ka, "exact") == pytest.approx(expected, abs=0.06)
    assert 11 < rms_db(28, "paper") - rms_db(28, "exact") < 28


@pytest.mark.parametrize("ka", [128.0, 180.0])
def test_large_discs_off_their_normal(ka: float) -> None:
    """Beyond the table: rms errors as stated, relative to the echo itself."""
    angle = np.linspace(0, 1.4, 1200)
    exact = HardDisc(ka).backscatter(angle)
    off = np.abs(backscatter_amplitude(ka, angle, "exact") - exact) ** 2
    for low, high, share in (
        (0, 0.1, 0.04),
        (0.1, 1.047, 0.2),
        (1.047, 1.2, 0.25),
        (1.2, 1.4, 0.4),
    ):
        some = (angle >= low) & (angle <= high)
        assert off[some].mean() <= share**2 * np.mean(np.abs(exact[some]) ** 2)


# ---------------------------------------------------------------------------------------- disc exact
# The exact disc that other tests are held to: nothing is lost. sonar/test_targets has it by another method.


@pytest.mark.medium
@pytest.mark.parametrize(("ka", "incidence"), [(1e-2, 0.7), (30.0, 0.7)])
def test_optical_theorem(ka: float, incidence: float) -> None:
    """∫|k·f|² dΩ = -4π·Im k·f forward (e^{+iωt}): nothing is lost."""
    count = math.ceil(1.5 * ka) + 24
    nodes, weights = np.polynomial.legendre.leggauss(count)
    turn = 2 * math.pi * np.arange(2 * count) / (2 * count)
    scattered, azimuth = (
        grid.ravel() for grid in np.meshgrid(np.arccos(nodes), turn, indexing="ij")
    )
    disc = HardDisc(ka)
    field = disc.amplitude(np.full(scattered.shape, incidence), scattered, azimuth)
    power = weights @ (np.abs(field) ** 2).reshape(count, -1).sum(axis=1) * math.pi / count
    ahead = disc.amplitude(*(np.array([a]) for a in (incidence, math.pi - incidence, math.pi)))
    assert power == pytest.approx(-4 * math.pi * ahead[0].imag, rel=1e-10)


def test_more_orders_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """The truncation is what could be wrong of large discs."""
    angle = np.linspace(0, 1.5, 7)
    for ka in (60.0, 100.0):
        disc, finer = HardDisc(ka), _Finer(ka)
        assert finer.orders > disc.orders
        difference = np.abs(disc.backscatter(angle) - finer.backscatter(angle))
        assert difference.max() < 1e-9 * abs(disc.backscatter(np.zeros(1))[0])


class _Finer(HardDisc):
    """Half as many orders more, and so the quadrature of a larger disc's field."""

    def __init__(self, ka: float) -> None:
        super().__init__(ka)
        self.orders = self.orders * 3 // 2
        self._matrix = _galerkin_matrix(self._k, self.orders)


# ---------------------------------------------------------------------------------------- disc table
# The table of the exact disc against the solver, and as what the repository ships.

RANGES = [(1e-9, 0.1), (0.1, 1), (1, 3), (3, 10), (10, 40), (40, 80), (80, LAST)]


@pytest.mark.slow
@pytest.mark.parametrize(("low", "high"), RANGES)
def test_error_is_as_stated(low: float, high: float) -> None:
    rng = np.random.default_rng(5)
    for ka in [*rng.uniform(low, high, 12), high]:
        near = rng.uniform(0, min(1.5, 10 / ka), 300)  # the main lobe and the first side lobes
        angle = np.concatenate([[0, math.pi / 2], near, rng.uniform(0, math.pi / 2, 300)])
        exact = HardDisc(ka).backscatter(angle)
        assert np.abs(tabulated(ka, angle) - exact).max() < ERROR * abs(exact[0])


def test_bound_of_the_table() -> None:
    rng = np.random.default_rng(6)
    angle = np.append(rng.uniform(0, math.pi / 2, 300), [0, math.pi / 2])
    for low, high in ((0.0, 0.3), (0.5, 0.6), (5.0, 6.7), (20.0, 27.0), (3.0, 3.0), (1e-3, LAST)):
        ka = np.linspace(max(low, 1e-6), high, 300)[:, None]
        size = (np.abs(tabulated(ka, angle)) / ka).max(axis=0)
        ends = (np.full(len(angle), end) for end in (low, high))
        assert (size <= tabulated_bound(*ends, angle)).all()


def test_error_of_the_table_is_bounded() -> None:
    rng = np.random.default_rng(2)
    for ka in [*np.exp(rng.uniform(math.log(0.01), math.log(LAST), 25)), 0.99 * LAST]:
        angle = np.concatenate(
            [rng.uniform(0, math.pi / 2, 300), rng.uniform(0, min(1.5, 9 / ka), 99)]
        )
        off = np.abs(HardDisc(float(ka)).backscatter(angle) - tabulated(np.full(399, ka), angle))
        assert (off / ka <= table_error(np.full(399, ka), angle)).all()


def test_shipped_table_is_what_the_script_makes() -> None:
    maker, ka = script("packaging/make_disc_table.py"), tabulated_ka()
    with np.load(FILE) as data:
        np.testing.assert_allclose(data["ka"], ka, rtol=1e-14)
        rows = np.split(data["series"], np.cumsum(data["terms"])[:-1])
    for index in (0, MARGIN, MARGIN + 1, 100, 300, len(ka) - 1):
        made = maker.series(float(ka[index]))
        shared = min(len(made), len(rows[index]))  # the cut may fall one term apart
        assert abs(len(made) - len(rows[index])) <= 1
        np.testing.assert_allclose(rows[index][:shared], made[:shared], atol=3e-7)
    assert FILE.stat().st_size < 1e6


# --------------------------------------------------------------------------------------- kept tables
# Tables kept on the disk: the same bytes with and without, whatever happens to a file or beside it.

TABLE = np.arange(12.0).reshape(3, 4) * (1 + 2j)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


def maker():
    return Mock(return_value=TABLE)


def test_a_table_is_made_once_and_read_the_same(folder):
    make = maker()
    first, second = (kept_table("t", "1", make) for _ in range(2))
    assert make.call_count == 1
    assert first.tobytes() == second.tobytes()
    assert (first.dtype, first.shape) == (second.dtype, second.shape)
    assert [path.name for path in folder.iterdir()] == ["t-1.table"]
    kept_table("t", "2", make)
    assert make.call_count == 2


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "text", "folder"])
def test_a_damaged_file_is_ignored_and_made_anew(folder, damage):
    kept_table("t", "1", maker())
    path = folder / "t-1.table"
    data = bytearray(path.read_bytes())
    if damage == "cut":
        path.write_bytes(data[:-7])
    elif damage == "flipped":
        data[-3] ^= 16
        path.write_bytes(data)
    elif damage == "folder":
        path.unlink()
        path.mkdir()
    else:
        path.write_bytes(b"" if damage == "empty" else b"no table at all")
    make = maker()
    assert np.array_equal(kept_table("t", "1", make), TABLE)
    assert make.call_count == 1
    if damage != "folder":
        assert np.array_equal(kept_table("t", "1", make), TABLE)
        assert make.call_count == 1
    assert not [one for one in folder.iterdir() if one.name.startswith(".")]


def test_a_cache_that_is_off_or_cannot_be_written_to_is_not_used(tmp_path, monkeypatch):
    make = maker()
    monkeypatch.setenv(VARIABLE, "off")
    assert cache_folder() is None
    (tmp_path / "file").write_text("")
    for number in range(2):
        assert kept_table("t", "1", make) is TABLE
        assert make.call_count == number + 1
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file" / "cache"))
    assert kept_table("t", "1", make) is TABLE


def test_it_lies_where_the_system_keeps_such_things(tmp_path, monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("LOCALAPPDATA", raising=False)
    for system, place in (
        ("linux", ".cache/forest-sensing"),
        ("darwin", "Library/Caches/forest-sensing"),
        ("win32", "AppData/Local/forest-sensing"),
    ):
        monkeypatch.setattr(kept_tables.sys, "platform", system)
        assert cache_folder() == tmp_path / place


@pytest.mark.slow
def test_discs_are_the_same_to_the_bit_with_and_without_and_by_many_at_once(tmp_path):
    code = (
        "import hashlib, numpy as np\n"
        "from forest_addon.acoustics import disc_table as d\n"
        "ka, angle = np.linspace(0, 120, 50)[:, None], np.linspace(0, 1.5, 40)\n"
        "data = d.tabulated(ka, angle).tobytes() + d._splines().tobytes() + d.bound_maxima().tobytes()\n"
        "print(hashlib.sha256(data).hexdigest())"
    )

    def process(where):
        environment = dict(os.environ) | {VARIABLE: where, "PYTHONPATH": str(ROOT)}
        return subprocess.Popen(
            [sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, text=True
        )

    cache = str(tmp_path / "cache")
    processes = [process("off"), *(process(cache) for _ in range(2))]
    said = {one.communicate()[0] for one in processes}
    assert len(said) == 1
    assert len(said.pop().strip()) == 64
    names = sorted(path.name for path in (tmp_path / "cache").iterdir())
    version = disc_table._version()
    assert names == [f"disc-maxima-{version}.table", f"disc-splines-{version}.table"]


# --------------------------------------------------------------------------------------- nonuniform
# Fast sums over echoes against the direct sum: tolerances, hard cases, and the kernel alone.

START, SPACING, COUNT, SPEED = 60e3, 50.0, 401, 340.0


def direct(amplitude, delay, start=START, spacing=SPACING, count=COUNT):
    """(K,) Σ A·e^{-i2πfτ} and Σ max|A| of all echoes; whole turns are exact in integers."""
    total, size = np.zeros(count, dtype=np.complex128), 0.0
    frequency = start + spacing * np.arange(count)
    for rows in np.array_split(np.arange(len(delay)), len(delay) // 100 + 1):
        values = amplitude(frequency, rows)
        turns = np.mod(np.outer(frequency, delay[rows]), 1.0)
        total += (values * np.exp(-2j * np.pi * turns)).sum(axis=1)
        size += np.abs(values).max(axis=0).sum()
    return total, size


def leaves(model, count, seed=1):
    """Amplitudes of random leaves, their delays, and how far their own responses reach."""
    rng = np.random.default_rng(seed)
    distance, radius = rng.uniform(0.5, 6, count), rng.uniform(0.002, 0.06, count)
    angle = np.arccos(rng.uniform(0, 1, count))

    def amplitude(frequency, rows):
        k = 2 * np.pi * frequency[:, None] / SPEED
        return backscatter_amplitude(k * radius[rows], angle[rows], model) / (
            k * distance[rows] ** 2
        )

    return amplitude, 2 * distance / SPEED, 2 * radius * np.sin(angle) / SPEED


@pytest.mark.usefixtures("computed_by")
@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_tolerance_is_kept(model: str) -> None:
    amplitude, delay, reach = leaves(model, 600)
    exact, size = direct(amplitude, delay)
    errors, most = [], 0.0
    for tolerance in (1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10, 1e-12):
        found = sum_delayed(
            amplitude, delay, START, SPACING, COUNT, tolerance=tolerance, reach=reach
        )
        errors.append(np.abs(found.spectrum - exact).max() / size)
        rough = 1e-5 if model == "exact" else 0.0  # splines are no smoother
        assert errors[-1] <= max(tolerance, rough)
        assert errors[-1] <= 1.5 * found.error
        assert found.error <= max(tolerance, rough) + 1e-11  # rounding of the carrier
        assert found.size == pytest.approx(size, rel=0.05)
        nodes = sum(number * count for number, count in found.nodes.items()) / 600
        assert most <= 1.5 * nodes < COUNT
        most = nodes
    assert errors[0] > 1e-9  # it is not the direct sum that was tested
    unknown = sum_delayed(amplitude, delay, START, SPACING, COUNT, tolerance=1e-4)
    assert np.abs(unknown.spectrum - exact).max() <= 1e-4 * size


@pytest.mark.usefixtures("computed_by")
@pytest.mark.parametrize(
    ("count", "tolerance"), [(1, 0.0), (2, 1e-3), (3, 1e-12), (7, 1e-6), (64, 1e-12), (65, 1e-3)]
)
def test_few_bins(count: int, tolerance: float) -> None:
    amplitude, delay, _ = leaves("piston", 2000)
    exact, size = direct(amplitude, delay, count=count)
    found = sum_delayed(amplitude, delay, START, SPACING, count, tolerance=tolerance)
    assert found.spectrum.shape == (count,)
    assert np.abs(found.spectrum - exact).max() <= max(tolerance, 1e-13) * size


@pytest.mark.usefixtures("computed_by")
@pytest.mark.parametrize("echoes", [0, 1, 2])
def test_few_echoes(echoes: int) -> None:
    amplitude, delay, _ = leaves("paper", echoes)
    exact, size = direct(amplitude, delay, count=40000, spacing=0.5)  # enough for the fast way
    found = sum_delayed(amplitude, delay, START, 0.5, 40000, tolerance=1e-6)
    assert np.abs(found.spectrum - exact).max() <= 1e-6 * size
    if not echoes:
        assert (found.spectrum == 0).all()
        assert found.size == found.error == 0
        assert found.nodes == {}


def ones(frequency, rows):
    return np.ones((len(frequency), len(rows)))


@pytest.mark.usefixtures("computed_by")
@pytest.mark.medium
@pytest.mark.parametrize(
    "delay",
    [
        np.zeros(500),
        np.arange(500) / (SPACING * 810),  # on the points of the grid (2·405)
        np.arange(500) / SPACING,  # whole records: all the same
        np.nextafter(np.arange(500) / SPACING, -1),  # the last point, which is also the first
        -np.linspace(0, 0.5, 500),
        2.0**20 + np.linspace(0, 0.01, 500),  # 8e10 periods of the carrier
    ],
    ids=["zero", "on the grid", "records", "just before", "negative", "huge"],
)
def test_hard_delays(delay: np.ndarray) -> None:
    exact, size = direct(ones, delay)
    rounding = 2 * math.pi * 2.0**-52 * 80e3 * np.abs(delay).max()
    for tolerance in (1e-3, 1e-6, 1e-10):
        found = sum_delayed(ones, delay, START, SPACING, COUNT, tolerance=tolerance)
        assert np.abs(found.spectrum - exact).max() <= (tolerance + rounding) * size
        assert found.nodes.keys() != {COUNT}  # the fast way was taken


@pytest.mark.usefixtures("computed_by")
def test_discs_of_no_size_add_nothing() -> None:
    def amplitude(frequency, rows):
        k = 2 * np.pi * frequency[:, None] / SPEED
        return backscatter_amplitude(k * np.zeros(len(rows)), np.ones(len(rows)), "piston") / k

    found = sum_delayed(amplitude, np.full(500, 0.01), START, SPACING, COUNT)
    assert (found.spectrum == 0).all()
    assert found.error == 0


@pytest.mark.usefixtures("computed_by")
def test_an_amplitude_that_is_not_smooth_is_said_to_be_off() -> None:
    rng = np.random.default_rng(7)
    delay, kink = rng.uniform(0, 0.02, 300), rng.uniform(62e3, 78e3, 300)

    def amplitude(frequency, rows):
        smooth = np.ones((len(frequency), len(rows)))
        return np.where(rows % 3 == 0, np.abs(frequency[:, None] - kink[rows]) / 1e4, smooth)

    exact, size = direct(amplitude, delay)
    found = sum_delayed(amplitude, delay, START, SPACING, COUNT, tolerance=1e-8)
    error = np.abs(found.spectrum - exact).max() / size
    assert 1e-8 < error <= found.error < 100 * error


@pytest.mark.usefixtures("computed_by")
@pytest.mark.medium
@pytest.mark.parametrize(
    ("sums", "tolerance", "wrong"),
    [(1, 1e-6, 0.0), (2, 1e-6, 100.0), (3, 0.0, 0.3), (40, 1e-3, 0.3)],
)
def test_weighted_sums_of_the_same_echoes(sums: int, tolerance: float, wrong: float) -> None:
    """Also with a wrong reach, for which some are computed again; 40 are several blocks."""
    amplitude, delay, reach = leaves("piston", 900)
    weights = np.random.default_rng(5).uniform(-1, 1, (900, sums))
    found = sum_delayed(
        amplitude, delay, START, SPACING, COUNT,
        tolerance=tolerance, reach=wrong * reach, weights=weights,
    )  # fmt: skip
    assert found.spectrum.shape == (sums, COUNT)
    assert sum(found.nodes.values()) == 900
    for number in (0, sums - 1):
        exact, size = direct(lambda f, rows, n=number: amplitude(f, rows) * weights[rows, n], delay)
        error = np.abs(found.spectrum[number] - exact).max()
        assert error <= max(tolerance, 1e-13) * found.size
        assert size < found.size
        assert tolerance == 0 or error > 1e-12 * size  # it is not the direct sum that was tested


@pytest.mark.usefixtures("computed_by")
@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 0.0])
@pytest.mark.parametrize("conjugate", [False, True])
def test_echoes_that_sound_twice(tolerance: float, conjugate: bool) -> None:
    """As twice as many would, in weighted sums, too."""
    amplitude, delay, reach = leaves("paper", 900)
    rng = np.random.default_rng(6)
    second, weights = rng.choice([-1.0, 1.0], 900), rng.uniform(-1, 1, (900, 2))
    again = delay + rng.uniform(0.0, 1e-3, 900)

    def other(frequency, rows):
        value = amplitude(frequency, rows)
        return (value.conj() if conjugate else value) * second[rows]

    for several in (None, weights):
        found = sum_delayed(
            amplitude, np.stack([delay, again]), START, SPACING, COUNT, tolerance=tolerance,
            reach=reach, weights=several, second=second, conjugate=conjugate,
        )  # fmt: skip
        assert sum(found.nodes.values()) == 900
        for number, spectrum in enumerate(np.atleast_2d(found.spectrum)):
            by = np.ones(900) if several is None else several[:, number]
            sums = [
                direct(lambda f, rows, of=of, by=by: of(f, rows) * by[rows], late)
                for of, late in ((amplitude, delay), (other, again))
            ]
            error = np.abs(spectrum - sums[0][0] - sums[1][0]).max() / found.size
            assert error <= max(tolerance, 1e-13)
            assert error <= found.error + 1e-15
            if several is None:
                assert found.size == pytest.approx(sums[0][1] + sums[1][1], rel=0.05)
            assert tolerance == 0 or error > 1e-12  # it is not the direct sum that was tested


def test_weighted_sums_of_nothing() -> None:
    amplitude, delay, _ = leaves("paper", 0)
    found = sum_delayed(
        amplitude, delay, START, 0.5, 40000, tolerance=1e-6, weights=np.empty((0, 2))
    )
    assert found.spectrum.shape == (2, 40000)
    assert not found.spectrum.any()


@pytest.mark.usefixtures("computed_by")
@pytest.mark.parametrize(("width", "stated"), list(enumerate(ALIASING, NARROWEST)))
def test_aliasing_of_the_kernel(width: int, stated: float) -> None:
    """Every delay between two points, every bin: within the stated bound, and no wider than needed."""
    bins, delays = 64, np.linspace(0, 1 / 128, 65)
    worst = 0.0
    for delay in delays:
        grid = DelayGrid(bins, 1, width)
        grid.add(np.array([delay]), np.zeros(1), np.ones((1, 1)), np.ones((1, 1)))
        exact = np.exp(-2j * np.pi * delay * (np.arange(bins) - bins // 2))
        worst = max(worst, np.abs(grid.spectrum(np.ones((1, bins))) - exact).max())
    assert worst < stated
    assert worst > 0.5 * stated
