"""Rays in time: parts of a scene move or bend, and rays meet them where they are at their own time.

A part is met in its own frame: a ray is taken there by the part's inverse transform at the ray's time, in
float64, and what it meets is exact there as in a still scene. Distances come back by the ray's stretch.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...base.trimesh import LEAF
from .caster import Hits, RayCaster, hit_normals, unit_columns
from .exact import ExactCaster, Referee, meet
from .geometry import SceneGeometry, invert_transforms
from .parts import MotionEngine, PartByPart, chosen
from .paths import SceneMotion, ShapePath, corners_at_rest


class TimedCaster(ABC):
    """Closest hits of rays at times of their own, in a scene that moves.

    scene : what hits are numbered by. within : metres by which places may be off between two samples, bent :
    and points of what changes its shape. held, remade, pause : as of ``SceneMotion``.
    bends : whether anything changes its shape.
    """

    engine: str
    scene: SceneGeometry
    within: float = 0.0
    bent: float = 0.0
    held: tuple[str, ...] = ()
    remade: tuple[str, ...] = ()
    pause: float = 0.0
    bends: bool = False

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


MakeMotion = Callable[[SceneGeometry, SceneMotion], MotionEngine | None]


class MovingCaster(TimedCaster):
    """Closest hits of rays at times of their own, in a scene of which some instances move.

    make : what makes a caster of a still scene. engine : what makes one of the moving scene, or None where it
    cannot; left out: casters of each part, in its own frame.
    """

    def __init__(
        self,
        scene: SceneGeometry,
        motion: SceneMotion,
        make: Callable[[SceneGeometry], RayCaster],
        engine: MakeMotion | None = None,
    ) -> None:
        self.scene, self.motion = scene, motion
        self.within, self.bent, self.held = motion.within, motion.bent, motion.held
        self.remade, self.pause = motion.remade, motion.pause
        self.bends = any(len(shape.time) > 1 for shape in motion.shapes.values())
        self._make, self._engine = make, engine
        self._still: RayCaster | None = None if motion.paths else make(scene)
        self._rays: MotionEngine | None = None
        if self._still is None:
            found = None if engine is None else engine(scene, motion)
            self._rays = PartByPart(scene, motion, make) if found is None else found
        self.engine = (self._still or self._rays).engine  # type: ignore[union-attr]

    def exactly(self, true: SceneGeometry | None = None) -> MovingCaster:
        scene = self.scene if true is None else self._extended(true)
        return MovingCaster(scene, self.motion, ExactCaster)

    def solid(self) -> MovingCaster:
        """The same motion without leaves."""
        scene, shapes = self.scene, {}
        for number, shape in self.motion.shapes.items():
            mesh = scene.meshes[scene.mesh_index[number]]
            kept = np.unique(mesh.triangles[mesh.part != LEAF])
            shapes[number] = ShapePath(shape.time, shape.vertices[:, kept])
        motion = replace(self.motion, shapes=shapes)
        return MovingCaster(scene.solid(), motion, self._make, self._engine)

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
        both = chosen(self.scene, np.arange(len(self.scene)))
        both.transform[: len(true)] = true.transform
        meshes = (*true.meshes, *self.scene.meshes[len(true.meshes) :])
        return replace(both, meshes=meshes)
