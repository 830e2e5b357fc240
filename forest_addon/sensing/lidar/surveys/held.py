"""Rays among parts that go by steps and stand for many pulses between: each stretch is a still scene."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import gcd

import numpy as np

from ...rays.caster import Hits, RayCaster, hit_normals
from ...rays.geometry import SceneGeometry, invert_transforms
from ...rays.moving import MovingCaster
from .stepped import SteppedMotion, SteppedPath

FEWEST = 5_000  # pulses of a stretch that are worth a scene of their own


@dataclass(frozen=True)
class _Stretch:
    """A still scene and its caster, and (I, 3, 4) by how much the places of its parts change a second."""

    caster: RayCaster
    scene: SceneGeometry
    change: np.ndarray


class HeldCaster(MovingCaster):
    """Closest hits of rays at times of their own, in a scene whose parts stand for many pulses.

    A time belongs to the stretch of the pulse that is sent then, in which no part takes a step.
    """

    def __init__(
        self,
        scene: SceneGeometry,
        motion: SteppedMotion,
        make: Callable[[SceneGeometry], RayCaster],
    ) -> None:
        super().__init__(scene, motion, make)
        self._paths: dict[int, SteppedPath] = motion.paths  # type: ignore[assignment]
        self._pulses = stretch_of(motion)
        self._made: tuple[int, _Stretch] | None = None

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
        count = len(origins)
        far, near = (np.broadcast_to(limit, count) for limit in (max_distance, min_distance))
        nothing = np.full(count, -1)
        found = Hits(np.full(count, np.inf), nothing, nothing.copy())
        for rows, stretch in self._stretches(time):
            hits = stretch.caster.cast(
                origins[rows],
                directions[rows],
                far[rows],
                min_distance=near[rows],
                leaving=None if leaving is None else leaving.select(rows),
            )
            for name, column in vars(found).items():
                column[rows] = getattr(hits, name)
        return found

    def normals(self, hits: Hits, time: np.ndarray) -> np.ndarray:
        found = np.empty((len(hits.distance), 3))
        for rows, stretch in self._stretches(time):
            found[rows] = hit_normals(stretch.scene, hits.select(rows))
        return found

    def velocities(
        self, points: np.ndarray, instance: np.ndarray, triangle: np.ndarray, time: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        velocity, rest = np.zeros_like(points), points.copy()
        for every, stretch in self._stretches(time):
            rows = every[np.isin(instance[every], self.motion.rows)]
            part = instance[rows]
            inverse = invert_transforms(stretch.scene.transform[part])
            own = np.einsum("rij,rj->ri", inverse[:, :, :3], points[rows]) + inverse[:, :, 3]
            for to, at in ((velocity, stretch.change[part]), (rest, self.scene.transform[part])):
                to[rows] = np.einsum("rij,rj->ri", at[:, :, :3], own) + at[:, :, 3]
        return velocity, rest

    def _stretches(self, time: np.ndarray) -> Iterator[tuple[np.ndarray, _Stretch]]:
        """Rows of times (R,) and their stretch, one after the other."""
        which = next(iter(self._paths.values())).sent(time) // self._pulses
        for number in np.unique(which).tolist():
            yield np.flatnonzero(which == number), self._stretch(number)

    def _stretch(self, number: int) -> _Stretch:
        if self._made is None or self._made[0] != number:
            at, change = self.scene.transform.copy(), np.zeros_like(self.scene.transform)
            for part, path in self._paths.items():
                at[part], change[part] = path.after(number * self._pulses)
            scene = replace(self.scene, transform=at)
            scene.share_table(self.scene.table)
            self._made = number, _Stretch(self._make(scene), scene, change)
        return self._made[1]


def stretch_of(motion: SteppedMotion) -> int:
    """Pulses from a step of a part to the next one of any, at least."""
    return gcd(*(path.every for path in motion.paths.values()))  # type: ignore[attr-defined]
