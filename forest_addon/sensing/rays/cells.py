"""The cells of a grid that straight lines pass, in order, all lines a step at a time (Amanatides & Woo
1987)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Cells:
    """A box of cubic cells: cell i reaches from (low + i)·edge to (low + i + 1)·edge along each axis.

    low : (3,) int64. size : (3,) int64, number of cells.
    """

    low: np.ndarray
    size: np.ndarray
    edge: float

    @classmethod
    def around(cls, cell: np.ndarray, edge: float) -> Cells:
        """The smallest box that holds cells (K, 3)."""
        if not len(cell):
            return cls(np.zeros(3, np.int64), np.zeros(3, np.int64), edge)
        low = cell.min(axis=0).astype(np.int64)
        return cls(low, cell.max(axis=0).astype(np.int64) - low + 1, edge)

    @property
    def count(self) -> int:
        """How many cells."""
        return int(np.prod(self.size))

    def number(self, cell: np.ndarray) -> np.ndarray:
        """(N,) numbers of cells (N, 3) counted from the box's corner, which must lie in it."""
        ny, nz = int(self.size[1]), int(self.size[2])
        return np.asarray((cell[:, 0] * ny + cell[:, 1]) * nz + cell[:, 2])

    def at(self, points: np.ndarray) -> np.ndarray:
        """(N,) numbers of the cells that points (N, 3) lie in, -1 outside of the box."""
        cell = np.floor(points / self.edge).astype(np.int64) - self.low
        inside = ((cell >= 0) & (cell < self.size)).all(axis=1)
        return np.where(inside, self.number(cell), -1)


@dataclass(frozen=True)
class Step:
    """One further cell of each of some lines: which line, which cell, from and to what distance."""

    line: np.ndarray
    cell: np.ndarray
    enter: np.ndarray
    leave: np.ndarray


def walk(
    cells: Cells, origins: np.ndarray, directions: np.ndarray, reach: np.ndarray
) -> Iterator[Step]:
    """Every cell that lines pass from their origin to a distance.

    origins : (R, 3) metres. directions : (R, 3) unit vectors. reach : (R,) metres.
    """
    if not cells.count or not len(origins):
        return
    least = cells.low * cells.edge
    most = (cells.low + cells.size) * cells.edge
    with np.errstate(divide="ignore", invalid="ignore"):
        near, far = (least - origins) / directions, (most - origins) / directions
    # Along an axis that a line does not move on, it is either always within the box or never.
    still = directions == 0
    within = (origins >= least) & (origins < most)
    near, far = np.minimum(near, far), np.maximum(near, far)
    near = np.where(still, np.where(within, -np.inf, np.inf), near)
    far = np.where(still, np.where(within, np.inf, -np.inf), far)
    enter = np.maximum(near.max(axis=1), 0.0)
    end = np.minimum(far.min(axis=1), reach)
    line = np.flatnonzero(enter < end)
    enter, end = enter[line], end[line]
    origin, way = origins[line].T.copy(), directions[line].T.copy()
    sign = np.sign(way).astype(np.int64)
    cell = np.floor((origin + enter * way) / cells.edge).astype(np.int64) - cells.low[:, None]
    cell = np.clip(cell, 0, cells.size[:, None] - 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        wall = (cells.low[:, None] + cell + (sign > 0)) * cells.edge
        following = np.where(sign == 0, np.inf, (wall - origin) / way)
        across = np.where(sign == 0, np.inf, cells.edge / np.abs(way))
    strides = np.array([cells.size[1] * cells.size[2], cells.size[2], 1], np.int64)
    number = cells.number(cell.T)
    while len(line):
        axis = np.argmin(following, axis=0)
        rows = np.arange(len(line))
        leave = np.minimum(following[axis, rows], end)
        yield Step(line, number, enter, np.maximum(leave, enter))
        cell[axis, rows] += sign[axis, rows]
        inside = (cell[axis, rows] >= 0) & (cell[axis, rows] < cells.size[axis])
        number = number + sign[axis, rows] * strides[axis]
        enter = np.maximum(leave, enter)
        following[axis, rows] += across[axis, rows]
        goes_on = np.flatnonzero(inside & (enter < end))
        if len(goes_on) < len(line):
            line, number, enter, end = (a[goes_on] for a in (line, number, enter, end))
            cell, following = cell[:, goes_on], following[:, goes_on]
            sign, across = sign[:, goes_on], across[:, goes_on]


def counts(cells: Cells, numbers: Sequence[np.ndarray]) -> np.ndarray:
    """(X, Y, Z) int32, how often each cell is named."""
    total = np.zeros(cells.count, np.int64)
    for number in numbers:
        total += np.bincount(number, minlength=cells.count)
    return total.astype(np.int32).reshape(cells.size)
