"""Rays in time: parts of a scene move, bend or sway, and rays meet them where they are at their own time.

Whatever finds a hit, it is met in float64 in the part's own frame, to which the ray is taken by the part's
inverse transform at the ray's time, and distances come back by the ray's stretch. ``PartByPart`` does so with
any caster of still scenes, one for each mesh; an engine may do it faster (``blender.rays.embree_motion``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import replace
from typing import Protocol

import numpy as np

from ..base.trimesh import TriMesh
from .moving import MovingScene, swept, taken_back, turned_back
from .rays.boxes import BoxTree
from .rays.caster import Hits, RayCaster, unit_columns
from .rays.exact import (
    ExactCaster,
    Level,
    Referee,
    candidates,
    counting,
    grouped,
    meet,
    put_nearest,
)
from .rays.geometry import SceneGeometry
from .rays.paths import ShapePath

KEPT = 64  # stretches of time whose boxes are kept

MakeCaster = Callable[[SceneGeometry], RayCaster]


class MotionSearch(Protocol):
    """Search for hits in a scene that moves, by whatever tree."""

    engine: str

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
        """The closest hits of rays (R, 3), (R, 3) within limits (R,), at times (R,), s."""
        ...


class MovingCaster:
    """Closest hits of rays at times of their own, in a scene that moves.

    make : what makes a caster of a still scene. engine : what makes a search in the moving scene, or None
    where it cannot; left out: ``PartByPart``.
    """

    def __init__(
        self,
        moving: MovingScene,
        make: MakeCaster,
        engine: Callable[[MovingScene], MotionSearch | None] | None = None,
    ) -> None:
        self.moving = moving
        search = None if engine is None else engine(moving)
        self.search: MotionSearch | Referee = search or PartByPart(moving, make)
        self.engine = self.search.engine

    @property
    def scene(self) -> SceneGeometry:
        """The scene by which hits are numbered."""
        return self.moving.scene

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: float | np.ndarray = np.inf,
        *,
        time: np.ndarray,
        min_distance: float | np.ndarray = 0.0,
        leaving: Hits | None = None,
    ) -> Hits:
        """The closest hit of each ray at its time (R,), s; the rest as ``RayCaster.cast``."""
        origins = np.asarray(origins, dtype=np.float64)
        near = np.broadcast_to(np.asarray(min_distance, dtype=np.float64), len(origins))
        far = np.broadcast_to(np.asarray(max_distance, dtype=np.float64), len(origins))
        time = np.asarray(time, dtype=np.float64)
        hits = self.search.cast(
            origins, directions, far, time=time, min_distance=near, leaving=leaving
        )
        assert hits.normal is not None
        rows = np.flatnonzero(hits.found & np.isnan(hits.normal[:, 0]))  # of which none is told
        hits.normal[rows] = self.moving.normals(hits.select(rows), time[rows])
        return hits

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

    def exactly(self, true: SceneGeometry | None = None) -> MovingCaster:
        """The same motion with every triangle met in float64. true : the scene that is true, as it is read;
        left out: its own."""
        return MovingCaster(self.moving if true is None else self.moving.of(true), ExactCaster)

    def judged(self, true: SceneGeometry | None = None) -> MovingCaster:
        """The same caster, every hit of which is held against float64 (``Referee``); true : as of
        ``exactly``."""
        other, exact = copy(self), self.exactly(true)
        other.search, other.engine = Referee(self, exact.scene, exact), Referee.engine
        return other


class PartByPart:
    """Rays at a scene that moves, each part in its own frame by a caster of its mesh: slow, always there."""

    def __init__(self, moving: MovingScene, make: MakeCaster) -> None:
        self._moving, self._make = moving, make
        self._still = make(moving.still)
        self.engine = self._still.engine
        self._casters: dict[int, RayCaster | BentCaster] = {}
        motion = moving.motion
        boxes = np.empty((len(motion.rows), 2, 3))
        for row, number in enumerate(motion.rows.tolist()):
            mesh = moving.scene.meshes[moving.scene.mesh_index[number]]
            shape = motion.shapes.get(number)
            ends = self._alone(mesh).bounds() if shape is None else shape.bounds()
            boxes[row] = motion.paths[number].swept(*(np.reshape(end, 3) for end in ends))
        self._keyed = BoxTree(boxes[:, 0], boxes[:, 1])
        self._spans = np.array([motion.span(n) for n in motion.rows.tolist()]).reshape(-1, 2)

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
        """The closest hits; see ``MotionSearch``."""
        best = self._still.cast(
            origins, directions, max_distance, min_distance=min_distance, leaving=leaving
        )
        directions = unit_columns(np.asarray(directions).T).T
        near = np.maximum(min_distance, 0.0)
        far = np.fmin(max_distance, best.distance)
        sound = np.isfinite(origins.sum(axis=1) + directions.sum(axis=1)) & (near <= far)
        sound = np.flatnonzero(sound)
        for ray, instance in self._pairs(origins, directions, near, far, time, sound):
            # Instances of one mesh, in whose frame they are met.
            at = self._moving.at(instance, time[ray])
            begin, along = taken_back(at, origins[ray]), turned_back(at, directions[ray])
            size = np.linalg.norm(along, axis=1)
            left = None
            if leaving is not None:
                left = leaving.select(ray)
                left = replace(left, instance=np.where(left.instance == instance, 0, -1))
            rays = begin, along, np.fmin(max_distance, best.distance)[ray] * size
            limits = {"min_distance": min_distance[ray] * size, "leaving": left}
            caster = self._caster(int(instance[0]))
            if isinstance(caster, BentCaster):
                limits["time"] = time[ray]
            met = caster.cast(*rays, **limits)
            distance = met.distance / size
            nearer = np.flatnonzero(met.found & (distance < best.distance[ray]))
            put_nearest(best, ray[nearer], Hits(distance, instance, met.triangle).select(nearer))
        return best

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
        moving, motion = self._moving, self._moving.motion
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

    def _caster(self, number: int) -> RayCaster | BentCaster:
        """A caster of the mesh of an instance, in its own frame."""
        index = int(self._moving.scene.mesh_index[number])
        mesh, shape = self._moving.scene.meshes[index], self._moving.motion.shapes.get(number)
        key = index if shape is None else -1 - number
        if key not in self._casters:
            bent = None if shape is None else BentCaster(mesh, shape)
            self._casters[key] = bent or self._make(self._alone(mesh))
        return self._casters[key]

    @staticmethod
    def _alone(mesh: TriMesh) -> SceneGeometry:
        one = np.zeros(1, np.int64)
        return SceneGeometry((mesh,), np.eye(3, 4)[None], one, ("",), one - 1, one - 1)


class BentCaster:
    """Closest hits of rays at times of their own at one mesh that changes its shape, in its own frame, in
    float64.

    Between two samples of the shape a box holds the triangles of a group at both, so it holds them all the
    way; of the groups whose boxes a ray meets, each triangle is met where its corners are at the ray's time.
    """

    def __init__(self, mesh: TriMesh, shape: ShapePath) -> None:
        self._mesh, self._shape = mesh, shape
        self._boxes: dict[int, list[Level]] = {}

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: np.ndarray,
        *,
        min_distance: np.ndarray,
        time: np.ndarray,
        leaving: Hits | None = None,
    ) -> Hits:
        """The closest hits of rays (R, 3), (R, 3) at times (R,), s, within limits (R,); instances are 0."""
        ways = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        known = self._shape.time
        row = np.clip(np.searchsorted(known, time, "right") - 1, 0, max(len(known) - 2, 0))
        hits = Hits.misses(len(origins))
        order = np.argsort(row, kind="stable")
        for rows in np.split(order, np.flatnonzero(np.diff(row[order])) + 1):
            if not len(rows):
                continue
            boxes = len(self._mesh.triangles), self._levels(int(row[rows[0]]))
            pair, triangle = candidates(boxes, origins[rows], ways[rows], max_distance[rows])
            ray = rows[pair]
            corners = self._shape.at(self._mesh.triangles[triangle], time[ray])
            distance = meet(tuple(corners.swapaxes(0, 1)), origins[ray], ways[ray])
            met = Hits(distance, np.zeros(len(ray), np.int64), triangle)
            left = None if leaving is None else leaving.select(ray)
            some = counting(met, min_distance[ray], max_distance[ray], left)
            put_nearest(hits, ray[some], met.select(some))
        return hits

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
