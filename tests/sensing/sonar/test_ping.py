"""The foliage echo against scalar loops, and its hard cases (PHYSICS 4.4)."""

import math
from typing import Any

import mpmath
import numpy as np
import pytest
from references.discs import HardDisc
from references.echoes import (
    LINEAR,
    amplitude_of,
    culled,
    discs_of,
    leaf_direct,
    leaf_discs,
    scene_of,
)
from references.rays import BruteCaster

from forest_addon.acoustics import nonuniform
from forest_addon.acoustics.disc import backscatter, backscatter_amplitude
from forest_addon.base.trimesh import LEAF, WOOD, TriMesh
from forest_addon.growth.mesh.leaves import measure_leaves
from forest_addon.sensing.rays.geometry import apply_transform
from forest_addon.sensing.sonar import search
from forest_addon.sensing.sonar.beam import (
    BeamPattern,
    GaussianBeam,
    Horseshoe,
    MeasuredBeam,
    MeasuredSphere,
    Omni,
    beam_offsets,
)
from forest_addon.sensing.sonar.echo import Echo
from forest_addon.sensing.sonar.leaves import LeafDiscs, LeafEchoes
from forest_addon.sensing.sonar.ping import ping
from forest_addon.sensing.sonar.station import Equipment, SonarPose, poses_of
from forest_addon.sensing.trajectory import frame_of, looking
from forest_addon.spec import Air, Sonar as AnySonar

AIR = Air(sound_speed=340.0)


def Sonar(**settings: Any) -> AnySonar:
    """A sonar to which leaves are pistons, so that scalar loops can follow."""
    return AnySonar(**({"leaf_model": "piston"} | settings))


def foliage_of(count: int, seed: int = 0, far: float = 5.0) -> LeafDiscs:
    """Leaves of every direction in a shell about (0, 0, 2), small enough to be points."""
    rng = np.random.default_rng(seed)
    way = rng.normal(size=(count, 3))
    way *= (rng.uniform(1.3, far, count) / np.linalg.norm(way, axis=1))[:, None]
    return discs_of(
        way + np.array([0, 0, 2.0]), rng.normal(size=(count, 3)), rng.uniform(0.005, 0.02, count)
    )


