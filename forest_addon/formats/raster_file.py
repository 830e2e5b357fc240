"""Rasters: TIFF by tifffile, PNG by pypng, npy arrays by numpy.

The black of an image is 0 and its white 1, whatever its depth; floating-point images and arrays count as
they are. Other images, and TIFF packed in ways that tifffile leaves to the package imagecodecs (LZW, the
prediction of floats, JPEG), are read by Pillow, which installations by pip have, or by OpenImageIO, which
is in Blender.
"""

from __future__ import annotations

import io
import math
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any

import numpy as np

from ..spec import SpecError
from .foreign import guarded

MOST_PIXELS = 100_000_000
MOST_SAMPLES = 16  # of a pixel
DEEP = 65535.0  # white of all that is deeper than a byte
WHITE = {"1": 1.0, "L": 255.0, "LA": 255.0, "RGB": 255.0, "RGBA": 255.0}  # by Pillow's modes
PNG = b"\x89PNG"
TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
WHITE_IS_ZERO, PALETTE = 0, 3  # of TIFF's photometric interpretation
PIXEL_SCALE, TIE_POINT, NO_DATA = 33550, 33922, 42113  # tags of a GeoTIFF


class TooLargeError(ValueError):
    """An image of more pixels than are read."""


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


def read_heights(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Heights (rows, columns) of a GeoTIFF, NaN where it has none, its upper left corner (2,) and the size of
    a pixel (2,) in map units (OGC 19-008r4); rows run from west to east.

    Raises
    ------
    SpecError, ValueError : this is no TIFF, or it does not say where it lies.
    """
    import tifffile

    with tifffile.TiffFile(path) as file:
        page: Any = file.pages[0]
        scale, tie, nothing = map(page.tags.valueof, (PIXEL_SCALE, TIE_POINT, NO_DATA))
    if scale is None or len(tie or ()) < 6:
        raise ValueError("it does not say where it lies; save a GeoTIFF with a north-up grid")
    height = _read_pixels(path)[0][..., 0].astype(np.float64)
    height[np.abs(height - float(str(nothing or "nan").strip("\0 "))) <= 1e-6] = np.nan
    size = np.array(scale[:2], dtype=np.float64)
    column, row, _, x, y, _ = tie[:6]
    return height, np.array([x - column * size[0], y + row * size[1]]), size


def read_png(data: bytes) -> tuple[np.ndarray, float]:
    """Pixels (H, W, 1 to 4) of a PNG's bytes, the upper row first, and the number that is white.

    One channel is grey, two are grey and alpha, three and four red, green, blue and alpha.

    Raises
    ------
    ValueError : this is no whole PNG, or it has too many pixels.
    """
    import png

    reader = png.Reader(bytes=data)
    try:
        reader.preamble()
        _refuse_large(reader.width, reader.height)
        wide, high, rows, about = reader.asDirect()
        pixels = np.array([np.asarray(row) for row in rows])
    except (png.Error, EOFError) as problem:
        raise ValueError(str(problem)) from None
    return pixels.reshape(high, wide, -1), float(2 ** about["bitdepth"] - 1)


def write_png(pixels: np.ndarray) -> bytes:
    """The file of an image (H, W, 3) of 0 to 1, the upper row first; 8 bits a channel."""
    import png

    values = np.rint(255 * np.clip(pixels, 0.0, 1.0)).astype(np.uint8)
    high, wide, _ = values.shape
    made = io.BytesIO()
    png.Writer(wide, high, greyscale=False, compression=9).write(made, values.reshape(high, -1))
    return made.getvalue()


def _read_array(path: Path) -> np.ndarray:
    try:
        with open(path, "rb") as file:
            shape = _shape_of(file)
        if math.prod(shape) > MOST_PIXELS:
            raise SpecError(
                str(path), f"has the shape {list(shape)}, more than {MOST_PIXELS:,} numbers"
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
    pixels, white = _read_pixels(path)
    if pixels.shape[2] in (2, 4):  # with alpha, which says nothing about shades
        pixels = pixels[..., :-1]
    if (pixels[..., 1:] != pixels[..., :1]).any():
        raise SpecError(str(path), "is in colour; save it in shades of grey")
    return pixels[..., 0] / white


def _read_pixels(path: Path) -> tuple[np.ndarray, float]:
    """Pixels (H, W, C) of an image as they are stored, and the number that is white; 1 of floats."""
    with open(path, "rb") as file:
        start = file.read(4)
    try:
        if start == PNG:
            return read_png(path.read_bytes())
        if start in TIFF:
            return _read_tiff(path)
        raise ValueError("it is neither PNG nor TIFF")
    except TooLargeError as problem:
        raise SpecError(str(path), str(problem)) from None
    except Exception as problem:  # a damaged image fails anywhere
        return _read_by_another(path, problem)


def _read_tiff(path: Path) -> tuple[np.ndarray, float]:
    import tifffile

    with tifffile.TiffFile(path) as file:
        page: Any = file.pages[0]
        _refuse_large(page.imagewidth, page.imagelength)
        if page.samplesperpixel > MOST_SAMPLES or page.tilewidth * page.tilelength > MOST_PIXELS:
            raise ValueError("its header is wrong")
        pixels = page.asarray(maxworkers=1)
    pixels = np.moveaxis(pixels, 0, -1) if page.axes == "SYX" else pixels
    pixels = pixels.reshape(page.imagelength, page.imagewidth, -1)
    if page.photometric == PALETTE:
        table = page.colormap >> 8  # some write 0xff00 for white
        return table.T[pixels[..., 0]], 255.0
    if pixels.dtype.kind == "f":
        return pixels, 1.0
    depth = page.bitspersample
    if page.photometric == WHITE_IS_ZERO and pixels.dtype.kind in "bu":
        pixels = (2**depth - 1) - pixels
    return pixels, 2.0**depth - 1 if depth <= 8 else DEEP


def _read_by_another(path: Path, problem: Exception) -> tuple[np.ndarray, float]:
    """Pixels and white by the library that is there. problem : why they are not read without it."""
    why = " ".join(str(problem).split()) or type(problem).__name__
    refused = SpecError(str(path), f"cannot be read ({why}); save it as PNG, TIFF or npy")
    try:
        return _read_by_pillow(path) if find_spec("PIL") else _read_by_openimageio(path)
    except TooLargeError as large:
        raise SpecError(str(path), str(large)) from None
    except Exception as other:
        raise (other if isinstance(other, SpecError) else refused) from None


def _read_by_pillow(path: Path) -> tuple[np.ndarray, float]:
    from PIL import Image

    with Image.open(path) as image:
        _refuse_large(*image.size)
        shown = image.convert("RGB") if image.mode == "P" else image  # of a palette
        mode, pixels = shown.mode, np.asarray(shown)
    if mode == "F" or mode.startswith("I"):
        return pixels[..., None], 1.0 if mode == "F" else DEEP
    if mode not in WHITE:
        raise SpecError(str(path), f"has the colour mode {mode}; save it in shades of grey")
    return pixels.reshape(*pixels.shape[:2], -1), WHITE[mode]


def _read_by_openimageio(path: Path) -> tuple[np.ndarray, float]:
    import OpenImageIO

    file = OpenImageIO.ImageInput.open(str(path))
    if file is None:
        raise ValueError(OpenImageIO.geterror())
    _refuse_large(file.spec().width, file.spec().height)
    pixels = file.read_image(OpenImageIO.UNKNOWN)
    return pixels, 1.0 if pixels.dtype.kind == "f" else float(np.iinfo(pixels.dtype).max)


def _refuse_large(wide: int, high: int) -> None:
    """Refuse an image that would take minutes and most of a machine's memory."""
    if wide * high > MOST_PIXELS:
        raise TooLargeError(
            f"has {wide:,} x {high:,} pixels, more than {MOST_PIXELS:,}; make it coarser, or cut it"
        )
