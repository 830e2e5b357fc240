"""The legend of a cloud: names or values of the choice that its menu *Colour By* has, beside their colours.

A colour is shown as an icon of ours, made when it is first drawn and kept until the add-on is disabled.
"""

from __future__ import annotations

from typing import Any

import bpy
import bpy.utils.previews
import numpy as np

from ...blender.show.cloud_nodes import on_map

SIDE = 32  # pixels of an icon
EDGE = 2  # of these, left free around it
RIM = 2  # of these, around the colour: dark around what is light and light around what is dark
LUMA = np.array([0.2126, 0.7152, 0.0722])  # how bright each channel looks (ITU-R BT.709)
GAMMA = 1 / 2.2  # colours are linear, the screen's are not

_swatches: Any = None


def draw_legend(layout: bpy.types.UILayout, result: Any, choice: str, colour_map: str = "") -> None:
    """Draw what the colours of this choice mean, two in a row; nothing where nobody noted it.

    colour_map : the scale that values are coloured on; empty: as they were noted.
    """
    entries = [entry for entry in result.legend if entry.choice == choice]
    if not entries:
        return
    colours = [tuple(entry.colour) for entry in entries]
    if colour_map:
        colours = [on_map(colour_map, k / max(1, len(entries) - 1)) for k in range(len(entries))]
    rows = layout.column(align=True)
    for first in range(0, len(entries), 2):
        row = rows.split(factor=0.5)
        for number in range(first, min(first + 2, len(entries))):
            row.label(text=entries[number].name, icon_value=_icon(colours[number]))


def unregister() -> None:
    """Free the icons."""
    global _swatches
    if _swatches is not None:
        bpy.utils.previews.remove(_swatches)
        _swatches = None


def pixels_of(colour: tuple[float, float, float]) -> np.ndarray:
    """(SIDE, SIDE, 4) a square of a colour, as the screen has it, rimmed, so that it is seen on any theme."""
    pixels = np.zeros((SIDE, SIDE, 4), np.float32)
    shown = np.array([channel**GAMMA for channel in colour])
    rim = 0.05 if shown @ LUMA > 0.5 else 0.95
    for edge, filled in ((EDGE, (rim, rim, rim)), (EDGE + RIM, shown)):
        inner = slice(edge, SIDE - edge)
        pixels[inner, inner] = (*filled, 1.0)
    return pixels


def _icon(colour: tuple[float, float, float]) -> int:
    global _swatches
    if _swatches is None:
        _swatches = bpy.utils.previews.new()
    name = " ".join(f"{channel:.4f}" for channel in colour)
    if name not in _swatches:
        made = _swatches.new(name)
        made.icon_size = (SIDE, SIDE)
        made.icon_pixels_float.foreach_set(pixels_of(colour).ravel())
    return int(_swatches[name].icon_id)