@pytest.mark.parametrize("model", ["piston", "paper"])
@pytest.mark.parametrize(("absorption", "elevation"), [(True, 20.0), (False, -90.0), (False, 90.0)])
def test_spectrum_against_scalar_loops(model: str, absorption: bool, elevation: float) -> None:
    discs = foliage_of(60)
    sonar = Sonar(
        leaf_model=model,
        absorption=absorption,
        azimuth_deg=130.0,
        elevation_deg=elevation,
        beam_width_deg=(70.0, 40.0),
        cull=0.0,
        tolerance=0.0,
    )
    air = Air(temperature_c=5.0, humidity=80.0)
    echo = ping(discs, sonar, air)
    assert numbers(echo) == list(range(60))
    assert echo.cull_bound == 0
    leaves = list(zip(discs.centre, discs.normal, discs.radius, strict=True))
    for bin_ in (0, 1, 333, len(echo.frequency) // 2, len(echo.frequency) - 1):
        wanted = sum(leaf_direct(float(echo.frequency[bin_]), leaf, sonar, air) for leaf in leaves)
        assert abs(echo.spectrum[bin_] - wanted) < 1e-11 * np.abs(echo.spectrum).max()
    some = echo.frequency[::20]
    for row in echo.heard.number[:3]:
        sizes = [abs(leaf_direct(float(f), leaves[row], sonar, air)) for f in some]
        hann = np.sin(np.pi * (some - 60e3) / 20e3) ** 2
        assert amplitude_of(echo, row) == pytest.approx(np.average(sizes, weights=hann), rel=1e-2)


def numbers(echo: Echo) -> list[int]:
    """The leaves that are heard, in order of their numbers."""
    return sorted(set(echo.heard.number.tolist()))


def analytic_at(echo: Echo, time: np.ndarray) -> np.ndarray:
    """The analytic signal between samples, from the spectrum and the stated window."""
    low, high = 60e3, 80e3
    window = np.sin(np.pi * (echo.frequency - low) / (high - low)) ** 2
    turned = np.exp(2j * np.pi * np.outer(time, echo.frequency))
    return np.asarray(turned @ (window * echo.spectrum) / window.sum())


@pytest.mark.medium
@pytest.mark.parametrize(
    ("distance", "model"), [(1.3, "exact"), (3.3333, "piston"), (14.9, "paper"), (14.9, "exact")]
)
def test_single_leaf_has_its_delay_and_level(distance: float, model: str) -> None:
    """Face-on and on the axis: |A| = L/kr², at 2r/c to a hundredth of a sample.

    The exact disc's own phase falls a little with the frequency, which is 0.04 samples of delay.
    """
    radius = 0.02  # its far field starts at 2ka² = 1.2 m
    discs = discs_of([[distance, 0, 2]], [1.0, 0, 0], radius)
    echo = ping(discs, Sonar(absorption=False, leaf_model=model), AIR)
    delay = 2 * distance / 340.0
    time = delay + np.linspace(-1, 1, 2001) / echo.sample_rate
    envelope = np.abs(analytic_at(echo, time))
    k = 2 * np.pi * echo.frequency / 340.0
    hann = np.sin(np.pi * (echo.frequency - 60e3) / 20e3) ** 2
    own = np.exp(2j * np.pi * np.outer(time - delay, echo.frequency))
    own = np.abs(own @ (hann * backscatter_amplitude(k * radius, 0.0, model) / k))
    assert abs(time[own.argmax()] - delay) * echo.sample_rate < (0.05 if model == "exact" else 0.01)
    assert abs(time[envelope.argmax()] - time[own.argmax()]) * echo.sample_rate < 0.01
    size = backscatter(k * radius, 0.0, model) / k
    level = float(np.average(size, weights=hann)) / distance**2
    if model == "piston":
        assert level == pytest.approx(2 * np.pi * 70e3 / 340 * radius**2 / (2 * distance**2))
    assert envelope.max() == pytest.approx(level, rel=1e-4)
    assert amplitude_of(echo, 0) == pytest.approx(level, rel=1e-3)
    nearest = int(np.argmax(echo.envelope))
    assert abs(echo.time[nearest] - delay) * echo.sample_rate < 1
    assert echo.envelope[nearest] == pytest.approx(level, rel=0.02)
    # Time and frequency say the same: the samples are the analytic signal at their times.
    some = slice(nearest - 20, nearest + 20)
    signal = analytic_at(echo, echo.time[some])
    np.testing.assert_allclose(echo.impulse_response[some], signal.real, atol=1e-9 * level)
    np.testing.assert_allclose(echo.envelope[some], np.abs(signal), atol=1e-9 * level)


def test_no_leaf_in_range_is_silence() -> None:
    for discs in (
        discs_of(np.empty((0, 3)), [1.0, 0, 0], 0.02),
        discs_of([[99, 0, 0]], [1.0, 0, 0], 1),
    ):
        echo = ping(discs, Sonar(), AIR)
        assert len(echo.time) > 0
        for array in (echo.spectrum, echo.impulse_response, echo.envelope):
            assert not array.any()
        assert len(echo.heard) == 0
        assert echo.cull_bound == 0
        assert echo.far == len(discs)


def test_leaves_out_of_range_are_left_out_and_counted() -> None:
    centre = [[0, 0, 2], [0.049, 0, 2], [0.051, 0, 2], [15, 0, 2], [15.001, 0, 2], [np.nan, 0, 2]]
    echo = ping(discs_of(centre, [1.0, 0, 0], 0.02), Sonar(cull=0.0), AIR)
    assert (echo.near, echo.far, echo.broken, echo.leaves) == (2, 1, 1, 6)
    assert numbers(echo) == [2, 3]
    assert np.isfinite(echo.impulse_response).all()


@pytest.mark.parametrize("model", ["piston", "paper"])
def test_leaf_without_area_adds_nothing(model: str) -> None:
    one = ping(discs_of([[2, 0, 2]], [1.0, 0, 0], 0.02), Sonar(leaf_model=model), AIR)
    two = ping(
        discs_of([[2, 0, 2], [1, 0, 2]], [1.0, 0, 0], [0.02, 0.0]), Sonar(leaf_model=model), AIR
    )
    np.testing.assert_array_equal(one.spectrum, two.spectrum)
    assert (numbers(two), two.cull_bound) == ([0], 0.0)


@pytest.mark.parametrize("far", [10.2, 14.99])
def test_late_echoes_do_not_wrap(far: float) -> None:
    """The record ends after the last echo's tail, and holds nothing before the first echo."""
    echo = ping(discs_of([[far, 0, 2]], [1.0, 0, 0], 0.02), Sonar(absorption=False), AIR)
    delay = 2 * far / 340.0
    assert echo.time[-1] > delay + 60 / 20e3
    peak = echo.envelope.max()
    assert echo.envelope[echo.time < delay - 64 / 20e3].max() < 2e-6 * peak
    near = ping(discs_of([[0.06, 0, 2]], [1.0, 0, 0], 0.02), Sonar(absorption=False), AIR)
    assert near.envelope[near.time > 0.12 / 340.0 + 60 / 20e3].max() < 2e-6 * near.envelope.max()


@pytest.mark.parametrize("band", [(69_900.0, 70_000.0), (60e3, 200e3), (1000.0, 1030.0)])
def test_any_band(band: tuple[float, float]) -> None:
    """A band of 100 Hz, one that ends at half the sampling rate, one at its lowest."""
    rate = 400e3 if band[0] > 60e3 - 1 else 10e3
    settings = Sonar(band=band, sample_rate=rate, absorption=False)
    echo = ping(discs_of([[0.8, 0, 2]], [1.0, 0, 0], 0.008), settings, AIR)
    assert band[0] <= echo.frequency[0]
    assert echo.frequency[-1] <= band[1]
    assert np.isfinite(echo.impulse_response).all()
    k = 2 * np.pi * (band[0] + band[1]) / 2 / 340.0
    assert echo.envelope.max() == pytest.approx(k * 0.008**2 / 2 / 0.64, rel=0.02)


def test_record_that_no_memory_holds_is_refused() -> None:
    with pytest.raises(ValueError, match="widen the band"):
        ping(discs_of([[2, 0, 2]], [1.0, 0, 0], 0.02), Sonar(band=(69_999.999, 70_000.0)), AIR)


@pytest.mark.medium
@pytest.mark.parametrize(("model", "cull"), [("piston", 1e-4), ("paper", 1e-2), ("piston", 0.1)])
def test_culling_keeps_its_promise(
    model: str, cull: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is left out adds less than promised, at every frequency and instant."""
    monkeypatch.setattr(search, "LOUDEST", 16)
    assert len(culled(foliage_of(3000), Sonar(leaf_model=model), cull).heard) < 2500


def test_a_null_in_the_band_does_not_fool_the_culling() -> None:
    """One leaf whose lobe has its zero in the band: the promise is about the mean over the band."""
    zero = 3.8317059702075125 / (2 * 2 * np.pi * 70_123.4 / 340.0 * 0.02)
    tilt = [-math.cos(math.asin(zero)), 0, zero]
    centre = [[2, 0, 2], *([3 + i / 100, 0.5, 2] for i in range(30))]
    radius = [0.02] + [1e-4] * 30
    normal = np.array([tilt] + [[1.0, 0.2, 0.1]] * 30)
    discs = discs_of(centre, normal, radius)
    assert 0 in numbers(culled(discs, Sonar(), 0.01))


def board(x: float) -> BruteCaster:
    """A board across the beam's right half (y < 0)."""
    corners = np.array([(x, -5, -5), (x, 0, -5), (x, 0, 9), (x, -5, 9)], dtype=np.float64)
    mesh = TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), WOOD)
    return BruteCaster(scene_of(mesh))


