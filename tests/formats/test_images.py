"""PNG and TIFF without a library: what Pillow writes is read as Pillow reads it, the rest by the standard."""

import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from forest_addon.base.rng import stream
from forest_addon.formats.png import PASSES, SIGNATURE, read_png, write_png
from forest_addon.formats.raster_file import read_raster
from forest_addon.formats.tiff import read_tiff
from forest_addon.spec import SpecError

HIGH, WIDE = 37, 61
SMOOTH = (np.add.outer(np.arange(HIGH), np.arange(WIDE)) * 2.3).astype(np.uint8)
NOISE = stream(0, "test", "images").integers(0, 256, (HIGH, WIDE)).astype(np.uint8)


def image(grey, mode):
    if mode == "F":
        return Image.fromarray(grey.astype(np.float32) / 7 - 3)
    if mode == "I;16":
        return Image.fromarray(grey.astype(np.uint16) * 257)
    if mode in ("RGB", "RGBA"):
        channels = [grey, grey.T.reshape(grey.shape), 255 - grey, grey // 2][: len(mode)]
        return Image.fromarray(np.stack(channels, axis=-1), mode)
    return Image.fromarray(grey).convert(mode)


def same(drawn, kind, read, **options):
    file = io.BytesIO()
    drawn.save(file, kind, **options)
    theirs = np.asarray(Image.open(io.BytesIO(file.getvalue())))
    ours, white = read(file.getvalue())
    assert (ours == theirs.reshape(*theirs.shape[:2], -1)).all()
    return white


@pytest.mark.parametrize("mode", ["1", "L", "LA", "RGB", "RGBA", "I;16"])
@pytest.mark.parametrize("grey", [SMOOTH, NOISE], ids=["smooth", "noise"])
def test_png_is_read_as_pillow_reads_it(grey, mode):
    white = same(image(grey, mode), "PNG", read_png)
    assert white == {"1": 1, "I;16": 65535}.get(mode, 255)


@pytest.mark.parametrize("compression", ["raw", "packbits", "tiff_lzw", "tiff_deflate"])
@pytest.mark.parametrize("mode", ["1", "L", "LA", "RGB", "RGBA", "I;16", "F"])
@pytest.mark.parametrize("grey", [SMOOTH, NOISE], ids=["smooth", "noise"])
def test_tiff_is_read_as_pillow_reads_it(grey, mode, compression):
    white = same(image(grey, mode), "TIFF", read_tiff, compression=compression)
    assert white == {"1": 1, "I;16": 65535, "F": 1}.get(mode, 255)


@pytest.mark.parametrize("compression", ["tiff_lzw", "tiff_deflate"])
@pytest.mark.parametrize(("mode", "predictor"), [("L", 2), ("RGB", 2), ("I;16", 2), ("F", 3)])
def test_differences_along_rows_are_summed(mode, predictor, compression):
    same(image(NOISE, mode), "TIFF", read_tiff, compression=compression, tiffinfo={317: predictor})


def test_lzw_of_all_lengths_of_codes():
    """Noise fills the table of 4096 strings many times over."""
    grey = stream(1, "test", "images").integers(0, 256, (200, 300)).astype(np.uint8)
    same(Image.fromarray(grey), "TIFF", read_tiff, compression="tiff_lzw")


def test_a_palette_counts_by_its_colours():
    drawn = Image.fromarray(SMOOTH // 64).convert("P")
    drawn.putpalette([0, 0, 0, 60, 60, 60, 90, 90, 90, 255, 255, 255])
    for kind, read in (("PNG", read_png), ("TIFF", read_tiff)):
        file = io.BytesIO()
        drawn.save(file, kind)
        pixels, white = read(file.getvalue())
        expected = np.array([0, 60, 90, 255])[SMOOTH // 64] / 255
        assert pixels[..., 0] / white == pytest.approx(expected)


def chunk(kind, body):
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def test_all_five_filters_of_png_undo_what_the_standard_says():
    """Each row with another filter, applied here byte by byte."""
    rows, bytes_of_a_pixel = stream(2, "test").integers(0, 256, (20, 27)).astype(int), 3
    lines = bytearray()
    for y, row in enumerate(rows):
        above = rows[y - 1] if y else np.zeros_like(row)
        lines.append(y % 5)
        for x, value in enumerate(row):
            a = row[x - bytes_of_a_pixel] if x >= bytes_of_a_pixel else 0
            b = above[x]
            c = above[x - bytes_of_a_pixel] if x >= bytes_of_a_pixel else 0
            nearest = min((a, b, c), key=lambda n: abs(a + b - c - n))
            lines.append((value - (0, a, b, (a + b) // 2, nearest)[y % 5]) % 256)
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", 9, 20, 8, 2, 0, 0, 0))
    file = SIGNATURE + head + chunk(b"IDAT", zlib.compress(lines)) + chunk(b"IEND", b"")
    assert (read_png(file)[0].reshape(rows.shape) == rows).all()
    assert (np.asarray(Image.open(io.BytesIO(file))).reshape(rows.shape) == rows).all()


@pytest.mark.parametrize("shape", [(1, 1), (3, 2), (8, 8), (9, 13)])
def test_an_interlaced_png_is_put_together(shape):
    grey = NOISE[: shape[0], : shape[1]]
    lines = b"".join(
        b"\0" + row.tobytes()
        for first, top, across, down in PASSES
        for row in grey[top::down, first::across]
        if row.size
    )
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", shape[1], shape[0], 8, 0, 0, 0, 1))
    file = SIGNATURE + head + chunk(b"IDAT", zlib.compress(lines)) + chunk(b"IEND", b"")
    assert (np.asarray(Image.open(io.BytesIO(file))) == grey).all()
    assert (read_png(file)[0][..., 0] == grey).all()


def test_a_written_png_is_read_by_others():
    colours = stream(3, "test").random((5, 7, 3))
    file = write_png(colours)
    expected = np.rint(255 * colours)
    assert (np.asarray(Image.open(io.BytesIO(file))) == expected).all()
    assert (read_png(file)[0] == expected).all()


def tiled(values, order="<", big=False, tile=16):
    """A TIFF of one channel in tiles, uncompressed, as GDAL writes them."""
    high, wide = values.shape
    form = {"f": 3, "i": 2, "u": 1}[values.dtype.kind]
    across, down = -(-wide // tile), -(-high // tile)
    whole = np.zeros((down * tile, across * tile), values.dtype.newbyteorder(order))
    whole[:high, :wide] = values
    blocks = [
        whole[y : y + tile, x : x + tile].tobytes()
        for y in range(0, len(whole), tile)
        for x in range(0, whole.shape[1], tile)
    ]
    word, count = ("Q", "Q") if big else ("I", "H")
    head = 16 if big else 8
    starts = head + np.cumsum([0, *map(len, blocks)])
    kind = 16 if big else 4
    entries = {
        256: (wide,), 257: (high,), 258: (8 * values.itemsize,), 259: (1,), 262: (1,), 277: (1,),
        322: (tile,), 323: (tile,), 324: tuple(starts[:-1]), 325: tuple(map(len, blocks)), 339: (form,),
    }  # fmt: skip
    size = struct.calcsize(order + word)
    directory = struct.pack(order + count, len(entries))
    beyond, tail = starts[-1] + len(directory) + len(entries) * (4 + 2 * size) + size, b""
    for tag, numbers in entries.items():
        body = struct.pack(f"{order}{len(numbers)}{word}", *map(int, numbers))
        if len(body) > size:
            body, tail = struct.pack(order + word, beyond + len(tail)), tail + body
        directory += struct.pack(f"{order}HH{word}", tag, kind, len(numbers)) + body
    letters = b"II" if order == "<" else b"MM"
    first = struct.pack(order + "HHHQ", 43, 8, 0, starts[-1]) if big else struct.pack(
        order + "HI", 42, starts[-1])  # fmt: skip
    return letters + first + b"".join(blocks) + directory + bytes(size) + tail


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("sort", ["u1", "u2", "i2", "f4", "f8"])
def test_tiles_and_big_tiff(sort, order, big):
    values = (SMOOTH.astype(float) - (sort[0] != "u") * 50).astype(sort)
    file = tiled(values, order, big)
    pixels, white = read_tiff(file)
    assert (pixels[..., 0] == values).all()
    assert white == {"u1": 255, "u2": 65535, "i2": 65535}.get(sort, 1)
    if sort == "u1" and not (big and order == ">"):  # which Pillow takes for a small one
        assert (np.asarray(Image.open(io.BytesIO(file))) == values).all()


@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_a_raster_is_read_where_there_is_no_pillow(tmp_path, monkeypatch, suffix):
    Image.fromarray(SMOOTH).save(tmp_path / f"a.{suffix}")
    Image.fromarray(SMOOTH).save(tmp_path / "a.jpg")
    monkeypatch.setitem(__import__("sys").modules, "PIL", None)
    assert read_raster(tmp_path / f"a.{suffix}") == pytest.approx(SMOOTH / 255)
    with pytest.raises(SpecError, match=r"a\.jpg.*neither PNG nor TIFF.*save it as PNG"):
        read_raster(tmp_path / "a.jpg")


def test_rare_images_are_read_where_there_is_pillow(tmp_path):
    Image.fromarray(SMOOTH).save(tmp_path / "a.jpg", quality=95)
    assert read_raster(tmp_path / "a.jpg") == pytest.approx(SMOOTH / 255, abs=0.15)


def test_holes_in_floating_point_are_no_colours(tmp_path):
    values = image(SMOOTH, "F")
    holes = np.where(SMOOTH > 100, np.nan, np.asarray(values))
    Image.fromarray(holes.astype(np.float32)).save(tmp_path / "a.tif")
    assert np.isnan(read_raster(tmp_path / "a.tif")).sum() == (SMOOTH > 100).sum()
