"""Results are called as their sensors are: one whose sensor is renamed follows, with its points."""

from __future__ import annotations

from typing import Any

import bpy

from ...blender.scene.layout import CLOUD_KEY
from ...blender.sensors.objects import file_name, kind_of, sensors_of

_sensor_of: dict[tuple[int, str], int] = {}  # uid of a sensor, by scene and name of its result


def follow_names(scene: bpy.types.Scene) -> None:
    """Rename results whose sensor has another name by now."""
    results = scene.forest_sensing.results
    for result in results:
        key = scene.session_uid, result.name
        thing = scene.objects.get(result.name)
        if thing is not None and kind_of(thing) == result.kind:
            _sensor_of[key] = thing.session_uid
            continue
        uid = _sensor_of.pop(key, None)
        if uid is None:
            continue
        thing = next((t for t in sensors_of(scene) if t.session_uid == uid), None)
        if thing is not None and thing.name not in results:
            _rename(scene, result, thing.name)
            _sensor_of[scene.session_uid, thing.name] = uid


def _rename(scene: bpy.types.Scene, result: Any, name: str) -> None:
    """Call a result otherwise, and its points, unless the user has named those."""
    from ...blender.show.cloud import rename_cloud  # brings in scipy

    if result.title == result.name:
        result.title = name
    result.name = name
    shown = scene.objects.get(result.shown)
    if shown is not None and CLOUD_KEY in shown:
        rename_cloud(shown, file_name(name))
        result.shown = shown.name


def unregister() -> None:
    """Forget the sensors."""
    _sensor_of.clear()


@bpy.app.handlers.persistent
def _look(scene: bpy.types.Scene, _depsgraph: object) -> None:
    if scene.is_editable and len(scene.forest_sensing.results):
        follow_names(scene)


HANDLERS = (("depsgraph_update_post", _look),)
