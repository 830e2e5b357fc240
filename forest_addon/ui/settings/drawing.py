"""Drawing that all panels share: their place, icons of sensors, how settings and lists of them are drawn.

Drawing only reads properties; nothing is computed or loaded here. Lists are made from what each says of
itself: rows that are drawn, buttons that add and remove. Blender reports no change of a list by itself, so
whoever adds or removes tags the scene.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any, ClassVar

import bpy

from ...sensing.kinds import KINDS
from ...spec.choices import applies, is_advanced
from ..shell.running import Button
from ..shell.views import chosen
from ..shell.words import keep, label, label_kept
from . import hills
from .exchange import forestless, untouched
from .groups import FACE, PARTS
from .references import is_lost

FOLDED = True  # parts of settings are closed until someone opens them
BIG = 1.4  # heights of a row: the buttons that start work
NARROW = 210  # pixels, of an interface in its usual size
LETTERS = 10  # of a name that a number leaves room for where it is narrow
OF_FOREST = "OUTLINER_OB_CURVES"
NO_TITLES: Mapping[str, str] = {}


def icon_of(kind: str) -> str:
    """The icon of a kind of sensor, or of the forest."""
    return KINDS[kind].icon if kind in KINDS else OF_FOREST if kind == "forest" else "DOT"


class Tab:
    """Place of our panels. ready, needs : what must hold of the context for one of its sort, and for it."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Forest"
    ready = needs = staticmethod(lambda _context: True)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(cls.ready(context) and cls.needs(context))


class OnceStarted(Tab):
    """A panel that appears when there are settings to show."""

    bl_order = 1  # Species comes first
    ready = staticmethod(lambda context: not untouched(context.scene.forest_sensing))


class WithForest(OnceStarted):
    """A panel that appears when a forest is to stand here; who senses a scene of his own needs none."""

    ready = staticmethod(lambda context: not forestless(context.scene.forest_sensing))


class OfForest(WithForest):
    """More of the forest, closed until someone opens it."""

    bl_parent_id = "FOREST_PT_forest"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}


class OfSensors(OnceStarted):
    """More of sensors, closed until someone opens it; results stay in sight."""

    bl_parent_id = "FOREST_PT_sensors"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}


class OfData(Tab):
    """A panel in the Properties editor, where Blender's own meshes, cameras and lamps have theirs."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_category = ""
    bl_context = "data"


def is_narrow() -> bool:
    """Return whether names would be cut off beside values in the region that is drawn."""
    region, scale = bpy.context.region, bpy.context.preferences.system.ui_scale
    return region is not None and 1 < region.width < NARROW * scale


def split(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """A column with labels to the left and values to the right; where it is narrow, within or above these."""
    column = layout.column()
    column.use_property_split = not is_narrow()
    column.use_property_decorate = False
    return column


def open_parts(
    layout: bpy.types.UILayout, group: Any, place: str, titles: Mapping[str, str] = NO_TITLES
) -> Iterator[tuple[str, bpy.types.UILayout]]:
    """Draw the header of each part of a group; gives the name and the body of those that are open.

    place : of the parts, by which Blender knows which are open. titles : of parts that have another.
    """
    for name in group.nested:
        header, body = layout.panel(f"FOREST_{place}_{name}", default_closed=FOLDED)
        if has(type(group), f"use_{name}"):
            header.prop(group, f"use_{name}", text="")
        header.label(text=label_kept(titles.get(name) or name_in(type(group), name)))
        if body is not None:
            body.active = getattr(group, f"use_{name}", True)
            yield name, body


def draw_settings(
    layout: bpy.types.UILayout, group: Any, hidden: Collection[str] = frozenset()
) -> None:
    """The settings of a group that have an effect now, in the order of ``spec``; the basic ones or all."""
    every, basic = _by_depth(type(group))
    if every is not basic and bpy.context.scene.forest_sensing.advanced:
        basic = every
    for name in basic:
        if name not in hidden and applies(group, name):
            draw_field(layout, group, name)


@functools.cache
def _by_depth(kind: type) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the settings of a class, all and the basic ones; the same tuple where all are basic."""
    settings = kind.__name__.removeprefix("FOREST_PG_")
    every: tuple[str, ...] = kind.shown  # type: ignore[attr-defined]
    basic = tuple(name for name in every if not is_advanced(settings, name))
    return every, every if basic == every else basic


@functools.cache
def has(kind: type, name: str) -> bool:
    """Return whether a class of settings has a property; looked up once."""
    return name in kind.bl_rna.properties  # type: ignore[attr-defined]


@functools.cache
def name_in(kind: type, name: str) -> str:
    """Return the name of a property of a class, as Blender looks it up in its catalogs; looked up once."""
    return str(kind.bl_rna.properties[name].name)  # type: ignore[attr-defined]


@functools.cache
def _way(kind: type, name: str) -> tuple[str, str, str]:
    """Way to draw a setting of a class, the property that shows it, and its name: looked up once."""
    known = kind.bl_rna.properties  # type: ignore[attr-defined]
    face = f"{name}{FACE}" if f"{name}{FACE}" in known else name
    if f"{name}_pointer" in known:
        way = "reference"
    elif f"use_{name}" in known:
        way = "optional"
    elif name in PARTS and getattr(known[face], "is_array", False):
        way = "pair"
    else:
        way = {"BOOLEAN": "switch", "STRING": "text", "ENUM": "text"}.get(known[face].type, "plain")
    return way, face, str(known[face].name)