def test_wood_hides_leaves() -> None:
    centre = [[2, 0.1, 2], [2, -0.1, 2], [1, -0.1, 2], [1.5, -0.1, 2], [1.5005, -0.1, 2]]
    discs = discs_of(centre, [1.0, 0, 0], 0.01)
    shaded = ping(discs, Sonar(), AIR, board(1.5))
    assert numbers(shaded) == [0, 2, 3, 4]  # on the board, and 0.5 mm behind
    assert shaded.hidden == 1
    open_ = ping(discs, Sonar(shading="none"), AIR, board(1.5))
    assert len(open_.heard) == 5
    assert len(ping(discs, Sonar(), AIR, None).heard) == 5
    behind = ping(discs, Sonar(), AIR, board(0.5))
    assert behind.hidden == 4


@pytest.mark.parametrize("tolerance", [0.0, 1e-6])
def test_blocks_do_not_matter(tolerance: float, monkeypatch: pytest.MonkeyPatch) -> None:
    discs = foliage_of(100)
    whole = ping(discs, Sonar(tolerance=tolerance), AIR)
    monkeypatch.setattr(nonuniform, "VALUES_AT_ONCE", 101)
    steps: list[tuple[int, int]] = []
    parts = ping(
        discs,
        Sonar(tolerance=tolerance),
        AIR,
        progress=lambda done, total: steps.append((done, total)),
    )
    scale = np.abs(whole.spectrum).max()
    np.testing.assert_allclose(parts.spectrum, whole.spectrum, atol=1e-12 * scale)
    assert steps[-1][0] == steps[-1][1] == len(parts.heard)


