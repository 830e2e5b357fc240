"""Branches by a tree's skeleton and, independently, by the curvature of its mesh."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from references.clutter_of_truth import blades_of_leaves, rods_of_skeleton

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, TriMesh
from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.growth.mesh.blades import shoot_of
from forest_addon.growth.tree import grow
from forest_addon.sensing.reverb.forest.clutter import (
    DRAWN,
    blades_of_mesh,
    clutter_of,
    rods_of_mesh,
    shoot_triangles,
)


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
