"""Files of a stand: rasters, lists of trees, allometries, the terrain.

Paths are relative to the scene file. A file that is named twice is read once.

A list of trees is a table of x and y, and any of species, scale, rotation (radians) and measures. Measures
are dbh, height, crown_width and crown_base, in metres unless the header says another unit, as in ``dbh_cm``
or ``Height (ft)``, and leaf_area in m²; they count where trees are grown to measure. The same columns that
``stand`` and ``run`` write, so what they wrote can be planted again. A cell that is left empty, or says NA,
is drawn.

A raster that says where it lies is put there, less the scene's offset: it is never stretched, it has to hold
the whole field, and what is beyond the field's margin is cut away.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from operator import attrgetter
from pathlib import Path

import numpy as np
import scipy

from .. import spec
from ..formats.crs import refuse_far, same_place, short, wkt_of
from ..formats.foreign import guarded
from ..formats.helios.parts import read_obj
from ..formats.ply import read_surface
from ..formats.raster_file import HIGHEST, GeoRaster, linear_between, read_raster, warped_by
from ..formats.stl import read_stl
from ..formats.table import LENGTHS
from ..formats.tree_map import NUMBERS, TreeMap, read_tree_map
from ..growth.library import read_allometry
from ..growth.measured.allometry import BREAST
from ..spec.base import SpecError, stands_for
from ..spec.forest import METRES
from .compose import Inputs, TreeList, on_field
from .intensity.surface import GroundSurface, Heightmap, IntensityError, Triangulated, refuse_pixels
from .plan import labels

MOST = {"dbh": 5.0, "height": 150.0, "crown_width": 100.0, "crown_base": 150.0}  # metres
USUAL = {
    "dbh": (0.02, 1.5),
    "height": (2.0, 65.0),
    "crown_width": (0.5, 40.0),
}  # half the trees of a table
USUAL["crown_base"] = USUAL["height"]
LEAST = {"dbh": 0.005, "height": 0.05, "crown_width": 0.03}  # metres, of half the trees of a table


# Of stems so thick, and of trees so tall, in metres: how many times they are as tall as thick in no stand,
# in the median.
THIN, SLENDER = 0.1, 140.0
TALL, SLENDEREST = 5.0, 300.0
MOST_SCALE = 20.0  # beyond, a scale was per cent


class ElsewhereError(SpecError):
    """A file that lies beside the field; ``offset`` (x, y, z) would put the field on it, None: none does."""

    def __init__(self, key: str, problem: str, offset: tuple[float, float, float] | None) -> None:
        super().__init__(key, problem)
        self.offset = offset


def read_tree_list(
    path: Path,
    offset: Sequence[float] = (0.0, 0.0),
    crs: str = "",
    planted: Sequence[str] = (),
) -> TreeList:
    """Read trees to plant; ``offset`` (x, y, ...) is taken from their coordinates, metres of ``crs``.

    planted : names that words and codes of the table may stand for.

    Raises
    ------
    SpecError : the file is missing or no table with x and y; a cell with what is not a finite number, or a
    scale or measure that is not above 0 or that no tree has.
    """
    trees = read_tree_map(path, crs)
    refuse_sizes(path, trees)
    named, said = trees.species != "", trees.said
    if not named.all() and named.any():
        said += (f"{path.name}: left out {(~named).sum():,} rows without a species",)
    else:
        named[:] = True
    kinds = {name: stands_for(name, planted) for name in dict.fromkeys(trees.species.tolist())}
    taken = (f'"{name}" is planted as {kind}' for name, kind in kinds.items() if name != kind)
    measures = trees.numbers[named, 2:]
    return TreeList(
        position=trees.position[named] - np.array(offset[:2]),
        species=tuple(kinds[name] for name in trees.species[named].tolist())
        if (trees.species != "").any()
        else None,
        scale=trees.numbers[named, 0],
        rotation=trees.numbers[named, 1],
        measures=measures if np.isfinite(measures).any() else None,
        said=(*said, *(f"{path.name}: {words}" for words in taken)),
    )


def refuse_sizes(path: Path, trees: TreeMap) -> None:
    """Refuse measures of a table's trees that no tree has.

    Raises
    ------
    SpecError : one is not above 0 or too large, or half are too small; says which unit would make sense.
    """
    for key, column in zip(NUMBERS, trees.numbers.T, strict=True):
        bad = np.flatnonzero(column <= 0)
        if len(bad) and key != "rotation":
            raise SpecError(
                str(path),
                f"row {trees.line[bad[0]]}: {key} is {column[bad[0]]:g}; give one above 0, or leave the "
                "cell empty",
            )
        if key in MOST and np.isfinite(column).any():
            worst, typical = int(np.nanargmax(column)), float(np.nanmedian(column))
            low, high = USUAL[key]
            if column[worst] > MOST[key] or typical > high:
                units = ("cm", "mm", "in") if key == "dbh" else ("ft", "cm", "dm")
                fit = [unit for unit in units if low <= typical * LENGTHS[unit] <= high] or ["cm"]
                row, size, most = trees.line[worst], column[worst], MOST[key]
                why = f"row {row}: {key} is {size:g} m, more than trees have ({most:g} m)"
                if size <= most:
                    why = f"half of the trees have a {key} above {typical:.3g} m, and no stand {high:g} m"
                raise SpecError(
                    str(path),
                    f"{why}; a median of {typical:.3g} "
                    f"{' or '.join(fit)} would make sense: say the unit in the header, as {key}_{fit[0]}",
                )
            if typical < LEAST.get(key, 0):
                raise SpecError(
                    str(path),
                    f"half of the trees have a {key} of {1000 * typical:.3g} mm or less; write numbers "
                    "without marks of thousands, and the right unit in the header",
                )
    for row in np.flatnonzero(
        trees.numbers[:, NUMBERS.index("crown_base")] >= trees.numbers[:, NUMBERS.index("height")]
    ):
        raise SpecError(
            str(path),
            f"row {trees.line[row]}: the crown begins above the top of the tree; correct crown_base or "
            "height",
        )
    for row in np.flatnonzero(trees.numbers[:, 0] > MOST_SCALE):
        raise SpecError(
            str(path),
            f"row {trees.line[row]}: scale is {trees.numbers[row, 0]:g} times; call the column scale_% if it "
            "is per cent",
        )
    for row in np.flatnonzero(trees.numbers[:, 3] <= np.where(trees.numbers[:, 2] > 0, BREAST, 0)):
        raise SpecError(
            str(path),
            f"row {trees.line[row]}: a tree of {trees.numbers[row, 3]:g} m has no DBH, as it ends below "
            f"{BREAST:g} m; leave out stumps, or correct dbh or height",
        )
    dbh, height = trees.numbers[np.isfinite(trees.numbers[:, 2:4]).all(axis=1), 2:4].T
    for rows, most in ((dbh >= THIN, SLENDER), (height >= TALL, SLENDEREST)):
        slender = float(np.median((height / dbh)[rows])) if rows.any() else 0.0
        if slender > most:
            raise SpecError(
                str(path),
                f"half of the trees are {slender:.0f} times as tall as thick, and no stand is {most:g} "
                "times; say the right units in the header, as height_ft or dbh_cm",
            )


def read_inputs(settings: spec.Scene, folder: Path) -> Inputs:
    """Read every file that the stand of a scene names.

    Raises
    ------
    SpecError : a file is missing or cannot be used.
    """
    wkt_of(settings.crs)  # now, before hours are spent on what cannot be written
    rasters: dict[str, GeoRaster] = {}
    lists: dict[str, TreeList] = {}
    told = []
    planted = [*labels(settings.plantings), *(planting.species for planting in settings.plantings)]
    for number, planting in enumerate(settings.plantings):
        for raster in planting.rasters:
            if raster.file not in rasters:
                key = f"plantings[{number}].rasters"
                placed = _read_placed(raster, settings, folder, key)
                rasters[raster.file] = placed
                told.append(
                    _told(raster.file, placed, placed.pixels, "amounts", "no tree stands there")
                )
        if planting.layout == "list" and planting.trees and planting.trees not in lists:
            path = folder / planting.trees
            listed = read_tree_list(path, settings.offset, settings.crs, planted)
            if len(listed):
                _refuse_treeless(f"plantings[{number}].trees", planting.trees, listed, settings)
            lists[planting.trees] = listed
            told += listed.said
    named = {p.targets.allometry for p in settings.plantings if p.targets} - {""}
    allometries = {name: read_allometry(name, folder) for name in sorted(named)}
    terrain = None
    if settings.forest.terrain.file:
        terrain, said = read_terrain(settings, folder)
        told.append(said)
    return Inputs(
        rasters=rasters, lists=lists, terrain=terrain, allometries=allometries, told=tuple(told)
    )


def _refuse_treeless(key: str, file: str, listed: TreeList, scene: spec.Scene) -> None:
    """Refuse a list of which no tree stands on the field."""
    place = listed.position
    extent = place.min(axis=0), place.max(axis=0)
    nearest = place[np.argmin(np.linalg.norm(place - np.mean(extent, axis=0), axis=1))]

    def holds(corners: np.ndarray) -> np.ndarray:
        return ((place >= corners[0] - 1e-6) & (place <= corners[2] + 1e-6)).all(axis=1).any()

    _refuse_elsewhere(key, file, scene, extent, holds, (nearest,))


def read_terrain(scene: spec.Scene, folder: Path) -> tuple[GroundSurface, str]:
    """The terrain of a scene's file, a heightmap or a surface of triangles, and what it was read as.

    Raises
    ------
    SpecError : the file is missing or cannot be used.
    """
    ground, forest, key = scene.forest.terrain, scene.forest, "forest.terrain.file"
    path = folder / ground.file
    try:
        if path.suffix.lower() in SURFACES:
            vertices, triangles = SURFACES[path.suffix.lower()](path)
            vertices, said = _on_map_or_not(vertices, scene, ground.file)
            return Triangulated(vertices, triangles), said
        raster = _read_placed(ground, scene, folder, key)
        low, size = on_field(raster, ground, forest)
        pixels = raster.pixels
        refuse_pixels(
            np.isnan(pixels) if raster.transform is None else np.isinf(pixels),
            pixels,
            low,
            size,
            ground.file,
            "a height",
        )
        if raster.transform is None:
            unit = METRES.get(ground.unit, 1.0)
            said = f", times relief = {ground.relief:g} m" if ground.relief != 1 else ""
            said = _told(ground.file, raster, pixels, "heights", "") + said
            return Heightmap(
                ground.base + ground.relief * unit * pixels, low, size, ground.file
            ), said
        metres = raster.heights(path, METRES.get(ground.unit))
        within, _, _ = _cut(metres, low, size, forest, 0.0)
        metres, low, size = _cut(metres, low, size, forest, forest.margin)
        said = _told(ground.file, raster, within, "heights in m", "there is no ground there")
        if ground.fill_holes and np.isnan(metres).any():
            hole = np.isnan(metres)
            beside = np.argwhere(scipy.ndimage.binary_dilation(hole, np.ones((3, 3))) & ~hole)
            metres, said = metres.copy(), f"{said}; filled from their neighbours"
            metres[hole] = linear_between(beside, metres[tuple(beside.T)], np.argwhere(hole))
        heights = ground.base + ground.relief * metres - scene.offset[2]
        return Heightmap(heights, low, size, ground.file), said
    except IntensityError as problem:
        raise SpecError(key, str(problem)) from None


def _read_placed(
    given: spec.Raster | spec.Terrain, scene: spec.Scene, folder: Path, key: str
) -> GeoRaster:
    """A raster in the scene's own metres, its first row in the north.

    Raises
    ------
    SpecError : its file cannot be used, lies in another coordinate system, or does not hold the field.
    """
    raster = read_raster(folder / given.file)
    if raster.transform is None:
        return raster
    if not same_place(raster.crs, scene.crs, np.mean(raster.extent, axis=0)):
        raise SpecError(
            key,
            f"{given.file} lies in {short(raster.crs)}, the scene in {scene.crs}; warp it there, as by "
            + warped_by(Path(given.file).name, scene.crs),
        )
    if scene.crs and not raster.crs:
        taken = f", taken to lie in {scene.crs}, as it names no system"
        raster = replace(raster, note=(raster.note + taken).lstrip(", "))
    raster = replace(raster, transform=raster.transform - np.outer(scene.offset[:2], [0, 0, 1]))
    if given.origin is None and given.size is None:
        _refuse_elsewhere(key, given.file, scene, raster.extent, raster.holds)
    return raster.upright()


def _refuse_elsewhere(
    key: str,
    file: str,
    scene: spec.Scene,
    extent: tuple[np.ndarray, np.ndarray],
    holds: Callable[[np.ndarray], np.ndarray],
    about: Sequence[np.ndarray] = (),
) -> None:
    """Refuse a file that lies beside the field.

    extent : lowest and highest x and y of the file in the scene, metres. holds : whether the file is on
    a field of these corners (4, 2), the lowest first. about : places (2,) that the field may be put
    around, after the middle of the extent.

    Raises
    ------
    ElsewhereError : says which offset would do.
    """
    low, size = np.array(scene.forest.origin), np.array(scene.forest.size)
    offset, corners = np.array(scene.offset[:2]), low + size * [[0, 0], [1, 0], [1, 1], [0, 1]]
    if np.all(holds(corners)):
        return
    refuse_far(
        scene.crs,
        np.mean(extent, axis=0, keepdims=True) + offset,
        what=f"{file}: coordinates",
    )
    shifts = [middle - size / 2 - low for middle in (np.mean(extent, axis=0), *about)]
    tried = [one for shift in shifts for one in (np.round(shift + offset) - offset, shift)]
    good = next((offset + one for one in tried if np.all(holds(corners + one))), None)
    todo, fitting = "make the field smaller, or take a larger file", None
    if good is not None:
        fitting = (float(good[0]), float(good[1]), scene.offset[2])
        x, y, z = fitting
        todo = f"offset = [{x:.10g}, {y:.10g}, {z:g}] at the top of the scene would put the field on it"
    there, here = (
        " and ".join(
            f"{a} {first:.10g} to {last:.10g}" for a, first, last in zip("xy", *ends, strict=True)
        )
        for ends in (np.add(extent, offset), np.add([low, low + size], offset))
    )
    raise ElsewhereError(
        key,
        f"{file} reaches over {there} m, and the field with its offset over {here}: {todo}",
        fitting,
    )


def _cut(
    pixels: np.ndarray, low: np.ndarray, size: np.ndarray, forest: spec.Forest, margin: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The pixels that touch the field and a margin, their lowest corner and extent."""
    count = np.array(pixels.shape[::-1])
    step = size / count
    field = np.array(forest.origin)
    first = np.floor((field - margin - low) / step + 1e-6)
    last = np.ceil((field + np.array(forest.size) + margin - low) / step - 1e-6)
    (a, b), (c, d) = np.clip([first, last], 0, count).astype(int)
    rows = slice(count[1] - d, count[1] - b)
    return pixels[rows, a:c], low + np.array([a, b]) * step, np.array([c - a, d - b]) * step


