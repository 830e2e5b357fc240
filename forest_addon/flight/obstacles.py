"""Obstacles of flyers in a world: the room around a place, and the first touch along a path.

``room`` bounds the distance to the nearest solid from below, by a look-up for all flyers, and measures it
where that is not enough for a step; only whose step does not fit into it is looked at along its way (below),
so the answer is exact and nearly always free. Instances stand in a map of squares.
"""

from __future__ import annotations

import numpy as np
import scipy
from scipy.spatial import cKDTree

from ..base.rows import distinct, lengths
from ..base.runs import numbered
from ..base.trimesh import LEAF, TriMesh, is_wood
from ..base.vectors import cross_rows, nearest_on_triangles, winding_number
from ..growth.own_tree.centreline import find_centrelines
from ..growth.own_tree.pieces import part
from ..sensing.rays.boxes import swept
from ..sensing.rays.geometry import SceneGeometry, apply_transform, invert_transforms

SQUARE = 2.0  # metres, of the map of what may be near
REACH = 2.0  # metres, beyond which room is not told
LONGEST = 0.5  # metres of a way, or around a place, that are looked at together
AT_ONCE = 64  # such pieces of a way


def touched(
    obstacles: MeshObstacles, start: np.ndarray, end: np.ndarray, radius: float
) -> tuple[np.ndarray, np.ndarray]:
    """(N,) shares of ways (N, 3) to (N, 3) at which spheres first touch, ``inf``: never; and metres around
    the middles of these in which surely nothing stands, -1 where the sphere does not stay in there.
    """
    share, reach = np.full(len(start), np.inf), lengths(end - start) / 2 + radius
    room = obstacles.room((start + end) / 2, reach)
    rows = (reach > room).nonzero()[0]
    if len(rows):
        share[rows] = obstacles.touch(start[rows], end[rows], radius)
        room[rows] = -1.0
    return share, room


