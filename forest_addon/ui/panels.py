"""The sidebar tab *Forest*: what grows, what senses it, what came of it.

Drawing only reads properties; nothing is computed or loaded here.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, ClassVar

import bpy

from .. import spec
from ..blender import sensors
from ..blender.layout import COLOUR_BY
from ..blender.nodes import drawn_input, has_input
from . import live, requirements
from .exchange import untouched
from .lists import ICONS, draw_list
from .migration import draw_notice
from .operators import chosen_sensor
from .painting import PAINTING
from .properties import PARTS
from .running import current
from .things import seen_thing
from .words import label, label_of_kept

BIG = 1.4  # heights of a row: the buttons that start work


class Tab:
    """Where our panels are."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Forest"


class OnceStarted(Tab):
    """A panel that appears when there are settings to show."""

    bl_order = 1  # Species comes first

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return not untouched(context.scene.forest_sensing)


# --------------------------------------------------------------------------------------------- forest


class FOREST_PT_forest(Tab, bpy.types.Panel):
    bl_label = "Forest"
    bl_order = 0

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        self.layout.operator("forest.load_scene", text="", icon="FILE_FOLDER", emboss=False)
        self.layout.operator("forest.save_scene", text="", icon="FILE_TICK", emboss=False)
        self.layout.separator()  # from the handle that Blender draws at the end

    def draw(self, context: bpy.types.Context) -> None:
        layout, props = self.layout, context.scene.forest_sensing
        if requirements.missing():
            _say_what_is_missing(layout)
        if props.notice:
            draw_notice(layout, props)
        if context.scene.unit_settings.scale_length != 1:
            _say_what_a_unit_is(layout)
        if untouched(props):
            _draw_start(layout)
            return
        _draw_update(layout, context.scene)
        column = split(layout)
        seed = column.row(align=True)
        seed.prop(props, "seed")
        seed.operator("forest.new_seed", text="", icon="FILE_REFRESH")
        draw_field(column, props.forest, "size")
        draw_field(column, props.forest, "instancing")


class FOREST_PT_plantings(OnceStarted, bpy.types.Panel):
    bl_label = "Plantings"
    bl_parent_id = "FOREST_PT_forest"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, props = self.layout, context.scene.forest_sensing
        draw_list(layout, "FOREST_UL_plantings", props, "plantings", "planting")
        if not props.plantings:
            layout.label(text="No trees: add a planting", icon="INFO")
            return
        column, planting = split(layout), _planting(context)
        for name in ("species", "variants", "layout", "expected", "density", "exact"):
            draw_field(column, planting, name)
        for name in ("scale", "crown"):
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
        layout.active = planting.layout == "poisson"
        draw_list(layout, "FOREST_UL_gaussians", planting, "gaussians", "gaussian")
        if not planting.gaussians:
            layout.label(text="No hills: the same everywhere", icon="INFO")
        else:
            draw_settings(split(layout), _chosen(planting, "gaussians"))
            layout.prop(context.scene.forest_sensing, "drag_hills", icon="EMPTY_AXIS", toggle=True)
        layout.label(text="Images")
        draw_list(layout, "FOREST_UL_rasters", planting, "rasters", "raster")
        if planting.rasters:
            draw_settings(split(layout), _chosen(planting, "rasters"))
        column = split(layout)
        draw_field(column, planting, "base")
        painted = column.row(align=True)
        painted.prop(planting, "painted")
        on = context.mode == PAINTING
        painted.operator(
            "forest.paint",
            text=label("Done") if on else "",
            icon="CHECKMARK" if on else "BRUSH_DATA",
        )
        draw_field(column, planting, "painted_value")


class FOREST_PT_limits(_OfPlanting, bpy.types.Panel):
    bl_label = "Limits"

    def draw(self, context: bpy.types.Context) -> None:
        column = split(self.layout)
        for name in ("slope_deg", "altitude", "polygon", "holes"):
            draw_field(column, _planting(context), name)


