"""Leaves at the height of the path and the tops of trees, of scenes whose truth is counted by hand."""

from dataclasses import replace

import numpy as np
import pytest

from forest_addon.base.trimesh import LEAF, WOOD, TriMesh
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.reverb.forest.surroundings import (
    NEVER,
    FoliageCanopy,
    canopy_of,
    surroundings,
    terms_of,
)
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.spec import Reverb


def scene(scale=1.0):
    """A stem of 10 m and two leaves of 0.5 m², at 1.5 and at 8 m."""
    corners, up = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float), np.array([0, 0, 1.0])
    stem = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0, 10.0]])
    vertices = np.concatenate([stem, corners + 1.5 * up, corners + 8 * up])
    mesh = TriMesh(
        vertices,
        np.arange(9).reshape(3, 3),
        np.array([WOOD, LEAF, LEAF]),
        np.array([-1, 0, 1]),
        np.zeros(3, int),
    )
    transform = np.zeros((2, 3, 4))
    transform[:, :, :3] = scale * np.eye(3)
    return SceneGeometry(
        (mesh,), transform, np.zeros(2, int), ("a", "b"), np.arange(2), np.zeros(2, int)
    )


def test_only_leaves_beside_the_path_count():
    """Two trees with 0.5 m² each between 0.5 and 2.5 m, on 100 m²."""
    found = canopy_of(scene(), (1.5, 1.5), 100.0)
    assert found.leaf_area_density == pytest.approx(2 * 0.5 / (100.0 * 2.0))
    assert found.top == pytest.approx(10.0)
    assert canopy_of(scene(), (5.0, 5.0), 100.0).leaf_area_density == 0


def test_leaves_on_the_floor_are_counted_apart():
    """Herbs: the same plants at a fifth of the size, with leaves of 0.02 m² at 0.3 m and above."""
    found = canopy_of(scene(0.2), (1.5, 1.5), 100.0)
    assert found.floor_leaf_area == pytest.approx(2 * 0.5 * 0.04 / 100.0)
    assert canopy_of(scene(), (1.5, 1.5), 100.0).floor_leaf_area == 0


def test_trunks_end_where_those_trees_do_whose_trunks_are_met():
    """A tree of 10 m over a shrub of 1 m, whose stem the path at 1.5 m passes over."""
    both = scene()
    transform = both.transform.copy()
    transform[1, :, :3] *= 0.1
    both = replace(both, transform=transform)
    assert canopy_of(both, (1.5, 1.5), 100.0, np.array([0, -1])).top == pytest.approx(10.0)
    assert canopy_of(both, (1.5, 1.5), 100.0, np.array([-1])).top == 0.0
    assert canopy_of(both, (1.5, 1.5), 100.0).top == pytest.approx(5.5)


def test_terms_tell_their_values():
    held = " ".join(terms_of(Reverb(model="forest", lean_deg=1.5, bark=0.07, trunk_height=12.0))[0])
    for words in ("(1.5 degrees)", "(7 %)", "(12 m)", "forest floor", "as in the scene"):
        assert words in held


def test_a_larger_tree_has_larger_leaves_higher_up():
    found = canopy_of(scene(2.0), (3.0, 3.0), 100.0)
    assert found.leaf_area_density == pytest.approx(2 * 0.5 * 4 / (100.0 * 2.0))
    assert found.top == pytest.approx(20.0)


def test_a_stand_at_random_is_even_and_one_with_an_edge_is_not():
    rng = np.random.default_rng(3)
    place = rng.uniform(0, 100, (800, 2))
    field = ((0.0, 0.0), (100.0, 100.0))
    reverb = Reverb(model="forest", continue_to=200.0)

    def around(rows):
        trunks = Trunks(place[rows], np.full(rows.sum(), 0.1), np.arange(rows.sum()))
        return surroundings(trunks, reverb, field, FoliageCanopy(0.2, 12.0))

    even = around(np.ones(800, bool))
    assert even.density.cells.size == 0
    assert even.density.around == pytest.approx(0.08)
    assert even.stand.leaf_area_density == 0.2
    half = around(place[:, 0] < 50)
    assert half.density.cells.size > 0
    there = half.density.at(np.array([[20.0, 50.0], [80.0, 50.0]]))
    assert there[0] > 0.03
    assert there[1] == 0


def test_what_is_in_the_model_is_said():
    held, missing = terms_of(Reverb())
    assert not any("bark" in name for name in held)
    assert any("bark" in name for name in missing)
    held, missing = terms_of(Reverb(model="forest"))
    assert any("bark" in name for name in held)
    assert any("branches" in name for name in held)
    assert any("diffraction" in name for name in missing)


def test_one_switch_gives_every_term():
    """The ground too: a model ``forest`` stands on a forest floor unless it is told otherwise."""
    held, missing = terms_of(Reverb(model="forest"))
    assert Reverb(model="forest").ground_kind == "forest floor"
    assert Reverb().ground_kind == "constant"
    assert Reverb(model="forest", surface="snow").ground_kind == "snow"
    assert set(missing) == set(NEVER)
    assert len(held) > len(terms_of(Reverb())[0])


def test_terms_tell_what_stands_there():
    """Leaves of two trees by hand: 1 m² on 100 m² between 0.5 and 2.5 m, the path at 1.5 m."""
    canopy = canopy_of(scene(), (1.5, 1.5), 100.0)
    trunks = Trunks(np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 4.0]]), np.full(3, 0.1), np.arange(3))
    reverb = Reverb(model="forest")
    stand = surroundings(trunks, reverb, ((0.0, 0.0), (10.0, 10.0)), canopy).stand
    held = " ".join(terms_of(reverb, stand)[0])
    for words in ("300/ha", "0.005 m²/m³ at the path", "m² of leaves as discs of", "10 m"):
        assert words in held
    assert "within a shoot (none there)" in held
    assert "as in the scene" not in held
