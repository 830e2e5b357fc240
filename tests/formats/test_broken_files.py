"""Broken files of every format: what was meant, or one sentence with the file's name; never anything else.

Files are mutated at random: bytes flipped, cut, repeated, swapped for others that mean
something to some reader. What is read nonetheless must be finite.
"""

import gzip
import json
import os
import re
import struct
import warnings
import zlib

import laspy
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.strategies import integers

from forest_addon.base.places import ASSETS
from forest_addon.base.rng import stream
from forest_addon.flight import policies
from forest_addon.flight.senses import LIDAR, LidarSense
from forest_addon.formats.foreign import guarded, refuse_claims
from forest_addon.formats.glb import read_glb
from forest_addon.formats.helios.parts import (
    Material,
    read_materials,
    read_obj,
    read_points,
    read_terrain,
)
from forest_addon.formats.las import read_las
from forest_addon.formats.raster_file import read_raster
from forest_addon.formats.sofa import read_head
from forest_addon.formats.stl import StlError, read_stl, write_stl
from forest_addon.formats.toml_file import read_scanner, read_settings
from forest_addon.formats.tree_map import read_rings, read_tree_map
from forest_addon.formats.wav import read_wav, write_wav
from forest_addon.growth.library import load_species
from forest_addon.sensing.reverb.directivity import read_directivity
from forest_addon.sensing.reverb.ends import read_microphones, read_path
from forest_addon.sensing.sonar.equipment_files import read_call, read_patterns, read_route
from forest_addon.spec import Flight, Scene, Sonar, SpecError, Species
from forest_addon.stand.files import read_tree_list

TOKENS = (
    *(b"\0", b"\xff", b"'", b'"', b"(", b"[" * 50, b"\n", b"\r", b",", b";", b"=", b"#", b"nan"),
    *(b"-inf", b"1e999", b"-1", b"0", b"9" * 400, b"\x1c", b"\xef\xbb\xbf", b"True", b"\x7f\xff\xff\xff"),
)  # fmt: skip


def npy(path):
    np.save(path, np.arange(12.0).reshape(3, 4))


def image(kind):
    def make(path):
        from PIL import Image

        shades = Image.fromarray(np.arange(240, dtype=np.uint8).reshape(12, 20))
        shades.save(path, format=kind)

    return make


def text(*lines):
    return lambda path: path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def preset(room, name):
    return lambda path: path.write_bytes((ASSETS / room / f"{name}.toml").read_bytes())


def ascii_stl(path):
    corners = "".join(f"  vertex {x} {x % 2} {x * 0.5}\n" for x in range(3))
    facet = f"facet normal 0 0 1\n outer loop\n{corners} endloop\nendfacet\n"
    path.write_text(f"solid a\n{facet * 4}endsolid a\n")


def glb(path):
    chunk = json.dumps({"asset": {"version": "2.0"}}).encode().ljust(40)
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(chunk), len(chunk), 0x4E4F534A)
    path.write_bytes(head + chunk)


def geotiff(path):
    from PIL import Image, TiffImagePlugin

    tags = TiffImagePlugin.ImageFileDirectory_v2()
    for key, value in ((33550, (2.0, 2.0, 0.0)), (33922, (0.0, 0.0, 0.0, 4e5, 5e6, 0.0))):
        tags[key], tags.tagtype[key] = value, 12
    Image.fromarray(np.arange(12, dtype=np.float32).reshape(3, 4)).save(path, tiffinfo=tags)


def las(path):
    cloud = laspy.create(point_format=6, file_version="1.4")
    cloud.x, cloud.y, cloud.z = stream(0, "las").random((3, 20))
    cloud.write(path)


def workbook(path):
    book = pytest.importorskip("openpyxl").Workbook()
    for row in (("x", "y", "DBH (cm)"), (1.5, 2, 30), (3, 4, None)):
        book.active.append(row)
    book.save(path)


def packed(path):
    path.write_bytes(gzip.compress(b"x,y,h\n1.5,2,12\n3,4,15\n"))