class FOREST_PT_rows(_OfPlanting, bpy.types.Panel):
    bl_label = "Orchard Rows"

    def draw(self, context: bpy.types.Context) -> None:
        column, planting = split(self.layout), _planting(context)
        column.active = planting.layout == "rows"
        draw_settings(column, planting.rows)


class FOREST_PT_list(_OfPlanting, bpy.types.Panel):
    bl_label = "List of Trees"

    def draw(self, context: bpy.types.Context) -> None:
        column, planting = split(self.layout), _planting(context)
        column.active = planting.layout == "list"
        for name in ("trees", "collection"):
            draw_field(column, planting, name)


class FOREST_PT_spacing(OnceStarted, bpy.types.Panel):
    bl_label = "Spacing"
    bl_parent_id = "FOREST_PT_forest"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, forest = self.layout, context.scene.forest_sensing.forest
        column = split(layout)
        for name in ("spacing", "spacing_rule"):
            draw_field(column, forest, name)
        layout.label(text="Between Two Species")
        draw_list(layout, "FOREST_UL_distances", forest, "distances", "distance")
        if forest.distances:
            draw_settings(split(layout), _chosen(forest, "distances"))


class FOREST_PT_stems(OnceStarted, bpy.types.Panel):
    bl_label = "Stems for Reverb"
    bl_parent_id = "FOREST_PT_forest"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, props = self.layout, context.scene.forest_sensing
        draw_list(layout, "FOREST_UL_stems", props, "stems", "stems")
        if props.stems:
            stems = _chosen(props, "stems")
            draw_settings(split(layout), stems)
            draw_settings(split(layout), stems.radius)


class FOREST_PT_ground(OnceStarted, bpy.types.Panel):
    bl_label = "Ground"
    bl_parent_id = "FOREST_PT_forest"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        props = context.scene.forest_sensing
        column = split(self.layout)
        for name in ("origin", "polygon", "holes", "margin"):
            draw_field(column, props.forest, name)
        self.layout.label(text="Terrain")
        draw_settings(split(self.layout), props.forest.terrain)
        self.layout.label(text="On the Map")
        column = split(self.layout)
        for name in ("offset", "crs"):
            column.prop(props, name)


# -------------------------------------------------------------------------------------------- sensors


class FOREST_PT_sensors(OnceStarted, bpy.types.Panel):
    bl_label = "Sensors"
    bl_order = 1

    def draw(self, context: bpy.types.Context) -> None:
        layout, props = self.layout, context.scene.forest_sensing
        home = sensors.home_of(context.scene)
        row = layout.row()
        if home is not None:
            row.template_list(
                "FOREST_UL_sensors", "", home, "objects", props, "active_sensor", rows=3
            )
        else:
            row.label(text="No sensor yet: add one", icon="INFO")
        buttons = row.column(align=True)
        buttons.operator_menu_enum("forest.add_sensor", "kind", text="", icon="ADD")
        buttons.operator("forest.remove_sensor", text="", icon="REMOVE")
        thing = chosen_sensor(context)
        run = layout.row(align=True)
        run.scale_y = BIG
        one = run.row(align=True)
        one.enabled = thing is not None
        this = one.operator(
            "forest.run",
            text=label("Run") if thing is None else label("Run {sensor}", sensor=thing.name),
            icon="PLAY",
        )
        this.sensor, this.frames = "" if thing is None else thing.name, "THIS"
        run.operator("forest.run", text="All").frames = "THIS"
        frames = run.operator("forest.run", text="", icon="RENDER_ANIMATION")
        frames.frames = "RANGE"
        split(layout).prop(props, "output", placeholder="In this file alone")


