"""Other files in this Blender: preferences and extensions stay, scripts in a file never run."""

import ast
import sys
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from mathutils import Matrix, Vector

from forest_addon.blender.files.export import empty_file, open_file
from forest_addon.blender.files.tree_files import ENDINGS, read_groups
from forest_addon.spec import SpecError

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


def test_what_is_no_blend_file(tmp_path):
    (tmp_path / "a.blend").write_text("no")
    for name in ("a.blend", "gone.blend"):
        with pytest.raises(
            SpecError, match=rf"{name}: (cannot be read as a scene|there is no such file)"
        ):
            open_file(tmp_path / name)


@pytest.mark.medium
@pytest.mark.parametrize("ending", [".glb", ".obj", ".ply", ".stl", ".usdc", ".blend"])
def test_scenes_of_every_format_open_in_metres_and_z_up(empty_blender, tmp_path, ending):
    """A box of 1 x 2 x 3 m whose foot is at (4, 5, 0); the .blend counts in centimetres."""
    size = 100.0 if ending == ".blend" else 1.0
    bpy.ops.mesh.primitive_cube_add(size=size, location=np.array([4.5, 6, 1.5]) * size)
    bpy.context.object.scale = (1, 2, 3)
    file = str(tmp_path / f"a{ending}")
    if ending == ".blend":
        bpy.context.scene.unit_settings.scale_length = 0.01
        bpy.ops.wm.save_as_mainfile(filepath=file)
    elif ending == ".glb":
        bpy.ops.export_scene.gltf(filepath=file)
    else:
        getattr(bpy.ops.wm, f"{ending[1:4]}_export")(filepath=file)
    empty_file()
    open_file(Path(file))
    boxes = [thing for thing in bpy.context.scene.objects if thing.type == "MESH"]
    corners = [boxes[0].matrix_world @ Vector(corner) for corner in boxes[0].bound_box]
    assert np.min(corners, axis=0) == pytest.approx([4, 5, 0], abs=1e-5)
    assert np.max(corners, axis=0) == pytest.approx([5, 7, 3], abs=1e-5)
    assert bpy.context.scene.unit_settings.scale_length == 1
    empty_file()


def test_a_mesh_that_counts_more_than_it_holds_never_reaches_blender(tmp_path):
    (tmp_path / "a.ply").write_text(
        "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n"
    )
    with pytest.raises(SpecError, match="its head counts 16,000,000,000 records or bytes"):
        open_file(tmp_path / "a.ply")
    with pytest.raises(SpecError, match=r"must end in one of \.blend, \.glb"):
        open_file(tmp_path / "a.max")


@pytest.mark.medium
@pytest.mark.parametrize("ending", [".glb", ".obj", ".ply", ".stl", ".usdc"])
@pytest.mark.parametrize("how", ["corners", "place"])
def test_a_mesh_at_map_coordinates_is_refused_at_both_doors(empty_blender, tmp_path, ending, how):
    """Blender holds places in single precision, whatever the file has; also trees of a wide forest."""
    wide = how == "corners" and ending not in (".ply", ".stl")  # these are one mesh
    far = Vector((432_100, 5_612_300, 120))
    for aside in (0, 2000 if wide else 30):
        bpy.ops.mesh.primitive_ico_sphere_add(radius=2, location=(aside, 0, 0))
        thing = bpy.context.object
        if how == "corners":
            thing.data.transform(Matrix.Translation(far))
        else:
            thing.location += far
    file = str(tmp_path / f"a{ending}")
    if ending == ".glb":
        bpy.ops.export_scene.gltf(filepath=file)
    else:
        getattr(bpy.ops.wm, f"{ending[1:4]}_export")(filepath=file)
    doors = [open_file, *([read_groups] if ending in ENDINGS and how == "place" else [])]
    for door in doors:
        empty_file()
        with pytest.raises(
            SpecError, match=rf"a\{ending}: lies at map .* steps of 0\.5: its shape"
        ):
            door(Path(file))
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
