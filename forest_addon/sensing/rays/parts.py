"""Rays at a scene that moves, part by part, each in its own frame: what any caster of still scenes can do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from .bent import BentCaster
from .boxes import BoxTree
from .caster import Hits, RayCaster
from .geometry import SceneGeometry, invert_transforms
from .paths import SceneMotion

STILL = np.eye(3, 4)


class MotionEngine(Protocol):
    """Search for hits in a scene that moves, by whatever tree."""

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


class PartByPart:
    """Rays at a scene that moves, each part in its own frame by a caster of its own."""

    def __init__(
        self, scene: SceneGeometry, motion: SceneMotion, make: Callable[[SceneGeometry], RayCaster]
    ) -> None:
        self._motion = motion
        moves = np.zeros(len(scene), dtype=bool)
        moves[motion.rows] = True
        self._still_number = np.flatnonzero(~moves)
        self._still = make(chosen(scene, self._still_number))
        self._parts: list[Any] = []
        boxes = np.empty((len(motion.rows), 2, 3))
        for row, n in enumerate(motion.rows.tolist()):
            if n in motion.shapes:
                mesh, shape = scene.meshes[scene.mesh_index[n]], motion.shapes[n]
                self._parts.append(BentCaster(mesh, shape))
                box = shape.bounds()
            else:
                alone = chosen(scene, [n], STILL)
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


def chosen(
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
        optics=None if scene.optics is None else scene.optics[rows],
    )


def _renumbered(hits: Hits, numbers: np.ndarray) -> Hits:
    """Hits with instances as rows of ascending ``numbers``; -1 where they are not among them."""
    if not len(numbers):
        return replace(hits, instance=np.full_like(hits.instance, -1))
    row = np.minimum(np.searchsorted(numbers, hits.instance), len(numbers) - 1)
    return replace(hits, instance=np.where(numbers[row] == hits.instance, row, -1))