class MeshObstacles:
    """Obstacles of a world: instances of meshes; ``moves``: they are others at other times.

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
        boxes = np.array([solid.box for solid in solids])[self._mesh]
        low, high = swept(boxes, self._to_world[None])
        self._low, self._high = low - 1e-9, high + 1e-9
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

    def _map(self) -> None:
        """Instances that may be within ``REACH`` of each square: a table, padded with their
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
        item, place = numbered(count)
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

    def at(self, _time: float) -> MeshObstacles:
        """Return them as they stand at a time, s."""
        return self

    def room(self, place: np.ndarray, wanted: np.ndarray | float = 0.0) -> np.ndarray:
        """(N,) metres around places (N, 3) in which surely nothing stands; at most ``REACH``. Where cells
        tell of less than is wanted (N,), up to ``LONGEST``, it is measured.
        """
        room = self._bound(place)
        rows = ((room < wanted) & (wanted <= LONGEST)).nonzero()[0]
        if len(rows):
            which, corners = self._around(place[rows], place[rows], LONGEST)
            measured = np.full(len(rows), LONGEST)
            np.minimum.at(measured, which, distances(place[rows[which]], corners) * (1 - 1e-9))
            room[rows] = measured
        return room

    def _bound(self, place: np.ndarray) -> np.ndarray:
        """(N,) what cells tell of ``room``."""
        if not len(self._mesh):
            return np.full(len(place), REACH)
        near = self._near(place)  # (N, K)
        known = near < self._none
        flyer, which = known.nonzero()[0], near[known]
        at = place[flyer]
        # First the box, which tells the ground and what is far; then the cells.
        away = np.maximum(self._low[which] - at, at - self._high[which])
        np.maximum(away, 0.0, out=away)
        room = lengths(away)
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
        """(M,) shares of ways (M, 3) to (M, 3) at which spheres first touch; ``inf``: never. Each way is
        taken in pieces, so that few triangles are near each.
        """
        share = np.full(len(start), np.inf)
        if not len(self._mesh):
            return share
        way = end - start
        count = np.maximum(np.ceil(lengths(way) / LONGEST), 1).astype(np.int64)
        for first in range(0, int(count.max()), AT_ONCE):
            rows = np.flatnonzero((count > first) & ~np.isfinite(share))
            if not len(rows):
                break
            which, piece = numbered(np.minimum(count[rows] - first, AT_ONCE))
            row = rows[which]
            step = way[row] / count[row, None]
            here = start[row] + (first + piece)[:, None] * step
            there = here + step
            which, corners = self._around(here, there, radius)
            found = touches(here[which], (there - here)[which], radius, corners)
            np.minimum.at(share, row[which], (first + piece[which] + found) / count[row[which]])
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
        pair, place = numbered(span[:, 0] * span[:, 1])  # lines of cells along z
        x, y = np.divmod(place, span[pair, 1])
        line = (first[pair, 0] + x) * shape[pair, 1] + first[pair, 1] + y
        line = self._first[which[pair]] + line * shape[pair, 2]
        begin, end = self._starts[line + first[pair, 2]], self._starts[line + last[pair, 2] + 1]
        of, place = numbered(end - begin)
        total = len(self._corners)
        key = distinct(pair[of] * total + self._items[begin[of] + place])
        pair, item = np.divmod(key, total)
        row, corners = row[pair], self._placed(which[pair], item)
        met = ((corners.min(axis=1) <= high[row]) & (corners.max(axis=1) >= low[row])).all(axis=1)
        return row[met], corners[met]

    def _astray(self, _place: np.ndarray) -> float:
        """Metres that nothing near places (N, 3) is farther than, from where it was read."""
        return 0.0

    def _own(self, _which: np.ndarray, item: np.ndarray) -> np.ndarray:
        """(T, 3, 3) corners of triangles ``item`` (T,) of instances (T,), in the frames of these."""
        return self._corners[item]

    def _placed(self, which: np.ndarray, item: np.ndarray) -> np.ndarray:
        """(T, 3, 3) corners in the world of triangles ``item`` (T,) of instances (T,)."""
        world, own = self._to_world[which], self._own(which, item)
        return own @ world[:, :, :3].transpose(0, 2, 1) + world[:, None, :, 3]

    def encloses(self, place: np.ndarray) -> bool:
        """Return whether a place (3,) is inside of a trunk, a branch or another closed body: by the winding
        number of each body's triangles in its own frame, the sum of their solid angles (van Oosterom &
        Strackee 1983) over 4π; an open end counts for what it leaves open.
        """
        if not len(self._mesh):
            return False
        slack = self._astray(place[None])
        met = (
            ((self._low <= place + slack) & (self._high >= place - slack)).all(axis=1).nonzero()[0]
        )
        for which in met:
            own_place, solid = apply_transform(self._to_local[which], place), self._mesh[which]
            if not (slack or self._solids[solid].may_enclose(own_place)):
                continue
            item = np.arange(*self._shift[solid : solid + 2])
            if winding_number(own_place, self._own(np.full(len(item), which), item)) > 0.5:
                return True
        return False


# Obstacles in one mesh: its triangles in cells, and the least distance from all of them to each cell.
#
# Wood as thick as asked for, ground and everything that is no leaf counts. ``room`` of a cell is a bound
# from below on the distance from anywhere in it to any of these triangles: the distance between cells
# (Euclidean distance transform of those that some triangle's box overlaps) less a cell's diagonal. Far from
# wood a look-up tells that nothing is near; near it, the triangles of the cells around are the only ones to
# be asked.


CELLS = 400_000  # of a mesh
FINEST = 0.05  # metres, a cell's edge
MARGIN = 1.5  # metres around the mesh that have cells
MOST = 2_000_000  # cells that triangles are written into


def stopping(mesh: TriMesh, thinnest: float) -> np.ndarray:
    """Numbers of the triangles that stop a flyer: no leaves, no wood thinner than that radius."""
    with np.errstate(invalid="ignore"):
        finite = np.isfinite(mesh.vertices[mesh.triangles].sum(axis=(1, 2)))
    stops = finite & (mesh.part != LEAF)
    wood = np.flatnonzero(stops & is_wood(mesh.part))
    if not thinnest or not len(wood):
        return np.flatnonzero(stops)
    corners = mesh.vertices[mesh.triangles[wood]]
    pieces = part(corners)
    if not pieces.count:
        return np.flatnonzero(stops)
    lines = find_centrelines(pieces)
    places, radius, owner = _along(lines.knot, lines.radius, lines.first)
    middle = corners.mean(axis=1)
    _, same = cKDTree(pieces.vertices[pieces.triangles].mean(axis=1)).query(middle)
    # A triangle is as thick as its own piece is nearest to it: a twig that leaves a trunk thins none of it.
    apart = 10.0 * (1.0 + np.ptp(middle, axis=0).max())
    tree = cKDTree(np.column_stack([places, apart * owner]))
    _, nearest = tree.query(np.column_stack([middle, apart * pieces.piece[same]]))
    stops[wood] = radius[nearest] >= thinnest
    return np.flatnonzero(stops)


