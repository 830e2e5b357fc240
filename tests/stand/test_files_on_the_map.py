"""Grounds and rasters by other hands: one plane in every type, unit, orientation and format, read in metres.

Files are written by tifffile with the tags that OGC 19-008r4 and GDAL name, or as text; the plane is known
in closed form. Bilinear in the inner pixels, it is held to the steps of the numbers stored.
"""

import re
import struct
from pathlib import Path

import laspy
import numpy as np
import pytest
import tifffile

from forest_addon.formats.helios.parts import Material, read_terrain as survey_ground
from forest_addon.formats.raster_file import CLOUDS, POINTS, read_raster
from forest_addon.results.points import ENDINGS
from forest_addon.spec import Forest, Planting, Raster, Scene, SpecError, Terrain
from forest_addon.stand.compose import process_of
from forest_addon.stand.files import SURFACES as SURFACES_READ, read_inputs

ROOT = Path(__file__).parents[2]
EAST, NORTH, WIDE, HIGH = 500_000.0, 5_400_000.0, 31, 27  # lowest corner on the map, metres
FOOT, US_FOOT = 0.3048, 1200 / 3937
UPRIGHT = np.array([[1.0, 0, EAST], [0, -1.0, NORTH + HIGH]])


def plane(x, y):
    """Heights over metres from the corner."""
    return 320 + 0.5 * x + 0.2 * y


def heights(transform=UPRIGHT, shape=(HIGH, WIDE), at=0.5):
    """The plane at the middles of pixels of a grid."""
    row, column = np.mgrid[: shape[0], : shape[1]] + at
    x, y = np.einsum("ij,jrc->irc", transform, np.stack([column, row, np.ones_like(row)]))
    return plane(x - EAST, y - NORTH)


