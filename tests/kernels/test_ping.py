"""Kernels of a ping against numpy, over drawn arguments."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from forest_addon import kernels
from forest_addon.acoustics.disc import disc_amplitudes
from forest_addon.acoustics.gridding import grid_of, kernel, lay
from forest_addon.sensing.sonar.leaves import FoliageDiscs, LeafDiscs, LeafEchoes
from forest_addon.sensing.sonar.station import Equipment, Station, posed
from forest_addon.sensing.sonar.wood import CylinderStrength
from forest_addon.spec import Air, Sonar


@pytest.fixture
def both(monkeypatch):
    """``both(work)``: what a function returns with the library and without."""
    if kernels.library() is None:
        pytest.skip(kernels.engine())

    def run(work):
        found = work()
        with monkeypatch.context() as off:
            off.setenv(kernels.SWITCH, "off")
            return found, work()

    return run


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
    wood = CylinderStrength(3 * RADIUS + 0.01, 2 * RADIUS, sine, cosine, FACTOR, *kinds)
    one, other = both(lambda: wood.amplitude(K))
    assert (np.abs(one - other) <= 1e-13 * np.abs(other).max(axis=1, keepdims=True)).all()


def test_opened_leaves_are_placed_alike(both):
    """Discs that are turned and scaled; paths to three ears, also of places on the axis and behind."""
    rng = np.random.default_rng(7)
    centre, normal = rng.normal(size=(2, 400, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    transform = np.column_stack([2 * Rotation.from_rotvec([1, 2, 3]).as_matrix(), [3, 4, 5]])
    one = np.zeros(400, np.int64)
    discs = FoliageDiscs.of_discs(LeafDiscs(centre, normal, np.ones(400), one, one, one))
    rows = rng.permutation(400)[:300]
    sonar = Sonar(ears=3, ear_turn_deg=20.0)
    station = Station(sonar, Air(), posed(sonar), Equipment.of(sonar))
    ahead = station.point + np.array([[1.0], [-1.0]]) * station.pose.frame[0]

    def placed():
        centres, normals, radius = discs.moved(transform, rows)
        places = np.concatenate([centres, ahead])
        leaves = LeafEchoes(centres, rows, normals, radius, radius, "paper")
        paths = station.paths(places)
        return centres, normals, leaves.incidence(station.point), *vars(paths).values()

    for found, expected in zip(*both(placed), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)
