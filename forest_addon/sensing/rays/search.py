"""Search that the engines share: batches in tasks, limits on both ends, chained rays, exact distances.

An engine only searches in float32: which triangle does each ray meet first behind its ``start``?
``Search`` answers all of ``RayCaster`` with that. The search begins a little before ``min_distance`` and
ends a little behind ``max_distance``, the float64 distance of what was found then decides. Where it says
no (too near, or the triangle that the ray leaves), the ray starts again just behind what it met, by a
step that doubles from try to try.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from ...base.trimesh import TriMesh
from .caster import ROWS, Hits, RayCaster, unit_columns
from .geometry import SceneGeometry

TASK = 4096  # rays; a multiple of 16, so that packets do not depend on the number of threads
MARGIN = 1e-3  # metres before min_distance where a search begins
STEP = 1e-6  # metres: the first step behind what does not count


class Search(RayCaster, ABC):
    """A ``RayCaster`` over an engine's ``_nearest``, on ``threads`` threads.

    like : a search in another scene, which shares what was made of meshes that both have.
    """

    engine: str
    task = TASK  # rays at a time

    def __init__(self, scene: SceneGeometry, threads: int = 1, like: Search | None = None) -> None:
        self.scene = scene
        self.threads = threads
        # Which mesh of the other search's scene each mesh is, of those that are in both.
        known = {} if like is None else {id(mesh): n for n, mesh in enumerate(like.scene.meshes)}
        self._same = {n: known[id(m)] for n, m in enumerate(scene.meshes) if id(m) in known}

    @abstractmethod
    def _nearest(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        start: np.ndarray,
        limit: np.ndarray,
        time: np.ndarray,
    ) -> Hits:
        """The nearest triangle of each ray between ``start`` and ``limit`` (R,), as float32 sees it.

        origins, directions : (3, R) float64, each coordinate one contiguous array; finite, unit
        directions. time : (R,) s, which counts where the scene moves. Distances in the hits are exact and
        from the origin; they may lie a little outside of the limits.
        """

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: float | np.ndarray = np.inf,
        *,
        min_distance: float | np.ndarray = 0.0,
        leaving: Hits | None = None,
        time: float | np.ndarray = 0.0,
    ) -> Hits:
        """The closest hit of each ray; see ``RayCaster``. time : (R,) s, where the scene moves."""
        origins, directions = np.asarray(origins), np.asarray(directions)
        count = len(origins)
        near, far, when = (
            np.full(count, given, dtype=np.float64) for given in (min_distance, max_distance, time)
        )
        hits = Hits.misses(count)
        left = Hits.misses(count) if leaving is None else leaving

        def task(part: slice) -> None:
            given = origins[part], directions[part], near[part], far[part], when[part]
            hits.put(part, self._cast(*given, left.select(part)))

        in_tasks(task, count, self.threads, self.task)
        return hits

    def _cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        near: np.ndarray,
        far: np.ndarray,
        time: np.ndarray,
        left: Hits,
    ) -> Hits:
        """One task."""
        begin, ways = np.array(origins.T, dtype=np.float64, order="C"), unit_columns(directions.T)
        sound = np.isfinite(begin.sum(axis=0) + ways.sum(axis=0)) & (near <= far)
        start = near - np.where(left.found, 0.0, MARGIN)
        hits, rays, step = Hits.misses(len(near)), np.flatnonzero(sound), STEP
        while len(rays):
            at, way = (np.ascontiguousarray(vectors[:, rays]) for vectors in (begin, ways))
            met = self._nearest(at, way, start[rays], far[rays], time[rays])
            hits.put(rays, met)
            rays = rays[refused(met, near[rays], left.select(rays))]
            start[rays] = np.maximum(start[rays], hits.distance[rays]) + step  # behind that
            step *= 2.0
        beyond = np.flatnonzero((hits.distance > far) & hits.found)
        hits.put(beyond, Hits.misses(len(beyond)))
        return hits


def refused(hits: Hits, near: np.ndarray, left: Hits) -> np.ndarray:
    """(R,) bool: which hits do not count, being too near or the triangle that the ray leaves."""
    same = (hits.instance == left.instance) & (hits.triangle == left.triangle)
    left_behind = left.found & hits.found & (same | (hits.distance <= near))
    return np.asarray((hits.distance < near) | left_behind)


def in_tasks(task: Callable[[slice], None], count: int, threads: int, size: int = TASK) -> None:
    """Do a task for every ``size`` rays of so many, on threads."""
    parts = [slice(first, first + size) for first in range(0, count, size)]
    if threads == 1 or len(parts) < 2:
        for part in parts:
            task(part)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(task, parts))


# The float64 distance of a hit: where both engines become exact.
#
# An engine says in float32 which triangle of which instance a ray meets. ``meet_planes``
# intersects the ray with that triangle's plane again, in float64, with the world's axes but from the ray's
# origin: that takes the error from 1e-5 m to 1e-13 m, near the world's origin and at UTM coordinates alike.


FLAT = 4.0  # steps of a float32 at a triangle's coordinates


def meet_planes(
    scene: SceneGeometry,
    origins: np.ndarray,
    directions: np.ndarray,
    instance: np.ndarray,
    triangle: np.ndarray,
    transform: np.ndarray | None = None,
    corners: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """(R,) metres along rays (3, R) with unit directions to the planes of triangles (R,) of instances (R,) of
    a scene, and the unit normals (3, R) of these.

    transform : (R, 3, 4) of the instances, where they are then; left out: where the scene says.
    corners : (R, 3, 3) of the triangles in their own frames; left out: of their meshes.

    A ray that float32 found to hit and that passes just beside the triangle may meet its plane
    far away, or never: the distance is kept within that of the triangle's corners.
    """
    if transform is None:
        transform = scene.transform[instance]
    m = transform.reshape(-1, 3, 4, 1).transpose(1, 2, 3, 0)  # to, from, 1, R
    if corners is None:
        corners = scene.corners(instance, triangle)
    corner = np.ascontiguousarray(corners.transpose(2, 1, 0))  # (of space, of triangle, R)
    space = m[:, 0] * corner[0] + m[:, 1] * corner[1] + m[:, 2] * corner[2]
    u, v = space[:, 1] - space[:, 0], space[:, 2] - space[:, 0]
    normal = u[[1, 2, 0]] * v[[2, 0, 1]] - u[[2, 0, 1]] * v[[1, 2, 0]]
    foot = m[:, 3, 0] - origins + space[:, 0]
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        t = _dot(foot, normal) / _dot(directions, normal)
        normal /= np.sqrt(_dot(normal, normal))
    at, second, third = (_dot(way, directions) for way in (foot, u, v))
    t = np.fmax(t, at + np.minimum(np.minimum(second, third), 0.0))
    return np.fmin(t, at + np.maximum(np.maximum(second, third), 0.0)), normal


def whole_triangles(mesh: TriMesh) -> np.ndarray:
    """(T,) bool: which triangles of a mesh a ray can hit.

    Corners must be finite, the height over the longest side more than ``FLAT`` steps of a float32: whoever
    searches in single precision finds what is thinner all along its line, before what is really there.
    """
    whole, vertices = np.empty(len(mesh.triangles), dtype=bool), mesh.vertices
    with np.errstate(invalid="ignore", over="ignore"):
        for first in range(0, len(whole), ROWS):
            part = slice(first, first + ROWS)
            corner = np.ascontiguousarray(vertices[mesh.triangles[part]].T)  # (3, corner, N)
            u, v, w = (corner[:, k] - corner[:, n] for k, n in ((1, 0), (2, 0), (2, 1)))
            normal = u[[1, 2, 0]] * v[[2, 0, 1]] - u[[2, 0, 1]] * v[[1, 2, 0]]
            longest = np.sqrt(np.maximum.reduce([_dot(side, side) for side in (u, v, w)]))
            step = np.spacing(np.abs(corner).max(axis=(0, 1)).astype(np.float32))
            whole[part] = np.sqrt(_dot(normal, normal)) > FLAT * step * longest
    return whole


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Dot products of vectors (3, …), summed in the same order at any number of them."""
    product = a * b
    total: np.ndarray = product[0] + product[1]
    total += product[2]
    return total
