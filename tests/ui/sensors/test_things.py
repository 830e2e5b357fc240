"""What an object is to sensors, from the panel to what they find."""

from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import spec
from forest_addon.blender.read.depsgraph import read_scene
from forest_addon.ui.sensors import panels


@pytest.fixture
def wall(small):
    bpy.ops.mesh.primitive_cube_add(location=(3, 3, 1))
    return bpy.context.object


def found():
    return read_scene(bpy.context.evaluated_depsgraph_get())


def test_an_object_is_seen_until_it_is_not_to_be(wall):
    assert wall.forest_seen
    assert wall.name in found().object_name
    wall.forest_seen = False
    assert wall.name not in found().object_name
    assert wall["forest_ignored"]
    wall.forest_seen = True
    assert wall.name in found().object_name
    assert "forest_ignored" not in wall


def test_an_object_has_a_reflectance_of_its_own(wall):
    assert not wall.forest_reflects
    assert np.isnan(found().reflectance).all()
    wall.forest_reflects = True
    assert wall["forest_reflectance"] == spec.Surfaces().other
    wall.forest_reflected = 0.25
    assert found().reflectance.tolist() == [0.25]
    wall.forest_reflected = 3.0  # a share
    assert wall["forest_reflectance"] == 1.0
    wall.forest_reflects = False
    assert np.isnan(found().reflectance).all()


def test_an_object_is_a_mirror_glass_or_water(wall):
    assert wall.forest_polish == "NONE"
    assert found().optics is None
    wall.forest_polish = "WATER"
    assert wall["forest_optics"] == "water"
    assert wall.forest_refraction == pytest.approx(1.33)
    wall.forest_refraction = 1.4
    assert found().optics[0, :2] == pytest.approx([2, 1.4])
    wall.forest_polish = "MIRROR"
    wall.forest_mirrored = 0.75
    assert found().optics[0, [0, 2]].tolist() == [0, 0.75]
    wall.forest_polish = "RETRO"
    assert wall.forest_gained == 785.0
    wall.forest_gained = 300.0
    assert found().optics[0, [0, 3]].tolist() == [3, 300]
    wall.forest_polish = "NONE"
    assert found().optics is None
    wall["forest_optics"] = "mirorr"
    wall.update_tag()  # a scanner that follows bounces refuses it
    assert found().optics[0, 0] == -1


def test_what_a_script_has_set_is_shown(wall):
    wall["forest_ignored"], wall["forest_reflectance"] = 1, 0.75
    assert not wall.forest_seen
    assert wall.forest_reflects
    assert wall.forest_reflected == 0.75
    wall["forest_reflectance"] = "white"  # sensors do not count it either
    assert wall.forest_reflected == spec.Surfaces().other


def test_it_is_undone(wall):
    bpy.ops.ed.undo_push(message="before")
    wall.forest_seen = False
    bpy.ops.ed.undo_push(message="after")
    bpy.ops.ed.undo()
    assert bpy.data.objects["Cube"].forest_seen


def test_the_panel_is_there_for_what_sensors_could_see(wall):
    assert panels.FOREST_PT_thing.poll(bpy.context)
    for other in ("reverb", "cloud"):
        bpy.context.view_layer.objects.active = bpy.data.objects[other]
        assert not panels.FOREST_PT_thing.poll(bpy.context)
    bpy.context.view_layer.objects.active = None
    assert panels.seen_thing(SimpleNamespace(object=None)) is None
    assert not panels.FOREST_PT_thing.poll(bpy.context)


def test_objects_keep_it_without_the_add_on(wall):
    wall.forest_seen = False
    panels.unregister()
    try:
        assert not hasattr(wall, "forest_seen")
        assert wall["forest_ignored"]
        assert wall.name not in found().object_name
    finally:
        panels.register()
    assert not wall.forest_seen
