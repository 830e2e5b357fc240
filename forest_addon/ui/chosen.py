"""What is chosen in the panel's lists."""

from __future__ import annotations

from typing import Any

import bpy

from ..blender import sensors


def chosen(owner: Any, name: str) -> Any:
    """The item of a list that is chosen, the last one where fewer are left; the list must hold one."""
    listed = getattr(owner, name)
    return listed[min(getattr(owner, f"active_{name}"), len(listed) - 1)]


def chosen_planting(props: Any) -> Any:
    """The planting that is chosen in the list, None where there is none."""
    active = props.active_plantings
    return props.plantings[active] if 0 <= active < len(props.plantings) else None


def chosen_sensor(context: bpy.types.Context) -> bpy.types.Object | None:
    """The sensor that the panel shows: the active object if it is one, else the list's."""
    thing = context.view_layer.objects.active
    if thing is not None and sensors.kind_of(thing):
        return thing
    home = sensors.home_of(context.scene)
    number = context.scene.forest_sensing.active_sensor
    if home is None or not 0 <= number < len(home.objects):
        return None
    thing = home.objects[number]
    return thing if sensors.kind_of(thing) else None
