"""Rays at a mesh that changes its shape, each at a time of its own, in float64.

Between two samples of the shape a box holds the triangles of a group at both, so it holds them all the way;
of the groups whose boxes a ray meets, each triangle is met where its corners are at the ray's time.
"""

from __future__ import annotations

import numpy as np

from ...base.trimesh import TriMesh
from .caster import Hits
from .exact import Level, candidates, counting, grouped, meet, put_nearest
from .paths import ShapePath

KEPT = 64  # stretches of time whose boxes are kept


class BentCaster:
    """Closest hits of rays at times of their own at one mesh, in its own frame."""

    def __init__(self, mesh: TriMesh, shape: ShapePath) -> None:
        self._mesh, self._shape = mesh, shape
        self._boxes: dict[int, list[Level]] = {}

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: np.ndarray,
        *,
        time: np.ndarray,
        min_distance: np.ndarray,
        leaving: Hits | None = None,
    ) -> Hits:
        """The closest hits of rays (R, 3), (R, 3) at times (R,), s, within limits (R,); instances are 0."""
        ways = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        known = self._shape.time
        row = np.clip(np.searchsorted(known, time, "right") - 1, 0, max(len(known) - 2, 0))
        hits = Hits.misses(len(origins))
        order = np.argsort(row, kind="stable")
        for mine in np.split(order, np.flatnonzero(np.diff(row[order])) + 1):
            if not len(mine):
                continue
            boxes = len(self._mesh.triangles), self._levels(int(row[mine[0]]))
            far = max_distance[mine]
            pair, triangle = candidates(boxes, origins[mine], ways[mine], far)
            ray = mine[pair]
            corners = self._shape.at(self._mesh.triangles[triangle], time[ray])
            distance = meet(tuple(corners.swapaxes(0, 1)), origins[ray], ways[ray])
            met = Hits(distance, np.zeros(len(ray), np.int64), triangle)
            left = None if leaving is None else leaving.select(ray)
            some = counting(met, min_distance[ray], max_distance[ray], left)
            put_nearest(hits, ray[some], met.select(some))
        return hits

    def meets(
        self, origins: np.ndarray, directions: np.ndarray, triangle: np.ndarray, time: np.ndarray
    ) -> np.ndarray:
        """(R,) metres along rays to triangles at times; inf where one passes its triangle by."""
        ways = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        corners = self._shape.at(self._mesh.triangles[triangle], time)
        return meet(tuple(corners.swapaxes(0, 1)), origins, ways)

    def _levels(self, row: int) -> list[Level]:
        if row not in self._boxes:
            while len(self._boxes) >= KEPT:
                self._boxes.pop(next(iter(self._boxes)))
            ends = self._shape.vertices[row : row + 2].astype(np.float64)
            low, high = ends.min(axis=0), ends.max(axis=0)
            triangles = self._mesh.triangles
            self._boxes[row] = (
                grouped(low[triangles].min(axis=1), high[triangles].max(axis=1))
                if len(triangles)
                else []
            )
        return self._boxes[row]
