"""PNG images as arrays and back (W3C Portable Network Graphics, third edition), with zlib and numpy alone.

Blender's Python has no library of images, and its own reader needs the main thread. Every filtered byte is
the sum of what is stored and a prediction from its neighbours to the left, above, and above to the left; as
these lie on earlier antidiagonals, an image is restored one antidiagonal at a time, all of its rows at once.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator

import numpy as np

SIGNATURE = b"\x89PNG\r\n\x1a\n"
CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # by colour type; 3 is a palette
DEPTHS = {0: (1, 2, 4, 8, 16), 3: (1, 2, 4, 8)}  # of the others: 8 and 16
MOST = 2**30  # bytes of pixels
MOST_PIXELS = 100_000_000  # ten seconds of reading
# Adam7: first column and row of each pass, and its steps.
PASSES = (
    *((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4)),
    *((0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2)),
)


class TooLargeError(ValueError):
    """An image of more pixels than are read."""


def read_png(data: bytes) -> tuple[np.ndarray, float]:
    """Pixels (H, W, 1 to 4), the upper row first, and the number that is white.

    One channel is grey, two are grey and alpha, three and four red, green, blue and alpha.

    Raises
    ------
    ValueError : this is no whole PNG.
    """
    if not data.startswith(SIGNATURE):
        raise ValueError("it is no PNG")
    packed, palette, head = [], b"", b""
    for kind, content in _chunks(data):
        if kind == b"IHDR":
            head = content
        elif kind == b"PLTE":
            palette = content
        elif kind == b"IDAT":
            packed.append(content)
    wide, high, depth, colour, _, _, woven = struct.unpack(">IIBBBBB", head)
    channels = CHANNELS.get(colour, 0)
    if not (wide and high and depth in DEPTHS.get(colour, (8, 16)) and channels):
        raise ValueError("its header is wrong")
    parts = [
        (first, row, across, down, -(-(wide - first) // across), -(-(high - row) // down))
        for first, row, across, down in (PASSES if woven else ((0, 0, 1, 1),))
        if first < wide and row < high
    ]
    strides = [-(-columns * channels * depth // 8) for *_, columns, _ in parts]
    size = sum((1 + stride) * part[-1] for stride, part in zip(strides, parts, strict=True))
    refuse_large(wide, high)
    if size > MOST:
        raise ValueError("it is too large")
    raw = np.frombuffer(zlib.decompressobj().decompress(b"".join(packed), size), dtype=np.uint8)
    if len(raw) < size:
        raise ValueError("it ends early")
    pixels = np.empty((high, wide, channels), dtype=np.uint16 if depth == 16 else np.uint8)
    start = 0
    for (first, row, across, down, columns, rows), stride in zip(parts, strides, strict=True):
        end = start + rows * (1 + stride)
        whole = _unfiltered(raw[start:end].reshape(rows, -1), max(1, channels * depth // 8))
        values = unpacked(whole, depth)[:, : columns * channels]
        pixels[row::down, first::across] = values.reshape(rows, columns, channels)
        start = end
    if colour != 3:
        return pixels, float(2**depth - 1)
    table = np.frombuffer(palette, dtype=np.uint8).reshape(-1, 3)
    return table[pixels[..., 0]], 255.0


def refuse_large(wide: int, high: int) -> None:
    """Refuse an image that would take minutes and most of a machine's memory.

    Raises
    ------
    TooLargeError : it has more than ``MOST_PIXELS``.
    """
    if wide * high > MOST_PIXELS:
        raise TooLargeError(
            f"has {wide:,} x {high:,} pixels, more than {MOST_PIXELS:,}; make it coarser, or cut it"
        )


def write_png(pixels: np.ndarray) -> bytes:
    """The file of an image (H, W, 3) of 0 to 1, the upper row first; 8 bits a channel."""
    values = np.rint(255 * np.clip(pixels, 0.0, 1.0)).astype(np.uint8)
    high, wide, _ = values.shape
    lines = np.zeros((high, 1 + 3 * wide), dtype=np.uint8)
    lines[:, 0] = 2  # each row holds what is to add to the one above
    flat = values.reshape(high, -1)
    lines[:, 1:] = flat - np.vstack([np.zeros_like(flat[:1]), flat[:-1]])
    parts = (
        (b"IHDR", struct.pack(">IIBBBBB", wide, high, 8, 2, 0, 0, 0)),
        (b"IDAT", zlib.compress(lines.tobytes(), 9)),
        (b"IEND", b""),
    )
    return SIGNATURE + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in parts
    )


def unpacked(rows: np.ndarray, depth: int) -> np.ndarray:
    """Samples (H, N) of rows of bytes (H, B), high bits and bytes first."""
    if depth == 8:
        return rows
    if depth == 16:
        return rows.view(">u2").astype(np.uint16)
    bits = np.unpackbits(rows, axis=1).reshape(len(rows), -1, depth)
    return bits @ (1 << np.arange(depth)[::-1]).astype(np.uint8)


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Kind and content of each piece of a file."""
    at = len(SIGNATURE)
    while at < len(data):
        (size,) = struct.unpack_from(">I", data, at)
        kind, content = data[at + 4 : at + 8], data[at + 8 : at + 8 + size]
        if data[at + 8 + size : at + 12 + size] != struct.pack(">I", zlib.crc32(kind + content)):
            raise ValueError("it is damaged")
        yield kind, content
        if kind == b"IEND":
            return
        at += 12 + size
    raise ValueError("it ends early")


def _unfiltered(lines: np.ndarray, width: int) -> np.ndarray:
    """Rows of bytes (H, B) from lines (H, 1 + B) that start with their filter. width : bytes of a pixel."""
    kind, stored = lines[:, 0], lines[:, 1:]
    if kind.max(initial=0) > 4:
        raise ValueError("it is damaged")
    if not kind.any():
        return np.ascontiguousarray(stored)
    rows, columns = len(lines), stored.shape[1] // width
    line = columns + 1  # a row of zeros above and a column of zeros to the left
    whole = np.zeros(((rows + 1) * line, width), dtype=np.int16)
    whole.reshape(rows + 1, line, width)[1:, 1:] = stored.reshape(rows, columns, width)
    for diagonal in range(rows + columns - 1):
        first = max(0, diagonal - columns + 1)
        count = min(rows, diagonal + 1) - first
        start = (first + 1) * line + diagonal - first + 1
        # One row down and one column to the left is so many pixels on: the width without the zeros.
        here, left, above, corner = (
            whole[start - back :: columns][:count] for back in (0, 1, line, line + 1)
        )
        guesses = np.stack(
            [0 * left, left, above, (left + above) >> 1, _paeth(left, above, corner)]
        )
        here += guesses[kind[first : first + count], np.arange(count)]
        here &= 255
    restored = whole.reshape(rows + 1, line, width)[1:, 1:]
    return restored.astype(np.uint8).reshape(rows, columns * width)


def _paeth(left: np.ndarray, above: np.ndarray, corner: np.ndarray) -> np.ndarray:
    """Of three neighbours the one nearest to left + above - corner; ties in this order."""
    a, b = np.abs(above - corner), np.abs(left - corner)
    c = np.abs(left + above - 2 * corner)
    return np.where((a <= b) & (a <= c), left, np.where(b <= c, above, corner))
