"""Sensors added where the user is: in any scene, on its ground, ready to run."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.blender.sensors import objects as sensors
from forest_addon.ui.sensors.add import STARTS
from forest_addon.ui.settings import exchange

from ..pressing import counts, press, run


@pytest.fixture
def room(props):
    """A scene of the user's own: a slab whose top is at 3 m, a block on it, and no forest."""
    for place, scale in (((0, 0, 2.5), (12, 12, 1)), ((3.5, 0, 5), (1, 2, 4))):
        bpy.ops.mesh.primitive_cube_add(size=1, location=place, scale=scale)
    bpy.context.view_layer.update()
    return props


@pytest.mark.slow
@pytest.mark.parametrize("which", STARTS)
def test_each_runs_at_once_in_any_scene(room, which):
    bpy.context.scene.cursor.location = (-2, 0, 3)
    assert press("add_sensor", kind=which) == {"FINISHED"}
    thing = bpy.context.view_layer.objects.active
    assert thing.name == STARTS[which].title
    group = getattr(thing.forest_sensor, STARTS[which].kind)
    for name, coarse in {"angle_step_deg": 4.0, "step": 1.0, "pulse_rate": 2000.0}.items():
        if hasattr(group, name):
            setattr(group, name, coarse)
    assert run(thing.name) == {"FINISHED"}
    assert thing.name in room.results
    assert exchange.forestless(room)
    assert not exchange.untouched(room)
    if STARTS[which].kind not in ("sonar", "reverb"):
        points = bpy.data.objects[room.results[thing.name].shown]
        assert len(points.data.vertices if points.type == "MESH" else points.data.points) > 10


def test_it_stands_on_the_ground_below_the_cursor(room):
    scene = bpy.context.scene
    for cursor, foot in (((0, 0, 3), 3), ((0, 0, 40), 3), ((50, 0, 1), 1), ((3.5, 0, 0), 3)):
        scene.cursor.location = cursor
        press("add_sensor", kind="terrestrial")
        thing = bpy.context.view_layer.objects.active
        assert np.allclose(thing.location, (*cursor[:2], foot + 1.6), atol=1e-5)
        scene.cursor.location = (0, 0, 0)


def test_a_path_goes_through_what_there_is_to_sense(room):
    bpy.context.scene.cursor.location = (0, 0, 3)
    press("add_sensor", kind="drone")
    path = sensors._held(bpy.context.view_layer.objects.active, sensors.PATH_KEY)
    line = np.array([(path.matrix_world @ p.co.xyz)[:] for p in path.data.splines[0].points])
    assert np.allclose(line[:, 2], 37)  # 30 m above the block's top
    assert np.allclose((line[:, 1].min(), line[:, 1].max()), (-6, 6))


def test_a_path_goes_with_its_sensor_unless_a_copy_follows_it(room):
    before = counts()
    press("add_sensor", kind="mobile")
    thing = bpy.context.view_layer.objects.active
    copy = thing.copy()
    sensors.home_of(bpy.context.scene).objects.link(copy)
    press("remove_sensor")
    assert sensors._held(copy, sensors.PATH_KEY).name in bpy.data.objects
    bpy.context.view_layer.objects.active = copy
    press("remove_sensor")
    assert counts()["objects"] == before["objects"]


@pytest.mark.slow
def test_a_forest_grown_later_leaves_the_users_sensors(room):
    press("scan_here")
    assert press("build") == {"FINISHED"}
    assert [thing.name for thing in sensors.sensors_of(bpy.context.scene)] == ["Tripod LiDAR"]
    assert len(room.plantings)
