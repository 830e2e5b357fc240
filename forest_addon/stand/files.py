"""Files of a stand: rasters, lists of trees, allometries, the terrain.

Paths are relative to the scene file. A file that is named twice is read once.

A list of trees is a table of x and y, and any of species, scale, rotation (radians) and measures. Measures
are dbh, height, crown_width and crown_base, in metres unless the header says another unit, as in ``dbh_cm``
or ``Height (ft)``, and leaf_area in m²; they count where trees are grown to measure. The same columns that
``stand`` and ``run`` write, so what they wrote can be planted again. A cell that is left empty, or says NA,
is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .. import spec
from ..formats.raster_file import read_raster
from ..formats.stl import StlError, read_stl
from ..formats.tree_map import LENGTHS, NUMBERS, read_tree_map
from ..growth.library.species_file import read_allometry
from ..spec import SpecError
from .inputs import Inputs, TreeList
from .intensity.functions import IntensityError
from .intensity.terrain import GroundSurface, Heightmap, Triangulated

MOST = {"dbh": 5.0, "height": 150.0, "crown_width": 100.0, "crown_base": 150.0}  # metres
USUAL = {
    "dbh": (0.02, 1.5),
    "height": (2.0, 65.0),
    "crown_width": (0.5, 40.0),
}  # half the trees of a table
USUAL["crown_base"] = USUAL["height"]


def read_tree_list(path: Path, offset: Sequence[float] = (0.0, 0.0), crs: str = "") -> TreeList:
    """Read trees to plant; ``offset`` (x, y, ...) is taken from their coordinates, metres of ``crs``.

    Raises
    ------
    SpecError : the file is missing or no table with x and y; a cell with what is not a finite number, or a
    scale or measure that is not above 0 or that no tree has.
    """
    trees = read_tree_map(path, crs)
    for key, column in zip(NUMBERS, trees.numbers.T, strict=True):
        low = np.flatnonzero(column <= 0) if key != "rotation" else ()
        if len(low):
            raise SpecError(
                str(path),
                f"row {trees.line[low[0]]}: {key} is {column[low[0]]:g}; give one above 0",
            )
        if key in MOST and np.isfinite(column).any():
            worst, typical = int(np.nanargmax(column)), float(np.nanmedian(column))
            low, high = USUAL[key]
            if column[worst] > MOST[key] or typical > high:
                units = ("cm", "mm", "in") if key == "dbh" else ("ft", "cm", "dm")
                fit = [unit for unit in units if low <= typical * LENGTHS[unit] <= high] or ["cm"]
                raise SpecError(
                    str(path),
                    f"row {trees.line[worst]}: {key} is {column[worst]:g} m, more than trees have (up to "
                    f"{MOST[key]:g} m, half of a stand {high:g} m); a median of {typical:.3g} "
                    f"{' or '.join(fit)} would make sense: say the unit in the header, as {key}_{fit[0]}",
                )
    named, said = trees.species != "", trees.said
    if not named.all() and named.any():
        said += (f"{path.name}: left out {(~named).sum():,} rows without a species",)
    else:
        named[:] = True
    measures = trees.numbers[named, 2:]
    return TreeList(
        position=trees.position[named] - np.array(offset[:2]),
        species=tuple(trees.species[named].tolist()) if trees.species.any() else None,
        scale=trees.numbers[named, 0],
        rotation=trees.numbers[named, 1],
        measures=measures if np.isfinite(measures).any() else None,
        said=said,
    )


def read_inputs(settings: spec.Scene, folder: Path) -> Inputs:
    """Read every file that the stand of a scene names.

    Raises
    ------
    SpecError : a file is missing or cannot be used.
    """
    rasters: dict[str, np.ndarray] = {}
    lists: dict[str, TreeList] = {}
    for planting in settings.plantings:
        for raster in planting.rasters:
            if raster.file not in rasters:
                rasters[raster.file] = read_raster(folder / raster.file)
        if planting.layout == "list" and planting.trees and planting.trees not in lists:
            path = folder / planting.trees
            listed = read_tree_list(path, settings.offset, settings.crs)
            _refuse_far(path, listed, settings)
            lists[planting.trees] = listed
    named = {p.targets.allometry for p in settings.plantings if p.targets} - {""}
    allometries = {name: read_allometry(name, folder) for name in sorted(named)}
    ground = settings.forest.terrain
    terrain = read_terrain(ground, settings.forest, folder) if ground.file else None
    return Inputs(rasters=rasters, lists=lists, terrain=terrain, allometries=allometries)


def _refuse_far(path: Path, listed: TreeList, settings: spec.Scene) -> None:
    """Refuse a list of which no tree stands on the field, and say what would do."""
    low, size = np.array(settings.forest.origin), np.array(settings.forest.size)
    place = listed.position - low
    if not len(place) or ((place >= -1e-6) & (place <= size + 1e-6)).all(axis=1).any():
        return
    first, last = place.min(axis=0), place.max(axis=0)
    there, offset = low + first, np.floor(first) + settings.offset[:2]
    raise SpecError(
        str(path),
        f"has no tree on the field of {size[0]:g} x {size[1]:g} m: they stand from ({there[0]:.8g}, "
        f"{there[1]:.8g}) on, over {last[0] - first[0]:.4g} x {last[1] - first[1]:.4g} m; "
        f"offset = [{offset[0]:.0f}, {offset[1]:.0f}, {settings.offset[2]:g}] would put them there",
    )


def read_terrain(ground: spec.Terrain, forest: spec.Forest, folder: Path) -> GroundSurface:
    """The terrain of a file: a heightmap, or a surface of triangles.

    Raises
    ------
    SpecError : the file is missing or cannot be used.
    """
    path = folder / ground.file
    try:
        if path.suffix.lower() == ".stl":
            corners = read_stl(path)
            return Triangulated(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
        low = np.array(forest.origin if ground.origin is None else ground.origin)
        size = np.array(forest.size if ground.size is None else ground.size)
        heights = ground.base + ground.relief * read_raster(path)
        return Heightmap(heights, low, size, ground.file)
    except FileNotFoundError:
        raise SpecError(str(path), "there is no such file; check the path") from None
    except (StlError, IntensityError) as problem:
        raise SpecError("forest.terrain.file", str(problem)) from None
    except SpecError:
        raise
    except ValueError as problem:
        raise SpecError("forest.terrain.file", str(problem)) from None
