"""Siblings stand as the tree does, whatever its base is like."""

from __future__ import annotations

import numpy as np
import pytest
from references.model_tree import Model, at, line

from forest_addon.growth.own_tree.anatomy import dissect
from forest_addon.growth.own_tree.habit import fit
from forest_addon.growth.own_tree.recognise import recognise
from forest_addon.growth.own_tree.relay import mesh_of
from forest_addon.growth.own_tree.sibling import Grown, grow_sibling
from forest_addon.spec import Siblings


def flared(sides: int, capped: bool = False, lean: float = 0.0) -> Model:
    """A trunk with few corners and a wide foot, its rings close together there."""
    model = Model()
    z = np.concatenate([np.arange(0, 0.7, 0.07), np.linspace(0.7, 10, 20)])
    path = at(0.4, -0.2, 0) + np.outer(z, at(np.tan(lean), 0, 1))
    trunk = model.add(
        path, 0.02 + 0.1 * (1 - z / 10) + 0.2 * np.exp(-z / 0.3), -1, sides=sides, capped=capped
    )
    for number in range(12):
        foot = path[-1 - number]
        out = at(np.cos(2.4 * number), np.sin(2.4 * number), 0.5)
        model.add(line(foot, foot + 2 * out), np.linspace(0.04, 0.01, 6), trunk, sides=sides)
    return model


def leans(grown: Grown) -> np.ndarray:
    """Degrees from the vertical of trunks from foot to tip."""
    begin = grown.lines.first + np.arange(len(grown.lines.first))
    way = (grown.lines.knot[begin[1:] - 1] - grown.lines.knot[begin[:-1]])[grown.order == 0]
    return np.rad2deg(np.arctan2(np.hypot(way[:, 0], way[:, 1]), way[:, 2]))


@pytest.mark.medium
@pytest.mark.parametrize("capped", [False, True])
@pytest.mark.parametrize("sides", [3, 4, 6, 9])
def test_the_foot_is_in_the_middle_of_its_base_and_the_trunk_begins_upright(sides, capped):
    found = recognise(flared(sides, capped).wood())
    np.testing.assert_allclose(found.foot[found.trunk], [0.4, -0.2, 0], atol=0.02)
    lines = dissect(found).lines
    heading = lines.frame[lines.first[found.trunk] : lines.first[found.trunk + 1], :, 2]
    assert np.rad2deg(np.arccos(np.minimum(heading[:, 2], 1.0))).max() < 6


@pytest.mark.medium
@pytest.mark.parametrize("sides", [3, 4])
@pytest.mark.parametrize("lean", [0.0, 0.4])
def test_siblings_stand_on_their_base_and_lean_as_the_tree_does(sides, lean):
    found = recognise(flared(sides, lean=lean).wood())
    anatomy = dissect(found)
    habit = fit(anatomy)
    own = leans(grow_sibling(habit, Siblings(variety=0.0), 1)).max()
    for key in range(20):
        grown = grow_sibling(habit, Siblings(), key)
        assert leans(grown).max() < own + 10
        mesh, _, _ = mesh_of(anatomy, grown, 1.0)
        assert mesh.vertices[:, 2].min() > -0.05
        assert mesh.vertices[:, 2].max() > 0.7 * 10