def _along(
    knot: np.ndarray, radius: np.ndarray, first: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places along centrelines a radius or so apart, how thick the wood is there, and the line of each."""
    starts = np.setdiff1d(np.arange(len(knot) - 1), first[1:-1] - 1)
    length = np.linalg.norm(knot[starts + 1] - knot[starts], axis=1)
    count = np.clip(np.ceil(length / np.maximum(radius[starts], 1e-3)), 1, 64).astype(np.int64)
    which, place = numbered(count)
    row, share = starts[which], place / count[which]
    places = knot[row] + share[:, None] * (knot[row + 1] - knot[row])
    thick = radius[row] + share * (radius[row + 1] - radius[row])
    line = np.searchsorted(first, np.concatenate([row, np.arange(len(knot))]), side="right") - 1
    return np.concatenate([places, knot]), np.concatenate([thick, radius]), line


class Solid:
    """The stopping triangles of a mesh in local space.

    corners : (T, 3, 3). low : (3,) where the cells start. cell : metres. room : (X, Y, Z) float32, metres.
    items : triangles by cell, cell after cell; count : (X·Y·Z,) how many each has.
    """

    def __init__(self, mesh: TriMesh, thinnest: float) -> None:
        self.corners = mesh.vertices[mesh.triangles[stopping(mesh, thinnest)]]
        self.empty = not len(self.corners)
        first, second, third = self.corners.transpose(1, 0, 2)
        self._area = lengths(cross_rows(second - first, third - first)) / 2
        self._middle = self.corners.mean(axis=1)
        self._size = np.linalg.norm(self.corners - self._middle[:, None], axis=2).max(axis=1)
        ends = np.zeros((1, 3)) if self.empty else self.corners.reshape(-1, 3)
        self.box = ends.min(axis=0), ends.max(axis=0)
        self.low = self.box[0] - MARGIN
        extent = self.box[1] - self.box[0] + 2 * MARGIN
        self.cell = max(FINEST, float(np.cbrt(extent.prod() / CELLS)))
        self.shape = np.maximum(np.ceil(extent / self.cell), 1).astype(np.int64)
        self._file()
        away = (
            scipy.ndimage.distance_transform_edt((self.count == 0).reshape(self.shape)) * self.cell
        )
        bound = np.maximum(away - np.sqrt(3) * self.cell, 0.0)
        self.room = (bound * (1 - 1e-6)).astype(np.float32)

    def may_enclose(self, place: np.ndarray) -> bool:
        """Return whether its triangles may fill half of all directions from a place (3,): each fills at most
        its area over the square of the least distance.
        """
        away = np.maximum(lengths(self._middle - place) - self._size, 1e-9)
        return bool((self._area / away**2).sum() > 0.99 * 2 * np.pi)

    def _file(self) -> None:
        """Write every triangle into the cells that its box overlaps."""
        slack = 1e-6 * self.cell
        first = np.floor((self.corners.min(axis=1) - self.low - slack) / self.cell).astype(np.int64)
        last = np.floor((self.corners.max(axis=1) - self.low + slack) / self.cell).astype(np.int64)
        first, last = np.maximum(first, 0), np.minimum(last, self.shape - 1)
        # Few triangles over very many cells are a ground.
        while (last - first + 1).prod(axis=1).sum() > MOST:
            self.cell *= 2.0
            self.shape = np.maximum(-(-self.shape // 2), 1)
            first, last = first // 2, last // 2
        span = last - first + 1
        item, place = numbered(span.prod(axis=1))
        across = span[item]
        x, rest = np.divmod(place, across[:, 1] * across[:, 2])
        y, z = np.divmod(rest, across[:, 2])
        cells = first[item] + np.stack([x, y, z], axis=1)
        number = (cells[:, 0] * self.shape[1] + cells[:, 1]) * self.shape[2] + cells[:, 2]
        self.items = item[np.argsort(number, kind="stable")]
        self.count = np.bincount(number, minlength=int(self.shape.prod()))


# First touch of a moving sphere: triangles, in closed form.
#
# A sphere of radius r goes from p along w. Its centre first comes within r of a triangle on one of the
# surfaces that bound all such places: the triangle's plane shifted by r, a cylinder of radius r around an
# edge, a sphere around a corner. Each gives a root of at most the second degree in the share t of the way,
# so nothing is stepped and nothing can be jumped over, however long the way is. All in float64; roots are
# taken as c/(√(b² - ac) - b), which loses no digits.


NEXT = (1, 2, 0)


def touches(start: np.ndarray, way: np.ndarray, radius: float, corners: np.ndarray) -> np.ndarray:
    """(T,) shares of ways at which spheres touch one triangle each of (T, 3, 3); ``inf``: never.

    start, way : (3,) or (T, 3).
    """
    start, way = (np.broadcast_to(v, (len(corners), 3)) for v in (start, way))
    share = _faces(start, way, radius, corners)
    for k, n in enumerate(NEXT):
        np.minimum(share, _edges(start, way, radius, corners[:, k], corners[:, n]), out=share)
        corner = first_within(start - corners[:, k], way, radius)
        np.minimum(share, np.where(corner <= 1, corner, np.inf), out=share)
    share[distances(start, corners) <= radius] = 0.0
    return share


def distances(point: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(T,) metres from a point (3,), or (T, 3) one each, to triangles (T, 3, 3)."""
    point = np.broadcast_to(point, (len(corners), 3))
    return lengths(point - nearest_on_triangles(point, corners))


def _faces(start: np.ndarray, way: np.ndarray, radius: float, corners: np.ndarray) -> np.ndarray:
    """Shares of ways at which spheres touch the insides of triangles."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = lengths(normal)
    normal /= np.where(length > 0, length, 1.0)[:, None]
    high = np.einsum("ti,ti->t", start - corners[:, 0], normal)
    side = np.sign(high)
    towards = side * np.einsum("ti,ti->t", way, normal)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = (np.abs(high) - radius) / -towards
        met = (share >= 0) & (share <= 1) & (towards < 0) & (length > 0)
    share[~met] = np.inf
    rows = met.nonzero()[0]
    if len(rows):
        n, some = normal[rows], share[rows, None]
        foot = start[rows] + some * way[rows] - radius * side[rows, None] * n
        inside = np.ones(len(rows), dtype=bool)
        for one, other in enumerate(NEXT):
            edge = corners[rows, other] - corners[rows, one]
            turn = np.cross(edge, foot - corners[rows, one])
            inside &= np.einsum("ti,ti->t", turn, n) >= 0
        share[rows[~inside]] = np.inf
    return share


def _edges(
    start: np.ndarray, way: np.ndarray, radius: float, one: np.ndarray, other: np.ndarray
) -> np.ndarray:
    """Shares at which spheres touch edges (T, 3), (T, 3) between their ends: at right angles to each, a
    circle."""
    edge, away = other - one, start - one
    square = np.einsum("ti,ti->t", edge, edge)
    size = np.maximum(square, 1e-300)
    away_along, way_along = (np.einsum("ti,ti->t", v, edge) / size for v in (away, way))
    share = first_within(away - away_along[:, None] * edge, way - way_along[:, None] * edge, radius)
    with np.errstate(invalid="ignore"):
        along = away_along + share * way_along
        met = (share <= 1) & (along >= 0) & (along <= 1) & (square > 0)
    return np.where(met, share, np.inf)


def first_within(away: np.ndarray, way: np.ndarray, reach: np.ndarray | float) -> np.ndarray:
    """(...,) shares of ways (..., D) at which points ``away`` (..., D) from centres first come within
    ``reach`` (...,) of them; ``inf``: never, or they are there."""
    pairs = (way, way), (away, way), (away, away)
    a, b, square = (np.einsum("...i,...i", one, other) for one, other in pairs)
    c = square - reach**2
    with np.errstate(invalid="ignore", divide="ignore"):
        share = c / (np.sqrt(b * b - a * c) - b)
    return np.where((b < 0) & (share >= 0), share, np.inf)