def geotiff(path, pixels, transform=UPRIGHT, keys=None, nodata=None, metadata=None, **how):
    """Write pixels with a pixel scale and a tie point where the grid is north-up, else with a matrix."""
    (a, b, c), (d, e, f) = np.asarray(transform, dtype=float)
    if b == d == 0 and a > 0 > e:
        tags = [(33550, "d", 3, (a, -e, 0.0)), (33922, "d", 6, (0.0, 0.0, 0.0, c, f, 0.0))]
    else:
        matrix = (a, b, 0.0, c, d, e, 0.0, f, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
        tags = [(34264, "d", 16, matrix)]
    keys = {1024: 1, 1025: 1, 3072: 32632} | (keys or {})
    directory = [1, 1, 0, len(keys)]
    for key, value in sorted(keys.items()):
        directory += [key, 0, 1, value]
    tags.append((34735, "H", len(directory), tuple(directory)))
    if nodata is not None:
        tags.append((42113, "s", 0, str(nodata)))
    if metadata is not None:
        tags.append((42112, "s", 0, f"<GDALMetadata>{metadata}</GDALMetadata>"))
    tifffile.imwrite(path, pixels, extratags=tags, photometric="minisblack", **how)


def scene(
    file, origin=(2.0, 2.0), size=(20.0, 18.0), offset=(EAST, NORTH, 300.0), crs="", **ground
):
    return Scene(
        offset=offset,
        crs=crs,
        forest=Forest(origin=origin, size=size, terrain=Terrain(file=file, **ground)),
    )


def ground_of(tmp_path, settings):
    """The ground, 300 points of the field, and the plane there less the offset's height."""
    inputs = read_inputs(settings, tmp_path)
    field = settings.forest
    place = np.array(field.origin) + np.random.default_rng(1).random((300, 2)) * field.size
    return inputs.terrain.height(place), plane(*place.T) - settings.offset[2], inputs.told[0]


META = '<Item name="{}" sample="0" role="{}">{}</Item>'
SCALED = META.format("SCALE", "scale", 0.1) + META.format("OFFSET", "offset", 300)
TURNED = [  # rows to the north; to the west; a rotated grid, of pixels that are not square
    np.array([[1.0, 0, EAST], [0, 1.0, NORTH]]),
    np.array([[-1.0, 0, EAST + WIDE], [0, -1.0, NORTH + HIGH]]),
    np.array([[0.8, 0.6, EAST - 12], [0.6, -0.8, NORTH + 12]]),
    np.array([[0.4, 0.72, EAST - 22.6], [0.3, -0.96, NORTH + 30.8]]),
]
KINDS = {  # how a file is written, and the largest step of its numbers in metres
    **{
        kind: (lambda p, kind=kind: geotiff(p, heights().round().astype(kind)), 0.5)
        for kind in ("int16", "uint16", "int32", "uint32", ">i2")
    },
    **{
        kind: (lambda p, kind=kind: geotiff(p, heights().astype(kind)), 1e-4)
        for kind in ("float32", "float64", ">f4")
    },
    "scale and offset of GDAL": (
        lambda p: geotiff(p, ((heights() - 300) * 10).round().astype("int16"), metadata=SCALED),
        0.05,
    ),
    "feet of GDAL's unit": (
        lambda p: geotiff(p, heights() / FOOT, metadata=META.format("UNITTYPE", "unittype", "ft")),
        1e-6,
    ),
    "feet of the vertical key": (
        lambda p: geotiff(p, heights() / US_FOOT, keys={4099: 9003}),
        1e-6,
    ),
    "tiles": (lambda p: geotiff(p, heights().astype("f4"), tile=(16, 16)), 1e-4),
    "strips, deflate, differences": (
        lambda p: geotiff(
            p, heights().round().astype("i2"), compression="zlib", predictor=2, rowsperstrip=5
        ),
        0.5,
    ),
    "BigTIFF": (lambda p: geotiff(p, heights(), bigtiff=True), 1e-6),
    "points, not areas": (lambda p: geotiff(p, heights(at=0.0), keys={1025: 2}), 1e-6),
    "pixels that are not square": (
        lambda p: geotiff(
            p,
            heights(np.array([[0.5, 0, EAST], [0, -0.25, NORTH + HIGH]]), (4 * HIGH, 2 * WIDE)),
            np.array([[0.5, 0, EAST], [0, -0.25, NORTH + HIGH]]),
        ),
        1e-6,
    ),
    **{
        f"turned {number}": (
            lambda p, turn=turn: geotiff(p, heights(turn, (60, 60)), turn),
            1e-6,
        )
        for number, turn in enumerate(TURNED)
    },
    "a world file": (
        lambda p: (
            tifffile.imwrite(p, heights(), photometric="minisblack"),
            p.with_suffix(".tfw").write_text(
                f"1,0\n0\n0\n-1\n{EAST + 0.5}\n{NORTH + HIGH - 0.5}\n"
            ),
            p.with_suffix(".prj").write_text("EPSG:32632"),
        ),
        1e-6,
    ),
    "two bands": (
        lambda p: geotiff(
            p, np.stack([heights(), heights() * 0 + 1]).astype("f4"), planarconfig="separate"
        ),
        1e-4,
    ),
}


@pytest.mark.parametrize("kind", KINDS)
def test_heights_are_heights_where_the_file_says(tmp_path, kind):
    write, step = KINDS[kind]
    write(tmp_path / "dem.tif")
    at = {"turned 0": (2.0, 2.0), "turned 1": (-25.0, 2.0)}.get(kind, (2.0, 2.0))
    settings = scene("dem.tif", at, (18.0, 18.0))
    found, expected, told = ground_of(tmp_path, settings)
    assert np.abs(found - expected).max() <= step + 1e-9
    assert "lies on the map in EPSG:32632: heights in m" in told
    assert ("the first of its 2 bands" in told) == (kind == "two bands")


@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize(
    ("kind", "packed", "predictor"),
    [
        ("i2", "lzw", 2),
        ("u4", "lzw", 2),
        ("f4", "zlib", 3),
        ("f8", "zlib", 3),
        ("f8", "lzw", 1),
        ("i4", "zstd", 1),
        ("f4", "lerc", 1),
    ],
)
def test_packed_heights_are_heights(tmp_path, kind, packed, predictor, big_endian):
    pytest.importorskip("imagecodecs", reason="tifffile packs these by imagecodecs")
    if packed == "lerc" and big_endian:
        pytest.skip("LERC is little-endian")
    how = {"compression": packed, "tile": (16, 16), "byteorder": "<>"[big_endian]}
    pixels = heights().round().astype(kind)
    geotiff(tmp_path / "dem.tif", pixels, predictor=predictor if predictor > 1 else None, **how)
    found, expected, _ = ground_of(tmp_path, scene("dem.tif"))
    assert np.abs(found - expected).max() <= 0.5 + 1e-4


def test_feet_of_a_system_are_metres_on_the_ground(tmp_path):
    """EPSG:2227 counts in US survey feet; its twin in metres has the same place, UTM another."""
    pytest.importorskip("pyproj")
    turn = UPRIGHT / US_FOOT
    metres = META.format("UNITTYPE", "unittype", "metre")
    for keys, unit, said in (
        ({}, US_FOOT, None),
        ({4096: 5703}, 1.0, None),  # NAVD88 height, metres
        ({4096: 5103}, US_FOOT, None),  # a datum
        ({}, 1.0, metres),
    ):
        keys = {3072: 2227, 3076: 9003} | keys
        geotiff(tmp_path / "dem.tif", heights() / unit, turn, keys, metadata=said)
        found, expected, _ = ground_of(tmp_path, scene("dem.tif", crs="EPSG:26943"))
        assert found == pytest.approx(expected, abs=1e-6)
        with pytest.raises(SpecError, match=r"lies in EPSG:2227, the scene in EPSG:32610"):
            read_inputs(scene("dem.tif", crs="EPSG:32610"), tmp_path)
    with pytest.raises(SpecError, match=r"US survey foot.*take EPSG:26943"):
        read_inputs(scene("dem.tif", crs="EPSG:2227"), tmp_path)


def test_a_picture_is_no_ground_unless_its_unit_is_said(tmp_path):
    geotiff(tmp_path / "dem.tif", (heights() - 300).round().astype("u1"))
    with pytest.raises(SpecError, match="holds bytes, as a hillshade"):
        read_inputs(scene("dem.tif"), tmp_path)
    settings = scene("dem.tif", unit="m", base=300.0)
    found, expected, _ = ground_of(tmp_path, settings)
    assert np.abs(found - expected).max() <= 0.5 + 1e-9


def test_a_system_that_is_not_there_is_refused_with_the_file(tmp_path):
    pytest.importorskip("pyproj")
    geotiff(tmp_path / "dem.tif", heights(), keys={3072: 29999})
    written(tmp_path / "dem.asc", "corner")
    (tmp_path / "dem.prj").write_text('GEOGCS["nowhere"]')
    for name in ("dem.tif", "dem.asc"):
        with pytest.raises(SpecError, match=rf"{name}: has a system that cannot be used"):
            read_inputs(scene(name), tmp_path)


def test_the_page_names_every_ending_that_is_read():
    page = (ROOT / "docs/bring-your-data.md").read_text("utf-8")
    said = page.split("## Terrain and rasters")[1].split("\n## ")[0].split("**Units.**")[0]
    endings = {*POINTS, *CLOUDS, *SURFACES_READ, ".asc", ".tif", ".npy"}
    assert set(re.findall(r"`(\.\w+)`", said)) - {".prj"} == endings
    said = page.split("## Point clouds")[1].split("\n## ")[0].split("\n\n")[1]
    assert set(re.findall(r"`(\.[\w.]+)`", said)) == {*ENDINGS} - {".xyz", ".npz", ".csv"}


DEGREES = np.array([[1e-5, 0, 9.0], [0, -1e-5, 48.75]])


@pytest.mark.parametrize(
    ("pixels", "transform", "keys", "said"),
    [
        (heights(), DEGREES, {1024: 2, 2048: 4326}, r"lies in degrees.*-t_srs EPSG:32632"),
        (heights(), UPRIGHT, {1024: 3, 3072: 32767}, "count.* from the middle of the Earth"),
        (heights(), UPRIGHT, {1024: 3, 2048: 4978, 3072: 32767}, "from the middle of the Earth"),
        (heights().astype(complex), UPRIGHT, {}, "is in colour, or of complex numbers"),
    ],
    ids=["degrees", "geocentric", "geocentric by its code", "complex"],
)
def test_a_raster_that_tells_no_heights_is_refused(tmp_path, pixels, transform, keys, said):
    geotiff(tmp_path / "dem.tif", pixels, transform, keys)
    for read in (
        lambda: read_inputs(scene("dem.tif"), tmp_path),
        lambda: survey_ground(tmp_path / "dem.tif", Material()),
    ):
        with pytest.raises(SpecError, match=rf"dem\.tif: .*{said}"):
            read()


@pytest.mark.parametrize(
    ("kind", "hole", "tag"),
    [
        ("f4", -9999, -9999),
        ("f4", -9999, None),
        ("f4", np.nan, None),
        ("f4", np.nan, "nan"),
        ("f4", -3.4028234663852886e38, "-3.4028234663852886e+38"),
        ("f4", 3.4e38, None),
        ("f8", -1.7e308, None),
        ("i2", -32768, -32768),
        ("i2", -32768, None),
        ("u2", 65535, 65535),
        ("i4", 0, 0),
        ("f4", -9999, "-9999,0"),
        ("f4", 0, "alpha"),
        ("f4", 0, "mask"),
    ],
)
def test_nodata_is_no_ground(tmp_path, kind, hole, tag):
    pixels = heights().round().astype(kind)
    pixels[10:13, 10:13] = hole
    shown = pixels != hole
    if tag == "alpha":
        pair = np.stack([pixels, shown.astype(kind)], axis=-1)
        geotiff(tmp_path / "dem.tif", pair, extrasamples=["unassalpha"])
    else:
        geotiff(tmp_path / "dem.tif", pixels, nodata=None if tag == "mask" else tag)
    if tag == "mask":  # beside the page, as GDAL puts it
        mask = {"subfiletype": 4, "photometric": "mask", "append": True}
        tifffile.imwrite(tmp_path / "dem.tif", shown, **mask)
    settings = scene("dem.tif", (0.0, 0.0), (WIDE, HIGH))
    inputs = read_inputs(settings, tmp_path)
    x, y = np.mgrid[0.5:WIDE, 0.5:HIGH]
    height = inputs.terrain.height(np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)
    empty = (x > 9) & (x < 14) & (y > HIGH - 14) & (y < HIGH - 9)
    inside = (x > 10) & (x < 13) & (y > HIGH - 13) & (y < HIGH - 10)
    assert np.isnan(height[inside]).all()
    assert np.abs(height - plane(x, y) + 300)[~empty].max() <= 0.5
    assert "9 pixels have none (NoData), and there is no ground there" in inputs.told[0]
    vertices, triangles = inputs.terrain.triangles()
    assert np.isfinite(vertices).all()
    a, b, c = (vertices[triangles[:, k], :2] for k in range(3))
    sides = np.stack([b - a, c - a], axis=1)
    area = np.abs(np.linalg.det(sides)).sum() / 2
    assert area == pytest.approx(
        WIDE * HIGH - 16
    )  # patches between nine pixels and their neighbours
    filled = read_inputs(
        scene("dem.tif", (0.0, 0.0), (WIDE, HIGH), fill_holes=True), tmp_path
    ).terrain.height(np.column_stack([x.ravel(), y.ravel()]))
    assert np.abs(filled.reshape(x.shape) - plane(x, y) + 300).max() <= 0.7


@pytest.mark.parametrize(
    ("unit", "metres", "times"),
    [("dm", 0.1, 4), ("cm", 0.01, 1), ("mm", 1e-3, 1), ("ft", FOOT, 10), ("us-ft", US_FOOT, 10)],
)
def test_heights_that_no_ground_has_ask_for_their_unit(tmp_path, unit, metres, times):
    """times : of the plane, so that its number of units is beyond what metres may be."""
    geotiff(tmp_path / "dem.tif", heights() * times / metres)
    settings = scene("dem.tif")
    with pytest.raises(SpecError, match=rf"9,000 m: what is their unit\? Say unit = .*'{unit}'"):
        read_inputs(settings, tmp_path)
    ground = read_inputs(scene("dem.tif", unit=unit), tmp_path).terrain
    expected = plane(10.5, 10.5) * times
    assert ground.height(np.array([[10.5, 10.5]])) + 300 == pytest.approx(expected, rel=1e-9)


def test_a_large_raster_is_cut_and_a_field_that_leaves_it_refused(tmp_path):
    large = np.array([[1.0, 0, EAST - 200], [0, -1.0, NORTH + 300]])
    geotiff(tmp_path / "dem.tif", heights(large, (512, 512)).astype("f4"), large)
    found, expected, told = ground_of(tmp_path, scene("dem.tif"))
    assert found == pytest.approx(expected, abs=1e-4)
    ground = read_inputs(scene("dem.tif"), tmp_path).terrain
    assert (ground.grid.low.tolist(), ground.grid.high.tolist()) == ([-18, -18], [42, 40])
    assert "20 x 18 pixels of 1 x 1 m on the field" in told
    with pytest.raises(SpecError) as refused:
        read_inputs(scene("dem.tif", offset=(0.0, 0.0, 300.0)), tmp_path)
    assert "x 499800 to 500312 and y 5399788 to 5400300" in str(refused.value)
    assert "field with its offset over x 2 to 22 and y 2 to 20" in str(refused.value)
    todo = "offset = [500044, 5400033, 300] at the top of the scene would put the field on it"
    assert todo in str(refused.value)
    read_inputs(scene("dem.tif", offset=(500044.0, 5400033.0, 300.0)), tmp_path)
    with pytest.raises(SpecError, match="make the field smaller"):
        read_inputs(scene("dem.tif", size=(600.0, 20.0)), tmp_path)


def test_a_place_in_the_scene_comes_before_that_of_the_file(tmp_path):
    geotiff(tmp_path / "dem.tif", heights())
    settings = scene("dem.tif", (1.0, 1.0), (20.0, 18.0), (0.0, 0.0, 300.0))
    with pytest.raises(SpecError, match="would put"):
        read_inputs(settings, tmp_path)
    placed = settings.forest.terrain.changed(origin=(0.0, 0.0))
    settings = settings.changed(forest=settings.forest.changed(terrain=placed))
    found, expected, _ = ground_of(tmp_path, settings)
    assert found == pytest.approx(expected, abs=1e-9)


def test_an_image_without_a_place_is_one_and_says_so(tmp_path):
    tifffile.imwrite(tmp_path / "hill.tif", np.array([[0, 65535]], dtype=np.uint16))
    inputs = read_inputs(scene("hill.tif", (0.0, 0.0), (20.0, 10.0), relief=7.0), tmp_path)
    assert inputs.terrain.height(np.array([[1.0, 5.0], [19.0, 5.0]])).tolist() == [0, 7]
    assert "hill.tif is an image or array without a place" in inputs.told[0]


def written(path, kind):
    """Write the plane as text or as a cloud."""
    row, column = np.mgrid[:HIGH, :WIDE]
    x, y = EAST + column + 0.5, NORTH + HIGH - row - 0.5
    rows = np.column_stack([x.ravel(), y.ravel(), heights().ravel()])
    head = {
        "corner": f"ncols {WIDE}\nnrows {HIGH}\nxllcorner {EAST}\nyllcorner {NORTH}\ncellsize 1\n",
        "centre": f"NCOLS {WIDE}\nNROWS {HIGH}\nXLLCENTER {EAST + 0.5}\nYLLCENTER {NORTH + 0.5}\nDX 1\nDY 1\n"
        "NODATA_VALUE -1\n",
    }
    if kind in head:
        lines = [" ".join(f"{v:.3f}" for v in line) for line in heights()]
        path.write_text(head[kind] + "\n".join(lines))
    elif kind == "decimal commas":
        lines = [" ".join(f"{v:.3f}".replace(".", ",") for v in line) for line in heights()]
        path.write_text(head["corner"] + "\n".join(lines))
    elif kind == "xyz":
        path.write_text(
            "x y z\n" + "\n".join("{:.2f} {:.2f} {:.3f}".format(*r) for r in rows[::-1])
        )
    elif kind == "named":  # in another order, and in centimetres
        lines = ["{2:.1f};7;{0:.2f};{1:.2f}".format(*r[:2], 100 * r[2]) for r in rows]
        path.write_text("\n".join(["elev_cm;id;Rechtswert;Hochwert", *lines]))
    elif kind == "titles, quotes, feet":
        lines = ['"{:.2f}","{:.2f}","{:.3f}"'.format(*r[:2], r[2] / FOOT) for r in rows]
        path.write_text("\n".join(["A survey", '"X","Y","Elevation (ft)"', *lines]), "utf-16")
    elif kind == "tabs":  # a third of the points is no ground
        lines = ["{:.2f}\t{:.2f}\t{:.3f}\t2".format(*r).replace(".", ",") for r in rows]
        lines += ["{:.2f}\t{:.2f}\t{:.3f}\t5".format(*r[:2], 350) for r in rows[::2]]
        path.write_text("\n".join(["x\ty\tz\tclassification", *lines]))
    elif kind == "counted":  # as Leica's and CloudCompare's, and each point twice, 1 m apart
        lines = [
            "{:.2f} {:.2f} {:.3f} 99".format(*r[:2], r[2] + up) for r in rows for up in (-1, 1)
        ]
        path.write_text("\n".join(["//X Y Z Intensity", str(len(lines)), *lines]))
    elif kind == "commas":
        path.write_text("\n".join("{:.2f},{:.2f},{:.3f}".format(*r) for r in rows))
    else:
        scattered = np.random.default_rng(5).random((4000, 2)) * [WIDE, HIGH]
        cloud = laspy.create(point_format=6, file_version="1.4")
        cloud.header.scales, cloud.header.offsets = [0.001] * 3, [EAST, NORTH, 0]
        high = np.arange(4000) % 3
        cloud.x, cloud.y = EAST + scattered[:, 0], NORTH + scattered[:, 1]
        cloud.z = plane(*scattered.T) + 12 * high  # vegetation above the ground
        cloud.classification = np.where(high == 1, 5, 2)
        cloud.withheld = high == 2
        cloud.classification[::9], cloud.z[::9] = 7, 900  # noise
        cloud.write(path)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("dem.asc", "corner"),
        ("dem.asc", "centre"),
        ("dem.asc", "decimal commas"),
        ("dem.xyz", "xyz"),
        ("dem.csv", "commas"),
        ("dem.txt", "named"),
        ("dem.csv", "titles, quotes, feet"),
        ("dem.txt", "tabs"),
        ("dem.pts", "counted"),
        ("ground.laz", "cloud"),
    ],
)
def test_grids_of_text_and_ground_of_clouds_are_read_as_geotiffs(tmp_path, name, kind):
    written(tmp_path / name, kind)
    found, expected, _ = ground_of(tmp_path, scene(name))
    assert found == pytest.approx(expected, abs=1e-2)


