"""The forest as .glb: as it was planned, valid, and small where trees are points."""

import ast
import json
import re
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from references import gltf
from references.model_tree import tree

bpy = pytest.importorskip("bpy")

from mathutils import Matrix, Vector
from references.scenes import add_collection, link

from forest_addon import spec
from forest_addon.base.places import ASSETS
from forest_addon.blender.files.export import (
    AS_WRITTEN,
    empty_file,
    export_glb,
    export_usd,
    open_file,
    read_groups,
)
from forest_addon.blender.scene import nodes
from forest_addon.blender.scene.forest import build
from forest_addon.blender.scene.layout import TREES, VARIANTS, part
from forest_addon.formats.glb import EXTENSION, read_glb
from forest_addon.growth.library import load_species
from forest_addon.growth.own_tree.pieces import likely_up, sort_out, stood
from forest_addon.growth.own_tree.recognise import recognise
from forest_addon.spec import SpecError
from forest_addon.stand.forest import grow_forest

MESHES = 4  # variants of two species


def settings(instancing, count, margin):
    return spec.Scene(
        seed=7,
        forest=spec.Forest(size=(60.0, 60.0), margin=margin, instancing=instancing),
        plantings=(
            spec.Planting(species="abop-monopodial-a", variants=2, expected=count, exact=True),
            spec.Planting(species="abop-sympodial-a", variants=2, expected=count, exact=True),
        ),
    )


def planted(instancing, count=15, species=None, margin=4.0):
    scene = settings(instancing, count, margin)
    if species:
        only = spec.Planting(species=species, variants=1, expected=count, exact=True)
        scene = scene.changed(plantings=(only,))
    kinds = [load_species(ASSETS / "species" / f"{p.species}.toml") for p in scene.plantings]
    forest = grow_forest(scene, kinds)
    build(bpy.context.scene, scene, forest)
    return forest


def in_order(transforms):
    return transforms[np.lexsort(transforms[:, :2, 3].round(3).T)]


@pytest.mark.slow
@pytest.mark.parametrize("instancing", ["points", "objects"])
def test_blender_reads_back_every_tree_where_it_stood(empty_blender, instancing, tmp_path):
    forest = planted(instancing)
    export_glb(bpy.context.scene, tmp_path / "forest.glb")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "forest.glb"))
    found = np.array(
        [
            obj.matrix_world
            for obj in bpy.context.scene.objects
            if obj.type == "MESH" and obj.data.name.split(".")[0] in forest.labels
        ]
    )
    assert len(found) == len(forest.stand)
    assert np.abs(in_order(found[:, :3]) - in_order(forest.transforms())).max() < 2e-5


@pytest.mark.medium
def test_points_are_one_node_a_variant_with_their_numbers(empty_blender, tmp_path):
    forest = planted("points")
    export_glb(bpy.context.scene, tmp_path / "forest.glb")
    document, binary = read_glb(tmp_path / "forest.glb")
    shared = [node for node in document["nodes"] if EXTENSION in node.get("extensions", {})]
    assert len(shared) == len(document["meshes"]) - 1 == MESHES
    assert len(document["nodes"]) == MESHES + 1
    seen = {}
    for node in shared:
        assert document["meshes"][node["mesh"]]["name"] == node["name"]
        indices = node["extensions"][EXTENSION]["attributes"]
        tree, species = (numbers(document, binary, indices[key]) for key in ("_TREE", "_SPECIES"))
        assert {forest.labels[s] for s in species} == {node["name"].split(".")[0]}
        variant = int(node["name"].split(".")[1])
        assert (forest.stand.variant[tree] == variant).all()
        seen |= dict.fromkeys(tree.tolist(), node["name"])
    assert seen.keys() == set(forest.stand.id.tolist())


def numbers(document, binary, index):
    accessor = document["accessors"][index]
    view = document["bufferViews"][accessor["bufferView"]]
    return np.frombuffer(binary, "<f4", accessor["count"], view["byteOffset"]).astype(int)


@pytest.mark.slow
def test_ten_thousand_trees_add_fifty_bytes_each(empty_blender, tmp_path):
    planted("points", 10)
    export_glb(bpy.context.scene, tmp_path / "few.glb")
    forest = planted("points", 5000)
    export_glb(bpy.context.scene, tmp_path / "many.glb")
    few, many = ((tmp_path / f"{name}.glb").stat().st_size for name in ("few", "many"))
    assert many - few < 50 * len(forest.stand)
    issues = gltf.validate(tmp_path / "many.glb")
    if issues is not None:
        assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"][:5]


