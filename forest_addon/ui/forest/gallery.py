"""The gallery of forests: what one may want to do, each with a picture and a sentence.

Shown by *Add > Forest > Gallery* and *File > New > Forest > Gallery*; the same forests stand in both menus,
which the keyboard walks. Pictures are made by packaging/make_previews.py; Blender reads a picture's file when
it shows it.
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import Any, ClassVar

import bpy
import bpy.utils.previews

from ...base.places import ASSETS
from ..shell.words import keep, label

PREVIEWS = ASSETS / "previews"
ACROSS = 3  # cards in a row
LETTERS, LINES = 36, 2  # below a picture


@dataclass(frozen=True)
class Card:
    """A scene of the add-on as the gallery shows it."""

    preset: str
    title: str
    words: str


GALLERY = (
    Card(
        "demo",
        keep("One of Each"),
        keep("Maples and hazels with a tractor, a tripod, a bat and a clap"),
    ),
    Card(
        "maple-walk",
        keep("A Walk in a Maple Stand"),
        keep("Turning beams on your back, carried in a bow through the trees"),
    ),
    Card(
        "conifer-drone",
        keep("A Drone over Conifers"),
        keep("Crowns from above: two legs at 45 m, lines across the way"),
    ),
    Card(
        "simlidar-orchard",
        keep("An Orchard and a Tractor"),
        keep("Rows of apple trees; a fan of beams that drives past them"),
    ),
    Card(
        "hedge-bat",
        keep("A Bat at a Hedge"),
        keep("One call towards a row of hazels, and what comes back of each leaf"),
    ),
    Card(
        "koli-summer",
        keep("A Clap in Koli"),
        keep("Spruces and birches as in Finland, and how long a clap rings there"),
    ),
)

_pictures: Any = None


class FOREST_OT_gallery(bpy.types.Operator):
    """Forests to start from, with pictures"""

    bl_idname = "forest.gallery"
    bl_label = "Gallery"
    bl_options: ClassVar[set[str]] = {"INTERNAL"}

    new: bpy.props.BoolProperty(
        name="New File", description="Begin a file with it", options={"SKIP_SAVE", "HIDDEN"}
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        return context.window_manager.invoke_popup(self, width=720)

    def draw(self, _context: bpy.types.Context) -> None:
        draw_gallery(self.layout, "forest.new" if self.new else "forest.start")

    def execute(self, _context: bpy.types.Context) -> set[str]:
        return {"FINISHED"}


def draw_gallery(layout: bpy.types.UILayout, operator: str) -> None:
    """A card for every forest, three in a row."""
    heading = label("Start a new file with") if operator == "forest.new" else label("Add a forest")
    layout.label(text=heading)
    grid = layout.grid_flow(
        row_major=True, columns=ACROSS, even_columns=True, even_rows=True, align=False
    )
    for card in GALLERY:
        column = grid.box().column(align=True)
        column.template_icon(icon_value=icon_of(card.preset), scale=7.0)
        entry = column.operator(operator, text=label(card.title))
        entry.preset = card.preset
        if operator == "forest.start":
            entry.grow = True
        lines = column.column(align=True)
        lines.active = False
        words = textwrap.wrap(label(card.words), LETTERS)
        for line in words + [""] * (LINES - len(words)):  # cards of a row end at one height
            lines.label(text=line)


def words_of(preset: str) -> str:
    """Return what one does with a preset, in a sentence; empty where the gallery does not show it."""
    return next((label(card.words) for card in GALLERY if card.preset == preset), "")


def icon_of(preset: str) -> int:
    """The number of a preset's picture; 0 where it has none."""
    global _pictures
    if _pictures is None:
        _pictures = bpy.utils.previews.new()
    if preset not in _pictures:
        file = PREVIEWS / f"{preset}.jpg"
        if not any(card.preset == preset for card in GALLERY) or not file.is_file():
            return 0
        tuple(_pictures.load(preset, str(file), "IMAGE").image_size)  # reads it now: no spinner
    return int(_pictures[preset].icon_id)


CLASSES = (FOREST_OT_gallery,)


def unregister() -> None:
    """Free the pictures."""
    global _pictures
    if _pictures is not None:
        bpy.utils.previews.remove(_pictures)
        _pictures = None
