"""Pace at which views are drawn: how much they can draw; slow ones are drawn only once while work goes on.

Blender draws a still view again and again, 8 times as it comes, to smooth its edges. Without a graphics card
each takes a second, in which everything waits, a job too. While one runs such views keep rough edges.
"""

from __future__ import annotations

import time
from typing import Any

import bpy
import gpu

BY_PROCESSOR = (
    "llvmpipe",
    "softpipe",
    "swrast",
    "swiftshader",
    "software",
    "lavapipe",
    "gdi generic",
)
LITTLE = 240_000  # triangles that a processor draws in less than a tenth of a second
SLOW = 0.2  # s that a view takes to draw; faster ones are left alone
LATELY = 1.5  # times as long ago as drawing took: then it is still being smoothed

_handles: list[Any] = []
_began = _took = _ended = 0.0
_usual = ""  # the smoothing of before; empty: it is not ours


def drawable() -> int:
    """Return how many triangles all stand-ins of a forest may have: fewer without a graphics card."""
    from ...blender.scene.forest import DRAWABLE

    if bpy.app.background:
        return DRAWABLE
    drawn_by = gpu.platform.renderer_get().lower()
    return LITTLE if any(name in drawn_by for name in BY_PROCESSOR) else DRAWABLE


def rough_edges() -> None:
    """Smooth views no longer, if one is being smoothed and that is slow."""
    global _usual
    system = bpy.context.preferences.system
    late = time.perf_counter() - _ended
    still = system.viewport_aa in ("OFF", "FXAA")  # these draw a view once
    if _usual or _took < SLOW or late > LATELY * _took or still:
        return
    _usual = system.viewport_aa
    _set("OFF")


def usual_edges() -> None:
    """Smooth views as before."""
    global _usual
    if _usual:
        _set(_usual)
    _usual = ""


def _set(smoothing: str) -> None:
    """Set how edges are smoothed; nothing that preferences are to be saved for."""
    preferences = bpy.context.preferences
    changed = preferences.is_dirty
    preferences.system.viewport_aa = smoothing  # type: ignore[assignment]
    preferences.is_dirty = changed


def register() -> None:
    """Watch views draw."""
    if bpy.app.background:
        return
    add = bpy.types.SpaceView3D.draw_handler_add
    _handles.append(add(_begin, (), "WINDOW", "PRE_VIEW"))
    _handles.append(add(_end, (), "WINDOW", "POST_PIXEL"))


def unregister() -> None:
    """Watch no longer, and leave smoothing as it was."""
    while _handles:
        bpy.types.SpaceView3D.draw_handler_remove(_handles.pop(), "WINDOW")
    usual_edges()


def _begin() -> None:
    global _began
    _began = time.perf_counter()


def _end() -> None:
    global _took, _ended
    _ended = time.perf_counter()
    _took = _ended - _began
