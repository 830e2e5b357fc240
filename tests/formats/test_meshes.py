"""Meshes by other hands: Wavefront files as they are met, and shapes that single precision has lost."""

import io
import struct
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
import tifffile
from hypothesis import given, strategies as st
from PIL import Image

from forest_addon.base.rng import stream
from forest_addon.formats import raster_file
from forest_addon.formats.helios.parts import read_obj
from forest_addon.formats.ply import read_surface
from forest_addon.formats.raster_file import read_png, read_raster, write_png
from forest_addon.formats.stl import StlError, StlWarning, read_stl, write_stl
from forest_addon.spec import SpecError

FAR = np.array([432_100, 5_612_300, 120.0])
TREE = stream(2, "far").random((150, 3)) * [4, 4, 12]
PIXELS = np.stack([*np.mgrid[:20, :20] / 2, stream(3, "far").random((20, 20))], 2).reshape(-1, 3)


def test_a_lost_material_file_is_said_and_others_of_its_line_are_read(tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl bark\nhelios_reflectance 0.3\n")
    (tmp_path / "b c.mtl").write_text("newmtl soil\nhelios_isGround true\n")
    (tmp_path / "t.obj").write_text(
        "mtllib a.mtl gone.mtl\nmtllib b c.mtl\nv 0 0 0\nv 1 \\\n 0 0\nv 0 1 0\nusemtl bark\n"
        "f -3 -2 \\\r\n -1\nusemtl \\\nsoil\nf 1 2 3 # \\\n"
    )
    found = read_obj(tmp_path / "t.obj")
    assert found.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert found.triangles.tolist() == [[0, 1, 2]] * 2
    assert found.materials[found.slot[0]].reflectance == 0.3
    assert found.ground.tolist() == [False, True]
    assert len(found.notes) == 1
    assert found.notes[0].startswith("t.obj: its material file gone.mtl is not there")


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        ("v 0 0 0\nv 1 0 0\nv 0 1 nan\nf 1 2 3\n", "utf-8"),
        ("v 0 0 0\nv 1,5 0 0\nv 0 1,5 0\nf 1 2 3\n", "utf-8"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 4\n", "utf-8"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 3 4\n", "utf-8-sig"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "utf-16"),
    ],
)
def test_what_blender_passes_over_in_an_obj_is_refused(tmp_path, text, encoding):
    """Its importer makes 0 of NaN and 1 of 1,5, and leaves out a line after a byte order mark."""
    pytest.importorskip("bpy")
    from forest_addon.blender.files.export import open_file, read_groups

    (tmp_path / "t.obj").write_text(text, encoding)
    for read in (read_obj, open_file, read_groups):
        with pytest.raises(SpecError, match=r"t\.obj"):
            read(tmp_path / "t.obj")


def obj(path, places, form):
    lines = ["v " + " ".join(format(x, form) for x in place) for place in places.tolist()]
    lines += [f"f {k + 1} {k + 2} {k + 3}" for k in range(0, len(places) - 2, 3)]
    path.write_text("\n".join(lines))
    return read_obj(path).vertices


