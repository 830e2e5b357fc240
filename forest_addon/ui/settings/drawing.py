"""Drawing that all panels share: their place, icons of sensors, and how settings are drawn.

Drawing only reads properties; nothing is computed or loaded here.
"""

from __future__ import annotations

import functools
from collections.abc import Collection
from typing import Any

import bpy

from ...sensing.kinds import KINDS
from ...spec.choices import applies, is_advanced
from ..shell.words import label
from .exchange import forestless, untouched
from .groups import PARTS
from .references import is_lost
from .shown import FACE

FOLDED = True  # parts of settings are closed until someone opens them
BIG = 1.4  # heights of a row: the buttons that start work
OF_FOREST = "OUTLINER_OB_CURVES"


def icon_of(kind: str) -> str:
    """The icon of a kind of sensor, or of the forest."""
    return KINDS[kind].icon if kind in KINDS else OF_FOREST if kind == "forest" else "DOT"


class Tab:
    """Place of our panels."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Forest"


class OnceStarted(Tab):
    """A panel that appears when there are settings to show."""

    bl_order = 1  # Species comes first

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return not untouched(context.scene.forest_sensing)


class WithForest(OnceStarted):
    """A panel that appears when a forest is to stand here; who senses a scene of his own needs none."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return not forestless(context.scene.forest_sensing)


def split(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """A column with labels to the left and values to the right."""
    column = layout.column()
    column.use_property_split = True
    column.use_property_decorate = False
    return column


def folded(layout: bpy.types.UILayout, name: str) -> tuple[bpy.types.UILayout, Any]:
    """Header and body of a part of a panel that is closed at first; None for a closed one's body."""
    return layout.panel(name, default_closed=FOLDED)


def draw_settings(
    layout: bpy.types.UILayout, group: Any, hidden: Collection[str] = frozenset()
) -> None:
    """The settings of a group that have an effect now, in the order of ``spec``; the basic ones or all."""
    kind = type(group)
    every, basic = _by_depth(kind)
    if every is not basic and bpy.context.scene.forest_sensing.advanced:
        basic = every
    for name in basic:
        if name not in hidden and applies(group, name):
            draw_field(layout, group, name)


def is_shown(group: Any, name: str) -> bool:
    """Return whether a setting is shown beside what the others are set to, at the depth that is chosen."""
    if not applies(group, name):
        return False
    every, basic = _by_depth(type(group))
    return every is basic or name in basic or bpy.context.scene.forest_sensing.advanced


@functools.cache
def _by_depth(kind: type) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the settings of a class, all and the basic ones; the same tuple where all are basic."""
    settings = kind.__name__.removeprefix("FOREST_PG_")
    every: tuple[str, ...] = kind.shown  # type: ignore[attr-defined]
    basic = tuple(name for name in every if not is_advanced(settings, name))
    return every, every if basic == every else basic


@functools.cache
def name_in(kind: type, name: str) -> str:
    """Return the name of a property of a class, as Blender looks it up in its catalogs; looked up once."""
    return str(kind.bl_rna.properties[name].name)  # type: ignore[attr-defined]


@functools.cache
def _way(kind: type, name: str) -> tuple[str, str, str]:
    """Return how a setting of a class is drawn, the property that shows it, and its name: looked up once."""
    known = kind.bl_rna.properties  # type: ignore[attr-defined]
    face = f"{name}{FACE}" if f"{name}{FACE}" in known else name
    if f"{name}_pointer" in known:
        way = "reference"
    elif f"use_{name}" in known:
        way = "optional"
    else:
        pair = name in PARTS and getattr(known[face], "is_array", False)
        way = "pair" if pair else "plain"
    return way, face, str(known[face].name)


def draw_field(layout: bpy.types.UILayout, group: Any, name: str) -> None:
    """One setting: pairs as two rows, a value that may be left out behind its switch."""
    way, face, title = _way(type(group), name)
    if way == "plain":
        layout.prop(group, face)
    elif way == "reference":
        draw_reference(layout, group, name)
    elif way == "optional":
        row = layout.row(align=True, heading=title)
        row.prop(group, f"use_{name}", text="")
        value = row.row(align=True)
        value.active = getattr(group, f"use_{name}")
        value.prop(group, face, text="")
    else:
        column = layout.column(align=True)
        first, second = PARTS[name]
        words, space, unit = label(title).partition(" (")
        column.prop(
            group, face, index=0, text=label("{setting} {end}", setting=words, end=label(first))
        )
        column.prop(group, face, index=1, text=f"{label(second)}{space}{unit}")


def draw_reference(layout: bpy.types.UILayout, group: Any, name: str) -> None:
    """Draw the thing that a setting names, to be picked; a name that nothing here has stands below as a
    text."""
    layout.prop(group, f"{name}_pointer")
    if is_lost(group, name):
        layout.prop(group, name, text=label("Not Here"), icon="ERROR")
    elif f"{name}_layer" in group.bl_rna.properties and getattr(group, f"{name}_pointer"):
        layout.prop(group, f"{name}_layer")
