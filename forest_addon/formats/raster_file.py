"""Rasters: TIFF by tifffile, PNG by pypng, npy arrays by numpy, grids and points of text, ground of a LAS.

A file that says where it lies (GeoTIFF, OGC 19-008r4; ESRI ASCII grid; points) holds numbers that count as
they are, by GDAL's scale and offset where it tells them; what it calls NoData is NaN. Any other is an image:
its black is 0 and its white 1, whatever its depth; floating-point images and arrays count as they are.
Images that are neither, and TIFF packed in ways that tifffile leaves to the package imagecodecs (LZW, the
prediction of floats, JPEG), are read by Pillow, which installations by pip have, or by OpenImageIO, which
is in Blender.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import scipy  # loads a part when it is first asked

from ..spec import SpecError
from ..spec.forest import METRES
from .crs import (
    GEO_KEYS,
    IN_DEGREES,
    MODEL,
    metric_near,
    system_of,
    unit_named,
)
from .foreign import guarded
from .table import text_of, words_of
from .tree_map import column_of, pairs_of

MOST_PIXELS = 100_000_000
MOST_SAMPLES = 16  # of a pixel
DEEP = 65535.0  # white of all that is deeper than a byte
WHITE = {  # by Pillow's modes
    **dict.fromkeys(("1", "F"), 1.0),
    **dict.fromkeys(("L", "LA", "RGB", "RGBA"), 255.0),
    **dict.fromkeys(("I", "I;16", "I;16L", "I;16B", "I;16N"), DEEP),
}
PNG = b"\x89PNG"
TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
WHITE_IS_ZERO, PALETTE = 0, 3  # of TIFF's photometric interpretation
PIXEL_SCALE, TIE_POINT, MATRIX, METADATA, NO_DATA = 33550, 33922, 34264, 42112, 42113  # tags
POINT = 2  # of a GeoTIFF's raster types
ALPHA = {1, 2}  # of TIFF's extra samples
RGB = 2  # of TIFF's photometric interpretation
NOTHING = (-9999.0, -99999.0, -32768.0, -32767.0)  # no height or amount, said or not
ENDLESS = 1e38  # beyond are the largest floats, which stand for nothing
LOWEST, HIGHEST = -500.0, 9000.0  # m, of ground
HEIGHTS = (
    "z",
    "h",
    "height",
    "elevation",
    "elev",
    "alt",
    "hoehe",
    "hohe",
    "dtm",
    "dgm",
    "gridcode",
    *("cota", "quota", "kote", "altitud", "altitude", "elevacion", "elevazione"),
)
DEGREES = 0.01  # a step below which numbers that may be degrees are degrees
POINTS, CLOUDS = (".xyz", ".txt", ".csv", ".pts"), (".las", ".laz")
GROUND_CLASS, MOST_POINTS = 2, 2_000_000  # and how many points of it are joined
HEAD = re.compile(r"\s*(?:(?:ncols|nrows|[xy]ll\w+|cellsize|d[xy]|nodata\w*)\s+\S+\s+)+")


@dataclass(frozen=True)
class GeoRaster:
    """Numbers in rows and columns, and where on the map they lie if their file says that.

    pixels : (rows, columns) float64, the first row the upper edge of an image; NaN where there is nothing.
    transform : (2, 3) from column, row and 1, counted from the outer corner of the first pixel, to metres
    on the map; None of an image. crs : its coordinate system; empty: not said. unit : metres of a unit of
    height. note : what was left aside of the file. shades : numbers are bytes, as of a picture.
    """

    pixels: np.ndarray
    transform: np.ndarray | None = None
    crs: str = ""
    unit: float = 1.0
    note: str = ""
    shades: bool = False

    def places(self, column: np.ndarray, row: np.ndarray) -> np.ndarray:
        """(..., 2) metres on the map of columns and rows, counted from the first pixel's outer corner."""
        assert self.transform is not None
        return np.stack([column, row], axis=-1) @ self.transform[:, :2].T + self.transform[:, 2]

    def indices(self, place: np.ndarray) -> np.ndarray:
        """(..., 2) columns and rows of places on the map, counted as those of ``places``."""
        assert self.transform is not None
        return (place - self.transform[:, 2]) @ np.linalg.inv(self.transform[:, :2]).T

    def holds(self, place: np.ndarray) -> np.ndarray:
        """(...) bool, which places (..., 2) on the map lie on it or within a hundredth of a pixel."""
        there = self.indices(place)
        near = np.array([there + 0.01, self.pixels.shape[::-1] - there + 0.01])
        return np.asarray((near >= 0).all(axis=(0, -1)))

    @property
    def extent(self) -> tuple[np.ndarray, np.ndarray]:
        """(2,) lowest and (2,) highest x and y of its outer edge, metres on the map."""
        rows, columns = self.pixels.shape
        corner = self.places(np.array([0, columns, columns, 0]), np.array([0, 0, rows, rows]))
        return corner.min(axis=0), corner.max(axis=0)

    def upright(self) -> GeoRaster:
        """The same with the first row in the north and columns to the east: turned over where that does it,
        else drawn anew, bilinear between the middles of pixels and as fine as they are."""
        assert self.transform is not None
        turn = self.transform[:, :2]
        low, high = self.extent
        if not turn[[0, 1], [1, 0]].any():
            pixels = self.pixels[:: -1 if turn[1, 1] > 0 else 1, :: -1 if turn[0, 0] < 0 else 1]
            return replace(
                self, pixels=pixels, transform=_north_up(low[0], high[1], np.abs(turn.diagonal()))
            )
        step = np.repeat(np.linalg.norm(turn, axis=0).min(), 2)
        columns, rows = np.ceil((high - low) / step - 1e-9).astype(int)
        _refuse_large(columns, rows)
        drawn = replace(self, transform=_north_up(low[0], high[1], step))
        y, x = np.mgrid[:rows, :columns] + 0.5
        place = drawn.places(x, y)
        middle = np.moveaxis(self.indices(place)[..., ::-1] - 0.5, -1, 0)
        pixels = scipy.ndimage.map_coordinates(self.pixels, middle, order=1, mode="nearest")
        return replace(drawn, pixels=np.where(self.holds(place), pixels, np.nan))

    def heights(self, path: Path, unit: float | None = None) -> np.ndarray:
        """(rows, columns) metres of what lies on the map.

        unit : metres of a unit; None: as the file says.

        Raises
        ------
        SpecError : no pixel has one, or some are beyond -500 to 9,000 m.
        """
        if self.shades and unit is None:
            raise SpecError(
                str(path),
                "holds bytes, as a hillshade or another picture; if they are heights, say unit = 'm'",
            )
        metres = self.pixels * (self.unit if unit is None else unit)
        if not np.isfinite(metres).any():
            raise SpecError(str(path), "has no height at all: every pixel is NoData")
        low, high = np.nanmin(metres), np.nanmax(metres)
        if low < LOWEST or high > HIGHEST:
            span = np.array([np.nanmin(self.pixels), np.nanmax(self.pixels)])
            fits = [u for u, m in METRES.items() if span[0] * m > LOWEST and span[1] * m < HIGHEST]
            raise SpecError(
                str(path),
                f"holds heights of {low:,.7g} to {high:,.7g} m, and ground lies between -500 and 9,000 m: "
                "what is their unit? "
                + (f"Say unit = {' or '.join(map(repr, fits))}; " if fits else "")
                + "else say in the file which number is NoData",
            )
        return metres


