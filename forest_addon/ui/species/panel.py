"""The sub-panel *Species*: what the chosen planting plants, as a picture, and its settings when edited."""

from __future__ import annotations

import functools
from typing import Any

import bpy

from ..settings.drawing import (
    WithForest,
    draw_list,
    draw_settings,
    folded,
    is_narrow,
    name_in,
    split,
)
from ..shell.running import panel
from ..shell.views import chosen_planting
from ..shell.words import keep, label, label_kept
from .edit import edited_item

GROWN = ("siblings", "rules", "honda", "crown")  # in place of the grammar
SPREADS = {"FOREST_PG_normal": ("mean", "sd"), "FOREST_PG_discrete": ("values", "weights")}


@panel("Species", WithForest, bl_parent_id="FOREST_PT_forest", bl_order=0)
def species(tab: bpy.types.Panel, context: bpy.types.Context) -> None:
    layout, props = tab.layout, context.scene.forest_sensing
    draw_list(layout, props, "plantings", "planting")
    halves = layout.column() if is_narrow() else layout.split(factor=0.5)
    if chosen_planting(props) is not None:
        halves.template_icon_view(
            props, "species_picture", show_labels=True, scale=5.5, scale_popup=6.5
        )
    buttons = halves.column(align=True)
    if not _is_edited(context):
        buttons.operator("forest.edit_species", icon="GREASEPENCIL")
    else:
        buttons.operator("forest.build", icon="FILE_REFRESH")
        buttons.operator("forest.save_species", icon="FILE_TICK")
        buttons.operator("forest.discard_species", icon="LOOP_BACK")
    buttons.separator()
    buttons.operator("forest.import_tree", icon="IMPORT")
    buttons.operator("forest.make_library", text="As Assets", icon="ASSET_MANAGER")


def _is_edited(context: bpy.types.Context) -> bool:
    return edited_item(context.scene.forest_sensing) is not None


SECTIONS = {  # of a species: by what they do
    "template": keep("Branches from STL Files"),
    "siblings": keep("Trees Like That One"),
    "grammar": keep("L-system of the Papers"),
    "rules": keep("L-system of Your Own"),
    "honda": keep("Branching by Angles and Ratios"),
    "crown": keep("Crown That Fills a Shape"),
    "architecture": keep("Limbs, Forks, Dead Branches"),
    "targets": keep("Size to Reach"),
    "needles": keep("Shoots of Needles"),
    "jitter": keep("Natural Variation"),
    "leaf": keep("Leaves"),
    "inclination": keep("How Leaves Incline"),
    "detail": keep("Detail of the Mesh"),
    "look": keep("Colours"),
    "bark": keep("Bark"),
}


@panel("Species Settings", WithForest, bl_parent_id="FOREST_PT_species", needs=_is_edited)
def edited(tab: bpy.types.Panel, context: bpy.types.Context) -> None:
    """The settings of an edited species, part by part."""
    group = edited_item(context.scene.forest_sensing).settings
    for part in group.nested:
        header, body = folded(tab.layout, f"FOREST_species_{part}")
        if _has(type(group), f"use_{part}"):
            header.prop(group, f"use_{part}", text="")
        header.label(text=label_kept(SECTIONS.get(part) or name_in(type(group), part)))
        if body is not None:
            body.active = getattr(group, f"use_{part}", True) and not _is_idle(group, part)
            _draw_part(body, getattr(group, part))
    split(tab.layout).prop(group, "source")


def _is_idle(group: Any, part: str) -> bool:
    """Return whether a part of a species has no effect beside others that are in use."""
    if part in ("grammar", "jitter"):
        return any(getattr(group, f"use_{other}") for other in GROWN)
    if part == "siblings":
        return not group.use_template
    return part == "detail" and group.use_template


def _draw_part(layout: bpy.types.UILayout, group: Any) -> None:
    """Numbers and texts first, then what is drawn from a distribution."""
    wide = ("axiom", "productions", "constants", "symbols")  # texts of an L-system
    long = [name for name in group.shown if name in wide]
    draw_settings(split(layout), group, long)
    kind = type(group)
    for name in long:
        layout.label(text=name_in(kind, name))
        layout.prop(group, name, text="")
    for name in group.nested:
        if type(getattr(group, name)).__name__ in SPREADS:
            _draw_spread(layout, group, name)
        else:
            layout.label(text=name_in(kind, name))
            _draw_part(layout, getattr(group, name))


@functools.cache
def _has(kind: type, name: str) -> bool:
    """Return whether a class of settings has a property; looked up once."""
    return name in kind.bl_rna.properties  # type: ignore[attr-defined]


def _draw_spread(layout: bpy.types.UILayout, owner: Any, name: str) -> None:
    """A distribution in a line or two: what is drawn, and within which limits."""
    group, kind = getattr(owner, name), type(owner)
    first, second = SPREADS[type(group).__name__]
    column = layout.column(align=True)
    row = _line(column, name_in(kind, name))
    if _has(kind, f"use_{name}"):
        row.prop(owner, f"use_{name}", text="")
    row.prop(group, first, text="")
    row.prop(group, second, text="", placeholder="weights")
    if _has(type(group), "use_low"):
        row = _line(column, label("Within"))
        for limit in ("low", "high"):
            row.prop(group, f"use_{limit}", text="")
            value = row.row(align=True)
            value.active = getattr(group, f"use_{limit}")
            value.prop(group, limit, text="")


def _line(column: bpy.types.UILayout, heading: str) -> bpy.types.UILayout:
    """A row for several values, with a label to the left as other settings have it."""
    halves = column.split(factor=0.4)
    left = halves.row()
    left.alignment = "RIGHT"
    left.label(text=heading)
    return halves.row(align=True)
