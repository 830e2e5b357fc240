"""An update puts the new forest into the objects that stand there; what the user did to them stays.

What a forest must be is read from a fresh build of the same forest in an empty file; what must stay is what
the tests did by hand, as Blender itself tells.
"""

import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.scenes import add_collection, link

from forest_addon import spec
from forest_addon.base.places import ASSETS
from forest_addon.base.trimesh import GROUND
from forest_addon.blender.read.depsgraph import SPECIES_KEY, TREE_KEY
from forest_addon.blender.scene import assets, forest as room, materials, nodes
from forest_addon.blender.scene.forest import build
from forest_addon.blender.scene.instances import read_points
from forest_addon.blender.scene.layout import (
    GROUND_NAME,
    MADE_KEY,
    OUTLINES,
    PARTS,
    TREES,
    VARIANTS,
    is_ours,
    part,
    root,
)
from forest_addon.blender.scene.placing import KeptStanding, fingerprint
from forest_addon.growth.library import load_species
from forest_addon.stand.forest import grow_forest

KINDS = ("objects", "meshes", "materials", "collections", "node_groups")
HOW = ("objects", "points")
LOST = (None, TREES, VARIANTS, OUTLINES, GROUND_NAME)
OLD_KEYS = {MADE_KEY, TREE_KEY, SPECIES_KEY, "forest_sensing", "forest_part"}


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch):
    """Pictures of variants from few dots: these tests look at none."""
    monkeypatch.setattr(assets, "DOTS", 200)


def settings(seed, count, instancing, species=("apple-stochastic",)):
    plantings = [
        spec.Planting(species=name, variants=3, expected=count, exact=True) for name in species
    ]
    return spec.Scene(
        seed=seed,
        forest=spec.Forest(size=(20.0, 20.0), margin=3.0 + seed, instancing=instancing),
        plantings=tuple(plantings),
    )


@lru_cache(maxsize=32)
def grown(seed, count, species, look):
    kinds = [young(*load_species(ASSETS / "species" / f"{name}.toml")) for name in species]
    if look is not None:
        kinds = [(with_look(kind, look), template) for kind, template in kinds]
    return grow_forest(settings(seed, count, "auto", species), kinds)


def young(kind, template):
    """A species of some hundred triangles a tree."""
    if kind.rules is not None:
        return replace(kind, rules=replace(kind.rules, generations=3)), template
    return replace(kind, grammar=replace(kind.grammar, generations=1)), template


def with_look(kind, look):
    return replace(kind, look=replace(kind.look, bark=look, leaf=look[::-1]))


def plant(how="objects", seed=1, count=9, species=("apple-stochastic",), look=None, scene=None):
    scene = scene or bpy.context.scene
    forest = grown(seed, count, tuple(species), look)
    build(scene, settings(seed, count, how, tuple(species)), forest)
    bpy.context.view_layer.update()
    return forest


def ours(name, scene=None):
    """Objects of one part of the forest, by their names."""
    home = part(scene or bpy.context.scene, name)
    homes = (home, *home.children_recursive)  # ``all_objects`` may be stale after an undo
    return {obj.name: obj for home in homes for obj in home.objects}


def first(name):
    return next(iter(sorted(ours(name).items())))[1]


def vertices(data):
    place = np.empty(3 * len(data.vertices), dtype=np.float32)
    data.vertices.foreach_get("co", place)
    return place.tobytes()


def told(scene=None):
    """All that a forest shows: names, places, meshes, materials, numbers, collections."""
    things = {}
    for name in PARTS:
        for obj in ours(name, scene).values():
            slots = tuple(slot.material and slot.material.name for slot in obj.material_slots)
            shown = ()
            if obj.modifiers and scene is None:
                placed = read_points(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()))
                sources = [placed.source[i].name for i in placed.index]
                shown = (sources, placed.transform.tobytes(), placed.tree.tobytes())
            things[obj.name] = (
                tuple(map(tuple, obj.matrix_world)),
                vertices(obj.data),
                obj.data.name,
                slots,
                (obj.get(TREE_KEY), obj.get(SPECIES_KEY)),
                shown,
                [home.name for home in obj.users_collection],
            )
    return things


def ids(blocks):
    return {block.name: block.session_uid for block in blocks}


def counts():
    return {kind: len(getattr(bpy.data, kind)) for kind in KINDS}


def empty():
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)


def fresh_of(how, **changes):
    """Build a forest in an empty file, empty it again, and return what the forest showed."""
    plant(how, **changes)
    shown = told()
    empty()
    return shown


def mesh(name="own"):
    data = bpy.data.meshes.new(name)
    data.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 1)], [], [(0, 1, 2)])
    return data


# ------------------------------------------------------------------------------ the same and the new


def alternately(cases, first=0):
    """Each case with one of the two ways in which trees stand, in turn."""
    return [(case, HOW[(number + first) % 2]) for number, case in enumerate(cases)]