def ascii_stl(path, places, form):
    corners = places[: len(places) // 3 * 3].reshape(-1, 3, 3)
    facets = [
        "outer loop\n"
        + "".join(f"vertex {' '.join(format(x, form) for x in one)}\n" for one in facet)
        + "endloop"
        for facet in corners.tolist()
    ]
    path.write_text("solid a\n" + "\n".join(facets) + "\nendsolid a\n")
    return read_stl(path).reshape(-1, 3)


def ply(path, places, kind):
    """Binary, in float or double, or ASCII in a form of numbers."""
    count = len(places) // 3
    binary = kind in ("float", "double")
    head = ["ply", f"format {'binary_little_endian' if binary else 'ascii'} 1.0"]
    head += [f"element vertex {len(places)}"]
    head += [f"property {kind if binary else 'float'} {axis}" for axis in "xyz"]
    head += [f"element face {count}", "property list uchar int vertex_indices", "end_header\n"]
    faces = np.arange(3 * count).reshape(-1, 3).tolist()
    if binary:
        body = places.astype("<f4" if kind == "float" else "<f8").tobytes()
        body += b"".join(struct.pack("<B3i", 3, *face) for face in faces)
    else:
        lines = [" ".join(format(x, kind) for x in place) for place in places.tolist()]
        body = "\n".join([*lines, *("3 {} {} {}".format(*face) for face in faces)]).encode()
    path.write_bytes("\n".join(head).encode() + body)
    return read_surface(path)[0]


def single(places):
    return places.astype(np.float32).astype(np.float64)


DOORS = [
    *((".obj", obj, form) for form in (".6f", ".3f")),
    (".stl", ascii_stl, ".6f"),
    *((".ply", ply, kind) for kind in ("float", "double", ".6f")),
]


@pytest.mark.parametrize(("ending", "write", "form"), DOORS)
def test_a_mesh_at_map_coordinates_in_single_precision_is_refused(tmp_path, ending, write, form):
    with pytest.raises((SpecError, StlError), match=r"^a\.\w+:? lies at map .* steps of 0\.5: its"):
        write(tmp_path / f"a{ending}", single(TREE + FAR), form)
    near = np.array([100, 200, 120])
    found = write(tmp_path / f"b{ending}", single(TREE + near), form)
    assert found == pytest.approx((TREE + near)[: len(found)], abs=1e-3)


@pytest.mark.parametrize(("ending", "write", "form"), [d for d in DOORS if d[2] != "float"])
@pytest.mark.parametrize("shape", [TREE, PIXELS], ids=["tree", "grid"])
def test_a_mesh_at_map_coordinates_with_its_digits_is_read(tmp_path, ending, write, form, shape):
    found = write(tmp_path / f"a{ending}", shape + FAR, form)
    assert found == pytest.approx((shape + FAR)[: len(found)], abs=6e-4)


def test_binary_stl_at_map_coordinates(tmp_path):
    write_stl(tmp_path / "a.stl", (TREE + FAR).reshape(-1, 3, 3))
    with pytest.raises(StlError, match=r"a\.stl lies at map .* its shape is lost; subtract"):
        read_stl(tmp_path / "a.stl")


# ----------------------------------------------------------------------------------------------- stl
# STL reading and writing, against bytes laid out here by ``struct`` and by hand.

ONE = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0]]
TWO = [[0.5, -1.0, 3.0], [0.25, 8.0, -2.0], [1e-3, 1e5, 7.0]]

ASCII = """solid tree
  facet normal 0 0 1
    outer loop
      vertex 0 0 0
      vertex 1 0 0
      vertex 0 2 0
    endloop
  endfacet
  facet normal 0 0 0
    outer loop
      vertex 0.5 -1 3
      vertex 0.25 8 -2
      vertex 1e-3 1e5 7
    endloop
  endfacet
endsolid tree
"""


def binary(facets: list[list[list[float]]], header: bytes = b"", count: int | None = None) -> bytes:
    """A binary STL by the format's description: little-endian, 80 + 4 bytes, then 50 a facet."""
    data = header.ljust(80, b"\0") + struct.pack("<I", len(facets) if count is None else count)
    for facet in facets:
        data += struct.pack("<3f", 0, 0, 0)
        data += b"".join(struct.pack("<3f", *corner) for corner in facet)
        data += struct.pack("<H", 0)
    return data


def read(folder: Path, data: bytes | str) -> np.ndarray:
    path = folder / "tree.stl"
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return read_stl(path)


def as_float32(facets: object) -> np.ndarray:
    return np.array(facets, dtype=np.float32).astype(np.float64)


# ------------------------------------------------------------------------------------- read


