"""The list of sensors, and those of what some of them have: poses to pass, further sources and receivers."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import bpy

from ...blender.sensors.objects import kind_of
from ..settings import references
from ..settings.drawing import icon_of
from ..settings.lists import Listed, Row, buttons, rows
from ..shell.chosen import chosen_sensor
from ..shell.words import keep

Context = bpy.types.Context


class FOREST_UL_sensors(bpy.types.UIList):
    """Sensors of the scene, which are objects."""

    def draw_item(self, context, layout, data, item, icon, active, name, index=0) -> None:
        layout.prop(item, "name", text="", emboss=False, icon=icon_of(kind_of(item)))
        run = layout.operator("forest.run", text="", icon="PLAY", emboss=False)
        run.sensor, run.frames = item.name, "THIS"

    def filter_items(self, context, data, name) -> tuple[list[int], list[int]]:
        things = getattr(data, name)
        return [self.bitflag_filter_item if kind_of(thing) else 0 for thing in things], []


def _of_sensor(kind: str) -> Callable[[Context], Any]:
    """The settings of the chosen sensor, if it is of a kind."""

    def settings(context: Context) -> Any:
        thing = chosen_sensor(context)
        fits = thing is not None and kind_of(thing) == kind
        return getattr(thing.forest_sensor, kind) if fits else None

    return settings


NO_SCANNER = keep("Choose a moving scanner in the list of sensors first")
NO_REVERB = keep("Choose a reverb in the list of sensors first")


def _say_names(name: str, reverb: Any) -> None:
    references.listed_anew(reverb, name)


POSES = Listed("poses", _of_sensor("mobile"), NO_SCANNER)
SOURCES = Listed("sources", _of_sensor("reverb"), NO_REVERB)
RECEIVERS = Listed("receivers", _of_sensor("reverb"), NO_REVERB)
SOURCE_OBJECTS, RECEIVER_OBJECTS = (
    Listed(f"{name}_pointers", _of_sensor("reverb"), NO_REVERB, partial(_say_names, name))
    for name in ("source_objects", "receiver_objects")
)


def _pose_row(item: Any) -> Row:
    x, y, z = item.position
    return Row(f"{x:g}, {y:g}, {z:g} m", "EMPTY_ARROWS", f"{item.time:g} s")


def _place_row(item: Any) -> Row:
    x, y, z = item.position
    return Row(f"{x:g}, {y:g}, {z:g} m", "EMPTY_AXIS")


def _object_row(item: Any) -> Row:
    lost = item.thing is None
    return Row(item.name or "?" if lost else item.thing.name, "ERROR" if lost else "OBJECT_DATA")


def _start_pose(pose: Any, context: Context) -> None:
    poses = POSES.owner(context).poses
    if len(poses) < 2:
        return
    last = poses[len(poses) - 2]
    pose.time, pose.heading_deg = last.time + 10, last.heading_deg
    x, y, z = last.position
    heading = math.radians(last.heading_deg)
    pose.position = (x + 10 * math.cos(heading), y + 10 * math.sin(heading), z)


def _start_place(place: Any, context: Context) -> None:
    field = context.scene.forest_sensing.forest
    x, y = (o + s / 2 for o, s in zip(field.origin, field.size, strict=True))
    place.position = (x, y, place.position[2])


OF_POSE = "Add a place that the scanner passes, ten seconds and ten metres after the last"
OF_SOURCE = "Add one more source, in the middle of the field"
OF_SPEAKER = "Add a Speaker of the scene as one more source; pick it below"
OF_EAR = "Add an Empty or a Camera of the scene as one more receiver; pick it below"
OF_RECEIVER = "Add one more receiver, in the middle of the field"

CLASSES = (
    FOREST_UL_sensors,
    rows("poses", "Poses of a moving scanner", _pose_row),
    rows("places", "Further sources or receivers of a reverb", _place_row),
    *buttons("pose", "Pose", POSES, OF_POSE, _start_pose),
    *buttons("source", "Source", SOURCES, OF_SOURCE, _start_place),
    *buttons("receiver", "Receiver", RECEIVERS, OF_RECEIVER, _start_place),
    rows("objects", "Objects that are further sources or receivers of a reverb", _object_row),
    *buttons("source_object", "Source Object", SOURCE_OBJECTS, OF_SPEAKER),
    *buttons("receiver_object", "Receiver Object", RECEIVER_OBJECTS, OF_EAR),
)