def _north_up(west: float, north: float, size: np.ndarray) -> np.ndarray:
    return np.array([[size[0], 0.0, west], [0.0, -size[1], north]])


@guarded("a raster: a GeoTIFF, an ASCII grid, points, an image in shades of grey or an npy array")
def read_raster(path: Path) -> GeoRaster:
    """Numbers of a file, and where they lie if it says that.

    Raises
    ------
    SpecError : the file is missing, cannot be read, is in colour, has no pixels, or lies in degrees.
    """
    return READERS.get(path.suffix.lower(), _read_image)(path)


def read_png(data: bytes, path: Path | None = None) -> tuple[np.ndarray, float]:
    """Pixels (H, W, 1 to 4) of a PNG's bytes, the upper row first, and the number that is white.

    One channel is grey, two are grey and alpha, three and four red, green, blue and alpha.
    path : of its file.

    Raises
    ------
    ValueError : this is no whole PNG, or it has too many pixels.
    """
    import png

    reader = png.Reader(bytes=data)
    try:
        reader.preamble()
        _refuse_large(reader.width, reader.height, path)
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


def _read_array(path: Path) -> GeoRaster:
    array = np.load(path, mmap_mode="r", allow_pickle=False)
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "buif":
        raise SpecError(str(path), "is not an npy file of real numbers; save a plain array")
    if array.ndim != 2 or not 0 < array.size <= MOST_PIXELS:
        raise SpecError(
            str(path),
            f"has the shape {list(array.shape)}: no array of rows and columns, or more than "
            f"{MOST_PIXELS:,} numbers",
        )
    return GeoRaster(array.astype(np.float64))


