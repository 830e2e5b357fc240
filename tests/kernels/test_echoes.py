"""Echoes by the kernel in C against the same by numpy: equal labels and counts, places to 1e-11 m."""

import dataclasses
import os

import numpy as np
import pytest
from references.rays import BruteCaster, ground, scene_with, wall
from scipy.spatial.transform import Rotation

from forest_addon import kernels
from forest_addon.acoustics.disc import MODELS, disc_amplitudes
from forest_addon.acoustics.gridding import grid_of, kernel, lay
from forest_addon.base.trimesh import LEAF, WOOD, TriMesh
from forest_addon.growth.mesh.meshing import tube
from forest_addon.sensing.lidar.scan import Scan
from forest_addon.sensing.lidar.waveform import Bins, find_echoes
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.sonar.beam import MeasuredBeam
from forest_addon.sensing.sonar.calls import Band
from forest_addon.sensing.sonar.leaves import LeafDiscs, LeafEchoes
from forest_addon.sensing.sonar.search import search
from forest_addon.sensing.sonar.station import Equipment, Station, posed
from forest_addon.sensing.sonar.targets import EchoTargets
from forest_addon.sensing.sonar.wood import CylinderStrength
from forest_addon.spec import Air, Beam, Mobile, Noise, Pose, Sonar, Surfaces, Terrestrial

BEAM = Beam(divergence_mrad=(3.0, 3.0), exit_diameter=0.02, subrays=19, pulse_ns=4.0, max_returns=5)


@pytest.fixture
def both(monkeypatch):
    """``both(work)``: what a function returns with the library and without; under a sanitizer, which watches
    the library and not its results, twice the library's."""
    if kernels.library() is None:
        pytest.skip(kernels.engine())

    def run(work):
        found = work()
        if os.environ.get("KERNELS_UNDER_TEST"):
            return found, found
        with monkeypatch.context() as off:
            off.setenv(kernels.SWITCH, "off")
            return found, work()

    return run


def alike(one, other):
    for field in dataclasses.fields(one):
        ours, theirs = getattr(one, field.name), getattr(other, field.name)
        if dataclasses.is_dataclass(ours):
            alike(ours, theirs)
        elif isinstance(ours, np.ndarray) and ours.dtype.kind == "f":
            np.testing.assert_allclose(ours, theirs, rtol=1e-11, atol=1e-12, err_msg=field.name)
        else:
            np.testing.assert_array_equal(ours, theirs, err_msg=field.name)


def drawn(seed, spread):
    """Contacts of sixty pulses, in any order, in clumps, some without light, some blurred."""
    rng = np.random.default_rng(seed)
    count = rng.integers(1, 60, 60)
    ray = np.repeat(np.arange(60), count) * 19 + rng.integers(0, 19, count.sum())
    clump = rng.choice([0.0, 0.0, 0.5, 3.0, 30.0], len(ray))
    distance = 40 + clump + 0.2 * rng.normal(size=len(ray)) * rng.integers(0, 2, len(ray))
    energy = 10 ** rng.uniform(-5, 0, len(ray)) * rng.integers(0, 4, len(ray)).clip(0, 1)
    blur = 0.3 * spread * rng.choice([0.0, 0.0, 0.5, 3.0, 40.0], len(ray))
    return ray, 19, distance, energy, 0.3, blur


@pytest.mark.medium
@pytest.mark.parametrize("bins", [None, Bins(np.array([0.0, 0.2, 0.5, 0.3, 0.1]), 0.1, 3)])
@pytest.mark.parametrize("spread", [0, 1])
@pytest.mark.parametrize("seed", range(3))
def test_contacts_of_any_kind_make_the_same_echoes(both, seed, spread, bins):
    given = drawn(seed, spread)
    by_c, by_numpy = both(lambda: find_echoes(*given, bins=bins))
    alike(by_c, by_numpy)
    assert len(by_c.pulse) > 60


def test_nothing_comes_back(both):
    none = np.zeros(0)
    alike(*both(lambda: find_echoes(none.astype(int), 19, none, none, 0.3)))


def stand():
    trunk = TriMesh.of_part(*tube(np.array([[6.0, 1, -1], [6.0, 1, 9]]), np.full(2, 0.2), 12), WOOD)
    leaf = TriMesh.of_part(
        np.array([[8.0, 0, 2], [8, 3, 2], [8, 0, 5]]), np.array([[0, 1, 2]]), LEAF
    )
    return BruteCaster(scene_with(ground(60.0), wall(15.0, 30.0), trunk, leaf))


