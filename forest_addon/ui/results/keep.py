"""Results that are kept: frame by frame, by the names of their sensors, and which of them views show.

The panel keeps the last result of each kind, the newest first; views show the points of one at a time, unless
several are asked for. Of a frame range, a result holds a mesh, a picture, a sound, what is exported, figures
and a legend of every frame that ran. When Blender goes to a frame, all that shows the result is given those
of that frame, or of the last one before it that ran. A result whose sensor is renamed follows, with its
points.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any

import bpy

from ...blender.scene.layout import CLOUD_KEY, FRAME_KEY
from ...blender.sensors.objects import file_name, sensors_of
from ..shell.running import Reading, button
from ..shell.views import is_rendering, redraw_panels, show
from ..shell.words import say


def blocks_of(result: Any) -> list[bpy.types.ID | None]:
    """The points, pictures and sounds that a result holds."""
    of_frames = ((each.points, each.picture, each.sound) for each in result.frames)
    return [result.picture, *(block for blocks in of_frames for block in blocks)]


def hold_frame(result: Any, frame: int, sound: bpy.types.Sound | None) -> None:
    """Keep what a result shows now for a frame, beside what is kept of others. sound : of its Speaker."""
    shown = bpy.data.objects.get(result.shown)
    points = shown.data if shown is not None else None
    if points is not None:
        points[FRAME_KEY] = frame
    numbers = [each.frame for each in result.frames]
    if frame in numbers:
        item = result.frames[numbers.index(frame)]
    else:
        result.frames.add()
        at = sum(number < frame for number in numbers)
        result.frames.move(len(numbers), at)
        item = result.frames[at]
    item.frame, item.said, item.found = frame, said_of(result), result.found
    item.points, item.picture, item.sound = points, result.picture, sound


def said_of(result: Any) -> str:
    """Figures and legend of a result as one text: hundreds of frames have hundreds of lines each."""
    figures = [(each.name, each.value, each.made_of) for each in result.figures]
    legend = [(each.name, each.choice, *each.colour) for each in result.legend]
    return json.dumps((figures, legend))


def set_figures(result: Any, figures: Iterable[tuple[str, str, str]]) -> None:
    """Add figures to a result, or change them: name, value, and what says the value in another language."""
    for name, value, made_of in figures:
        item = result.figures.get(name) or result.figures.add()
        item.name, item.value, item.made_of = name, value, made_of


def set_legend(result: Any, legend: Iterable[tuple[str, str, Sequence[float]]]) -> None:
    """Have a result explain its colours: choice of the menu, name and colour of each."""
    result.legend.clear()
    for choice, name, colour in legend:
        item = result.legend.add()
        item.name, item.choice, item.colour = name, choice, colour


def begin_frames(scene: bpy.types.Scene, name: str) -> None:
    """Keep nothing of earlier frames of a sensor any longer, but what is shown now."""
    result = scene.forest_sensing.results.get(name)
    if result is None:
        return
    left = blocks_of(result)
    for each in result.frames:
        if each.points is not None:
            del each.points[FRAME_KEY]  # it is points as any other now
    result.frames.clear()
    let_go(left)


def let_go(blocks: Iterable[bpy.types.ID | None]) -> None:
    """Remove those of these points, pictures and sounds that nothing shows or keeps any longer."""
    there = {block for block in blocks if block is not None}
    bpy.data.batch_remove([block for block in there if not block.users])


@bpy.app.handlers.persistent
def _to_frame(scene: bpy.types.Scene, _depsgraph: object = None) -> None:
    if scene.is_editable:
        for result in scene.forest_sensing.results:
            if not result.frames:
                continue
            now = scene.frame_current
            before = [each for each in result.frames if each.frame <= now]
            each = before[-1] if before else result.frames[0]
            obj = scene.objects.get(result.shown)
            ours = obj is not None and CLOUD_KEY in obj and FRAME_KEY in obj.data
            if ours and each.points is not None and obj.data != each.points:
                obj.data = each.points
            speaker = scene.objects.get(result.name)
            if each.sound is not None and speaker is not None and speaker.type == "SPEAKER":
                speaker.data.sound = each.sound
            if is_rendering():
                continue
            if each.picture is not None and result.picture != each.picture:
                result.picture = each.picture
            result.found = each.found
            if each.said and each.said != said_of(result):  # nothing, in files of before
                figures, legend = json.loads(each.said)
                result.figures.clear()
                set_figures(result, figures)
                set_legend(result, ((choice, name, colour) for name, choice, *colour in legend))
                redraw_panels()


SENSOR_KEY = "forest_result"  # on a sensor: the name of its result


def follow_names(scene: bpy.types.Scene) -> None:
    """Rename results whose sensor has another name by now."""
    results = scene.forest_sensing.results
    for obj in sensors_of(scene):
        told, name = obj.get(SENSOR_KEY, obj.name), obj.name
        if told != name and told in scene.objects:  # it is a copy
            del obj[SENSOR_KEY]
        elif told in results and name not in results:
            result = results[told]
            from ...blender.show.cloud import rename_cloud  # brings in scipy

            if result.title == result.name:
                result.title = name
            result.name = name
            shown = scene.objects.get(result.shown)
            if shown is not None and CLOUD_KEY in shown:
                rename_cloud(shown, file_name(name))
                result.shown = shown.name
            obj[SENSOR_KEY] = name


@bpy.app.handlers.persistent
def _look(scene: bpy.types.Scene, _depsgraph: object) -> None:
    if scene.is_editable and len(scene.forest_sensing.results):
        follow_names(scene)


HANDLERS = (("frame_change_pre", _to_frame), ("depsgraph_update_post", _look))


def _beside_with_shift(
    pressed: bpy.types.Operator, context: bpy.types.Context, event: bpy.types.Event
) -> set[str]:
    pressed.more = event.shift
    return set(pressed.execute(context))


@button(
    "Show Points",
    Reading,
    bl_options={"REGISTER", "UNDO"},
    invoke=_beside_with_shift,
    result=bpy.props.StringProperty(options={"HIDDEN"}),
    more=bpy.props.BoolProperty(
        name="Beside Others", description="Other points stay as they are", options={"SKIP_SAVE"}
    ),
)
def _show_result(pressed: bpy.types.Operator, context: bpy.types.Context) -> str:
    """Show these points alone, or hide them; with Shift beside those that are shown"""
    results = context.scene.forest_sensing.results
    obj = points_of(results[pressed.result]) if pressed.result in results else None
    if obj is None:
        raise ValueError(
            say("{name} has no points here. Run its sensor again", name=pressed.result)
        )
    if obj.visible_get():
        obj.hide_set(True)
    else:
        show_result(context, results[pressed.result], pressed.more)
    return ""


def points_of(result: Any) -> bpy.types.Object | None:
    """The object of a result's points in its scene, None where there is none."""
    return result.id_data.objects.get(result.shown) if result.shown else None


def record_of(result: Any) -> Any:
    """Record of results of this kind; None of the forest, and of no result."""
    from ...results.kinds import RESULTS as KINDS_OF_RESULTS

    return None if result is None else KINDS_OF_RESULTS.get(result.kind)


def show_result(context: bpy.types.Context, result: Any, more: bool = False) -> None:
    """Show the points of a result, and hide those of others. more : those stay as they are."""
    obj = points_of(result)
    if obj is None:
        return
    show(context, obj)  # not selected: all points would be orange
    for other in () if more else context.scene.forest_sensing.results:
        points = points_of(other)
        if points is not None and points != obj and CLOUD_KEY in points and points.visible_get():
            points.hide_set(True)