def test_a_unit_that_is_said_comes_before_that_of_the_file(tmp_path):
    pytest.importorskip("pyproj")
    for name, kind in (("g.las", "cloud"), ("dem.csv", "titles, quotes, feet")):
        written(tmp_path / name, kind)
    feet = read_inputs(scene("dem.csv", unit="ft"), tmp_path).terrain
    assert feet.height(np.array([[10.5, 10.5]])) == pytest.approx(plane(10.5, 10.5) - 300, abs=1e-3)
    cloud = laspy.read(tmp_path / "g.las")
    cloud.header.add_crs(pytest.importorskip("pyproj").CRS("EPSG:2227"))
    for part in (cloud.header, cloud.points):
        part.scales, part.offsets = part.scales / US_FOOT, part.offsets / US_FOOT
    cloud.write(tmp_path / "g.las")
    for said in ({}, {"unit": "us-ft"}):
        settings = scene("g.las", crs="EPSG:26943", **said)
        found, expected, _ = ground_of(tmp_path, settings)
        assert found == pytest.approx(expected, abs=1e-2)


def test_a_cloud_says_as_of_what_system_it_is_taken_or_how_to_move_it(tmp_path):
    pyproj = pytest.importorskip("pyproj")
    written(tmp_path / "g.las", "cloud")
    _, _, told = ground_of(tmp_path, scene("g.las", crs="EPSG:26943"))
    assert "taken to lie in EPSG:26943, as it names no system" in str(told)
    assert "names no system" not in str(ground_of(tmp_path, scene("g.las"))[2])
    cloud = laspy.read(tmp_path / "g.las")
    cloud.header.add_crs(pyproj.CRS("EPSG:32611"))
    cloud.write(tmp_path / "g.las")
    assert "names no system" not in str(ground_of(tmp_path, scene("g.las", crs="EPSG:32611"))[2])
    advice = r"pdal translate g.las OUT.laz reprojection --filters.reprojection.out_srs=EPSG:32610$"
    with pytest.raises(SpecError, match=advice):
        read_inputs(scene("g.las", crs="EPSG:32610"), tmp_path)


