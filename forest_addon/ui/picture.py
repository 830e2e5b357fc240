"""A signal as a picture: its level over time, drawn with numpy into a Blender image."""

from __future__ import annotations

import bpy
import numpy as np

SIDE = 256  # pixels; the panel shows squares
FLOOR_DB = -80.0
PAPER, INK, LOUD = (0.11, 0.13, 0.12), (0.25, 0.47, 0.22), (0.80, 0.90, 0.45)


def draw_level(name: str, signal: np.ndarray) -> tuple[bpy.types.Image, int]:
    """Draw a signal (N,) into the image of this name, made where it is missing.

    Returns the image and how many samples it shows: up to the last that is above the floor.
    """
    level = level_db(signal)
    heard = np.flatnonzero(level > FLOOR_DB)
    drawn = int(heard[-1]) + 1 if len(heard) else len(level)
    picture = level_picture(level[:drawn])
    image = bpy.data.images.get(name)
    if image is None or tuple(image.size) != (SIDE, SIDE):
        if image is not None:
            bpy.data.images.remove(image)
        image = bpy.data.images.new(name, SIDE, SIDE)
    image.pixels.foreach_set(picture.ravel())
    image.update()
    image.pack()  # a drawn image would be lost when the file is saved
    preview = image.preview_ensure()
    preview.image_size = (SIDE, SIDE)
    preview.image_pixels_float.foreach_set(picture.ravel())
    return image, drawn


def level_db(signal: np.ndarray) -> np.ndarray:
    """(N,) dB re the largest, not below ``FLOOR_DB``; silence is at the floor."""
    size = np.abs(signal)
    largest = size.max(initial=0.0) or 1.0
    floor = 10.0 ** (FLOOR_DB / 20)
    level: np.ndarray = 20 * np.log10(np.maximum(size / largest, floor))
    return level


def level_picture(level: np.ndarray) -> np.ndarray:
    """(SIDE, SIDE, 4) float32: the loudest of each column, brighter where it is louder."""
    height = np.zeros(SIDE)
    if len(level):
        first = np.linspace(0, len(level), SIDE, endpoint=False).astype(int)
        height = 1 - np.maximum.reduceat(level, first) / FLOOR_DB
    row = (np.arange(SIDE) + 0.5)[:, None] / SIDE
    shade = np.array(INK) + row[..., None] * (np.array(LOUD) - np.array(INK))
    picture = np.ones((SIDE, SIDE, 4), dtype=np.float32)
    picture[..., :3] = np.where((row < height)[..., None], shade, PAPER)
    return picture
