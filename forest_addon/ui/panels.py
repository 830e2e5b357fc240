"""The sidebar tab *Forest*: what grows, what senses it, what came of it.

Drawing only reads properties; nothing is computed or loaded here.
"""

from __future__ import annotations

from typing import Any, ClassVar

import bpy

from .. import spec
from . import requirements
from .exchange import untouched
from .lists import draw_list
from .properties import PARTS

ICONS = {
    "forest": "OUTLINER_OB_CURVES",
    "tractor": "AUTO",
    "terrestrial": "OUTLINER_OB_POINTCLOUD",
    "mobile": "CON_FOLLOWPATH",
    "airborne": "AXIS_TOP",
    "sonar": "OUTLINER_OB_SPEAKER",
    "reverb": "RNDCURVE",
}


class _Tab:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Forest"


class _OnceStarted(_Tab):
    """A panel that appears when there are settings to show."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return not untouched(context.scene.forest_sensing)


# --------------------------------------------------------------------------------------------- forest


class FOREST_PT_forest(_Tab, bpy.types.Panel):
    bl_label = "Forest"
    bl_order = 0

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        self.layout.operator("forest.load_scene", text="", icon="FILE_FOLDER", emboss=False)
        self.layout.separator()  # from the handle that Blender draws at the end

    def draw(self, context: bpy.types.Context) -> None:
        layout, props = self.layout, context.scene.forest_sensing
        if requirements.missing():
            _say_what_is_missing(layout)
        if untouched(props):
            _draw_start(layout)
            return
        _big_button(layout, "forest.build", "FILE_REFRESH" if "forest" in props.results else "PLAY")
        column = _split(layout)
        column.prop(props, "seed")
        _draw_field(column, props.forest, "size")
        _draw_field(column, props.forest, "spacing")


class FOREST_PT_plantings(_OnceStarted, bpy.types.Panel):
    bl_label = "Plantings"
    bl_parent_id = "FOREST_PT_forest"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, props = self.layout, context.scene.forest_sensing
        draw_list(layout, "FOREST_UL_plantings", props, "plantings", "planting")
        if not props.plantings:
            layout.label(text="No trees: add a planting", icon="INFO")
            return
        planting = props.plantings[min(props.active_plantings, len(props.plantings) - 1)]
        column = _split(layout)
        for name in ("species", "variants", "expected", "scale"):
            _draw_field(column, planting, name)
        layout.label(text="Where They Stand")
        draw_list(layout, "FOREST_UL_gaussians", planting, "gaussians", "gaussian")
        if not planting.gaussians:
            layout.label(text="No hills: the same everywhere", icon="INFO")
            return
        hill = planting.gaussians[min(planting.active_gaussians, len(planting.gaussians) - 1)]
        _draw_settings(_split(layout), hill)


class FOREST_PT_ground(_OnceStarted, bpy.types.Panel):
    bl_label = "Ground"
    bl_parent_id = "FOREST_PT_forest"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        column = _split(self.layout)
        for name in ("origin", "margin"):
            _draw_field(column, context.scene.forest_sensing.forest, name)


# -------------------------------------------------------------------------------------------- sensors


class FOREST_PT_sensors(_OnceStarted, bpy.types.Panel):
    bl_label = "Sensors"
    bl_order = 1

    def draw(self, context: bpy.types.Context) -> None:
        column = _split(self.layout)
        column.prop(context.scene.forest_sensing, "output", placeholder="In this file alone")


class _Sensor(_OnceStarted):
    """One kind of sensor: the button that runs it, also in the header, and its settings."""

    bl_parent_id = "FOREST_PT_sensors"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}
    kind: ClassVar[str]
    operator: ClassVar[str]

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        self.layout.operator(self.operator, text="", icon="PLAY", emboss=False)

    def draw(self, context: bpy.types.Context) -> None:
        group = getattr(context.scene.forest_sensing, self.kind)
        _big_button(self.layout, self.operator, ICONS[self.kind])
        _draw_settings(_split(self.layout), group)
        for part in group.parts:
            header, body = self.layout.panel(f"FOREST_{self.kind}_{part}", default_closed=True)
            header.label(text=part.title())
            if body is not None:
                _draw_settings(_split(body), getattr(group, part))


class FOREST_PT_terrestrial(_Sensor, bpy.types.Panel):
    bl_label = spec.Terrestrial.TITLE
    kind, operator = "terrestrial", "forest.sweep"


class FOREST_PT_mobile(_Sensor, bpy.types.Panel):
    bl_label = spec.Mobile.TITLE
    kind, operator = "mobile", "forest.travel"

    def draw(self, context: bpy.types.Context) -> None:
        _Sensor.draw(self, context)
        group = context.scene.forest_sensing.mobile
        if group.follow:
            return
        self.layout.label(text="Where It Goes")
        draw_list(self.layout, "FOREST_UL_poses", group, "poses", "pose")
        if group.poses:
            pose = group.poses[min(group.active_poses, len(group.poses) - 1)]
            _draw_settings(_split(self.layout), pose)


class FOREST_PT_airborne(_Sensor, bpy.types.Panel):
    bl_label = spec.Airborne.TITLE
    kind, operator = "airborne", "forest.fly"


class FOREST_PT_tractor(_Sensor, bpy.types.Panel):
    bl_label = spec.Tractor.TITLE
    kind, operator = "tractor", "forest.scan"


class FOREST_PT_sonar(_Sensor, bpy.types.Panel):
    bl_label = spec.Sonar.TITLE
    kind, operator = "sonar", "forest.ping"


class FOREST_PT_reverb(_Sensor, bpy.types.Panel):
    bl_label = spec.Reverb.TITLE
    kind, operator = "reverb", "forest.clap"


class FOREST_PT_air(_OnceStarted, bpy.types.Panel):
    bl_label = "Air"
    bl_parent_id = "FOREST_PT_sensors"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        _draw_settings(_split(self.layout), context.scene.forest_sensing.air)


class FOREST_PT_rays(_OnceStarted, bpy.types.Panel):
    bl_label = spec.Rays.TITLE
    bl_parent_id = "FOREST_PT_sensors"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        _draw_settings(_split(self.layout), context.scene.forest_sensing.rays)


# -------------------------------------------------------------------------------------------- results


class FOREST_PT_results(_OnceStarted, bpy.types.Panel):
    bl_label = "Results"
    bl_order = 2

    def draw(self, context: bpy.types.Context) -> None:
        results = context.scene.forest_sensing.results
        if not results:
            self.layout.label(text="Nothing has run yet", icon="INFO")
        for result in results:
            _draw_result(self.layout, result)


def _draw_result(layout: bpy.types.UILayout, result: Any) -> None:
    header, body = layout.panel(f"FOREST_result_{result.name}")
    header.label(text=result.title, icon=ICONS[result.name])
    if result.shown:
        chosen = header.operator("forest.select_result", text="", icon="RESTRICT_SELECT_OFF")
        chosen.shown = result.shown
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
    table = body.column(align=True)
    for figure in result.figures:
        row = table.split(factor=0.45)
        name = row.row()
        name.active = False
        name.label(text=figure.name)
        row.label(text=figure.value)


# ------------------------------------------------------------------------------------ shared drawing


def _draw_start(layout: bpy.types.UILayout) -> None:
    """What a newcomer sees: one button that shows what this is."""
    column = layout.column(align=True)
    column.label(text="Grow a forest, scan it")
    column.label(text="and listen in it.")
    _big_button(layout, "forest.build", "PLAY", "Build Demo Forest")
    layout.operator("forest.load_scene", icon="FILE_FOLDER")


def _say_what_is_missing(layout: bpy.types.UILayout) -> None:
    box = layout.box()
    box.alert = True
    column = box.column(align=True)
    column.label(text=requirements.in_words(requirements.missing()), icon="ERROR")
    for line in requirements.WHAT_TO_DO:
        column.label(text=line)


def _big_button(
    layout: bpy.types.UILayout, operator: str, icon: str, text: str | None = None
) -> None:
    row = layout.row()
    row.scale_y = 1.4
    row.operator(operator, icon=icon, **({"text": text} if text else {}))


def _split(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """A column with labels to the left and values to the right."""
    column = layout.column()
    column.use_property_split = True
    column.use_property_decorate = False
    return column


def _draw_settings(layout: bpy.types.UILayout, group: Any) -> None:
    """Every setting of a group, in the order of ``spec``; the name comes last."""
    for name in sorted(group.shown, key="name".__eq__):
        _draw_field(layout, group, name)


def _draw_field(layout: bpy.types.UILayout, group: Any, name: str) -> None:
    """One setting: pairs as two rows, a value that may be left out behind its switch."""
    known = group.bl_rna.properties[name]
    if f"use_{name}" in group.bl_rna.properties:
        row = layout.row(align=True, heading=known.name)
        row.prop(group, f"use_{name}", text="")
        value = row.row(align=True)
        value.active = getattr(group, f"use_{name}")
        value.prop(group, name, text="")
    elif name in PARTS and getattr(known, "is_array", False):
        column = layout.column(align=True)
        first, second = PARTS[name]
        words, space, unit = known.name.partition(" (")
        column.prop(group, name, index=0, text=f"{words} {first.title()}")
        column.prop(group, name, index=1, text=f"{second.title()}{space}{unit}")
    else:
        layout.prop(group, name)


CLASSES = (
    FOREST_PT_forest,
    FOREST_PT_plantings,
    FOREST_PT_ground,
    FOREST_PT_sensors,
    FOREST_PT_terrestrial,
    FOREST_PT_mobile,
    FOREST_PT_airborne,
    FOREST_PT_tractor,
    FOREST_PT_sonar,
    FOREST_PT_reverb,
    FOREST_PT_air,
    FOREST_PT_rays,
    FOREST_PT_results,
)