def layer(path):
    raw = pytest.importorskip("pyogrio.raw")
    shapes = pytest.importorskip("shapely").to_wkb(
        pytest.importorskip("shapely").points([[1, 2], [3, 4]])
    )
    raw.write(
        path, shapes, [np.array([0.2, 0.3])], ["dbh"], geometry_type="Point", crs="EPSG:32632"
    )


def shapefile(path):
    """Its other files stand beside it, and beside what it is changed to."""
    layer(path)
    for file in path.parent.glob(f"{path.stem}.*"):
        file.with_stem("a").write_bytes(file.read_bytes())


def sofa(path):
    library = pytest.importorskip("sofar")
    file = library.Sofa("SimpleFreeFieldHRIR")
    file.Data_IR, file.Data_SamplingRate = stream(0, "sofa").random((4, 2, 8)), 48_000
    file.SourcePosition = np.array([[turn, 0, 1.5] for turn in (0, 90, 180, 270)])
    library.write_sofa(str(path), file)


def head_in(path):
    pytest.importorskip("sofar")
    found = read_head(path)
    return found.directions, found.responses


def usd(path):
    bpy = pytest.importorskip("bpy")
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.wm.usd_export(filepath=str(path))


def opened(path):
    pytest.importorskip("bpy")
    from forest_addon.blender.files.export import open_file

    open_file(path)


def head_of(path):
    """Heads that are read before Blender reads a mesh; files go to Blender in tests of its own."""
    if not path.exists():
        raise SpecError(str(path), "there is no such file")
    refuse_claims(path)
    if path.read_bytes()[:3] not in (b"ply", b"glT"):
        raise ValueError("no mesh")


PLY = (
    "ply",
    "format ascii 1.0",
    "element vertex 3",
    "property float x",
    "property float y",
    "end_header",
)
POINT = '{"type": "Feature", "geometry": {"type": "Point", "coordinates": [%s]}, "properties": {"h": 9}}'
LEVEL = LidarSense(LIDAR)
READERS = {
    "las": ("a.las", las, lambda path: np.asarray(read_las(path).xyz)),
    "laz": ("a.laz", las, lambda path: np.asarray(read_las(path).xyz)),
    "xlsx": ("a.xlsx", workbook, lambda path: read_tree_map(path).position),
    "packed table": ("a.csv.gz", packed, lambda path: read_tree_map(path).position),
    "layer": ("a.fgb", layer, lambda path: read_tree_map(path).position),
    "geopackage": ("a.gpkg", layer, lambda path: read_tree_map(path).position),
    "shapefile": ("a.shp", shapefile, lambda path: read_tree_map(path).position),
    "sofa": ("a.sofa", sofa, head_in),
    "usd": ("a.usda", usd, opened),
    "binary usd": ("a.usdc", usd, opened),
    "geojson": (
        "a.geojson",
        text('{"features": [', POINT % "1, 2", ",", POINT % "3.5, 4", "]}"),
        lambda path: read_tree_map(path).position,
    ),
    "ply head": ("a.ply", text(*PLY, "0 0", "1 0", "1 1"), guarded("a mesh")(head_of)),
    "glb head": ("a.glb", glb, guarded("a mesh")(head_of)),
    "obj": (
        "a.obj",
        text("v 0 0 0", "v 1 0 0", "v 0 1 0.5", "usemtl a", "f 1//1 2/1 -1"),
        lambda path: read_obj(path).vertices,
    ),
    "materials": (
        "a.mtl",
        text("newmtl a", "helios_reflectance 0.2", "helios_isGround true"),
        read_materials,
    ),
    "points": (
        "a.xyz",
        text("0 0 0", "1 2 3", "2 2 2.5"),
        lambda path: read_points(path, " ", 1.0, Material()).vertices,
    ),
    "terrain": ("a.tif", geotiff, lambda path: read_terrain(path, Material()).vertices),
    "npy": ("a.npy", npy, read_raster),
    "png": ("a.png", image("PNG"), read_raster),
    "tiff": ("a.tif", image("TIFF"), read_raster),
    "map": ("a.csv", text("x,y,species", "1.5,2,oak", "3,-4e0,elm"), read_tree_map),
    "rings": ("a.csv", text("x;y;ring", "0;0;a", "9;0;a", "9;9;b"), read_rings),
    "list": ("a.csv", text("x,y,scale,rotation", "1,2,1.1,0.5", "3,4,,"), read_tree_list),
    "microphones": ("a.csv", text("x,y,z", "0,0,0", "0.5,-1e-1,2"), read_microphones),
    "path": (
        "a.csv",
        text("time,x,y,z", "0,0,0,1.5", "2,3,4,1.5"),
        lambda path: read_path(path, "k"),
    ),
    "directivity": ("a.csv", text("angle_deg,250,1000", "0,0,0", "180,-3,-20"), read_directivity),
    "pattern": ("a.csv", text("angle_deg,60000,70000", "0,0,0", "90,-9,-20"), read_patterns),
    "route": (
        "a.csv",
        text("x_m,y_m,z_m,azimuth_deg,elevation_deg", "0,0,1,90,0", "1,0,1,80,5"),
        lambda path: read_route(path, 3.0),
    ),
    "wav": ("a.wav", lambda path: write_wav(path, np.linspace(-1, 1, 50), 8000.0), read_wav),
    "call": (
        "a.wav",
        lambda path: write_wav(path, np.sin(1.76 * np.arange(50)), 250_000.0),  # 70 kHz
        lambda path: read_call(path, Sonar()),
    ),
    "policy": (
        "a.npz",
        lambda path: np.savez(path, weights=np.linspace(-1, 1, policies.SIZE)),
        lambda path: policies.load(path, Flight(), LEVEL).weights,
    ),
    "stl": ("a.stl", lambda path: write_stl(path, stream(0, "stl").random((5, 3, 3))), read_stl),
    "ascii stl": ("a.stl", ascii_stl, read_stl),
    "glb": ("a.glb", glb, read_glb),
    "scene": ("a.toml", preset("scenes", "demo"), lambda path: read_settings(path, Scene)),
    "species": ("a.toml", preset("species", "apple"), lambda path: read_settings(path, Species)),
    "scanner": (
        "a.toml",
        preset("scanners", "riegl-vz-400i"),
        lambda path: read_scanner(path.name, path.parent),
    ),
}