# --------------------------------------------------------------------------------------------- discs
# Leaves as discs: exact under every transform.


def leafy_mesh(flat: bool = True, count: int = 5) -> TriMesh:
    """Wood, and leaves of two triangles each, some of them wound the other way."""
    rng = np.random.default_rng(2)
    corners, triangles, leaf = [np.eye(3)], [[0, 1, 2]], [-1]
    for number in range(count):
        quad = rng.normal(size=(4, 3))
        if flat:
            quad[3] = quad[0] + quad[2] - quad[1]  # a parallelogram
        first = 3 + 4 * number
        corners.append(quad)
        triangles += [[first, first + 1, first + 2], [first, first + 2, first + 3]]
        if number % 2:
            triangles[-1] = triangles[-1][::-1]
        leaf += [number, number]
    part = np.where(np.array(leaf) < 0, WOOD, LEAF).astype(np.int8)
    return TriMesh(
        np.concatenate(corners),
        np.array(triangles, np.int32),
        part,
        np.array(leaf, np.int32),
        np.zeros(len(leaf), np.int32),
    )


def transform(
    linear: np.ndarray, shift: tuple[float, float, float] = (1.0, -2.0, 0.5)
) -> np.ndarray:
    return np.column_stack([linear, shift])


@pytest.mark.parametrize("flat", [True, False])
@pytest.mark.parametrize("name", list(LINEAR)[:-1])
def test_same_as_measuring_the_moved_mesh(name: str, flat: bool) -> None:
    mesh = leafy_mesh(flat)
    mesh.leaf[mesh.leaf >= 0] *= 3  # numbers may have gaps
    moved = transform(LINEAR[name])
    found = leaf_discs(scene_of(mesh, moved))
    world = TriMesh(
        apply_transform(moved, mesh.vertices), mesh.triangles, mesh.part, mesh.leaf, mesh.material
    )
    expected = measure_leaves(world)
    assert found.leaf.tolist() == [0, 3, 6, 9, 12]
    np.testing.assert_allclose(found.centre, expected.centre[::3], atol=1e-12)
    np.testing.assert_allclose(found.radius, expected.radius[::3], rtol=1e-11, atol=1e-15)
    if name != "flattened" and (flat or name not in ("squeezed", "sheared")):
        along = np.abs(np.einsum("li,li->l", found.normal, expected.normal[::3]))
        np.testing.assert_allclose(along, 1, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found.normal, axis=1), 1, rtol=1e-12)


