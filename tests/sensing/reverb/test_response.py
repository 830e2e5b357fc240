"""The forest's impulse response against scalar loops, and its hard cases (PHYSICS 5.8)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from references.rays_brute import BruteCaster
from references.reverb_direct import reverb_spectrum_direct

from forest_addon.acoustics.air import absorption
from forest_addon.acoustics.ground import spherical_reflection, surface_impedance
from forest_addon.base.rng import stream
from forest_addon.base.trimesh import WOOD, TriMesh
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.reverb.band import roll_off
from forest_addon.sensing.reverb.response import ImpulseResponse, impulse_response
from forest_addon.sensing.reverb.sums import scattering
from forest_addon.sensing.reverb.sums.scattering import scattered_spectrum, trunk_paths
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.spec import Air, Reverb

AIR = Air(sound_speed=343.0)
NOTHING = Trunks(np.empty((0, 2)), np.empty(0), np.empty(0, np.int64))


def forest(*rows: tuple[float, float, float]) -> Trunks:
    table = np.array(rows, dtype=np.float64).reshape(-1, 3)
    return Trunks(table[:, :2], table[:, 2], np.arange(len(table)))


def listen(
    trunks: Trunks, air: Air = AIR, wood: BruteCaster | None = None, **settings: Any
) -> ImpulseResponse:
    reverb = Reverb(**{"duration": 0.4, "sample_rate": 8000.0, **settings})
    return impulse_response(trunks, reverb, air, wood=wood)


def scattered_trunks(count: int, seed: int = 0) -> Trunks:
    rng = np.random.default_rng(seed)
    return Trunks(rng.uniform(-15, 35, (count, 2)), rng.uniform(0.02, 0.4, count), np.arange(count))


@pytest.mark.medium
@pytest.mark.parametrize("conditions", [(20.0, 50.0, 101.325), (-20.0, 10.0, 80.0)])
def test_spectra_against_scalar_loops(conditions: tuple[float, float, float]) -> None:
    """Every part at single frequencies; five radii over two octaves of panels, one twice."""
    trunks = forest(
        (9, 11, 0.3), (12, 9, 0.3), (3, 10, 0.07), (25, 10, 0.11), (10, 10, 0.04), (-5, 30, 0.5)
    )
    source, receiver = np.array([5.0, 10.0]), np.array([15.0, 10.5])
    air = Air(temperature_c=conditions[0], humidity=conditions[1], pressure_kpa=conditions[2])
    spacing = 2.5
    frequency = spacing * np.arange(4801)
    loss = absorption(frequency, *conditions)
    paths = trunk_paths(trunks, source, receiver, 1.5, 0.6)
    spectrum = scattered_spectrum(paths, spacing, loss, air.speed())
    for bin_ in [0, 1, 2, 3, 10, 55, 217, 1000, 2345, 3999, 4800]:
        expected = reverb_spectrum_direct(
            frequency[bin_],
            (*source, 1.5),
            (*receiver, 1.0),
            [(x, y, a) for (x, y), a in zip(trunks.position, trunks.radius, strict=True)],
            speed=air.speed(),
            air=conditions,
            ground=-0.6,
            strength=1.5,
            spreading=0.6,
        )[2]
        assert abs(spectrum[bin_] - expected) < 1e-11 * np.abs(spectrum).max()


def test_samples_against_scalar_loops() -> None:
    trunks = forest((9, 11, 0.3), (12, 9, 0.2), (3, 10, 0.07))
    response = listen(trunks, Air(), duration=2.0, ground=-0.6, spreading=0.5)
    spectra = np.fft.rfft([response.direct, response.ground, response.trees])  # 0.5 Hz
    for bin_ in [100, 1001, 4444, 6999, 7190]:
        expected = reverb_spectrum_direct(
            bin_ * 0.5,
            (5.0, 10.0, 1.5),
            (15.0, 10.0, 1.5),
            [(x, y, a) for (x, y), a in zip(trunks.position, trunks.radius, strict=True)],
            speed=Air().speed(),
            air=(20.0, 50.0, 101.325),
            ground=-0.6,
            strength=2.0,
            spreading=0.5,
        )
        error = np.abs(spectra[:, bin_] - expected) / np.abs(spectra).max(axis=1)
        assert (error < [2e-9, 2e-9, 1e-5]).all()  # trees: the ringing is cut off after 0.3 s


def test_direct_and_ground_delay_and_level() -> None:
    """An arrival on a sample is one sample of height 1/d but for air and the band's end."""
    response = listen(
        NOTHING,
        source=(0.0, 0.0, 3.0),
        receiver=(4 * 3.43, 0.0, 3.0),
        sample_rate=10_000.0,
        air=Air(sound_speed=343.0, humidity=100.0),
    )
    assert np.argmax(response.direct) == 400
    assert response.direct_delay == pytest.approx(0.04)
    assert response.direct[400] == pytest.approx(0.95 / (4 * 3.43), rel=0.02)  # the air takes 1.8 %
    bounced = math.hypot(4 * 3.43, 6.0)
    assert np.argmax(response.ground) == round(bounced / 343 * 10_000)
    assert not response.trees.any()
    np.testing.assert_array_equal(response.samples, response.direct + response.ground)
    assert (response.trunks, response.continued, response.late, response.clamped) == (0, 0, 0, 0)