CHANGES = (
    {"seed": 2},
    {"count": 4},
    {"count": 15, "seed": 5},
    {"species": ("hazelnut", "apple-stochastic")},
    {"species": ("hazelnut",)},
    {"look": (0.1, 0.2, 0.3)},
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "how"),
    [*alternately(CHANGES), *alternately(CHANGES[:1], 1), (CHANGES[3], "objects")],
)
def test_an_update_is_the_forest_that_a_fresh_build_is(empty_blender, how, change):
    fresh = fresh_of(how, **change)
    plant(how)
    plant(how, **change)
    assert told() == fresh


@pytest.mark.medium
@pytest.mark.parametrize(("before", "after"), [HOW, HOW[::-1]])
def test_switching_between_points_and_objects(empty_blender, before, after):
    plant(after, seed=2)
    fresh, count = told(), counts()
    empty()
    plant(before)
    plant(after, seed=2)
    assert told() == fresh
    made = counts()
    assert made.pop("node_groups") == 1  # the instancer stays for the next time
    assert {key: count[key] for key in made} == made


@pytest.mark.medium
@pytest.mark.parametrize("how", HOW)
def test_what_stands_for_the_same_is_the_same_block(empty_blender, how):
    plant(how)
    things, homes = ids(bpy.data.objects), ids(bpy.data.collections)
    coats, groups = ids(bpy.data.materials), ids(bpy.data.node_groups)
    plant(how, seed=2)
    assert ids(bpy.data.collections) == homes
    assert ids(bpy.data.materials) == coats
    assert ids(bpy.data.node_groups) == groups
    assert all(is_ours(obj) for obj in bpy.data.objects)
    now = ids(bpy.data.objects)
    assert {name: now[name] for name in things if name in now} == {
        name: uid for name, uid in things.items() if name in now
    }
    assert len(now.keys() & things.keys()) >= len(things) - 2  # a variant may not stand there


@pytest.mark.medium
def test_a_variant_whose_number_changes_is_the_same_object(empty_blender):
    plant()
    before = {t.name.split(" ", 1)[1]: t.session_uid for t in ours(VARIANTS).values()}
    plant(species=("hazelnut", "apple-stochastic"))
    after = {t.name.split(" ", 1)[1]: t.session_uid for t in ours(VARIANTS).values()}
    kept = {name: uid for name, uid in after.items() if name in before}
    assert kept
    assert kept == {name: before[name] for name in kept}
    names = sorted(ours(VARIANTS))
    assert [int(name[:3]) for name in names] == list(range(len(names)))


@pytest.mark.slow
def test_many_updates_leave_nothing_behind(empty_blender, tmp_path):
    sizes, told_of = [], []
    for _ in range(5):
        for how, seed in (("points", 1), ("objects", 2), ("points", 3), ("points", 1)):
            plant(how, seed=seed)
        told_of.append(counts())
        path = tmp_path / "forest.blend"
        bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
        sizes.append(path.stat().st_size)
    assert all(found == told_of[0] for found in told_of)
    assert max(sizes) < 1.01 * sizes[0]
    assert not [m for m in (*bpy.data.meshes, *bpy.data.materials) if not m.users]
    names = [*bpy.data.collections, *bpy.data.materials, *bpy.data.meshes]
    assert not [block.name for block in names if re.search(r"\.\d+\.\d+$| .*\.\d+$", block.name)]


# ------------------------------------------------------------------------------- collections, objects


@pytest.mark.parametrize("how", HOW)
def test_edits_of_collections_stay(empty_blender, how):
    plant(how)
    layer = bpy.context.view_layer.layer_collection.children["Forest"]
    top, ground, trees = (
        root(bpy.context.scene),
        *(part(bpy.context.scene, name) for name in (GROUND_NAME, TREES)),
    )
    layer.children["Trees"].exclude = True
    layer.children["Ground"].hide_viewport = layer.children["Ground"].holdout = True
    ground.hide_render, ground.color_tag, ground["mine"] = True, "COLOR_04", 7
    part(bpy.context.scene, VARIANTS).hide_viewport = False
    trees.name, top.name = "Stems", "Wood of the owls"
    linked = link("lamp", home=ground)
    inner = add_collection("Huts", trees)
    plant(how, seed=2)
    layer = bpy.context.view_layer.layer_collection.children["Wood of the owls"]
    assert layer.children["Stems"].exclude
    assert layer.children["Ground"].hide_viewport
    assert layer.children["Ground"].holdout
    assert (ground.hide_render, ground.color_tag, ground["mine"]) == (True, "COLOR_04", 7)
    assert not part(bpy.context.scene, VARIANTS).hide_viewport
    assert part(bpy.context.scene, TREES) == trees
    assert linked.name in ground.objects
    assert inner.name in trees.children
    assert [home.name for home in top.children] == ["Stems", *PARTS[1:]]