def test_leaf_without_area() -> None:
    mesh = leafy_mesh(count=2)
    mesh.vertices[3:7] = mesh.vertices[3]
    for linear in (np.eye(3), LINEAR["sheared"]):
        discs = leaf_discs(scene_of(mesh, transform(linear)))
        assert discs.radius[0] == 0
        np.testing.assert_allclose(
            discs.centre[0], apply_transform(transform(linear), mesh.vertices[3][None])[0]
        )
        assert np.isfinite(discs.normal).all()
        assert discs.radius[1] > 0


def test_incidence_keeps_its_digits_face_on_and_edge_on() -> None:
    """Against 50 digits, down to 1e-9 from either."""
    rng = np.random.default_rng(1)
    point, centre = np.array([3.0, -2.0, 1.0]), 10.0 * rng.normal(size=(60, 3))
    small = 10.0 ** -rng.uniform(1, 9, 20)
    angle = np.concatenate([small, np.pi / 2 - small, rng.uniform(0, np.pi / 2, 20)])[:, None]
    away = centre - point
    unit = away / np.linalg.norm(away, axis=1, keepdims=True)
    across = np.cross(unit, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    normal = np.cos(angle) * unit + np.sin(angle) * across
    ones = np.ones(60)
    leaves = LeafEchoes(centre, np.arange(60), normal, ones, ones, "exact")
    with mpmath.workdps(50):
        for found, a, n in zip(
            leaves.incidence(point), away.tolist(), normal.tolist(), strict=True
        ):
            (x, y, z), (u, v, w) = map(mpmath.mpf, a), map(mpmath.mpf, n)
            grazing = mpmath.sqrt(
                (y * w - z * v) ** 2 + (z * u - x * w) ** 2 + (x * v - y * u) ** 2
            )
            known = float(mpmath.atan2(grazing, abs(x * u + y * v + z * w)))
            assert found == pytest.approx(known, abs=1e-15)


# ---------------------------------------------------------------------------------------------- beam
# The beam: plain angles in its two planes, no pole, no wrap.

AXES = [(0.0, 0.0), (2.5, 0.6), (-1.0, math.pi / 2), (0.3, -math.pi / 2), (4.0, 1.5)]


@pytest.mark.parametrize(("azimuth", "elevation"), AXES)
def test_frame_is_right_handed(azimuth: float, elevation: float) -> None:
    frame = frame_of(azimuth, elevation)
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(np.cross(frame[0], frame[1]), frame[2], atol=1e-15)
    assert frame[1, 2] == 0  # left is level
    assert np.isfinite(beam_offsets(-frame[:1], frame)).all()


@pytest.mark.parametrize(("azimuth", "elevation"), AXES)
@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 2.0, 3.1])
def test_offsets_in_the_two_planes(azimuth: float, elevation: float, angle: float) -> None:
    forward, left, up = frame_of(azimuth, elevation)
    for side, expected in ((left, (angle, 0)), (-left, (-angle, 0)), (up, (0, angle))):
        way = math.cos(angle) * forward + math.sin(angle) * side
        offsets = np.concatenate(beam_offsets(way[None], frame_of(azimuth, elevation)))
        np.testing.assert_allclose(offsets, expected, atol=1e-14)


# ------------------------------------------------------------------------------------------ station
# Beams of call and ears, several ears, poses.

BAND = (60e3, 80e3)


