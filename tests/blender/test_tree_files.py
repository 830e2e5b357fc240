"""Trees in PLY, OBJ and glTF files are read, and the user's file stays as it was."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from references.model_tree import tree

bpy = pytest.importorskip("bpy")

from forest_addon.blender.files.tree_files import read_groups
from forest_addon.growth.own_tree.pieces import likely_up, sort_out, stood
from forest_addon.growth.own_tree.recognise import recognise
from forest_addon.spec import SpecError


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
        thing = bpy.data.objects.new(name, mesh)
        thing.location.x = 2.0
        bpy.context.scene.collection.objects.link(thing)
    bpy.context.view_layer.update()
    bpy.ops.wm.obj_export(filepath=str(tmp_path / "tree.obj"))
    bpy.ops.wm.ply_export(filepath=str(tmp_path / "tree.ply"))
    bpy.ops.export_scene.gltf(filepath=str(tmp_path / "tree.glb"))
    bpy.ops.export_scene.gltf(filepath=str(tmp_path / "tree.gltf"), export_format="GLTF_SEPARATE")
    return tmp_path


@pytest.mark.medium
@pytest.mark.parametrize(
    ("ending", "up", "told"),
    [
        ("obj", "y", "by name"),
        ("ply", "z", "by shape"),
        ("glb", "y", "by name"),
        ("gltf", "y", "by name"),
    ],
)
def test_a_tree_is_read_and_nothing_of_it_stays(
    folder: Path, ending: str, up: str, told: str
) -> None:
    bpy.context.scene.collection.objects[0].select_set(True)
    before, scene = state(), bpy.context.scene
    selected = [thing.name for thing in bpy.context.selected_objects]
    groups = read_groups(folder / f"tree.{ending}")
    assert state() == before
    assert bpy.context.scene == scene
    assert [thing.name for thing in bpy.context.selected_objects] == selected

    parts = sort_out(groups)
    assert parts.said == told
    assert likely_up(parts.wood) == up
    model = tree()
    turned = stood(parts, up)
    found = recognise(turned.wood, turned.leaves)
    assert (found.wood.count, found.leaves.count) == (28, 63)
    daughters = np.bincount(found.parent + 1, minlength=29)
    np.testing.assert_array_equal(
        np.sort(daughters), np.sort(np.bincount(np.array(model.parents) + 1, minlength=29))
    )
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


def test_compressed_gltf_is_read_or_refused_in_one_sentence(folder: Path) -> None:
    """Draco: Blender decodes it where its build has the library."""
    path = folder / "small.glb"
    bpy.ops.export_scene.gltf(filepath=str(path), export_draco_mesh_compression_enable=True)
    if b"KHR_draco_mesh_compression" not in path.read_bytes():
        pytest.skip("this Blender cannot compress")
    before = state()
    parts = sort_out(read_groups(path))
    assert state() == before
    turned = stood(parts, "y")
    found = recognise(turned.wood, turned.leaves)
    assert (found.wood.count, found.leaves.count) == (28, 63)
