"""Trees as points of one object: what the points say reaches the evaluated instances and the sensors."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from mathutils import Euler, Matrix
from references.scenes import add_collection, add_mesh, link

from forest_addon import api, spec
from forest_addon.base.places import ASSETS
from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, WOOD
from forest_addon.blender.files.export import save_blend
from forest_addon.blender.read.depsgraph import SPECIES_KEY, read_scene
from forest_addon.blender.scene import nodes
from forest_addon.blender.scene.assets import FILE, add_catalogs, catalog_id
from forest_addon.blender.scene.forest import build
from forest_addon.blender.scene.instances import points_mesh, read_points
from forest_addon.blender.scene.layout import TREES, VARIANTS, part
from forest_addon.blender.scene.meshes import to_mesh, write_truth
from forest_addon.blender.sensors.observe import Observer
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.mesh.leaves import measure_leaves
from forest_addon.growth.tree import grow
from forest_addon.growth.truth import tree_truth
from forest_addon.stand.forest import NONE, grow_forest, placed_leaves, placed_table
from headless.cli import main

SIZES = (1.0, 2.0, 3.0)  # heights of three variants, which tell them apart
COUNT = 200


def variants_home(name):
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
    nodes.give_instancer(obj, variants_home("full"), variants_home("rough"), light)
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


# ------------------------------------------------------------------------------------------ library
# Trees from an asset library, in a file that knows nothing of us: sensors and tables know what they are.

SPECIES = "fern", "hazelnut"
POSE = Matrix.LocRotScale((3.0, -2.0, 0.4), Euler((0.2, -0.1, 1.1)), (1.3, 1.3, 1.3))
BENT = Matrix.LocRotScale((-3.0, 1.0, 0.0), Euler((0.0, 0.0, 0.3)), (1.0, 0.8, 1.4))
TRIPOD = api.Terrestrial(position=(0.0, 0.0, 1.0), angle_step_deg=2.0, elevation_deg=(-45.0, 45.0))
BAT = api.Sonar(position=(0.0, 0.0, 1.0), beam="omni", max_range=8.0, cull=0.0)


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    """A library as the command makes it."""
    out = tmp_path_factory.mktemp("library")
    assert main(["assets", *SPECIES, "--variants", "2", "--out", str(out)]) == 0
    return out


def tree_of(name, variant):
    species, template = load_species(find_species(name, Path()))
    return grow(species, template, stream(1, "library", name, variant))


def bring(file, kind, name, link):
    """Append or link from a file, as the File menu does."""
    with bpy.data.libraries.load(str(file), link=link) as (there, here):
        assert name in getattr(there, kind)
        setattr(here, kind, [name])
    return getattr(here, kind)[0]


def stand(block, matrix):
    """Put what was brought into the scene, moved, turned and scaled."""
    if isinstance(block, bpy.types.Collection):
        obj = bpy.data.objects.new("drop", None)
        obj.instance_type, obj.instance_collection = "COLLECTION", block
    elif block.library is None:
        obj = block
    else:  # a linked object is moved by an object of this file that wears its mesh
        obj = bpy.data.objects.new("drop", block.data)
    bpy.context.scene.collection.objects.link(obj)
    obj.matrix_world = matrix
    bpy.context.view_layer.update()
    return obj


def direct(tree, matrix, number):
    """The same tree, built by us."""
    obj = link("ours", to_mesh("ours", tree.mesh))
    obj["forest_tree"], obj["forest_species"] = number, 0
    obj.matrix_world = matrix
    bpy.context.view_layer.update()


@pytest.fixture(scope="module")
def built_here(blender):
    """A tree, and what is seen and heard of it where we built it."""
    blender.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    tree = tree_of("hazelnut", 1)
    direct(tree, POSE, 0)
    ours = api.current()
    return tree, ours.scan(TRIPOD), ours.ping(BAT).pings[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "link"), [("objects", False), ("objects", True), ("collections", True)]
)
def test_a_tree_of_a_library_is_seen_as_the_tree_that_it_is(
    built_here, empty_blender, library, kind, link
):
    tree, cloud, echo = built_here
    assert len(cloud) > 100
    block = bring(library / "hazelnut.blend", kind, "Hazelnut 2", link)
    assert (block.library is not None) == link
    stand(block, POSE)
    theirs = api.current()
    found = theirs.scan(TRIPOD)
    # An instance's place is composed in float32: rays past edges may differ.
    assert abs(len(found) - len(cloud)) <= 0.01 * len(cloud)
    if len(found) == len(cloud):
        assert np.abs(found.points - cloud.points).max() < 1.0
        assert np.median(np.abs(found.points - cloud.points)) < 1e-6
        same = {
            name: np.mean(found.labels[name] == values) for name, values in cloud.labels.items()
        }
        assert min(same.values()) > 0.99, same
    organs = set(np.unique(found.labels["organ"]).tolist())
    assert organs == {WOOD, LEAF}
    assert set(np.unique(found.labels["tree"]).tolist()) == {0}
    assert set(np.unique(found.labels["species"]).tolist()) == {0}
    heard = theirs.ping(BAT).pings[0]
    assert heard.leaves == echo.leaves == len(tree.leaves)
    loud = np.abs(echo.spectra).max()
    assert np.abs(heard.spectra - echo.spectra).max() < 0.02 * loud

    leaves = theirs.leaves
    m = np.array(POSE)[:3]
    place = tree.leaves.centre @ m[:, :3].T + m[:, 3]
    assert np.abs(leaves["centre"] - place).max() < 5e-6
    assert np.abs(leaves["radius"] / tree.leaves.radius - 1.3).max() < 1e-5
    facing = np.einsum("li,li->l", leaves["normal"], tree.leaves.normal @ m[:, :3].T / 1.3)
    assert facing.min() > 1 - 1e-5
    assert np.array_equal(leaves["branch"], tree.leaves.branch)
    table, truth = theirs.trees, tree_truth(tree)
    assert table["species"].tolist() == ["hazelnut"]
    assert table["leaf_area_m2"][0] == pytest.approx(1.69 * truth["leaf_area_m2"], rel=1e-5)
    assert table["height_m"][0] == pytest.approx(1.3 * truth["height_m"], rel=1e-5)
    assert table["wood_volume_m3"][0] == pytest.approx(1.3**3 * truth["wood_volume_m3"], rel=1e-5)
    wood = theirs.skeleton(0)
    assert np.abs(wood["start"] - (tree.skeleton.start @ m[:, :3].T + m[:, 3])).max() < 5e-6
    assert np.abs(wood["radius"] - 1.3 * tree.skeleton.radius).max() < 1e-7
    assert np.array_equal(wood["parent"], tree.skeleton.parent)
    cylinders = theirs.cylinders
    assert len(cylinders["length"]) == len(tree.skeleton)
    assert cylinders["length"].sum() == pytest.approx(
        1.3 * np.linalg.norm(tree.skeleton.end - tree.skeleton.start, axis=1).sum(), rel=1e-5
    )


def test_each_has_a_number_and_what_a_user_numbers_stays(empty_blender, library):
    fern = bring(library / "fern.blend", "collections", "Fern 1", True)
    hazel = bring(library / "hazelnut.blend", "collections", "Hazelnut 1", True)
    for k in range(3):
        stand(fern, Matrix.Translation((k, 0, 0))).name = f"b {k}"
    first = stand(hazel, Matrix.Translation((9, 0, 0)))
    first.name = "a"
    chosen = stand(hazel, Matrix.Translation((12, 0, 0)))
    chosen["forest_tree"], chosen["forest_species"] = 40, 7
    chosen.update_tag()
    bpy.context.view_layer.update()
    table = api.current().trees
    assert table["tree"].tolist() == [40, 41, 42, 43, 44]
    assert table["x_m"].tolist() == pytest.approx([12, 9, 0, 1, 2])
    assert table["species"].tolist() == ["hazelnut"] * 2 + ["fern"] * 3
    scene = api.current().observer.geometry
    assert dict(zip(scene.tree.tolist(), scene.species.tolist(), strict=True)) == {
        40: 7,
        41: 9,
        **dict.fromkeys((42, 43, 44), 8),
    }
    assert len(scene.meshes) == 2


@pytest.mark.medium
def test_what_the_asset_browser_shows(empty_blender, library):
    listed = (library / FILE).read_text().splitlines()
    with bpy.data.libraries.load(str(library / "hazelnut.blend"), assets_only=True) as (
        there,
        here,
    ):
        here.collections = list(there.collections)
    assert sorted(there.collections) == ["Hazelnut 1", "Hazelnut 2"]
    for home in here.collections:
        about = home.asset_data
        assert f"{about.catalog_id}:Forest Sensing/Shrubs:Forest Sensing-Shrubs" in listed
        assert {"tree", "hazelnut", "shrubs"} == {tag.name for tag in about.tags}
        assert "leaves" in about.description
        assert about.author
        assert tuple(home.preview.image_size) == (256, 256)
        picture = np.array(home.preview.image_pixels_float).reshape(256, 256, 4)
        assert 0.1 < (picture[..., 3] > 0).mean() < 0.8
        rows = np.flatnonzero((picture[..., 3] > 0).any(axis=1))
        assert rows[0] < 16
        assert rows[-1] > 240
        green = picture[picture[..., 3] > 0.5, :3].mean(axis=0)
        assert green[1] > green[2]


def test_catalogs_of_others_stay(tmp_path):
    file = add_catalogs(tmp_path, ["Forest Sensing/Conifers"])
    mine = "11111111-2222-3333-4444-555555555555:Rocks:Rocks"
    file.write_text(file.read_text() + mine + "\n")
    add_catalogs(tmp_path, ["Forest Sensing/Conifers", "Forest Sensing/Shrubs"])
    lines = file.read_text().splitlines()
    assert mine in lines
    assert "VERSION 1" in lines
    assert len([line for line in lines if catalog_id("Forest Sensing/Conifers") in line]) == 1
    assert len([line for line in lines if line.endswith("Sensing-Shrubs")]) == 1


def test_leaves_of_a_stretched_tree_are_those_of_its_triangles(empty_blender):
    """Flat leaves, against measuring the mesh where it stands, also mirrored and sheared."""
    species, _ = load_species(find_species("bilberry", Path()))
    flat = species.changed(leaf=species.leaf.changed(shape="ellipse"))
    tree = grow(flat, None, stream(1, "flat"))
    mesh = to_mesh("bilberry", tree.mesh)
    write_truth(mesh, "bilberry#1", "bilberry", tree)
    shear = Matrix(((1, 0.4, 0, 0), (0, 1, 0, 0), (0, 0.2, -1.5, 0), (0, 0, 0, 1)))
    for matrix in (BENT, shear):
        obj = link("bilberry", mesh)
        obj.matrix_world = matrix
        bpy.context.view_layer.update()
        placed = api.current().observer.placed_trees
        leaves, table = placed_leaves(placed), placed_table(placed)
        world = tree.mesh.vertices @ np.array(obj.matrix_world)[:3, :3].T
        world += np.array(obj.matrix_world)[:3, 3]
        truth = measure_leaves(replace(tree.mesh, vertices=world))
        assert np.abs(leaves["centre"] - truth.centre).max() < 1e-5
        assert np.abs(leaves["radius"] / truth.radius - 1).max() < 1e-3
        facing = np.abs(np.einsum("li,li->l", leaves["normal"], truth.normal))
        assert facing.min() > 1 - 1e-4
        assert table["leaf_area_m2"][0] == pytest.approx(np.pi * (truth.radius**2).sum(), rel=1e-4)
        bpy.data.objects.remove(obj)


def test_a_file_without_such_trees_has_none(empty_blender):
    assert len(api.current().observer.placed_trees) == len(NONE) == 0
    with pytest.raises(api.SpecError, match="was not grown here"):
        _ = api.current().trees