def tripod(**settings):
    given = {"position": (0.0, 0.0, 1.7), "azimuth_deg": (-60.0, 60.0), "angle_step_deg": 4.0}
    given |= {"elevation_deg": (-70.0, 40.0), "beam": BEAM, "max_range": 50.0}
    return Terrestrial(**(given | settings))


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        {"beam": dataclasses.replace(BEAM, extinction=0.01, subrays=7)},
        {
            "angle_step_deg": 20.0,
            "beam": dataclasses.replace(BEAM, divergence_mrad=(20.0, 5.0), subrays=150),
        },
        {"beam": dataclasses.replace(BEAM, subrays=1)},
        {"min_range": 4.0, "max_range": 9.0, "noise": Noise(range_sd=0.01, drop_out=0.1)},
        {"angle_step_deg": 1.5, "azimuth_deg": (-15.0, 15.0), "elevation_deg": (-3.0, 9.0)},
        {"surfaces": Surfaces(leaf_transmittance=0.3)},
    ],
)
def test_a_scan_is_the_same(both, settings):
    work = Scan(tripod(**settings), stand(), 3)
    by_c, by_numpy = both(lambda: work.look(0, work.pulses))
    alike(by_c, by_numpy)
    assert len(by_c) > 30


def test_a_moving_scanner_and_cuts_anywhere(both):
    poses = (Pose(time=0.0, position=(-5.0, -8.0, 2.0)), Pose(time=1.0, position=(9.0, -3.0, 2.5)))
    scanner = Mobile(poses=poses, pulse_rate=400.0, line_rate=5.0, beam=BEAM, max_range=60.0)
    work = Scan(scanner, stand(), 3)
    whole, by_numpy = both(lambda: work.look(0, work.pulses))
    alike(whole, by_numpy)
    pieces = [cloud.position for _, cloud in work.chunks(at_once=37)]
    assert np.concatenate(pieces).tobytes() == whole.position.tobytes()
    assert len(whole) > 300


# ---------------------------------------------------------------------------------------------- ping
# Kernels of a ping against numpy, over drawn arguments.


@pytest.mark.parametrize("width", [3, 7, 15])
@pytest.mark.parametrize(("nodes", "sums"), [(1, 1), (4, 3), (6, 1), (33, 2)])
def test_echoes_are_laid_down_alike(both, width, nodes, sums):
    rng = np.random.default_rng([width, nodes, sums])
    count, size = 300, 64
    place = np.concatenate([rng.uniform(0, size, count - 3), [0.0, size, 0.5]])
    cycles = rng.uniform(-1e4, 1e4, count)
    heights = rng.normal(size=(nodes, count)) + 1j * rng.normal(size=(nodes, count))
    weights = rng.normal(size=(count, sums))

    def laid():
        grid = grid_of(sums, size + width, nodes)
        return grid, lay(kernel(width), place, cycles, heights, weights, grid)

    (one, size), (other, expected) = both(laid)
    np.testing.assert_allclose(size, expected, rtol=1e-14)
    assert np.abs(one - other).max() < 1e-14 * np.abs(heights).sum()
    assert not one[:, :, nodes:].any()


K = 2 * np.pi * np.geomspace(20e3, 120e3, 7) / 343.0
RADIUS, ANGLE = np.meshgrid(
    [1e-6, 1e-4, 0.003, 0.02, 0.05, 0.07, 0.3], np.append(np.linspace(0, np.pi / 2, 40), 1e-7)
)
RADIUS, ANGLE = RADIUS.ravel(), ANGLE.ravel()
FACTOR = np.random.default_rng(1).uniform(0.1, 1, len(RADIUS))


@pytest.mark.parametrize(
    "k", [K, np.linspace(K[1], K[3], 70), K[::-1]], ids=["few", "many", "back"]
)
@pytest.mark.parametrize("later", [0.0, 1.0])
@pytest.mark.parametrize(("model", "off"), [("paper", 5e-12), ("piston", 1e-12), ("exact", 5e-7)])
def test_discs_are_as_loud(both, model, off, later, k):
    """Of the exact disc's table, numpy sums in single precision."""
    k, later = k.copy(), later * (model == "exact")
    one, other = both(lambda: disc_amplitudes(k, RADIUS, ANGLE, FACTOR, model, later))
    scale = np.abs(disc_amplitudes(k, RADIUS, 0 * ANGLE, FACTOR, model))
    assert (np.abs(one - other) <= off * scale).all()


def test_rims_are_as_loud(both):
    radius, angle = 6.0 / K[0] * np.geomspace(1, 1e4, 500), np.linspace(0.6, 1.5, 500)
    given = radius, angle, np.linspace(0.1, 1, 500), "piston", 0.0
    side = np.resize(np.array([-1, 1], np.int8), 500)
    one, other = both(lambda: disc_amplitudes(K, *given, side))
    np.testing.assert_allclose(one, other, rtol=2e-13)


