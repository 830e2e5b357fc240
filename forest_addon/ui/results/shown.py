"""Results whose points views show: one at a time, unless several are asked for."""

from __future__ import annotations

from typing import Any, ClassVar

import bpy

from ...blender.scene.layout import CLOUD_KEY
from ..shell.selection import show
from ..shell.words import say


class FOREST_OT_show_result(bpy.types.Operator):
    """Show these points alone, or hide them; with Shift beside those that are shown"""

    bl_idname = "forest.show_result"
    bl_label = "Show Points"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}
    result: bpy.props.StringProperty(options={"HIDDEN"})
    more: bpy.props.BoolProperty(
        name="Beside Others", description="Other points stay as they are", options={"SKIP_SAVE"}
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.more = event.shift
        return self.execute(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        results = context.scene.forest_sensing.results
        thing = points_of(results[self.result]) if self.result in results else None
        if thing is None:
            problem = say("{name} has no points here. Run its sensor again", name=self.result)
            self.report({"ERROR"}, problem)
            return {"CANCELLED"}
        if is_seen(thing):
            thing.hide_set(True)
        else:
            show_result(context, results[self.result], self.more)
        return {"FINISHED"}


def points_of(result: Any) -> bpy.types.Object | None:
    """The object of a result's points in its scene, None where there is none."""
    return result.id_data.objects.get(result.shown) if result.shown else None


def is_seen(thing: bpy.types.Object) -> bool:
    """Return whether the view layer shows an object."""
    return bool(thing.visible_get())


def show_result(context: bpy.types.Context, result: Any, more: bool = False) -> None:
    """Show the points of a result, and hide those of others. more : those stay as they are."""
    thing = points_of(result)
    if thing is None:
        return
    show(context, thing)  # not selected: all points would be orange
    for other in () if more else context.scene.forest_sensing.results:
        points = points_of(other)
        if points is not None and points != thing and CLOUD_KEY in points and is_seen(points):
            points.hide_set(True)


CLASSES = (FOREST_OT_show_result,)