class FOREST_PT_sensor(OnceStarted, bpy.types.Panel):
    """Settings of the chosen sensor."""

    bl_label = "Settings"
    bl_parent_id = "FOREST_PT_sensors"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}  # results stay in sight

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return super().poll(context) and chosen_sensor(context) is not None

    def draw(self, context: bpy.types.Context) -> None:
        thing = chosen_sensor(context)
        kind = sensors.kind_of(thing)
        column = split(self.layout)
        column.prop(thing, "name")
        column.prop(thing, "location")
        if kind == "reverb":
            column.prop(thing, f'["{sensors.RECEIVER_KEY}"]', text="Receiver")
        if kind != "terrestrial":
            column.prop(thing, "rotation_euler", text="Rotation")
        group = getattr(thing.forest_sensor, kind)
        hidden = {"name", *sensors.POSED.get(kind, ())}
        draw_settings(split(self.layout), group, hidden)
        for part in group.nested:
            header, body = self.layout.panel(f"FOREST_{kind}_{part}", default_closed=True)
            header.label(text=group.bl_rna.properties[part].name)
            if body is not None:
                draw_settings(split(body), getattr(group, part))
        if kind == "mobile" and not group.follow:
            self.layout.label(text="Where It Goes")
            draw_list(self.layout, "FOREST_UL_poses", group, "poses", "pose")
            if group.poses:
                draw_settings(split(self.layout), _chosen(group, "poses"))
        if kind == "reverb":
            self.layout.label(text="Further Sources")
            _draw_ends(self.layout, group, "sources", "source")
            self.layout.label(text="Further Receivers")
            _draw_ends(self.layout, group, "receivers", "receiver")


def _draw_ends(layout: bpy.types.UILayout, reverb: Any, name: str, thing: str) -> None:
    """Further sources or receivers: the list, and the place of the chosen one."""
    draw_list(layout, "FOREST_UL_places", reverb, name, thing)
    if getattr(reverb, name):
        draw_settings(split(layout), _chosen(reverb, name))


class FOREST_PT_thing(OnceStarted, bpy.types.Panel):
    """What the active object is to sensors."""

    bl_label = "This Object"
    bl_parent_id = "FOREST_PT_sensors"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return super().poll(context) and seen_thing(context) is not None

    def draw(self, context: bpy.types.Context) -> None:
        thing = seen_thing(context)
        column = split(self.layout)
        column.prop(thing, "name")
        column.prop(thing, "forest_seen")
        column.prop(thing, "forest_reflects")
        if thing.forest_reflects:
            column.prop(thing, "forest_reflected")


class FOREST_PT_air(OnceStarted, bpy.types.Panel):
    bl_label = "Air"
    bl_parent_id = "FOREST_PT_sensors"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        draw_settings(split(self.layout), context.scene.forest_sensing.air)


class FOREST_PT_rays(OnceStarted, bpy.types.Panel):
    bl_label = spec.Rays.TITLE
    bl_parent_id = "FOREST_PT_sensors"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        draw_settings(split(self.layout), context.scene.forest_sensing.rays)


# -------------------------------------------------------------------------------------------- results


class FOREST_PT_results(OnceStarted, bpy.types.Panel):
    bl_label = "Results"
    bl_order = 2

    def draw(self, context: bpy.types.Context) -> None:
        results = context.scene.forest_sensing.results
        if not results:
            self.layout.label(text="Nothing has run yet", icon="INFO")
        for result in results:
            _draw_result(self.layout, result)


def _draw_result(layout: bpy.types.UILayout, result: Any) -> None:
    header, body = layout.panel_prop(result, "opened")
    header.label(text=result.title, icon=ICONS.get(result.kind, "DOT"))
    if result.shown:
        chosen = header.operator("forest.select_result", text="", icon="RESTRICT_SELECT_OFF")
        chosen.shown = result.shown
    if result.kind == "reverb":
        header.operator("forest.play", text="", icon="PLAY_SOUND").sensor = result.name
    if result.picture is not None:
        shown = header.operator("forest.show_picture", text="", icon="IMAGE_DATA")
        shown.result = result.name
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
    _draw_colour_by(body, result)
    table = body.column(align=True)
    for figure in result.figures:
        row = table.split(factor=0.45)
        name = row.row()
        name.active = False
        name.label(text=figure.name)
        row.label(text=label_of_kept(figure.made_of) if figure.made_of else figure.value)


