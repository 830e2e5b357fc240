"""Rays in time: rigid parts of a scene move, and each ray meets them where they are at its own time.

A part is cast in its own frame: a ray is taken there by the part's inverse transform at the ray's time, in
float64, and what it meets is exact there as in a still scene. Distances come back by the ray's stretch.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from .boxes import BoxTree
from .caster import Hits, RayCaster, unit_columns
from .geometry import SceneGeometry, invert_transforms
from .referee import Referee

STILL = np.eye(3, 4)


@dataclass(frozen=True)
class RigidPath:
    """Transforms (K, 3, 4), local to world, at ascending times (K,), s, of a part that keeps its shape.

    Between samples places and shears go linearly and turns by the shortest way at an even rate (Shoemake
    1985), so samples must be less than half a turn apart. Before the first and after the last it stands.
    """

    time: np.ndarray
    transform: np.ndarray

    def at(self, time: np.ndarray) -> np.ndarray:
        """(R, 3, 4) transforms at times (R,)."""
        time = np.clip(time, self.time[0], self.time[-1])
        found = np.empty((len(time), 3, 4))
        if len(self.time) == 1:
            found[:] = self.transform[0]
            return found
        place, _, shape = self._factors
        row, share = self._between(time)
        found[:, :, 3] = place[row] + share * (place[row + 1] - place[row])
        stretch = shape[row] + share[:, None] * (shape[row + 1] - shape[row])
        found[:, :, :3] = self._turns(time).as_matrix() @ stretch
        return found

    def velocity(self, points: np.ndarray, time: np.ndarray) -> np.ndarray:
        """(R, 3) m/s of the part's own points (R, 3) at times (R,); at a sample, of what follows."""
        if len(self.time) == 1:
            return np.zeros_like(points)
        place, turn, shape = self._factors
        row, share = self._between(time)
        step = np.diff(self.time)[row, None]
        turned = self._turns(np.clip(time, self.time[0], self.time[-1]))
        rate = (turn[1:] * turn[:-1].inv()).as_rotvec()[row] / step
        bend = shape[row + 1] - shape[row]
        stretched = np.einsum("rij,rj->ri", shape[row] + share[:, None] * bend, points)
        found = (place[row + 1] - place[row]) / step
        found += np.cross(rate, turned.apply(stretched))
        found += turned.apply(np.einsum("rij,rj->ri", bend, points) / step)
        found[(time < self.time[0]) | (time > self.time[-1])] = 0.0
        return found

    def swept(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Box in the world, corners (3,), that a part within a box of its own, corners (3,), never leaves.

        It holds the boxes at all samples. Between two of them, a turn by an angle apart, a point at an arm m
        is at most m times half that angle from the straight line between its places there.
        """
        middle, half = (low + high) / 2, (high - low) / 2
        straight = self.transform[:, :, :3]
        centre = straight @ middle + self.transform[:, :, 3]
        out = np.abs(straight) @ half
        bow = 0.0
        if len(self.time) > 1:
            _, turn, _ = self._factors
            arm = float(np.linalg.norm(np.maximum(np.abs(low), np.abs(high))))
            size = float(np.linalg.norm(straight, ord=2, axis=(1, 2)).max())
            bow = float((turn[1:] * turn[:-1].inv()).magnitude().max()) / 2 * size * arm
        return (centre - out).min(axis=0) - bow, (centre + out).max(axis=0) + bow

    @cached_property
    def _turns(self) -> Slerp:
        return Slerp(self.time, self._factors[1])

    @cached_property
    def _factors(self) -> tuple[np.ndarray, Rotation, np.ndarray]:
        """Places (K, 3), turns and shapes (K, 3, 3) of the samples, by polar decomposition."""
        u, size, v = np.linalg.svd(self.transform[:, :, :3])
        sign = np.where(np.linalg.det(u @ v) < 0, -1.0, 1.0)[:, None, None]
        shape = sign * ((v.transpose(0, 2, 1) * size[:, None, :]) @ v)
        return self.transform[:, :, 3], Rotation.from_matrix(sign * (u @ v)), shape

    def _between(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sample before each time (R,), and the share of the way to the next (R, 1)."""
        row = np.clip(np.searchsorted(self.time, time, "right") - 1, 0, len(self.time) - 2)
        share = (time - self.time[row]) / (self.time[row + 1] - self.time[row])
        return row, np.clip(share, 0.0, 1.0)[:, None]


class PartPath(Protocol):
    """Path of a part that keeps its shape; see ``RigidPath``."""

    def at(self, time: np.ndarray) -> np.ndarray: ...

    def velocity(self, points: np.ndarray, time: np.ndarray) -> np.ndarray: ...

    def swept(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]: ...


class TimedCaster(ABC):
    """Closest hits of rays at times of their own, in a scene that moves.

    scene : what hits are numbered by. within : metres by which places may be off between two samples.
    frozen : names of objects that change their shape, and are taken as they are in ``scene``.
    """

    engine: str
    scene: SceneGeometry
    within: float = 0.0
    frozen: tuple[str, ...] = ()

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

    @abstractmethod
    def judged(self, true: SceneGeometry | None = None) -> TimedCaster:
        """The same motion by a caster that holds the engine against float64, ray by ray.

        true : the scene that is true; left out: its own.
        """

    @abstractmethod
    def transforms(self, instance: np.ndarray, time: np.ndarray) -> np.ndarray:
        """(R, 3, 4) local to world of instances (R,) at times (R,), s; a miss has that of the last one."""

    @abstractmethod
    def velocities(
        self, points: np.ndarray, instance: np.ndarray, time: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(R, 3) m/s of surface points (R, 3), met on instances (R,) at times (R,), and where they are in the
        scene as it stands still, metres."""

    def known(self, instance: np.ndarray, triangle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The numbers that instances and triangles (R,) have in the scene as it was read."""
        return instance, triangle


class MovingCaster(TimedCaster):
    """Closest hits of rays at times of their own, in a scene of which some instances move.

    paths : of the instances that move, by number; each gives the whole transform of its instance.
    make : what makes a caster of a still scene. within : metres by which places between two samples may be
    off. frozen : names of objects that change their shape, and are taken as they are in ``scene``.
    """

    def __init__(
        self,
        scene: SceneGeometry,
        paths: Mapping[int, PartPath],
        make: Callable[[SceneGeometry], RayCaster],
        within: float = 0.0,
        frozen: tuple[str, ...] = (),
    ) -> None:
        self.within, self.frozen = within, frozen
        moves = np.zeros(len(scene), dtype=bool)
        moves[list(paths)] = True
        self.scene, self._paths = scene, paths
        self._still_number = np.flatnonzero(~moves)
        self._still = make(_chosen(scene, self._still_number))
        self._parts = {n: make(_chosen(scene, [n], STILL)) for n in paths}
        boxes = [
            paths[n].swept(*(corner[0] for corner in part.scene.bounds()))
            for n, part in self._parts.items()
        ]
        low, high = np.array(boxes).reshape(-1, 2, 3).transpose(1, 0, 2)
        self._swept = BoxTree(low, high)
        self.engine = self._still.engine

    def judged(self, true: SceneGeometry | None = None) -> MovingCaster:
        """The same motion by a caster that holds the engine against float64, ray by ray.

        true : the scene that is true; left out: its own.
        """
        other, scene = copy(self), self.scene if true is None else true
        other._still = Referee(self._still, _chosen(scene, self._still_number))
        other._parts = {
            n: Referee(part, _chosen(scene, [n], STILL)) for n, part in self._parts.items()
        }
        other.engine = Referee.engine
        return other

    def transforms(self, instance: np.ndarray, time: np.ndarray) -> np.ndarray:
        """(R, 3, 4) local to world of instances (R,) at times (R,), s; a miss has that of the last one."""
        found = self.scene.transform[instance]
        for number, path in self._paths.items():
            rows = np.flatnonzero(instance == number)
            if len(rows):
                found[rows] = path.at(time[rows])
        return found

    def velocities(
        self, points: np.ndarray, instance: np.ndarray, time: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(R, 3) m/s of surface points (R, 3), met on instances (R,) at times (R,), and where they are in the
        scene as it stands still, metres."""
        velocity, rest = np.zeros_like(points), points.copy()
        for number, path in self._paths.items():
            rows = np.flatnonzero(instance == number)
            if not len(rows):
                continue
            inverse = invert_transforms(path.at(time[rows]))
            own = np.einsum("rij,rj->ri", inverse[:, :, :3], points[rows]) + inverse[:, :, 3]
            velocity[rows] = path.velocity(own, time[rows])
            still = self.scene.transform[number]
            rest[rows] = own @ still[:, :3].T + still[:, 3]
        return velocity, rest

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
        if not self._parts:
            return self._still.cast(
                origins, directions, max_distance, min_distance=min_distance, leaving=leaving
            )
        origins = np.asarray(origins, dtype=np.float64)
        ways = unit_columns(np.asarray(directions).T).T
        near = np.broadcast_to(np.asarray(min_distance, dtype=np.float64), len(origins))
        far = np.array(np.broadcast_to(max_distance, len(origins)), dtype=np.float64)
        left = None if leaving is None else _renumbered(leaving, self._still_number)
        best = self._still.cast(origins, ways, far, min_distance=near, leaving=left)
        best.instance[best.found] = self._still_number[best.instance[best.found]]
        sound = np.flatnonzero(np.isfinite(origins.sum(axis=1) + ways.sum(axis=1)))
        start, limit = np.maximum(near[sound], 0.0), np.minimum(far, best.distance)[sound]
        ray, box, _ = self._swept.pairs(origins[sound].T, ways[sound].T, start, limit)
        order = np.argsort(box, kind="stable")
        cuts = np.searchsorted(box[order], np.arange(len(self._parts) + 1))
        for place, (number, part) in enumerate(self._parts.items()):
            rows = sound[ray[order[cuts[place] : cuts[place + 1]]]]
            if len(rows):
                self._cast_part(number, part, (origins, ways, time, near, far), rows, leaving, best)
        return best

    def _cast_part(
        self,
        number: int,
        part: RayCaster,
        rays: tuple[np.ndarray, ...],
        rows: np.ndarray,
        leaving: Hits | None,
        best: Hits,
    ) -> None:
        """Put into ``best`` what these rows of the rays meet nearer in one part."""
        origins, ways, time, near, far = rays
        limit = np.minimum(far, best.distance)
        inverse = invert_transforms(self._paths[number].at(time[rows]))
        begin = np.einsum("rij,rj->ri", inverse[:, :, :3], origins[rows]) + inverse[:, :, 3]
        along = np.einsum("rij,rj->ri", inverse[:, :, :3], ways[rows])
        size = np.linalg.norm(along, axis=1)
        left = None if leaving is None else _renumbered(leaving, np.array([number])).select(rows)
        met = part.cast(
            begin,
            along,
            limit[rows] * size,
            min_distance=near[rows] * size,
            leaving=left,
        )
        distance = met.distance / size
        won = np.flatnonzero(met.found & (distance < best.distance[rows]))
        chosen = Hits(distance[won], np.full(len(won), number), met.triangle[won])
        best.put(rows[won], chosen)


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