def _on_map_or_not(vertices: np.ndarray, scene: spec.Scene, file: str) -> tuple[np.ndarray, str]:
    """Corners (V, 3) of a surface in the scene, and what they were read as: the scene's own metres if they
    lie about the middle of the field, else the map's, less the scene's offset."""
    middle = np.array(scene.forest.origin) + np.array(scene.forest.size) / 2
    if np.abs(vertices[:, 2]).max() > HIGHEST:
        raise SpecError(
            "forest.terrain.file",
            f"{file} has heights of {vertices[:, 2].min():,.7g} to {vertices[:, 2].max():,.7g} m; export it "
            "in metres, with z up",
        )
    for shift, words in (((0, 0, 0), "the scene's own"), (scene.offset, "map")):
        low, high = (vertices - shift).min(axis=0)[:2], (vertices - shift).max(axis=0)[:2]
        if ((low <= middle) & (high >= middle)).all():
            return vertices - shift, f"{file} is a surface, read at {words} coordinates in metres"
    _refuse_elsewhere(
        "forest.terrain.file",
        f"{file} (read with z up)",
        scene,
        (low, high),
        lambda place: ((place >= low) & (place <= high)).all(axis=1),
    )
    return vertices, file


def _told(file: str, raster: GeoRaster, pixels: np.ndarray, what: str, nothing: str) -> str:
    """A sentence on what a raster was read as."""
    low, high = np.nanmin(pixels, initial=np.inf), np.nanmax(pixels, initial=-np.inf)
    if raster.transform is None:
        return f"{file} is an image or array without a place: {what} of {low:g} to {high:g} over its extent"
    rows, columns = pixels.shape
    step = np.abs(raster.transform[:, :2].diagonal())
    system = f" in {short(raster.crs)}" if raster.crs else ""
    holes = int(np.isnan(pixels).sum())
    return (
        f"{file} lies on the map{system}: {what} of {low:,.7g} to {high:,.7g}, "
        f"{columns:,} x {rows:,} pixels of {step[0]:.4g} x {step[1]:.4g} m on the field"
        + (f", {raster.note}" if raster.note else "")
        + (f"; {holes:,} pixels have none (NoData), and {nothing}" if holes else "")
    )


@guarded("a surface of triangles")
def _triangles_of_stl(path: Path) -> tuple[np.ndarray, np.ndarray]:
    corners = read_stl(path)
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


SURFACES = {
    ".stl": _triangles_of_stl,
    ".obj": lambda path: attrgetter("vertices", "triangles")(read_obj(path)),
    ".ply": read_surface,
}
