"""Blurred clouds, votes of neighbours and labels in doubt, against cases that are known."""

import numpy as np
import pytest

pytest.importorskip("pgeof")

from studies.sim_to_real.clouds import Labelled, blurred, cells_of
from studies.sim_to_real.run import told_by


def _plank(seed=1, count=4000):
    """Points of a level plank 20 m long and one cell high, wood where x < 10."""
    points = np.random.default_rng(seed).uniform((0, 0, 0), (20, 2, 0.01), (count, 3))
    cells = cells_of(points)
    wood = cells.majority(points[:, 0] < 10.0) > 0.5
    return Labelled("plank", cells, wood, wood)


def test_a_blur_spreads_cells_as_far_as_it_says_and_keeps_their_labels():
    cloud = _plank()
    for spread in (0.02, 0.04):
        moved = blurred(cloud, spread, 7)
        assert moved.cells.centre[:, 2].std() == pytest.approx(spread, rel=0.08)
        far = np.abs(moved.cells.centre[:, 0] - 10.0) > 6 * spread
        assert (moved.wood[far] == (moved.cells.centre[far, 0] < 10.0)).all()
        assert len(moved.features) == len(moved.cells.centre) == len(moved.stem)


class _Says:
    """A classifier that says what it was given."""

    def __init__(self, share):
        self.share = share

    def predict_proba(self, features):
        return np.column_stack([1 - self.share, self.share])


def test_neighbours_outvote_one_that_errs_and_the_edge_stays_where_it_is():
    place = np.stack(np.meshgrid(np.arange(0.025, 1, 0.05), np.arange(0.025, 1, 0.05)), -1).reshape(
        -1, 2
    )
    place += np.random.default_rng(3).uniform(-0.01, 0.01, place.shape)  # no two pairs tie
    cells = cells_of(np.column_stack([place, np.full(len(place), 0.025)]))
    cloud = Labelled("grid", cells, None, None)
    assert np.abs(np.asarray(cloud.near.sum(axis=1)) - 1).max() < 1e-12
    x, y = cells.centre[:, 0], cells.centre[:, 1]
    share = np.where(x < 0.5, 0.9, 0.1)
    wrong = int(np.argmin(np.hypot(x - 0.225, y - 0.525)))
    share[wrong] = 0.0
    told = told_by(_Says(share), cloud)
    assert told[wrong]
    assert (told == (x < 0.5))[np.abs(x - 0.5) > 0.1].all()
    brute = [share[np.hypot(x - a, y - b) <= 0.1 + 1e-9].mean() for a, b in zip(x, y, strict=True)]
    assert np.abs(cloud.near @ share - brute).max() < 1e-12
