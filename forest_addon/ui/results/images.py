"""Plots as Blender images: axes and numbers around the pixels, and a small one for the panel.

Text is drawn with Blender's own font into an image buffer. Blender 4.5 gives no access to its pixels: there
it goes through a file in Blender's temporary folder, and is left out where that is full.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from pathlib import Path

import blf
import bpy
import imbuf
import numpy as np

from ...blender.scene.attributes import give_picture
from ...blender.scene.layout import ROLE_KEY, by_role, own
from ...drawing.strips import Axis, Plot, Strip
from ..shell.words import label_kept

LEFT, RIGHT, BELOW, ABOVE = 96, 28, 66, 38  # pixels around strips; ABOVE each for its title
BAR, BESIDE = (
    18,
    110,
)  # pixels of a scale of colours, and of the room that it takes with its numbers
FONT, SIZE = 0, 18
GROUND, TEXT, LINE = 0.03, 0.85, 0.35  # grey
TICK = 6  # pixels
ICON = 256  # pixels of the panel's picture, a square

Label = tuple[
    str, float, float, float, float
]  # text, where, and how much of its size is left and below


def show(name: str, plot: Plot) -> bpy.types.Image:
    """A plot as the Blender image of this name, packed into the file, its preview without the axes."""
    canvas = drawn(plot)
    image = _image(name, canvas.shape[1], canvas.shape[0])
    image.pixels.foreach_set(_with_alpha(canvas).ravel())
    image.update()
    image.pack()  # a drawn image would be lost when the file is saved
    image.buffers_free()  # 3 MB; what shows it reads the packed file, of some 20 KB
    give_picture(image, _with_alpha(_small(plot)))
    return image


def drawn(plot: Plot) -> np.ndarray:
    """A plot with axes and texts, (H, W, 3) of 0 to 1, the lowest row first."""
    canvas, labels = _compose(plot)
    return np.maximum(canvas, TEXT * _written(labels, canvas.shape)[..., None])


def ticks(axis: Axis, most: int) -> list[float]:
    """Round values along an axis, at most so many: 1, 2 or 5 times a power of ten, or steps of so much."""
    if axis.log:
        low, high = math.floor(math.log10(axis.low)), math.ceil(math.log10(axis.high))
        round_ones = [factor * 10.0**power for power in range(low, high) for factor in (1, 2, 5)]
        values = [value for value in round_ones if axis.low <= value <= axis.high]
        return values[:: -(-len(values) // most)] if values else [axis.low]
    span = axis.high - axis.low
    if not span > 0:
        return [axis.low]
    power = 10.0 ** math.floor(math.log10(span / most))
    step = next(
        power * factor for factor in (1, 2, 5, 10, 20) if span / (power * factor) < most + 1e-9
    )
    first, last = math.ceil(axis.low / step - 1e-9), math.floor(axis.high / step + 1e-9)
    return [number * step for number in range(first, last + 1)]


def _image(name: str, wide: int, high: int) -> bpy.types.Image:
    """Our image of this name, which editors go on showing; an image of the user's is left alone."""
    image = by_role(bpy.data.images).get(name)
    if image is None:
        image = own(bpy.data.images.new(name, wide, high))
        image[ROLE_KEY] = name
    elif tuple(image.size) != (wide, high):
        image.scale(wide, high)
    return image


def _compose(plot: Plot) -> tuple[np.ndarray, list[Label]]:
    """The canvas with strips, frames and ticks, and what is to be written on it."""
    wide = plot.strips[0].pixels.shape[1]
    high = BELOW + sum(len(strip.pixels) + ABOVE for strip in plot.strips)
    beside = BESIDE if any(strip.values for strip in plot.strips) else RIGHT
    canvas = np.full((high, LEFT + wide + beside, 3), GROUND)
    labels: list[Label] = []
    bottom = BELOW
    for strip in plot.strips:
        labels.extend(_draw_strip(canvas, strip, plot.across, bottom))
        bottom += len(strip.pixels) + ABOVE
    for value, column in _places(plot.across, wide, 10, 80):
        labels.append((f"{value:g}", LEFT + column, BELOW - TICK - 4, 0.5, 1.0))
    labels.append((label_kept(plot.across.label), LEFT + wide / 2, 10, 0.5, 0.0))
    return canvas, labels


