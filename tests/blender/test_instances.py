"""Trees as points of one object: what the points say reaches the evaluated instances and the sensors."""

import subprocess
import sys

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.scenes import add_collection, add_mesh, link

from forest_addon import spec
from forest_addon.base.places import ASSETS
from forest_addon.blender.files.export import save_blend
from forest_addon.blender.read.depsgraph import SPECIES_KEY, read_scene
from forest_addon.blender.scene import nodes
from forest_addon.blender.scene.forest import build
from forest_addon.blender.scene.instances import points_mesh, read_points
from forest_addon.blender.scene.layout import TREES, VARIANTS, part
from forest_addon.blender.sensors.observe import Observer
from forest_addon.growth.library import load_species
from forest_addon.stand.forest import grow_forest

SIZES = (1.0, 2.0, 3.0)  # heights of three variants, which tell them apart
COUNT = 200


def library(name):
    home = add_collection(name)
    home.hide_viewport = True
    for number, size in enumerate(SIZES):
        corners = [(0, 0, 0), (1, 0, 0), (0, 1, size)]
        obj = add_mesh(f"{name} {number:03d}", corners, (0, 1, 2), home=home)
        obj.location = (50, 50, 50)  # where a variant itself is does not matter
    return home


def columns(count=COUNT):
    rng = np.random.default_rng(5)
    return {
        "position": rng.uniform(-90, 90, (count, 3)),
        "rotation": rng.uniform(-7, 7, count),
        "scale": rng.uniform(0.2, 3, count),
        "variant": rng.integers(0, len(SIZES), count),
        "tree": rng.permutation(count) + 1000,
        "species": rng.integers(0, 7, count),
    }


def plant(light=False, **changes):
    data = points_mesh("Trees", len(SIZES), **(columns() | changes))
    obj = link("Trees", data)
    nodes.give_instancer(obj, library("full"), library("rough"), light)
    return obj


def placed(obj):
    return read_points(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()))


def test_every_attribute_comes_back_from_the_evaluated_instances(empty_blender):
    obj, told = plant(), columns()
    found = placed(obj)
    assert (found.tree == told["tree"]).all()
    assert (found.species == told["species"]).all()
    heights = np.array([source.data.vertices[2].co.z for source in found.source])
    assert (heights[found.index] == np.array(SIZES)[told["variant"]]).all()
    cos, sin = np.cos(told["rotation"]), np.sin(told["rotation"])
    flat = np.zeros(COUNT)
    turn = np.array([[cos, -sin, flat], [sin, cos, flat], [flat, flat, flat + 1]])
    expected = turn.transpose(2, 0, 1) * told["scale"][:, None, None]
    assert np.abs(found.transform[:, :, :3] - expected).max() < 3e-6
    assert np.abs(found.transform[:, :, 3] - told["position"]).max() < 1e-5


def test_a_moved_object_takes_its_trees_along(empty_blender):
    obj = plant()
    obj.location = (0, 0, 100)
    bpy.context.view_layer.update()
    assert np.allclose(placed(obj).transform[:, 2, 3], columns()["position"][:, 2] + 100)


def test_points_deleted_by_hand_are_trees_gone(empty_blender):
    obj, told = plant(), columns()
    bpy.context.view_layer.objects.active = obj
    for vertex in obj.data.vertices:
        vertex.select = vertex.index % 2 == 0
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.delete(type="VERT")
    bpy.ops.object.mode_set(mode="OBJECT")
    assert (placed(obj).tree == told["tree"][1::2]).all()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"scale": np.where(np.arange(COUNT) == 3, -1.0, 1.0)}, r"size factor -1\.0.*above 0"),
        ({"scale": np.where(np.arange(COUNT) == 3, 0.0, 1.0)}, r"size factor 0\.0.*above 0"),
        ({"scale": np.full(COUNT, np.nan)}, "size factor nan"),
        ({"variant": np.full(COUNT, 3)}, "variant 3.*0 to 2"),
        ({"variant": np.full(COUNT, -1)}, "variant -1"),
        ({"position": np.full((COUNT, 3), np.inf)}, "stands at.*finite"),
    ],
)
def test_a_tree_that_cannot_stand_is_refused(empty_blender, changes, words):
    with pytest.raises(ValueError, match=words):
        plant(**changes)
    assert not bpy.data.node_groups


def test_the_node_group_is_made_once_and_kept_as_edited(empty_blender):
    obj = plant()
    group = nodes.instancer_group()
    assert obj.modifiers[0].node_group == group
    add = group.nodes.new("GeometryNodeTranslateInstances")
    add.inputs["Translation"].default_value = (0, 0, 7)
    add.inputs["Local Space"].default_value = False
    (last,) = (link for link in group.links if link.to_node.type == "GROUP_OUTPUT")
    group.links.new(last.from_socket, add.inputs[0])
    group.links.new(add.outputs[0], last.to_socket)
    again = plant()
    assert again.modifiers[0].node_group == group
    assert len(bpy.data.node_groups) == 1
    higher = placed(again).transform[:, 2, 3] - columns()["position"][:, 2]
    assert np.abs(higher - 7).max() < 1e-4  # the edit counts for the new object too


