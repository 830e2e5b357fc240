"""Results of a frame range that are kept in the file: the timeline shows each frame's points and picture.

A result holds a mesh, a picture, a sound, what is exported, figures and a legend of every frame that ran.
When Blender goes to a frame, all that shows the result is given those of that frame, or of the last one
before it that ran.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

import bpy

from ...blender.scene.layout import CLOUD_KEY, FRAME_KEY


def blocks_of(result: Any) -> list[bpy.types.ID | None]:
    """The points, pictures and sounds that a result holds."""
    of_frames = ((each.points, each.picture, each.sound) for each in result.frames)
    return [result.picture, *(block for blocks in of_frames for block in blocks)]


def hold(result: Any, frame: int, sound: bpy.types.Sound | None) -> None:
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
    item.frame, item.said, item.found = frame, _said_of(result), result.found
    item.points, item.picture, item.sound = points, result.picture, sound


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
    """Remove those of these points, pictures and sounds that nothing shows or keeps any longer."""
    there = {block for block in blocks if block is not None}
    bpy.data.batch_remove([block for block in there if not block.users])


def show_frame(scene: bpy.types.Scene) -> None:
    """Give every result all that is kept of the frame that the scene is at."""
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
        speaker = scene.objects.get(result.name)
        if each.sound is not None and speaker is not None and speaker.type == "SPEAKER":
            speaker.data.sound = each.sound
        result.found = each.found
        if each.said and each.said != _said_of(result):  # nothing, in files of before
            _say(result, each.said)


@bpy.app.handlers.persistent
def _to_frame(scene: bpy.types.Scene, _depsgraph: object = None) -> None:
    if scene.is_editable:
        show_frame(scene)


HANDLERS = (("frame_change_pre", _to_frame),)