def _read_image(path: Path) -> GeoRaster:
    placed = _place_of(path)
    pixels, white = _read_pixels(path, raw=placed is not None)
    if placed is not None:
        return _numbers(path, pixels, *placed)
    if pixels.shape[2] in (2, 4):  # with alpha, which says nothing about shades
        pixels = pixels[..., :-1]
    if (pixels[..., 1:] != pixels[..., :1]).any():
        raise SpecError(str(path), "is in colour; save it in shades of grey")
    return GeoRaster(np.asarray(pixels[..., 0] / white, dtype=np.float64))


def _place_of(path: Path) -> tuple[GeoRaster, Any] | None:
    """The place of a TIFF, as a raster without pixels, and its page's tags; None of an image.

    Raises
    ------
    SpecError : it lies by ground control points or in degrees, or is a photograph.
    """
    import tifffile

    try:
        with tifffile.TiffFile(path) as opened:
            page: Any = opened.pages[0]
            named, tags, colour = page.geotiff_tags or {}, page.tags, page.photometric == RGB
            scale, tie, matrix = map(tags.valueof, (PIXEL_SCALE, TIE_POINT, MATRIX))
            told = {number: tags.valueof(number) for number in (METADATA, NO_DATA)}
    except Exception:  # no TIFF; what is damaged is told where its pixels are read
        return None
    if matrix is not None:
        transform = np.reshape(matrix, (4, 4))[:2, [0, 1, 3]].astype(np.float64)
    elif scale is not None and tie is not None:
        size, (column, row, _, x, y, _) = np.abs(scale[:2]), tie[:6]
        transform = _north_up(x - column * size[0], y + row * size[1], size)
    elif tie is not None:
        raise SpecError(str(path), "lies by ground control points; warp it to a grid (gdalwarp)")
    else:
        return _beside_a_world(path)
    if colour or page.dtype.kind == "c":
        raise SpecError(
            str(path), "is in colour, or of complex numbers; give one band of heights or amounts"
        )
    if not np.isfinite(transform).all() or not np.linalg.det(transform[:, :2]):
        raise SpecError(str(path), "does not say where it lies in numbers; save it again")
    if named.get("GTRasterTypeGeoKey") == POINT:
        transform[:, 2] -= transform[:, :2].sum(axis=1) / 2
    keys = {number: named[name] for number, name in GEO_KEYS.items() if name in named}
    if keys.get(MODEL) == IN_DEGREES:
        raise _in_degrees(path, transform)
    crs, flat, up = system_of(path, "", keys)
    _refuse_degrees(path, crs, transform)
    return GeoRaster(np.zeros((0, 0)), flat * transform, crs, up), told


