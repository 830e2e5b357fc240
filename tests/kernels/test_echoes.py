"""Echoes by the kernel in C against the same by numpy: equal labels and counts, places to 1e-11 m."""

import dataclasses

import numpy as np
import pytest
from references.lidar_scenes import ground, scene_with, wall
from references.rays_brute import BruteCaster

from forest_addon import kernels
from forest_addon.base.trimesh import LEAF, WOOD, TriMesh
from forest_addon.growth.mesh.meshing import tube
from forest_addon.sensing.lidar.scan import Scan
from forest_addon.sensing.lidar.waveform import Bins, find_echoes
from forest_addon.spec import Beam, Mobile, Noise, Pose, Surfaces, Terrestrial

BEAM = Beam(divergence_mrad=(3.0, 3.0), exit_diameter=0.02, subrays=19, pulse_ns=4.0, max_returns=5)


@pytest.fixture
def by_both(monkeypatch):
    """Results of a call by C and by numpy."""
    if kernels.library() is None:
        pytest.skip(kernels.engine())

    def call(function):
        by_c = function()
        monkeypatch.setenv(kernels.SWITCH, "off")
        by_numpy = function()
        monkeypatch.delenv(kernels.SWITCH)
        return by_c, by_numpy

    return call


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


@pytest.mark.parametrize("bins", [None, Bins(np.array([0.0, 0.2, 0.5, 0.3, 0.1]), 0.1, 3)])
@pytest.mark.parametrize("spread", [0, 1])
@pytest.mark.parametrize("seed", range(6))
def test_contacts_of_any_kind_make_the_same_echoes(by_both, seed, spread, bins):
    given = drawn(seed, spread)
    by_c, by_numpy = by_both(lambda: find_echoes(*given, bins=bins))
    alike(by_c, by_numpy)
    assert len(by_c.pulse) > 60


def test_nothing_comes_back(by_both):
    none = np.zeros(0)
    alike(*by_both(lambda: find_echoes(none.astype(int), 19, none, none, 0.3)))


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


@pytest.mark.medium
@pytest.mark.parametrize(
    "settings",
    [
        {"beam": dataclasses.replace(BEAM, extinction=0.01, subrays=7)},
        {
            "angle_step_deg": 12.0,
            "beam": dataclasses.replace(BEAM, divergence_mrad=(20.0, 5.0), subrays=150),
        },
        {"beam": dataclasses.replace(BEAM, subrays=1)},
        {"min_range": 4.0, "max_range": 9.0, "noise": Noise(range_sd=0.01, drop_out=0.1)},
        {"angle_step_deg": 1.0, "azimuth_deg": (-15.0, 15.0), "elevation_deg": (-3.0, 9.0)},
        {"surfaces": Surfaces(leaf_transmittance=0.3)},
    ],
)
def test_a_scan_is_the_same(by_both, settings):
    work = Scan(tripod(**settings), stand(), 3)
    by_c, by_numpy = by_both(lambda: work.look(0, work.pulses))
    alike(by_c, by_numpy)
    assert len(by_c) > 100


@pytest.mark.medium
def test_a_moving_scanner_and_cuts_anywhere(by_both):
    poses = (Pose(time=0.0, position=(-5.0, -8.0, 2.0)), Pose(time=1.0, position=(9.0, -3.0, 2.5)))
    scanner = Mobile(poses=poses, pulse_rate=400.0, line_rate=5.0, beam=BEAM, max_range=60.0)
    work = Scan(scanner, stand(), 3)
    whole, by_numpy = by_both(lambda: work.look(0, work.pulses))
    alike(whole, by_numpy)
    pieces = [cloud.position for _, cloud in work.chunks(at_once=37)]
    assert np.concatenate(pieces).tobytes() == whole.position.tobytes()
    assert len(whole) > 300