def test_east_and_north_exchanged_are_refused_as_trees_are(tmp_path):
    pytest.importorskip("pyproj")
    written(tmp_path / "dem.xyz", "xyz")
    rows = [line.split() for line in (tmp_path / "dem.xyz").read_text().splitlines()[1:]]
    (tmp_path / "dem.xyz").write_text("\n".join(f"{y} {x} {z}" for x, y, z in rows))
    said = "dem.xyz: .* are far from where EPSG:32632 is used; exchange them"
    with pytest.raises(SpecError, match=said):
        read_inputs(scene("dem.xyz", crs="EPSG:32632"), tmp_path)


@pytest.mark.parametrize("number", [0.0, float("nan"), 1e300])
def test_steps_of_a_cloud_that_are_none_are_refused(tmp_path, number):
    written(tmp_path / "g.las", "cloud")
    data = bytearray((tmp_path / "g.las").read_bytes())
    struct.pack_into("<d", data, 131, number)
    (tmp_path / "g.las").write_bytes(data)
    with pytest.raises(SpecError, match=r"g.las: is broken: its scales are"):
        read_raster(tmp_path / "g.las")


def obj(corners, path, _kind):
    lines = ["v {} {} {}".format(*corner) for corner in corners]
    path.write_text("\n".join([*lines, "f 1 2 3 4"]))


