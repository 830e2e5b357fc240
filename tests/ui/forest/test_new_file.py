"""File > New > Forest: start scenes in a file of their own."""

from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy")

from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

from forest_addon.blender.read.depsgraph import read_scene
from forest_addon.blender.scene.instances import TREE_KEY
from forest_addon.blender.sensors.objects import sensors_of
from forest_addon.blender.show.preview import LAWN
from forest_addon.formats.toml_file import read_settings
from forest_addon.spec import Scene
from forest_addon.ui.forest import start
from forest_addon.ui.forest.start import SCENES, presets

from ..test_panels import canvas


def in_picture(scene, corners):
    """Where places are in the camera's picture, 0 to 1."""
    bpy.context.view_layer.update()
    for corner in corners:
        seen = world_to_camera_view(scene, scene.camera, Vector(corner))
        assert seen.z > 0
        yield seen.xy


def ground_of(scene):
    """The corners of the field."""
    (x, y), (wide, deep) = scene.forest_sensing.forest.origin, scene.forest_sensing.forest.size
    return [(x, y, 0), (x + wide, y, 0), (x, y + deep, 0), (x + wide, y + deep, 0)]


def crowns_of(scene):
    """The corners of the boxes about its trees."""
    trees = [thing for thing in scene.objects if TREE_KEY in thing]
    return [tree.matrix_world @ Vector(corner) for tree in trees for corner in tree.bound_box]


@pytest.mark.slow
@pytest.mark.parametrize(("preset", "trees"), [("tanveer-one-tree", 1), ("paper-100k", 0)])
def test_a_start_scene_stands_built_and_lit(props, preset, trees):
    bpy.data.meshes.new("of the old file").use_fake_user = True
    assert bpy.ops.forest.new(preset=preset) == {"FINISHED"}
    scene = bpy.context.scene
    assert "of the old file" not in bpy.data.meshes
    assert sum(TREE_KEY in thing for thing in scene.objects) == trees
    assert "forest" in scene.forest_sensing.results
    assert scene.forest_sensing.name == read_settings(SCENES / f"{preset}.toml", Scene).name
    assert scene.world is not None
    assert [thing.data.type for thing in scene.objects if thing.type == "LIGHT"] == ["SUN"]
    assert scene.view_settings.exposure > 0.5  # the evening's sun is weak
    for place in in_picture(scene, crowns_of(scene) if trees else ground_of(scene)):
        assert min(place) >= -0.15  # boxes are larger than crowns
        assert max(place) <= 1.15
    assert (scene.camera.location.z < 5) == bool(trees)  # among trees at the height of eyes
    sensors = {sensor.name for sensor in read_settings(SCENES / f"{preset}.toml", Scene).sensors}
    assert sensors <= {thing.name for thing in scene.objects}


@pytest.mark.slow
def test_the_lawn_is_for_pictures_alone(props):
    """Views do not show it, so that View All frames the forest; and no sensor meets it."""
    bpy.ops.forest.new(preset="tanveer-one-tree")
    lawn = bpy.context.scene.objects[LAWN]
    assert (lawn.hide_viewport, lawn.hide_render) == (True, False)
    seen = {thing for thing in bpy.context.scene.objects if thing.visible_get()}
    assert max(max(thing.dimensions) for thing in seen) < 60
    assert LAWN not in read_scene(bpy.context.evaluated_depsgraph_get()).object_name


def test_the_empty_one_has_light_a_camera_and_nothing_else(props):
    assert bpy.ops.forest.new(preset="") == {"FINISHED"}
    assert {thing.type for thing in bpy.context.scene.objects} == {"LIGHT", "CAMERA"}


def test_a_preset_that_is_not_there_is_reported(props):
    with pytest.raises(RuntimeError, match=r"There is no scene .baobab."):
        bpy.ops.forest.new(preset="baobab")


def test_the_menu_is_there_and_offers_what_add_offers(registered):
    drawn = bpy.types.TOPBAR_MT_file_new._dyn_ui_initialize()
    assert start.draw_in_new in drawn
    offered = []

    class Layout:
        def operator(self, name, **_):
            assert name in ("forest.new", "forest.gallery")
            offered.append(SimpleNamespace())
            return offered[-1]

        def separator(self):
            pass

        def menu(self, name, **_):
            kind = getattr(bpy.types, name)
            kind.draw(canvas(kind, self), None)

    menu = type("Menu", (), {"layout": Layout()})
    start.FOREST_MT_new.draw(menu, None)
    presets_offered = [entry.preset for entry in offered if hasattr(entry, "preset")]
    assert sorted(presets_offered) == sorted(["", *(file for file, _ in presets())])


@pytest.fixture
def furnished(registered, monkeypatch):
    """The presets of new files that are furnished, in a Blender that has a window."""
    presets = []
    monkeypatch.setattr(start, "_furnish_soon", presets.append)
    return presets


def test_the_new_file_that_was_asked_for_is_furnished_and_no_other(furnished, monkeypatch):
    monkeypatch.setattr(start, "_awaited", "demo")
    bpy.ops.wm.read_homefile(app_template="")
    assert furnished == ["demo"]
    bpy.ops.wm.read_homefile(app_template="")
    assert furnished == ["demo"]


def test_another_file_is_left_as_it_is(furnished, monkeypatch, tmp_path):
    file = str(tmp_path / "other.blend")
    bpy.ops.wm.save_as_mainfile(filepath=file)
    monkeypatch.setattr(start, "_awaited", "demo")
    bpy.ops.wm.open_mainfile(filepath=file)
    bpy.ops.wm.read_homefile(app_template="")
    assert furnished == []


def test_who_chooses_anew_is_not_given_what_was_given_up(furnished, monkeypatch):
    monkeypatch.setattr(start, "_awaited", "demo")
    layout = type("Layout", (), {"separator": lambda _: None, "menu": lambda *_, **__: None})()
    start.draw_in_new(type("Menu", (), {"layout": layout}), None)
    bpy.ops.wm.read_homefile(app_template="")
    assert furnished == []


def test_add_forest_keeps_the_sensors_that_are_there(small):
    """Add > Forest adds; only who chooses to replaces."""
    before = sensors_of(bpy.context.scene)
    assert bpy.ops.forest.start(preset="demo") == {"FINISHED"}
    bpy.context.view_layer.update()
    after = sensors_of(bpy.context.scene)
    assert set(before) < set(after)
    bpy.ops.forest.start(preset="demo")  # those of the preset are there by now
    assert set(sensors_of(bpy.context.scene)) == set(after)
    bpy.ops.forest.start(preset="demo", sensors="REPLACE")
    assert len(sensors_of(bpy.context.scene)) == len(after) - len(before)


def test_an_opened_scene_file_says_that_sensors_went_or_keeps_them(small, capfd):
    before, demo = set(sensors_of(bpy.context.scene)), str(SCENES / "demo.toml")
    assert bpy.ops.forest.load_scene(filepath=demo, keep_sensors=True) == {"FINISHED"}
    assert before < set(sensors_of(bpy.context.scene))
    count = len(sensors_of(bpy.context.scene))
    assert bpy.ops.forest.load_scene(filepath=demo) == {"FINISHED"}
    assert f"took the place of {count}; undo brings those back" in capfd.readouterr().out