@pytest.mark.parametrize("header", [b"", b"solid facet outer loop vertex"])
def test_binary_is_read_as_float64(tmp_path: Path, header: bytes) -> None:
    facets = read(tmp_path, binary([ONE, TWO], header))
    assert facets.dtype == np.float64
    np.testing.assert_array_equal(facets, as_float32([ONE, TWO]))


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.upper(),
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "\r"),
        lambda text: " ".join(text.split()),  # one line
        lambda text: "\n\t\v\f ".join(text.split()) + "\n\n\x1a",  # one word a line, Ctrl-Z
        lambda text: "\ufeff" + text,
        lambda text: "\n\n  " + text,
        lambda text: text.replace("normal 0 0 1", "normal nan nan nan"),
        lambda text: text.replace("normal 0 0 1", ""),
        lambda text: text.replace("facet normal 0 0 1", ""),
        lambda text: text.replace("normal 0 0 1", "normal 0 0 -1"),
        lambda text: text.replace("endloop", "end loop").replace("endfacet", "end facet"),
        lambda text: (
            text.replace("1e-3", "+.1E-02").replace("1e5", "100000.").replace("8", "8e+00")
        ),
        lambda text: text.replace("tree", ""),
        lambda text: text.replace("endloop\n  endfacet\nendsolid", "endsolid"),  # closes the loop
        lambda text: text.replace("tree", "vertex 1 2 3 outer loops"),
        lambda text: text.replace(
            "  facet normal 0 0 0", "endsolid a\nsolid b\nfacet normal 0 0 0"
        ),
    ],
)
def test_ascii_as_exporters_write_it(tmp_path: Path, change) -> None:  # type: ignore[no-untyped-def]
    np.testing.assert_array_equal(read(tmp_path, change(ASCII)), [ONE, TWO])


@pytest.mark.medium
@given(
    st.lists(
        st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=9, max_size=9),
        min_size=1,
    ),
    st.lists(st.sampled_from([" ", "\n", "\t ", "\r\n"]), min_size=5, max_size=5),
)
def test_ascii_numbers_are_read_exactly(
    tmp_path_factory: pytest.TempPathFactory, facets: list[list[float]], gaps: list[str]
) -> None:
    def word(number: int) -> str:
        return gaps[number % len(gaps)]

    text = "solid" + gaps[0]
    for facet in facets:
        text += "facet outer loop "
        for corner in range(3):
            numbers = facet[3 * corner : 3 * corner + 3]
            text += "vertex" + "".join(word(i) + repr(x) for i, x in enumerate(numbers)) + gaps[3]
        text += "endloop endfacet" + gaps[4]
    found = read(tmp_path_factory.mktemp("ascii"), text + "endsolid")
    np.testing.assert_array_equal(found.reshape(-1, 9), facets)


@pytest.mark.parametrize("bad", ["nan", "-inf", "NaN", "1.#QNAN", "-1.#IND00", "1.#INF", "1e999"])
def test_facets_of_no_finite_number_are_left_out_and_counted(tmp_path: Path, bad: str) -> None:
    with pytest.warns(StlWarning, match="tree.stl: 1 of 2 facets"):
        facets = read(tmp_path, ASCII.replace("-1 3", f"{bad} 3"))
    np.testing.assert_array_equal(facets, [ONE])


def test_binary_facets_of_no_finite_number_are_left_out_and_counted(tmp_path: Path) -> None:
    broken = [[[0.0, 0.0, float("nan")], ONE[1], ONE[2]], [ONE[0], [float("inf"), 0, 0], ONE[2]]]
    with pytest.warns(StlWarning, match="2 of 4 facets"):
        facets = read(tmp_path, binary([broken[0], ONE, broken[1], TWO]))
    np.testing.assert_array_equal(facets, as_float32([ONE, TWO]))
    with pytest.raises(StlError, match=r"tree\.stl.*finite"):
        read(tmp_path, binary(broken))


def test_sound_files_do_not_warn_and_a_facet_of_zero_area_is_kept(tmp_path: Path) -> None:
    flat = [[1.0, 1.0, 1.0]] * 3
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read(tmp_path, ASCII)
        found = read(tmp_path, binary([flat, ONE]))
    np.testing.assert_array_equal(found, as_float32([flat, ONE]))


# ------------------------------------------------------------------------------------- refuse