def draw_field(layout: bpy.types.UILayout, group: Any, name: str) -> None:
    """One setting: pairs as two rows, a value that may be left out behind its switch."""
    way, face, title = _way(type(group), name)
    narrow = is_narrow()
    if way == "reference":
        draw_reference(layout, group, name)
    elif way == "optional":
        row = layout.column() if narrow else layout.row(align=True, heading=title)
        row.prop(group, f"use_{name}", text=title if narrow else "")
        value = row.row(align=True)
        value.active = getattr(group, f"use_{name}")
        value.prop(group, face, text="")
    elif way == "pair":
        column = layout.column(align=True)
        first, second = PARTS[name]
        words, space, unit = label(title).partition(" (")
        begin = label("{setting} {end}", setting=words, end=label(first))
        if narrow:
            column.label(text=words)
            begin = f"{label(first)}{space}{unit}"
        column.prop(group, face, index=0, text=begin)
        column.prop(group, face, index=1, text=f"{label(second)}{space}{unit}")
    else:
        above = narrow and (way == "text" or (way == "plain" and len(title) > LETTERS))
        draw_named(layout, group, face, title, above)


def draw_named(layout: bpy.types.UILayout, owner: Any, name: str, title: str, above: bool) -> None:
    """A property with its name before or within it, or above."""
    if above:
        layout.label(text=title)
    layout.prop(owner, name, text="" if above else title)


def draw_reference(layout: bpy.types.UILayout, group: Any, name: str) -> None:
    """Draw the thing that a setting names, to be picked; a name that nothing here has stands below as a
    text."""
    pointer = f"{name}_pointer"
    draw_named(layout, group, pointer, name_in(type(group), pointer), is_narrow())
    if is_lost(group, name):
        layout.prop(group, name, text=label("Not Here"), icon="ERROR")
    elif f"{name}_layer" in group.bl_rna.properties and getattr(group, f"{name}_pointer"):
        layout.prop(group, f"{name}_layer")


Context = bpy.types.Context


def draw_list(
    layout: bpy.types.UILayout, owner: Any, name: str, thing: str, shown: str = ""
) -> None:
    """A list with buttons that add and remove a THING; ``shown`` names its rows, by default as the list."""
    row = layout.row()
    known = f"FOREST_UL_{shown or name}"
    row.template_list(known, "", owner, name, owner, f"active_{name}", rows=2)
    buttons = row.column(align=True)
    buttons.operator(f"forest.add_{thing}", text="", icon="ADD")
    buttons.operator(f"forest.remove_{thing}", text="", icon="REMOVE")


def draw_listed(
    layout: bpy.types.UILayout, owner: Any, name: str, thing: str, shown: str = ""
) -> None:
    """A list, and the settings of the chosen item below it."""
    draw_list(layout, owner, name, thing, shown)
    if getattr(owner, name):
        draw_settings(split(layout), chosen(owner, name))


def rows(
    name: str, meaning: str, row_of: Callable[[Any], tuple[str, str, str]]
) -> type[bpy.types.UIList]:
    """The class that draws a list, FOREST_UL_NAME. row_of : text and icon of an item, and what stands at the
    end of its row."""

    def draw_item(_list, _context, layout, _data, item, _icon, _active, _name, _index=0) -> None:
        text, icon, right = row_of(item)
        line = layout.row(align=True)
        line.label(text=text, icon=icon)
        if right and not is_narrow():
            end = line.row()
            end.alignment = "RIGHT"
            end.label(text=right)

    body = {"__doc__": meaning, "draw_item": draw_item}
    return type(f"FOREST_UL_{name}", (bpy.types.UIList,), body)


def buttons(
    thing: str,
    title: str,
    items: str,
    owner: Callable[[Context], Any],
    no_owner: str,
    adds: str,
    start: Callable[[Context], dict[str, Any]] = lambda context: {},
    changed: Callable[[Any], None] = lambda owner: None,
) -> tuple[type, type]:
    """The operators forest.add_THING and forest.remove_THING of a list of settings.

    title : what people call an item. items : the property that is the list, of the group that ``owner``
    gives; None where there is none, ``no_owner`` says so then. adds : the help of the button that adds.
    start : the first settings of a new item, which is the last of the list by then. changed : what follows
    when an item was added or removed.
    """
    owned = (lambda context: owner(context) is not None, no_owner)
    empty = keep("The list is empty: there is nothing to remove")
    filled = (lambda context: len(getattr(owner(context), items)) > 0, empty)
    add, remove = (
        type(
            f"FOREST_OT_{verb}_{thing}",
            (_Listing, bpy.types.Operator),
            {
                "__doc__": words,
                "bl_label": f"{verb.title()} {title}",
                "needs": needs,
                "items": items,
                "owner": staticmethod(owner),
                "changed": staticmethod(changed),
                "start": start and staticmethod(start),
            },
        )
        for verb, words, needs, start in (
            ("add", adds, (owned,), start),
            ("remove", f"Remove the chosen {title.lower()}", (owned, filled), None),
        )
    )
    return add, remove


class _Listing(Button):
    """A button that adds an item to a list, with ``start`` for its first settings; without, removes one."""

    items: str
    owner: Any
    changed: Any
    start: Any

    def act(self, context: Context) -> str:
        owner, name = self.owner(context), self.items
        items, active = getattr(owner, name), getattr(owner, f"active_{name}")
        if self.start:
            item = items.add()
            for key, value in self.start(context).items():
                setattr(item, key, value)
            active = len(items)
        else:
            items.remove(active)
        hills.renew(context.scene)
        setattr(owner, f"active_{name}", max(0, min(active, len(items) - 1)))
        self.changed(owner)
        context.scene.update_tag()
        return ""