def test_cylinders_are_as_loud(both):
    """Up to sizes beyond the table, of any turn, wave and end."""
    sine, cosine = np.sin(ANGLE), np.cos(ANGLE)
    kinds = np.random.default_rng(3).integers([[3], [2]], size=(2, len(ANGLE))).astype(np.int8)
    kinds[0, 2 * K[0] * RADIUS * sine < 4.0] = 0  # thin segments are not taken apart
    length = 3 * RADIUS + 0.01
    level, size, turn = length * FACTOR / np.pi, 2 * RADIUS * sine, length * cosine
    wood = CylinderStrength(level, size, turn, *kinds)
    one, other = both(lambda: wood.amplitude(K))
    assert (np.abs(one - other) <= 1e-13 * np.abs(other).max(axis=1, keepdims=True)).all()


def test_ways_are_the_same(both):
    """Paths to three ears, also of places on the axis and behind, and angles of leaves there."""
    sonar = Sonar(ears=3, ear_turn_deg=20.0)
    station = Station(sonar, Air(), posed(sonar), Equipment.of(sonar))
    ahead = station.point + np.array([[1.0], [-1.0]]) * station.pose.frame[0]
    centre, normal = np.random.default_rng(7).normal(size=(2, 400, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    row, one = np.arange(400), np.ones(400)
    leaves = LeafEchoes(centre, row, normal, one, one, "paper")

    def seen():
        paths = station.paths(np.concatenate([centre, ahead]))
        return leaves.incidence(station.point), *vars(paths).values()

    for found, expected in zip(*both(seen), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)


BEAMS = {
    "gaussian": {},
    "horseshoe": {"beam": "horseshoe", "band": (60e3, 80e3), "ears": 1},
    "apart": {"ear_spacing": 0.3, "ears": 3, "record": 0.03, "hearing": "omni"},
    "measured": {"beam": "file", "beam_file": "beam.csv", "hearing": "same"},
}
MEASURED = MeasuredBeam(
    np.array([0.0, 0.5, 1.0, 3.0]),
    np.array([50e3, 70e3]),
    np.array([[0.0, 0.0], [-6.0, -9.0], [-20.0, -25.0], [-300.0, -400.0]]),
)


@pytest.mark.medium
@pytest.mark.parametrize("settings", BEAMS.values(), ids=BEAMS)
@pytest.mark.parametrize("model", MODELS)
def test_opened_leaves_are_the_same(both, model, settings):
    """Two instances, turned and mirrored, of leaves of any size, too near, too far, not finite."""
    rng = np.random.default_rng(11)
    count, one = 700, np.zeros(700, np.int64)
    centre = 5.0 * rng.uniform(-1, 1, (count, 3)) * rng.uniform(0, 1, (count, 1)) ** 2
    normal = rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    radius = 10.0 ** rng.uniform(-3.5, -0.8, count)
    radius[5], radius[7], centre[9, 1] = np.nan, 0.0, np.inf
    radius[20:40], centre[20:40, 0] = (
        2.0,
        20.0,
    )  # beyond the range, of more lobes than are tabulated
    still = EchoTargets.of_discs(LeafDiscs(centre, normal, radius, one, np.arange(count) // 2, one))
    turn = Rotation.from_rotvec([1, 2, 3]).as_matrix()
    places = np.stack([np.eye(3, 4), np.column_stack([-0.7 * turn, [1.0, 0.5, 0.2]])])
    two = np.zeros(2, np.int64)
    scene = SceneGeometry(still.scene.meshes, places, two, ("a", "b"), two, two)
    targets = EchoTargets(scene, still)
    sonar = Sonar(position=(0, 0, 0), max_range=4.0, near_limit=0.2, leaf_model=model, cull=1e-2)
    sonar = sonar.changed(**settings)
    beam = MEASURED if sonar.beam == "file" else None
    station = Station(sonar, Air(), posed(sonar), Equipment.of(sonar, beam))
    latest = sonar.record or np.inf
    band = Band(*sonar.band)
    found, expected = both(lambda: search(targets, station, band, None, latest))
    assert found.counts == expected.counts
    assert found.bound == pytest.approx(expected.bound, rel=1e-6)
    assert min(found.counts.broken, found.counts.near, found.counts.far) > 0
    assert len(found.groups) == {"paper": 1, "piston": 2, "exact": 3}[model]
    for one, other in zip(found.groups, expected.groups, strict=True):
        alike(one, other)
        assert len(one) > 1
