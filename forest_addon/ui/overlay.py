"""Overlays of the 3D view, from the bottom up: intensity, outlines of sensors, points of results.

Each drawing makes anew what Blender says has changed and hands finished batches to the graphics card. One
that fails is left out until something changes, and takes no other along. Nothing is added to the scene, and
nothing is left when the add-on is disabled.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from typing import Any, Protocol

import bpy
import gpu

from .forest import intensity
from .results import points
from .sensors import outlines
from .settings.drawing import OnceStarted, split
from .settings.exchange import forestless


class Drawing(Protocol):
    """One layer of what is drawn."""

    def draw(self, context: bpy.types.Context, /) -> None:
        """Draw it, if the scene asks for it."""

    def forget(self, depsgraph: bpy.types.Depsgraph | None = None, /) -> None:
        """Make anew what has changed; without a depsgraph, all."""


DRAWINGS: tuple[Drawing, ...] = (intensity, outlines, points)

log = logging.getLogger(__name__)

_handle: Any = None
_broken: set[Drawing] = set()  # what failed since something changed


class FOREST_PT_view(OnceStarted, bpy.types.Panel):
    """Switches of the overlays of the 3D view."""

    bl_label = "Overlays"
    bl_parent_id = "FOREST_PT_results"

    def draw(self, context: bpy.types.Context) -> None:
        props = context.scene.forest_sensing
        row = self.layout.row(align=True)
        for name in ("show_sensors", "show_intensity", "show_points"):
            if name != "show_intensity" or not forestless(props):
                row.prop(props, name, toggle=True)
        if context.scene.forest_sensing.show_points:
            split(self.layout).prop(context.scene.forest_sensing, "point_size")


CLASSES = (FOREST_PT_view,)


def register() -> None:
    """Draw from now on, where there is a view to draw over."""
    global _handle
    if not bpy.app.background:
        _handle = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_VIEW")


def unregister() -> None:
    """Take everything back."""
    global _handle
    if _handle is not None:
        bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
        _handle = None
    forget(DRAWINGS)


def draw(drawings: Iterable[Drawing], context: bpy.types.Context) -> None:
    """Draw each of them, whatever becomes of the others."""
    for drawing in drawings:
        if drawing in _broken:
            continue
        try:
            drawing.draw(context)
        except Exception:
            _broken.add(drawing)  # or it would fail, and say so, at every redraw
            log.exception("Forest Sensing cannot draw a part of its overlays")


def forget(drawings: Iterable[Drawing], depsgraph: bpy.types.Depsgraph | None = None) -> None:
    """Something changed: each makes it anew, and what failed is tried again."""
    _broken.clear()
    for drawing in drawings:
        drawing.forget(depsgraph)


@bpy.app.handlers.persistent
def _forget(_scene: object = None, depsgraph: bpy.types.Depsgraph | None = None) -> None:
    forget(DRAWINGS, depsgraph)


WINDOW_HANDLERS = tuple(
    (f"{name}_post", _forget)
    for name in ("depsgraph_update", "frame_change", "undo", "redo", "load")
)


def _draw() -> None:
    context = bpy.context
    if not context.space_data.overlay.show_overlays:
        return
    gpu.state.blend_set("ALPHA")
    gpu.state.depth_test_set("LESS_EQUAL")
    draw(DRAWINGS, context)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")