def _draw_strip(canvas: np.ndarray, strip: Strip, across: Axis, bottom: int) -> Iterator[Label]:
    high, wide, _ = strip.pixels.shape
    top, right = bottom + high, LEFT + wide
    canvas[bottom - 1 : top + 1, LEFT - 1 : right + 1] = LINE
    canvas[bottom:top, LEFT:right] = strip.pixels
    for _, column in _places(across, wide, 10, 80):
        canvas[bottom - TICK : bottom, LEFT + column] = LINE
    yield (label_kept(strip.title), LEFT, top + 10, 0.0, 0.0)
    yield (label_kept(strip.up.label), right, top + 10, 1.0, 0.0)
    for value, row in _places(strip.up, high, 6, 30):
        canvas[bottom + row, LEFT - TICK : LEFT] = LINE
        yield (f"{value:g}", LEFT - TICK - 6, bottom + row, 1.0, 0.5)
    if strip.values is None:
        return
    foot = right + RIGHT // 2
    place = np.linspace(0.0, len(strip.colours) - 1.0, high)
    for channel in range(3):
        shades = np.interp(place, np.arange(len(strip.colours)), strip.colours[:, channel])
        canvas[bottom:top, foot : foot + BAR, channel] = shades[:, None]
    yield (label_kept(strip.values.label), foot + BAR, top + 10, 0.5, 0.0)
    for value, row in _places(strip.values, high, 6, 30):
        canvas[bottom + row, foot + BAR : foot + BAR + TICK] = LINE
        yield (f"{value:g}", foot + BAR + TICK + 6, bottom + row, 0.0, 0.5)


def _places(axis: Axis, pixels: int, most: int, apart: int) -> Iterator[tuple[float, int]]:
    """Ticks of an axis and the pixels that they are at, so far apart that their numbers have room."""
    even = math.log if axis.log else float
    low, span = even(axis.low), (even(axis.high) - even(axis.low)) or 1.0
    for value in ticks(axis, max(1, min(most, pixels // apart))):
        yield round(value, 9), round((even(value) - low) / span * (pixels - 1))


def _written(labels: list[Label], shape: tuple[int, ...]) -> np.ndarray:
    """(H, W) of 0 to 1: where the labels are."""
    high, wide = shape[:2]
    paper = imbuf.new((wide, high))
    blf.size(FONT, SIZE)
    blf.color(FONT, 1.0, 1.0, 1.0, 1.0)
    with blf.bind_imbuf(FONT, paper):
        for text, x, y, left, below in labels:
            _, tall = blf.dimensions(FONT, "0")
            blf.position(FONT, x - left * blf.dimensions(FONT, text)[0], y - below * tall, 0)
            blf.draw_buffer(FONT, text)
    if not hasattr(paper, "with_buffer"):
        wide, high = paper.size
        with tempfile.TemporaryDirectory(dir=bpy.app.tempdir) as folder:
            file = str(Path(folder) / "labels.png")
            try:
                imbuf.write(paper, filepath=file)
                image = bpy.data.images.load(file)
            except (OSError, RuntimeError):
                return np.zeros((high, wide))
            pixels = np.zeros(high * wide * 4, dtype=np.float32)
            if len(image.pixels) == len(pixels):
                image.pixels.foreach_get(pixels)
            bpy.data.images.remove(image)
        return pixels.reshape(high, wide, 4)[..., 0]
    with paper.with_buffer() as pixels:
        return np.asarray(pixels)[..., 0] / 255.0


def _small(plot: Plot) -> np.ndarray:
    """(ICON, ICON, 3): the strips alone, as wide for their height as they are."""
    pixels = np.concatenate([strip.pixels for strip in plot.strips])
    longest = max(pixels.shape[:2])
    rows, columns = (
        np.arange(max(1, ICON * n // longest)) * longest // ICON for n in pixels.shape[:2]
    )
    icon = np.full((ICON, ICON, 3), GROUND)
    top, left = (ICON - len(rows)) // 2, (ICON - len(columns)) // 2
    icon[top : top + len(rows), left : left + len(columns)] = pixels[np.ix_(rows, columns)]
    return icon


def _with_alpha(colours: np.ndarray) -> np.ndarray:
    pixels = np.ones((*colours.shape[:2], 4), dtype=np.float32)
    pixels[..., :3] = colours
    return pixels