def test_every_node_is_labelled_and_none_covers_another(empty_blender):
    group = nodes.instancer_group()
    shown = [node for node in group.nodes if node.type not in ("GROUP_INPUT", "GROUP_OUTPUT")]
    assert all(node.label for node in shown)
    places = [tuple(node.location) for node in group.nodes if node.type != "FRAME"]
    assert len(set(places)) == len(places)


def test_a_user_finds_named_inputs(empty_blender):
    (modifier,) = plant().modifiers
    assert (modifier.name, modifier.node_group.name) == (nodes.INSTANCER, "Forest Sensing Forest")
    sockets = [i for i in modifier.node_group.interface.items_tree if i.in_out == "INPUT"]
    assert [socket.name for socket in sockets] == [
        *("Points", "Variants", "Outlines", "Scale", "Rotation", "Light View", "Whole Within"),
        *("Dots", "Show Share"),
    ]
    assert all(socket.description for socket in sockets)


def test_size_and_turn_of_all_are_seen_by_sensors_too(empty_blender):
    obj, told = plant(), columns()
    (modifier,) = obj.modifiers
    nodes.set_input(modifier, nodes.ALL_SCALE, 1.5)
    nodes.set_input(modifier, nodes.ALL_ROTATION, 0.25)
    other = plant(scale=1.5 * told["scale"], rotation=told["rotation"] + 0.25)
    found, expected = placed(obj).transform, placed(other).transform
    assert np.abs(found - expected).max() < 1e-5
    scene = read_scene(bpy.context.evaluated_depsgraph_get())
    assert len(scene.transform) == 2 * COUNT


@pytest.mark.parametrize("within", [0.0, 90.0, 1e4])
def test_stand_ins_are_whole_near_the_camera_and_sensors_see_all_whole(empty_blender, within):
    obj = plant()
    nodes.set_input(obj.modifiers[0], nodes.LIGHT, True)
    nodes.set_input(obj.modifiers[0], nodes.NEAR, within)
    before = placed(obj)
    assert {source.name[:5] for source in before.source} == {"rough"}  # there is no camera
    camera = link("eye", bpy.data.cameras.new("eye"))
    bpy.context.scene.camera, camera.location = camera, (1.0, 2.0, 3.0)
    obj.update_tag()
    found = placed(obj)
    away = np.linalg.norm(found.transform[:, :, 3] - np.array(camera.location), axis=1)
    whole = np.array([found.source[k].name.startswith("full") for k in found.index])
    assert (whole == (away <= within)).all()
    assert 0 < whole.sum() < len(whole) or within != 90
    with nodes.in_full(bpy.context.evaluated_depsgraph_get()):
        assert {source.name[:4] for source in placed(obj).source} == {"full"}
    with pytest.raises(ZeroDivisionError), nodes.in_full(bpy.context.evaluated_depsgraph_get()):
        raise ZeroDivisionError
    assert nodes.is_light(obj.modifiers[0])


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_views_show_a_share_of_the_trees_and_sensors_see_all(empty_blender, share):
    obj = plant()
    (modifier,) = obj.modifiers
    every = placed(obj)
    nodes.set_input(modifier, nodes.SHARE, share)
    some = placed(obj)
    # 200 draws: outside of 4.5 standard deviations once in 100,000 seeds, and the seed is fixed
    off = 4.5 * np.sqrt(COUNT * share * (1 - share))
    assert abs(len(some) - share * COUNT) <= off
    assert set(some.tree) <= set(every.tree)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    with nodes.in_full(depsgraph):
        inside = read_points(obj.evaluated_get(depsgraph))
    assert inside.transform.tobytes() == every.transform.tobytes()
    assert (inside.tree == every.tree).all()
    assert (placed(obj).tree == some.tree).all()  # as it was, and the same ones
    assert len(Observer(depsgraph).geometry.transform) == COUNT


# ------------------------------------------------------------------------------- whole forests


def scene_of(instancing, **changes):
    return spec.Scene(
        seed=11,
        forest=spec.Forest(size=(9.0, 9.0), margin=5.0, instancing=instancing),
        plantings=(
            spec.Planting(species="hazelnut", variants=2, expected=5, exact=True),
            spec.Planting(species="apple", variants=2, expected=3, exact=True),
        ),
        sensors=(spec.Terrestrial(position=(4.0, 4.0, 1.2), angle_step_deg=2.0),),
        **changes,
    )


@pytest.fixture(scope="module")
def grown():
    kinds = [load_species(ASSETS / "species" / f"{n}.toml") for n in ("hazelnut", "apple")]
    return grow_forest(scene_of("points"), kinds)