@pytest.mark.medium
def test_edits_of_a_plantings_collection_stay(empty_blender):
    plant()
    grove = part(bpy.context.scene, TREES).children[0]
    grove.name, grove.color_tag = "Orchard", "COLOR_02"
    plant(seed=2)
    (only,) = part(bpy.context.scene, TREES).children
    assert (only, only.name, only.color_tag) == (grove, "Orchard", "COLOR_02")
    assert len(grove.objects) == 9
    plant(count=0)
    assert list(part(bpy.context.scene, TREES).children) == [grove]
    plant(species=("hazelnut",))
    assert not grove.objects  # renamed, it is the user's, but its trees were the forest's
    assert len([obj for obj in bpy.data.objects if TREE_KEY in obj]) == 9


def test_parts_are_found_where_the_user_put_them(empty_blender):
    plant()
    mine = add_collection("Mine")
    ground, top = part(bpy.context.scene, GROUND_NAME), root(bpy.context.scene)
    mine.children.link(ground)
    top.children.unlink(ground)
    mine.children.link(top)
    bpy.context.scene.collection.children.unlink(top)
    before = counts()
    plant()
    assert counts() == before
    assert [home.name for home in mine.children] == ["Ground", "Forest"]
    assert list(bpy.context.scene.collection.children) == [mine]


@pytest.mark.medium
@pytest.mark.parametrize(("name", "how"), alternately(PARTS))
def test_what_others_put_into_our_collections_stays_there(empty_blender, how, name):
    plant(how)
    home = part(bpy.context.scene, name)
    mine = rock(home)
    for seed in (1, 2):
        plant(how, seed=seed)
        assert mine.name == "rock"
        assert list(mine.users_collection) == [home] == [part(bpy.context.scene, name)]


def rock(home):
    return link("rock", bpy.data.meshes.new("rock"), home=home)


def test_what_stands_beside_the_parts_or_in_a_species_stays(empty_blender):
    plant()
    top, trees = root(bpy.context.scene), part(bpy.context.scene, TREES)
    beside, among = rock(top), rock(trees.children[0])
    plant("points")
    assert list(beside.users_collection) == [top]
    assert list(among.users_collection) == [trees]  # a species has no collection then


def test_copies_belong_to_the_user_and_a_renamed_tree_is_still_the_tree(empty_blender):
    plant()
    tree, renamed = list(ours(TREES).values())[:2]
    copy = tree.copy()
    tree.users_collection[0].objects.link(copy)
    renamed.name, data = "the old oak", renamed.data
    plant()
    kept = ours(TREES)
    assert {copy.name, "the old oak"} <= set(kept)
    assert kept["the old oak"].data == data
    assert len(kept) == 9 + 1  # none stands where the renamed one does


def test_a_tree_that_is_needed_no_more_stays_in_a_collection_of_the_users(empty_blender):
    plant()
    own, chosen = add_collection("Chosen"), first(TREES)
    own.objects.link(chosen)
    plant("points")
    assert list(own.objects) == [chosen]
    assert list(chosen.users_collection) == [own]


@pytest.mark.medium
@pytest.mark.parametrize("how", HOW)
def test_edits_of_objects_stay(empty_blender, how):
    plant(how)
    edited = [first(name) for name in (TREES, VARIANTS, GROUND_NAME)]
    for obj in edited:
        obj.hide_render = obj.hide_select = obj.show_wire = True
        obj["mine"], obj.data["mine"], obj.pass_index = "x", {"a": [1.5]}, 4
        obj.visible_shadow = False
    tree = first(TREES)
    tree.hide_set(True)
    variant = first(VARIANTS)
    variant.asset_data.author = "me"
    variant.asset_data.tags.new("best")
    plant(how, seed=2)
    assert [first(name) for name in (TREES, VARIANTS, GROUND_NAME)] == edited
    for obj in edited:
        assert (obj.hide_render, obj.hide_select, obj.show_wire) == (True, True, True)
        assert (obj["mine"], obj.pass_index, obj.visible_shadow) == ("x", 4, False)
    for obj in edited[1:]:
        assert obj.data["mine"].to_dict() == {"a": [1.5]}
    assert tree.hide_get()
    assert variant.asset_data.author == "me"
    assert {"best", "tree", "apple-stochastic"} <= set(variant.asset_data.tags.keys())
    variant.asset_clear()
    plant(how, seed=1)
    assert variant.asset_data is None


def test_a_tree_in_a_collection_of_the_users_is_brought_up_to_date_there(empty_blender):
    plant()
    both, moved = list(ours(TREES).values())[:2]
    own = add_collection("Chosen")
    for obj in (both, moved):
        own.objects.link(obj)
    part(bpy.context.scene, TREES).children[0].objects.unlink(moved)
    number = moved[TREE_KEY]
    forest = plant(seed=2)
    assert {home.name for home in both.users_collection} == {"apple-stochastic", "Chosen"}
    assert list(moved.users_collection) == [own]
    assert np.allclose(moved.matrix_world.translation[:2], forest.stand.position[number, :2])
    assert len([obj for obj in bpy.data.objects if TREE_KEY in obj]) == 9


