"""Search that the engines share: batches in tasks, limits on both ends, chained rays, exact distances.

An engine only searches in float32: which triangle does each ray meet first behind its ``start``?
``Search`` answers all of ``RayCaster`` with that. The search begins a little before ``min_distance`` and
ends a little behind ``max_distance``, the float64 distance of what was found then decides. Where it says
no (too near, or the triangle that the ray leaves), the ray starts again just behind what it met, by a
step that doubles from try to try.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from .caster import Hits, RayCaster, unit_columns
from .geometry import SceneGeometry
from .refine import RefinedSurfaces

TASK = 4096  # rays; a multiple of 16, so that packets do not depend on the number of threads
MARGIN = 1e-3  # metres before min_distance where a search begins
STEP = 1e-6  # metres: the first step behind what does not count


class Search(RayCaster, ABC):
    """A ``RayCaster`` over an engine's ``_nearest``, on ``threads`` threads.

    like : a search in a scene with the same meshes, which shares what was made of them.
    """

    engine: str
    task = TASK  # rays at a time
    _surfaces: RefinedSurfaces

    def __init__(self, scene: SceneGeometry, threads: int = 1, like: Search | None = None) -> None:
        self.scene = scene
        self.threads = threads
        self._surfaces: RefinedSurfaces = RefinedSurfaces(
            scene, None if like is None else like._surfaces
        )

    @abstractmethod
    def _nearest(
        self, origins: np.ndarray, directions: np.ndarray, start: np.ndarray, limit: np.ndarray
    ) -> Hits:
        """The nearest triangle of each ray between ``start`` and ``limit`` (R,), as float32 sees it.

        origins, directions : (3, R) float64, each coordinate one contiguous array; finite, unit
        directions. Distances in the hits are exact and from the origin; they may lie a little outside
        of the limits.
        """

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: float | np.ndarray = np.inf,
        *,
        min_distance: float | np.ndarray = 0.0,
        leaving: Hits | None = None,
    ) -> Hits:
        """The closest hit of each ray; see ``RayCaster``."""
        origins, directions = np.asarray(origins), np.asarray(directions)
        count = len(origins)
        if count <= self.task and leaving is None:
            found = self._plainly(origins, directions, min_distance, max_distance)
            if found is not None:
                return found
        near, far = (
            np.full(count, limit, dtype=np.float64) for limit in (min_distance, max_distance)
        )
        if count <= self.task:
            return self._cast(origins, directions, near, far, leaving)
        hits = Hits.misses(count)

        def task(part: slice) -> None:
            left = None if leaving is None else leaving.select(part)
            hits.put(part, self._cast(origins[part], directions[part], near[part], far[part], left))

        in_tasks(task, count, self.threads, self.task)
        return hits

    def _plainly(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        near: float | np.ndarray,
        far: float | np.ndarray,
    ) -> Hits | None:
        """One task as most are: finite rays and the same limits for all.

        As ``_cast`` without its looks at each ray, which cost more than the search of few; None where
        the rays or their limits need them.
        """
        if isinstance(near, np.ndarray) or isinstance(far, np.ndarray) or not near <= far:
            return None
        origins = np.array(origins.T, dtype=np.float64, order="C")
        directions = unit_columns(directions.T)
        if not math.isfinite(np.add.reduce(origins, None) + np.add.reduce(directions, None)):
            return None
        count = origins.shape[1]
        start, limit = np.full(count, near - MARGIN), np.full(count, far, np.float64)
        hits = self._nearest(origins, directions, start, limit)
        if count and np.minimum.reduce(hits.distance) < near:
            left = Hits.misses(count)
            self._behind(
                hits, origins, directions, start, np.full(count, near, np.float64), limit, left
            )
        return hits if far == np.inf else _within(hits, far)

    def _cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        near: np.ndarray,
        far: np.ndarray,
        leaving: Hits | None,
    ) -> Hits:
        """One task."""
        origins = np.array(origins.T, dtype=np.float64, order="C")
        directions = unit_columns(directions.T)
        start = near - MARGIN
        if leaving is not None:
            start[leaving.found] += MARGIN
        usual = np.isfinite(origins.sum() + directions.sum()) and (near <= far).all()
        if usual:
            hits = self._nearest(origins, directions, start, far)
        else:
            hits = Hits.misses(len(near))
            valid = np.isfinite(origins.sum(axis=0) + directions.sum(axis=0)) & (near <= far)
            rays = np.flatnonzero(valid)
            hits.put(rays, self._nearest(*_taken(rays, origins, directions, start, far)))
        left = Hits.misses(len(near)) if leaving is None else leaving
        self._behind(hits, origins, directions, start, near, far, left)
        return _within(hits, far)

    def _behind(
        self,
        hits: Hits,
        origins: np.ndarray,
        directions: np.ndarray,
        start: np.ndarray,
        near: np.ndarray,
        far: np.ndarray,
        left: Hits,
    ) -> None:
        """Search on behind those hits that do not count, until all do; a miss always does."""
        rays = np.flatnonzero(refused(hits, near, left))
        step = STEP
        while len(rays):
            start[rays] = np.maximum(start[rays], hits.distance[rays]) + step
            step *= 2.0
            hits.put(rays, self._nearest(*_taken(rays, origins, directions, start, far)))
            rays = rays[refused(hits.select(rays), near[rays], left.select(rays))]


def _within(hits: Hits, far: np.ndarray | float) -> Hits:
    """Hits, those beyond ``far`` taken away."""
    beyond = hits.distance > far
    beyond &= hits.instance >= 0
    if beyond.any():
        hits.put(beyond, Hits.misses(1))
    return hits


def _taken(rays: np.ndarray, *arrays: np.ndarray) -> tuple[np.ndarray, ...]:
    """Some rays of arrays (..., R); no copies where they are all."""
    if len(rays) == arrays[0].shape[-1]:
        return arrays
    return tuple(np.ascontiguousarray(array[..., rays]) for array in arrays)


def refused(hits: Hits, near: np.ndarray, left: Hits) -> np.ndarray:
    """(R,) bool: which hits do not count, being too near or the triangle that the ray leaves."""
    nearer: np.ndarray = hits.distance < near
    if left.found.any():
        same = (hits.instance == left.instance) & (hits.triangle == left.triangle)
        nearer |= left.found & hits.found & (same | (hits.distance <= near))
    return nearer


def search_on(
    nearest: Callable[[np.ndarray, np.ndarray], Hits],
    near: np.ndarray,
    far: np.ndarray,
    left: Hits,
) -> Hits:
    """The first hits that count, of rays with limits (R,) and what they leave.

    nearest : what some rays (S,), by number, meet from distances (S,) on.
    """
    start = near - MARGIN
    start[left.found] += MARGIN
    hits = nearest(np.arange(len(near)), start)
    rays = np.flatnonzero(refused(hits, near, left))
    step = STEP
    while len(rays):
        start[rays] = np.maximum(start[rays], hits.distance[rays]) + step
        step *= 2.0
        found = nearest(rays, start[rays])
        hits.put(rays, found)
        rays = rays[refused(found, near[rays], left.select(rays))]
    return _within(hits, far)


def in_tasks(task: Callable[[slice], None], count: int, threads: int, size: int = TASK) -> None:
    """Do a task for every ``size`` rays of so many, on threads."""
    parts = [slice(first, first + size) for first in range(0, count, size)]
    if threads == 1 or len(parts) < 2:
        for part in parts:
            task(part)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(task, parts))
