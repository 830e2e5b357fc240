"""Rasters: PNG and TIFF images, and npy arrays, as numbers.

The black of an image is 0 and its white 1, whatever its depth; floating-point images and arrays count as
they are. Other images, and rare kinds of TIFF, are read where Pillow is there; Blender does not bring it.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import IO

import numpy as np

from ..spec import SpecError
from . import png, tiff
from .foreign import guarded

DEEP = tiff.DEEP
WHITE = {"1": 1.0, "L": 255.0, "LA": 255.0, "RGB": 255.0, "RGBA": 255.0}  # by Pillow's modes


@guarded("an image in shades of grey or an npy array")
def read_raster(path: Path) -> np.ndarray:
    """Pixels (rows, columns) float64, the first row the upper edge.

    Raises
    ------
    SpecError : the file is missing, cannot be read, is in colour or has no pixels.
    """
    pixels = _read_array(path) if path.suffix.lower() == ".npy" else _read_image(path)
    if pixels.ndim != 2 or not pixels.size:
        raise SpecError(
            str(path), f"has the shape {list(pixels.shape)}; give an array of rows and columns"
        )
    return np.asarray(pixels, dtype=np.float64)


def _read_array(path: Path) -> np.ndarray:
    try:
        with open(path, "rb") as file:
            shape = _shape_of(file)
        if math.prod(shape) > png.MOST_PIXELS:
            raise SpecError(
                str(path), f"has the shape {list(shape)}, more than {png.MOST_PIXELS:,} numbers"
            )
        array = np.load(path, allow_pickle=False)
    except (ValueError, EOFError) as problem:
        raise SpecError(str(path), f"is not an npy file of numbers: {problem}") from None
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "buif":
        raise SpecError(str(path), "is not an npy file of real numbers; save a plain array")
    return array


def _shape_of(file: IO[bytes]) -> tuple[int, ...]:
    """The shape that the header of an npy file says; () of another file."""
    try:
        version = np.lib.format.read_magic(file)
        read = {1: np.lib.format.read_array_header_1_0, 2: np.lib.format.read_array_header_2_0}
        return tuple(read[version[0]](file)[0])
    except Exception:  # np.load says what it is
        return ()


def _read_image(path: Path) -> np.ndarray:
    data = path.read_bytes()
    try:
        if data.startswith(png.SIGNATURE):
            pixels, white = png.read_png(data)
        elif data[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
            pixels, white = tiff.read_tiff(data)
        else:
            raise ValueError("it is neither PNG nor TIFF")
    except png.TooLargeError as problem:
        raise SpecError(str(path), str(problem)) from None
    except Exception as problem:  # a damaged image fails anywhere
        pixels, white = _read_by_pillow(path, problem)
    if pixels.shape[2] in (2, 4):  # with alpha, which says nothing about shades
        pixels = pixels[..., :-1]
    if (pixels[..., 1:] != pixels[..., :1]).any():
        raise SpecError(str(path), "is in colour; save it in shades of grey")
    return pixels[..., 0] / white


def _read_by_pillow(path: Path, problem: Exception) -> tuple[np.ndarray, float]:
    """Pixels (H, W, C) and their white by Pillow. problem : why they are not read without it."""
    why = str(problem) or type(problem).__name__
    refused = SpecError(str(path), f"cannot be read ({why}); save it as PNG, TIFF or npy")
    try:
        from PIL import Image
    except ImportError:
        raise refused from None
    try:
        with Image.open(path) as image:
            png.refuse_large(*image.size)
            mode, pixels = image.mode, np.asarray(image)
    except png.TooLargeError as large:
        raise SpecError(str(path), str(large)) from None
    except (OSError, ValueError, Image.DecompressionBombError):
        raise refused from None
    if mode == "F" or mode.startswith("I"):
        return pixels[..., None], 1.0 if mode == "F" else DEEP
    if mode not in WHITE:
        raise SpecError(str(path), f"has the colour mode {mode}; save it in shades of grey")
    return pixels.reshape(*pixels.shape[:2], -1), WHITE[mode]