@pytest.mark.medium
@pytest.mark.parametrize(("x", "angle"), [(25.0, math.pi), (-5.0, math.pi), (10.0, 0.0)])
def test_tree_in_line(x: float, angle: float) -> None:
    """Straight back the echo leads the axis by a diameter's way, straight on it is with the axis."""
    trunks = forest((x, 10.0, 0.3))
    paths = trunk_paths(trunks, np.array([5.0, 10]), np.array([15.0, 10]), 2.0, 0.7)
    assert paths.angle[0] == pytest.approx(angle, abs=1e-12)
    response = listen(trunks, sample_rate=48_000.0)
    axis = paths.length[0] / 343.0
    first = (axis - 2 * 0.3 * math.sin(angle / 2) / 343.0) * 48_000
    energy = np.cumsum(response.trees**2)
    assert energy[int(first) - 10] < 1e-2 * energy[-1]
    assert abs(np.argmax(np.abs(response.trees)) - first) < 3


@pytest.mark.parametrize("offset", [0.0, 0.1, 0.2999])
def test_receiver_on_or_in_a_trunk(offset: float) -> None:
    response = listen(forest((15 + offset, 10, 0.3), (9, 9, 0.1)))
    assert np.isfinite(response.samples).all()
    assert response.clamped == 1
    paths = trunk_paths(
        forest((15 + offset, 10, 0.3)), np.array([5.0, 10]), np.array([15.0, 10]), 2.0, 0.7
    )
    assert paths.weight[0] == pytest.approx(2.0 / ((10 + offset) * 0.3**0.7))
    assert listen(forest((15.3001, 10, 0.3))).clamped == 0


def test_source_is_receiver() -> None:
    place = {"source": (0.0, 0.0, 1.5), "receiver": (0.0, 0.0, 1.5)}
    response = listen(forest((3, 4, 0.2)), **place)
    assert np.isfinite(response.samples).all()
    assert response.direct_delay == 0
    assert np.abs(response.direct).max() < 1.01 / 0.1  # as at 0.1 m
    assert abs(np.argmax(np.abs(response.trees)) - (10 - 0.4) / 343 * 8000) < 2


def test_shorter_than_the_direct_delay() -> None:
    response = listen(scattered_trunks(5), duration=0.001, source=(-90.0, 0.0, 1.0))
    assert len(response.samples) == 8
    assert np.isfinite(response.samples).all()
    assert not response.samples.any()
    assert response.late == 5
    assert response.direct_delay > 0.25
    assert len(listen(NOTHING, duration=1e-6).samples) == 1


def test_late_trunks_are_counted_and_nothing_wraps() -> None:
    near, far = (10.0, 12.0, 0.2), (10.0, 400.0, 0.2)
    both = listen(forest(near, far), duration=0.2)
    assert (both.trunks, both.late) == (1, 1)
    np.testing.assert_array_equal(both.samples, listen(forest(near), duration=0.2).samples)
    long = listen(forest(near, far), duration=3.0)
    assert (long.trunks, long.late) == (2, 0)
    peak = np.abs(both.trees).max()
    np.testing.assert_allclose(both.samples, long.samples[:1600], atol=1e-6 * peak)
    arrival = int(math.hypot(5, 390) * 2 / 343 * 8000)
    assert np.abs(long.trees[arrival - 20 : arrival + 20]).max() > 1e-4 * peak


