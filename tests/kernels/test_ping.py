"""Kernels of a ping against numpy, over drawn arguments."""

import numpy as np
import pytest

from forest_addon import kernels
from forest_addon.acoustics.gridding import grid_of, kernel, lay


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
        lay(kernel(width), place, cycles, heights, weights, grid)
        return grid

    one, other = both(laid)
    assert np.abs(one - other).max() < 1e-14 * np.abs(heights).sum()
    assert not one[:, :, nodes:].any()
