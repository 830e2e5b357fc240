"""The 3D views that are open: drawn anew, turned to a field, with the tab *Forest* beside it."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
from mathutils import Vector

from ...spec import Forest

TAB = "Forest"
PANELS = {"VIEW_3D": "UI", "PROPERTIES": "WINDOW"}  # where panels of ours are, by the kind of area
ACROSS = (
    0.36  # metres from the middle to the edge of a view, a metre of its distance; lens of 50 mm
)

_seen_through: set[int] = set()  # areas whose views were made so by us


def views() -> Iterator[tuple[bpy.types.Window, bpy.types.Area]]:
    """Each 3D view, with its window."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                yield window, area


def region_of(area: bpy.types.Area, kind: str) -> bpy.types.Region:
    """The region of an area that is of a kind."""
    return next(region for region in area.regions if region.type == kind)


def region_below(
    window: bpy.types.Window, x: int, y: int
) -> tuple[bpy.types.Area | None, bpy.types.Region | None]:
    """The 3D view below the mouse at (x, y) of a window and its region there, of four views the one that it
    is; the first view where there is none below."""
    areas = [area for area in window.screen.areas if area.type == "VIEW_3D"]
    below = [area for area in areas if _holds(area, x, y)]
    area = next(iter(below or areas), None)
    found = [r for r in area.regions if r.type == "WINDOW" and r.width > 1] if area else []
    return area, next((r for r in found if _holds(r, x, y)), next(iter(found), None))


def _holds(box: bpy.types.Area | bpy.types.Region, x: int, y: int) -> bool:
    """Return whether a place of the window is in an area or region."""
    return box.x <= x < box.x + box.width and box.y <= y < box.y + box.height


def redraw_panels() -> None:
    """Have every sidebar of a 3D view and every Properties editor drawn anew, and no view itself."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in PANELS:
                region_of(area, PANELS[area.type]).tag_redraw()


def look_at(area: bpy.types.Area, field: Forest) -> None:
    """Turn a 3D view to the whole field, beside the sidebar, and have its solid mode draw no outlines.

    A view that looks through a camera is not turned.
    """
    space = area.spaces.active
    view = space.region_3d
    space.shading.show_object_outline = False  # black around every leaf: crowns would be dark
    if view.view_perspective == "CAMERA":
        return
    longest = max(field.size)
    space.clip_end = max(space.clip_end, 10.0 * longest)
    view.view_distance = 1.6 * longest
    covered = region_of(area, "UI").width / region_of(area, "WINDOW").width
    aside = view.view_rotation @ Vector((ACROSS * view.view_distance * covered, 0.0, 0.0))
    middle = [o + s / 2 for o, s in zip(field.origin, field.size, strict=True)]
    view.view_location = Vector((*middle, 3.0)) + aside


def see_through(on: bool) -> None:
    """Show through what is in front in every view that does not do so already; or end that."""
    for _, area in views():
        shading, key = area.spaces.active.shading, area.as_pointer()
        if on and not shading.show_xray:
            shading.show_xray = True
            _seen_through.add(key)
        elif not on and key in _seen_through:
            shading.show_xray = False
    if not on:
        _seen_through.clear()


def open_tab(area: bpy.types.Area) -> None:
    """Show the tab; it is known once the sidebar was drawn."""
    side = region_of(area, "UI")
    if side.active_panel_category != "UNSUPPORTED":
        side.active_panel_category = TAB