def test_trees_that_hang_on_something_go_along_with_it(empty_blender):
    plant()
    anchor = link("anchor")
    for obj in ours(TREES).values():
        obj.parent = anchor
    anchor.location = (100, 0, 5)
    forest = plant(seed=2)
    for obj in ours(TREES).values():
        where = forest.transforms()[obj[TREE_KEY]]
        assert obj.parent == anchor
        shifted = where[:, 3] + [100, 0, 5]
        assert np.allclose(obj.matrix_world.translation, shifted, atol=1e-5)


# ----------------------------------------------------------------------------------------- materials


def slots(obj):
    return [slot.material for slot in obj.material_slots]


def test_slots_of_objects_stay(empty_blender):
    plant()
    mine = bpy.data.materials.new("mine")
    tree = first(TREES)
    tree.material_slots[1].link = "OBJECT"
    tree.material_slots[1].material = mine
    variant = first(VARIANTS)
    variant.data.materials.append(mine)
    plant(seed=2)
    assert tree.material_slots[1].link == "OBJECT"
    assert tree.material_slots[1].material == mine
    assert slots(variant)[2] == mine


@pytest.mark.medium
def test_a_further_variant_wears_what_the_first_of_its_species_wears(empty_blender):
    plant(count=1)
    mine = bpy.data.materials.new("mine")
    (only,) = ours(VARIANTS).values()
    only.data.materials[0] = mine
    plant(count=12, species=("apple-stochastic", "hazelnut"))
    assert len(ours(VARIANTS)) > 3
    for name, obj in ours(VARIANTS).items():
        assert (slots(obj)[0] == mine) == ("apple-stochastic" in name)


@pytest.mark.slow
@pytest.mark.parametrize("look", [None, (0.05, 0.1, 0.3)])
@pytest.mark.parametrize(("seed", "how"), [(1, "points"), (2, "objects")])
def test_edits_of_materials_stay_and_a_new_look_recolours_ours_alone(
    empty_blender, how, seed, look
):
    plant(how)
    bark, _ = slots(first(VARIANTS))
    rough = bark.node_tree.nodes["Principled BSDF"].inputs["Roughness"]
    rough.default_value = 0.123
    bark.node_tree.nodes.new("ShaderNodeTexVoronoi").name = "mine"
    mine = bpy.data.materials.new("mine")
    for obj in [*ours(VARIANTS).values(), *ours(GROUND_NAME).values()]:
        obj.data.materials[-1] = mine
    before = mine.diffuse_color[:]
    plant(how, seed=seed, look=look)
    for obj in [*ours(VARIANTS).values(), *(ours(TREES).values() if how == "objects" else ())]:
        assert slots(obj) == [bark, mine]
    assert slots(first(GROUND_NAME)) == [mine]
    assert mine.diffuse_color[:] == before
    assert "forest_look" not in mine
    assert rough.default_value == pytest.approx(0.123)
    assert "mine" in bark.node_tree.nodes
    if look:
        twin = materials.bark("twin", look)
        assert ramp_colours(bark) == ramp_colours(twin)
        assert bark.diffuse_color[:] == twin.diffuse_color[:]
        ramp(bark).elements[0].color = (1, 0, 0, 1)
        plant(how, seed=seed, look=look)  # did not change again: the user's colour stays
        assert ramp(bark).elements[0].color[:] == (1, 0, 0, 1)


def ramp(material):
    return next(n for n in material.node_tree.nodes if n.type == "VALTORGB").color_ramp


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "how"), [(1, "points"), (2, "objects")])
def test_materials_that_were_deleted_come_back(empty_blender, how, seed):
    fresh = fresh_of(how, seed=seed)
    plant(how)
    bpy.data.batch_remove(list(bpy.data.materials))
    plant(how, seed=seed)
    assert told() == fresh
    first(VARIANTS).data.materials.clear()
    plant(how, seed=seed)
    assert told() == fresh


# ----------------------------------------------------------------------------------------- modifiers


@pytest.mark.parametrize("how", HOW)
def test_modifiers_of_the_users_stay_and_work(empty_blender, how):
    plant(how)
    edited = [first(name) for name in (TREES, VARIANTS, GROUND_NAME)]
    for obj in edited:
        obj.modifiers.new("mine", "DISPLACE").strength = 0.25
    plant(how, seed=2)
    for obj in edited:
        assert obj.modifiers["mine"].strength == 0.25
    assert [len(obj.modifiers) for obj in edited] == [2 if how == "points" else 1, 1, 1]
    ground = first(GROUND_NAME).evaluated_get(bpy.context.evaluated_depsgraph_get())
    assert np.array([v.co.z for v in ground.data.vertices]).max() == pytest.approx(0.125)