def _beside_a_world(path: Path) -> tuple[GeoRaster, Any] | None:
    """The place of a TIFF that a world file beside it says; None without one."""
    endings = (f"{path.suffix[:2]}fw", f"{path.suffix}w", ".wld")
    for beside in filter(Path.is_file, map(path.with_suffix, endings)):
        a, d, b, e, c, f = map(float, beside.read_text("utf-8").replace(",", ".").split())
        crs, flat, up = _system_beside(path)
        turn = flat * np.array([[a, b, c - (a + b) / 2], [d, e, f - (d + e) / 2]])
        return GeoRaster(np.zeros((0, 0)), turn, crs, up), {METADATA: "", NO_DATA: None}
    return None


def _in_degrees(path: Path, transform: np.ndarray) -> SpecError:
    """Sentence on what lies in degrees, at the last column of (2, 3)."""
    return SpecError(
        str(path),
        f"lies in degrees; project it, as by {warped_by(path.name, metric_near(*transform[:, 2]))}",
    )


def warped_by(name: str, crs: str) -> str:
    """The command that projects a file of this name to a system."""
    if name.lower().endswith(CLOUDS):
        return f"pdal translate {name} OUT.laz reprojection --filters.reprojection.out_srs={crs}"
    return f"gdalwarp -t_srs {crs} {name} OUT.tif"


def _refuse_degrees(path: Path, crs: str, transform: np.ndarray) -> None:
    """Refuse what lies in degrees by its small steps and no system's name."""
    step, (east, north) = np.abs(transform[:, :2]).max(), transform[:, 2]
    if not crs and step < DEGREES and abs(east) <= 180 and abs(north) <= 90:
        raise _in_degrees(path, transform)


def _numbers(path: Path, pixels: np.ndarray, place: GeoRaster, told: dict[int, Any]) -> GeoRaster:
    """The first band of stored numbers (H, W, C) with the meaning that GDAL's tags give them."""
    stored = pixels[..., 0]
    values = np.asarray(stored, dtype=np.float64).copy()
    nothing = re.fullmatch(
        r"(?i)-?\d*\.?\d+(e[+-]?\d+)?", str(told[NO_DATA]).strip("\0 ").replace(",", ".")
    )
    hole = np.isclose(values, float(nothing[0]) if nothing else np.nan, rtol=1e-7, atol=0)
    hole |= np.ma.getmaskarray(stored)
    values[hole | np.isin(values, NOTHING) | ~(np.abs(values) < ENDLESS)] = np.nan
    said = dict(
        re.findall(r'<Item name="(\w+)"(?![^>]*sample="[1-9])[^>]*>([^<]*)<', str(told[METADATA]))
    )
    values = values * float(said.get("SCALE", 1)) + float(said.get("OFFSET", 0))
    return replace(
        place,
        pixels=values,
        unit=unit_named(said.get("UNITTYPE"), place.unit),
        note=f"the first of its {pixels.shape[2]} bands" if pixels.shape[2] > 1 else "",
        shades=stored.dtype.itemsize == 1 and "SCALE" not in said,
    )


def _read_ascii_grid(path: Path) -> GeoRaster:
    """An ESRI ASCII grid: a head of words and numbers, then heights from the north-west."""
    # old Windows programs write -1.#IND
    text = re.sub(r"-?1\.#\w+", "nan", text_of(path)[0].replace(",", ".").lower())
    head = HEAD.match(text)
    if head is None:
        raise SpecError(
            str(path),
            "has no head of ncols, nrows, xllcorner, yllcorner, cellsize; if it holds points, end its name "
            "in .xyz",
        )
    said = {word: float(number) for word, number in re.findall(r"(\w+)\s+(\S+)", head[0])}
    values = np.array(text[head.end() :].split(), dtype=np.float64)
    columns, rows = int(said["ncols"]), int(said["nrows"])
    size = np.array([said.get("dx") or said["cellsize"], said.get("dy") or said["cellsize"]])
    if len(values) != columns * rows or not (size > 0).all():
        raise SpecError(
            str(path),
            f"has {len(values):,} heights, its head says {columns:,} x {rows:,} of {size[0]:g} m; save it "
            "again",
        )
    corner = [
        said[f"{axis}llcenter"] - size[k] / 2
        if f"{axis}llcenter" in said
        else said[f"{axis}llcorner"]
        for k, axis in enumerate("xy")
    ]
    crs, flat, up = _system_beside(path)
    place = _north_up(corner[0], corner[1] + rows * size[1], size)
    _refuse_degrees(path, crs, place)
    return _numbers(
        path,
        values.reshape(rows, columns, 1),
        GeoRaster(values, flat * place, crs, up),
        {METADATA: "", NO_DATA: said.get("nodata_value", -9999.0)},
    )


