"""The forest as .glb: as it was planned, valid, and small where trees are points."""

import json
import subprocess
import sys

import numpy as np
import pytest
from references import gltf

bpy = pytest.importorskip("bpy")

from forest_addon import spec
from forest_addon.base.places import ASSETS
from forest_addon.blender.files.export import export_glb, export_usd
from forest_addon.blender.scene import nodes
from forest_addon.blender.scene.forest import build
from forest_addon.blender.scene.layout import TREES, VARIANTS, part
from forest_addon.formats.glb import EXTENSION, read_glb
from forest_addon.growth.library import load_species
from forest_addon.stand.forest import grow_forest

MESHES = 4  # variants of two species


def settings(instancing, count):
    return spec.Scene(
        seed=7,
        forest=spec.Forest(size=(60.0, 60.0), margin=4.0, instancing=instancing),
        plantings=(
            spec.Planting(species="abop-monopodial-a", variants=2, expected=count, exact=True),
            spec.Planting(species="abop-sympodial-a", variants=2, expected=count, exact=True),
        ),
    )


def planted(instancing, count=15, species=None):
    scene = settings(instancing, count)
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
            thing.matrix_world
            for thing in bpy.context.scene.objects
            if thing.type == "MESH" and thing.data.name.split(".")[0] in forest.labels
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
    hidden = bpy.data.collections.new("away")
    bpy.context.scene.collection.children.link(hidden)
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
    grove = bpy.data.collections.new("0 grove")
    variants.children.link(grove)
    grove.objects.link(variants.objects[0])
    with pytest.raises(ValueError, match="pick mesh objects"):
        export_glb(bpy.context.scene, tmp_path / "forest.glb")
    assert not list(tmp_path.iterdir())
    assert not list(bpy.context.scene.collection.objects)


def wide(instancing):
    """A stand with a kilometre of ground around it."""
    scene = settings(instancing, 6).changed(
        forest=spec.Forest(size=(60.0, 60.0), margin=1000.0, instancing=instancing)
    )
    kinds = [load_species(ASSETS / "species" / f"{p.species}.toml") for p in scene.plantings]
    forest = grow_forest(scene, kinds)
    build(bpy.context.scene, scene, forest)
    return forest


@pytest.mark.slow
@pytest.mark.parametrize("instancing", ["points", "objects"])
def test_a_viewer_that_frames_all_shows_the_forest(empty_blender, instancing, tmp_path):
    forest = wide(instancing)
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
    forest = wide(instancing)
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
    planted(instancing, 2, "maple")
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
