"""Obstacles of flyers in a world: the room around a place, and the first touch along a path.

``room`` bounds the distance to the nearest solid from below and is one look-up for all flyers; only whose
step does not fit into it is looked at with the triangles themselves (``sweep``), so the answer is exact and
nearly always free. Instances stand in a map of squares; stems are endless upright cylinders.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..sensing.rays.geometry import SceneGeometry, invert_transforms
from .solids import Solid, repeated
from .sweep import distances, first_trunk, touches

SQUARE = 2.0  # metres, of the map of what may be near
REACH = 2.0  # metres, beyond which room is not told
LONGEST = 0.5  # metres of a way that are looked at together
AT_ONCE = 64  # such pieces of a way


class Obstacles(Protocol):
    """Protocol of the obstacles of a world; ``moves``: they are others at other times."""

    moves: bool

    def at(self, time: float) -> Obstacles:
        """Return them as they stand at a time, s."""
        ...

    def room(self, place: np.ndarray) -> np.ndarray:
        """(N,) metres around places (N, 3) in which surely nothing stands; at most ``REACH``."""
        ...

    def touch(self, start: np.ndarray, end: np.ndarray, radius: float) -> np.ndarray:
        """(M,) shares of ways (M, 3) to (M, 3) at which spheres first touch; ``inf``: never."""
        ...

    def encloses(self, place: np.ndarray) -> bool:
        """Return whether a place (3,) is inside of a trunk, a branch or another closed body."""
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
    rows = (far + radius > room).nonzero()[0]
    if len(rows):
        share[rows] = obstacles.touch(start[rows], end[rows], radius)
    return share


class MeshObstacles:
    """Instances of meshes.

    solids : for each mesh of the scene, its ``Solid``.
    """

    moves = False

    def __init__(self, scene: SceneGeometry, solids: list[Solid]) -> None:
        usable = np.isfinite(inverse := invert_transforms(scene.transform)).all(axis=(1, 2))
        usable &= ~np.array([solid.empty for solid in solids] or [True])[scene.mesh_index]
        rows = self.rows = np.flatnonzero(usable)
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
        # Triangles likewise: those of cell c of all are _items[_starts[c] : _starts[c + 1]].
        shift = self._shift = np.cumsum([0, *(len(solid.corners) for solid in solids)])
        self._corners = np.concatenate([solid.corners for solid in solids])
        self._items = np.concatenate([s.items + n for s, n in zip(solids, shift, strict=False)])
        self._starts = np.append(0, np.cumsum(np.concatenate([s.count for s in solids])))
        self._map()

    def _boxes(self) -> tuple[np.ndarray, np.ndarray]:
        box = np.array([solid.box for solid in self._solids])[self._mesh]  # (I, 2, 3)
        middle, half = box.mean(axis=1), np.ptp(box, axis=1) / 2
        linear = self._to_world[:, :, :3]
        centre = np.einsum("iab,ib->ia", linear, middle) + self._to_world[:, :, 3]
        extent = np.einsum("iab,ib->ia", np.abs(linear), half) + 1e-9
        return centre - extent, centre + extent

    def _map(self) -> None:
        """Return which instances may be within ``REACH`` of each square: a table, padded with their
        number."""
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
        item, place = repeated(count)
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

    def at(self, _time: float) -> Obstacles:
        """See ``Obstacles``."""
        return self

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

    def touch(self, start: np.ndarray, end: np.ndarray, radius: float) -> np.ndarray:
        """See ``Obstacles``: each way in pieces, so that few triangles are near each."""
        share = np.full(len(start), np.inf)
        if not len(self._mesh):
            return share
        way = end - start
        far = np.sqrt(way[:, 0] ** 2 + way[:, 1] ** 2 + way[:, 2] ** 2)
        count = np.maximum(np.ceil(far / LONGEST), 1).astype(np.int64)
        for first in range(0, int(count.max()), AT_ONCE):
            rows = np.flatnonzero((count > first) & ~np.isfinite(share))
            if not len(rows):
                break
            which, piece = repeated(np.minimum(count[rows] - first, AT_ONCE))
            row = rows[which]
            step = way[row] / count[row, None]
            here = start[row] + (first + piece)[:, None] * step
            found = self._touches(here, here + step, radius)
            np.minimum.at(share, row, (first + piece + found) / count[row])
        return share

    def _touches(self, here: np.ndarray, there: np.ndarray, radius: float) -> np.ndarray:
        """(P,) shares of short ways at which spheres touch first."""
        share = np.full(len(here), np.inf)
        which, corners = self._around(here, there, radius)
        if len(which):
            found = touches(here[which], (there - here)[which], radius, corners)
            np.minimum.at(share, which, found)
        return share

    def _around(
        self, here: np.ndarray, there: np.ndarray, radius: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Triangles within a radius of short ways, and some more: whose (T,), and world corners (T, 3, 3)."""
        slack = radius * (1 + 1e-9) + 1e-6 + self._astray(here)
        low, high = np.minimum(here, there) - slack, np.maximum(here, there) + slack
        if float((high - low).max(initial=0.0)) < REACH:  # then the map has all that may be met
            near = self._near(here)
            row, column = (near < self._none).nonzero()
            which = near[row, column]
        else:
            row, which = (grid.ravel() for grid in np.indices((len(here), len(self._mesh))))
        met = ((self._low[which] <= high[row]) & (self._high[which] >= low[row])).all(axis=1)
        row, which = row[met], which[met]
        m = self._to_local[which]
        reach = (slack / self._least[which])[:, None]
        ends = [np.einsum("pij,pj->pi", m[:, :, :3], e[row]) + m[:, :, 3] for e in (here, there)]
        cell, corner, shape = self._cell[which, None], self._corner[which], self._shape[which]
        first = np.floor((np.minimum(*ends) - reach - corner) / cell).astype(np.int64)
        last = np.floor((np.maximum(*ends) + reach - corner) / cell).astype(np.int64)
        first, last = np.maximum(first, 0), np.minimum(last, shape - 1)
        span = np.maximum(last - first + 1, 0)
        span[(span == 0).any(axis=1)] = 0
        pair, place = repeated(span[:, 0] * span[:, 1])  # lines of cells along z
        x, y = np.divmod(place, span[pair, 1])
        line = (first[pair, 0] + x) * shape[pair, 1] + first[pair, 1] + y
        line = self._first[which[pair]] + line * shape[pair, 2]
        begin, end = self._starts[line + first[pair, 2]], self._starts[line + last[pair, 2] + 1]
        of, place = repeated(end - begin)
        total = len(self._corners)
        key = np.unique(pair[of] * total + self._items[begin[of] + place])
        pair, item = np.divmod(key, total)
        return row[pair], self._placed(which[pair], item)

    def _astray(self, _place: np.ndarray) -> float:
        """Metres that nothing near places (N, 3) is farther than, from where it was read."""
        return 0.0

    def _placed(self, which: np.ndarray, item: np.ndarray) -> np.ndarray:
        """(T, 3, 3) corners in the world of triangles ``item`` (T,) of instances (T,)."""
        world, own = self._to_world[which], self._corners[item]
        return own @ world[:, :, :3].transpose(0, 2, 1) + world[:, None, :, 3]

    def encloses(self, place: np.ndarray) -> bool:
        """See ``Obstacles``: by the winding number of each body's triangles, the sum of their solid angles
        (van Oosterom & Strackee 1983) over 4π; an open end counts for what it leaves open.
        """
        if not len(self._mesh):
            return False
        slack = self._astray(place[None])
        met = (
            ((self._low <= place + slack) & (self._high >= place - slack)).all(axis=1).nonzero()[0]
        )
        for which in met:
            count, first = (
                len(self._solids[self._mesh[which]].corners),
                self._shift[self._mesh[which]],
            )
            own = self._placed(np.full(count, which), first + np.arange(count))
            a, b, c = (own - place).transpose(1, 0, 2)
            la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
            top = np.einsum("ti,ti->t", a, np.cross(b, c))
            dot = np.einsum
            low = la * lb * lc + dot("ti,ti->t", a, b) * lc
            low += dot("ti,ti->t", b, c) * la + dot("ti,ti->t", c, a) * lb
            if abs(2.0 * np.arctan2(top, low).sum()) > 2.0 * np.pi:
                return True
        return False

    def distance(self, place: np.ndarray, most: float) -> float:
        """Metres from (3,) to the nearest solid; ``inf`` where that is beyond ``most``."""
        if not len(self._mesh):
            return np.inf
        _, corners = self._around(place[None], place[None], most)
        found = float(distances(place, corners).min(initial=np.inf))
        return found if found <= most else np.inf


