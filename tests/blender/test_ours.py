"""Building again removes what we made and nothing else; a build that fails leaves everything."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import spec
from forest_addon.base.places import ASSETS
from forest_addon.blender.scene import forest as room
from forest_addon.blender.scene.forest import build
from forest_addon.blender.scene.layout import (
    GROUND_NAME,
    PARTS,
    TREES,
    VARIANTS,
    is_ours,
    part,
    root,
)
from forest_addon.growth.library import load_species
from forest_addon.stand.forest import grow_forest

KINDS = ("objects", "meshes", "materials", "collections", "node_groups")


def settings(instancing):
    return spec.Scene(
        seed=2,
        forest=spec.Forest(size=(9.0, 9.0), margin=5.0, instancing=instancing),
        plantings=(spec.Planting(species="apple", variants=2, expected=3, exact=True),),
        sensors=(spec.Sonar(),),
    )


@pytest.fixture(scope="module")
def grown():
    species = load_species(ASSETS / "species" / "apple.toml")
    return grow_forest(settings("points"), [species])


def plant(grown, instancing="points"):
    return build(bpy.context.scene, settings(instancing), grown)


def counts():
    return {kind: len(getattr(bpy.data, kind)) for kind in KINDS}


def rock(home, name="rock"):
    thing = bpy.data.objects.new(name, bpy.data.meshes.new(name))
    home.objects.link(thing)
    return thing


@pytest.mark.medium
@pytest.mark.parametrize("instancing", ["points", "objects"])
def test_building_again_piles_nothing_up_and_keeps_names(empty_blender, grown, instancing):
    plant(grown, instancing)
    before = counts(), sorted(thing.name for thing in bpy.data.objects)
    names = sorted(home.name for home in bpy.data.collections)
    plant(grown, instancing)
    assert (counts(), sorted(thing.name for thing in bpy.data.objects)) == before
    assert sorted(home.name for home in bpy.data.collections) == names
    assert all(is_ours(thing) for thing in bpy.data.objects)


@pytest.mark.slow
@pytest.mark.parametrize("name", PARTS)
def test_what_others_put_into_our_collections_stays_there(empty_blender, grown, name):
    plant(grown)
    mine = rock(part(bpy.context.scene, name))
    for _ in range(2):
        plant(grown)
        assert mine.name == "rock"
        assert mine.name in part(bpy.context.scene, name).objects
        assert [home.name for home in mine.users_collection] == [name]


def test_what_stands_beside_the_parts_or_in_a_species_stays(empty_blender, grown):
    top = plant(grown, "objects")
    beside, among = rock(top), rock(part(bpy.context.scene, TREES).children[0], "bush")
    own = bpy.data.collections.new("Huts")
    part(bpy.context.scene, GROUND_NAME).children.link(own)
    hut = rock(own, "hut")
    plant(grown)
    assert beside.name in root(bpy.context.scene).objects
    assert among.name in part(bpy.context.scene, TREES).objects
    assert own.name in part(bpy.context.scene, GROUND_NAME).children
    assert hut.name in own.objects


def test_copies_belong_to_the_user_and_a_renamed_tree_is_still_the_tree(empty_blender, grown):
    plant(grown, "objects")
    first, second = list(part(bpy.context.scene, TREES).all_objects)[:2]
    count = len(grown.stand)
    copy = first.copy()
    first.users_collection[0].objects.link(copy)
    second.name = "the old oak"
    mesh = second.data
    plant(grown, "objects")
    kept = part(bpy.context.scene, TREES).all_objects
    assert {copy.name, "the old oak"} <= set(kept.keys())
    assert kept["the old oak"].data == mesh
    assert len(mesh.polygons)
    assert len(kept) == count + 1  # none stands where the renamed one does


def test_a_tree_that_is_needed_no_more_stays_in_a_collection_of_the_users(empty_blender, grown):
    plant(grown, "objects")
    own = bpy.data.collections.new("Chosen")
    bpy.context.scene.collection.children.link(own)
    chosen = next(iter(part(bpy.context.scene, TREES).all_objects))
    own.objects.link(chosen)
    plant(grown, "points")
    assert list(own.objects) == [chosen]
    assert list(chosen.users_collection) == [own]


def test_a_tree_that_cannot_stand_leaves_the_scene_as_it_was(empty_blender, grown, monkeypatch):
    rock(bpy.context.scene.collection)
    before = counts()
    spoilt = {**vars(grown), "stand": type(grown.stand)(**vars(grown.stand))}
    spoilt["stand"].scale[:] *= -1
    try:
        with pytest.raises(ValueError, match="size factor"):
            plant(type(grown)(**spoilt))
    finally:
        spoilt["stand"].scale[:] *= -1
    assert counts() == before
    plant(grown)
    before, names = counts(), set(bpy.data.objects.keys())

    def full(*_):
        raise MemoryError

    monkeypatch.setattr(room, "ground_mesh", full)
    with pytest.raises(MemoryError):
        plant(grown)
    assert (counts(), set(bpy.data.objects.keys())) == (before, names)


@pytest.mark.medium
def test_another_forest_of_the_same_file_is_left_alone(empty_blender, grown):
    plant(grown)
    other = bpy.data.scenes.new("other")
    build(other, settings("points"), grown)
    trees = part(bpy.context.scene, TREES).objects[0]
    build(other, settings("points"), grown)
    assert trees.name in part(bpy.context.scene, TREES).objects
    assert len(part(other, TREES).objects) == 1
    assert len(bpy.data.node_groups) == 1
    assert len(part(other, VARIANTS).objects) == len(grown.variants)
    assert np.isfinite(trees.dimensions).all()


def test_meshes_keep_the_number_of_their_variant(empty_blender, grown):
    for _ in range(3):
        plant(grown)
        for thing in part(bpy.context.scene, VARIANTS).objects:
            assert thing.name.split(" ", 1)[1] == thing.data.name