def inputs(modifier):
    return {
        name: nodes._input(modifier, name)[0] for name in ("Variants", "Outlines", "Light View")
    }


def test_edits_of_the_instancer_stay(empty_blender, monkeypatch):
    plant("points")
    (obj,) = ours(TREES).values()
    (modifier,) = obj.modifiers
    group = modifier.node_group
    group.nodes.new("GeometryNodeTranslateInstances").name = "mine"
    shrubs = add_collection("Shrubs")
    nodes.set_input(modifier, "Variants", shrubs)
    nodes.set_input(modifier, "Light View", True)
    plant("points", seed=2)
    assert list(obj.modifiers) == [modifier]
    assert (modifier.node_group, "mine" in group.nodes) == (group, True)
    expected = {"Variants": shrubs, "Outlines": part(bpy.context.scene, OUTLINES)}
    assert inputs(modifier) == expected | {"Light View": True}
    copy = group.copy()
    modifier.node_group = copy
    plant("points", seed=1)
    assert [m.node_group for m in obj.modifiers] == [copy]


def test_a_view_becomes_light_by_itself_until_the_user_chooses(empty_blender, monkeypatch):
    plant("points")
    (modifier,) = first(TREES).modifiers
    assert not nodes.is_light(modifier)
    monkeypatch.setattr(room, "SHOWN_IN_FULL", 10)
    plant("points")
    assert nodes.is_light(modifier)
    nodes.set_input(modifier, "Light View", False)
    plant("points", seed=2)
    assert not nodes.is_light(modifier)


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["modifier", "group", "outlines socket", "variants"])
def test_an_instancer_that_lost_something_works_again(empty_blender, loss):
    fresh = {name: facts[5] for name, facts in fresh_of("points", seed=2).items()}
    plant("points")
    (obj,) = ours(TREES).values()
    if loss == "modifier":
        obj.modifiers.clear()
    elif loss == "group":
        bpy.data.node_groups.remove(obj.modifiers[0].node_group)
    elif loss == "outlines socket":
        tree = obj.modifiers[0].node_group.interface
        tree.remove(next(i for i in tree.items_tree if i.name == "Outlines"))
    else:
        bpy.data.collections.remove(part(bpy.context.scene, VARIANTS))
    plant("points", seed=2)
    assert len(obj.modifiers) == 1
    shown = told()[obj.name][5]
    assert [name[:24] for name in shown[0]] == [name[:24] for name in fresh[obj.name][0]]
    assert shown[1:] == fresh[obj.name][1:]


# -------------------------------------------------------------------------------------------- meshes


@pytest.mark.medium
@pytest.mark.parametrize("how", HOW)
def test_a_mesh_of_the_users_stays_on_our_object(empty_blender, how):
    plant(how)
    variant, ground, mine = first(VARIANTS), first(GROUND_NAME), mesh()
    variant.data = mine
    ground.data = ground.data.copy()
    ground.data.vertices[0].co.z = 3
    seen = vertices(ground.data)
    for seed in (2, 1, 2):
        plant(how, seed=seed)
        assert variant.data == mine
        assert not mine.materials
        assert vertices(ground.data) == seen
    assert all(data.users for data in bpy.data.meshes)
    kind = variant.name.split(" ", 1)[1]
    if how == "objects":
        forest = grown(2, 9, ("apple-stochastic",), None)
        for tree in ours(TREES).values():
            number = forest.stand.variant[tree[TREE_KEY]]
            assert (tree.data == mine) == (kind == f"apple-stochastic.{number:03d}")
        again = mesh("other")
        variant.data = again
        plant(how, seed=2)
        assert again.users > 1  # the trees of this variant follow
        assert mine.users == 0


def test_trees_follow_their_variants_whatever_the_meshes_are_called(empty_blender):
    plant()
    for number, obj in enumerate(ours(VARIANTS).values()):
        obj.data.name = f"mine {number}"
    for seed in (2, 3, 1):
        forest = plant(seed=seed)
        shown = {name.split(" ", 1)[1]: obj.data for name, obj in ours(VARIANTS).items()}
        for tree in ours(TREES).values():
            number = forest.stand.variant[tree[TREE_KEY]]
            assert tree.data == shown[f"apple-stochastic.{number:03d}"]


def test_a_mesh_that_did_not_change_keeps_what_was_done_to_it(empty_blender):
    plant()
    variant, ground = first(VARIANTS), first(GROUND_NAME)
    uids = variant.data.session_uid, ground.data.session_uid
    group = ground.vertex_groups.new(name="weights")
    group.add([0, 2], 0.5, "REPLACE")
    variant.data.vertices[5].co.x += 1
    seen = vertices(variant.data)
    plant(count=12)  # other trees of the same variants on the same ground
    assert (variant.data.session_uid, ground.data.session_uid) == uids
    assert vertices(variant.data) == seen
    assert ground.vertex_groups["weights"].weight(2) == 0.5
    plant(seed=2)
    assert variant.data.session_uid != uids[0]
    assert vertices(variant.data) != seen