def ply(corners, path, kind):
    """A quadrilateral, with a property and an element that nobody asked for."""
    head = f"ply\nformat {kind} 1.0\ncomment by hand\nelement vertex 4\n"
    head += "property double x\nproperty double y\nproperty float32 z\nproperty uchar red\n"
    head += "element face 1\nproperty list uchar int vertex_indices\nproperty short flag\n"
    head += "element edge 1\nproperty int vertex1\nend_header\n"
    if kind == "ascii":
        rows = ["{} {} {} 7".format(*corner) for corner in corners]
        path.write_text(head + "\n".join([*rows, "4 0 1 2 3 1", "0"]) + "\n")
        return
    order = "<" if "little" in kind else ">"
    body = b"".join(struct.pack(order + "ddfB", *corner, 7) for corner in corners)
    path.write_bytes(head.encode() + body + struct.pack(order + "B4ihi", 4, 0, 1, 2, 3, 1, 0))


SURFACES = {
    "a.obj": (obj, ""),
    "a.ply": (ply, "ascii"),
    "b.ply": (ply, "binary_little_endian"),
    "c.PLY": (ply, "binary_big_endian"),
}


@pytest.mark.parametrize(
    ("east", "north", "crs", "said"),
    [
        (0.0, 0.0, "", r"a.obj \(read with z up\) reaches over x"),
        (0.0, 0.0, "EPSG:25832", r"a.obj \(read with z up\): coordinates of .* are far from"),
        (EAST, NORTH, "", "in metres, with z up"),
    ],
)
def test_a_surface_with_y_up_is_refused_with_the_axis(tmp_path, east, north, crs, said):
    if crs:
        pytest.importorskip("pyproj")
    corners = [(0, 0), (WIDE, 0), (WIDE, HIGH), (0, HIGH)]
    placed = [(east + x, 300.0 + y / 10, -north - y) for x, y in corners]
    obj(placed, tmp_path / "a.obj", "")
    with pytest.raises(SpecError, match=said):
        ground_of(tmp_path, scene("a.obj", offset=(0.0, 0.0, 0.0), crs=crs))


