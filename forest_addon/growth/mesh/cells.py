"""Area of a mesh in each cell of a grid: triangles cut exactly at the cells' walls.

Most triangles lie in one cell. A wall that passes through a triangle cuts off the corner that stands alone
on its side, with the share s·t of the area, s and t being the shares of its two edges that do. Of a triangle
that reaches over one wall this is all that is asked. Any other is cut in three by a wall, (1 − s) and
s(1 − t) being the shares of the others, again and again until each piece reaches over one wall at most; of
the walls that it crosses the middle one comes first, so that n cells take log₂ n rounds. Shares add up to
one, so sums over cells are the area of the mesh but for rounding, wherever it lies.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

AT_ONCE = 1 << 16  # triangles: what is in work stays in the cache
DENSE = 4  # cells of a grid for each number to be summed; in a larger one only those that are named are kept
Part = tuple[np.ndarray, np.ndarray, np.ndarray]  # cells, of which triangles, shares of their areas


@dataclass(frozen=True)
class CellAreas:
    """Areas in the cells of a grid that have any.

    cell : (K, 3) int64, cell i reaches from i·edge to (i + 1)·edge along each axis; sorted, no cell twice.
    area : (K, P) m² of each of P parts.
    """

    cell: np.ndarray
    area: np.ndarray


def areas_by_cell(
    vertices: np.ndarray,
    triangles: np.ndarray,
    part: np.ndarray,
    parts: int,
    edge: float,
    area: np.ndarray,
) -> CellAreas:
    """Areas by cell of a mesh.

    vertices : (V, 3) metres. triangles : (T, 3). part : (T,) number of the part that each is of, below
    ``parts``.
    edge : of a cell, metres. area : (T,) of the triangles.
    """
    if not len(triangles):
        return CellAreas(np.empty((0, 3), np.int64), np.empty((0, parts)))
    place = np.ascontiguousarray(
        (vertices / edge).T
    )  # in edges: walls are whole numbers, which are exact
    at = np.floor(place).astype(np.int64)
    grid = _Grid.around(at)
    key = grid.number(at)
    corners = np.ascontiguousarray(triangles.T)
    numbers, kinds, sizes = [], [], []
    for first in range(0, len(triangles), AT_ONCE):
        rows = slice(first, first + AT_ONCE)
        of_part, size = part[rows], area[rows]
        for number, source, share in _shares(place, key, corners[:, rows], grid):
            numbers.append(number)
            kinds.append(of_part[source])
            sizes.append(size[source] * share)
    number, kind, size = (np.concatenate(some) for some in (numbers, kinds, sizes))
    return grid.sums(number, kind, size, parts)


def join_areas(found: list[CellAreas], parts: int) -> CellAreas:
    """The areas of several meshes in the same grid."""
    found = [one for one in found if len(one.cell)]
    if not found:
        return CellAreas(np.empty((0, 3), np.int64), np.empty((0, parts)))
    cell = np.concatenate([one.cell for one in found]).T
    area = np.concatenate([one.area for one in found])
    grid = _Grid.around(cell)
    kind = np.tile(np.arange(parts), len(area))
    return grid.sums(np.repeat(grid.number(cell), parts), kind, area.ravel(), parts)


@dataclass(frozen=True)
class _Grid:
    """A box of cells, numbered in their order: its lowest cell, and how many it has along each axis."""

    low: tuple[int, int, int]
    size: tuple[int, int, int]

    @classmethod
    def around(cls, cell: np.ndarray) -> _Grid:
        """The smallest grid that holds cells (3, N), at least one."""
        low, high = ([int(bound) for bound in of(cell, axis=1)] for of in (np.min, np.max))
        x, y, z = (most - least + 1 for least, most in zip(low, high, strict=True))
        if x * y * z >= 2**63:
            raise ValueError(f"a mesh reaches over {x} x {y} x {z} cells; make the cells larger")
        return cls((low[0], low[1], low[2]), (x, y, z))

    @property
    def count(self) -> int:
        """Number of its cells."""
        return self.size[0] * self.size[1] * self.size[2]

    @property
    def strides(self) -> np.ndarray:
        """(3,) from a cell's number to the next along each axis."""
        return np.array([self.size[1] * self.size[2], self.size[2], 1])

    def number(self, cell: np.ndarray) -> np.ndarray:
        """(N,) numbers of cells (3, N)."""
        number: np.ndarray = (cell[0] - self.low[0]) * self.size[1]
        number += cell[1] - self.low[1]
        number *= self.size[2]
        number += cell[2] - self.low[2]
        return number

    def sums(self, number: np.ndarray, kind: np.ndarray, size: np.ndarray, parts: int) -> CellAreas:
        """Sum up sizes (N,) in cells of these numbers, for each cell and each part."""
        count = self.count
        named: np.ndarray | None = None
        if count * parts > DENSE * len(number):
            named, number = np.unique(number, return_inverse=True)
            count = len(named)
        area = np.bincount(number * parts + kind, size, count * parts).reshape(count, parts)
        some = np.flatnonzero(area.any(axis=1))
        cell = np.unravel_index(some if named is None else named[some], self.size)
        return CellAreas(np.stack(cell, axis=1) + self.low, area[some])