@pytest.mark.slow
def test_sizes_from_1e_3_to_500() -> None:
    response = listen(
        forest((9, 12, 1.2), (11, 20, 0.01), (11, 5, 1e-5), (2, 2, 0.0)),
        sample_rate=48_000.0,
        duration=0.2,
    )
    assert np.isfinite(response.trees).all()
    alone = listen(forest((11, 20, 0.01)), sample_rate=48_000.0, duration=0.2)
    assert 0 < np.abs(alone.trees).max() < np.abs(response.trees).max()


@pytest.mark.parametrize("temperature", [-40.0, 50.0])
@pytest.mark.parametrize("humidity", [1e-6, 100.0])
def test_extreme_air_and_far_paths(temperature: float, humidity: float) -> None:
    air = Air(temperature_c=temperature, humidity=humidity, pressure_kpa=60.0)
    response = listen(
        forest((4000, 10, 0.2)), air, duration=30.0, sample_rate=2000.0, receiver=(2000.0, 10, 1.5)
    )
    assert np.isfinite(response.samples).all()
    assert response.trunks == 1


def test_any_number_of_trunks_and_bins(monkeypatch: pytest.MonkeyPatch) -> None:
    trunks = scattered_trunks(13)
    whole = listen(trunks)
    monkeypatch.setattr(scattering, "TRUNKS_AT_ONCE", 5)
    monkeypatch.setattr(scattering, "BINS_AT_ONCE", 17)
    steps: list[tuple[int, int]] = []
    parts = impulse_response(
        trunks,
        Reverb(duration=0.4, sample_rate=8000.0),
        AIR,
        progress=lambda done, total: steps.append((done, total)),
    )
    np.testing.assert_allclose(parts.samples, whole.samples, atol=1e-13)
    assert steps[-1] == (13, 13)
    assert [done for done, _ in steps] == sorted(done for done, _ in steps)


def test_sum_of_single_trunks_and_order() -> None:
    trunks = scattered_trunks(6)
    together = listen(trunks, duration=0.6)
    rows = np.column_stack([trunks.position, trunks.radius])
    apart = [listen(forest(tuple(row)), duration=0.6).trees for row in rows]
    np.testing.assert_allclose(
        together.trees, np.sum(apart, axis=0), atol=1e-6 * np.abs(apart).max()
    )


def test_reciprocity() -> None:
    """With spherical spreading on both legs, source and receiver can change places."""
    trunks = scattered_trunks(6)
    ends = {"source": (1.0, 2.0, 1.2), "receiver": (11.0, 8.0, 2.5)}
    there = listen(trunks, spreading=1.0, **ends)
    back = listen(trunks, spreading=1.0, source=ends["receiver"], receiver=ends["source"])
    np.testing.assert_allclose(there.samples, back.samples, atol=1e-13)


def wall(low: float, high: float) -> TriMesh:
    """Across the way from (5, 10) to (15, 10), from one height to another."""
    corners = [(10, 9, low), (10, 11, low), (10, 11, high), (10, 9, high)]
    return TriMesh.of_part(np.array(corners), np.array([[0, 1, 2], [0, 2, 3]]), WOOD)


def caster(mesh: TriMesh) -> BruteCaster:
    identity = np.eye(3, 4)[None]
    one = np.zeros(1, np.int64)
    return BruteCaster(SceneGeometry((mesh,), identity, one, ("wall",), one, one))


@pytest.mark.medium
@pytest.mark.parametrize(
    ("low", "high", "direct", "ground"),
    [
        (0.0, 3.0, False, False),
        (1.0, 3.0, False, True),
        (0.0, 0.5, True, False),
        (4, 5, True, True),
    ],
)
def test_line_of_sight(low: float, high: float, direct: bool, ground: bool) -> None:
    free = listen(scattered_trunks(3))
    response = listen(scattered_trunks(3), wood=caster(wall(low, high)))
    assert (response.direct_clear, response.ground_clear) == (direct, ground)
    np.testing.assert_array_equal(response.direct, free.direct * direct)
    np.testing.assert_array_equal(response.ground, free.ground * ground)
    np.testing.assert_array_equal(response.trees, free.trees)