@pytest.mark.medium
def test_the_scene_is_as_before(empty_blender, tmp_path):
    planted("points")
    hidden = add_collection("away")
    hidden.objects.link(bpy.data.objects.new("lamp", None))
    bpy.context.view_layer.layer_collection.children["away"].exclude = True
    (trees,) = part(bpy.context.scene, TREES).objects
    trees.select_set(True)
    before = set(bpy.data.objects), len(bpy.data.meshes)
    export_glb(bpy.context.scene, tmp_path / "forest.glb")
    assert (set(bpy.data.objects), len(bpy.data.meshes)) == before
    assert list(bpy.context.selected_objects) == [trees]


@pytest.mark.slow
def test_a_light_view_exports_whole_trees(empty_blender, tmp_path, monkeypatch):
    planted("points")
    export_glb(bpy.context.scene, tmp_path / "full.glb")
    monkeypatch.setattr("forest_addon.blender.scene.forest.SHOWN_IN_FULL", 1)
    planted("points")
    (trees,) = part(bpy.context.scene, TREES).objects
    assert nodes.is_light(trees.modifiers[0])
    export_glb(bpy.context.scene, tmp_path / "light.glb")
    full, light = (read_glb(tmp_path / f"{n}.glb")[0] for n in ("full", "light"))
    assert json.dumps(full["nodes"], sort_keys=True) == json.dumps(light["nodes"], sort_keys=True)
    assert full["accessors"] == light["accessors"]


@pytest.mark.medium
def test_nodes_that_pick_collections_are_refused_in_words(empty_blender, tmp_path):
    planted("points")
    variants = part(bpy.context.scene, VARIANTS)
    grove = add_collection("0 grove", variants)
    grove.objects.link(variants.objects[0])
    with pytest.raises(ValueError, match="pick mesh objects"):
        export_glb(bpy.context.scene, tmp_path / "forest.glb")
    assert not list(tmp_path.iterdir())
    assert not list(bpy.context.scene.collection.objects)


@pytest.mark.slow
@pytest.mark.parametrize("instancing", ["points", "objects"])
def test_a_viewer_that_frames_all_shows_the_forest(empty_blender, instancing, tmp_path):
    forest = planted(instancing, 6, margin=1000.0)  # a kilometre of ground around it
    before = len(bpy.data.meshes), set(bpy.data.objects)
    export_glb(bpy.context.scene, tmp_path / "forest.glb")
    assert (len(bpy.data.meshes), set(bpy.data.objects)) == before
    document, _ = read_glb(tmp_path / "forest.glb")
    (ground,) = (m for m in document["meshes"] if m["name"].startswith("Ground"))
    box = document["accessors"][ground["primitives"][0]["attributes"]["POSITION"]]
    x, y = (np.array([box[end][k] for end in ("min", "max")]) for k in (0, 2))
    trees = forest.stand.position
    for edges, place in ((x, trees[:, 0]), (np.sort(-y), trees[:, 1])):
        assert place.min() - 30 < edges[0] < place.min() - 4
        assert place.max() + 4 < edges[1] < place.max() + 30


READ_USD = """
import sys
from pxr import Usd, UsdGeom
stage = Usd.Stage.Open(sys.argv[1])
box = UsdGeom.BBoxCache(0, ["default", "render"]).ComputeWorldBound(stage.GetPseudoRoot())
whole = box.ComputeAlignedRange()
count = sum(
    len(UsdGeom.PointInstancer(p).GetProtoIndicesAttr().Get()) for p in stage.Traverse()
    if p.IsA(UsdGeom.PointInstancer)
) or sum("abop" in p.GetName() for p in stage.GetPrimAtPath("/root").GetChildren())
print(UsdGeom.GetStageUpAxis(stage), UsdGeom.GetStageMetersPerUnit(stage), count)
print(*whole.GetMin(), *whole.GetMax())
"""


@pytest.mark.slow
@pytest.mark.parametrize("instancing", ["points", "objects"])
def test_another_reader_finds_every_tree_of_a_usd_file(empty_blender, instancing, tmp_path):
    pytest.importorskip("pxr", reason="usd-core reads USD files back")
    forest = planted(instancing, 6, margin=1000.0)  # a kilometre of ground around it
    export_usd(bpy.context.scene, tmp_path / "forest.usdc")
    words = [sys.executable, "-c", READ_USD, str(tmp_path / "forest.usdc")]  # beside Blender's own
    told = subprocess.run(words, capture_output=True, text=True, check=True).stdout.split()
    assert told[:3] == ["Z", "1.0", str(len(forest.stand))]
    low, high = np.array(told[3:], float).reshape(2, 3)
    top = (forest.stand.position[:, 2] + forest.heights()).max()
    assert abs(high[2] - top) < 0.3
    assert (high - low)[:2].max() < 130