def test_what_a_copy_shares_with_a_variant_stays_as_it_is(empty_blender):
    plant()
    variant = first(VARIANTS)
    twin = variant.copy()
    bpy.context.scene.collection.objects.link(twin)
    old, mine = twin.data, bpy.data.materials.new("mine")
    seen = vertices(old)
    for seed in (2, 3, 2):
        plant(seed=seed)
        assert twin.data == old
        assert vertices(old) == seen
        assert variant.data != old
        if seed == 2:
            variant.data.materials[0] = mine
    assert variant.data.materials[0] == mine


@pytest.mark.medium
@pytest.mark.parametrize("name", ["copy", "0", "zebra", "000 A"])
def test_what_others_put_among_the_variants_is_not_taken_for_one(empty_blender, name):
    plant("points")
    variant = first(VARIANTS)
    mine = variant.copy()
    if name != "copy":
        mine.name = name
    mine.data = mesh()
    part(bpy.context.scene, VARIANTS).objects.link(mine)
    forest = plant("points", seed=2)
    obj = ours(TREES)["Trees"]
    placed = read_points(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    for row, tree in enumerate(placed.tree):
        planned = f"apple-stochastic.{forest.stand.variant[tree]:03d}"
        assert placed.source[placed.index[row]].data.name == planned


# ------------------------------------------------------------------------------- failure, undo, redo


def everything():
    """Every block of ours and of the user's with what it holds."""
    found = told() | {"counts": counts(), "ids": [ids(getattr(bpy.data, kind)) for kind in KINDS]}
    found["slots"] = {m.name: [s and s.name for s in m.materials] for m in bpy.data.meshes}
    found["looks"] = {m.name: [*ramp_colours(m), *m.diffuse_color] for m in bpy.data.materials}
    found["modifiers"] = {o.name: [m.name for m in o.modifiers] for o in bpy.data.objects}
    found["properties"] = {o.name: sorted(o.keys()) for o in bpy.data.objects}
    found["children"] = {c.name: [k.name for k in c.children] for c in bpy.data.collections}
    return found


def ramp_colours(material):
    tree = material.node_tree
    nodes = [n for n in tree.nodes if n.type == "VALTORGB"] if tree else []
    return [c for n in nodes for e in n.color_ramp.elements for c in e.color]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("where", "how"), alternately(["ground_mesh", "stand_in", "fingerprint", "points_mesh"])
)
def test_an_update_that_fails_changes_nothing(empty_blender, how, where, monkeypatch):
    plant(how)
    bpy.data.materials.remove(slots(first(VARIANTS))[1])
    root(bpy.context.scene).children.unlink(part(bpy.context.scene, OUTLINES))
    before = everything()
    calls = []

    def full(*_, **__):
        calls.append(1)
        raise MemoryError

    monkeypatch.setattr(room, where, full)
    with pytest.raises(MemoryError):
        plant("points", seed=2, species=("hazelnut", "apple-stochastic"), look=(0.3, 0.2, 0.1))
    assert calls
    assert everything() == before


def test_a_tree_that_cannot_stand_leaves_the_scene_as_it_was(empty_blender):
    rock(bpy.context.scene.collection)
    before, forest = counts(), grown(1, 9, ("apple-stochastic",), None)
    spoilt = replace(forest, stand=replace(forest.stand, scale=-forest.stand.scale))
    with pytest.raises(ValueError, match="size factor"):
        build(bpy.context.scene, settings(1, 9, "points"), spoilt)
    assert counts() == before


@pytest.mark.slow
@pytest.mark.parametrize("how", HOW)
def test_undo_and_redo_restore_exactly(empty_blender, how):
    def step(name):
        bpy.ops.ed.undo_push(message=name)
        states.append(everything())

    states = []
    plant(how)
    for name in (TREES, VARIANTS, GROUND_NAME):
        first(name).modifiers.new("mine", "DISPLACE").strength = 0.5
    mine = bpy.data.materials.new("mine")
    first(VARIANTS).data.materials[0] = mine
    step("edited")
    plant(how, seed=2)
    step("seed")
    plant(how, seed=2, count=14, look=(0.3, 0.2, 0.1))
    step("more")
    plant("points" if how == "objects" else "objects", seed=3)
    step("other")
    for state in (*states[2::-1],):
        bpy.ops.ed.undo()
        assert everything() == state
        assert all("mine" in first(n).modifiers for n in (TREES, VARIANTS, GROUND_NAME))
    for state in states[1:]:
        bpy.ops.ed.redo()
        assert everything() == state
    bpy.ops.ed.undo()
    bpy.ops.ed.undo()
    assert everything() == states[1]
    plant(how, seed=3)
    assert "mine" in first(GROUND_NAME).modifiers
    assert slots(first(VARIANTS))[0].name == "mine"


