"""Rays in time: parts of a scene move or bend, and rays meet them where they are at their own time.

A part is met in its own frame: a ray is taken there by the part's inverse transform at the ray's time, in
float64, and what it meets is exact there as in a still scene. Distances come back by the ray's stretch.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from .bent import BentCaster
from .boxes import BoxTree
from .caster import Hits, RayCaster, hit_normals, unit_columns
from .exact import ExactCaster, meet
from .geometry import SceneGeometry, invert_transforms
from .paths import Motion, corners_at_rest
from .referee import Referee

STILL = np.eye(3, 4)


class TimedCaster(ABC):
    """Closest hits of rays at times of their own, in a scene that moves.

    scene : what hits are numbered by. within : metres by which places may be off between two samples, bent :
    and points of what changes its shape. held : names of objects that stand still between samples.
    """

    engine: str
    scene: SceneGeometry
    within: float = 0.0
    bent: float = 0.0
    held: tuple[str, ...] = ()

    @abstractmethod
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

    def judged(self, true: SceneGeometry | None = None) -> JudgedCaster:
        """The same motion by a caster that holds the engine against float64, ray by ray.

        true : the scene that is true; left out: its own.
        """
        return JudgedCaster(self, self.exactly(true))

    @abstractmethod
    def exactly(self, true: SceneGeometry | None = None) -> TimedCaster:
        """The same motion with every triangle met in float64."""

    @abstractmethod
    def corners(self, instance: np.ndarray, triangle: np.ndarray, time: np.ndarray) -> np.ndarray:
        """(R, 3, 3) corners in the world of triangles of instances (R,) at times (R,), s."""

    def meets(
        self, origins: np.ndarray, directions: np.ndarray, hits: Hits, time: np.ndarray
    ) -> np.ndarray:
        """(R,) metres along rays to the triangles that hits name; inf where one passes its triangle by."""
        found = np.full(len(origins), np.inf)
        rows = np.flatnonzero(hits.found)
        if len(rows):
            corners = self.corners(hits.instance[rows], hits.triangle[rows], time[rows])
            corners -= origins[rows, None]
            ways = unit_columns(directions[rows].T).T
            found[rows] = meet(tuple(corners.swapaxes(0, 1)), np.zeros((len(rows), 3)), ways)
        return found

    @abstractmethod
    def normals(self, hits: Hits, time: np.ndarray) -> np.ndarray:
        """(R, 3) unit world normals of the triangles that were hit at times (R,), s; NaN for a miss."""

    @abstractmethod
    def velocities(
        self, points: np.ndarray, instance: np.ndarray, triangle: np.ndarray, time: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(R, 3) m/s of surface points (R, 3), met on triangles of instances (R,) at times (R,), and where
        they are in the scene as it stands still, metres; NaN where they are not there."""

    def known(self, instance: np.ndarray, triangle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The numbers that instances and triangles (R,) have in the scene as it was read."""
        return instance, triangle


class JudgedCaster(TimedCaster):
    """An engine in a scene that moves, every hit of which is held against float64 (``Referee``)."""

    engine = Referee.engine

    def __init__(self, caster: TimedCaster, exact: TimedCaster) -> None:
        self.scene, self._caster = caster.scene, caster
        self._judge = Referee(caster, exact.scene, exact)

    def exactly(self, true: SceneGeometry | None = None) -> TimedCaster:
        return self._caster.exactly(true)

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
        return self._judge.cast(
            origins,
            directions,
            max_distance,
            min_distance=min_distance,
            leaving=leaving,
            time=time,
        )

    def corners(self, instance: np.ndarray, triangle: np.ndarray, time: np.ndarray) -> np.ndarray:
        return self._caster.corners(instance, triangle, time)

    def normals(self, hits: Hits, time: np.ndarray) -> np.ndarray:
        return self._caster.normals(hits, time)

    def velocities(
        self, points: np.ndarray, instance: np.ndarray, triangle: np.ndarray, time: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        return self._caster.velocities(points, instance, triangle, time)

    def known(self, instance: np.ndarray, triangle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self._caster.known(instance, triangle)


class MotionEngine(Protocol):
    """What finds hits in a scene that moves, by whatever tree."""

    engine: str

    def cast(
        self,
        origins: np.ndarray,
        ways: np.ndarray,
        near: np.ndarray,
        far: np.ndarray,
        time: np.ndarray,
        leaving: Hits | None,
    ) -> Hits:
        """The closest hits of rays (R, 3), (R, 3) unit, at times (R,), s."""
        ...


MakeMotion = Callable[[SceneGeometry, Motion], MotionEngine | None]


class MovingCaster(TimedCaster):
    """Closest hits of rays at times of their own, in a scene of which some instances move.

    make : what makes a caster of a still scene. engine : what makes one of the moving scene, or None where it
    cannot; left out: casters of each part, in its own frame.
    """

    def __init__(
        self,
        scene: SceneGeometry,
        motion: Motion,
        make: Callable[[SceneGeometry], RayCaster],
        engine: MakeMotion | None = None,
    ) -> None:
        self.scene, self.motion = scene, motion
        self.within, self.bent, self.held = motion.within, motion.bent, motion.held
        self._still: RayCaster | None = None if motion.paths else make(scene)
        self._rays: MotionEngine | None = None
        if self._still is None:
            found = None if engine is None else engine(scene, motion)
            self._rays = PartByPart(scene, motion, make) if found is None else found
        self.engine = (self._still or self._rays).engine  # type: ignore[union-attr]

    def exactly(self, true: SceneGeometry | None = None) -> MovingCaster:
        scene = self.scene if true is None else self._extended(true)
        return MovingCaster(scene, self.motion, ExactCaster)

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
        if self._rays is None:
            assert self._still is not None
            return self._still.cast(
                origins, directions, max_distance, min_distance=min_distance, leaving=leaving
            )
        origins = np.asarray(origins, dtype=np.float64)
        ways = unit_columns(np.asarray(directions).T).T
        near = np.broadcast_to(np.asarray(min_distance, dtype=np.float64), len(origins))
        far = np.array(np.broadcast_to(max_distance, len(origins)), dtype=np.float64)
        time = np.asarray(time, dtype=np.float64)
        return self._rays.cast(origins, ways, near, far, time, leaving)

    def corners(self, instance: np.ndarray, triangle: np.ndarray, time: np.ndarray) -> np.ndarray:
        own = self.motion.corners(self.scene, instance, triangle, time)
        at = self.scene.transform[instance]
        mine, row = self.motion.row_of(instance)
        if len(mine):
            at[mine] = self.motion.table.at(row, time[mine])
        return np.asarray(np.einsum("rij,rkj->rki", at[:, :, :3], own) + at[:, None, :, 3])

    def normals(self, hits: Hits, time: np.ndarray) -> np.ndarray:
        found = hit_normals(self.scene, hits)
        mine, row = self.motion.row_of(hits.instance)
        if len(mine):
            instance, triangle, time = hits.instance[mine], hits.triangle[mine], time[mine]
            own = self.motion.corners(self.scene, instance, triangle, time)
            at = self.motion.table.at(row, time)[:, :, :3]
            u, v = (np.einsum("rij,rj->ri", at, own[:, k] - own[:, 0]) for k in (1, 2))
            normal = np.cross(u, v)
            with np.errstate(invalid="ignore", divide="ignore"):
                found[mine] = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        return found

    def velocities(
        self, points: np.ndarray, instance: np.ndarray, triangle: np.ndarray, time: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        velocity, rest = np.zeros_like(points), points.copy()
        mine, row = self.motion.row_of(instance)
        if not len(mine):
            return velocity, rest
        instance, triangle, time = instance[mine], triangle[mine], time[mine]
        at = self.motion.table.at(row, time)
        inverse = invert_transforms(at)
        own = np.einsum("rij,rj->ri", inverse[:, :, :3], points[mine]) + inverse[:, :, 3]
        rate, stood = self._bent(own, instance, triangle, time)
        velocity[mine] = self.motion.table.velocity(row, own, time)
        velocity[mine] += np.einsum("rij,rj->ri", at[:, :, :3], rate)
        still = self.scene.transform[instance]
        rest[mine] = np.einsum("rij,rj->ri", still[:, :, :3], stood) + still[:, :, 3]
        return velocity, rest

    def known(self, instance: np.ndarray, triangle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The numbers in the scene as it was read; of a mesh of other triangles, one of the same material."""
        stands_for = self.motion.stands_for
        if stands_for is None:
            return instance, triangle
        instance, triangle = np.array(instance), np.array(triangle)
        other = np.append(stands_for, -1)[instance] != instance
        for number in np.unique(instance[other]).tolist():
            mine = np.flatnonzero(instance == number)
            of = int(stands_for[number])
            here, there = (self.scene.meshes[self.scene.mesh_index[n]] for n in (number, of))
            if here is not there:
                slot, first = np.unique(there.material, return_index=True)
                row = np.minimum(np.searchsorted(slot, here.material), len(slot) - 1)
                like = np.where(slot[row] == here.material, first[row], 0)
                triangle[mine] = like[triangle[mine]]
            instance[mine] = of
        return instance, triangle

    def _bent(
        self, own: np.ndarray, instance: np.ndarray, triangle: np.ndarray, time: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(R, 3) m/s of own points (R, 3) as their shape changes, and where they are at rest; NaN where they
        are not there then."""
        rate, stood = np.zeros_like(own), own.copy()
        bends = np.flatnonzero(np.isin(instance, list(self.motion.shapes)))
        if len(bends):
            asked = instance[bends], triangle[bends], time[bends]
            a, b, c = self.motion.corners(self.scene, *asked).swapaxes(0, 1)
            across = np.stack([b - a, c - a], axis=2)  # (R, 3, 2): shares along two sides
            share = np.einsum("rij,rj->ri", np.linalg.pinv(across), own[bends] - a)
            shares = np.column_stack([1 - share.sum(axis=1), share])
            rates = self.motion.corner_rates(self.scene, *asked)
            rate[bends] = np.einsum("rk,rki->ri", shares, rates)
            vertex = corners_at_rest(self.scene, *asked[:2])
            stood[bends] = np.einsum("rk,rki->ri", shares, vertex)
        if self.motion.stands_for is not None:
            stood[self.motion.stands_for[instance] != instance] = np.nan
        return rate, stood

    def _extended(self, true: SceneGeometry) -> SceneGeometry:
        """A scene as it was read, with the instances that this one has besides."""
        more = np.arange(len(true), len(self.scene))
        if not len(more):
            return true
        both = _chosen(self.scene, np.arange(len(self.scene)))
        both.transform[: len(true)] = true.transform
        meshes = (*true.meshes, *self.scene.meshes[len(true.meshes) :])
        return replace(both, meshes=meshes)


class PartByPart:
    """Rays at a scene that moves, each part in its own frame by a caster of its own."""

    def __init__(
        self, scene: SceneGeometry, motion: Motion, make: Callable[[SceneGeometry], RayCaster]
    ) -> None:
        self._motion = motion
        moves = np.zeros(len(scene), dtype=bool)
        moves[motion.rows] = True
        self._still_number = np.flatnonzero(~moves)
        self._still = make(_chosen(scene, self._still_number))
        self._parts: list[Any] = []
        boxes = np.empty((len(motion.rows), 2, 3))
        for row, n in enumerate(motion.rows.tolist()):
            if n in motion.shapes:
                mesh, shape = scene.meshes[scene.mesh_index[n]], motion.shapes[n]
                self._parts.append(BentCaster(mesh, shape))
                box = shape.bounds()
            else:
                alone = _chosen(scene, [n], STILL)
                self._parts.append(make(alone))
                low, high = alone.bounds()
                box = low[0], high[0]
            boxes[row] = motion.paths[n].swept(*box)
        self._swept = BoxTree(boxes[:, 0], boxes[:, 1])
        self.engine = self._still.engine

    def cast(
        self,
        origins: np.ndarray,
        ways: np.ndarray,
        near: np.ndarray,
        far: np.ndarray,
        time: np.ndarray,
        leaving: Hits | None,
    ) -> Hits:
        """The closest hits; see ``MotionEngine``."""
        left = None if leaving is None else _renumbered(leaving, self._still_number)
        best = self._still.cast(origins, ways, far, min_distance=near, leaving=left)
        best.instance[best.found] = self._still_number[best.instance[best.found]]
        if not self._parts:
            return best
        sound = np.flatnonzero(np.isfinite(origins.sum(axis=1) + ways.sum(axis=1)))
        start, limit = np.maximum(near[sound], 0.0), np.minimum(far, best.distance)[sound]
        ray, box, _ = self._swept.pairs(origins[sound].T, ways[sound].T, start, limit)
        order = np.argsort(box, kind="stable")
        cuts = np.searchsorted(box[order], np.arange(len(self._parts) + 1))
        rays = origins, ways, time, near, far
        for place in range(len(self._parts)):
            rows = sound[ray[order[cuts[place] : cuts[place + 1]]]]
            first, last = self._motion.span(int(self._motion.rows[place]))
            rows = rows[(time[rows] >= first) & (time[rows] < last)]
            if len(rows):
                self._cast_part(place, rays, rows, leaving, best)
        return best

    def _own(
        self, place: int, origins: np.ndarray, ways: np.ndarray, time: np.ndarray, rows: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Some rays in the frame of a part at their times, and how much they are stretched there."""
        path = np.full(len(rows), place)
        inverse = invert_transforms(self._motion.table.at(path, time[rows]))
        begin = np.einsum("rij,rj->ri", inverse[:, :, :3], origins[rows]) + inverse[:, :, 3]
        along = np.einsum("rij,rj->ri", inverse[:, :, :3], ways[rows])
        return begin, along, np.linalg.norm(along, axis=1)

    def _cast_part(
        self,
        place: int,
        rays: tuple[np.ndarray, ...],
        rows: np.ndarray,
        leaving: Hits | None,
        best: Hits,
    ) -> None:
        """Put into ``best`` what these rows of the rays meet nearer in one part."""
        origins, ways, time, near, far = rays
        number = self._motion.rows[place]
        limit = np.minimum(far, best.distance)[rows]
        begin, along, size = self._own(place, origins, ways, time, rows)
        left = None if leaving is None else _renumbered(leaving, np.array([number])).select(rows)
        part = self._parts[place]
        when = {"time": time[rows]} if isinstance(part, BentCaster) else {}
        met = part.cast(
            begin, along, limit * size, min_distance=near[rows] * size, leaving=left, **when
        )
        distance = met.distance / size
        won = np.flatnonzero(met.found & (distance < best.distance[rows]))
        best.put(rows[won], Hits(distance[won], np.full(len(won), number), met.triangle[won]))


def _chosen(
    scene: SceneGeometry, rows: Sequence[int] | np.ndarray, place: np.ndarray | None = None
) -> SceneGeometry:
    """The scene of some instances, each where it is or all at one place (3, 4)."""
    transform = scene.transform[rows] if place is None else np.repeat(place[None], len(rows), 0)
    return replace(
        scene,
        transform=transform,
        mesh_index=scene.mesh_index[rows],
        tree=scene.tree[rows],
        species=scene.species[rows],
        object_index=scene.object_index[rows],
        reflectance=scene.reflectance[rows],
    )


def _renumbered(hits: Hits, numbers: np.ndarray) -> Hits:
    """Hits with instances as rows of ascending ``numbers``; -1 where they are not among them."""
    if not len(numbers):
        return replace(hits, instance=np.full_like(hits.instance, -1))
    row = np.minimum(np.searchsorted(numbers, hits.instance), len(numbers) - 1)
    return replace(hits, instance=np.where(numbers[row] == hits.instance, row, -1))
