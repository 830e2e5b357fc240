"""Hulls of a mesh: a few boxes around groups of its triangles tell which rays pass by within its box.

A tree fills its box badly: of rays among a thousand trees that come to one's box, six in seven meet
nothing in it. Rays in a mesh's own space go in; out comes whether any of its hulls is met, in float32 with
hulls that are larger by more than float32 can be wrong, so that no hit is lost.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...base.trimesh import TriMesh
from .boxes import WIDER, Box, inverse, morton, slabs

COUNT = 16  # hulls of a mesh


class Hulls:
    """Of unique meshes, made when they are first asked for; triangles that are not finite are in none."""

    def __init__(self, meshes: Sequence[TriMesh]) -> None:
        self._meshes = meshes
        self._low = np.full((3, COUNT, len(meshes)), np.nan, dtype=np.float32)
        self._high = self._low.copy()
        self._made = np.zeros(len(meshes), dtype=bool)

    def take(self, mesh: np.ndarray) -> Box:
        """Smallest and largest coordinates, (3, COUNT, P) each, of the hulls of meshes (P,)."""
        if not self._made.take(mesh).all():
            for number in np.unique(mesh).tolist():
                if not self._made[number]:
                    self._make(number)
        return self._low.take(mesh, 2), self._high.take(mesh, 2)

    def _make(self, number: int) -> None:
        low, high = _around(self._meshes[number])
        slack = 1e-6 * float(max(np.abs(low).max(initial=0.0), np.abs(high).max(initial=0.0)))
        self._low[:, : low.shape[1], number] = low - slack - 1e-6
        self._high[:, : high.shape[1], number] = high + slack + 1e-6
        self._made[number] = True

    @staticmethod
    def met(origin: np.ndarray, way: np.ndarray, hulls: Box) -> np.ndarray:
        """(P,) bool: whether rays (3, P) from near a mesh may meet it."""
        at, slope = origin.astype(np.float32)[:, None], inverse(way).astype(np.float32)[:, None]
        entry, leave = slabs(at, slope, hulls)
        leave *= WIDER
        found: np.ndarray = (entry <= leave).any(axis=0)
        return found


def _around(mesh: TriMesh) -> Box:
    """(3, K), (3, K) boxes around groups of triangles whose first corners lie near each other."""
    triangles = mesh.triangles
    known = np.isfinite(mesh.vertices.sum(axis=1))
    if not known.all():
        triangles = triangles[known[triangles].all(axis=1)]
    if not len(triangles):
        return np.empty((3, 0)), np.empty((3, 0))
    place = morton(np.where(known[:, None], mesh.vertices, 0.0))
    first, second, third = triangles[np.argsort(place[triangles[:, 0]])].T
    cuts = np.unique(np.linspace(0, len(first), COUNT, endpoint=False).astype(np.int64))
    low, high = np.empty((3, len(cuts))), np.empty((3, len(cuts)))
    for axis, x in enumerate(mesh.vertices.T.copy()):
        a, b, c = x[first], x[second], x[third]
        low[axis] = np.minimum.reduceat(np.minimum(np.minimum(a, b), c), cuts)
        high[axis] = np.maximum.reduceat(np.maximum(np.maximum(a, b), c), cuts)
    return low, high
