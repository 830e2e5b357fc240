"""Rays in time: parts of a scene move, bend or sway, and rays meet them where they are at their own time.

Whatever finds a hit, it is met in float64 in the part's own frame, to which the ray is taken by the part's
inverse transform at the ray's time, and distances come back by the ray's stretch. ``MovingCaster`` does so
with any caster of still scenes, one for each mesh; an engine may do it faster
(``blender.rays.embree_motion``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from ..base.kept import LastAsked
from .moving import MovingScene, taken_back, turned_back
from .rays.boxes import BoxTree, swept
from .rays.caster import Hits, RayCaster, unit_columns
from .rays.exact import (
    ExactCaster,
    Level,
    candidates,
    counting,
    grouped,
    meet,
    nearest_of_rays,
    put_nearest,
)
from .rays.geometry import SceneGeometry, alone
from .rays.paths import ShapePath

KEPT = 64  # stretches of time whose boxes are kept

MakeCaster = Callable[[SceneGeometry], RayCaster]


class MovingCaster(RayCaster):
    """Closest hits of rays at times of their own in a scene that moves, each part met in its own frame by a
    caster of its mesh: slow, always there.

    make : what makes a caster of a still scene.
    """

    moving: MovingScene

    def __init__(self, moving: MovingScene, make: MakeCaster) -> None:
        self.moving, self.scene, self._make = moving, moving.scene, make
        self.still = make(moving.still)
        self.engine = self.still.engine
        self._casters: dict[int, RayCaster] = {}
        self._keyed = BoxTree(*moving.keyed.swapaxes(0, 1))
        spans = [moving.motion.span(number) for number in moving.motion.rows.tolist()]
        self._spans = np.array(spans).reshape(-1, 2)

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
        """The closest hit of each ray at its time (R,), s."""
        origins, count = np.asarray(origins, dtype=np.float64), len(origins)
        near = np.maximum(np.full(count, min_distance, np.float64), 0.0)
        far, when = (np.full(count, given, np.float64) for given in (max_distance, time))
        hits = self.still.cast(origins, directions, far, min_distance=near, leaving=leaving)
        far = np.fmin(far, hits.distance)
        ways = unit_columns(np.asarray(directions).T).T
        sound = np.isfinite(origins.sum(axis=1) + ways.sum(axis=1)) & (near <= far)
        rays = origins, ways, near, far, when, np.flatnonzero(sound)
        for rows, met in self._met(*rays, leaving):
            nearer = np.flatnonzero(met.distance < hits.distance[rows])
            hits.put(rows[nearer], met.select(nearer))
            far[rows[nearer]] = met.distance[nearer]
        assert hits.normal is not None
        rows = np.flatnonzero(hits.found & np.isnan(hits.normal[:, 0]))  # of which none is told
        hits.normal[rows] = self.moving.normals(hits.select(rows), when[rows])
        return hits

    def _met(
        self,
        origins: np.ndarray,
        ways: np.ndarray,
        near: np.ndarray,
        far: np.ndarray,
        time: np.ndarray,
        sound: np.ndarray,
        leaving: Hits | None,
    ) -> Iterator[tuple[np.ndarray, Hits]]:
        """Rows of rays (R, 3), (R, 3), each once, and what moves that they meet between limits, of which
        ``far`` comes nearer from step to step; sound : the rows that are asked for."""
        for ray, instance in self._pairs(origins, ways, near, far, time, sound):
            # Instances of one mesh, in whose frame they are met.
            at = self.moving.at(instance, time[ray])
            begin, along = taken_back(at, origins[ray]), turned_back(at, ways[ray])
            size = np.linalg.norm(along, axis=1)
            left = None
            if leaving is not None:
                left = leaving.select(ray)
                left = replace(left, instance=np.where(left.instance == instance, 0, -1))
            met = self._caster(int(instance[0])).cast(
                begin,
                along,
                far[ray] * size,
                min_distance=near[ray] * size,
                leaving=left,
                time=time[ray],
            )
            met = replace(met, distance=met.distance / size, instance=instance, normal=None)
            order = nearest_of_rays(ray, met.distance)
            order = order[np.isfinite(met.distance[order])]
            nowhere = np.full((len(order), 3), np.nan)
            yield ray[order], replace(met.select(order), normal=nowhere)

    def _pairs(
        self,
        origins: np.ndarray,
        ways: np.ndarray,
        near: np.ndarray,
        far: np.ndarray,
        time: np.ndarray,
        sound: np.ndarray,
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Rays (M,) by number and instances (M,) that they may meet, those of a mesh together."""
        moving, motion = self.moving, self.moving.motion
        groups = []
        if len(motion.rows):
            ray, box, _ = self._keyed.pairs(
                origins[sound].T, ways[sound].T, near[sound], far[sound]
            )
            ray = sound[ray]
            there = (time[ray] >= self._spans[box, 0]) & (time[ray] < self._spans[box, 1])
            groups.append((ray[there], motion.rows[box[there]]))
        for rows, window in moving.bundles(origins, ways, near, far, time, sound):
            boxes = moving.pieces.boxes[moving.pieces.mesh[window.piece]]
            tree = BoxTree(*swept(boxes, window.places))
            ray, box, _ = tree.pairs(origins[rows].T, ways[rows].T, near[rows], far[rows])
            groups.append((rows[ray], moving.count + window.piece[box]))
        for ray, instance in groups:
            # What changes its shape is met alone.
            mesh = moving.scene.mesh_index[instance]
            kind = np.where(motion.bends(instance), -1 - instance, mesh)
            order = np.lexsort((instance, kind))
            cuts = np.flatnonzero(np.diff(kind[order], prepend=np.iinfo(np.int64).min))
            for rows in np.split(order, cuts[1:]):
                if len(rows):
                    yield ray[rows], instance[rows]

    def meets(
        self, origins: np.ndarray, directions: np.ndarray, hits: Hits, time: np.ndarray
    ) -> np.ndarray:
        """(R,) metres along rays to the triangles that hits name; inf where one passes its triangle by."""
        distance = np.full(len(origins), np.inf)
        rows = np.flatnonzero(hits.found)
        corners = self.moving.corners(hits.instance[rows], hits.triangle[rows], time[rows])
        corners -= origins[rows, None]
        ways = unit_columns(directions[rows].T).T
        distance[rows] = meet(tuple(corners.swapaxes(0, 1)), np.zeros((len(rows), 3)), ways)
        return distance

    def _caster(self, number: int) -> RayCaster:
        """A caster of the mesh of an instance, in its own frame."""
        index = int(self.scene.mesh_index[number])
        mesh, shape = self.scene.meshes[index], self.moving.motion.shapes.get(number)
        key = index if shape is None else -1 - number
        if key not in self._casters:
            own = alone(mesh)
            self._casters[key] = self._make(own) if shape is None else BentCaster(own, shape)
        return self._casters[key]


