"""Inputs of a stand besides its settings: rasters, painted meshes, lists of trees and the ground.

All are plain arrays, so files (``formats.stand_files``) and objects of a Blender scene can fill them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..spec import Allometry
from .intensity.terrain import Flat, GroundSurface


@dataclass(frozen=True)
class Painted:
    """Weights on a mesh, in world coordinates.

    vertices : (V, 3) metres. triangles : (T, 3). weight : (V,), 0 or larger.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    weight: np.ndarray


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

    rasters : pixels (rows, columns) float64 of ``Raster.file``, the first row the north edge; an image's
    black is 0 and its white 1, an array's numbers count as they are.
    painted : by ``Planting.painted``. lists : by ``Planting.trees`` or ``Planting.collection``.
    terrain : the ground; None: flat at ``GroundSurface.base``. allometries : by ``Targets.allometry``.
    """

    rasters: Mapping[str, np.ndarray] = field(default_factory=dict)
    painted: Mapping[str, Painted] = field(default_factory=dict)
    lists: Mapping[str, TreeList] = field(default_factory=dict)
    terrain: GroundSurface | None = None
    allometries: Mapping[str, Allometry] = field(default_factory=dict)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about how lists of trees were read."""
        return tuple(said for listed in self.lists.values() for said in listed.said)

    def ground(self, base: float) -> GroundSurface:
        """The ground, flat where no other is given."""
        return Flat(base) if self.terrain is None else self.terrain
