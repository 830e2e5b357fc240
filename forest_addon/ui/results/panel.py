"""The panel *Results*: what came of it, in figures and pictures."""

from __future__ import annotations

from typing import Any

import bpy

from ...blender.scene.layout import COLOUR_BY, COLOUR_MAP, FAR_POINTS, RADIUS, SHARE
from ...blender.scene.nodes import chosen_input, drawn_inputs
from ...blender.show.cloud_nodes import is_measure
from ..settings.drawing import OnceStarted, icon_of, split
from ..shell.words import label, label_of_kept
from .shown import is_seen, points_of
from .swatches import draw_legend


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
    from ...results.kinds import RESULTS

    header, body = layout.panel_prop(result, "opened")
    title = label("{name} (before)", name=result.title) if result.stale else result.title
    header.label(text=title, icon=icon_of(result.kind))
    if points_of(result) is not None:
        chosen = header.operator("forest.select_result", text="", icon="RESTRICT_SELECT_OFF")
        chosen.shown = result.shown
    _draw_looks(header, result)
    record = RESULTS.get(result.kind)
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
        _draw_sound(body, result.id_data.forest_sensing)
    table = body.split(factor=0.45)
    names, values = table.column(align=True), table.column(align=True)
    names.active = False
    for figure in result.figures:
        names.label(text=figure.name)
        values.label(text=label_of_kept(figure.made_of) if figure.made_of else figure.value)
    if result.kind != "forest":
        _draw_end(body, result)


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
    from ...results.kinds import RESULTS

    points, record = points_of(result), RESULTS.get(result.kind)
    if points is not None:
        eye = "HIDE_OFF" if is_seen(points) else "HIDE_ON"
        layout.operator("forest.show_result", text="", icon=eye).result = result.name
    if record is not None and record.sound is not None:
        layout.operator("forest.play", text="", icon="PLAY_SOUND").sensor = result.name
    if result.picture is not None:
        shown = layout.operator("forest.show_picture", text="", icon="IMAGE_DATA")
        shown.result = result.name


def _draw_end(layout: bpy.types.UILayout, result: Any) -> None:
    """Draw what can be done with a result: called otherwise, exported, removed."""
    row = layout.row(align=True)
    row.prop(result, "title", text="")
    row.operator("forest.export_result", text="", icon="EXPORT").result = result.name
    row.operator("forest.remove_result", text="", icon="TRASH").result = result.name


def _draw_sound(layout: bpy.types.UILayout, props: Any) -> None:
    """Draw what is heard when a reverb is played."""
    column = split(layout)
    column.prop(props, "dry")
    if props.dry == "FILE":
        column.prop(props, "dry_file")


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


CLASSES = (FOREST_PT_results,)
