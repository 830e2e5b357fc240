"""The buttons of the asset library: trees of the scene's species, and the library among Blender's own."""

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.blender.scene.assets import FILE
from forest_addon.ui.settings import preferences
from forest_addon.ui.species import edit


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A library that is only of this test; preferences as they were afterwards."""
    home = tmp_path / "library"
    for room in (preferences, edit):
        monkeypatch.setattr(room, "library_folder", lambda: home)
    yield home
    known = bpy.context.preferences.filepaths.asset_libraries
    for one in [one for one in known if one.path == str(home)]:
        known.remove(one)


@pytest.mark.slow
def test_trees_of_the_scene_become_a_library_that_blender_is_told_of(props, folder):
    known = bpy.context.preferences.filepaths.asset_libraries
    before = [one.path for one in known]
    props.plantings.add().species = "grass"
    props.plantings.add().species = "bilberry"
    blocks = len(bpy.data.meshes), len(bpy.data.materials), len(bpy.data.collections)
    assert bpy.ops.forest.make_library(variants=1) == {"FINISHED"}
    assert sorted(file.name for file in folder.iterdir()) == ["bilberry.blend", FILE, "grass.blend"]
    assert blocks == (len(bpy.data.meshes), len(bpy.data.materials), len(bpy.data.collections))
    assert [one.path for one in known] == before  # never by itself
    assert bpy.ops.forest.add_library() == {"FINISHED"}
    assert [one.path for one in known if one.name == "Forest Sensing"] == [str(folder)]
    with pytest.raises(RuntimeError, match="already"):
        bpy.ops.forest.add_library()
    with bpy.data.libraries.load(str(folder / "grass.blend"), assets_only=True) as (there, _):
        assert list(there.collections) == ["Grass 1"]


@pytest.mark.medium
def test_one_press_from_a_clean_start_makes_trees_and_adds_them(props, folder, monkeypatch):
    monkeypatch.setattr(edit, "FIRST", ("grass",))
    known = bpy.context.preferences.filepaths.asset_libraries
    assert bpy.ops.forest.add_library() == {"FINISHED"}
    assert sorted(file.name for file in folder.iterdir()) == [FILE, "grass.blend"]
    assert [one.path for one in known if one.name == "Forest Sensing"] == [str(folder)]
