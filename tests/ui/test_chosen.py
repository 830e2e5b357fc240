"""Which sensor is chosen: list, panel and buttons mean the same one, whatever was clicked last."""

from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.blender.sensors import objects as sensors
from forest_addon.ui.forest.start import SCENES
from forest_addon.ui.shell.views import chosen_sensor


def listed(props):
    """What the list highlights."""
    home = sensors.home_of(bpy.context.scene)
    number = props.active_sensor
    return home.objects[number] if number >= 0 else None


def activate(thing):
    bpy.context.view_layer.objects.active = thing
    bpy.context.view_layer.update()


def agree(props, thing):
    assert listed(props) == chosen_sensor(bpy.context) == thing


def test_after_shift_d_the_copy_is_chosen_everywhere(small):
    echo = bpy.data.objects["echo"]
    small.active_sensor = list(sensors.home_of(bpy.context.scene).objects).index(echo)
    agree(small, echo)
    for thing in bpy.data.objects:
        thing.select_set(thing == echo)
    bpy.ops.object.duplicate()
    copy = bpy.context.view_layer.objects.active
    assert copy != echo
    bpy.context.view_layer.update()
    agree(small, copy)
    assert bpy.ops.forest.remove_sensor() == {"FINISHED"}
    assert "echo" in bpy.data.objects
    assert "echo.001" not in bpy.data.objects


def test_the_chosen_one_stays_when_something_else_is_clicked_or_removed(small):
    cloud, echo = bpy.data.objects["cloud"], bpy.data.objects["echo"]
    activate(cloud)
    activate(echo)
    other = bpy.data.objects.new("rock", None)
    bpy.context.scene.collection.objects.link(other)
    activate(other)
    agree(small, echo)
    sensors.remove_sensor(cloud)  # numbers of the list move up
    agree(small, echo)
    echo.name = "ear"
    agree(small, echo)
    sensors.remove_sensor(echo)
    bpy.context.view_layer.update()
    assert chosen_sensor(bpy.context) == listed(small) is not None


def test_a_copy_of_a_reverb_goes_without_the_receiver_that_both_have(small):
    reverb = bpy.data.objects["reverb"]
    copy = reverb.copy()
    sensors.home_of(bpy.context.scene).objects.link(copy)
    sensors.remove_sensor(copy)
    assert sensors.receiver_of(reverb) is not None
    sensors.remove_sensor(reverb)
    assert "reverb receiver" not in bpy.data.objects


@pytest.mark.medium
@pytest.mark.parametrize("preset", sorted(Path(path).stem for path in SCENES.glob("*.toml")))
def test_every_preset_starts_with_a_sensor_chosen(props, preset):
    bpy.ops.forest.start(preset=preset)
    bpy.context.view_layer.update()
    there = sensors.sensors_of(bpy.context.scene)
    if there:
        agree(props, there[0])
    else:
        assert props.active_sensor == -1