class StemObstacles:
    """Endless upright trunks.

    position : (N, 2) metres. radius : (N,).
    """

    moves = False

    def __init__(self, position: np.ndarray, radius: np.ndarray) -> None:
        from scipy.spatial import cKDTree

        self._position, self._radius = position, radius
        self._thickest = float(radius.max(initial=0.0))
        self._tree = cKDTree(position) if len(position) else None

    def at(self, _time: float) -> Obstacles:
        """See ``Obstacles``."""
        return self

    def room(self, place: np.ndarray) -> np.ndarray:
        """See ``Obstacles``."""
        if self._tree is None:
            return np.full(len(place), REACH)
        nearest, _ = self._tree.query(place[:, :2])
        return np.clip(nearest - self._thickest, 0.0, REACH)

    def touch(self, start: np.ndarray, end: np.ndarray, radius: float) -> np.ndarray:
        """See ``Obstacles``."""
        share = np.full(len(start), np.inf)
        if self._tree is None:
            return share
        way = (end - start)[:, :2]
        reach = (np.hypot(*way.T) / 2 + radius + self._thickest) * (1 + 1e-9)
        near = self._tree.query_ball_point((start[:, :2] + end[:, :2]) / 2, reach)
        for row, rows in enumerate(near):
            if rows:
                thick = (self._radius[rows] + radius)[None]
                share[row] = first_trunk(
                    start[row : row + 1, :2], way[row : row + 1], thick, self._position[None, rows]
                )[0]
        return share

    def encloses(self, place: np.ndarray) -> bool:
        """See ``Obstacles``."""
        return bool((np.hypot(*(self._position - place[:2]).T) < self._radius).any())
