"""Hills that are dragged in the view: a handle for each, kept at one with the numbers in the panel.

The numbers are the truth: settings, scene files and runs without a window read nothing else. A handle that
moves sets them, a number that is typed moves the handle. What is deleted in the view goes from the list as
well, for whoever deletes a hill's circle means the hill; a copy of a handle is a new hill. Blender reports
changes after it has evaluated them: where hill and handle differ then, the handle was moved last, because
setting a number moves the handle at once. The same holds after undo, so both come back together.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import bpy
from mathutils import Matrix

from ...blender.scene.layout import INTENSITY, find_part, part
from ...blender.show import intensity
from ..shell.views import is_rendering, redraw_panels, select_alone
from ..shell.words import title_of

SAME = 1e-6  # relative difference that is rounding: of a parent's matrix

_following = False  # handles are setting hills, which must not move handles
_active = ""  # the handle that was the active object when last looked


def renew(scene: bpy.types.Scene) -> None:
    """Remove the handles of hills that are gone, and make those that are missing."""
    props = scene.forest_sensing
    shown = props.drag_hills
    kept = {hill.handle for _, _, hill in _hills(props)} if shown else set()
    home = part(scene, INTENSITY) if shown else find_part(scene, INTENSITY)
    things = home.objects if home is not None else ()
    gone = [obj for obj in things if intensity.HANDLE_KEY in obj and obj not in kept]
    bpy.data.batch_remove(gone)
    for planting, _, hill in _hills(props):
        if shown and not _stands(hill.handle):
            name = f"{title_of(planting.species)} hill"
            hill.handle = intensity.new_handle(name, home, props.forest.terrain.base)
            intensity.place(hill.handle, hill.centre, hill.width)


def place(hill: Any) -> None:
    """Move a hill's handle to where its numbers are."""
    if hill.handle is not None and not _following:
        intensity.place(hill.handle, hill.centre, hill.width)


def choose(planting: Any, context: bpy.types.Context) -> None:
    """A hill that is chosen in the list becomes the active object."""
    global _active
    number = planting.active_gaussians
    if _following or context.mode != "OBJECT" or not 0 <= number < len(planting.gaussians):
        return
    obj, layer = planting.gaussians[number].handle, context.view_layer
    if obj is None or obj.name not in layer.objects or layer.objects.active == obj:
        return
    select_alone(layer, obj)
    _active = obj.name


@bpy.app.handlers.persistent
def follow(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Take into the hills what happened to their handles."""
    global _following
    props = scene.forest_sensing
    if not props.drag_hills or not scene.is_editable or is_rendering():
        return
    home = find_part(scene, INTENSITY)
    if home is None:  # gone with all handles: the hills stay, and are not taken for deleted later
        for _, _, hill in _hills(props):
            hill.handle = hill.handle if _stands(hill.handle) else None
        return
    _following = True
    try:
        for planting in props.plantings:
            for number in reversed(range(len(planting.gaussians))):
                handle = planting.gaussians[number].handle
                if handle is not None and not _stands(handle):
                    planting.gaussians.remove(number)
                    redraw_panels()
                    last = len(planting.gaussians) - 1
                    planting.active_gaussians = max(0, min(planting.active_gaussians, last))
        _adopt_copies(props, home)
        layer = depsgraph.view_layer
        moved = {u.id.name for u in depsgraph.updates if u.is_updated_transform}
        for _, _, hill in _hills(props):
            obj = hill.handle
            # One that is hidden may be reported as moved and is not evaluated.
            if obj is not None and obj.name in moved and obj.visible_get(view_layer=layer):
                _take(hill, obj.evaluated_get(depsgraph).matrix_world)
        _choose_active(props, layer.objects.active)
    finally:
        _following = False


HANDLERS = (("depsgraph_update_post", follow), ("frame_change_post", follow))


def _hills(props: Any) -> Iterator[tuple[Any, int, Any]]:
    """Every hill: (planting, number, hill)."""
    for planting in props.plantings:
        for number, hill in enumerate(planting.gaussians):
            yield planting, number, hill


def _stands(obj: bpy.types.Object | None) -> bool:
    """Return whether a handle is in a scene; one that was deleted lives on for the hill's sake alone."""
    return obj is not None and bool(obj.users_collection)


def _adopt_copies(props: Any, home: bpy.types.Collection) -> None:
    """A hill for every copy of a handle, as high as the one that was copied."""
    of_handle = {hill.handle: (planting, number) for planting, number, hill in _hills(props)}
    copies = [
        obj
        for obj in home.objects
        if obj not in of_handle and obj.get(intensity.HANDLE_KEY, obj.name) != obj.name
    ]
    origins = {obj.name: where for obj, where in of_handle.items() if obj is not None}
    for obj in copies:
        if obj[intensity.HANDLE_KEY] in origins:
            planting, number = origins[obj[intensity.HANDLE_KEY]]
            peak = planting.gaussians[number].peak
            hill = planting.gaussians.add()
            redraw_panels()
            hill.peak, hill.handle = peak, obj
    for obj in (*of_handle, *copies):
        if obj is not None:
            intensity.sign(obj)


def _take(hill: Any, matrix: Matrix) -> None:
    """Centre and width from where a handle stands in the world."""
    for name, value in zip(("centre", "width"), intensity.shape_of(matrix), strict=True):
        pairs = zip(getattr(hill, name), value, strict=True)
        if not all(math.isclose(a, b, rel_tol=SAME, abs_tol=SAME) for a, b in pairs):
            setattr(hill, name, value)


def _choose_active(props: Any, active: bpy.types.Object | None) -> None:
    """The handle that has just become the active object: its hill is the chosen one."""
    global _active
    name = active.name if active is not None and intensity.HANDLE_KEY in active else ""
    if name != _active:
        _active = name
        for number, planting in enumerate(props.plantings):
            for index, hill in enumerate(planting.gaussians):
                if name and hill.handle == active:
                    props.active_plantings, planting.active_gaussians = number, index
