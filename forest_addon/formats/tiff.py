"""TIFF images as arrays (Adobe, TIFF revision 6.0, 1992; its Technical Note 3; BigTIFF), with zlib and numpy.

What programs of maps and pictures write is read: strips and tiles, integers and floats of 1 to 64 bits,
grey, palettes and colours, either order of bytes, stored as they are or by PackBits, LZW or Deflate, with or
without differences along rows. Of several images in a file the first counts.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np

from .png import MOST, refuse_large, unpacked

WIDTH, HEIGHT, BITS, COMPRESSION, PHOTOMETRIC, FILL_ORDER = 256, 257, 258, 259, 262, 266
STRIPS, SAMPLES, ROWS, STRIP_SIZES, PLANAR, PREDICTOR, PALETTE = 273, 277, 278, 279, 284, 317, 320
TILE_WIDTH, TILE_HEIGHT, TILES, TILE_SIZES, FORMAT = 322, 323, 324, 325, 339
WHITE_IS_ZERO, COLOURS_OF_A_PALETTE = 0, 3
CODES = {1: "B", 3: "H", 4: "I", 13: "I", 16: "Q", 18: "Q"}  # of the types that are whole numbers
GEO_CODES = {2: "B", 12: "d"}  # texts and doubles, which say where an image lies
PIXEL_SCALE, TIE_POINT, NO_DATA = 33550, 33922, 42113
DEEP = 65535.0  # white of all that is deeper than a byte

Tags = dict[int, tuple[Any, ...]]


def read_tiff(data: bytes) -> tuple[np.ndarray, float]:
    """Pixels (H, W, C), the upper row first, and the number that is white; 1 of floating point.

    Raises
    ------
    ValueError : this is no whole TIFF, or one of a kind that is not read here.
    """
    order = {b"II": "<", b"MM": ">"}.get(data[:2])
    if order is None:
        raise ValueError("it is no TIFF")
    tags = _tags(data, order)
    depths, (form, *_) = tags.get(BITS, (1,)), tags.get(FORMAT, (1,))
    if len(set(depths)) > 1:
        raise ValueError("its channels differ in depth")
    kind = "f" if form == 3 else "i" if form == 2 else "u"
    pixels = _pixels(data, tags, order, kind, depths[0])
    white = 1.0 if kind == "f" else 2.0 ** depths[0] - 1 if depths[0] <= 8 else DEEP
    shown = tags.get(PHOTOMETRIC, (1,))[0]
    if shown == WHITE_IS_ZERO and kind == "u":
        pixels = (2 ** depths[0] - 1) - pixels
    if shown == COLOURS_OF_A_PALETTE:
        table = np.array(tags[PALETTE]).reshape(3, -1) >> 8  # some write 0xff00 for white
        return table.T[pixels[..., 0]], 255.0
    return pixels, white


def read_place(data: bytes) -> tuple[np.ndarray, np.ndarray, float]:
    """Place of the upper left corner (2,), size of a pixel (2,), and the value that stands for nothing (NaN:
    none does), of a GeoTIFF whose rows run from west to east (OGC 19-008r4).

    Raises
    ------
    ValueError : it does not say where it lies.
    """
    tags = _tags(data, {b"II": "<", b"MM": ">"}.get(data[:2], "<"), GEO_CODES)
    if PIXEL_SCALE not in tags or len(tags.get(TIE_POINT, ())) < 6:
        raise ValueError("it does not say where it lies; save a GeoTIFF with a north-up grid")
    scale = np.array(tags[PIXEL_SCALE][:2], dtype=np.float64)
    column, row, _, x, y, _ = tags[TIE_POINT][:6]
    corner = np.array([x - column * scale[0], y + row * scale[1]])
    words = bytes(int(code) for code in tags.get(NO_DATA, ())).rstrip(b"\0 ").decode("latin-1")
    return corner, scale, float(words) if words else float("nan")


def _tags(data: bytes, order: str, codes: dict[int, str] = CODES) -> Tags:
    """The numbers of the first directory that are of some types."""
    (version,) = struct.unpack_from(f"{order}H", data, 2)
    if version not in (42, 43):
        raise ValueError("it is no TIFF")
    wide = version == 43  # BigTIFF: offsets and counts have eight bytes
    word, count, entry = ("Q", "Q", 20) if wide else ("I", "H", 12)
    (place,) = struct.unpack_from(order + word, data, 8 if wide else 4)
    (entries,) = struct.unpack_from(order + count, data, place)
    place += struct.calcsize(order + count)
    tags: Tags = {}
    for at in range(place, place + min(entries, 4096) * entry, entry):
        tag, kind, number = struct.unpack_from(f"{order}HH{word}", data, at)
        if kind not in codes or number > len(data):
            continue
        form = f"{order}{number}{codes[kind]}"
        held = at + 4 + struct.calcsize(order + word)
        if struct.calcsize(form) > struct.calcsize(order + word):
            (held,) = struct.unpack_from(order + word, data, held)
        tags[tag] = struct.unpack_from(form, data, held)
    return tags


def _pixels(data: bytes, tags: Tags, order: str, kind: str, depth: int) -> np.ndarray:
    """(H, W, C) as they are stored, from strips or tiles."""
    wide, high = tags[WIDTH][0], tags[HEIGHT][0]
    refuse_large(wide, high)
    samples = tags.get(SAMPLES, (1,))[0]
    tiled = TILES in tags
    across = tags[TILE_WIDTH][0] if tiled else wide
    down = tags[TILE_HEIGHT][0] if tiled else min(tags.get(ROWS, (high,))[0], high)
    apart = samples > 1 and tags.get(PLANAR, (1,))[0] == 2
    planes, channels = (samples, 1) if apart else (1, samples)
    if min(wide, high, across, down, samples) < 1 or samples > 16:
        raise ValueError("its header is wrong")
    if wide * high * samples * depth > 8 * MOST or across * down * samples * depth > 8 * MOST:
        raise ValueError("it is too large")
    unpack = _unpacker(tags.get(COMPRESSION, (1,))[0])
    if tags.get(FILL_ORDER, (1,))[0] != 1:
        raise ValueError("its bits are in an order that is not read")
    sort = _sort(kind, depth, order)
    predictor = tags.get(PREDICTOR, (1,))[0]
    columns, rows = -(-wide // across), -(-high // down)
    starts = tags[TILES if tiled else STRIPS]
    sizes = tags.get(TILE_SIZES if tiled else STRIP_SIZES, (len(data),) * len(starts))
    if len(starts) < planes * columns * rows or len(sizes) < len(starts):
        raise ValueError("parts of it are missing")
    pixels = np.zeros((high, wide, samples), dtype=sort.newbyteorder("="))
    stride = -(-across * channels * depth // 8)
    for number in range(planes * columns * rows):
        plane, place = divmod(number, columns * rows)
        top, left = place // columns * down, place % columns * across
        tall = down if tiled else min(down, high - top)
        packed = data[starts[number] : starts[number] + sizes[number]]
        raw = np.frombuffer(unpack(packed, tall * stride), dtype=np.uint8)
        if len(raw) < tall * stride:
            raise ValueError("it ends early")
        lines = raw[: tall * stride].reshape(tall, stride)
        part = _samples(lines, sort, depth, channels, predictor)[:, : across * channels]
        part = part.reshape(tall, across, channels)[: high - top, : wide - left]
        first = plane if apart else 0
        pixels[top : top + tall, left : left + across, first : first + channels] = part
    return pixels


def _sort(kind: str, depth: int, order: str) -> np.dtype:
    """Return how a sample is stored; of less than a byte: a byte."""
    known = {"u": (1, 2, 4, 8, 16, 32), "i": (8, 16, 32), "f": (16, 32, 64)}[kind]
    if depth not in known:
        raise ValueError(f"its numbers of {depth} bits are not read")
    return np.dtype(f"{order}{kind}{max(1, depth // 8)}")


def _samples(
    lines: np.ndarray, sort: np.dtype, depth: int, channels: int, predictor: int
) -> np.ndarray:
    """Numbers (H, N) of rows of bytes, summed up where differences are stored."""
    if predictor == 3:  # the bytes of floats, all first ones first, and of these the differences
        size = sort.itemsize
        summed = _summed(lines, channels)
        split = summed.reshape(len(lines), size, -1).swapaxes(1, 2)
        return np.ascontiguousarray(split).view(f">f{size}").reshape(len(lines), -1)
    values = np.ascontiguousarray(lines).view(sort) if depth >= 8 else unpacked(lines, depth)
    if predictor == 2:
        return _summed(values.astype(sort.newbyteorder("=")), channels)
    if predictor != 1:
        raise ValueError(f"its prediction {predictor} is not read")
    return values


def _summed(values: np.ndarray, channels: int) -> np.ndarray:
    """Running sums along rows, each channel for itself; numbers wrap around."""
    apart = values.reshape(len(values), -1, channels)
    return np.cumsum(apart, axis=1, dtype=values.dtype).reshape(values.shape)


def _unpacker(compression: int) -> Callable[[bytes, int], bytes]:
    """(bytes, how many are wanted) -> bytes, for a number of the standard."""
    if compression == 1:
        return lambda packed, size: packed[:size]
    if compression in (8, 32946):
        return lambda packed, size: zlib.decompressobj().decompress(packed, max(size, 1))
    if compression == 5:
        return _lzw
    if compression == 32773:
        return _packbits
    raise ValueError(f"its compression {compression} is not read; use LZW, Deflate or none")


def _packbits(packed: bytes, size: int) -> bytes:
    """Runs of bytes and of copies of one."""
    out, at = bytearray(), 0
    while at < len(packed) and len(out) < size:
        head = packed[at]
        if head < 128:
            out += packed[at + 1 : at + 2 + head]
            at += 2 + head
        else:
            out += packed[at + 1 : at + 2] * (257 - head if head > 128 else 0)
            at += 2 if head > 128 else 1
    return bytes(out)


def _lzw(packed: bytes, size: int) -> bytes:
    """Strings by codes of 9 to 12 bits, high bits first; 256 starts anew, 257 ends."""
    start = [bytes((value,)) for value in range(256)] + [b"", b""]
    table, out, before = list(start), bytearray(), b""
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
        if code == 257 or len(out) >= size:
            break
        if code > len(table) or (code == len(table) and not before):
            raise ValueError("it is damaged")
        string = table[code] if code < len(table) else before + before[:1]
        if before and len(table) < 4096:
            table.append(before + string[:1])
        out += string
        before = string
        if bits < 12:  # the writer is one string ahead
            bits = max(bits, (len(table) + 1).bit_length())
    return bytes(out)
