"""A flyer in Blender: put there with sensors that go along with it, flown by a policy, and animated.

The flyer is an empty whose X axis looks ahead; a LiDAR and a sonar follow it, so that what they find along an
animated flight can be run like that of any other sensor. *Fly* goes from where the flyer stands, and keys its
place and heading; the trail is coloured by how near anything was.
"""

from __future__ import annotations

from math import degrees
from pathlib import Path
from typing import Any

import bpy

from ... import spec
from ...blender.jobs import Task, Work
from ...blender.scene.layout import RESULTS, part
from ..settings.drawing import BIG, OfSensors, draw_settings, split
from ..settings.exchange import add_sensor, to_spec
from ..shell.running import Button, Working, button, getting_ready, long_button, panel
from ..shell.views import choose_sensor
from ..shell.words import say

FLYER_KEY = "forest_flyer"
NAME = "Flyer"
POLICIES = (
    ("gap", "By the Gap", "Follow the gap that costs least to turn to, by LiDAR"),
    (
        "echo",
        "By Two Ears",
        "Turn from the ear that hears the louder echo (Vanderelst et al. 2015)",
    ),
    ("straight", "Straight On", "Towards the aim, whatever is in the way"),
)


@button("Flight", Button)
def add_flight(_button: Button, context: bpy.types.Context) -> str:
    """Add a flyer with a LiDAR and two ears that go along with it"""
    from ...flight.senses import LIDAR, SONAR

    scene = context.scene
    obj = bpy.data.objects.new(NAME, None)
    obj.empty_display_type, obj.empty_display_size = "ARROWS", 0.5
    obj[FLYER_KEY] = True
    obj.location = scene.cursor.location
    obj.location.z = max(obj.location.z, scene.forest_sensing.flight.height)
    scene.collection.objects.link(obj)
    for settings in (LIDAR.changed(poses=()), SONAR):
        made = add_sensor(scene, settings.changed(follow=obj.name))
        made.name = f"{obj.name} {settings.name}"
    context.view_layer.update()
    choose_sensor(context, made)
    return ""


def flyer_of(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The scene's flyer, the active object if it is one."""
    active = bpy.context.view_layer.objects.active
    if active is not None and FLYER_KEY in active:
        return active
    return next((obj for obj in scene.objects if FLYER_KEY in obj), None)


@long_button(
    "Fly",
    Working,
    policy=bpy.props.EnumProperty(
        name="Policy", description="How it finds its way", items=POLICIES
    ),
    seed=bpy.props.IntProperty(name="Seed", min=0, description="Of what is left to chance"),
)
def _fly(pressed: bpy.types.Operator, context: bpy.types.Context) -> Work:
    """Fly from where the flyer stands to its aim, through all that stands in the scene, and animate it"""
    scene = context.scene
    obj = flyer_of(scene)
    if obj is None:
        raise spec.SpecError("", say("There is no flyer yet; add one by Add > Forest > Flight"))
    yield getting_ready("api", "flight.flying", "flight.policies", "flight.woods")
    from ...api import World
    from ...blender.show.trails import show_flights
    from ...flight.flying import fly
    from ...flight.policies import policy_of
    from ...flight.senses import LIDAR, SONAR, EarSense, LidarSense
    from ...flight.simulation import Flyers
    from ...flight.woods import Stock

    settings = to_spec(scene, [])
    place, heading = obj.matrix_world.translation, obj.matrix_world.to_euler().z
    flight = settings.flight.changed(start=tuple(place), heading_deg=degrees(heading))
    settings = settings.changed(flight=flight)
    world = World(settings, Path(bpy.path.abspath(scene.forest_sensing.folder)), None, scene)
    stock = Stock.standing(world)

    def flown(_tell: Any) -> Any:
        lidar, ears = LidarSense(LIDAR), EarSense(SONAR, settings.air)
        pilot = policy_of(pressed.policy, flight, lidar, ears)
        hears = "sonar" in pilot.sensors
        flyers = Flyers(flight, 1, None if hears else lidar, ears if hears else None)
        flyers.enter(stock.surroundings())
        return fly(flyers, pilot, [pressed.seed])[0]

    if settings.wind.speed > 0:
        pressed.report(
            {"WARNING"}, say("Scenes in Blender carry flyers by their steady wind alone")
        )
    track = yield Task(say("flying"), flown)
    show_flights(part(scene, RESULTS), [track], name=obj.name, flyer=obj)
    seconds, way = track.seconds, track.flown
    return {
        "arrived": say(
            "It arrives after {seconds:.1f} s and {way:.0f} m", seconds=seconds, way=way
        ),
        "crashed": say(
            "It touches something after {seconds:.1f} s and {way:.0f} m",
            seconds=seconds,
            way=way,
        ),
        "late": say(
            "It is still on its way after {seconds:.1f} s and {way:.0f} m",
            seconds=seconds,
            way=way,
        ),
    }[track.end]


@panel(spec.Flight.TITLE, OfSensors)
def flight(tab: bpy.types.Panel, context: bpy.types.Context) -> None:
    """Panel of a flyer: what its body can do, and where it is to go."""
    row = tab.layout.row(align=True)
    row.scale_y = BIG
    if flyer_of(context.scene) is None:
        row.operator("forest.add_flight", text="Add a Flyer", icon="EMPTY_SINGLE_ARROW")
    else:
        row.operator_menu_enum("forest.fly", "policy", text="Fly", icon="PLAY")
    draw_settings(split(tab.layout), context.scene.forest_sensing.flight)
