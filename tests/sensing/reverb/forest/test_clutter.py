"""Branches by a tree's skeleton and, independently, by the curvature of its mesh."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from references.clutter_of_truth import blades_of_leaves, rods_of_skeleton

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, WOOD, TriMesh
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.mesh.blades import shoot_of
from forest_addon.growth.tree import grow
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.reverb.forest.clutter import (
    DRAWN,
    blades_of_mesh,
    clutter_of,
    rods_of_mesh,
    shoot_triangles,
)
from forest_addon.sensing.reverb.forest.surroundings import (
    NEVER,
    FoliageCanopy,
    canopy_of,
    surroundings,
    terms_of,
)
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.spec import Reverb


@pytest.fixture(scope="module")
def birch():
    species, template = load_species(find_species("betula-pendula", Path()))
    return grow(species, template, stream(1, "test"))


def test_a_mesh_tells_its_branches_as_the_skeleton_has_them(birch):
    true, found = rods_of_skeleton(birch.skeleton), rods_of_mesh(birch.mesh)
    for low, high in ((0.001, 0.002), (0.002, 0.006), (0.006, 0.02)):
        lengths = [r.length[(r.radius > low) & (r.radius < high)].sum() for r in (true, found)]
        assert lengths[1] == pytest.approx(lengths[0], rel=0.15)
    assert found.length.sum() == pytest.approx(true.length.sum(), rel=0.05)
    heights = [(r.length @ r.height) / r.length.sum() for r in (true, found)]
    rises = [(r.length @ r.rise) / r.length.sum() for r in (true, found)]
    assert heights[1] == pytest.approx(heights[0], rel=0.02)
    assert rises[1] == pytest.approx(rises[0], rel=0.05)


@pytest.mark.medium
def test_leaves_and_layers(birch):
    of_truth, of_mesh = blades_of_leaves(birch.leaves), blades_of_mesh(birch.mesh)
    assert of_mesh.area.sum() == pytest.approx(of_truth.area.sum(), rel=1e-6)
    rods = rods_of_skeleton(birch.skeleton)
    found = clutter_of([rods], [of_truth], 10.0)
    thick = rods.radius < 0.08
    assert np.sum(found.length) * 10.0 == pytest.approx(rods.length[thick].sum(), rel=0.05)
    assert np.sum(found.leaf_area) * 10.0 == pytest.approx(of_truth.area.sum(), rel=1e-6)


def test_a_tree_twice_as_large(birch):
    rods = rods_of_skeleton(birch.skeleton)
    large = rods.placed(np.hstack([2.0 * np.eye(3), [[0.0], [0.0], [1.0]]]))
    np.testing.assert_allclose(large.length, 2 * rods.length)
    np.testing.assert_allclose(large.height, 2 * rods.height + 1.0)


def test_few_pieces_are_the_same_stand(birch):
    rods, blades = rods_of_skeleton(birch.skeleton), blades_of_leaves(birch.leaves)
    whole = clutter_of([rods], [blades], 10.0)
    found = clutter_of([rods.summed()], [blades.summed()], 10.0)
    assert len(rods.summed().length) < 0.3 * len(rods.length)
    np.testing.assert_allclose(np.sum(found.length), np.sum(whole.length), rtol=1e-9)
    np.testing.assert_allclose(found.radii, whole.radii, rtol=1e-9)
    np.testing.assert_allclose(np.sum(found.leaf_area), np.sum(whole.leaf_area), rtol=1e-9)
    np.testing.assert_allclose(found.leaf_radius, whole.leaf_radius, rtol=1e-9)


@pytest.mark.medium
@pytest.mark.parametrize(
    "name", ["norway-spruce", pytest.param("scots-pine", marks=pytest.mark.slow)]
)
def test_shoots_are_needles_and_leaves_are_not(birch, name):
    """Half the needles' surface within 20 %, and how far they are from the middle within 10 %."""
    species, _ = load_species(find_species(name, Path()))
    length = species.leaf.length.mean
    every = shoot_of(replace(species.needles, blades=0), length)
    drawn = shoot_of(species.needles, length)
    meshes = [
        TriMesh(
            length * blade.vertices,
            blade.triangles,
            material=np.zeros(len(blade.triangles), np.int64),
            part=np.full(len(blade.triangles), LEAF),
            leaf=np.zeros(len(blade.triangles), np.int64),
        )
        for blade in (every, drawn)
    ]
    needles = blades_of_mesh(meshes[0])
    found = blades_of_mesh(meshes[1])
    assert shoot_triangles(meshes[1]).all()
    assert not shoot_triangles(birch.mesh).any()
    assert found.area[0] / DRAWN == pytest.approx(needles.area[0], rel=0.2)
    assert found.shoot[0] == pytest.approx(needles.shoot[0], rel=0.1)
    clutter = clutter_of([], [found], 1.0)
    assert np.sum(clutter.leaf_area) == 0.0
    assert np.sum(clutter.needle_area) == pytest.approx(found.area[0] / DRAWN)
    assert clutter.shoot_area == pytest.approx(found.area[0] / DRAWN)


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
