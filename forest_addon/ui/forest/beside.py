"""A forest beside Blender's start cube: moved as a whole, with its sensors, so that the cube is not in it."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any

import bpy

from ... import spec

CUBE, CORNERS = "Cube", 8  # what Blender starts with
BESIDE = 2.0  # metres from the cube's middle to the ground that views show
PLACES = {"origin", "centre", "start", "position", "source", "receiver"}
OUTLINES = {"polygon", "holes"}
# What is given by files and objects of its own does not move with the rest.
NAMED = {"painted", "trees", "collection", "object", "file", "follow", "array_file"}
NAMED |= {"source_path", "receiver_path", "source_objects", "receiver_objects"}


def beside_cube(scene: bpy.types.Scene, settings: spec.Scene) -> spec.Scene:
    """Move a forest beside the start cube of a new file, if a window shows that; else it stays in place."""
    if bpy.app.background or bpy.data.filepath or not _is_start(scene) or _is_bound(settings):
        return settings
    from ...blender.scene.nodes import around

    field = settings.forest
    right = BESIDE + around(field) - field.origin[0]
    return moved(settings, (round(right, 1), -field.origin[1] - field.size[1] / 2))


def moved(settings: Any, way: tuple[float, float]) -> Any:
    """Return settings with all places in them moved on the map, metres."""
    changed = {}
    for field in fields(settings):
        value = getattr(settings, field.name)
        if isinstance(settings, spec.Rows):
            break  # they start at a place of the field
        if field.name in PLACES and isinstance(value, tuple):
            changed[field.name] = _place(value, way)
        elif field.name in OUTLINES:
            changed[field.name] = _outline(value, way)
        elif is_dataclass(value):
            changed[field.name] = moved(value, way)
        elif isinstance(value, tuple) and any(map(is_dataclass, value)):
            changed[field.name] = tuple(moved(item, way) for item in value)
    return replace(settings, **changed)


def _place(place: tuple[float, ...], way: tuple[float, float]) -> tuple[float, ...]:
    return (place[0] + way[0], place[1] + way[1], *place[2:])


def _outline(corners: tuple[Any, ...], way: tuple[float, float]) -> tuple[Any, ...]:
    """An outline, or several, moved."""
    if corners and isinstance(corners[0][0], tuple):
        return tuple(_outline(ring, way) for ring in corners)
    return tuple(_place(corner, way) for corner in corners)


def _is_start(scene: bpy.types.Scene) -> bool:
    """Return whether the start cube stands where Blender has put it."""
    cube = scene.objects.get(CUBE)
    return (
        cube is not None
        and cube.type == "MESH"
        and len(cube.data.vertices) == CORNERS
        and not any(cube.location)
    )


def _is_bound(settings: Any) -> bool:
    """Return whether anything in settings is placed by a file or an object."""
    for field in fields(settings):
        value = getattr(settings, field.name)
        if field.name in NAMED and value and not isinstance(value, int):
            return True
        parts = value if isinstance(value, tuple) else (value,)
        if any(is_dataclass(part) and _is_bound(part) for part in parts):
            return True
    return False
