"""Rays against every triangle near them, in float64: what audits and benchmarks hold the engines against.

Triangles that follow each other in their mesh are most often neighbours: eight share a box, eight boxes a
larger one, and so on to the whole mesh. All rays go down these boxes together, and meet each triangle of the
groups whose boxes they meet (Möller & Trumbore 1997). It shares no code with the engines.
"""

from __future__ import annotations

import numpy as np

from ...base.trimesh import TriMesh
from .caster import Hits, RayCaster
from .geometry import SceneGeometry, invert_transforms

GROUP = 8  # triangles of a box, and boxes of a larger one
PAIRS = 500_000  # rays by instances, and by boxes, at a time
EDGE = 1e-12  # barycentric slack: a ray at a shared edge meets at least one of its triangles

Level = tuple[np.ndarray, np.ndarray]  # smallest and largest corners (G, 3)


class ExactCaster(RayCaster):
    """The ``RayCaster`` protocol in float64."""

    engine = "float64"

    def __init__(self, scene: SceneGeometry) -> None:
        self.scene = scene
        self._low, self._high = scene.bounds()
        self._inverse = invert_transforms(scene.transform)[:, :, :3]

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: float | np.ndarray = np.inf,
        *,
        min_distance: float | np.ndarray = 0.0,
        leaving: Hits | None = None,
    ) -> Hits:
        """The closest hits of rays (R, 3), (R, 3)."""
        count = len(origins)
        ways = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        far = np.broadcast_to(np.asarray(max_distance, np.float64), count)
        near = np.broadcast_to(np.asarray(min_distance, np.float64), count)
        hits = Hits.misses(count)
        at_once = max(1, PAIRS // max(len(self.scene), 1))
        for first in range(0, count, at_once):
            rows = np.arange(first, min(first + at_once, count))
            left = None if leaving is None else leaving.select(rows)
            part = self._cast(origins[rows], ways[rows], near[rows], far[rows], left)
            hits.put(rows, part)
        return hits

    def meets(self, origins: np.ndarray, directions: np.ndarray, hits: Hits) -> np.ndarray:
        """(R,) metres along rays to the triangles that hits name; inf where one passes its triangle by."""
        ways = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        found = np.full(len(origins), np.inf)
        named = np.flatnonzero(hits.found)
        mesh_of = self.scene.mesh_index[hits.instance[named]]
        for index in np.unique(mesh_of).tolist():
            rows = named[mesh_of == index]
            start, way = self._local(origins[rows], ways[rows], hits.instance[rows])
            corners = _corners(self.scene.meshes[index], hits.triangle[rows])
            found[rows] = meet(corners, start, way)
        return found

    def _local(
        self, origins: np.ndarray, ways: np.ndarray, instance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Rays in the space of their instances; distances stay those of the world."""
        inverse = self._inverse[instance]
        start = np.einsum("pij,pj->pi", inverse, origins - self.scene.transform[instance, :, 3])
        return start, np.einsum("pij,pj->pi", inverse, ways)

    def _cast(
        self,
        origins: np.ndarray,
        ways: np.ndarray,
        near: np.ndarray,
        far: np.ndarray,
        leaving: Hits | None,
    ) -> Hits:
        met = _slabs(origins[:, None], ways[:, None], self._low, self._high, far[:, None])
        ray, instance = np.nonzero(met)
        mesh_of = self.scene.mesh_index[instance]
        rays, distances, instances, triangles = [], [], [], []
        for index in np.unique(mesh_of).tolist():
            rows = np.flatnonzero(mesh_of == index)
            mine, here = ray[rows], instance[rows]
            start, way = self._local(origins[mine], ways[mine], here)
            mesh = self.scene.meshes[index]
            pair, triangle = candidates(_levels(mesh), start, way, far[mine])
            distance = meet(_corners(mesh, triangle), start[pair], way[pair])
            mine, here = mine[pair], here[pair]
            left = None if leaving is None else leaving.select(mine)
            some = counting(Hits(distance, here, triangle), near[mine], far[mine], left)
            rays.append(mine[some])
            distances.append(distance[some])
            instances.append(here[some])
            triangles.append(triangle[some])
        hits = Hits.misses(len(origins))
        if not rays:
            return hits
        found = (np.concatenate(column) for column in (distances, instances, triangles))
        put_nearest(hits, np.concatenate(rays), Hits(*found))
        return hits


def cast_exactly(scene: SceneGeometry, origins: np.ndarray, directions: np.ndarray) -> Hits:
    """The closest hits of rays (R, 3), (R, 3)."""
    return ExactCaster(scene).cast(origins, directions)


def counting(hits: Hits, near: np.ndarray, far: np.ndarray, left: Hits | None) -> np.ndarray:
    """Rows of hits that count, of rays with these limits and what they leave."""
    counts = (hits.distance >= near) & (hits.distance <= far) & np.isfinite(hits.distance)
    if left is not None:
        counts &= ~(left.found & (hits.distance <= near))
        counts &= ~((left.instance == hits.instance) & (left.triangle == hits.triangle))
    return np.flatnonzero(counts)


def put_nearest(hits: Hits, ray: np.ndarray, met: Hits) -> None:
    """Write the nearest of what rays (M,) met."""
    order = np.lexsort((met.distance, ray))
    order = order[np.diff(ray[order], prepend=-1) != 0]
    hits.put(ray[order], met.select(order))


def candidates(
    groups: tuple[int, list[Level]], start: np.ndarray, way: np.ndarray, far: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rays (K,) by number and triangles (K,) whose boxes they meet before ``far``.

    groups : number of the triangles, and the boxes around them.
    """
    triangles, levels = groups
    if not levels:
        none = np.empty(0, np.int64)
        return none, none
    top = len(levels[-1][0])
    ray, box = np.repeat(np.arange(len(start)), top), np.tile(np.arange(top), len(start))
    for number, (low, high) in enumerate(reversed(levels)):
        kept = []
        for first in range(0, len(ray), PAIRS):
            part = slice(first, first + PAIRS)
            r, b = ray[part], box[part]
            kept.append(first + np.flatnonzero(_slabs(start[r], way[r], low[b], high[b], far[r])))
        some = np.concatenate(kept) if kept else np.empty(0, np.int64)
        below = triangles if number == len(levels) - 1 else len(levels[-2 - number][0])
        box = (box[some, None] * GROUP + np.arange(GROUP)).ravel()
        ray = np.repeat(ray[some], GROUP)
        inside = box < below
        ray, box = ray[inside], box[inside]
    return ray, box


def _levels(mesh: TriMesh) -> tuple[int, list[Level]]:
    """Boxes around groups of a mesh's triangles; kept with the mesh, which many scenes may share."""
    kept: list[Level] | None = vars(mesh).get("_groups")
    if kept is None:
        kept = []
        if len(mesh.triangles):
            corners = np.stack(_corners(mesh, slice(None)))
            kept = grouped(corners.min(axis=0), corners.max(axis=0))
        vars(mesh)["_groups"] = kept
    return len(mesh.triangles), kept


def grouped(low: np.ndarray, high: np.ndarray) -> list[Level]:
    """Boxes around groups of boxes (T, 3), (T, 3) that follow each other, and around groups of these, up to
    at most ``GROUP``.
    """
    levels: list[Level] = []
    low, high = low - 1e-9, high + 1e-9
    while not levels or len(low) > GROUP:
        first = np.arange(0, len(low), GROUP)
        low = np.fmin.reduceat(low, first)
        high = np.fmax.reduceat(high, first)
        levels.append((low, high))
    return levels


def _corners(mesh: TriMesh, triangle: np.ndarray | slice) -> tuple[np.ndarray, ...]:
    """Corners (K, 3), three of them, of triangles (K,)."""
    return tuple(mesh.vertices[mesh.triangles[triangle, k]] for k in range(3))


def meet(corners: tuple[np.ndarray, ...], origin: np.ndarray, way: np.ndarray) -> np.ndarray:
    """(K,) metres along rays (K, 3), (K, 3) to triangles of three corners (K, 3); inf for a miss."""
    a, b, c = corners
    u, v, s = b - a, c - a, origin - a
    with np.errstate(all="ignore"):
        p = np.cross(way, v)
        determinant = np.einsum("ki,ki->k", u, p)
        first = np.einsum("ki,ki->k", s, p) / determinant
        q = np.cross(s, u)
        second = np.einsum("ki,ki->k", q, way) / determinant
        t = np.einsum("ki,ki->k", v, q) / determinant
        inside = (first >= -EDGE) & (second >= -EDGE) & (first + second <= 1 + EDGE)
    met: np.ndarray = np.where(inside & (t >= 0), t, np.inf)
    return met


def _slabs(
    origin: np.ndarray, way: np.ndarray, low: np.ndarray, high: np.ndarray, far: np.ndarray
) -> np.ndarray:
    """Return whether rays (..., 3) meet boxes (..., 3) before ``far`` (...)."""
    entry, leave = np.zeros(1), far
    with np.errstate(divide="ignore", invalid="ignore"):
        for k in range(3):
            a = (low[..., k] - origin[..., k]) / way[..., k]
            b = (high[..., k] - origin[..., k]) / way[..., k]
            entry = np.fmax(entry, np.fmin(a, b))
            leave = np.fmin(leave, np.fmax(a, b))
    met: np.ndarray = entry <= leave * (1 + 1e-12)
    return met & ~np.isnan(low[..., 0])