def echo_of(places: Any, **settings: Any) -> Echo:
    """Of small leaves that face the origin."""
    sonar = {"position": (0, 0, 0), "absorption": False, "leaf_model": "piston", "cull": 0.0}
    places = np.asarray(places, np.float64).reshape(-1, 3)
    return ping(discs_of(places, places, 0.01), AnySonar(**(sonar | settings)), AIR)


def measured() -> MeasuredBeam:
    """A pattern with a notch at 20° and a side lobe at 40°, narrower at high frequencies."""
    angle = np.deg2rad([0, 10, 20, 40, 90, 180])
    level = np.array(
        [[0, -3, -40, -12, -30, -45], [0, -6, -30, -18, -40, -50], [0, -9, -35, -25, -50, -60.0]]
    )
    return MeasuredBeam(angle, np.array([60e3, 70e3, 80e3]), level.T)


def all_round() -> MeasuredSphere:
    """A pattern without any order, from 60 directions."""
    rng = np.random.default_rng(5)
    towards = rng.normal(size=(60, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    at = np.array([60e3, 70e3, 80e3])
    return MeasuredSphere.all_round(towards, at, rng.uniform(-40, 0, (60, 3)))


def test_horseshoe_widths_are_those_of_the_paper() -> None:
    width = np.rad2deg(Horseshoe().width(np.array([60e3, 70e3, 80e3])))
    cubic = [0.011333 * f**3 - 2.3219 * f**2 + 156.15 * f - 3402.7 for f in (60, 70, 80)]
    np.testing.assert_allclose(width, cubic, rtol=1e-12)
    half = np.deg2rad(width) / 2
    gain = Horseshoe().gain(half, np.zeros(3), np.array([60e3, 70e3, 80e3]))
    np.testing.assert_allclose(20 * np.log10(np.diag(gain)), -3.0, atol=1e-9)


def test_measured_patterns_pass_through_what_was_measured() -> None:
    pattern = measured()
    gain = pattern.gain(pattern.angle, 0 * pattern.angle, pattern.frequency)
    np.testing.assert_allclose(20 * np.log10(gain.T), pattern.level, atol=1e-9)
    single = MeasuredBeam(pattern.angle, np.array([70e3]), pattern.level[:, :1])
    assert single.gain(np.zeros(1), np.zeros(1), np.array([1e3, 9e4])).shape == (2, 1)


def test_measured_patterns_do_not_swing_between_frequencies_that_stand_close() -> None:
    """A polynomial of degree 4 through all five passes them by 5,000 dB."""
    at = np.array([20e3, 20.1e3, 20.2e3, 20.3e3, 80e3])
    level = np.array([[0, 1.5, -1.5, 1.5, -6], [-20, -21, -19.5, -20.5, -30.0]])
    swinging = MeasuredBeam(np.deg2rad([0, 180]), at, level).levels(np.linspace(20e3, 80e3, 500))
    off = np.abs(swinging - level.mean(axis=1, keepdims=True))
    assert (off.max(axis=1) < 2 * np.ptp(level, axis=1)).all()


@pytest.mark.parametrize(
    "beam", [GaussianBeam((0.5, 0.2)), Horseshoe(), measured(), all_round(), Omni()], ids=type
)
def test_no_gain_exceeds_its_bounds(beam: BeamPattern) -> None:
    rng = np.random.default_rng(0)
    off, side = rng.uniform(0, math.pi, 3000), rng.uniform(0, 2 * math.pi, 3000)
    az, el = off * np.cos(side), off * np.sin(side)
    gain = beam.gain(az, el, np.linspace(*BAND, 41)).max(axis=0)
    assert (gain <= beam.loudest(az, el, BAND) * (1 + 1e-9)).all()
    for nearer in (0.0, 0.1, 0.7):
        away = np.maximum(off - nearer, 0)
        assert (gain <= beam.ceiling(away, BAND) * (1 + 1e-9)).all()


def test_emission_and_reception_are_separate() -> None:
    place = 2 * np.array([[math.cos(0.3), math.sin(0.3), 0.0]])
    both = echo_of(place, beam_width_deg=(40, 40))
    deaf = echo_of(place, beam_width_deg=(40, 40), hearing="omni")
    wide = echo_of(place, beam_width_deg=(40, 40), hearing="gaussian", hearing_width_deg=(80, 80))
    none = echo_of(place, beam="omni")
    one_way = np.abs(deaf.spectrum / none.spectrum)
    np.testing.assert_allclose(np.abs(both.spectrum / none.spectrum), one_way**2, rtol=1e-6)
    np.testing.assert_allclose(np.abs(wide.spectrum / none.spectrum), one_way**1.25, rtol=1e-6)


def test_beam_by_frequency_colours_the_echo() -> None:
    place = 2 * np.array([[math.cos(0.3), math.sin(0.3), 0.0]])
    coloured, plain = echo_of(place, beam="horseshoe"), echo_of(place, beam="omni")
    gain = np.abs(coloured.spectrum / plain.spectrum)
    width = np.deg2rad(np.polyval([0.011333, -2.3219, 156.15, -3402.7], coloured.frequency / 1e3))
    np.testing.assert_allclose(20 * np.log10(gain), -2 * 3 * (0.3 / (width / 2)) ** 2, atol=1e-6)


def test_a_measured_beam_is_heard() -> None:
    place = 2 * np.array([[math.cos(0.3), math.sin(0.3), 0.0]])
    sonar = AnySonar(
        position=(0, 0, 0), absorption=False, beam="file", beam_file="x", leaf_model="piston"
    )
    discs = discs_of(place, place, 0.01)
    with pytest.raises(ValueError, match="has not been read"):
        ping(discs, sonar, AIR)
    equipment = Equipment(measured(), (measured(),), None)
    gain = (
        ping(discs, sonar, AIR, equipment=equipment).spectrum / echo_of(place, beam="omni").spectrum
    )
    at = echo_of(place, beam="omni").frequency
    expected = measured().gain(np.array([0.3]), np.zeros(1), at)[:, 0] ** 2
    np.testing.assert_allclose(np.abs(gain), expected, rtol=1e-5)


def test_two_ears_hear_a_leaf_to_the_left_apart() -> None:
    """The left ear first, by the difference of the paths; each with its own spreading."""
    place = np.array([0.8, 0.6, 0.0])
    echo = echo_of(place, beam="omni", ears=2, ear_spacing=0.04)
    legs = [np.linalg.norm(place - [0, y, 0]) for y in (0.02, -0.02)]
    turned = np.exp(-2j * math.pi * echo.frequency * (1.0 + legs[0]) / 340)
    assert np.abs(np.angle(echo.spectra[0] / (1j * turned))).max() < 0.02
    phase = np.unwrap(np.angle(echo.spectra[1] / echo.spectra[0]))
    later = -np.polyfit(echo.frequency, phase, 1)[0] / (2 * math.pi)
    assert later == pytest.approx((legs[1] - legs[0]) / 340, rel=0.01)
    level = np.abs(echo.spectra[1] / echo.spectra[0]).mean()
    assert level == pytest.approx(legs[0] / legs[1], rel=2e-3)
    assert echo.responses.shape == echo.envelopes.shape == (2, len(echo.time))


def test_a_leaf_ahead_is_the_same_at_both_ears_and_turned_ears_differ() -> None:
    echo = echo_of([1.5, 0, 0], ears=2, beam_width_deg=(40, 40))
    np.testing.assert_allclose(echo.spectra[0], echo.spectra[1], rtol=1e-9)
    aside = echo_of([1.5, 0.5, 0], ears=2, ear_turn_deg=20.0, beam_width_deg=(40, 40))
    assert np.abs(aside.spectra[0]).mean() > 1.5 * np.abs(aside.spectra[1]).mean()
    many = echo_of([1.5, 0.5, 0], ears=7, ear_spacing=0.3)
    assert many.spectra.shape[0] == 7


def test_poses_look_and_fly() -> None:
    position = np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1.0]])
    beam = np.array([0.1, 0.2, 0.3])
    flown = looking(position, np.zeros(3), np.zeros(3), beam, speed=3.0)
    gone = np.linalg.norm(np.diff(position, axis=0), axis=1)
    assert np.diff(flown.time) == pytest.approx(gone / 3.0)
    assert looking(position, np.zeros(3), np.zeros(3)).time == pytest.approx([0, 1, 2])
    poses = poses_of(flown)
    assert [pose.width for pose in poses] == [0.1, 0.2, 0.3]
    np.testing.assert_allclose([np.linalg.norm(pose.velocity) for pose in poses], 3.0)
    np.testing.assert_allclose(poses[0].velocity, [3, 0, 0])
    (alone,) = poses_of(looking(position[:1], np.array([math.pi / 2]), np.zeros(1), speed=2.0))
    np.testing.assert_allclose(alone.velocity, [0, 2, 0], atol=1e-15)


