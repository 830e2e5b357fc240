"""Add > Forest > Flight, and Fly: a flyer with sensors, keyed along its way, a trail in colours."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.blender.read.depsgraph import read_scene
from forest_addon.blender.scene.instances import IGNORED_KEY
from forest_addon.blender.sensors.objects import sensors_of
from forest_addon.ui.settings.exchange import from_spec, to_spec


def wall(x, size=0.5):
    bpy.ops.mesh.primitive_cube_add(size=size, location=(x, 0.0, 2.0))
    return bpy.context.object


def trail():
    return next(t for t in bpy.data.objects if t.name.endswith("trail"))


def test_a_flyer_stands_with_its_sensors(props):
    bpy.context.scene.cursor.location = (1.0, 2.0, 0.0)
    bpy.ops.forest.add_flight()
    flyer = bpy.data.objects["Flyer"]
    assert tuple(flyer.location) == (1.0, 2.0, 2.0)
    assert {thing.name for thing in sensors_of(bpy.context.scene)} == {"Flyer lidar", "Flyer sonar"}
    assert {s.follow for s in to_spec(bpy.context.scene).sensors} == {"Flyer"}


def test_it_flies_around_what_stands_there_and_is_animated(props):
    wall(5.0)
    bpy.ops.forest.add_flight()
    flyer = bpy.data.objects["Flyer"]
    props.flight.distance = 10.0
    assert bpy.ops.forest.fly(policy="gap") == {"FINISHED"}
    scene = bpy.context.scene
    places = []
    for frame in range(1, scene.frame_end + 1):
        scene.frame_set(frame)
        places.append(tuple(flyer.matrix_world.translation))
    places = np.array(places)
    assert np.allclose(places[0], [0, 0, 2], atol=1e-5)
    assert np.hypot(*(places[-1, :2] - [10, 0])) < 2.3
    assert np.abs(places[:, 1]).max() > 0.3  # around the cube
    mesh = trail().data
    colour = np.empty(4 * len(mesh.vertices), dtype=np.float32)
    mesh.color_attributes["sensed"].data.foreach_get("color", colour)
    assert len(np.unique(colour.reshape(-1, 4).round(2), axis=0)) > 3
    assert trail()[IGNORED_KEY]
    geometry = read_scene(bpy.context.evaluated_depsgraph_get())
    assert "Flyer trail" not in geometry.object_name


def test_twice_in_a_row_nothing_piles_up(props):
    wall(4.0)
    bpy.ops.forest.add_flight()
    props.flight.distance = 6.0
    bpy.ops.forest.fly(policy="straight")
    things, meshes = len(bpy.data.objects), len(bpy.data.meshes)
    bpy.context.scene.frame_set(1)
    bpy.ops.forest.fly(policy="straight")
    assert (len(bpy.data.objects), len(bpy.data.meshes)) == (things, meshes)


def test_without_a_flyer_it_says_what_to_do(props):
    with pytest.raises(RuntimeError, match="no flyer yet; add one"):
        bpy.ops.forest.fly(policy="gap")


def test_settings_of_a_flight_come_through_the_panel(props):
    scene = bpy.context.scene
    wanted = to_spec(scene).changed()
    wanted = wanted.changed(
        flight=wanted.flight.changed(body="quadrotor", speed=7.0, start=(1.0, 2.0, 3.0))
    )
    from_spec(scene, wanted)
    assert to_spec(scene).flight == wanted.flight
