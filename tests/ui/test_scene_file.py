"""Scene files opened and written by the panel, .blend files saved and opened again."""

import json
import shutil

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ui.pressing import (
    ROOT,
    counts,
    facts,
    press,
    run,
    trees,
)

from forest_addon.formats.toml_file import read_settings
from forest_addon.spec import Scene
from forest_addon.ui.settings import exchange
from headless.cli import main

BARE = "\n[output]\n" + "".join(
    f"{name} = false\n"
    for name in ("blend", "glb", "preview", "pictures", "goodness", "leaves", "report")
)


@pytest.mark.medium
def test_an_exported_scene_file_says_the_same(built, tmp_path):
    path = tmp_path / "mine.toml"
    assert press("save_scene", filepath=str(path)) == {"FINISHED"}
    assert read_settings(path, Scene) == exchange.to_spec(bpy.context.scene)
    before = exchange.to_spec(bpy.context.scene)
    assert press("load_scene", filepath=str(path)) == {"FINISHED"}
    assert exchange.to_spec(bpy.context.scene) == before


@pytest.mark.medium
def test_the_panel_exports_for_other_programs(built, tmp_path):
    assert press("export_others", directory=str(tmp_path / "others")) == {"FINISHED"}
    said = json.loads((tmp_path / "others/scene.json").read_text())
    assert sum(part["tree"] >= 0 for part in said["parts"]) == len(trees())
    assert all((tmp_path / "others" / part["file"]).is_file() for part in said["parts"])
    assert (tmp_path / "others/forest.glb").is_file()


@pytest.mark.slow
def test_without_a_window_the_exported_scene_gives_the_same_bytes(built, tmp_path):
    """The panel's scene and the one of a file are the same thing: every result, bit for bit."""
    built.output = str(tmp_path / "panel")
    assert press("run") == {"FINISHED"}
    path = tmp_path / "mine.toml"
    press("save_scene", filepath=str(path))
    path.write_text(path.read_text() + BARE)
    out = tmp_path / "headless"
    assert main(["run", str(path), "--out", str(out), "--quiet"]) == 0
    results = sorted(file.name for file in (tmp_path / "panel").glob("[!.]*"))
    assert len(results) == 6
    for name in results:
        ours, theirs = ((tmp_path / where / name).read_bytes() for where in ("panel", "headless"))
        if name.endswith(".npz"):  # an archive also holds when it was written
            ours, theirs = ({k: v.tobytes() for k, v in np.load(tmp_path / where / name).items()}
                            for where in ("panel", "headless"))  # fmt: skip
        assert ours == theirs, name


def test_a_scene_file_is_opened(props):
    demo = ROOT / "assets/scenes/demo.toml"
    assert press("load_scene", filepath=str(demo)) == {"FINISHED"}
    assert props.plantings[0].species == read_settings(demo, Scene).plantings[0].species
    assert trees() == []


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("seed = -1", "seed"),
        ("forrest = 1", "did you mean"),
        ("[", "not TOML"),
        (None, "no such file"),
        ("seed = 9999999999", "too large for the panel"),
    ],
)
def test_a_bad_scene_file_changes_nothing(small, tmp_path, text, words):
    path = tmp_path / "bad.toml"
    if text is not None:
        path.write_text(text)
    before = exchange.to_spec(bpy.context.scene)
    with pytest.raises(RuntimeError, match=words):
        press("load_scene", filepath=str(path))
    assert exchange.to_spec(bpy.context.scene) == before


@pytest.mark.slow
def test_species_files_are_found_beside_the_scene_file(props, tmp_path):
    for name in ("species", "templates"):
        shutil.copytree(ROOT / "assets" / name, tmp_path / name)
    (tmp_path / "scene.toml").write_text(
        '[forest]\nsize = [6, 6]\n[[plantings]]\nspecies = "species/hazelnut.toml"\nexpected = 3\n'
    )
    press("load_scene", filepath=str(tmp_path / "scene.toml"))
    assert press("build") == {"FINISHED"}


@pytest.mark.slow
def test_a_saved_file_brings_everything_back(built, tmp_path):
    run("cloud")
    run("echo")
    before, figures = exchange.to_spec(bpy.context.scene), facts(built, "echo")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "forest.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "forest.blend"))
    props = bpy.context.scene.forest_sensing
    assert exchange.to_spec(bpy.context.scene) == before
    assert facts(props, "echo") == figures
    count = counts()
    press("build")
    run("cloud")
    run("echo")
    assert counts() == count


def test_the_offset_that_a_file_asks_for_is_taken_and_undone(small, tmp_path):
    heights = " ".join(["250"] * 2400)
    (tmp_path / "dem.asc").write_text(
        f"ncols 60\nnrows 40\nxllcorner 500000.5\nyllcorner 5400000\ncellsize 1\n{heights}"
    )
    small.folder, small.forest.terrain.file = str(tmp_path), "dem.asc"
    with pytest.raises(RuntimeError, match=r"offset = \[500028, 5400017, 0\] at the top"):
        bpy.ops.forest.build()
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.forest.take_offset("EXEC_DEFAULT", True) == {"FINISHED"}
    assert bpy.context.scene.forest_sensing.offset == "[500028.0, 5400017.0, 0.0]"
    assert bpy.ops.forest.take_offset() == {"FINISHED"}  # there already
    assert bpy.context.scene.forest_sensing.offset == "[500028.0, 5400017.0, 0.0]"
    bpy.ops.ed.undo()
    assert "500028" not in bpy.context.scene.forest_sensing.offset
