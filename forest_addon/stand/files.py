"""Files of a stand: rasters, lists of trees, allometries, the terrain.

Paths are relative to the scene file. A file that is named twice is read once.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .. import spec
from ..formats.raster_file import read_raster
from ..formats.stl import StlError, read_stl
from ..growth.library.species_file import read_allometry
from ..spec import SpecError
from .inputs import Inputs, TreeList
from .intensity.functions import IntensityError
from .intensity.terrain import GroundSurface, Heightmap, Triangulated
from .tree_list import read_tree_list


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