def _shares(place: np.ndarray, key: np.ndarray, corners: np.ndarray, grid: _Grid) -> Iterator[Part]:
    """Cells in which triangles lie, and the share of their area in each.

    place : (3, V) vertices in edges. key : (V,) numbers of their cells. corners : (3, T).
    """
    of_a, of_b, of_c = key[corners]
    together = (of_a == of_b) & (of_a == of_c)
    rows = np.flatnonzero(together)
    yield of_a[rows], rows, np.ones(len(rows))

    source = np.flatnonzero(~together)
    pieces = np.moveaxis(place[:, corners[:, source]], -1, 0)
    share = np.ones(len(pieces))
    while len(pieces):
        low, high = (
            of(of(pieces[:, :, 0], pieces[:, :, 1]), pieces[:, :, 2])
            for of in (np.minimum, np.maximum)
        )
        low = np.floor(low)
        walls = np.maximum(np.ceil(high) - low - 1, 0)  # that it really passes
        number = grid.number(low.astype(np.int64).T)
        axis = np.argmax(walls, axis=1)
        rows = np.arange(len(pieces))
        many, wall = walls.sum(axis=1), low[rows, axis] + np.ceil(walls[rows, axis] / 2)
        none, one, more = (
            np.flatnonzero(many == 0),
            np.flatnonzero(many == 1),
            np.flatnonzero(many > 1),
        )
        yield number[none], source[none], share[none]
        below = _share_below(pieces[one, axis[one]].T, wall[one])
        yield number[one], source[one], share[one] * below
        yield number[one] + grid.strides[axis[one]], source[one], share[one] * (1.0 - below)
        pieces, share = _split(pieces[more], share[more], axis[more], wall[more])
        source = np.tile(source[more], 3)


def _share_below(along: Sequence[np.ndarray] | np.ndarray, wall: np.ndarray) -> np.ndarray:
    """(T,) share of the area of triangles that lies below a wall, by their three corners across it."""
    a, b, c = (corner - wall for corner in along)
    up_a, up_b, up_c = a >= 0, b >= 0, c >= 0
    lone_up = up_a.astype(np.int8) + up_b + up_c == 1
    of_b, of_c = up_b == lone_up, up_c == lone_up
    of_b &= up_a != lone_up
    of_c &= up_a != lone_up
    tip = np.where(of_b, b, np.where(of_c, c, a))
    one, two = np.where(of_b, a, b), np.where(of_c, a, c)
    cut_off = tip / (tip - one) * (tip / (tip - two))
    return np.where(lone_up, 1.0 - cut_off, cut_off)


def _split(
    pieces: np.ndarray, share: np.ndarray, axis: np.ndarray, wall: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (T, axis, corner) cut in three by a wall each that they pass, and their shares."""
    rows = np.arange(len(pieces))
    up = pieces[rows, axis] >= wall[:, None]
    lone_up = up.sum(axis=1) == 1
    lone = np.argmax(up == lone_up[:, None], axis=1)
    a, b, c = (pieces[rows, :, (lone + turn) % 3] for turn in range(3))
    tip = a[rows, axis] - wall
    ends = []
    for end in (b, c):
        part = np.clip(tip / (a[rows, axis] - end[rows, axis]), 0.0, 1.0)
        place = a + part[:, None] * (end - a)
        place[rows, axis] = wall
        ends.append((part, place))
    (s, ab), (t, ac) = ends
    three = ((a, ab, ac), (ab, b, c), (ab, c, ac))
    cuts = np.concatenate([np.stack(one, axis=2) for one in three])
    return cuts, np.concatenate([share * s * t, share * (1.0 - s), share * s * (1.0 - t)])
