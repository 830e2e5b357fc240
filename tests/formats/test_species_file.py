"""Species files: leaves of one's own, and what is wrong said in one sentence."""

import gc
import shutil

import numpy as np
import pytest
from references.model_tree import tree

from forest_addon.base.places import ASSETS
from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF
from forest_addon.formats.stl import read_stl, write_stl
from forest_addon.growth.library import KEPT, find_species, load_species
from forest_addon.growth.mesh.leaves import measure_leaves
from forest_addon.growth.own_tree.template import BranchTemplate
from forest_addon.growth.tree import grow
from forest_addon.spec import SpecError

SPECIES = """
name = "kite tree"
[grammar]
generations = 4
radius = 0.08
[leaf]
mesh = "kite.stl"
"""
KITE = np.array([[0, 0, 0], [1, -0.6, 0], [3, 0, 0], [1, 0.6, 0]])[[[0, 1, 2], [0, 2, 3]]]


def test_leaves_of_a_users_own_shape(tmp_path):
    (tmp_path / "kite.toml").write_text(SPECIES)
    write_stl(tmp_path / "kite.stl", KITE)
    species, blade = load_species(tmp_path / "kite.toml")
    tree = grow(species, blade, stream(1, "kite"))
    assert len(tree.leaves) > 100
    assert np.sum(tree.mesh.part == LEAF) == 2 * len(tree.leaves)
    measured = measure_leaves(tree.mesh)
    np.testing.assert_allclose(tree.leaves.radius, measured.radius, rtol=1e-6)
    area = np.pi * tree.leaves.radius**2
    np.testing.assert_allclose(area, tree.leaves.length * tree.leaves.width / 2, rtol=1e-6)


@pytest.mark.parametrize(
    ("facets", "complaint"),
    [(None, "there is no file"), (KITE * [1, 0, 0], "no area")],
)
def test_a_leaf_that_cannot_be_used(tmp_path, facets, complaint):
    (tmp_path / "kite.toml").write_text(SPECIES)
    if facets is not None:
        write_stl(tmp_path / "kite.stl", facets)
    with pytest.raises(SpecError, match=complaint) as caught:
        load_species(tmp_path / "kite.toml")
    assert "leaf.mesh" in str(caught.value)


@pytest.mark.slow
def test_a_tree_is_recognised_once_as_long_as_its_files_stay_the_same(tmp_path):
    """By what is in them: a file that was written anew is read anew, at another height it is another."""

    def load(height):
        (tmp_path / "mine.toml").write_text(
            f'name = "mine"\n[template]\nwood = "wood.stl"\nheight = {height}\n'
        )
        return load_species(tmp_path / "mine.toml")[1]

    wood = tree().wood()
    write_stl(tmp_path / "wood.stl", wood)
    first = load(5.0)
    assert load(5.0) is first
    assert load(6.0).trunk_length == pytest.approx(1.2 * first.trunk_length)
    assert load(5.0) is first
    write_stl(tmp_path / "wood.stl", wood * [1, 1, 2])
    assert load(5.0) is not first
    for height in range(7, 7 + KEPT):
        load(float(height))
    write_stl(tmp_path / "wood.stl", wood)
    again = load(5.0)  # no longer kept: recognised again, the same
    assert again is not first
    np.testing.assert_array_equal(again.trunk.vertices, first.trunk.vertices)


@pytest.mark.medium
def test_a_template_is_cut_once_in_a_process(tmp_path):
    """A series of scenes keeps one template and its branches, not one a scene; another solid is another."""
    first = load_species(find_species("hazelnut", tmp_path))[1]
    again = load_species(find_species("hazelnut", tmp_path))[1]
    assert again is first
    shutil.copytree(ASSETS / "templates" / "hazelnut", tmp_path / "t")
    preset = find_species("hazelnut", tmp_path).read_text()
    file = tmp_path / "own.toml"
    file.write_text(preset.replace("../templates/hazelnut", "t"))
    assert load_species(file)[1] is first
    write_stl(tmp_path / "t" / "wood.stl", 1.01 * read_stl(tmp_path / "t" / "wood.stl"))
    other = load_species(file)[1]
    assert other is not first
    assert len(other.branches) == len(first.branches)


@pytest.mark.slow
def test_what_is_kept_of_templates_does_not_grow_with_scenes(tmp_path):
    def kept():
        gc.collect()
        return sum(isinstance(thing, BranchTemplate) for thing in gc.get_objects())

    counts = []
    for _ in range(3):
        species, template = load_species(find_species("hazelnut", tmp_path))
        grow(species, template, stream(1, "series"))
        del species, template
        counts.append(kept())
    assert counts[0] == counts[1] == counts[2]