def test_the_ground_does_not_hide_its_own_sound() -> None:
    corners = np.array([(-99.0, -99, 0.001), (99, -99, 0.001), (99, 99, 0.001), (-99, 99, 0.001)])
    floor = TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), WOOD)
    low = listen(NOTHING, wood=caster(floor), source=(5.0, 10.0, 0.02))
    assert low.ground_clear
    assert listen(NOTHING, wood=caster(floor)).ground_clear


@pytest.mark.medium
def test_continuation() -> None:
    trunks = scattered_trunks(40)
    settings = Reverb(duration=0.4, sample_rate=4000.0, continue_to=60.0)
    field = ((-15.0, -15.0), (50.0, 50.0))

    def run(seed: int) -> ImpulseResponse:
        return impulse_response(trunks, settings, AIR, rng=stream(seed, "beyond"), field=field)

    first = run(1)
    assert first.continued > 50
    assert first.trunks == 40 + first.continued
    np.testing.assert_array_equal(first.samples, run(1).samples)
    assert not np.array_equal(first.samples, run(2).samples)
    with pytest.raises(ValueError, match="continue_to"):
        impulse_response(trunks, settings, AIR)


def test_roll_off() -> None:
    share = np.linspace(0, 0.5, 1001)
    gain = roll_off(share)
    assert (gain[share <= 0.45] == 1).all()
    assert gain[-1] == 0
    assert (np.diff(gain) <= 0).all()
    assert abs(gain[950] - 0.5) < 1e-9


def test_a_hard_surface_is_a_constant_of_one_and_a_soft_one_is_quieter() -> None:
    hard = listen(NOTHING, surface="asphalt", flow_resistivity=1e6).ground
    mirror = listen(NOTHING, ground=1.0).ground
    assert np.linalg.norm(hard - mirror) < 0.05 * np.linalg.norm(mirror)
    soft = listen(NOTHING, surface="snow").ground
    assert np.linalg.norm(soft) < 0.8 * np.linalg.norm(mirror)


def test_the_ground_has_the_spectrum_of_its_reflection() -> None:
    """At single frequencies, by both impedance models."""
    path, rise = math.hypot(10.0, 3.0), 3.0
    frequency = np.fft.rfftfreq(16_000, 1 / 8000.0)
    bins = [200, 1000, 4000, 7000]
    for model in ("miki", "delany-bazley"):
        settings = {"surface": "grass", "duration": 2.0}
        found = np.fft.rfft(listen(NOTHING, impedance_model=model, **settings).ground)
        mirror = np.fft.rfft(listen(NOTHING, ground=1.0, duration=2.0).ground)
        impedance = surface_impedance(frequency[bins], 200.0, model)
        expected = spherical_reflection(frequency[bins], path, rise, impedance, 343.0)
        np.testing.assert_allclose(found[bins] / mirror[bins], expected, atol=2e-3)


def test_what_a_soft_ground_sends_after_a_short_record_is_not_heard_at_its_begin() -> None:
    """Against a long record; the path of 100.04 m ends 8 ms before the short one does."""
    far = {"source": (0.0, 0.0, 1.5), "receiver": (100.0, 0.0, 1.5), "sample_rate": 24e3}
    short, long = (
        listen(NOTHING, surface="snow", duration=seconds, **far).ground for seconds in (0.3, 4.0)
    )
    assert np.abs(short - long[: len(short)]).max() < 1e-5 * np.abs(long).max()


@pytest.mark.slow
@pytest.mark.parametrize("rate", [1000.0, 192_000.0])
def test_slow_and_fast_sampling(rate: float) -> None:
    response = listen(forest((9, 11, 0.3)), sample_rate=rate, duration=0.1, surface="snow")
    assert len(response.samples) == round(0.1 * rate)
    assert np.isfinite(response.samples).all()
    assert np.abs(response.trees).max() > 0