def test_a_pose_of_its_own_width() -> None:
    place = np.array([[2.0, 0.6, 0.0]])
    discs = discs_of(place, place, 0.01)
    sonar = AnySonar(position=(0, 0, 0), leaf_model="piston", beam_width_deg=(20, 20))
    wide = AnySonar(position=(0, 0, 0), leaf_model="piston", beam_width_deg=(60, 60))
    pose = SonarPose(np.zeros(3), np.eye(3), np.zeros(3), math.radians(60))
    np.testing.assert_allclose(
        ping(discs, sonar, AIR, pose=pose).spectrum, ping(discs, wide, AIR).spectrum
    )


def test_a_tone_has_one_bin() -> None:
    echo = echo_of([2, 0, 0], band=(70e3, 70e3), record=0.02)
    k = 2 * math.pi * 70e3 / 340
    assert echo.frequency.tolist() == [70e3]
    assert abs(echo.spectrum[0]) == pytest.approx(k * 0.01**2 / 2 / 4, rel=1e-9)
    assert len(echo.time) == 8000
    np.testing.assert_allclose(echo.envelope, abs(echo.spectrum[0]), rtol=1e-9)


@pytest.mark.parametrize("rise", [-30.0, 30.0])
def test_what_the_table_is_off_by_is_told_of_any_ears(rise: float) -> None:
    """Equal leaves in phase against the exact disc, by ears that hear the band's end ``rise`` dB louder."""
    low, high, away, radius = 40e3, 90e3, 3.0, 0.03
    ears = MeasuredBeam(np.array([0.0, 3.2]), np.array([low, high]), np.array([[0.0, rise]] * 2))
    sonar = AnySonar(
        position=(0, 0, 0), band=(low, high), beam="omni", absorption=False, cull=0.0, tolerance=0.0
    )
    facing = np.array([1.0, 0.3, 0.1])
    leaves = discs_of([[away, 0, 0]] * 300, facing, radius)
    echo = ping(leaves, sonar, AIR, equipment=Equipment.of(sonar, hears=(ears,)))
    some = np.linspace(0, len(echo.frequency) - 1, 9).astype(int)
    angle = np.arccos(1 / np.linalg.norm(facing, keepdims=True))
    for found, frequency in zip(echo.spectrum[some], echo.frequency[some], strict=True):
        k = 2 * np.pi * frequency / 340.0
        exact = HardDisc(float(k * radius)).backscatter(angle)[0] / (k * away**2)
        exact *= 300 * np.exp(-2j * k * away) * ears.gain(*np.zeros((2, 1)), frequency[None])[0, 0]
        assert abs(found - exact) <= echo.table_error * echo.size[0]
    assert echo.table_error < 1e-4
