"""Frames a second while a view orbits a forest: ``blender forest.blend --python tests/gui/orbit.py``.

It needs a window; Xvfb and software rendering will do. The view shows all of the forest in Solid shading
and turns by 30° a frame; what is printed is the median of the frames.
"""

import math
import statistics
import sys
import time

import bpy
from mathutils import Euler, Vector

FRAMES = 12


def orbit() -> None:
    """Turn the first 3D view, print, leave Blender."""
    window = bpy.context.window_manager.windows[0]
    area = next(a for a in window.screen.areas if a.type == "VIEW_3D")
    region = next(r for r in area.regions if r.type == "WINDOW")
    area.spaces[0].shading.type = "SOLID"
    area.spaces[0].clip_end = 1e5
    view = area.spaces[0].region_3d
    view.view_perspective = "PERSP"
    view.view_location, view.view_distance = _whole_forest()
    taken, used = [], []
    with bpy.context.temp_override(window=window, area=area, region=region):
        for frame in range(FRAMES):
            view.view_rotation = Euler(
                (math.radians(65), 0, math.radians(30 * frame))
            ).to_quaternion()
            view.update()
            start, work = time.perf_counter(), time.process_time()
            bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)
            taken.append(time.perf_counter() - start)
            used.append(time.process_time() - work)
    seconds = statistics.median(taken)
    print(f"{1 / seconds:.2f} frames/s; {statistics.median(used):.2f} CPU seconds a frame")
    sys.stdout.flush()
    bpy.ops.wm.quit_blender()


def _whole_forest() -> tuple[Vector, float]:
    """The middle of the ground, and its largest extent."""
    corners = [
        thing.matrix_world @ Vector(corner)
        for thing in bpy.data.collections["Ground"].objects
        for corner in thing.bound_box
    ]
    low = Vector(min(c[k] for c in corners) for k in range(3))
    high = Vector(max(c[k] for c in corners) for k in range(3))
    return (low + high) / 2, 1.1 * max(high - low)


bpy.app.timers.register(orbit, first_interval=2.0)
