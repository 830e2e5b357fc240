"""The panel *Forest*: what grows, where it stands, on which ground."""

from __future__ import annotations

from typing import Any, ClassVar

import bpy

from ..settings.drawing import (
    BIG,
    Tab,
    WithForest,
    draw_field,
    draw_reference,
    draw_settings,
    is_shown,
    split,
)
from ..settings.exchange import forestless
from ..settings.lists import draw_list
from ..settings.presets import draw_presets
from ..settings.saved import draw_notice
from ..shell import requirements
from ..shell.chosen import chosen
from ..shell.progress import draw_job
from ..shell.running import current
from ..shell.words import label
from . import live
from .display import draw_display
from .painting import PAINTING


def _planting(context: bpy.types.Context) -> Any:
    return chosen(context.scene.forest_sensing, "plantings")


class FOREST_PT_forest(Tab, bpy.types.Panel):
    bl_label = "Species and Forest"
    bl_order = 0

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        self.layout.operator("forest.load_scene", text="", icon="FILE_FOLDER", emboss=False)
        self.layout.operator("forest.save_scene", text="", icon="FILE_TICK", emboss=False)
        self.layout.operator("forest.export_others", text="", icon="EXPORT", emboss=False)
        self.layout.separator()  # from the handle that Blender draws at the end

    def draw(self, context: bpy.types.Context) -> None:
        layout, props = self.layout, context.scene.forest_sensing
        if requirements.missing():
            _say_what_is_missing(layout)
        if props.notice:
            draw_notice(layout, props)
        if context.scene.unit_settings.scale_length != 1:
            _say_what_a_unit_is(layout)
        if forestless(props):
            _draw_start(layout)
            return
        _draw_update(layout, context.scene)
        column = split(layout)
        seed = column.row(align=True)
        seed.prop(props, "seed")
        seed.operator("forest.new_seed", text="", icon="FILE_REFRESH")
        draw_field(column, props.forest, "size")
        draw_field(column, props.forest, "instancing")
        draw_display(column, props)


class FOREST_PT_plantings(WithForest, bpy.types.Panel):
    """Of the species that is chosen above: how many, and how they stand."""

    bl_label = "Planting"
    bl_parent_id = "FOREST_PT_forest"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw_header_preset(self, _context: bpy.types.Context) -> None:
        draw_presets(self.layout, "planting")

    def draw(self, context: bpy.types.Context) -> None:
        layout, props = self.layout, context.scene.forest_sensing
        if not props.plantings:
            layout.label(text="No trees: add a planting", icon="INFO")
            return
        column, planting = split(layout), _planting(context)
        if props.advanced:  # a species file that no folder of ours has
            draw_field(column, planting, "species")
        for name in ("variants", "layout", "expected", "density", "exact"):
            draw_field(column, planting, name)
        for name in ("scale", "crown", "age", "season"):
            draw_field(column, planting, name)


class _OfPlanting(Tab):
    """More of the chosen planting."""

    bl_parent_id = "FOREST_PT_plantings"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(context.scene.forest_sensing.plantings)


class FOREST_PT_intensity(_OfPlanting, bpy.types.Panel):
    bl_label = "Where They Stand"
    bl_options: ClassVar[set[str]] = set()

    def draw(self, context: bpy.types.Context) -> None:
        layout, planting = self.layout, _planting(context)
        layout.active = planting.layout in ("poisson", "clusters", "strauss")
        draw_list(layout, "FOREST_UL_gaussians", planting, "gaussians", "gaussian")
        if not planting.gaussians:
            layout.label(text="No hills: the same everywhere", icon="INFO")
        else:
            draw_settings(split(layout), chosen(planting, "gaussians"))
            layout.prop(context.scene.forest_sensing, "drag_hills", icon="EMPTY_AXIS", toggle=True)
        layout.label(text="Images")
        draw_list(layout, "FOREST_UL_rasters", planting, "rasters", "raster")
        if planting.rasters:
            draw_settings(split(layout), chosen(planting, "rasters"))
        column = split(layout)
        draw_field(column, planting, "base")
        draw_reference(column, planting, "painted")
        on = context.mode == PAINTING
        column.operator(
            "forest.paint",
            text=label("Done") if on else label("Paint"),
            icon="CHECKMARK" if on else "BRUSH_DATA",
        )
        draw_field(column, planting, "painted_value")


class FOREST_PT_limits(_OfPlanting, bpy.types.Panel):
    bl_label = "Limits"

    def draw(self, context: bpy.types.Context) -> None:
        column = split(self.layout)
        for name in ("slope_deg", "altitude", "polygon", "holes"):
            draw_field(column, _planting(context), name)


class _OfLayout(_OfPlanting):
    """Settings that one layout alone heeds, under its own name."""

    which: ClassVar[str]

    def draw(self, context: bpy.types.Context) -> None:
        column, planting = split(self.layout), _planting(context)
        column.active = planting.layout == self.which
        draw_settings(column, getattr(planting, self.which))


class FOREST_PT_clusters(_OfLayout, bpy.types.Panel):
    bl_label = "Clusters"
    which = "clusters"


class FOREST_PT_strauss(_OfLayout, bpy.types.Panel):
    bl_label = "Keeping Apart"
    which = "strauss"


class FOREST_PT_rows(_OfLayout, bpy.types.Panel):
    bl_label = "Orchard Rows"
    which = "rows"


