"""Whole trees: the truth that grows with them is what is measured on their triangles."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import WOOD
from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.growth.mesh.leaves import measure_leaves
from forest_addon.growth.tree import SUNK, grow
from forest_addon.spec import Detail, Grammar, Leaf, Species


@pytest.mark.slow
@pytest.mark.parametrize("name", ["maple", "spruce"])
def test_grafted_truth_is_what_the_mesh_measures(name):
    species, template = load_species(find_species(name, Path()))
    tree = grow(species, template, stream(3, "tree", name, 0))
    measured = measure_leaves(tree.mesh)
    assert len(tree.leaves) == len(measured)
    for column in ("centre", "length", "width", "radius"):
        np.testing.assert_allclose(
            getattr(tree.leaves, column), getattr(measured, column), atol=1e-12
        )
    np.testing.assert_allclose(tree.leaves.normal, measured.normal, atol=1e-11)
    along = np.einsum("li,li->l", tree.leaves.axis, measured.axis)
    np.testing.assert_allclose(np.abs(along), 1, atol=1e-9)  # which end is the tip is not measured
    assert (np.diff(tree.leaves.branch) >= 0).all()


def test_a_species_without_a_template_grows_whole():
    species = Species(name="plain", grammar=Grammar(generations=4, radius=0.08))
    tree = grow(species, None, stream(3, "tree", "plain", 0))
    assert not tree.grafted
    assert tree.mesh.uv is not None
    assert tree.mesh.vertices[:, 2].min() == pytest.approx(-SUNK, abs=0.01)
    again = grow(species, None, stream(3, "tree", "plain", 0))
    assert np.array_equal(tree.mesh.vertices, again.mesh.vertices)
    bare = grow(replace(species, leaf=Leaf(on=False)), None, stream(3, "tree", "plain", 0))
    assert np.array_equal(bare.mesh.vertices, tree.mesh.vertices[: len(bare.mesh.vertices)])
    coarse = grow(
        replace(species, detail=Detail(tolerance=0.02)), None, stream(3, "tree", "plain", 0)
    )
    assert np.sum(coarse.mesh.part == WOOD) < 0.8 * np.sum(tree.mesh.part == WOOD)


def test_fewer_leaves_keep_their_area_and_move_no_branch():
    species, _ = load_species(find_species("honda-birch", Path()))
    few = replace(species, detail=Detail(leaves=0.2))
    whole, thinned = (grow(s, None, stream(3, "tree", "birch", 0)) for s in (species, few))
    assert len(thinned.leaves) == pytest.approx(0.2 * len(whole.leaves), abs=1)
    areas = [(tree.leaves.radius**2).sum() for tree in (thinned, whole)]
    assert areas[0] == pytest.approx(areas[1], rel=1e-9)
    assert np.array_equal(thinned.skeleton.end, whole.skeleton.end)
    measured = measure_leaves(thinned.mesh)
    np.testing.assert_allclose(thinned.leaves.radius, measured.radius, rtol=1e-6)
