"""Results of a frame range that are kept in the file: the timeline shows each frame's points and picture.

A result holds a mesh and a picture of every frame that ran. When Blender goes to a frame, the object of the
points is given the mesh of that frame, or of the last one before it that ran.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import bpy

from ...blender.layout import CLOUD_KEY, FRAME_KEY

Kept = tuple[int, bpy.types.Mesh | None, bpy.types.Image | None]


def of_result(result: Any) -> list[Kept]:
    """What is kept of each frame: its number, points, picture."""
    return [(each.frame, each.points, each.picture) for each in result.frames]


def blocks_of(result: Any) -> list[bpy.types.ID | None]:
    """The points and pictures that a result holds."""
    return [result.picture, *(block for each in of_result(result) for block in each[1:])]


def hold(result: Any, earlier: Iterable[Kept], frame: int) -> None:
    """Keep what a result shows now for a frame, beside what was kept of other frames before."""
    shown = bpy.data.objects.get(result.shown)
    points = shown.data if shown is not None else None
    if points is not None:
        points[FRAME_KEY] = frame
    ours = [each for each in earlier if each[0] != frame] + [(frame, points, result.picture)]
    result.frames.clear()
    for number, data, picture in sorted(ours, key=lambda each: each[0]):
        item = result.frames.add()
        item.frame, item.points, item.picture = number, data, picture


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
