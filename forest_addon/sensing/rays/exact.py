"""Rays against every triangle near them, in float64: what audits and benchmarks hold the engines against.

Slow and plain: triangles stand in groups of neighbours, a ray is tested against the box of each group of
each instance it may meet, and against each triangle of the groups whose box it meets (Möller & Trumbore
1997). It shares no code with the engines.
"""

from __future__ import annotations

import numpy as np

from .boxes import morton
from .caster import Hits
from .geometry import SceneGeometry

GROUP = 128  # triangles
EDGE = 1e-12  # barycentric slack: a ray at a shared edge meets at least one of its triangles


def cast_exactly(scene: SceneGeometry, origins: np.ndarray, directions: np.ndarray) -> Hits:
    """The closest hits of rays (R, 3), (R, 3), one ray after the other."""
    groups: dict[int, _Groups] = {}  # of meshes that some ray comes to
    low, high = scene.bounds()
    hits = Hits.misses(len(origins))
    ways = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    for ray, (origin, way) in enumerate(zip(origins, ways, strict=True)):
        entry, leave = _slabs(origin, way, low, high)
        met = np.flatnonzero(entry <= leave)
        for instance in met[np.argsort(entry[met])].tolist():
            if entry[instance] > hits.distance[ray]:
                break
            matrix = scene.transform[instance]
            local = np.linalg.solve(
                matrix[:, :3], np.stack([origin - matrix[:, 3], way], axis=1)
            ).T  # the length of the direction stays: distances are those of the world
            index = int(scene.mesh_index[instance])
            if index not in groups:
                mesh = scene.meshes[index]
                groups[index] = _Groups(mesh.vertices[mesh.triangles])
            distance, triangle = groups[index].nearest(*local)
            if distance < hits.distance[ray]:
                hits.put(
                    slice(ray, ray + 1),
                    Hits(np.array([distance]), np.array([instance]), np.array([triangle])),
                )
    return hits


def meet_exactly(
    scene: SceneGeometry, origin: np.ndarray, direction: np.ndarray, instance: int, triangle: int
) -> float:
    """Metres along a ray (3,), (3,) to one triangle of an instance; inf where it passes it by."""
    matrix = scene.transform[instance]
    way = direction / np.linalg.norm(direction)
    local = np.linalg.solve(matrix[:, :3], np.stack([origin - matrix[:, 3], way], axis=1)).T
    mesh = scene.meshes[int(scene.mesh_index[instance])]
    return _Groups(mesh.vertices[mesh.triangles[[triangle]]]).nearest(*local)[0]


class _Groups:
    """The triangles (T, 3, 3) of a mesh in groups of neighbours."""

    def __init__(self, corners: np.ndarray) -> None:
        self._number = np.argsort(morton(corners[:, 0] + corners[:, 1] + corners[:, 2]))
        self._corners = corners[self._number]
        first = 3 * np.arange(0, len(corners), GROUP)
        each = self._corners.reshape(-1, 3)
        self._low = np.minimum.reduceat(each, first) - 1e-9
        self._high = np.maximum.reduceat(each, first) + 1e-9

    def nearest(self, origin: np.ndarray, way: np.ndarray) -> tuple[float, int]:
        """Distance and triangle, inf and -1 for a miss."""
        entry, leave = _slabs(origin, way, self._low, self._high)
        met = np.flatnonzero(entry <= leave)
        rows = (met[:, None] * GROUP + np.arange(GROUP)).ravel()
        rows = rows[rows < len(self._corners)]
        a, b, c = (self._corners[rows, k] for k in range(3))
        u, v, s = b - a, c - a, origin - a
        with np.errstate(all="ignore"):
            p = np.cross(way, v)
            determinant = np.einsum("ti,ti->t", u, p)
            first = np.einsum("ti,ti->t", s, p) / determinant
            q = np.cross(s, u)
            second = q @ way / determinant
            t = np.einsum("ti,ti->t", v, q) / determinant
            inside = (first >= -EDGE) & (second >= -EDGE) & (first + second <= 1 + EDGE)
        t = np.where(inside & (t >= 0), t, np.inf)
        if not len(t) or np.isinf(best := t.min()):
            return np.inf, -1
        return float(best), int(self._number[rows[t.argmin()]])


def _slabs(
    origin: np.ndarray, way: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - origin) / way, (high - origin) / way
    entry = np.fmax.reduce(np.fmin(a, b), axis=1)
    return np.maximum(entry, 0.0), np.fmin.reduce(np.fmax(a, b), axis=1)
