"""Trees as people model them come back: rebuilt exactly, with siblings that stand and hang together."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as some
from references.brought_trees import TREES, decimated, doubled, rough

from forest_addon.growth.own_tree.anatomy import dissect
from forest_addon.growth.own_tree.habit import fit
from forest_addon.growth.own_tree.recognise import Recognition, recognise
from forest_addon.growth.own_tree.relay import farthest_off, lowest_corner, standing_of
from forest_addon.growth.own_tree.sibling import grow_sibling
from forest_addon.spec import Siblings

SIBLINGS = 5
DONE = ("nothing", "rough", "doubled", "decimated", "both")


def brought(name: str, sides: int, capped: bool, done: str, place: np.ndarray) -> np.ndarray:
    """The facets of a tree, some corners a ring, after what was done to its mesh."""
    if done == "decimated":
        return decimated(TREES[name](24, capped).wood(), 0.1) + place
    wood = TREES[name](sides, capped).wood()
    wood = rough(wood, 0.002, sides) if done in ("rough", "both") else wood
    return (doubled(wood) if done in ("doubled", "both") else wood) + place


def check(found: Recognition) -> None:
    """Rebuilt to the bit, nearly, and siblings with the geometry of standing trees."""
    anatomy = dissect(found)
    habit = fit(anatomy)
    itself = grow_sibling(habit, Siblings(variety=0.0), 0)
    own, low = standing_of(itself), lowest_corner(anatomy, itself, 0.0)
    assert farthest_off(anatomy, itself) < 1e-9
    for key in range(SIBLINGS):
        grown = grow_sibling(habit, Siblings(), key)
        standing = standing_of(grown)
        assert np.rad2deg(standing.lean) <= np.rad2deg(own.lean) + 10
        assert standing.gap <= 1e-3
        assert standing.thicker <= max(own.thicker, 1.0) + 0.02
        assert lowest_corner(anatomy, grown, 1.0) >= 1.3 * min(low, 0.0) - 0.05
        tall = grown.lines.knot[:, 2].max() / itself.lines.knot[:, 2].max()
        assert 0.6 < tall < 1.6


@pytest.mark.slow
@settings(max_examples=2, phases=[Phase.explicit, Phase.generate])
@given(
    some.sampled_from(sorted(TREES)),
    some.integers(3, 12),
    some.booleans(),
    some.sampled_from(DONE),
    some.tuples(some.integers(-500, 500), some.integers(-500, 500), some.floats(-0.5, 0.5)),
)
@example("stacked", 4, True, "both", (0, 0, 0.0))
@example("twin", 3, False, "nothing", (-30, 7, -0.4))
@example("leaning", 4, False, "decimated", (0, 0, 0.3))
def test_any_tree_comes_back_standing(
    name: str, sides: int, capped: bool, done: str, place: tuple[float, float, float]
) -> None:
    check(recognise(brought(name, sides, capped, done, np.array(place))))


@pytest.mark.medium
@pytest.mark.parametrize(
    ("name", "orders"),
    [
        ("stacked", [1, 12, 12]),  # three pieces of trunk are one
        ("twin", [2, 16, 16]),  # two stems, each with its branches
        ("forked", [1, 10, 15, 6]),
        ("flared", [1, 12, 12]),
        ("palm", [1, 14]),
    ],
)
@pytest.mark.parametrize("sides", [3, 4, 6])
def test_orders_are_those_of_the_tree(name: str, orders: list[int], sides: int) -> None:
    anatomy = dissect(recognise(brought(name, sides, sides == 4, "rough", np.zeros(3))))
    np.testing.assert_array_equal(np.bincount(anatomy.order), orders)