class FOREST_PT_list(_OfPlanting, bpy.types.Panel):
    bl_label = "List of Trees"

    def draw(self, context: bpy.types.Context) -> None:
        column, planting = split(self.layout), _planting(context)
        column.active = planting.layout == "list"
        for name in ("trees", "collection"):
            draw_field(column, planting, name)


class FOREST_PT_targets(_OfPlanting, bpy.types.Panel):
    bl_label = "Grown to Measure"

    def draw_header(self, context: bpy.types.Context) -> None:
        self.layout.prop(_planting(context), "use_targets", text="")

    def draw(self, context: bpy.types.Context) -> None:
        column, planting = split(self.layout), _planting(context)
        column.active = planting.use_targets
        targets = planting.targets
        row = column.row(align=True, heading=targets.bl_rna.properties["dbh"].name)
        row.prop(targets, "use_dbh", text="")
        spread = row.row(align=True)
        spread.active = targets.use_dbh
        spread.prop(targets.dbh, "mean", text="")
        spread.prop(targets.dbh, "sd", text="")
        draw_settings(column, targets)


class FOREST_PT_spacing(WithForest, bpy.types.Panel):
    bl_label = "Spacing"
    bl_parent_id = "FOREST_PT_forest"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, forest = self.layout, context.scene.forest_sensing.forest
        column = split(layout)
        for name in ("spacing", "spacing_rule"):
            if is_shown(forest, name):
                draw_field(column, forest, name)
        layout.label(text="Between Two Species")
        draw_list(layout, "FOREST_UL_distances", forest, "distances", "distance")
        if forest.distances:
            draw_settings(split(layout), chosen(forest, "distances"))


class FOREST_PT_stems(WithForest, bpy.types.Panel):
    bl_label = "Stems for Reverb"
    bl_parent_id = "FOREST_PT_forest"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, props = self.layout, context.scene.forest_sensing
        draw_list(layout, "FOREST_UL_stems", props, "stems", "stems")
        if props.stems:
            stems = chosen(props, "stems")
            draw_settings(split(layout), stems)
            draw_settings(split(layout), stems.radius)


class FOREST_PT_ground(WithForest, bpy.types.Panel):
    bl_label = "Ground"
    bl_parent_id = "FOREST_PT_forest"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        props = context.scene.forest_sensing
        column = split(self.layout)
        for name in ("undergrowth", "origin", "polygon", "holes", "margin"):
            draw_field(column, props.forest, name)
        self.layout.label(text="Terrain")
        draw_settings(split(self.layout), props.forest.terrain)
        self.layout.label(text="On the Map")
        column = split(self.layout)
        for name in ("offset", "crs"):
            column.prop(props, name)


def _draw_start(layout: bpy.types.UILayout) -> None:
    """Draw the start for a newcomer: two doors, and the way to a file."""
    _build_or_progress(layout, "OUTLINER_OB_CURVES", label("Grow Forest"))
    scan = layout.row()
    scan.scale_y = BIG
    scan.operator("forest.scan_here", icon="OUTLINER_OB_POINTCLOUD")
    row = layout.row(align=True)
    row.operator("forest.gallery", text="More Forests", icon="IMGDISPLAY")
    row.operator("forest.load_scene", text="Open")


def _draw_update(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """The button that grows, with a star where settings have changed since, and Live beside it."""
    row = layout.row(align=True)
    if "forest" not in scene.forest_sensing.results:
        _build_or_progress(row, "OUTLINER_OB_CURVES", label("Grow Forest"))
    else:
        star = " *" if live.is_stale(scene) else ""
        _build_or_progress(row, "FILE_REFRESH", label("Grow Forest") + star)
    beside = row.row(align=True)
    beside.scale_y = BIG
    beside.ui_units_x = 3
    beside.prop(scene.forest_sensing, "live", toggle=True)


def _say_what_is_missing(layout: bpy.types.UILayout) -> None:
    box = layout.box()
    box.alert = True
    column = box.column(align=True)
    column.label(text=requirements.in_words(requirements.missing()), icon="ERROR")
    for line in requirements.WHAT_TO_DO:
        column.label(text=line)


def _say_what_a_unit_is(layout: bpy.types.UILayout) -> None:
    """Blender shows lengths times the scene's Unit Scale; trees and sound are computed without it."""
    column = layout.box().column(align=True)
    column.label(text="A unit counts as 1 m here:", icon="ERROR")
    column.label(text="set Scene > Unit Scale to 1", icon="BLANK1")


def _build_or_progress(layout: bpy.types.UILayout, icon: str, text: str) -> None:
    """The button that builds; while something runs, how far that is, in its place so that nothing moves."""
    row, job = layout.row(align=True), current()
    row.scale_y = BIG
    if job is not None:
        draw_job(row, job)
    else:
        row.operator("forest.build", text=text, icon=icon)


CLASSES = (
    FOREST_PT_forest,
    FOREST_PT_plantings,
    FOREST_PT_intensity,
    FOREST_PT_limits,
    FOREST_PT_clusters,
    FOREST_PT_strauss,
    FOREST_PT_rows,
    FOREST_PT_list,
    FOREST_PT_targets,
    FOREST_PT_spacing,
    FOREST_PT_stems,
    FOREST_PT_ground,
)
