"""Add > Mesh > L-system Tree, as its operator runs."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.blender.meshes import from_mesh
from forest_addon.growth.mesh.trimesh import LEAF
from forest_addon.ui.forest import tree


def add(**settings):
    assert bpy.ops.forest.add_tree(**settings) == {"FINISHED"}
    return from_mesh(bpy.context.active_object.data)


def test_a_tree_stands_at_the_cursor(props):
    bpy.context.scene.cursor.location = (1, 2, 3)
    add(species="hazelnut")
    thing = bpy.context.active_object
    assert tuple(thing.location) == (1, 2, 3)
    assert thing.select_get()
    assert [slot.name for slot in thing.data.materials] == ["hazelnut bark", "hazelnut leaf"]


def test_leaves_off_moves_no_branch(props):
    leafy, bare = add(species="maple", seed=4), add(species="maple", seed=4, leaves=False)
    assert np.any(leafy.part == LEAF)
    assert not np.any(bare.part == LEAF)
    wood = leafy.select(leafy.part != LEAF)
    np.testing.assert_array_equal(bare.vertices[bare.triangles], wood.vertices[wood.triangles])


def test_seed_and_generations_change_the_tree(props):
    small = add(species="ginkgo", generations=4)
    assert len(add(species="ginkgo", generations=5).triangles) > len(small.triangles)
    other = add(species="ginkgo", generations=4, seed=2)
    assert not np.array_equal(other.vertices, small.vertices)


@pytest.mark.parametrize("species", [name for name, _, _ in tree.species_items()])
def test_every_preset_can_be_added(props, species):
    assert len(add(species=species).triangles)