def test_a_planting_is_not_dressed_like_one_whose_name_goes_on(empty_blender):
    mesh = bpy.data.meshes.new("other")
    standing = KeptStanding({}, {f"{VARIANTS}/maple.v2.000": mesh}, {})
    assert standing.first(f"{VARIANTS}/maple") is None
    assert standing.first(f"{VARIANTS}/maple.v2") == mesh


def test_while_something_of_it_is_edited_a_forest_stays_as_it_is(empty_blender):
    """A job may get there while the user works on."""
    plant()
    before = told(bpy.context.scene)
    bpy.context.view_layer.objects.active = first(GROUND_NAME)
    bpy.ops.object.mode_set(mode="EDIT")
    kept = counts()
    with pytest.raises(ValueError, match='"Ground" is being edited; leave Edit Mode'):
        plant(seed=2)
    assert counts() == kept
    bpy.ops.object.mode_set(mode="OBJECT")
    assert told(bpy.context.scene) == before


# --------------------------------------------------------------------------------- other forests, loss


@pytest.mark.slow
@pytest.mark.parametrize(("shown", "how"), alternately([False, True]))
def test_each_scene_updates_its_own_forest(empty_blender, how, shown):
    here, there = bpy.context.scene, bpy.data.scenes.new("there")
    plant(how)
    plant(how, scene=there, seed=2)
    if shown:  # the forest of the one in the other too
        there.collection.children.link(root(here))
    mine = told(here)
    uids = ids(ours(TREES, there).values())
    for seed in (3, 2, 4):
        plant(how, scene=there, seed=seed, count=14)
        plant(how, scene=there, seed=seed)
        assert told(here) == mine
    assert ids(ours(TREES, there).values()) == uids
    theirs = {name: facts[0] for name, facts in told(there).items()}
    plant(how, seed=2)
    assert {name: facts[0] for name, facts in told(there).items()} == theirs
    assert ids(ours(TREES, there).values()) == uids


@pytest.mark.slow
@pytest.mark.parametrize(("name", "how"), alternately(PARTS))
def test_a_linked_forest_within_ours_is_left_alone(empty_blender, how, name, tmp_path):
    path = str(tmp_path / "library.blend")
    plant(how, seed=3)
    bpy.ops.wm.save_as_mainfile(filepath=path)
    empty()
    plant(how)
    with bpy.data.libraries.load(path, link=True) as (source, target):
        target.collections = [n for n in source.collections if n in ("Forest", "apple-stochastic")]
    linked = list(target.collections)
    for one in linked:
        part(bpy.context.scene, name).children.link(one)
        bpy.context.scene.collection.children.link(one)
    before = {obj.session_uid for one in linked for obj in one.all_objects}
    for seed in (2, 1):
        plant(how, seed=seed)
        assert {obj.session_uid for one in linked for obj in one.all_objects} == before
        assert all(one in list(part(bpy.context.scene, name).children) for one in linked)
        assert root(bpy.context.scene).library is None
        things = part(bpy.context.scene, TREES).all_objects
        trees = {obj for obj in things if obj.library is None}
        assert len(trees) == (9 if how == "objects" else 1)


def dissolve(home):
    """What Blender's outliner does on *Delete*: what is inside goes up."""
    above = [
        c for c in (bpy.context.scene.collection, *bpy.data.collections) if home in list(c.children)
    ]
    for parent in above:
        for obj in home.objects:
            parent.objects.link(obj)
        for child in home.children:
            parent.children.link(child)
    bpy.data.collections.remove(home)


@pytest.mark.slow
@pytest.mark.parametrize(("lost", "how"), alternately(LOST))
def test_a_collection_that_was_deleted_comes_back_with_what_was_in_it(empty_blender, how, lost):
    plant(how, seed=2)
    fresh, count = told(), counts()
    empty()
    plant(how)
    uids = ids(bpy.data.objects)
    home = part(bpy.context.scene, lost) if lost else root(bpy.context.scene)
    dissolve(home)
    plant(how, seed=2)
    assert told() == fresh
    assert counts() == count
    now = ids(bpy.data.objects)
    assert all(now[name] == uid for name, uid in uids.items() if name in now)
    assert [home.name for home in bpy.context.scene.collection.children] == ["Forest"]
    assert not bpy.context.scene.collection.objects
    assert not root(bpy.context.scene).objects


