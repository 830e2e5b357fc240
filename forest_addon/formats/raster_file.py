"""Rasters: TIFF by tifffile, PNG by pypng, npy arrays by numpy; other images where Pillow is there.

The black of an image is 0 and its white 1, whatever its depth; floating-point images and arrays count as
they are. tifffile brings few codecs of its own: the two that maps mostly have, LZW and the prediction of
floats, are added here where the package imagecodecs (tens of megabytes) is missing.
"""

from __future__ import annotations

import io
import math
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
    ValueError : this is no TIFF, or it does not say where it lies.
    """
    with _open_tiff(path) as file:
        page = file.pages[0]
        tags = {code: page.tags.valueof(code) for code in (PIXEL_SCALE, TIE_POINT, NO_DATA)}
        height = _tiff_pixels(page)[0][..., 0].astype(np.float64)
    if tags[PIXEL_SCALE] is None or len(tags[TIE_POINT] or ()) < 6:
        raise ValueError("it does not say where it lies; save a GeoTIFF with a north-up grid")
    scale = np.array(tags[PIXEL_SCALE][:2], dtype=np.float64)
    column, row, _, x, y, _ = tags[TIE_POINT][:6]
    nothing = float(str(tags[NO_DATA]).strip("\0 ") if tags[NO_DATA] else "nan")
    height[np.abs(height - nothing) <= 1e-6] = np.nan
    return height, np.array([x - column * scale[0], y + row * scale[1]]), scale


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
    with open(path, "rb") as file:
        start = file.read(4)
    try:
        if start == PNG:
            pixels, white = read_png(path.read_bytes())
        elif start in TIFF:
            with _open_tiff(path) as tiff:
                pixels, white = _tiff_pixels(tiff.pages[0])
        else:
            raise ValueError("it is neither PNG nor TIFF")
    except TooLargeError as problem:
        raise SpecError(str(path), str(problem)) from None
    except Exception as problem:  # a damaged image fails anywhere
        pixels, white = _read_by_pillow(path, problem)
    if pixels.shape[2] in (2, 4):  # with alpha, which says nothing about shades
        pixels = pixels[..., :-1]
    if (pixels[..., 1:] != pixels[..., :1]).any():
        raise SpecError(str(path), "is in colour; save it in shades of grey")
    return pixels[..., 0] / white


def _open_tiff(path: Path) -> Any:
    """The file as tifffile has it, which knows LZW and the prediction of floats."""
    import tifffile
    from tifffile import _imagecodecs as codecs  # its own few, where imagecodecs is not installed

    for name, decode in (("lzw_decode", _lzw), ("floatpred_decode", _summed_floats)):
        if not hasattr(codecs, name):
            setattr(codecs, name, decode)
    return tifffile.TiffFile(path)


def _tiff_pixels(page: Any) -> tuple[np.ndarray, float]:
    """Pixels (H, W, C) of a page as they are stored, and the number that is white; 1 of floats."""
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
            _refuse_large(*image.size)
            mode, pixels = image.mode, np.asarray(image)
    except TooLargeError as large:
        raise SpecError(str(path), str(large)) from None
    except (OSError, ValueError, Image.DecompressionBombError):
        raise refused from None
    if mode == "F" or mode.startswith("I"):
        return pixels[..., None], 1.0 if mode == "F" else DEEP
    if mode not in WHITE:
        raise SpecError(str(path), f"has the colour mode {mode}; save it in shades of grey")
    return pixels.reshape(*pixels.shape[:2], -1), WHITE[mode]


def _refuse_large(wide: int, high: int) -> None:
    """Refuse an image that would take minutes and most of a machine's memory."""
    if wide * high > MOST_PIXELS:
        raise TooLargeError(
            f"has {wide:,} x {high:,} pixels, more than {MOST_PIXELS:,}; make it coarser, or cut it"
        )


def _lzw(packed: bytes, /, *, out: int | None = None) -> bytes:
    """At most ``out`` bytes of strings by codes of 9 to 12 bits, high bits first (TIFF 6.0, section 13)."""
    size = math.inf if out is None else out
    start = [bytes((value,)) for value in range(256)] + [b"", b""]
    table, found, before = list(start), bytearray(), b""
    bits, held, buffer = 9, 0, 0
    for byte in packed:
        buffer, held = (buffer << 8) | byte, held + 8
        if held < bits:
            continue
        held -= bits
        code, buffer = buffer >> held, buffer & ((1 << held) - 1)
        if code == 256:
            table, bits, before = list(start), 9, b""
            continue
        if code == 257 or len(found) >= size:
            break
        if code > len(table) or (code == len(table) and not before):
            raise ValueError("it is damaged")
        string = table[code] if code < len(table) else before + before[:1]
        if before and len(table) < 4096:
            table.append(before + string[:1])
        found += string
        before = string
        if bits < 12:  # the writer is one string ahead
            bits = max(bits, (len(table) + 1).bit_length())
    return bytes(found)


def _summed_floats(data: np.ndarray, /, **_options: Any) -> np.ndarray:
    """Floats (..., W, C) of which rows hold all first bytes, then all second ones, as differences (TIFF's
    technical note 3)."""
    size, (*_, wide, channels) = data.itemsize, data.shape
    apart = np.ascontiguousarray(data).view(np.uint8).reshape(-1, size * wide, channels)
    summed = np.cumsum(apart, axis=1, dtype=np.uint8).reshape(len(apart), size, -1).swapaxes(1, 2)
    floats = np.ascontiguousarray(summed).view(f">f{size}").reshape(data.shape)
    return floats.astype(data.dtype)
