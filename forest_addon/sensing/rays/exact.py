"""Rays against every triangle near them, in float64: what audits and benchmarks hold the engines against.

Slow and plain: triangles stand in groups of those that follow each other in their mesh, most often
neighbours; a ray is tested against the box of each group of each instance it may meet, and against each
triangle of the groups whose box it meets (Möller & Trumbore 1997). It shares no code with the engines.
"""

from __future__ import annotations

import numpy as np

from ...base.trimesh import TriMesh
from .caster import Hits
from .geometry import SceneGeometry

GROUP = 128  # triangles
EDGE = 1e-12  # barycentric slack: a ray at a shared edge meets at least one of its triangles


def cast_exactly(scene: SceneGeometry, origins: np.ndarray, directions: np.ndarray) -> Hits:
    """The closest hits of rays (R, 3), (R, 3), one ray after the other."""
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
            mesh = scene.meshes[int(scene.mesh_index[instance])]
            distance, triangle = _nearest(mesh, *local)
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
    return _meet(mesh, np.array([triangle]), *local)[0]


def _nearest(mesh: TriMesh, origin: np.ndarray, way: np.ndarray) -> tuple[float, int]:
    """Distance and triangle, inf and -1 for a miss."""
    entry, leave = _slabs(origin, way, *_boxes(mesh))
    met = np.flatnonzero(entry <= leave)
    rows = (met[:, None] * GROUP + np.arange(GROUP)).ravel()
    return _meet(mesh, rows[rows < len(mesh.triangles)], origin, way)


def _boxes(mesh: TriMesh) -> tuple[np.ndarray, np.ndarray]:
    """(G, 3), (G, 3) around groups of triangles; kept with the mesh, which many scenes may share."""
    kept: tuple[np.ndarray, np.ndarray] | None = vars(mesh).get("_groups")
    if kept is None:
        first = np.arange(0, len(mesh.triangles), GROUP)
        corners = [mesh.vertices[mesh.triangles[:, k]] for k in range(3)]
        least = np.minimum(np.minimum(corners[0], corners[1]), corners[2])
        most = np.maximum(np.maximum(corners[0], corners[1]), corners[2])
        if not len(first):
            return least, most
        kept = (
            np.minimum.reduceat(least, first) - 1e-9,
            np.maximum.reduceat(most, first) + 1e-9,
        )
        vars(mesh)["_groups"] = kept
    return kept


def _meet(
    mesh: TriMesh, rows: np.ndarray, origin: np.ndarray, way: np.ndarray
) -> tuple[float, int]:
    """The nearest of some triangles of a mesh."""
    a, b, c = (mesh.vertices[mesh.triangles[rows, k]] for k in range(3))
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
    return float(best), int(rows[t.argmin()])


def _slabs(
    origin: np.ndarray, way: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - origin) / way, (high - origin) / way
    entry = np.fmax.reduce(np.fmin(a, b), axis=1)
    return np.maximum(entry, 0.0), np.fmin.reduce(np.fmax(a, b), axis=1)