def _system_beside(path: Path) -> tuple[str, float, float]:
    """The coordinate system of the .prj file beside a grid, and metres of its units on the map and in
    height; metres where there is none."""
    beside = path.with_suffix(".prj")
    crs = beside.read_text("utf-8", errors="replace").strip() if beside.is_file() else ""
    return system_of(path, crs, {})


def _read_points(path: Path) -> GeoRaster:
    """Points of a text of columns: x, y and height as the line above names them, else the first three, in
    metres; where it names classes, those of ground.

    Raises
    ------
    SpecError : the line above names others, or fewer than there are; there are no points.
    """
    text = text_of(path)[0].replace('"', "")
    lines = [line.strip(" ") for line in text.splitlines() if line.strip()]
    first = next((k for k, line in enumerate(lines) if line[0] in "+-.0123456789\t"), len(lines))
    if first == len(lines):
        raise SpecError(str(path), "has no line of numbers; give points x, y, z, one a line")
    rows = lines[first + lines[first].isdigit() :]  # but for how many there are
    plain = re.sub(r"\s*,\s+|\s+,", ",", rows[0]) if rows else ""
    by = next((mark for mark in ";\t" if mark in plain), None if " " in plain else ",")
    wide = len(plain.rstrip(";\t,").split(by))
    head = lines[first - 1].strip("#/% ").split(by) if first else ["x", "y", "z"][:wide]
    both = next(filter(all, pairs_of(path, head)), [])
    up = column_of(path, head, {}, "height", HEIGHTS)
    if not both or up is None or (first and len(head) < wide):
        raise SpecError(
            str(path),
            f"does not name its columns x, y and z, or fewer than its {wide} columns; name each in its first "
            "line",
        )
    if by != ",":
        rows = [line.replace(",", ".") for line in rows]
    found = [*filter(None, both), up]
    known = [
        at for at, name in enumerate(head) if "".join(words_of(name)) in ("classification", "class")
    ]
    points = np.loadtxt(rows, delimiter=by, usecols=[*(at for at, *_ in found), *known], ndmin=2)
    if not first and wide > 3 and (np.diff(points[:, 0]) == 1).all():
        raise SpecError(
            str(path), "counts its rows in its first column; name the columns in its first line"
        )
    if known:
        points = _of_ground(path, points[:, :3], points[:, 3])
    if re.search("lon|lng", head[found[0][0]].lower()):
        raise _in_degrees(path, np.column_stack([np.eye(2), points[0, :2]]))
    crs, *units = _system_beside(path)
    flat, high = (
        said if name else own for (_, said, name), own in zip(found[1:], units, strict=True)
    )
    return _gridded(path, points, crs, flat, high)


