"""Leaves made for a template tree without leaves."""

import shutil

import numpy as np
import pytest

from forest_addon.base.places import ASSETS
from forest_addon.base.rng import stream
from forest_addon.formats.stl import read_stl
from forest_addon.growth.library.species_file import load_species
from forest_addon.growth.mesh.blades import SHAPES
from forest_addon.growth.own_tree.recognise import recognise
from forest_addon.growth.own_tree.template import dress, split_tree
from forest_addon.growth.tree import grow
from forest_addon.spec import Leaf, Normal

LEAF = Leaf(
    length=Normal(mean=0.08, sd=0.0), width_ratio=Normal(mean=0.5, sd=0.0), nodes=3, per_node=2
)


@pytest.fixture(scope="module")
def wood():
    return read_stl(ASSETS / "templates" / "maple" / "wood.stl")


@pytest.mark.medium
@pytest.mark.parametrize("unit", [1.0, 0.1])
def test_every_twig_bears_nodes_times_leaves_of_their_true_size(wood, unit):
    facets = dress(wood / unit, LEAF, SHAPES["ellipse"](), unit)
    bare = recognise(wood)
    twigs = np.setdiff1d(np.arange(len(bare.parent)), [*bare.parent, bare.trunk])
    split = split_tree(wood, facets * unit)
    assert split.leaf_count == len(twigs) * 6
    assert split.unattached_leaves == 0
    for branch in split.branches:
        assert branch.leaves.length * branch.length == pytest.approx(0.08, rel=1e-3)
        # The polygon has the area of the ellipse of 8 by 4 cm.
        radius = np.sqrt(0.08 * 0.04) / 2
        assert branch.leaves.radius * branch.length == pytest.approx(radius, rel=1e-3)


def test_leaves_reach_the_tips(wood):
    facets = dress(wood, LEAF, SHAPES["ellipse"](), 1.0)
    bare = recognise(wood)
    twigs = np.setdiff1d(np.arange(len(bare.parent)), [*bare.parent, bare.trunk])
    corner = facets.reshape(-1, 3)
    for tip in bare.tip[twigs]:
        assert np.linalg.norm(corner - tip, axis=1).min() < 0.02


@pytest.mark.slow
def test_a_species_file_asks_for_them(tmp_path):
    shutil.copy(ASSETS / "templates" / "maple" / "wood.stl", tmp_path)
    text = 'name = "dressed"\n[template]\nwood = "wood.stl"\n'
    (tmp_path / "bare.toml").write_text(text)
    (tmp_path / "leafy.toml").write_text(text + 'grow_leaves = true\n[leaf]\nshape = "maple"\n')
    bare, leafy = (load_species(tmp_path / f"{name}.toml") for name in ("bare", "leafy"))
    assert bare[1].leaf_count == 0
    assert leafy[1].leaf_count > 100
    tree, again = (grow(*leafy, stream(1, "tree")) for _ in range(2))
    assert len(tree.leaves) > 1000
    assert np.array_equal(tree.mesh.vertices, again.mesh.vertices)