@pytest.mark.slow
@pytest.mark.parametrize(("lost", "how"), alternately(LOST, 1))
def test_a_collection_that_was_deleted_with_its_objects_is_made_anew(empty_blender, how, lost):
    fresh = fresh_of(how, seed=2)
    plant(how)
    mine = bpy.data.materials.new("mine")
    home = part(bpy.context.scene, lost) if lost else root(bpy.context.scene)
    if lost == VARIANTS and how == "objects":
        first(VARIANTS).data.materials[0] = mine
    for inner in home.children_recursive:
        bpy.data.collections.remove(inner)
    bpy.data.batch_remove([t for t in bpy.data.objects if not t.users_collection])
    bpy.data.batch_remove(list(home.objects))
    bpy.data.collections.remove(home)
    plant(how, seed=2)
    if mine.users:  # trees still wore it
        assert first(VARIANTS).data.materials[0] == mine
        first(VARIANTS).data.materials[0] = bpy.data.materials["apple-stochastic bark"]
    shown = told()
    places = {name: facts[0] for name, facts in shown.items()}
    assert places == {name: facts[0] for name, facts in fresh.items()}
    assert {n: f[1] for n, f in shown.items()} == {n: f[1] for n, f in fresh.items()}


@pytest.mark.medium
def test_a_forest_of_an_older_version_is_replaced(empty_blender):
    """Its objects carry the name they were made under, but do not say what they stand for."""
    fresh = {name: facts[:2] for name, facts in fresh_of("objects", seed=2).items()}
    plant()
    for block in (*bpy.data.objects, *bpy.data.collections, *bpy.data.meshes, *bpy.data.materials):
        for key in set(block.keys()) - OLD_KEYS:
            del block[key]
    for block in (*bpy.data.meshes, *bpy.data.materials):
        block.pop(MADE_KEY, None)
    plant(seed=2)
    assert {name: facts[:2] for name, facts in told().items()} == fresh
    assert [home.name[:16] for home in part(bpy.context.scene, TREES).children] == [
        "apple-stochastic"
    ]


# --------------------------------------------------------------------------------------------- ready
# What is made ahead of a build is what the build would make, and nothing is made of what stands already.


def library(scene):
    """Shape, custom properties and picture of every variant, and the corners of its stand-in."""
    found = []
    for obj in part(scene, VARIANTS).objects:
        data, picture = obj.data, np.empty(4 * assets.PIXELS**2, np.float32)
        obj.preview.image_pixels_float.foreach_get(picture)
        said = {key: value for key, value in data.items() if key.endswith(("_m", "_m2", "_m3"))}
        found.append((data["forest_shape"], said, picture.tobytes()))
    corners = [[tuple(v.co) for v in t.data.vertices] for t in part(scene, OUTLINES).objects]
    return found, corners


@pytest.mark.slow
def test_a_build_of_what_was_made_ahead_is_the_same(empty_blender, monkeypatch):
    plain, other = bpy.context.scene, bpy.data.scenes.new("other")
    forest, heard = plant("points"), []
    made = room.make_ready(forest, (), True, lambda done, total: heard.append((done, total)))
    assert heard == [(number, len(forest.variants)) for number in range(len(forest.variants))]
    again = []  # fingerprints are taken of the ground alone
    monkeypatch.setattr(room, "stand_in", lambda *_: pytest.fail("made twice"))
    monkeypatch.setattr(room, "fingerprint", lambda mesh: again.append(mesh) or fingerprint(mesh))
    build(other, settings(1, 9, "points"), forest, ready=made)
    assert [set(mesh.part) for mesh in again] == [{GROUND}]
    assert library(other) == library(plain)
    monkeypatch.undo()
    anew = grown(4, 9, ("apple-stochastic",), None)
    assert not room.make_ready(anew, room.shapes_in(plain), False, lambda *_: None).stand_ins


@pytest.mark.slow
def test_measures_and_pictures_can_follow_once_the_forest_stands(empty_blender):
    """As a window does it: nothing of the forest before is told of the new one meanwhile."""
    later, at_once = bpy.context.scene, bpy.data.scenes.new("at once")
    forest, anew = plant("points"), plant("points", seed=4, scene=at_once)
    assert assets.untold(later, forest) == []
    build(later, settings(4, 9, "points"), anew, as_assets=False)
    wanted = assets.untold(later, anew)
    assert set(wanted) == set(anew.variants)
    assert not any("height_m" in obj.data for obj in ours(VARIANTS).values())
    assets.tell_variants(later, anew, room.tell_of(anew, wanted[:1]))  # cancelled half way
    assert assets.untold(later, anew) == wanted[1:]
    told_first, second = part(later, VARIANTS).objects[:2]
    second.asset_clear()
    assets.tell_variants(later, anew, room.tell_of(anew, wanted[1:]))
    assert assets.untold(later, anew) == []
    assert second.asset_data is None  # the user's choice
    second.asset_mark()
    _, sentence, picture = room.tell_of(anew, wanted)[wanted[1]]
    assets.mark_asset(second, sentence, ("tree", anew.labels[0]), picture)
    assert library(later) == library(at_once)
    assert told_first.data["height_m"] == pytest.approx(anew.variants[wanted[0]].height)
