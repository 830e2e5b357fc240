"""Adding sensors to the scene and removing them."""

from __future__ import annotations

from typing import ClassVar

import bpy

from ... import spec
from ...blender import sensors
from ..chosen import choose_sensor, chosen_sensor
from ..exchange import add_sensor
from ..running import InOwnScene
from ..words import say

# What a new sensor has that is not the default, which keeps scenes of before as they were.
NEW = {"reverb": {"model": "forest", "surface": "forest floor"}}


class FOREST_OT_add_sensor(InOwnScene, bpy.types.Operator):
    """Add a sensor as an object: move it, turn it, parent it, key it"""

    bl_idname = "forest.add_sensor"
    bl_label = "Add Sensor"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    kind: bpy.props.EnumProperty(
        name="Kind",
        items=[(kind, cls.TITLE, cls.__doc__ or "") for kind, cls in spec.SENSORS.items()],
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = spec.SENSORS[self.kind](**NEW.get(self.kind, {}))
        thing = add_sensor(context.scene, settings)
        if context.scene.cursor.location.length:
            shift = context.scene.cursor.location - thing.location
            thing.location = context.scene.cursor.location
            thing.location.z = max(thing.location.z, _height_of(settings))
            receiver = sensors.receiver_of(thing)
            if receiver is not None:
                receiver.location += shift
                receiver.location.z = thing.location.z
        context.view_layer.update()
        choose_sensor(context, thing)
        return {"FINISHED"}


class FOREST_OT_remove_sensor(InOwnScene, bpy.types.Operator):
    """Remove the chosen sensor; what it found stays"""

    bl_idname = "forest.remove_sensor"
    bl_label = "Remove Sensor"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not super().poll(context):
            return False
        if chosen_sensor(context) is None:
            cls.poll_message_set(say("There is no sensor to remove"))
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        sensors.remove_sensor(chosen_sensor(context))
        return {"FINISHED"}


def _height_of(settings: spec.Settings) -> float:
    """How high above z = 0 a new sensor stands."""
    place = getattr(settings, "position", None) or getattr(settings, "source", (0.0, 0.0, 2.0))
    return float(place[2])


CLASSES = (FOREST_OT_add_sensor, FOREST_OT_remove_sensor)
