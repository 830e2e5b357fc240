"""The panel *Forest*: what grows, where it stands, on which ground, with the lists that it has."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import bpy

from ..settings.drawing import (
    BIG,
    OfForest,
    Tab,
    buttons,
    draw_field,
    draw_listed,
    draw_named,
    draw_reference,
    draw_settings,
    is_narrow,
    name_in,
    rows,
    split,
)
from ..settings.exchange import forestless
from ..settings.presets import draw_presets
from ..shell import running
from ..shell.running import current, draw_job, panel
from ..shell.views import chosen, chosen_planting
from ..shell.words import EDITED, keep, label, title_of
from . import build
from .hand import PAINTING
from .planting import is_planting
from .wind import draw_display

Context = bpy.types.Context


def _props(context: Context) -> Any:
    return context.scene.forest_sensing


def _planting(context: Context) -> Any:
    return chosen_planting(_props(context))


NO_PLANTING = keep("There is no planting yet. Add one to the list")
WIDE = 2.0  # metres, of a clearing that a button makes
# Blender shows lengths times the scene's Unit Scale; trees and sound are computed without it.
UNIT = (keep("A unit counts as 1 m here:"), keep("set Scene > Unit Scale to 1"))


def _planting_row(item: Any) -> tuple[str, str, str]:
    edited = item.species.startswith(EDITED)
    known = item.standing >= 0
    count = item.standing if known else item.expected
    number = label("1 tree") if count == 1 else label("{expected:g} trees", expected=count)
    if known and item.use_expected and round(item.expected) != count:
        number = label("{standing:,} of {asked:g} trees", standing=count, asked=item.expected)
    return (
        title_of(item.species) or label("(no species)"),
        "GREASEPENCIL" if edited else "OUTLINER_OB_CURVES",
        number if known or item.use_expected else "",
    )


def _place(place: Any, form: str = "g") -> str:
    return f"{place[0]:{form}}, {place[1]:{form}} m"


def _hill(field: Any) -> dict[str, Any]:
    """A hill in the middle of a field."""
    middle = [o + s / 2 for o, s in zip(field.origin, field.size, strict=True)]
    return {"centre": middle, "width": [s / 4 for s in field.size]}


def _distance(context: Context) -> dict[str, Any]:
    """A distance of the chosen planting from itself."""
    planting = _planting(context)
    both = {} if planting is None else dict.fromkeys(("species", "other"), planting.species)
    return both | {"distance": _props(context).forest.spacing}


CLASSES = (
    rows("plantings", "Species of the forest", _planting_row),
    *buttons(
        "planting",
        "Planting",
        "plantings",
        _props,
        "",
        "Plant one more species",
        lambda _context: {"species": "maple", "use_expected": True},
    ),
    rows(
        "gaussians",
        "Hills of a species' intensity",
        lambda item: (
            _place(item.centre),
            "MESH_CIRCLE",
            label("peak {height:.3g}", height=item.peak),
        ),
    ),
    *buttons(
        "gaussian",
        "Hill",
        "gaussians",
        _planting,
        NO_PLANTING,
        "Add a hill of the intensity function, in the middle of the field",
        lambda context: _hill(_props(context).forest),
    ),
    rows(
        "rasters",
        "Images of a species' intensity",
        lambda item: (Path(item.file).name or label("(no file)"), "IMAGE_DATA", item.use),
    ),
    *buttons(
        "raster",
        "Image",
        "rasters",
        _planting,
        NO_PLANTING,
        "Add an image to the intensity function",
        lambda context: {n: getattr(_props(context).forest, n) for n in ("size", "origin")},
    ),
    rows(
        "distances",
        "Distances between pairs of species",
        lambda item: (
            f"{item.species or '?'}, {item.other or '?'}",
            "DRIVER_DISTANCE",
            f"{item.distance:g} m",
        ),
    ),
    *buttons(
        "distance",
        "Distance",
        "distances",
        lambda context: _props(context).forest,
        "",
        "Add a distance between trees of two species, at first of the chosen planting with itself",
        _distance,
    ),
    rows(
        "stems",
        "Stems that only reverb hears",
        lambda item: (label("{count:,} stems", count=item.count), "MESH_CYLINDER", ""),
    ),
    *buttons(
        "stems",
        "Stems",
        "stems",
        _props,
        "",
        "Add trees that are upright cylinders only: reverb hears them, nothing is grown",
        lambda _context: {"count": 1000},
    ),
    rows(
        "by_hand",
        "Trees of a planting that were set by hand",
        lambda item: (
            _place(item.position, ".2f"),
            "OUTLINER_OB_CURVES",
            label("variant {number}", number=item.variant) if item.use_variant else "",
        ),
    ),
    *buttons(
        "hand_tree",
        "Tree",
        "by_hand",
        _planting,
        NO_PLANTING,
        "Set a tree by hand at the 3D cursor",
        lambda context: {"position": context.scene.cursor.location[:2]},
    ),
    rows(
        "clearings",
        "Discs that a planting keeps free",
        lambda item: (_place(item.position, ".2f"), "MESH_CIRCLE", f"{item.radius:.3g} m"),
    ),
    *buttons(
        "clearing",
        "Clearing",
        "clearings",
        _planting,
        NO_PLANTING,
        "Keep a disc around the 3D cursor free of trees that are drawn",
        lambda context: {"position": context.scene.cursor.location[:2], "radius": WIDE},
    ),
)


def _shown_planting(context: Context) -> Any:
    return chosen(_props(context), "plantings")


def _files_beside(tab: bpy.types.Panel, _context: Context) -> None:
    if not is_narrow():  # else they would stand on the title
        _draw_files(tab.layout)
        tab.layout.separator()  # from the handle that Blender draws at the end


@panel("Species and Forest", Tab, bl_order=0, draw_header_preset=_files_beside)
def forest(tab: bpy.types.Panel, context: Context) -> None:
    layout, props = tab.layout, _props(context)
    if is_narrow():
        _draw_files(layout.row())
    if running.missing():
        missing = running.packages_in_words(running.missing())
        _draw_warning(layout, (missing, *running.WHAT_TO_DO)).alert = True
    if props.notice:
        row = layout.row(align=True)  # what happened to this file, and what takes the line away
        row.label(text=props.notice.partition(":")[0], icon="INFO")
        row.operator("forest.take_note", text="", icon="X")
    if context.scene.unit_settings.scale_length != 1:
        _draw_warning(layout, UNIT)
    if forestless(props):
        # The start for a newcomer: two doors, and the way to a file.
        _build_or_progress(layout, "OUTLINER_OB_CURVES", label("Grow Forest"))
        scan = layout.row()
        scan.scale_y = BIG
        scan.operator("forest.scan_here", icon="OUTLINER_OB_POINTCLOUD")
        row = layout.row(align=True)
        row.operator("forest.gallery", text="More Forests", icon="IMGDISPLAY")
        row.operator("forest.load_scene", text="Open")
        return
    # The button that grows, with a star where settings have changed since, and Live beside it.
    row = layout.column(align=True) if is_narrow() else layout.row(align=True)
    star = " *" if build.is_stale(context.scene) else ""
    icon = "FILE_REFRESH" if "forest" in props.results else "OUTLINER_OB_CURVES"
    _build_or_progress(row, icon, label("Grow Forest") + star)
    beside = row.row(align=True)
    beside.scale_y = BIG
    beside.ui_units_x = 0 if is_narrow() else 3
    beside.prop(props, "live", toggle=True)
    column = split(layout)
    seed = column.row(align=True)
    seed.prop(props, "seed")
    seed.operator("forest.new_seed", text="", icon="FILE_REFRESH")
    draw_field(column, props.forest, "size")
    draw_field(column, props.forest, "instancing")
    draw_display(column, props)


@panel("Planting", OfForest, draw_header_preset=lambda tab, _: draw_presets(tab.layout, "planting"))
def plantings(tab: bpy.types.Panel, context: Context) -> None:
    """Planting of the species that is chosen above: how many, and how they stand."""
    layout, props = tab.layout, _props(context)
    if not props.plantings:
        layout.label(text="No trees: add a planting", icon="INFO")
        return
    column, planting = split(layout), _shown_planting(context)
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
    ready = staticmethod(lambda context: bool(_props(context).plantings))


@panel("Where They Stand", _OfPlanting, bl_options=set())
def intensity(tab: bpy.types.Panel, context: Context) -> None:
    layout, planting = tab.layout, _shown_planting(context)
    layout.active = planting.layout in ("poisson", "clusters", "strauss")
    draw_listed(layout, planting, "gaussians", "gaussian")
    if not planting.gaussians:
        layout.label(text="No hills: the same everywhere", icon="INFO")
    else:
        layout.prop(_props(context), "drag_hills", icon="EMPTY_AXIS", toggle=True)
    layout.label(text="Images")
    draw_listed(layout, planting, "rasters", "raster")
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


def _part(name: str, title: str, names: tuple[str, ...], which: str) -> type:
    """The panel of settings of a planting, or of the group ``which``, heeded by the layout of that name."""

    def draw(tab: bpy.types.Panel, context: Context) -> None:
        column, planting = split(tab.layout), _shown_planting(context)
        column.active = which in ("", planting.layout)
        for each in names:
            draw_field(column, planting, each)
        if not names:
            draw_settings(column, getattr(planting, which))

    return panel(title, _OfPlanting)(draw, name)


limits = _part("limits", "Limits", ("slope_deg", "altitude", "polygon", "holes"), "")
clusters = _part("clusters", "Clusters", (), "clusters")
strauss = _part("strauss", "Keeping Apart", (), "strauss")
_in_rows = _part("rows", "Orchard Rows", (), "rows")
_in_list = _part("list", "List of Trees", ("trees", "collection"), "list")


@panel(
    "Grown to Measure",
    _OfPlanting,
    draw_header=lambda tab, context: tab.layout.prop(
        _shown_planting(context), "use_targets", text=""
    ),
)
def targets(tab: bpy.types.Panel, context: Context) -> None:
    column, planting = split(tab.layout), _shown_planting(context)
    column.active = planting.use_targets
    group = planting.targets
    row = column.row(align=True, heading=name_in(type(group), "dbh"))
    row.prop(group, "use_dbh", text="")
    spread = row.row(align=True)
    spread.active = group.use_dbh
    spread.prop(group.dbh, "mean", text="")
    spread.prop(group.dbh, "sd", text="")
    draw_settings(column, group)


@panel("By Hand", _OfPlanting)
def by_hand(tab: bpy.types.Panel, context: Context) -> None:
    """Single trees of the chosen planting that stay as they were set, discs without trees."""
    layout, planting, props = tab.layout, _shown_planting(context), _props(context)
    text = label("Done Planting") if is_planting() else label("Plant by Hand")
    row = layout.row()
    row.scale_y = BIG
    row.operator("forest.plant", text=text, icon="CHECKMARK" if is_planting() else "BRUSH_DATA")
    column = split(layout)
    for name in ("plant_radius", "plant_density"):
        draw_named(column, props, name, name_in(type(props), name), is_narrow())
    column.prop(props, "plant_grows")
    layout.label(text="Selected Trees")
    row = layout.column(align=True)  # side by side their names would be cut off
    for name, icon in (("lock", "LOCKED"), ("swap", "FILE_REFRESH"), ("remove", "X")):
        row.operator(f"forest.{name}_trees", icon=icon)
    row.operator("forest.adopt_trees", icon="ADD")
    layout.label(text="Trees Set by Hand")
    draw_listed(layout, planting, "by_hand", "hand_tree")
    layout.label(text="Clearings")
    draw_listed(layout, planting, "clearings", "clearing")


@panel("Spacing", OfForest)
def spacing(tab: bpy.types.Panel, context: Context) -> None:
    layout, field = tab.layout, _props(context).forest
    draw_settings(split(layout), field, {*field.shown} - {"spacing", "spacing_rule"})
    layout.label(text="Between Two Species")
    draw_listed(layout, field, "distances", "distance")


@panel("Stems for Reverb", OfForest)
def stems(tab: bpy.types.Panel, context: Context) -> None:
    props = _props(context)
    draw_listed(tab.layout, props, "stems", "stems")
    if props.stems:
        draw_settings(split(tab.layout), chosen(props, "stems").radius)


@panel("Ground", OfForest)
def ground(tab: bpy.types.Panel, context: Context) -> None:
    layout, props = tab.layout, _props(context)
    column = split(layout)
    for name in ("undergrowth", "origin", "polygon", "holes", "margin"):
        draw_field(column, props.forest, name)
    layout.label(text="Terrain")
    draw_settings(split(layout), props.forest.terrain)
    layout.label(text="On the Map")
    column = split(layout)
    row = column.row(align=True)
    row.prop(props, "offset")
    row.operator("forest.take_offset", text="", icon="IMPORT")
    column.prop(props, "crs")


def _draw_files(row: bpy.types.UILayout) -> None:
    """The buttons for scene files."""
    for name, icon in (("load_scene", "FILE_FOLDER"), ("save_scene", "FILE_TICK")):
        row.operator(f"forest.{name}", text="", icon=icon, emboss=False)
    row.operator("forest.export_others", text="", icon="EXPORT", emboss=False)


def _draw_warning(layout: bpy.types.UILayout, lines: Sequence[str]) -> bpy.types.UILayout:
    """Draw sentences in a box, a line each."""
    box = layout.box()
    column = box.column(align=True)
    for number, line in enumerate(lines):
        column.label(text=label(line), icon="BLANK1" if number else "ERROR")
    return box


def _build_or_progress(layout: bpy.types.UILayout, icon: str, text: str) -> None:
    """The button that builds; while something runs, how far that is, in its place so that nothing moves."""
    row, job = layout.row(align=True), current()
    row.scale_y = BIG
    if job is not None:
        draw_job(row, job)
    else:
        row.operator("forest.build", text=text, icon=icon)
