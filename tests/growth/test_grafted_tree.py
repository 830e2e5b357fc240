"""A grown tree: what it is made of, its truth, its independence of everything else."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from forest_addon.base.places import ASSETS
from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, WOOD
from forest_addon.growth.library.species_file import load_species
from forest_addon.growth.mesh.leaves import measure_leaves
from forest_addon.growth.own_tree.template import GraftSite, graft, prepare
from forest_addon.growth.tree import grow
from forest_addon.spec import Template

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data" / "maple"


@pytest.fixture(scope="module")
def maple():
    return load_species(ASSETS / "species" / "maple.toml")


@pytest.fixture(scope="module")
def tree(maple):
    return grow(*maple, stream(1, "tree"))


def test_a_tree_stands_on_the_ground_with_its_trunk_upright(tree):
    low = tree.mesh.vertices[:, 2].min()
    assert -0.3 < low < 0  # sunk a little, so that no gap shows
    foot = tree.mesh.vertices[np.abs(tree.mesh.vertices[:, 2]) < 0.02]
    assert np.abs(foot[:, :2]).max() < 0.4
    assert 7 < tree.height < 13
    assert np.isfinite(tree.mesh.vertices).all()


def test_the_skeleton_is_trunk_and_first_level_axes(tree, maple):
    grammar = maple[0].grammar
    assert set(tree.skeleton.order.tolist()) == {0, 1}
    assert (tree.skeleton.order == 0).sum() == grammar.generations + 1
    firsts = (tree.skeleton.order == 1) & (tree.skeleton.order[tree.skeleton.parent] == 0)
    assert firsts.sum() == 2 * grammar.generations
    assert tree.skeleton.radius[0, 0] == grammar.radius


def test_the_truth_of_leaves_is_what_their_triangles_measure(tree):
    again = measure_leaves(tree.mesh, tree.leaves.branch)
    for name in ("centre", "normal", "radius"):
        assert np.allclose(getattr(again, name), getattr(tree.leaves, name), atol=1e-9), name
    assert (tree.mesh.part[tree.mesh.leaf >= 0] == LEAF).all()
    assert (np.unique(tree.mesh.leaf) == np.arange(-1, len(tree.leaves))).all()
    branches = 2 * 7 * 2 + 1  # symmetric pairs, generations, copies, and the tip
    assert tree.leaves.branch.min() >= 0
    assert tree.leaves.branch.max() < branches
    # Leaves are as large as a maple's, on long branches and on short ones.
    assert 0.10 < np.median(tree.leaves.length) < 0.16


def test_leaves_reach_the_tips_and_fill_the_crown(tree):
    crown = tree.leaves.centre
    assert crown[:, 2].max() > 0.97 * tree.height
    wood = tree.mesh.vertices[np.unique(tree.mesh.triangles[tree.mesh.part == WOOD])]
    reach = np.linalg.norm(wood[:, :2], axis=1).max()
    assert np.linalg.norm(crown[:, :2], axis=1).max() > 0.95 * reach


def test_a_tree_is_a_function_of_its_stream_alone(maple):
    one, two = (grow(*maple, stream(5, "tree", 3)) for _ in range(2))
    assert (one.mesh.vertices == two.mesh.vertices).all()
    other = grow(*maple, stream(5, "tree", 4))
    assert other.mesh.vertices.shape != one.mesh.vertices.shape or not np.array_equal(
        other.mesh.vertices, one.mesh.vertices
    )


@pytest.mark.parametrize("generations", [0, 1, 9])
def test_few_and_many_generations(maple, generations):
    species, template = maple
    species = replace(species, grammar=replace(species.grammar, generations=generations))
    grown = grow(species, template, stream(2, "tree"))
    assert np.isfinite(grown.mesh.vertices).all()
    assert grown.skeleton.order.max() == min(generations, 1)


def test_a_graft_starts_at_its_site_and_ends_at_its_length(maple):
    scion = prepare(maple[1].branches[0])
    direction = np.array([0.36, 0.48, 0.8])
    site = GraftSite(np.array([1.0, 2.0, 3.0]), direction, 4.0)
    mesh = graft(scion, site, 0.0, 0.0, stream(0, "graft"))
    mesh = mesh[0] if isinstance(mesh, tuple) else mesh
    wood = mesh.vertices[np.unique(mesh.triangles[mesh.part == WOOD])] - site.foot
    assert np.linalg.norm(wood, axis=1).min() < 0.1
    end = np.linalg.norm(wood - 4.0 * direction, axis=1).min()
    assert end < 0.05


def test_leaves_face_the_light_as_their_template_does(tree):
    upward = np.abs(tree.leaves.normal[:, 2])
    assert np.median(upward) > 0.5  # isotropic leaves would have 0.5; these lie flatter


@pytest.mark.medium
@pytest.mark.skipif(not SHARED.is_dir(), reason="the maple of T20 is not beside the repository")
def test_the_papers_own_maple_gives_trees_too(maple):
    from forest_addon.formats.stl import read_stl
    from forest_addon.growth.own_tree.template import split_tree

    wood, leaves = (read_stl(SHARED / f"maple_{part}.stl") for part in ("stem", "leaves"))
    template = split_tree(wood, leaves, height=12.0)
    species = replace(maple[0], template=Template(wood="maple_stem.stl", height=12.0))
    grown = grow(species, template, stream(3, "tree"))
    assert len(grown.leaves) > 1000
    assert 7 < grown.height < 14
    assert np.isfinite(grown.mesh.vertices).all()


def test_as_many_templates_as_nodes_match_one_to_one(maple):
    species, template = maple
    species = replace(species, grammar=replace(species.grammar, generations=2, copies=1))
    sites = 2 * 2 * 1 + 1
    five = replace(template, branches=template.branches[:sites])
    assert len(five.branches) == sites
    grown = grow(species, five, stream(4, "tree"))
    per_branch = np.bincount(grown.leaves.branch, minlength=sites)
    assert (per_branch > 0).all()