def exactly(caster: RayCaster, true: SceneGeometry | None = None) -> ExactCaster | MovingCaster:
    """A caster of the same scene that meets every triangle in float64. true : the scene that is true, as it
    is read; left out: the caster's own."""
    moving = caster.moving
    if moving is None:
        return ExactCaster(caster.scene if true is None else true)
    return MovingCaster(moving if true is None else moving.of(true), ExactCaster)


class BentCaster(RayCaster):
    """Closest hits of rays at times of their own at one mesh that changes its shape, in its own frame, in
    float64.

    Between two samples of the shape a box holds the triangles of a group at both, so it holds them all the
    way; of the groups whose boxes a ray meets, each triangle is met where its corners are at the ray's time.
    """

    engine = ExactCaster.engine

    def __init__(self, scene: SceneGeometry, shape: ShapePath) -> None:
        self.scene, self._shape = scene, shape
        self._mesh = scene.meshes[0]
        self._boxes: LastAsked[int, list[Level]] = LastAsked(KEPT)

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
        """The closest hits of rays at times (R,), s; instances are 0."""
        ways = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        near, far, time = (
            np.full(len(ways), given, np.float64) for given in (min_distance, max_distance, time)
        )
        known = self._shape.time
        row = np.clip(np.searchsorted(known, time, "right") - 1, 0, max(len(known) - 2, 0))
        hits = Hits.misses(len(origins))
        order = np.argsort(row, kind="stable")
        for rows in np.split(order, np.flatnonzero(np.diff(row[order])) + 1):
            if not len(rows):
                continue
            step = int(row[rows[0]])
            levels = self._boxes.once(step, partial(self._levels, step))
            boxes = len(self._mesh.triangles), levels
            pair, triangle = candidates(boxes, origins[rows], ways[rows], far[rows])
            ray = rows[pair]
            corners = self._shape.at(self._mesh.triangles[triangle], time[ray])
            distance = meet(tuple(corners.swapaxes(0, 1)), origins[ray], ways[ray])
            met = Hits(distance, np.zeros(len(ray), np.int64), triangle)
            left = None if leaving is None else leaving.select(ray)
            some = counting(met, near[ray], far[ray], left)
            put_nearest(hits, ray[some], met.select(some))
        return hits

    def _levels(self, row: int) -> list[Level]:
        ends, triangles = (
            self._shape.vertices[row : row + 2].astype(np.float64),
            self._mesh.triangles,
        )
        low, high = ends.min(axis=0)[triangles], ends.max(axis=0)[triangles]
        return grouped(low.min(axis=1), high.max(axis=1)) if len(triangles) else []
