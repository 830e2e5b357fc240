"""What stands in the way of an echo: wood as a hard edge, leaves as a haze.

``behind_wood`` asks one ray a scatterer whether trunks, branches or ground stand before it.

``Extinction`` is Beer-Lambert through the leaf area on the way. At a few metres the Fresnel width √(λr)
exceeds a leaf, so that a leaf casts no shadow of its own; what counts is how many leaves a bundle of rays
meets. The directions around the sonar are cut into cells ``CELL`` wide; through each go ``RAYS`` rays,
from leaf to leaf, and the mean number of leaves they met before a distance is the optical depth τ
there (a point quadrat, Warren Wilson 1960: it takes the projected area of the leaves as they are turned,
G·u integrated over the way). Each way weakens the intensity by e^{-τ}, both ways the pressure by e^{-τ}.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...growth.mesh.trimesh import LEAF
from ..rays.caster import RayCaster
from .scatterers import Scatterers
from .search import Found
from .station import Paths, Station

CELL = math.radians(4.0)
SIDE = 4  # rays along each side of a cell
RAYS = SIDE * SIDE
STEP = 1e-4  # m beyond a leaf from where a ray goes on
MOST_LEAVES = 64  # on one ray; nothing is heard behind
ROUND = 0.5  # radii of a leaf before its centre that do not shade it: itself


def behind_wood(wood: RayCaster, point: np.ndarray) -> Callable[[Scatterers, Paths], np.ndarray]:
    """Whether wood hides scatterers from a point (3,)."""

    def hidden(scatterers: Scatterers, paths: Paths) -> np.ndarray:
        origins = np.broadcast_to(point, paths.direction.shape)
        reach = np.maximum(paths.distance - scatterers.clear, 0.0)
        return np.asarray(wood.occluded(origins, paths.direction, reach))

    return hidden


class Extinction:
    """The optical depth of leaves around a sonar; cells are looked into when something is heard there."""

    def __init__(self, rays: RayCaster, station: Station) -> None:
        self._rays, self._station = rays, station

    def shade(self, found: Found) -> Found:
        """The same with ``shade`` times e^{-τ}."""
        groups = []
        for group in found.groups:
            depth = self.depth(group.paths.emitted, group.paths.distance, group.scatterers.clear)
            groups.append(replace(group, shade=group.shade * np.exp(-depth)))
        return Found(groups, found.bound, found.counts)

    def depth(self, offset: np.ndarray, distance: np.ndarray, clear: np.ndarray) -> np.ndarray:
        """(M,) τ up to places at offsets (2, M) off the axis, ``clear`` metres before ``distance``."""
        cell = np.floor(offset.T / CELL).astype(np.int64)  # (M, 2)
        cells, of_place = np.unique(cell, axis=0, return_inverse=True)
        of_place = of_place.ravel()
        farthest = np.zeros(len(cells))
        np.maximum.at(farthest, of_place, distance)
        met_cell, met = self._leaves(cells, farthest)
        # Ordered by cell and distance, a place's rank among the leaves of its cell is what is before it.
        order = np.lexsort((met, met_cell))
        met_cell, met = met_cell[order], met[order]
        scale = 2.0 * (1.0 + float(distance.max(initial=0.0)))
        before = np.searchsorted(met_cell * scale + met, of_place * scale + distance - clear)
        first = np.searchsorted(met_cell, of_place)
        depth: np.ndarray = np.maximum(before - first, 0) / RAYS
        return depth

    def _leaves(self, cells: np.ndarray, farthest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Cell (H,) and distance (H,) of every leaf that the rays of the cells meet."""
        inner = (np.arange(SIDE) + 0.5) / SIDE
        grid = np.stack(np.meshgrid(inner, inner, indexing="ij"), axis=-1).reshape(-1, 2)
        offset = (cells[:, None] + grid).reshape(-1, 2) * CELL
        ray_cell = np.repeat(np.arange(len(cells)), RAYS)
        angle = np.hypot(*offset.T)
        side = offset * np.sinc(angle / math.pi)[:, None]
        forward, left, up = self._station.pose.frame
        way = (
            np.outer(np.cos(angle), forward) + np.outer(side[:, 0], left) + np.outer(side[:, 1], up)
        )

        travelled = np.zeros(len(way))
        alive = np.flatnonzero(angle < math.pi)
        cell_of, distance_of = [], []
        scene = self._rays.scene
        leaf_of = [mesh.part == LEAF for mesh in scene.meshes]
        for _ in range(MOST_LEAVES):
            if not len(alive):
                break
            origin = self._station.point + travelled[alive, None] * way[alive]
            hits = self._rays.cast(origin, way[alive], farthest[ray_cell[alive]] - travelled[alive])
            alive, hit = alive[hits.found], np.flatnonzero(hits.found)
            travelled[alive] += hits.distance[hit] + STEP
            mesh, triangle = scene.mesh_index[hits.instance[hit]], hits.triangle[hit]
            leaf = np.zeros(len(alive), dtype=bool)
            for index in np.unique(mesh):
                rows = mesh == index
                leaf[rows] = leaf_of[index][triangle[rows]]
            cell_of.append(ray_cell[alive[leaf]])
            distance_of.append(travelled[alive[leaf]] - STEP)
            alive = alive[travelled[alive] < farthest[ray_cell[alive]]]
        return np.concatenate(cell_of or [np.empty(0, np.int64)]), np.concatenate(
            distance_of or [np.empty(0)]
        )