@pytest.mark.parametrize("instancing", ["points", "objects"])
def test_other_programs_see_bark_leaves_and_ground_in_colour(empty_blender, instancing, tmp_path):
    """Viewers of glTF and USD do not know Blender's nodes: without a plain colour all is white."""
    planted(instancing, 2, "whorl-8")
    export_glb(bpy.context.scene, tmp_path / "forest.glb")
    export_usd(bpy.context.scene, tmp_path / "forest.usda")
    document, _ = read_glb(tmp_path / "forest.glb")
    seen = {m["name"]: m["pbrMetallicRoughness"]["baseColorFactor"] for m in document["materials"]}
    assert len({tuple(colour) for colour in seen.values()}) == len(seen) == 3
    leaf = next(colour for name, colour in seen.items() if "leaf" in name)
    assert leaf[1] > max(leaf[0], leaf[2])
    text = (tmp_path / "forest.usda").read_text()
    assert "diffuseColor = (0.8, 0.8, 0.8)" not in text
    assert text.count("diffuseColor = (") == len(seen)


# ---------------------------------------------------------------------------------------- tree files
# Trees in PLY, OBJ and glTF files are read, and the user's file stays as it was.


def state() -> dict[str, list[str]]:
    kinds = [p.identifier for p in bpy.data.bl_rna.properties if p.type == "COLLECTION"]
    return {kind: sorted(data.name for data in getattr(bpy.data, kind)) for kind in kinds}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A tree whose two objects have materials, written by Blender's exporters."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    model = tree()
    for name, material, facets in (
        ("Tree", "bark", model.wood()),
        ("Crown", "leaf", model.leaves()),
    ):
        mesh = bpy.data.meshes.new(name)
        corners = np.arange(3 * len(facets)).reshape(-1, 3)
        mesh.from_pydata(facets.reshape(-1, 3).tolist(), [], corners.tolist())
        mesh.materials.append(bpy.data.materials.new(material))
        obj = link(name, mesh)
        obj.location.x = 2.0
    bpy.context.view_layer.update()
    for name in ("tree.obj", "tree.ply", "tree.glb"):
        write(tmp_path / name)
    write(tmp_path / "tree.gltf", export_format="GLTF_SEPARATE")
    write(tmp_path / "tree.draco.glb", export_draco_mesh_compression_enable=True)
    return tmp_path


def write(file: Path, **how) -> None:
    """Have Blender write its scene in the format of a file."""
    if file.suffix == ".blend":
        bpy.ops.wm.save_as_mainfile(filepath=str(file))
    elif file.suffix in (".glb", ".gltf"):
        bpy.ops.export_scene.gltf(filepath=str(file), **how)
    else:
        getattr(bpy.ops.wm, f"{file.suffix[1:4]}_export")(filepath=str(file), **how)


@pytest.mark.medium
@pytest.mark.parametrize(
    ("ending", "up", "told"),
    [
        ("obj", "y", "by name"),
        ("ply", "z", "by shape"),
        ("glb", "y", "by name"),
        ("gltf", "y", "by name"),
        ("draco.glb", "y", "by name"),
    ],
)
def test_a_tree_is_read_and_nothing_of_it_stays(
    folder: Path, ending: str, up: str, told: str
) -> None:
    packed = b"KHR_draco_mesh_compression" in (folder / f"tree.{ending}").read_bytes()
    if ending == "draco.glb" and not packed:
        pytest.skip("this Blender cannot compress")
    bpy.context.scene.collection.objects[0].select_set(True)
    before, scene = state(), bpy.context.scene
    selected = [obj.name for obj in bpy.context.selected_objects]
    groups = read_groups(folder / f"tree.{ending}")
    assert state() == before
    assert bpy.context.scene == scene
    assert [obj.name for obj in bpy.context.selected_objects] == selected

    parts = sort_out(groups)
    assert parts.said == told
    assert likely_up(parts.wood) == up
    model = tree()
    turned = stood(parts, up)
    found = recognise(turned.wood, turned.leaves)
    assert (found.wood.count, found.leaves.count) == (28, 63)
    daughters = (np.bincount(np.add(p, 1), minlength=29) for p in (found.parent, model.parents))
    np.testing.assert_array_equal(*map(np.sort, daughters))
    np.testing.assert_allclose(found.foot[found.trunk], model.foot[0] + [2, 0, 0], atol=5e-3)