@pytest.mark.parametrize("name", SURFACES)
def test_a_surface_is_read_where_it_lies(tmp_path, name):
    """In the scene's own metres, and on the map: both are the plane."""
    write, kind = SURFACES[name]
    corners = np.array([[0, 0], [WIDE, 0], [WIDE, HIGH], [0, HIGH]], dtype=float)
    offset = (EAST, NORTH, 0.0)
    for shift, words in ((np.zeros(2), "the scene's own"), (np.array([EAST, NORTH]), "map")):
        placed = np.column_stack([corners + shift, plane(*corners.T)])
        write(placed.tolist(), tmp_path / name, kind)
        found, expected, told = ground_of(tmp_path, scene(name, offset=offset))
        assert found == pytest.approx(expected, abs=1e-4)
        assert words in told
    with pytest.raises(SpecError, match=r"offset = \["):
        read_inputs(scene(name, offset=(0.0, 0.0, 0.0)), tmp_path)


@pytest.mark.parametrize("transform", [UPRIGHT, *TURNED[2:]])
def test_a_survey_reads_the_ground_by_the_same_reader(tmp_path, transform):
    geotiff(tmp_path / "dem.tif", heights(transform).astype("f8"), transform, nodata=-9999)
    vertices = survey_ground(tmp_path / "dem.tif", Material()).vertices
    assert vertices[:, 2] == pytest.approx(
        plane(vertices[:, 0] - EAST, vertices[:, 1] - NORTH), abs=1e-9
    )


