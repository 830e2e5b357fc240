"""What stops flyers in a world: how much room there is around a place, and where a way first touches.

``room`` bounds the distance to the nearest solid from below and is one look-up for all flyers; only whose
step does not fit into it is looked at with the triangles themselves (``sweep``), so the answer is exact and
nearly always free. Instances stand in a map of squares; stems are endless upright cylinders.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..sensing.rays.geometry import SceneGeometry, invert_transforms
from .solids import Solid, pieces_of
from .sweep import distances, first_touch, first_trunk

SQUARE = 2.0  # metres, of the map of what may be near
REACH = 2.0  # metres, beyond which room is not told
LONGEST = 1.0  # metres of a way that are looked at together


class Obstacles(Protocol):
    """What flyers ask of a world."""

    def room(self, place: np.ndarray) -> np.ndarray:
        """(N,) metres around places (N, 3) in which surely nothing stands; at most ``REACH``."""
        ...

    def touch(self, start: np.ndarray, end: np.ndarray, radius: float) -> float:
        """Share of the way from (3,) to (3,) at which a sphere first touches; ``inf``: never."""
        ...


def touched(
    obstacles: Obstacles,
    start: np.ndarray,
    end: np.ndarray,
    radius: float,
    room: np.ndarray | None = None,
) -> np.ndarray:
    """(N,) shares of ways (N, 3) to (N, 3) at which spheres first touch; ``inf``: never.

    room : (N,) known around the starts; left out: asked for.
    """
    room = obstacles.room(start) if room is None else room
    way = end - start
    far = np.sqrt(way[:, 0] ** 2 + way[:, 1] ** 2 + way[:, 2] ** 2)
    share = np.full(len(start), np.inf)
    for row in (far + radius > room).nonzero()[0]:
        share[row] = obstacles.touch(start[row], end[row], radius)
    return share


class MeshObstacles:
    """Instances of meshes.

    solids : for each mesh of the scene, its ``Solid``.
    """

    def __init__(self, scene: SceneGeometry, solids: list[Solid]) -> None:
        usable = np.isfinite(inverse := invert_transforms(scene.transform)).all(axis=(1, 2))
        usable &= ~np.array([solid.empty for solid in solids] or [True])[scene.mesh_index]
        rows = np.flatnonzero(usable)
        self._mesh, self._to_world = scene.mesh_index[rows], scene.transform[rows]
        self._to_local = inverse[rows]
        self._solids = solids
        if not len(rows):
            self._table = np.empty((0, 0), dtype=np.int64)
            return
        stretch = np.linalg.svd(self._to_world[:, :, :3], compute_uv=False)
        self._least, self._most = stretch[:, 2] * (1 - 1e-9), stretch[:, 0] * (1 + 1e-9)
        self._low, self._high = self._boxes()
        # Cells of all meshes in one list; a place beyond a mesh's cells is asked at the nearest cell.
        self._cells = np.concatenate([solid.room.ravel() for solid in solids])
        first = np.cumsum([0, *(solid.room.size for solid in solids)])[:-1]
        self._first, self._cell = first[self._mesh], np.array([s.cell for s in solids])[self._mesh]
        self._shape = np.array([solid.shape for solid in solids])[self._mesh]
        self._corner = np.array([solid.low for solid in solids])[self._mesh]
        self._map()

    def _boxes(self) -> tuple[np.ndarray, np.ndarray]:
        box = np.array([solid.box for solid in self._solids])[self._mesh]  # (I, 2, 3)
        middle, half = box.mean(axis=1), np.ptp(box, axis=1) / 2
        linear = self._to_world[:, :, :3]
        centre = np.einsum("iab,ib->ia", linear, middle) + self._to_world[:, :, 3]
        extent = np.einsum("iab,ib->ia", np.abs(linear), half) + 1e-9
        return centre - extent, centre + extent

    def _map(self) -> None:
        """Which instances may be within ``REACH`` of each square: a table, padded with the last number + 1."""
        small = self._high[:, :2] - self._low[:, :2]
        self._wide = np.flatnonzero((small > 100.0).any(axis=1))  # a ground: everywhere
        narrow = np.flatnonzero((small <= 100.0).all(axis=1))
        low, high = self._low[narrow, :2] - REACH, self._high[narrow, :2] + REACH
        self._map_low = low.min(axis=0, initial=np.inf) if len(narrow) else np.zeros(2)
        top = high.max(axis=0, initial=-np.inf) if len(narrow) else np.ones(2)
        self._squares = np.maximum(np.ceil((top - self._map_low) / SQUARE), 1).astype(np.int64) + 2
        first = np.floor((low - self._map_low) / SQUARE).astype(np.int64)
        span = np.floor((high - self._map_low) / SQUARE).astype(np.int64) - first + 1
        count = span.prod(axis=1)
        item = np.repeat(np.arange(len(narrow)), count)
        place = np.arange(len(item)) - np.repeat(np.cumsum(count) - count, count)
        x, y = np.divmod(place, span[item, 1])
        square = (first[item, 0] + x) * self._squares[1] + first[item, 1] + y
        order = np.argsort(square, kind="stable")
        square, item = square[order], narrow[item[order]]
        total = int(self._squares.prod())
        counts = np.bincount(square, minlength=total)
        starts = np.cumsum(counts) - counts
        width = int(counts.max(initial=0))
        self._none = len(self._mesh)
        self._table = np.full((total + 1, width + len(self._wide)), self._none)
        self._table[square, np.arange(len(square)) - starts[square]] = item
        self._table[:, width:] = self._wide

    def room(self, place: np.ndarray) -> np.ndarray:
        """See ``Obstacles``."""
        if not len(self._mesh):
            return np.full(len(place), REACH)
        near = self._near(place)  # (N, K)
        known = near < self._none
        flyer, which = known.nonzero()[0], near[known]
        at = place[flyer]
        # First the box, which tells the ground and what is far; then the cells.
        away = np.maximum(self._low[which] - at, at - self._high[which])
        np.maximum(away, 0.0, out=away)
        room = np.sqrt(away[:, 0] ** 2 + away[:, 1] ** 2 + away[:, 2] ** 2)
        close = (room < REACH).nonzero()[0]
        which, at = which[close], at[close]
        m = self._to_local[which]
        local = (
            m[:, :, 0] * at[:, :1] + m[:, :, 1] * at[:, 1:2] + m[:, :, 2] * at[:, 2:] + m[:, :, 3]
        )
        cell = np.floor((local - self._corner[which]) / self._cell[which, None])
        shape = self._shape[which]
        within = ((cell >= 0) & (cell < shape)).all(axis=1)
        cell = cell.clip(0, shape - 1).astype(np.int64)
        number = (cell[:, 0] * shape[:, 1] + cell[:, 1]) * shape[:, 2] + cell[:, 2]
        told = self._cells[self._first[which] + number] * self._least[which]
        told[~within] = 0.0
        room[close] = np.maximum(room[close], told)
        least = np.full(len(place), REACH)
        np.minimum.at(least, flyer, room)
        return least

    def _near(self, place: np.ndarray) -> np.ndarray:
        square = np.floor((place[:, :2] - self._map_low) / SQUARE)
        outside = ((square < 0) | (square >= self._squares)).any(axis=1)
        number = square[:, 0] * self._squares[1] + square[:, 1]
        return self._table[np.where(outside, len(self._table) - 1, number).astype(np.int64)]

    def touch(self, start: np.ndarray, end: np.ndarray, radius: float) -> float:
        """See ``Obstacles``."""
        if not len(self._mesh):
            return np.inf
        for share, last in pieces_of(start, end, LONGEST):
            here, there = start + share * (end - start), start + last * (end - start)
            corners = self.around(here, there, radius)
            found = first_touch(here, there - here, radius, corners)
            if np.isfinite(found):
                return share + found * (last - share)
        return np.inf

    def around(self, start: np.ndarray, end: np.ndarray, radius: float) -> np.ndarray:
        """(T, 3, 3) world corners of all triangles within a radius of a way, and of some more."""
        slack = radius * (1 + 1e-9) + 1e-6
        low, high = np.minimum(start, end) - slack, np.maximum(start, end) + slack
        met = ((self._low <= high) & (self._high >= low)).all(axis=1).nonzero()[0]
        found = [np.empty((0, 3, 3))]
        for which in met:
            m, solid = self._to_local[which], self._solids[self._mesh[which]]
            ends = np.stack([start, end]) @ m[:, :3].T + m[:, 3]
            reach = slack / self._least[which]
            rows = solid.near(ends.min(axis=0) - reach, ends.max(axis=0) + reach)
            world = self._to_world[which]
            found.append(solid.corners[rows] @ world[:, :3].T + world[:, 3])
        return np.concatenate(found)

    def distance(self, place: np.ndarray, most: float) -> float:
        """Metres from (3,) to the nearest solid; ``inf`` where that is beyond ``most``."""
        corners = self.around(place, place, most) if len(self._mesh) else np.empty((0, 3, 3))
        found = float(distances(place, corners).min(initial=np.inf))
        return found if found <= most else np.inf


class StemObstacles:
    """Endless upright trunks.

    position : (N, 2) metres. radius : (N,).
    """

    def __init__(self, position: np.ndarray, radius: np.ndarray) -> None:
        from scipy.spatial import cKDTree

        self._position, self._radius = position, radius
        self._thickest = float(radius.max(initial=0.0))
        self._tree = cKDTree(position) if len(position) else None

    def room(self, place: np.ndarray) -> np.ndarray:
        """See ``Obstacles``."""
        if self._tree is None:
            return np.full(len(place), REACH)
        nearest, _ = self._tree.query(place[:, :2])
        return np.clip(nearest - self._thickest, 0.0, REACH)

    def touch(self, start: np.ndarray, end: np.ndarray, radius: float) -> float:
        """See ``Obstacles``."""
        if self._tree is None:
            return np.inf
        way = (end - start)[:2]
        reach = float(np.hypot(*way)) / 2 + radius + self._thickest
        rows = self._tree.query_ball_point((start[:2] + end[:2]) / 2, reach * (1 + 1e-9))
        return float(
            first_trunk(
                start[None, :2],
                way[None],
                (self._radius[rows] + radius)[None],
                self._position[None, rows],
            )[0]
        )


class Together:
    """Several obstacles as one."""

    def __init__(self, *parts: Obstacles) -> None:
        self._parts = parts

    def room(self, place: np.ndarray) -> np.ndarray:
        """See ``Obstacles``."""
        return np.min([part.room(place) for part in self._parts], axis=0)

    def touch(self, start: np.ndarray, end: np.ndarray, radius: float) -> float:
        """See ``Obstacles``."""
        return min(part.touch(start, end, radius) for part in self._parts)
