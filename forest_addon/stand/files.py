"""Files of a stand: rasters, lists of trees, allometries, the terrain.

Paths are relative to the scene file. A file that is named twice is read once.

A list of trees is a CSV of x and y, and any of species, scale, rotation (radians) and measures. Measures
are dbh, height, crown_width and crown_base, in metres unless the header says another unit, as in ``dbh_cm``
or ``Height (ft)``, and leaf_area in m²; they count where trees are grown to measure. The same columns that
``stand`` and ``run`` write, so what they wrote can be planted again. A cell that is left empty, or says NA,
is drawn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .. import spec
from ..formats.foreign import guarded
from ..formats.raster_file import read_raster
from ..formats.stl import StlError, read_stl
from ..formats.tree_map import read_rows
from ..growth.library.species_file import read_allometry
from ..spec import SpecError
from .inputs import Inputs, TreeList
from .intensity.functions import IntensityError
from .intensity.terrain import GroundSurface, Heightmap, Triangulated

MEASURES = ("dbh", "height", "crown_width", "crown_base", "leaf_area")
NUMBERS = ("scale", "rotation", *MEASURES)
MOST = {"dbh": 5.0, "height": 150.0, "crown_width": 100.0, "crown_base": 150.0}  # metres


@guarded("a CSV file with columns x and y")
def read_tree_list(path: Path, offset: Sequence[float] = (0.0, 0.0)) -> TreeList:
    """Read trees to plant; ``offset`` (x, y, ...) is taken from their coordinates.

    Raises
    ------
    SpecError : the file is missing or no CSV with x and y; a cell with what is not a finite number, or a
    scale or measure that is not above 0 or that no tree has.
    """
    rows = read_rows(path, ("species",), NUMBERS)
    position = np.array([[x, y] for _, x, y, *_ in rows], dtype=np.float64).reshape(-1, 2)
    numbers = np.array([found for *_, found in rows], dtype=np.float64).reshape(-1, len(NUMBERS))
    for (line, *_), found in zip(rows, numbers.tolist(), strict=True):
        for key, number in zip(NUMBERS, found, strict=True):
            if key != "rotation" and number <= 0:
                raise SpecError(str(path), f"row {line}: {key} is {number:g}; give one above 0")
            if number > MOST.get(key, math.inf):
                raise SpecError(
                    str(path),
                    f"row {line}: {key} is {number:g} m, more than trees have ({MOST[key]:g} m); give "
                    f"metres, or say the unit in the header, as {key}_cm or {key}_ft",
                )
    species = tuple(name for *_, (name,), _ in rows)
    measures = numbers[:, 2:]
    return TreeList(
        position=position - np.array(offset[:2]),
        species=species if any(species) else None,
        scale=numbers[:, 0],
        rotation=numbers[:, 1],
        measures=measures if np.isfinite(measures).any() else None,
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
            lists[planting.trees] = read_tree_list(folder / planting.trees, settings.offset)
    named = {p.targets.allometry for p in settings.plantings if p.targets} - {""}
    allometries = {name: read_allometry(name, folder) for name in sorted(named)}
    ground = settings.forest.terrain
    terrain = read_terrain(ground, settings.forest, folder) if ground.file else None
    return Inputs(rasters=rasters, lists=lists, terrain=terrain, allometries=allometries)


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
