"""Voxels that light passes by chance, held against the law of Beer and Lambert and a slow march.

A correct program fails a test of chance in one of a million seeds.
"""

from __future__ import annotations

import numpy as np
from scipy import stats
from scipy.spatial.transform import Rotation

from forest_addon.base.rng import child_keys, first_key, keyed_uniform
from forest_addon.sensing.lidar.surveys.digitised import Haze

FALSE_ALARM = 1e-6
TURN = Rotation.from_euler("xyz", [10, -25, 70], degrees=True).as_matrix()
PLACE = np.array([3.0, -2.0, 5.0])
SCALE = 1.5


def turned() -> Haze:
    """A grid of 4 x 3 x 5 cells of 0.4 m, a third of them empty, turned, scaled and moved."""
    density = np.arange(60.0).reshape(4, 3, 5) % 7 / 3 * (np.arange(60).reshape(4, 3, 5) % 3 > 0)
    return Haze(0, np.column_stack([SCALE * TURN, PLACE]), np.array([-1.0, 0.5, 2.0]), 0.4, density)


def density_at(haze: Haze, points: np.ndarray) -> np.ndarray:
    """(P,) density at points (P, 3) of the world."""
    local = (points - PLACE) @ TURN / SCALE
    cell = np.floor((local - haze.low) / haze.size).astype(int)
    inside = ((cell >= 0) & (cell < haze.density.shape)).all(axis=1)
    return np.where(inside, haze.density[tuple(np.where(inside[:, None], cell, 0).T)], 0.0)


def test_rays_cross_the_area_of_a_slow_march() -> None:
    rng = np.random.default_rng(5)
    haze = turned()
    middle = PLACE + SCALE * TURN @ (haze.low + haze.size * np.array([2.0, 1.5, 2.5]))
    way = rng.normal(size=(60, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    way[:3] = TURN.T  # along the grid's axes
    start = middle + rng.uniform(-0.4, 0.4, (60, 3)) - way * rng.uniform(0, 4, (60, 1))
    depth = rng.exponential(0.7, 60)
    found = haze.reach(start, way, depth, np.full(60, 8.0))
    assert 10 < np.isfinite(found).sum() < 55
    step = 5e-4
    along = step * (np.arange(16_000) + 0.5)
    for ray in range(60):
        passed = step * np.cumsum(density_at(haze, start[ray] + along[:, None] * way[ray]))
        if np.isfinite(found[ray]):
            index = int(np.searchsorted(along, found[ray])) - 1
            assert abs(passed[index] - depth[ray]) < 10 * step * haze.density.max()
        else:
            assert passed[-1] < depth[ray] + 10 * step * haze.density.max()


def test_nothing_is_met_beyond_the_farthest() -> None:
    haze = Haze(0, np.eye(4)[:3], np.zeros(3), 1.0, np.full((1, 1, 1), 2.0))
    start, way = np.tile([0.5, 0.5, -1.0], (3, 1)), np.tile([0.0, 0.0, 1.0], (3, 1))
    found = haze.reach(start, way, np.array([1.0, 1.0, 3.0]), np.array([5.0, 1.4, 5.0]))
    np.testing.assert_allclose(found, [1.5, np.inf, np.inf])


def test_paths_in_two_densities_follow_beers_law() -> None:
    """Cells of 0.5 and 2 m² a m³: the distance has F(s) = 1 - exp(-σs) in each, 8.2 % pass both."""
    haze = Haze(0, np.eye(4)[:3], np.zeros(3), 1.0, np.array([[[0.5, 2.0]]]))
    keys = child_keys(first_key(3, "lidar", "test"), np.arange(20_000))
    depth = -np.log(keyed_uniform(child_keys(keys, 0), "voxels"))
    start, way = np.tile([0.5, 0.5, -1.0], (20_000, 1)), np.tile([0.0, 0.0, 1.0], (20_000, 1))
    found = haze.reach(start, way, depth, np.full(20_000, 10.0)) - 1
    passed = int(np.isinf(found).sum())
    assert stats.binomtest(passed, 20_000, np.exp(-2.5)).pvalue > FALSE_ALARM / 2
    share = 1 - np.exp(-2.5)

    def law(s: np.ndarray) -> np.ndarray:
        crossed = 0.5 * np.minimum(s, 1) + 2.0 * np.clip(s - 1, 0, 1)
        return np.asarray((1 - np.exp(-crossed)) / share)

    met = found[np.isfinite(found)]
    assert stats.kstest(met, law).pvalue > FALSE_ALARM / 2