def scanned(instancing, forest):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    settings = scene_of(instancing)
    build(bpy.context.scene, settings, forest)
    observer = Observer(bpy.context.evaluated_depsgraph_get())
    return observer.observe(settings.sensors[0], settings)


@pytest.mark.slow
def test_lidar_labels_are_the_same_for_points_and_for_objects(empty_blender, grown, monkeypatch):
    monkeypatch.setattr("forest_addon.blender.scene.forest.SHOWN_IN_FULL", 10)  # a light view
    points, objects = scanned("points", grown), scanned("objects", grown)
    # A point's transform is computed in float32 from angle and size, an object's from its matrix: a
    # beam that grazes an edge may pass on the other side of it.
    assert len(points.position) == pytest.approx(len(objects.position), rel=2e-3)
    assert set(points.returns.tree[points.returns.tree >= 0]) == set(grown.stand.id)
    for found in (points, objects):
        trees = found.returns.tree >= 0
        planted = grown.stand.species[found.returns.tree[trees]]
        assert (found.returns.species[trees] == planted).all()
    if len(points.position) == len(objects.position):
        same = points.returns.tree == objects.returns.tree
        assert same.mean() > 0.998
        for label in ("species", "organ", "leaf"):
            a, b = getattr(points.returns, label), getattr(objects.returns, label)
            assert (a == b)[same].mean() > 0.998, label


@pytest.mark.medium
def test_the_planned_variant_stands_at_every_place(empty_blender, grown):
    build(bpy.context.scene, scene_of("points"), grown)
    (obj,) = part(bpy.context.scene, TREES).all_objects
    found = placed(obj)
    stand = grown.stand
    for row, tree in enumerate(found.tree):
        planned = f"{grown.labels[stand.species[tree]]}.{stand.variant[tree]:03d}"
        assert found.source[found.index[row]].data.name == planned
    assert np.abs(found.transform - grown.transforms()[found.tree]).max() < 1e-6


@pytest.mark.medium
def test_variants_are_hidden_assets_with_a_picture(empty_blender, grown):
    build(bpy.context.scene, scene_of("points"), grown)
    variants = part(bpy.context.scene, VARIANTS)
    assert variants.hide_viewport
    assert variants.hide_render
    assert [obj.name for obj in variants.objects] == sorted(t.name for t in variants.objects)
    for obj in variants.objects:
        label = obj.data.name.split(".")[0]
        assert {"tree", label} <= {tag.name for tag in obj.asset_data.tags}
        assert f"{label}, " in obj.asset_data.description
        picture = np.array(obj.preview.image_pixels_float).reshape(-1, 4)
        assert 0.05 < picture[:, 3].mean() < 0.9
        green = picture[picture[:, 3] > 0, :3].mean(axis=0)
        assert green[1] > green[2]


def test_nobody_draws_variants_of_a_scene_that_is_not_kept(empty_blender, grown, monkeypatch):
    monkeypatch.setattr("forest_addon.blender.scene.assets.draw", None)
    build(bpy.context.scene, scene_of("points"), grown, as_assets=False)
    variants = part(bpy.context.scene, VARIANTS).objects
    assert len(variants) == len(grown.variants)
    assert not any(obj.asset_data for obj in variants)


@pytest.mark.medium
def test_a_variant_dragged_in_is_seen_with_its_species_and_stays(empty_blender, grown):
    build(bpy.context.scene, scene_of("points"), grown)
    source = part(bpy.context.scene, VARIANTS).objects[2]
    dragged = source.copy()  # what Blender does when an asset of the same file is dragged in
    dragged.location = (40, 0, 0)
    part(bpy.context.scene, TREES).objects.link(dragged)
    bpy.context.view_layer.update()
    scene = read_scene(bpy.context.evaluated_depsgraph_get())
    (at,) = np.flatnonzero(scene.object_index == scene.object_name.index(dragged.name))
    assert (scene.tree[at], scene.species[at]) == (-1, source[SPECIES_KEY])
    build(bpy.context.scene, scene_of("points"), grown)
    assert dragged.name in part(bpy.context.scene, TREES).objects


@pytest.mark.slow
def test_the_blend_file_opens_without_the_extension(empty_blender, grown, tmp_path):
    build(bpy.context.scene, scene_of("points"), grown)
    save_blend(tmp_path / "forest.blend")
    code = (
        "import bpy, sys; bpy.ops.wm.open_mainfile(filepath=sys.argv[1]); "
        "d = bpy.context.evaluated_depsgraph_get(); "
        "print('FOUND', sum(i.is_instance for i in d.object_instances), "
        "sum(bool(o.asset_data) for o in bpy.data.objects), 'forest_addon' in sys.modules)"
    )
    words = [sys.executable, "-c", code, str(tmp_path / "forest.blend")]
    told = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path)
    assert f"FOUND {len(grown.stand)} {len(grown.variants)} False" in told.stdout, told.stderr