BY_HAND = binary([ONE, TWO], b"made by hand")
NO_TRIANGLE = [  # in the second facet
    ("vertex 0.5 -1 3", "vertex 0.5 -1"),
    ("vertex 0.5 -1 3", "vertex 0.5 -1 3 4"),
    ("vertex 0.5 -1 3", "vertex 0.5 -1 three"),
    ("vertex 0.5 -1 3", "vertex 0,5 -1,0 3,0"),
    ("vertex 0.5 -1 3", "vertex 0.5.1 -1 3"),
    ("1e-3 1e5 7", "1.2.3 1e5 x"),  # three numbers are read before the x
    ("1e-3 1e5 7", "1e-3 1e5 7\n vertex 1 1 1"),  # a quad
    ("      vertex 1e-3 1e5 7\n", ""),
    ("vertex 1e-3 1e5 7\n    endloop", ""),
]
REFUSED = [
    *((data, "empty") for data in (b"", b"\n \n", b"\0" * 100)),
    *(
        (BY_HAND[:left], f"cut off.*counts 2 facets, the file holds {(left - 84) // 50}")
        for left in (84, 85, 133, 134, 150, 183)
    ),
    *(  # more than its header counts
        (
            binary([ONE, TWO], b"made by hand", count) + extra,
            f"damaged.*counts {count} facets, the file holds 2|"
            f"counts {count} facets, the file holds 2.*damaged",
        )
        for count, extra in ((0, b""), (1, b""), (2, b"trailer"), (2, b"\1" * 49))
    ),
    *(
        (data, "not an STL")
        for data in (
            b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n" * 20,  # OBJ
            b"solid advice: plant trees.\n" * 9,
            b"solid",
            b"hello",
            b"ply\nformat ascii 1.0\n",
            b"PK\x03\x04" + bytes(range(256)) * 9,
            b"\x89PNG\r\n\x1a\n" + np.random.default_rng(2).bytes(5000),
            np.random.default_rng(3).bytes(70),
        )
    ),
    (binary([], b"nothing"), "no facets"),
    ("solid tree\nendsolid tree\n", "no facets"),
    *(
        (ASCII[: ASCII.rindex(end)], f"cut off after {whole} facets")
        for end, whole in (
            ("endsolid", 2),
            ("endfacet\nendsolid", 2),
            ("-1 3\n      vertex 0.25", 1),
            ("1e5", 1),
        )
    ),
    *(
        (new.join(ASCII.rsplit(old, 1)), "facet 2 is not three vertices")
        for old, new in NO_TRIANGLE
    ),
]


@pytest.mark.parametrize(("data", "words"), REFUSED)
def test_what_is_no_whole_stl_is_one_sentence(
    tmp_path: Path, data: bytes | str, words: str
) -> None:
    with pytest.raises(StlError, match=words) as caught:
        read(tmp_path, data)
    assert "tree.stl" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


# ------------------------------------------------------------------------------------- write


def test_write_lays_out_the_format(tmp_path: Path) -> None:
    path = tmp_path / "one.stl"
    write_stl(path, np.array([ONE]), header="made here")
    head, count, *numbers = struct.unpack("<80sI12fH", path.read_bytes())
    assert (head, count) == (b"made here".ljust(80, b"\0"), 1)
    assert numbers == [0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0]  # the normal follows the right hand


@pytest.mark.parametrize(
    ("facets", "header"),
    [
        (np.full((1, 3, 3), np.nan), "x"),
        (np.full((1, 3, 3), 1e39), "x"),
        (np.zeros((3, 3)), "x"),
        (np.zeros((1, 3, 3)), "solid tree"),
        (np.zeros((1, 3, 3)), "x" * 81),
    ],
)
def test_what_cannot_be_written_leaves_the_old_file(
    tmp_path: Path, facets: np.ndarray, header: str
) -> None:
    path = tmp_path / "old.stl"
    path.write_bytes(b"as it was")
    with pytest.raises(StlError, match=r"old\.stl"):
        write_stl(path, facets, header=header)
    assert path.read_bytes() == b"as it was"
    assert [p.name for p in tmp_path.iterdir()] == ["old.stl"]


# -------------------------------------------------------------------------------------------- images
# Rasters: what Pillow and tifffile write is read as they read it, at any depth, packed in any usual way.

HIGH, WIDE = 37, 61
SMOOTH = (np.add.outer(np.arange(HIGH), np.arange(WIDE)) * 2.3).astype(np.uint8)
NOISE = stream(0, "test", "images").integers(0, 256, (HIGH, WIDE)).astype(np.uint8)
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
