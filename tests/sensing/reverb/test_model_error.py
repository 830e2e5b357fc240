"""Which trunks are solved exactly, and how far single scattering is from them."""

from __future__ import annotations

import numpy as np
import pytest

from forest_addon.sensing.reverb.model_error import model_error
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.spec import Air

ENDS = np.array([[-5.0, 0.0], [5.0, 0.0]])
SOME = np.array([125.0, 250.0, 500.0])


def forest(count: int, side: float, radius: float = 0.15, seed: int = 0) -> Trunks:
    rng = np.random.default_rng(seed)
    place = rng.uniform(-side / 2, side / 2, (count, 2))
    return Trunks(place, np.full(count, radius), np.arange(count))


@pytest.mark.slow
def test_dense_stands_scatter_more_than_once() -> None:
    """15 to 30 % at 0.01 trunks/m², more at 0.05 (PHYSICS 5.5)."""
    found = {}
    for density in (0.01, 0.05):
        side = np.sqrt(25 / density)
        errors = [
            model_error(forest(25, side, seed=seed), *ENDS, 25, Air(), SOME).relative
            for seed in range(5)
        ]
        found[density] = np.median(errors)
    assert 0.1 < found[0.01] < 0.4
    assert found[0.05] > 1.2 * found[0.01]


def test_one_trunk_and_none() -> None:
    one = model_error(forest(1, 4.0), *ENDS, 10, Air(), SOME)
    assert one.relative == 0
    assert one.level_db == 0
    none = model_error(forest(0, 4.0), *ENDS, 10, Air(), SOME)
    assert (none.relative, none.level_db, len(none.trunks)) == (0.0, 0.0, 0)


def test_nearest_trunks_that_can_be_solved() -> None:
    rows = [(0, 3, 0.2), (0.1, 3, 0.3), (0, -6, 0.1), (5.05, 0, 0.1), (0, 90, 0.2), (1, 1, 0.0)]
    table = np.array(rows)
    trunks = Trunks(table[:, :2], table[:, 2], np.arange(len(rows)))
    found = model_error(trunks, *ENDS, 5, Air(), SOME)
    assert found.trunks.tolist() == [1, 2]  # 0 overlaps the thicker 1, 3 covers the receiver
    assert found.left_out == 2
    assert found.relative > 0
    np.testing.assert_array_equal(found.frequency, SOME)


@pytest.mark.medium
def test_frequencies_that_are_too_high_are_left_out() -> None:
    steps: list[tuple[int, int]] = []
    found = model_error(
        forest(60, 200.0, 0.5),
        *ENDS,
        60,
        Air(),
        np.array([30.0, 20e3]),
        progress=lambda done, total: steps.append((done, total)),
    )
    assert found.frequency.tolist() == [30.0]
    assert steps == [(1, 1)]
