"""Lists of the panel, made from what each says of itself: rows that are drawn, buttons that add and remove.

Blender reports no change of a list by itself, so whoever adds or removes tags the scene.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import bpy

from ..shell.chosen import chosen
from ..shell.running import Button
from ..shell.words import say
from . import hills
from .drawing import draw_settings, split

Context = bpy.types.Context


@dataclass(frozen=True)
class Row:
    """Row of a list; ``right`` stands at its end."""

    text: str
    icon: str
    right: str = ""


@dataclass(frozen=True)
class Listed:
    """A list of settings: the property ``items`` of its owner.

    owner : the group that holds the list, None where there is none; ``no_owner`` says so then.
    changed : what follows when an item was added or removed.
    """

    items: str
    owner: Callable[[Context], Any]
    no_owner: str = ""
    changed: Callable[[Any], None] = lambda owner: None


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


def rows(name: str, meaning: str, row_of: Callable[[Any], Row]) -> type[bpy.types.UIList]:
    """The class that draws a list, FOREST_UL_NAME."""

    def draw_item(_list, _context, layout, _data, item, _icon, _active, _name, _index=0) -> None:
        row = row_of(item)
        line = layout.row(align=True)
        line.label(text=row.text, icon=row.icon)
        if row.right:
            end = line.row()
            end.alignment = "RIGHT"
            end.label(text=row.right)

    body = {"__doc__": meaning, "draw_item": draw_item}
    return type(f"FOREST_UL_{name}", (bpy.types.UIList,), body)


def buttons(
    thing: str,
    title: str,
    listed: Listed,
    adds: str,
    start: Callable[[Any, Context], None] = lambda item, context: None,
) -> tuple[type, type]:
    """The operators forest.add_THING and forest.remove_THING.

    title : what people call an item. adds : the help of the button that adds.
    start : gives a new item, which is the last of the list by then, its first settings.
    """
    said = {
        "add": {"__doc__": adds, "start": staticmethod(start)},
        "remove": {"__doc__": f"Remove the chosen {title.lower()}"},
    }
    add, remove = (
        type(
            f"FOREST_OT_{verb}_{thing}",
            (kind, bpy.types.Operator),
            said[verb]
            | {
                "bl_idname": f"forest.{verb}_{thing}",
                "bl_label": f"{verb.title()} {title}",
                "listed": listed,
            },
        )
        for verb, kind in (("add", _Add), ("remove", _Remove))
    )
    return add, remove


class _Listing(Button):
    """A button beside a list."""

    # Not ClassVar[Listed]: Blender 4.5 evaluates it, typing keeps what it evaluated, by that this module and
    # by that bpy, which then cannot end: a process with bpy as a module would wait for ever.
    listed: ClassVar[Any]

    @classmethod
    def obstacle(cls, context: Context) -> str:
        reason = super().obstacle(context)
        if not reason and cls.listed.owner(context) is None:
            reason = say(cls.listed.no_owner)
        return reason

    def act(self, context: Context) -> str:
        owner, name = self.listed.owner(context), self.listed.items
        number = self.change(getattr(owner, name), getattr(owner, f"active_{name}"), context)
        hills.renew(context.scene)
        setattr(owner, f"active_{name}", number)
        self.listed.changed(owner)
        context.scene.update_tag()
        return ""


class _Add(_Listing):
    def change(self, items: Any, _active: int, context: Context) -> int:
        """Add one item; returns its number."""
        self.start(items.add(), context)
        return len(items) - 1


class _Remove(_Listing):
    @classmethod
    def obstacle(cls, context: Context) -> str:
        reason = super().obstacle(context)
        if reason or len(getattr(cls.listed.owner(context), cls.listed.items)):
            return reason
        return say("The list is empty: there is nothing to remove")

    def change(self, items: Any, active: int, _context: Context) -> int:
        """Remove the chosen item; returns the number of the one that is chosen then."""
        items.remove(active)
        return max(0, min(active, len(items) - 1))
