"""Files with settings of the panel: which layout of them they have, and what is renewed when they are saved.

A scene that is saved says which layout its settings have. A later layout than this version knows is told in
the panel until the user takes note, and in the console. A file without settings of ours is left alone.
"""

from __future__ import annotations

import logging
from typing import Any

import bpy

from ...blender.sensors import objects as sensors
from ..shell.running import Button
from ..shell.words import say
from . import references

LAYOUT = 3  # how a scene keeps its settings
KEY = "forest_sensing"  # of the scene's settings, as Blender stores them

log = logging.getLogger(__name__)


class FOREST_OT_take_note(Button, bpy.types.Operator):
    """Remove this message"""

    bl_idname = "forest.take_note"
    bl_label = "Dismiss"

    @classmethod
    def description(cls, context: bpy.types.Context, _properties: Any) -> str:
        notice = context.scene.forest_sensing.notice
        return say("{notice}. Press to take this line away", notice=notice)

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        reason = super().obstacle(context)
        if not reason and not context.scene.forest_sensing.notice:
            reason = say("There is nothing to take note of")
        return reason

    def act(self, context: bpy.types.Context) -> str:
        context.scene.forest_sensing.property_unset("notice")
        return ""


def draw_notice(panel: bpy.types.UILayout, props: Any) -> None:
    """One line of what happened to this file, with the button that takes it away."""
    row = panel.row(align=True)
    row.label(text=props.notice.partition(":")[0], icon="INFO")
    row.operator("forest.take_note", text="", icon="X")


def register() -> None:
    """Look at the file that is open by now."""
    bpy.app.timers.register(_look_at_all, first_interval=0.0)


def unregister() -> None:
    """Look at it no longer."""
    if bpy.app.timers.is_registered(_look_at_all):
        bpy.app.timers.unregister(_look_at_all)


@bpy.app.handlers.persistent
def _look_at_all(*_: object) -> None:
    """Tell of scenes that a newer version has saved."""
    for scene in bpy.data.scenes:
        if not scene.is_editable or not _has_settings(scene):
            continue
        if scene.forest_sensing.layout > LAYOUT:
            notice = say(
                "Saved by a newer version: it keeps settings in layout {found}, this version knows {known}: "
                "what is new in it has no effect here. Update Forest Sensing",
                found=scene.forest_sensing.layout,
                known=LAYOUT,
            )
            scene.forest_sensing.notice = notice
            log.warning("Forest Sensing, scene %s. %s", scene.name, notice)


@bpy.app.handlers.persistent
def _sign(*_: object) -> None:
    """Note today's layout in every scene that is about to be saved with settings of ours."""
    for scene in bpy.data.scenes:
        if scene.is_editable and _has_settings(scene):
            props = scene.forest_sensing
            props.layout = max(LAYOUT, props.layout)
            things = sensors.sensors_of(scene)
            of_sensors = (getattr(t.forest_sensor, sensors.kind_of(t)) for t in things)
            references.renew_texts([props.forest.terrain, *props.plantings, *of_sensors])


def _has_settings(scene: bpy.types.Scene) -> bool:
    """Return whether settings of ours are stored in a scene and any was set."""
    # Blender 5 keeps them apart from custom properties
    apart = hasattr(scene, "bl_system_properties_get")
    home = scene.bl_system_properties_get() if apart else scene
    stored = None if home is None else home.get(KEY)
    return stored is not None and _holds_values(stored)


def _holds_values(stored: Any) -> bool:
    """Return whether anything was set: to draw a panel makes empty groups."""
    return any(
        _holds_values(value) if hasattr(value, "keys") else True for value in stored.values()
    )


HANDLERS = (
    ("load_post", _look_at_all),
    ("blend_import_post", _look_at_all),
    ("save_pre", _sign),
)
