"""Results of a frame range that are kept in the file: the timeline shows each frame's points and picture.

A result holds a mesh, a picture, figures and a legend of every frame that ran. When Blender goes to a frame,
the object of the points is given the mesh of that frame, or of the last one before it that ran, and the panel
says what was found there.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

import bpy

from ...blender.scene.layout import CLOUD_KEY, FRAME_KEY

Kept = tuple[int, bpy.types.Mesh | None, bpy.types.Image | None, str]


def of_result(result: Any) -> list[Kept]:
    """Return what is kept of each frame: its number, points, picture, what is said of it."""
    return [(each.frame, each.points, each.picture, each.said) for each in result.frames]


def blocks_of(result: Any) -> list[bpy.types.ID | None]:
    """The points and pictures that a result holds."""
    return [result.picture, *(block for each in of_result(result) for block in each[1:3])]


def hold(result: Any, earlier: Iterable[Kept], frame: int) -> None:
    """Keep what a result shows now for a frame, beside what was kept of other frames before."""
    shown = bpy.data.objects.get(result.shown)
    points = shown.data if shown is not None else None
    if points is not None:
        points[FRAME_KEY] = frame
    ours = [each for each in earlier if each[0] != frame]
    ours.append((frame, points, result.picture, _said_of(result)))
    result.frames.clear()
    for number, data, picture, said in sorted(ours, key=lambda each: each[0]):
        item = result.frames.add()
        item.frame, item.points, item.picture, item.said = number, data, picture, said


def tell_again(result: Any, frame: int) -> None:
    """Note what a result says by now, where it is kept for this frame."""
    for each in result.frames:
        if each.frame == frame:
            each.said = _said_of(result)


def _said_of(result: Any) -> str:
    """Figures and legend of a result as one text: hundreds of frames have hundreds of lines each."""
    figures = [(each.name, each.value, each.made_of) for each in result.figures]
    legend = [(each.name, each.choice, *each.colour) for each in result.legend]
    return json.dumps((figures, legend))


def _say(result: Any, said: str) -> None:
    """Have a result say what was noted of a frame."""
    figures, legend = json.loads(said)
    result.figures.clear()
    result.legend.clear()
    for name, value, made_of in figures:
        item = result.figures.add()
        item.name, item.value, item.made_of = name, value, made_of
    for name, choice, *colour in legend:
        item = result.legend.add()
        item.name, item.choice, item.colour = name, choice, colour


def begin(scene: bpy.types.Scene, name: str) -> None:
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
    """Remove those of these points and pictures that nothing shows or keeps any longer."""
    there = {block for block in blocks if block is not None}
    bpy.data.batch_remove([block for block in there if not block.users])


def show_frame(scene: bpy.types.Scene) -> None:
    """Give every result the points and the picture of the frame that the scene is at."""
    for result in scene.forest_sensing.results:
        if not result.frames:
            continue
        now = scene.frame_current
        before = [each for each in result.frames if each.frame <= now]
        each = before[-1] if before else result.frames[0]
        thing = scene.objects.get(result.shown)
        ours = thing is not None and CLOUD_KEY in thing and FRAME_KEY in thing.data
        if ours and each.points is not None and thing.data != each.points:
            thing.data = each.points
        if each.picture is not None and result.picture != each.picture:
            result.picture = each.picture
        if each.said and each.said != _said_of(result):  # nothing, in files of before
            _say(result, each.said)


def register() -> None:
    """Hear of frames, before Blender evaluates them."""
    bpy.app.handlers.frame_change_pre.append(_to_frame)


def unregister() -> None:
    """Take the handler back."""
    if _to_frame in bpy.app.handlers.frame_change_pre:
        bpy.app.handlers.frame_change_pre.remove(_to_frame)


@bpy.app.handlers.persistent
def _to_frame(scene: bpy.types.Scene, _depsgraph: object = None) -> None:
    if scene.is_editable:
        show_frame(scene)
