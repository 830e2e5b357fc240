"""Add > Mesh > L-system Tree, as its operator runs."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.base.trimesh import LEAF
from forest_addon.blender.scene.meshes import from_mesh
from forest_addon.ui.forest import tree

from ..pressing import ROOT


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


@pytest.mark.medium
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


@pytest.mark.slow
def test_every_preset_is_offered_and_any_kind_can_be_added(props):
    presets = {path.stem for path in (ROOT / "assets" / "species").glob("*.toml")}
    assert presets <= {item[0] for item in tree.species_items()}
    for species in (
        "whorl-8",
        "abop-monopodial-a",
        "honda-willow",
        "scots-pine",
        "apple-stochastic",
    ):
        assert len(add(species=species).triangles)


def test_it_starts_with_a_leafy_one_and_offers_the_users_too(small):
    bpy.ops.forest.edit_species()
    offered = [item[0] for item in tree.species_items()]
    assert offered[0] == tree.LEAFY
    assert small.plantings[0].species in offered
    assert np.any(add().part == LEAF)
    assert len(add(species=small.plantings[0].species).triangles)


@pytest.mark.medium
def test_a_tree_is_grown_again_from_the_settings_that_it_keeps(props):
    grown = add(species="ginkgo", generations=4, seed=3)
    thing = bpy.context.active_object
    kept = thing.data.forest_grown
    assert (kept.species, kept.seed, kept.generations, kept.leaves) == ("ginkgo", 3, 4, True)
    mine = bpy.data.materials.new("mine")
    thing.data.materials[0] = mine
    thing.modifiers.new("mine", "DISPLACE")
    other = bpy.data.objects.new("other", thing.data)
    bpy.context.scene.collection.objects.link(other)
    meshes, thing.data["plot"] = len(bpy.data.meshes), "B7"
    assert bpy.ops.forest.grow_again() == {"FINISHED"}
    np.testing.assert_array_equal(from_mesh(thing.data).vertices, grown.vertices)
    assert bpy.ops.forest.grow_again(new_seed=True) == {"FINISHED"}
    assert (thing.data.forest_grown.seed, thing.data["plot"]) == (4, "B7")
    assert not np.array_equal(from_mesh(thing.data).vertices, grown.vertices)
    assert thing.data.materials[0] == mine
    assert (other.data, len(thing.modifiers), len(bpy.data.meshes)) == (thing.data, 1, meshes)
    thing.data.forest_grown.species = "hazelnut"
    thing.data.forest_grown.generations = 0
    assert bpy.ops.forest.grow_again() == {"FINISHED"}
    assert thing.data.materials[0].name == "hazelnut bark"


def test_a_tree_of_another_file_is_left_to_that(props, tmp_path):
    add(species="hazelnut")
    path = str(tmp_path / "library.blend")
    bpy.data.libraries.write(path, {bpy.context.active_object})
    with bpy.data.libraries.load(path, link=True) as (source, target):
        target.objects = source.objects
    bpy.context.scene.collection.objects.link(target.objects[0])
    bpy.context.view_layer.objects.active = target.objects[0]
    with pytest.raises(RuntimeError, match="another file"):
        bpy.ops.forest.grow_again()


def test_a_tree_that_was_saved_is_grown_again(props, tmp_path):
    grown = add(species="ginkgo", generations=4, seed=3)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "tree.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "tree.blend"))
    assert bpy.ops.forest.grow_again() == {"FINISHED"}
    again = from_mesh(bpy.context.object.data)
    np.testing.assert_array_equal(again.vertices, grown.vertices)


def test_another_mesh_is_not_grown(props):
    bpy.ops.mesh.primitive_cube_add()
    with pytest.raises(RuntimeError, match="no tree of Add"):
        bpy.ops.forest.grow_again()