def _read_ground(path: Path) -> GeoRaster:
    """Ground points of a LAS as a grid.

    Raises
    ------
    SpecError : none is classed as ground.
    """
    from .las import read_las, units_of

    cloud = read_las(path)
    crs, flat, up = units_of(path, cloud.header)
    ground = _of_ground(path, np.asarray(cloud.xyz), np.asarray(cloud.classification))
    ground = ground[:: len(ground) // MOST_POINTS + 1]
    return _gridded(path, ground / [flat, flat, up], crs, flat, up)


def _of_ground(path: Path, points: np.ndarray, classes: np.ndarray) -> np.ndarray:
    """Points (N, 3) that are classed as ground.

    Raises
    ------
    SpecError : there are none; says which classes there are.
    """
    if not (classes == GROUND_CLASS).any():
        raise SpecError(
            str(path),
            "has no points of class 2, ground, only of "
            f"{', '.join(f'{number:g}' for number in np.unique(classes)[:8])}; classify it first",
        )
    return points[classes == GROUND_CLASS]


def _gridded(path: Path, points: np.ndarray, crs: str, flat: float, up: float) -> GeoRaster:
    """Points (N, 3) as a raster: the grid that they stand on, gaps without height; of scattered points what
    is linear between them, on pixels of one point each, and no farther from them than two. Points at one
    place count as one of their mean height.

    Raises
    ------
    SpecError : they lie on one line.
    """
    points = points[np.isfinite(points).all(axis=1) & ~np.isin(points[:, 2], NOTHING)]
    place, at, many = np.unique(
        points[:, 0] + 1j * points[:, 1], return_inverse=True, return_counts=True
    )
    points = np.column_stack([place.real, place.imag, np.bincount(at, points[:, 2]) / many])
    if len(points) < 3 or np.linalg.cond(np.cov(points[:, :2].T)) > 1e12:
        raise SpecError(
            str(path),
            f"has {len(points):,} points with a height, all on one line; a ground needs an area",
        )
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    steps = [np.diff(np.unique(np.round(points[:, axis], 6))) for axis in (0, 1)]
    size = np.array([step.min() if len(step) else 0.0 for step in steps])
    place = (points[:, :2] - low) / size
    whole = np.rint(place)
    columns, rows = whole.max(axis=0).astype(int) + 1
    if np.abs(place - whole).max() < 0.01 and columns * rows <= 4 * len(points):
        pixels = np.full((rows, columns), np.nan)
        pixels[rows - 1 - whole[:, 1].astype(int), whole[:, 0].astype(int)] = points[:, 2]
        edge, note = _north_up(low[0] - size[0] / 2, high[1] + size[1] / 2, size), ""
    else:
        size = np.repeat(np.sqrt(np.prod(high - low) / len(points)), 2)
        columns, rows = np.ceil((high - low) / size).astype(int)
        edge, note = _north_up(low[0], high[1], size), f"linear between {len(points):,} points"
        y, x = np.mgrid[:rows, :columns] + 0.5
        middle = np.stack([low[0] + x * size[0], high[1] - y * size[1]], axis=-1)
        pixels = linear_between(points[:, :2] - low, points[:, 2], middle - low, 2 * size[0])
    _refuse_degrees(path, crs, edge)
    return GeoRaster(pixels, flat * edge, crs, up, note)


def linear_between(
    known: np.ndarray, values: np.ndarray, at: np.ndarray, reach: float = np.inf
) -> np.ndarray:
    """(...) what is linear between points (N, 2) of values (N,) at places (..., 2); beyond those the value
    of the nearest within reach, else NaN."""
    away, nearest = scipy.spatial.cKDTree(known).query(at)
    between = np.where(away <= reach, values[nearest], np.nan)
    if len(known) > 3:
        linear = scipy.interpolate.LinearNDInterpolator(known, values)(at)
        between = np.where(np.isnan(linear), between, linear)
    return between


def _read_pixels(path: Path, raw: bool) -> tuple[np.ndarray, float]:
    """Pixels (H, W, C) of an image as they are stored, and the number that is white; 1 of floats.

    raw : numbers, not shades or colours of a table.
    """
    with open(path, "rb") as file:
        start = file.read(4)
    own: dict[bytes, Callable[[Path], tuple[np.ndarray, float]]] = {
        PNG: lambda file: read_png(file.read_bytes(), file)
    } | dict.fromkeys(TIFF, partial(_read_tiff, raw=raw))
    readers = [own[start]] if start in own else []
    why = "" if readers else "it is neither PNG nor TIFF"
    if start[:2] != b"MM":  # which Pillow takes for little-endian where it is packed
        readers.append(_read_by_pillow if find_spec("PIL") else _read_by_openimageio)
    for read in readers:
        try:
            return read(path)
        except SpecError:
            raise
        except Exception as problem:  # a damaged image fails anywhere
            why = why or " ".join(str(problem).split()) or type(problem).__name__
    raise SpecError(
        str(path),
        f"cannot be read ({why}); save it as PNG, TIFF or npy, a cloud as LAS"
        + (", or pip install imagecodecs" if "imagecodecs" in why else ""),
    )


def _read_tiff(path: Path, raw: bool) -> tuple[np.ndarray, float]:
    import tifffile

    with tifffile.TiffFile(path) as file:
        page: Any = file.pages[0]
        _refuse_large(page.imagewidth, page.imagelength, path)
        if page.samplesperpixel > MOST_SAMPLES or page.tilewidth * page.tilelength > MOST_PIXELS:
            raise ValueError(f"its head counts {page.samplesperpixel} bands, or tiles too large")
        pixels = page.asarray(maxworkers=1)
        pixels = np.moveaxis(pixels, 0, -1) if page.axes == "SYX" else pixels
        pixels = pixels.reshape(page.imagelength, page.imagewidth, -1)
        if raw:
            return np.ma.array(pixels, mask=_hidden(file, page, pixels)), 1.0
        if pixels.dtype.kind == "f":
            return pixels, 1.0
        if page.photometric == PALETTE:
            table = page.colormap >> 8  # some write 0xff00 for white
            return table.T[pixels[..., 0]], 255.0
        depth = page.bitspersample
        if page.photometric == WHITE_IS_ZERO and pixels.dtype.kind in "bu":
            pixels = (2**depth - 1) - pixels
        return pixels, 2.0**depth - 1 if depth <= 8 else DEEP


def _hidden(file: Any, page: Any, pixels: np.ndarray) -> Any:
    """(H, W, C) bool, which pixels its alpha or a mask beside a page of a TIFF hides."""
    shown = [one for one in file.pages if one.is_mask and one.shape[:2] == page.shape[:2]]
    if shown:
        hidden = shown[0].asarray() == 0
    elif set(page.extrasamples) & ALPHA:
        hidden = pixels[..., -1] == 0
    else:
        return False
    return np.broadcast_to(hidden[..., None], pixels.shape)


def _read_by_pillow(path: Path) -> tuple[np.ndarray, float]:
    from PIL import Image

    with Image.open(path) as image:
        _refuse_large(image.width, image.height, path)
        shown = image.convert("RGB") if image.mode == "P" else image  # of a palette
        mode, pixels = shown.mode, np.asarray(shown)
    if mode not in WHITE:
        raise SpecError(str(path), f"has the colour mode {mode}; save it in shades of grey")
    return pixels.reshape(*pixels.shape[:2], -1), WHITE[mode]


def _read_by_openimageio(path: Path) -> tuple[np.ndarray, float]:
    import OpenImageIO

    file = OpenImageIO.ImageInput.open(str(path))
    if file is None:
        raise ValueError(OpenImageIO.geterror())
    _refuse_large(file.spec().width, file.spec().height, path)
    pixels = file.read_image(OpenImageIO.UNKNOWN)
    return pixels, 1.0 if pixels.dtype.kind == "f" else float(np.iinfo(pixels.dtype).max)


def _refuse_large(wide: int, high: int, path: Path | None = None) -> None:
    """Refuse an image that would take minutes and most of a machine's memory."""
    if wide * high > MOST_PIXELS:
        raise SpecError(
            str(path or "it"),
            f"has {wide:,} x {high:,} pixels, more than {MOST_PIXELS:,}; make it coarser, or cut it",
        )


READERS: dict[str, Callable[[Path], GeoRaster]] = {
    ".asc": _read_ascii_grid,
    ".npy": _read_array,
    **dict.fromkeys(POINTS, _read_points),
    **dict.fromkeys(CLOUDS, _read_ground),
}