# ------------------------------------------------------------------------------------- intensities


def process(tmp_path, pixels, planting, nodata=None):
    side = np.array([[1.0, 0, EAST], [0, -1.0, NORTH + len(pixels)]])
    geotiff(tmp_path / "map.tif", pixels, side, nodata=nodata)
    settings = Scene(
        offset=(EAST, NORTH, 0.0),
        forest=Forest(size=pixels.shape[::-1]),
        plantings=(planting,),
    )
    return process_of(planting, settings.forest, read_inputs(settings, tmp_path))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "hole", "tag"), [("u1", 255, 255), ("f4", -9999, None), ("f4", np.nan, None)]
)
def test_nodata_is_no_weight_up_to_the_edge_of_its_pixels(tmp_path, kind, hole, tag):
    pixels = np.full((20, 20), 3, dtype=kind)
    pixels[4:9, 6:12] = hole
    found = process(tmp_path, pixels, Planting(species="m", rasters=(Raster(file="map.tif"),)), tag)
    place = np.random.default_rng(2).random((5000, 2)) * 20
    x, y = place.T
    empty = (x > 6) & (x < 12) & (y < 16) & (y > 11)
    assert found.at(place) == pytest.approx(np.where(empty, 0.0, 3.0))
    assert found.expected == pytest.approx(3 * (400 - 30), rel=2e-3)


def test_classes_are_numbers_that_a_threshold_parts(tmp_path):
    pixels = np.random.default_rng(3).integers(1, 5, (20, 20)).astype("u1")
    pixels[2, 3] = 255
    planting = Planting(
        species="m", base=0.5, rasters=(Raster(file="map.tif", use="mask", threshold=3),)
    )
    found = process(tmp_path, pixels, planting, 255)
    place = np.random.default_rng(4).random((5000, 2)) * 20
    column, row = np.floor(place[:, 0]).astype(int), 19 - np.floor(place[:, 1]).astype(int)
    kept = (pixels[row, column] >= 3) & (pixels[row, column] != 255)
    assert (found.at(place) == np.where(kept, 0.5, 0.0)).all()


def test_percent_weigh_as_numbers(tmp_path):
    pixels = np.repeat([[0, 20, 60]], 3, axis=0).repeat(8, axis=0).repeat(8, axis=1).astype("u1")
    planting = Planting(species="m", expected=30, rasters=(Raster(file="map.tif"),))
    found = process(tmp_path, pixels, planting)
    low, high = found.at(np.array([[12.0, 12.0], [20.0, 12.0]]))
    assert high / low == pytest.approx(3)
    assert found.expected == pytest.approx(30)
