"""The panel *Results*: what came of it, in figures and pictures, and what the colours of points mean."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from ...blender.scene.layout import (
    COLOUR_BY,
    COLOUR_MAP,
    FAR_POINTS,
    GAMMA,
    LUMINANCE,
    RADIUS,
    SHARE,
)
from ...blender.scene.nodes import chosen_input, drawn_inputs
from ...blender.show.cloud_nodes import is_measure, on_map
from ..settings.drawing import OnceStarted, icon_of, split
from ..shell.views import icons
from ..shell.words import label, label_of_kept
from .keep import points_of, record_of

SIDE = 32  # pixels of an icon
EDGE = 2  # of these, left free around it
RIM = 2  # of these, around the colour: dark around what is light and light around what is dark


def draw_legend(layout: bpy.types.UILayout, result: Any, choice: str, colour_map: str = "") -> None:
    """Draw what the colours of this choice mean, two in a row; nothing where nobody noted it.

    colour_map : the scale that values are coloured on; empty: as they were noted.
    """
    entries = [entry for entry in result.legend if entry.choice == choice]
    if not entries:
        return
    colours = [tuple(entry.colour) for entry in entries]
    if colour_map:
        colours = list(map(tuple, on_map(colour_map, np.linspace(0.0, 1.0, len(entries)))))
    rows = layout.column(align=True)
    for first in range(0, len(entries), 2):
        row = rows.split(factor=0.5)
        for number in range(first, min(first + 2, len(entries))):
            row.label(text=entries[number].name, icon_value=_icon(colours[number]))


def pixels_of(colour: tuple[float, float, float]) -> np.ndarray:
    """(SIDE, SIDE, 4) a square of a colour, as the screen has it, rimmed, so that it is seen on any theme."""
    pixels = np.zeros((SIDE, SIDE, 4), np.float32)
    shown = np.array([channel**GAMMA for channel in colour])
    rim = 0.05 if shown @ LUMINANCE > 0.5 else 0.95
    for edge, filled in ((EDGE, (rim, rim, rim)), (EDGE + RIM, shown)):
        inner = slice(edge, SIDE - edge)
        pixels[inner, inner] = (*filled, 1.0)
    return pixels


def _icon(colour: tuple[float, float, float]) -> int:
    name = "colour " + " ".join(f"{channel:.4f}" for channel in colour)
    if name not in icons():
        made = icons().new(name)
        made.icon_size = (SIDE, SIDE)
        made.icon_pixels_float.foreach_set(pixels_of(colour).ravel())
    return int(icons()[name].icon_id)


class FOREST_PT_results(OnceStarted, bpy.types.Panel):
    bl_label = "Results"
    bl_order = 2

    def draw(self, context: bpy.types.Context) -> None:
        results = context.scene.forest_sensing.results
        if not results:
            self.layout.label(text="Nothing has run yet", icon="INFO")
        if any(result.stale for result in results):
            column = self.layout.column(align=True)  # beside the button the words would be cut off
            column.label(text="Some are from before the last change", icon="TIME")
            column.operator("forest.run", text="Run Again", icon="FILE_REFRESH").again = True
        for result in results:
            _draw_result(self.layout, result)


def _draw_result(layout: bpy.types.UILayout, result: Any) -> None:
    header, body = layout.panel_prop(result, "opened")
    title = label("{name} (before)", name=result.title) if result.stale else result.title
    header.label(text=title, icon=icon_of(result.kind))
    if points_of(result) is not None:
        chosen = header.operator("forest.select_result", text="", icon="RESTRICT_SELECT_OFF")
        chosen.shown = result.shown
    _draw_looks(header, result)
    record = record_of(result)
    if result.file:
        opened = header.operator("wm.path_open", text="", icon="FILE_FOLDER")
        opened.filepath = result.file
    if body is None:
        return
    if result.picture is not None and result.picture.preview is not None:
        body.template_icon(result.picture.preview.icon_id, scale=8)
        caption = body.row()
        caption.alignment = "CENTER"
        caption.active = False
        caption.label(text=result.caption)
    if result.frames:
        frames = label(
            "Frames {first} to {last}: play the timeline",
            first=result.frames[0].frame,
            last=result.frames[-1].frame,
        )
        body.label(text=frames, icon="PLAY")
    _draw_points(body, result)
    if record is not None and record.is_response:
        column, props = split(body), result.id_data.forest_sensing
        column.prop(props, "dry")
        if props.dry == "FILE":
            column.prop(props, "dry_file")
    table = body.split(factor=0.45)
    names, values = table.column(align=True), table.column(align=True)
    names.active = False
    for figure in result.figures:
        names.label(text=figure.name)
        values.label(text=label_of_kept(figure.made_of) if figure.made_of else figure.value)
    if result.kind != "forest":
        row = body.row(align=True)
        row.prop(result, "title", text="")
        row.operator("forest.export_result", text="", icon="EXPORT").result = result.name
        row.operator("forest.remove_result", text="", icon="TRASH").result = result.name


def draw_found(layout: bpy.types.UILayout, result: Any) -> None:
    """Draw in one line what a sensor found, with the buttons that show it; the result itself is far below."""
    row = layout.row(align=True)
    said = result.summary
    words = label_of_kept(said.made_of) if said.made_of else said.value
    if result.frames or not words:  # each frame has its own; earlier versions kept no such line
        words = result.title
    if result.stale:
        words = label("{name} (before)", name=words)
    row.label(text=words, icon="TIME" if result.stale else "CHECKMARK")
    _draw_looks(row, result)


def _draw_looks(layout: bpy.types.UILayout, result: Any) -> None:
    """Draw the buttons that show the points of a result, play it, and show its picture."""
    points, record = points_of(result), record_of(result)
    if points is not None:
        eye = "HIDE_OFF" if points.visible_get() else "HIDE_ON"
        layout.operator("forest.show_result", text="", icon=eye).result = result.name
    if record is not None and record.sound is not None:
        layout.operator("forest.play", text="", icon="PLAY_SOUND").sensor = result.name
    if result.picture is not None:
        shown = layout.operator("forest.show_picture", text="", icon="IMAGE_DATA")
        shown.result = result.name


def _draw_points(layout: bpy.types.UILayout, result: Any) -> None:
    """Draw how the points of a cloud look: its modifier's menu and radius, and whether renders show them."""
    cloud = bpy.data.objects.get(result.shown)
    for modifier in cloud.modifiers if cloud is not None else ():
        inputs = drawn_inputs(modifier)
        if COLOUR_BY not in inputs:
            continue
        column = split(layout)
        column.prop(*inputs[COLOUR_BY], text=COLOUR_BY)
        if RADIUS in inputs:
            row = column.row(align=True)
            row.prop(*inputs[RADIUS], text="Radius")
            row.prop(cloud, "hide_render", text="")
        if SHARE in inputs:
            column.prop(*inputs[SHARE], text=SHARE)
        if FAR_POINTS in inputs and "Far Points" in result.figures:
            column.prop(*inputs[FAR_POINTS], text=FAR_POINTS)
        choice, colour_map = chosen_input(modifier, COLOUR_BY), ""
        if COLOUR_MAP in inputs and is_measure(choice):
            column.prop(*inputs[COLOUR_MAP], text=COLOUR_MAP)
            colour_map = chosen_input(modifier, COLOUR_MAP)
        draw_legend(layout, result, choice, colour_map)
