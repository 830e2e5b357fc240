"""Rasters: PNG and TIFF images, and npy arrays, as numbers.

The black of an image is 0 and its white 1, whatever its depth; floating-point images and arrays count as
they are. Images are read by Pillow, which matplotlib brings.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..spec import SpecError
from .foreign import guarded

WHITE = {"1": 1.0, "L": 255.0, "LA": 255.0, "RGB": 255.0, "RGBA": 255.0}
DEEP = 65535.0  # white of 16-bit images, which Pillow gives as I;16 or, from some files, as I


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
        array = np.load(path, allow_pickle=False)
    except (ValueError, EOFError) as problem:
        raise SpecError(str(path), f"is not an npy file of numbers: {problem}") from None
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "buif":
        raise SpecError(str(path), "is not an npy file of real numbers; save a plain array")
    return array


def _read_image(path: Path) -> np.ndarray:
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as image:
            mode, pixels = image.mode, np.asarray(image)
    except FileNotFoundError:
        raise
    except (UnidentifiedImageError, Image.DecompressionBombError, OSError, ValueError) as problem:
        raise SpecError(
            str(path), f"cannot be read ({problem}); save it as PNG, TIFF or npy"
        ) from None
    if mode == "F":
        return pixels
    if mode.startswith("I"):
        return pixels / DEEP
    if mode not in WHITE:
        raise SpecError(str(path), f"has the colour mode {mode}; save it in shades of grey")
    if pixels.ndim == 3:
        grey = pixels[..., :3] if mode.startswith("RGB") else pixels[..., :1]
        if (grey != grey[..., :1]).any():
            raise SpecError(str(path), "is in colour; save it in shades of grey")
        pixels = grey[..., 0]
    return pixels / WHITE[mode]