def test_gltf_that_cannot_be_decompressed_is_said_to_be_so(tmp_path: Path) -> None:
    """Some builds of Blender come without Draco; a broken stream is the same to all of them."""
    view = {"bufferView": 0, "attributes": {"POSITION": 0}}
    scene = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_draco_mesh_compression"],
        "extensionsRequired": ["KHR_draco_mesh_compression"],
        "buffers": [{"byteLength": 4, "uri": "data:application/octet-stream;base64,AAAAAA=="}],
        "bufferViews": [{"buffer": 0, "byteLength": 4}],
        "accessors": [
            {"componentType": 5126, "count": 3, "type": "VEC3"},
            {"componentType": 5125, "count": 3, "type": "SCALAR"},
        ],
        "meshes": [
            {
                "primitives": [
                    {
                        "attributes": {"POSITION": 0},
                        "indices": 1,
                        "extensions": {"KHR_draco_mesh_compression": view},
                    }
                ]
            }
        ],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    (tmp_path / "packed.gltf").write_text(json.dumps(scene))
    before = state()
    with pytest.raises(SpecError, match=r"Draco.*; export it without") as caught:
        read_groups(tmp_path / "packed.gltf")
    assert "\n" not in str(caught.value)
    assert state() == before


@pytest.mark.parametrize("ending", ["obj", "ply", "glb"])
def test_a_bad_file_is_one_sentence_and_leaves_nothing(tmp_path: Path, ending: str) -> None:
    (tmp_path / f"bad.{ending}").write_bytes(b"nothing here\n" * 5)
    before = state()
    with pytest.raises(SpecError, match=f"bad.{ending}") as caught:
        read_groups(tmp_path / f"bad.{ending}")
    assert "\n" not in str(caught.value)
    assert state() == before
    with pytest.raises(SpecError, match="there is no such file"):
        read_groups(tmp_path / f"gone.{ending}")


# ------------------------------------------------------------------------------------------- opening
# Other files in this Blender: preferences and extensions stay, scripts in a file never run.

ROOT = Path(__file__).resolve().parents[2]
OURS = [p for room in ("forest_addon", "headless") for p in (ROOT / room).rglob("*.py")]


def test_an_empty_file_is_empty_and_preferences_stay(empty_blender):
    undo = bpy.context.preferences.edit.undo_steps
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.preferences.edit.undo_steps = 77
    before = {addon.module for addon in bpy.context.preferences.addons}
    empty_file()
    assert len(bpy.data.objects) == len(bpy.data.meshes) == 0
    assert bpy.context.preferences.edit.undo_steps == 77
    assert {addon.module for addon in bpy.context.preferences.addons} == before
    bpy.context.preferences.edit.undo_steps = undo


@pytest.mark.parametrize("wanted", [True, False])
def test_scripts_of_a_file_never_run(empty_blender, tmp_path, monkeypatch, wanted):
    """Neither with the preference that they may, nor without: a registered text and a driver."""
    file = tmp_path / "trap.blend"
    text = bpy.data.texts.new("trap.py")
    text.write("import sys; sys.trapped = True")
    text.use_module = True
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    monkeypatch.setattr(bpy.context.preferences.filepaths, "use_scripts_auto_execute", wanted)
    empty_file()
    open_file(file)
    assert "trap.py" in bpy.data.texts
    assert not hasattr(sys, "trapped")


HUGE = "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("a.blend", "a.blend: cannot be read as a scene"),
        ("gone.blend", "gone.blend: there is no such file"),
        (
            "huge.ply",
            "its head counts 16,000,000,000 records or bytes",
        ),  # and never reaches Blender
        ("a.max", r"must end in one of \.blend, \.glb"),
    ],
)
def test_what_cannot_be_opened_is_refused(tmp_path, name, words):
    (tmp_path / "a.blend").write_text("no")
    (tmp_path / "huge.ply").write_text(HUGE)
    with pytest.raises(SpecError, match=words):
        open_file(tmp_path / name)


