"""The string of a fitted grammar, walked by the turtle of ABOP, is the tree that was grown."""

from __future__ import annotations

import numpy as np
import pytest
from references.own_trees import own_tree
from scipy.spatial import cKDTree

from forest_addon.growth.lsystem.system import read_system
from forest_addon.growth.lsystem.turtle import ABOP, read_commands, walk
from forest_addon.growth.own_tree.relay import (
    feet_of_leaves,
    generations_of,
    hang_leaves,
    skeleton_of_grown,
    write_string,
)
from forest_addon.growth.own_tree.sibling import grow_sibling
from forest_addon.spec import Siblings

NAMES = {"length": 1.0, "angle": 0.0, "thinning": 1.0}


@pytest.mark.medium
@pytest.mark.parametrize(("name", "variety"), [("whorled", 1.0), ("abop", 1.0), ("abop", 0.0)])
def test_the_turtle_walks_the_tree(name, variety):
    habit = own_tree(name).habit
    grown = grow_sibling(habit, Siblings(variety=variety), 3)
    text = write_string(habit, grown, variety, generations_of(habit))
    walked = walk(read_commands(read_system(text, []).axiom, ABOP.symbols, NAMES), 0.1)
    wood = skeleton_of_grown(grown)
    gap = cKDTree(walked.skeleton.end).query(wood.end)[0]
    assert gap.max() < 1e-5
    length = [np.linalg.norm(s.end - s.start, axis=1).sum() for s in (walked.skeleton, wood)]
    assert length[0] == pytest.approx(length[1], rel=1e-6)
    hung = hang_leaves(habit.anatomy, grown, variety)
    foot, _ = feet_of_leaves(habit.anatomy, grown, hung, variety > 0)
    assert len(walked.leaves) == len(foot)
    assert cKDTree(walked.leaves.foot).query(foot)[0].max() < 1e-5


def test_a_generation_rewrites_one_order():
    habit = own_tree("whorled").habit
    grown = grow_sibling(habit, Siblings(variety=0.0), 0)
    texts = [write_string(habit, grown, 0.0, g) for g in range(5)]
    assert [text.count("A(") for text in texts] == [1, 0, 0, 0, 0]
    assert [text.count("B(") for text in texts] == [0, 60, 0, 0, 0]
    assert [text.count("C(") for text in texts] == [0, 0, 240, 0, 0]
    assert [text.count("~(") for text in texts] == [0, 0, 0, 0, 2880]
