"""Inputs of a stand besides its settings: rasters, painted meshes, lists of trees and the ground.

All are plain arrays, so files (``stand.files``) and objects of a Blender scene can fill them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..formats.raster_file import GeoRaster
from ..spec import Allometry, Forest, Raster, Terrain
from .intensity.functions import Painted
from .intensity.surface import Flat, GroundSurface


@dataclass(frozen=True)
class TreeList:
    """Trees that somebody has placed; what is None is drawn.

    position : (N, 2) metres, or (N, 3) where heights are given and count in place of the terrain's.
    species : (N,) names of plantings. scale : (N,), NaN where it is drawn.
    rotation : (N,) radians, NaN where it is drawn.
    measures : (N, 5) dbh, height, crown width, crown base and leaf area, NaN where they are drawn.
    said : sentences about how a file was read.
    """

    position: np.ndarray
    species: tuple[str, ...] | None = None
    scale: np.ndarray | None = None
    rotation: np.ndarray | None = None
    measures: np.ndarray | None = None
    said: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.position)


@dataclass(frozen=True)
class Inputs:
    """Everything by the name that the settings use.

    rasters : by ``Raster.file``, the first row the north edge; those that say where they lie in the scene's
    own metres.
    painted : by ``Planting.painted``. lists : by ``Planting.trees`` or ``Planting.collection``.
    terrain : the ground; None: flat at ``GroundSurface.base``. allometries : by ``Targets.allometry``.
    """

    rasters: Mapping[str, GeoRaster] = field(default_factory=dict)
    painted: Mapping[str, Painted] = field(default_factory=dict)
    lists: Mapping[str, TreeList] = field(default_factory=dict)
    terrain: GroundSurface | None = None
    allometries: Mapping[str, Allometry] = field(default_factory=dict)
    told: tuple[str, ...] = ()

    def ground(self, base: float) -> GroundSurface:
        """The ground, flat where no other is given."""
        return Flat(base) if self.terrain is None else self.terrain


def on_field(
    raster: GeoRaster, given: Raster | Terrain, forest: Forest
) -> tuple[np.ndarray, np.ndarray]:
    """Lowest corner (2,) and extent (2,) of a raster, metres in the scene: as given, else as its file says,
    of an image as the field."""
    low, size = np.array(forest.origin), np.array(forest.size)
    if raster.transform is not None:
        low, high = raster.extent
        size = high - low
    if given.origin is not None:
        low = np.array(given.origin)
    return low, size if given.size is None else np.array(given.size)