def mutated(raw, rng):
    """A copy with one to four places changed."""
    data = bytearray(raw)
    for _ in range(rng.integers(1, 5)):
        at = int(rng.integers(0, len(data) + 1))
        # The first bytes hold headers, which most readers trust.
        at = at if rng.random() < 0.5 else min(at, int(rng.integers(0, 140)))
        match rng.integers(0, 6):
            case 0:
                data[at : at + 1] = bytes(rng.integers(0, 256, 1, dtype=np.uint8))
            case 1:
                token = TOKENS[rng.integers(len(TOKENS))]
                data[at : at + len(token) * int(rng.integers(0, 2))] = token
            case 2:
                del data[at:]
            case 3:
                del data[at : at + int(rng.integers(1, 20))]
            case 4:
                data[at:at] = data[max(at - 30, 0) : at]
            case 5:
                data[at : at + 4] = bytes(rng.integers(0, 256, 4, dtype=np.uint8))
        if not data:
            break
    return bytes(data)


def outcome(read, path):
    """What a reader gave, or the sentence that it refused with."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # facets left out, images that look like bombs
        try:
            return read(path), None
        except (SpecError, StlError) as problem:
            return None, str(problem)


def arrays_of(found):
    if isinstance(found, np.ndarray):
        return [found]
    if isinstance(found, tuple | list):
        return [array for each in found for array in arrays_of(each)]
    return []


@pytest.mark.medium
@pytest.mark.parametrize("kind", READERS)
@settings(max_examples=12)
@given(seed=integers(0, 2**32 - 1))
def test_a_broken_file_is_one_sentence(kind, seed, tmp_path):
    name, make, read = READERS[kind]
    path, intact = tmp_path / name, tmp_path / f"intact-{name}"
    if not intact.exists():
        make(intact)
        path.write_bytes(intact.read_bytes())
        assert outcome(read, path)[1] is None
    path.write_bytes(mutated(intact.read_bytes(), stream(seed, "broken", kind)))
    found, refused = outcome(read, path)
    if refused is None:
        for array in arrays_of(found):
            if array.dtype.kind == "f" and kind not in ("npy", "tiff"):  # may hold NaN: no data
                assert np.isfinite(array).all()
        return
    assert name in refused
    assert "\n" not in refused
    assert len(refused) < 1200


@pytest.mark.parametrize("kind", READERS)
def test_no_file_a_folder_nothing_in_it(kind, tmp_path):
    name, _, read = READERS[kind]
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / name).mkdir()
    (tmp_path / name).write_bytes(b"")
    for path in (tmp_path / "none" / name, tmp_path / "folder" / name, tmp_path / name):
        try:
            _, refused = outcome(read, path)
        except OSError as problem:  # STL: the caller says what the file was for
            refused = str(problem)
            assert name.endswith(".stl")
        if kind in ("scene", "species") and path == tmp_path / name:
            continue  # an empty TOML file says nothing wrong
        assert name in refused


NESTED = "a = " + "[" * 3000 + "]" * 3000
LONG = "9" * 5000
MUCH = [
    *((kind, NESTED, "nested too deeply") for kind in ("scene", "species", "scanner")),
    ("scene", "seed = " + "[" * 300 + "]" * 300, "seed"),  # which Python still reads
    *(
        ("scene", f"name = 'a'\nseed = {number}\n", "seed.* digits")
        for number in (LONG, f"-{LONG}", "0x" + "f" * 5000, "1" + "_000" * 1700)
    ),
    (
        "scene",
        '[[plantings]]\nspecies = "maple"\nexpected = 1\n' * 1001,
        "plantings: has 1,001 entries; give at most 1,000",
    ),
]


@pytest.mark.parametrize(("kind", "written", "words"), MUCH)
def test_settings_of_much_too_much_are_one_short_sentence(kind, written, words, tmp_path):
    path = tmp_path / "much.toml"
    path.write_text(written)
    _, refused = outcome(READERS[kind][2], path)
    assert re.search(f"much.toml.*{words}", refused)
    assert "set_int_max_str_digits" not in refused
    assert len(refused) < 400


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such files")
@pytest.mark.parametrize("kind", READERS)
def test_what_has_no_end_is_not_read(tmp_path, kind):
    """Devices and pipes would be read for ever; a file of 5 GB takes all memory."""
    name, _, read = READERS[kind]
    path = tmp_path / name
    for make in (lambda: path.symlink_to("/dev/zero"), lambda: os.mkfifo(path)):
        make()
        with pytest.raises((SpecError, StlError), match=r"is a device or a pipe|is not known"):
            read(path)
        path.unlink()
    with open(path, "wb") as file:
        file.truncate(5 * 10**9)
    with pytest.raises((SpecError, StlError), match=r"has 5.0 GB, more than the"):
        read(path)


def huge_png(path):
    head = struct.pack(">IIBBBBB", 30_000, 30_000, 8, 0, 0, 0, 0)
    chunks = [(b"IHDR", head), (b"IDAT", zlib.compress(b"")), (b"IEND", b"")]
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + b"".join(
            struct.pack(">I", len(c)) + k + c + struct.pack(">I", zlib.crc32(k + c))
            for k, c in chunks
        )
    )


def huge_tiff(path):
    entries = [
        (256, 30_000),
        (257, 30_000),
        (258, 8),
        (259, 1),
        (262, 1),
        (273, 8),
        (277, 1),
        (279, 1),
    ]
    rows = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in entries)
    path.write_bytes(b"II*\0" + struct.pack("<IH", 8, len(entries)) + rows + struct.pack("<I", 0))


def huge_bmp(path):
    head = struct.pack(
        "<2sIHHIIiiHHIIiiII", b"BM", 54, 0, 0, 54, 40, 12_000, 12_000, 1, 24, *([0] * 6)
    )
    path.write_bytes(head)


def huge_npy(path):
    np.lib.format.open_memmap(path, "w+", np.uint8, (30_000, 30_000)).flush()


@pytest.mark.parametrize(
    ("name", "make"),
    [("a.png", huge_png), ("a.tif", huge_tiff), ("a.bmp", huge_bmp), ("a.npy", huge_npy)],
)
def test_a_raster_that_would_take_all_memory_is_refused(tmp_path, name, make):
    make(tmp_path / name)
    with pytest.raises(SpecError, match="more than 100,000,000"):
        read_raster(tmp_path / name)


def claiming_las(path, at, code, *values):
    las(path)
    raw = bytearray(path.read_bytes())
    struct.pack_into(code, raw, at, *values)
    path.write_bytes(raw)


def claiming_laz(path, kind):
    """Its reader makes room for what its parts count, gigabytes for 655 bytes, or ends the process."""
    las(path)
    raw = bytearray(path.read_bytes())
    begin = struct.unpack_from("<I", raw, 96)[0]
    at, value = {
        "layer": (begin + 8 + 30 + 4, 4_000_000_000),
        "chunk table": (struct.unpack_from("<Q", raw, begin)[0] + 8, 0xFFFFFFFF),
        "points of a chunk": (raw.index(b"laszip encoded") + 52 + 12, 0xFFFF7FFC),
    }[kind]
    struct.pack_into("<I", raw, at, value)
    path.write_bytes(raw)


def claiming_wav(path):
    write_wav(path, np.linspace(-1, 1, 50), 8000.0)
    raw = path.read_bytes()
    at = raw.index(b"data") + 4
    path.write_bytes(raw[:at] + struct.pack("<I", 4000) + raw[at + 4 :])


def claiming_glb(path):
    chunk = json.dumps({"asset": {"version": "2.0"}, "accessors": [{"count": 10**9}]}).encode()
    path.write_bytes(
        struct.pack("<4sIIII", b"glTF", 2, 20 + len(chunk), len(chunk), 0x4E4F534A) + chunk
    )


def claiming_usd(path, at, value):
    usd(path)
    raw = bytearray(path.read_bytes())
    table = struct.unpack_from("<Q", raw, 16)[0]
    at = struct.unpack_from("<Q", raw, table + 8 + 16)[0] if at else table
    struct.pack_into("<Q", raw, at, value)
    path.write_bytes(raw)


CLAIMS = {
    "sections": ("a.usdc", lambda path: claiming_usd(path, 0, 300_000_000)),
    "words": ("a.usdc", lambda path: claiming_usd(path, 1, 300_000_000)),
    "records beyond the end": (
        "a.las",
        lambda path: claiming_las(path, 96, "<II", 10**9, 3 * 10**6),
    ),
    "records": ("a.las", lambda path: claiming_las(path, 100, "<I", 4_000_000_000)),
    "records behind": ("a.las", lambda path: claiming_las(path, 243, "<I", 4_000_000_000)),
    "points": ("a.las", lambda path: claiming_las(path, 247, "<Q", 10**15)),
    "packed points": ("a.laz", lambda path: claiming_las(path, 247, "<Q", 10**10)),
    **{
        kind: ("a.laz", lambda path, kind=kind: claiming_laz(path, kind))
        for kind in ("layer", "chunk table", "points of a chunk")
    },
    "vertices": ("a.ply", text(*PLY[:2], "element vertex 4000000000", *PLY[3:], "0 0")),
    "vertices of nothing": ("a.ply", text(*PLY[:2], "element vertex 4000000000", PLY[5], "0 0")),
    "accessors": ("a.glb", claiming_glb),
    "sound": ("a.wav", claiming_wav),
    "sparse accessors": (
        "a.gltf",
        text('{"accessors": [{"count": 3, "sparse": {"count": 4000000000}}]}'),
    ),
}


@pytest.mark.parametrize("kind", CLAIMS)
def test_a_head_that_counts_more_than_the_file_holds_is_refused_at_once(tmp_path, kind):
    name, make = CLAIMS[kind]
    make(tmp_path / name)
    with pytest.raises(SpecError, match=f"{name}: is broken: (its head|a chunk) counts"):
        (read_las if name[:4] in ("a.la",) else refuse_claims)(tmp_path / name)


def test_a_sound_of_a_stream_is_read_to_its_end(tmp_path):
    """A program that writes into a pipe cannot say how long it will be."""
    write_wav(tmp_path / "a.wav", np.linspace(-1, 1, 50), 8000.0)
    raw = (tmp_path / "a.wav").read_bytes()
    at = raw.index(b"data") + 4
    (tmp_path / "b.wav").write_bytes(raw[:at] + b"\xff" * 4 + raw[at + 4 :])
    found = [read_wav(tmp_path / name)[0] for name in ("a.wav", "b.wav")]
    np.testing.assert_array_equal(*found)


def test_what_is_not_installed_is_no_fault_of_a_file(tmp_path):
    @guarded("a table")
    def read(path):
        raise ModuleNotFoundError("No module named 'laspy'", name="laspy")

    with pytest.raises(ModuleNotFoundError, match="laspy"):
        read(tmp_path / "a.las")


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such files")
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("a.gltf", '{"buffers": [{"uri": "endless%2Ebin", "byteLength": 9}]}'),
        ("a.gltf", '{"images": [{"uri": "endless.bin"}]}'),
        ("a.obj", "mtllib endless.bin"),
        ("a.obj", "v 0 0 0\nmtllib a.mtl"),
    ],
    ids=["buffer", "image", "materials", "texture"],
)
def test_a_part_that_has_no_end_is_not_opened(tmp_path, name, said):
    """Blender opens what a file names beside it, and would wait for ever."""
    os.mkfifo(tmp_path / "endless.bin")
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd -s 1 endless.bin\n")
    (tmp_path / name).write_text(said)
    with pytest.raises(SpecError, match=r"names \"endless.bin\", which is a device or a pipe"):
        refuse_claims(tmp_path / name)


@pytest.mark.parametrize(
    "lines",
    [
        (*PLY[:2], "comment " + "x" * 200_000, *PLY[2:], "0 0"),
        (*PLY[:2], PLY[3], PLY[2], *PLY[3:], "0 0"),
        (*PLY[:2], "element vertex three", *PLY[3:], "0 0"),
        (*PLY[:2], "element vertex -4", *PLY[3:], "0 0"),
        (*PLY[:2], "vertex 3", *PLY[3:], "0 0"),
        (*PLY[:3], "property flaot x", *PLY[4:], "0 0"),
        (*PLY[:5], "0 0"),
        (*PLY, "0 0", "1 0", "0 1 " + "0 " * 40_000),
    ],
    ids=["no end", "no element", "word", "negative", "no word", "type", "open", "line"],
)
def test_a_ply_on_which_blender_ends_itself_is_refused_before(tmp_path, lines):
    text(*lines)(tmp_path / "a.ply")
    with pytest.raises(SpecError, match=r"a\.ply: (is no PLY that can be read|has a line of)"):
        refuse_claims(tmp_path / "a.ply")


def test_an_stl_of_too_many_facets_is_refused(tmp_path):
    for write in (lambda path: write_stl(path, stream(0, "stl").random((5, 3, 3))), ascii_stl):
        write(tmp_path / "a.stl")
        with pytest.raises(StlError, match="facets, more than 3; make it coarser"):
            read_stl(tmp_path / "a.stl", 3)
    leaf = stream(0, "leaf").random((10_001, 3, 3))
    write_stl(tmp_path / "leaf.stl", leaf)
    (tmp_path / "s.toml").write_text('name = "a"\n[honda]\n[leaf]\nmesh = "leaf.stl"\n')
    with pytest.raises(SpecError, match="10,001 facets, more than 10,000"):
        load_species(tmp_path / "s.toml")


SECRET = "root:x:0:0:WORD-THAT-NO-ONE-MAY-READ:/root:/bin/bash"


@pytest.mark.parametrize("kind", READERS)
def test_a_file_of_something_else_is_not_shown(tmp_path, kind):
    """A service that takes names of files must not hand out what is in them."""
    name, _, read = READERS[kind]
    for text_of_it in (SECRET, f"{SECRET}\n{SECRET}\n", f"{SECRET},1,2,3\n", f"a;{SECRET}\nb;c\n"):
        path = tmp_path / name
        path.write_text(text_of_it)
        with pytest.raises((SpecError, StlError, ValueError)) as said:
            read(path)
        assert "WORD-THAT" not in str(said.value)