@pytest.mark.medium
@pytest.mark.parametrize("ending", [".glb", ".obj", ".ply", ".stl", ".usdc", ".blend"])
def test_scenes_of_every_format_open_in_metres_and_z_up(empty_blender, tmp_path, ending):
    """A box of 1 x 2 x 3 m whose foot is at (4, 5, 0); the .blend counts in centimetres."""
    size = 100.0 if ending == ".blend" else 1.0
    bpy.ops.mesh.primitive_cube_add(size=size, location=np.array([4.5, 6, 1.5]) * size)
    bpy.context.object.scale = (1, 2, 3)
    file = tmp_path / f"a{ending}"
    if ending == ".blend":
        bpy.context.scene.unit_settings.scale_length = 0.01
    write(file)
    empty_file()
    open_file(file)
    boxes = [obj for obj in bpy.context.scene.objects if obj.type == "MESH"]
    corners = [boxes[0].matrix_world @ Vector(corner) for corner in boxes[0].bound_box]
    assert np.min(corners, axis=0) == pytest.approx([4, 5, 0], abs=1e-5)
    assert np.max(corners, axis=0) == pytest.approx([5, 7, 3], abs=1e-5)
    assert bpy.context.scene.unit_settings.scale_length == 1
    empty_file()


@pytest.mark.medium
@pytest.mark.parametrize("ending", [".glb", ".obj", ".ply", ".stl", ".usdc"])
@pytest.mark.parametrize("how", ["corners", "place"])
def test_a_mesh_at_map_coordinates_is_refused_at_both_doors(empty_blender, tmp_path, ending, how):
    """Blender holds places in single precision, whatever the file has; also trees of a wide forest."""
    wide = how == "corners" and ending not in (".ply", ".stl")  # these are one mesh
    far = Vector((432_100, 5_612_300, 120))
    for aside in (0, 2000 if wide else 30):
        bpy.ops.mesh.primitive_ico_sphere_add(radius=2, location=(aside, 0, 0))
        obj = bpy.context.object
        if how == "corners":
            obj.data.transform(Matrix.Translation(far))
        else:
            obj.location += far
    file = tmp_path / f"a{ending}"
    write(file)
    doors = [open_file, *([read_groups] if ending in AS_WRITTEN and how == "place" else [])]
    for door in doors:
        empty_file()
        with pytest.raises(
            SpecError, match=rf"a\{ending}: lies at map .* steps of 0\.5: its shape"
        ):
            door(file)
    empty_file()


@pytest.mark.medium
@pytest.mark.parametrize(
    ("ending", "how"),
    [
        *((ending, {}) for ending in (".glb", ".ply", ".stl", ".usda", ".obj")),
        (".gltf", {"export_format": "GLTF_SEPARATE"}),
        *((ending, {"ascii_format": True}) for ending in (".ply", ".stl")),
    ],
)
def test_corners_that_are_no_numbers_are_refused_at_both_doors(
    empty_blender, tmp_path, ending, how
):
    """Blender's importers put them at the origin, and say nothing."""
    bpy.ops.mesh.primitive_ico_sphere_add(radius=2)
    bpy.context.object.data.vertices[3].co = (7.125, 7.125, 7.125)
    file = tmp_path / f"a{ending}"
    write(file, **how)
    doors = [open_file, *([read_groups] if ending in AS_WRITTEN else [])]
    for door in doors:
        empty_file()
        door(file)
    for stored in tmp_path.iterdir():
        raw = stored.read_bytes().replace(struct.pack("<f", 7.125), struct.pack("<f", np.nan))
        if how.get("ascii_format") or ending in (".usda", ".obj"):
            raw = re.sub(rb"7\.1250*", b"nan", raw)
        stored.write_bytes(raw)
    for door in doors:
        empty_file()
        with pytest.raises(SpecError, match=rf"a\{ending}.* (NaN|no numbers|finite number)"):
            door(file)
    empty_file()


@pytest.mark.slow
def test_there_is_no_other_way_to_another_file():
    """Factory settings switch extensions off and remove what they brought; scripts are never let run."""
    forbidden = ("read_factory_settings", "read_userpref")
    for path in OURS:
        text = path.read_text(encoding="utf-8")
        if not any(name in text for name in (*forbidden, "open_mainfile")):
            continue  # not even in a comment
        for call in ast.walk(ast.parse(text)):
            name = getattr(getattr(call, "func", None), "attr", "")
            assert name not in forbidden, path
            if name == "open_mainfile":
                assert path.name == "export.py", f"{path} opens files by itself"
