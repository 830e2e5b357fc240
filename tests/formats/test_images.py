"""Rasters: what Pillow and tifffile write is read as they read it, at any depth, packed in any usual way."""

import io
import sys

import numpy as np
import pytest
import tifffile
from PIL import Image

from forest_addon.base.rng import stream
from forest_addon.formats import raster_file
from forest_addon.formats.raster_file import read_png, read_raster, write_png
from forest_addon.spec import SpecError

HIGH, WIDE = 37, 61
SMOOTH = (np.add.outer(np.arange(HIGH), np.arange(WIDE)) * 2.3).astype(np.uint8)
NOISE = stream(0, "test", "images").integers(0, 256, (HIGH, WIDE)).astype(np.uint8)
LARGE = (
    stream(1, "test", "images").integers(0, 256, (90, 120)).astype(np.uint8)
)  # fills LZW's table
WHITES = {"1": 1, "I;16": 65535, "F": 1}  # 255 of others


def image(grey, mode):
    """An image of shades, in one of Pillow's modes."""
    if mode == "F":
        return Image.fromarray(grey.astype(np.float32) / 7 - 3)
    if mode == "I;16":
        return Image.fromarray(grey.astype(np.uint16) * 257)
    return Image.fromarray(grey).convert(mode)


PACKED = [("PNG", {})] + [
    ("TIFF", {"compression": packed} | ({"tiffinfo": {317: predictor}} if predictor else {}))
    for packed, predictor in [
        *(("raw", 0), ("packbits", 0), ("tiff_lzw", 0), ("tiff_deflate", 0)),
        *(("tiff_lzw", 2), ("tiff_deflate", 2)),
    ]
]


@pytest.mark.parametrize(("kind", "options"), PACKED)
@pytest.mark.parametrize("mode", ["1", "L", "LA", "RGB", "RGBA", "P", "I;16", "F"])
def test_shades_are_read_as_pillow_reads_them(tmp_path, monkeypatch, mode, kind, options):
    if (kind, mode) == ("PNG", "F") or (mode == "1" and "tiffinfo" in options):
        pytest.skip("there is no such file")
    grey = SMOOTH if mode == "P" else NOISE
    if mode == "F" and "tiffinfo" in options:
        options = options | {"tiffinfo": {317: 3}}
    path = tmp_path / f"a.{kind.lower()}"
    image(grey, mode).save(path, kind, **options)
    theirs = np.asarray(Image.open(path).convert("L" if mode == "P" else mode), float)
    theirs = theirs if theirs.ndim == 2 else theirs[..., 0]
    if not {"tiff_lzw", 3} & {options.get("compression"), options.get("tiffinfo", {}).get(317)}:
        monkeypatch.setattr(raster_file, "find_spec", lambda _name: None)  # Pillow is not asked
    assert read_raster(path).pixels == pytest.approx(theirs / WHITES.get(mode, 255), rel=1e-15)


@pytest.mark.parametrize("options", [{}, {"tile": (16, 16)}, {"bigtiff": True}, {"byteorder": ">"}])
@pytest.mark.parametrize("sort", ["u1", "u2", "i2", "u4", "f4", "f8"])
def test_depths_tiles_big_files_and_orders_of_bytes(tmp_path, sort, options):
    values = (SMOOTH.astype(float) - (sort[0] != "u") * 50).astype(sort)
    tifffile.imwrite(tmp_path / "a.tif", values, photometric="minisblack", **options)
    white = {"u1": 255, "u2": 65535, "i2": 65535, "u4": 65535}.get(sort, 1)
    assert (read_raster(tmp_path / "a.tif").pixels == values / white).all()


def test_white_may_be_zero_and_channels_may_lie_apart(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", SMOOTH, photometric="miniswhite")
    assert (read_raster(tmp_path / "a.tif").pixels == (255 - SMOOTH) / 255).all()
    planes = np.stack([SMOOTH, SMOOTH, SMOOTH])
    tifffile.imwrite(tmp_path / "b.tif", planes, photometric="rgb", planarconfig="separate")
    assert (read_raster(tmp_path / "b.tif").pixels == SMOOTH / 255).all()


@pytest.mark.parametrize("depth", [8, 16])
def test_colours_of_a_png_keep_their_depth(depth):
    import png

    rows = stream(2, "test").integers(0, 2**depth, (9, 3 * 7))
    file = io.BytesIO()
    png.Writer(7, 9, greyscale=False, bitdepth=depth).write(file, rows.tolist())
    pixels, white = read_png(file.getvalue())
    assert (pixels.reshape(rows.shape) == rows).all()
    assert white == 2**depth - 1


def test_a_written_png_is_read_by_others():
    colours = stream(3, "test").random((5, 7, 3))
    file = write_png(colours)
    expected = np.rint(255 * colours)
    assert (np.asarray(Image.open(io.BytesIO(file))) == expected).all()
    assert (read_png(file)[0] == expected).all()


def test_rare_images_are_read_where_there_is_pillow(tmp_path, monkeypatch):
    Image.fromarray(SMOOTH).save(tmp_path / "a.jpg", quality=95)
    assert read_raster(tmp_path / "a.jpg").pixels == pytest.approx(SMOOTH / 255, abs=0.15)
    monkeypatch.setattr(raster_file, "find_spec", lambda _name: None)
    monkeypatch.setitem(sys.modules, "OpenImageIO", None)
    with pytest.raises(SpecError, match=r"a\.jpg.*neither PNG nor TIFF.*save it as PNG"):
        read_raster(tmp_path / "a.jpg")


def test_packed_images_are_read_by_what_blender_has(tmp_path, monkeypatch):
    pytest.importorskip("OpenImageIO")
    monkeypatch.setattr(raster_file, "find_spec", lambda _name: None)
    for mode in ("1", "L", "LA", "I;16", "F"):
        drawn = image(NOISE, mode)
        drawn.save(tmp_path / "a.tif", compression="tiff_lzw")
        theirs = np.asarray(drawn, float).reshape(HIGH, WIDE, -1)[..., 0]
        assert (read_raster(tmp_path / "a.tif").pixels == theirs / WHITES.get(mode, 255)).all()


def test_holes_in_floating_point_are_no_colours(tmp_path):
    holes = np.where(SMOOTH > 100, np.nan, np.asarray(image(SMOOTH, "F")))
    Image.fromarray(holes.astype(np.float32)).save(tmp_path / "a.tif")
    assert np.isnan(read_raster(tmp_path / "a.tif").pixels).sum() == (SMOOTH > 100).sum()
