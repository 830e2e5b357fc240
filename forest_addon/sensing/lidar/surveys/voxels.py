"""Voxels that light passes by chance: plant area as a haze, of one density in each cell of a grid.

A ray goes s = -ln U / σ before it meets a plant, in a medium that has σ m² of area in its way a m³. As that
law has no memory, one U a ray and grid, spent on σ times the way in each cell that it crosses, is the law of
HELIOS++, which draws one a voxel (Weiser et al. 2021, Remote Sens. 13, 4).
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import Self

import numpy as np

from ....base.rng import daughter_keys, keyed_uniform
from ...rays.caster import Hits
from ..passage import Contacts
from ..scan import RAYS_AT_ONCE, Scan


@dataclass(frozen=True)
class Haze:
    """A grid of plant area in a scene.

    instance : number of what stands for it in the scene. transform : (3, 4) grid to world, a turn, an even
    scale and a shift. low : (3,) lowest corner of the grid, and size : edge of its cells, in its own metres.
    density : (X, Y, Z) area in the way of light, m² a m³ of the world.
    """

    instance: int
    transform: np.ndarray
    low: np.ndarray
    size: float
    density: np.ndarray

    def reach(
        self, origins: np.ndarray, directions: np.ndarray, depth: np.ndarray, farthest: np.ndarray
    ) -> np.ndarray:
        """(R,) metres at which rays have crossed so much area, ∞ where they do not up to ``farthest``.

        depth : (R,) area that a ray crosses, m² a m². origins, directions : (R, 3). farthest : (R,) metres.
        """
        found = np.full(len(origins), np.inf)
        inward = np.linalg.inv(self.transform[:, :3]) / self.size
        start = (origins - self.transform[:, 3]) @ inward.T - self.low / self.size
        way = directions @ inward.T
        cells = np.array(self.density.shape)
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([(0 - start) / way, (cells - start) / way])
        along = way == 0
        outside = along & ((start < 0) | (start >= cells))
        ends[:, along] = np.array([[-np.inf], [np.inf]])
        enters = np.maximum(ends.min(axis=0).max(axis=1), 0.0)
        leaves = np.minimum(ends.max(axis=0).min(axis=1), farthest)
        rows = np.flatnonzero((enters < leaves) & ~outside.any(axis=1))
        start, way, at, last = start[rows], way[rows], enters[rows], leaves[rows]
        left = depth[rows].copy()
        ahead = way > 0
        cell = np.clip(np.floor(start + at[:, None] * way), 0, cells - 1).astype(np.int64)
        while len(rows):
            with np.errstate(divide="ignore", invalid="ignore"):
                border = (cell + ahead - start) / way
            border[way == 0] = np.inf
            axis = border.argmin(axis=1)
            lines = np.arange(len(rows))
            stop = np.clip(border[lines, axis], at, last)
            density = self.density[cell[:, 0], cell[:, 1], cell[:, 2]]
            crossed = density * (stop - at)
            met = crossed >= left
            found[rows[met]] = at[met] + left[met] / density[met]
            cell[lines, axis] += np.where(ahead[lines, axis], 1, -1)
            inside = ((cell >= 0) & (cell < cells)).all(axis=1)
            on = np.flatnonzero(~met & (stop < last) & inside)
            rows, at, left = rows[on], stop[on], (left - crossed)[on]
            start, way, last, cell, ahead = start[on], way[on], last[on], cell[on], ahead[on]
        return found


class HazyScan(Scan):
    """A scan of a scene in which light passes voxels by chance."""

    _hazes: tuple[Haze, ...] = ()

    def among(self, hazes: tuple[Haze, ...]) -> Self:
        """The same scan with voxels that light passes by chance."""
        if not hazes:
            return self
        other = copy(self)
        other._hazes, other._faces, other._sure = hazes, None, False
        other.at_once = max(1, RAYS_AT_ONCE // self.scanner.beam.subrays)
        return other

    def _met(
        self, rays: tuple[np.ndarray, np.ndarray], keys: np.ndarray, at: np.ndarray | None
    ) -> Contacts:
        found = super()._met(rays, keys, at)
        for number, haze in enumerate(self._hazes):
            nearest = np.full(len(keys), self.scanner.max_range)
            np.minimum.at(nearest, found.ray, found.hits.distance)
            chance = keyed_uniform(daughter_keys(keys, number), "voxels")
            distance = haze.reach(*rays, -np.log(chance), nearest)
            met = np.flatnonzero(np.isfinite(distance))
            kept = found.select(np.flatnonzero(found.hits.distance <= distance[found.ray]))
            first = np.zeros(len(met), dtype=np.int64)
            hits = Hits(distance[met], np.full(len(met), haze.instance), first)
            organ = self.caster.scene.meshes[haze.instance].part[first]
            found = Contacts.joined([kept, Contacts(met, hits, organ, np.ones(len(met)))])
            found = found.select(np.lexsort((found.hits.distance, found.ray)))
        return found

    def _normals(self, hits: Hits, ways: np.ndarray, time: np.ndarray) -> np.ndarray:
        normal = super()._normals(hits, ways, time)
        hazy = np.isin(hits.instance, [haze.instance for haze in self._hazes])
        return np.where(hazy[:, None], -ways, normal) if hazy.any() else normal