def _draw_colour_by(layout: bpy.types.UILayout, result: Any) -> None:
    """The menu that colours a cloud, which its modifier has."""
    cloud = bpy.data.objects.get(result.shown)
    for modifier in cloud.modifiers if cloud is not None else ():
        if has_input(modifier, COLOUR_BY):
            split(layout).prop(*drawn_input(modifier, COLOUR_BY), text=COLOUR_BY)


class FOREST_PT_view(OnceStarted, bpy.types.Panel):
    """What is drawn over the 3D view."""

    bl_label = "Overlays"
    bl_order = 3

    def draw(self, context: bpy.types.Context) -> None:
        row = self.layout.row(align=True)
        for name in ("show_sensors", "show_intensity", "show_points"):
            row.prop(context.scene.forest_sensing, name, toggle=True)


# ------------------------------------------------------------------------------------ shared drawing


def _planting(context: bpy.types.Context) -> Any:
    """The planting that is chosen in the list."""
    return _chosen(context.scene.forest_sensing, "plantings")


def _chosen(owner: Any, name: str) -> Any:
    listed = getattr(owner, name)
    return listed[min(getattr(owner, f"active_{name}"), len(listed) - 1)]


def _draw_start(layout: bpy.types.UILayout) -> None:
    """What a newcomer sees: one button that shows what this is."""
    column = layout.column(align=True)
    column.label(text="Grow a forest, scan it")
    column.label(text="and listen in it.")
    _build_or_progress(layout, "PLAY", label("Build Demo Forest"))
    layout.operator("forest.load_scene", icon="FILE_FOLDER")


def _draw_update(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """The button that builds, with a star where settings have changed since, and Live beside it."""
    row = layout.row(align=True)
    if "forest" not in scene.forest_sensing.results:
        _build_or_progress(row, "PLAY", label("Build Forest"))
    else:
        star = " *" if live.is_stale(scene) else ""
        _build_or_progress(row, "FILE_REFRESH", label("Update") + star)
    beside = row.row(align=True)
    beside.scale_y = BIG
    beside.ui_units_x = 3
    beside.prop(scene.forest_sensing, "live", toggle=True)


def _draw_job(layout: bpy.types.UILayout) -> None:
    """How far the running job is, and the button that stops it."""
    job = current()
    row = layout.row(align=True)
    row.scale_y = BIG
    row.progress(factor=job.share, text=f"{job.label} {job.share:.0%}")
    row.operator("forest.cancel", text="", icon="CANCEL")


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
    if current() is not None:
        _draw_job(layout)
        return
    row = layout.row()
    row.scale_y = BIG
    row.operator("forest.build", text=text, icon=icon)


def split(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """A column with labels to the left and values to the right."""
    column = layout.column()
    column.use_property_split = True
    column.use_property_decorate = False
    return column


def draw_settings(
    layout: bpy.types.UILayout, group: Any, hidden: Collection[str] = frozenset()
) -> None:
    """Every setting of a group, in the order of ``spec``."""
    for name in group.shown:
        if name not in hidden:
            draw_field(layout, group, name)


def draw_field(layout: bpy.types.UILayout, group: Any, name: str) -> None:
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
        words, space, unit = label(known.name).partition(" (")
        column.prop(
            group, name, index=0, text=label("{setting} {end}", setting=words, end=label(first))
        )
        column.prop(group, name, index=1, text=f"{label(second)}{space}{unit}")
    else:
        layout.prop(group, name)


CLASSES = (
    FOREST_PT_forest,
    FOREST_PT_plantings,
    FOREST_PT_intensity,
    FOREST_PT_limits,
    FOREST_PT_rows,
    FOREST_PT_list,
    FOREST_PT_spacing,
    FOREST_PT_stems,
    FOREST_PT_ground,
    FOREST_PT_sensors,
    FOREST_PT_sensor,
    FOREST_PT_thing,
    FOREST_PT_air,
    FOREST_PT_rays,
    FOREST_PT_results,
    FOREST_PT_view,
)
