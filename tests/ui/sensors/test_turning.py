"""A sensor's object moved and turned by hand: its rays are the ones of before, moved and turned alike."""

import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.blender.sensors.objects import PATH_KEY, kind_of
from forest_addon.blender.sensors.observe import Observer
from forest_addon.sensing.kinds import KINDS
from forest_addon.sensing.lidar import tractor
from forest_addon.sensing.lidar.pattern import pattern_of
from forest_addon.sensing.reverb.ends import ends_of
from forest_addon.sensing.sonar.station import posed
from forest_addon.ui.sensors.add import STARTS
from forest_addon.ui.settings import exchange

from ..pressing import add_cube, press

TURN, MOVE = math.radians(31.0), np.array([1.5, -2.0, 0.0])
RAYS = 400


def direction(azimuth_deg, elevation_deg):
    a, e = math.radians(azimuth_deg), math.radians(elevation_deg)
    return np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])


def rays(thing):
    """(R, 3), (R, 3) where from and where to the sensor of an object looks: its first rays, and some more."""
    sensor = exchange.sensor_of(thing)
    if sensor.kind == "sonar":
        way = Observer.way(sensor)
        pose = posed(sensor) if way is None else way[0]
        return np.tile(pose.position, (3, 1)), pose.frame
    if sensor.kind == "reverb":
        ((source, _receiver),) = ends_of(sensor).pairs
        way = direction(sensor.facing_azimuth_deg, sensor.facing_elevation_deg)
        return np.array([source]), way[None]
    if sensor.kind == "tractor":
        steps = len(tractor.fan(sensor))
        number = np.linspace(0, steps * len(tractor.positions(sensor)) - 1, RAYS).astype(int)
        return tractor.axes(sensor, *np.divmod(number, steps))
    pattern = pattern_of(sensor, Observer.way(sensor))
    pulses = pattern.pulses(np.linspace(0, pattern.count - 1, RAYS).astype(int))
    return pulses.origin, pulses.direction


def added(which):
    add_cube().scale = (20, 30, 5)
    press("add_sensor", kind=which)
    return bpy.context.view_layer.objects.active


@pytest.mark.parametrize("which", STARTS)
def test_rays_move_and_turn_with_what_a_hand_may_move(props, which):
    """The object itself; of a drone and a vehicle, which are locked, the curve that the panel points to."""
    thing = added(which)
    if kind_of(thing) == "mobile":
        assert all((*thing.lock_location, *thing.lock_rotation))
        assert KINDS["mobile"].fixed(thing.forest_sensor.mobile) == "Move what it follows"
        held = thing[PATH_KEY]
    else:
        held = thing
        assert not any((thing.lock_rotation[2], *thing.lock_location))
    origin, way = rays(thing)
    pivot = np.array(held.location)
    held.rotation_euler.z += TURN
    held.location = pivot + MOVE
    bpy.context.view_layer.update()
    cos, sin = math.cos(TURN), math.sin(TURN)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    moved, turned = rays(thing)
    assert np.abs(turned - way @ turn.T).max() < 2e-5
    assert np.abs(moved - ((origin - pivot) @ turn.T + pivot + MOVE)).max() < 2e-3


@pytest.mark.parametrize("which", ["sonar", "reverb"])
def test_what_may_look_up_does(props, which):
    thing = added(which)
    _, way = rays(thing)
    axis = 1 if which == "sonar" else 0
    thing.rotation_euler[axis] += 0.3 * (-1 if which == "sonar" else 1)
    bpy.context.view_layer.update()
    raised = math.asin(rays(thing)[1][0, 2]) - math.asin(way[0, 2])
    assert raised == pytest.approx(0.3, abs=1e-5)


@pytest.mark.parametrize("which", STARTS)
def test_a_parent_moves_and_turns_it_too(props, which):
    """Locks are for hands; a parent, a constraint or a key moves what hands may move."""
    thing = added(which)
    held = thing.get(PATH_KEY, thing)
    carrier = bpy.data.objects.new("carrier", None)
    bpy.context.scene.collection.objects.link(carrier)
    held.parent = carrier
    bpy.context.view_layer.update()
    origin, way = rays(thing)
    carrier.location, carrier.rotation_euler.z = (3, 4, 0), math.pi / 2
    bpy.context.view_layer.update()
    moved, turned = rays(thing)
    assert np.abs(turned - np.stack([-way[:, 1], way[:, 0], way[:, 2]], axis=1)).max() < 2e-5
    expected = np.stack([3 - origin[:, 1], 4 + origin[:, 0], origin[:, 2]], axis=1)
    assert np.abs(moved - expected).max() < 2e-3


@pytest.mark.parametrize("which", STARTS)
def test_where_a_turn_has_no_effect_the_panel_says_why(props, which):
    thing = added(which)
    kind = kind_of(thing)
    if len(KINDS[kind].turns) < 3 or kind == "reverb":
        assert KINDS[kind].fixed(getattr(thing.forest_sensor, kind))


def test_a_bat_that_follows_says_so(props):
    thing, other = added("sonar"), bpy.data.objects["cube"]
    settings = thing.forest_sensor.sonar
    settings.follow = other.name
    assert KINDS["sonar"].fixed(settings) == "Move what it follows"
    settings.follow, settings.route = "", "bat.csv"
    assert KINDS["sonar"].fixed(settings) == "It flies its route"
    reverb = added("reverb").forest_sensor.reverb
    assert KINDS["reverb"].fixed(reverb) == "It sends alike to all sides"
    reverb.directivity = "cardioid"
    assert not KINDS["reverb"].fixed(reverb)
