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
        """Number of cells."""
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
    origin, way = origins[line].T, directions[line].T
    low, most = cells.low[:, None], cells.size[:, None] - 1
    first, last = (
        np.clip(np.floor((origin + t * way) / cells.edge).astype(np.int64) - low, 0, most)
        for t in (enter, end)
    )
    # Longest ways first: the lines that still go on are then the first ones, step after step.
    steps = np.abs(last - first).sum(axis=0)
    order = np.argsort(-steps, kind="stable")
    line, enter, end, steps = line[order], enter[order], end[order], steps[order]
    origin, way, first = origin[:, order], way[:, order], first[:, order]
    sign = np.sign(way).astype(np.int64)
    with np.errstate(divide="ignore", invalid="ignore"):
        wall = (low + first + (sign > 0)) * cells.edge
        x, y, z = np.where(
            sign == 0, np.inf, (wall - origin) / way
        )  # where each axis has its next wall
        across = np.where(sign == 0, 0.0, cells.edge / np.abs(way))
    strides = np.array([[cells.size[1] * cells.size[2]], [cells.size[2]], [1]], np.int64)
    onward = sign * strides
    number, last_number = cells.number(first.T), cells.count - 1
    going = len(line) - np.searchsorted(steps[::-1], np.arange(int(steps.max(initial=0)) + 1))
    for count in going.tolist():
        number, enter, x, y, z = number[:count], enter[:count], x[:count], y[:count], z[:count]
        leave = np.minimum(np.minimum(x, y), z)
        over_x, over_y = leave == x, leave == y
        over_y &= ~over_x
        over_z = ~(over_x | over_y)
        # Products with truth values, since writing where something holds is several times slower.
        move = onward[2, :count].copy()
        for axis, (nearest, over) in enumerate(((x, over_x), (y, over_y), (z, over_z))):
            nearest += across[axis, :count] * over
            if axis < 2:
                move += (onward[axis, :count] - move) * over
        np.minimum(leave, end[:count], out=leave)
        np.maximum(leave, enter, out=leave)
        yield Step(line[:count], number, enter, leave)
        # Beyond the box comes no line but by rounding, at its very end.
        move += number
        np.maximum(move, 0, out=move)
        number, enter = np.minimum(move, last_number, out=move), leave


def counts(cells: Cells, numbers: Sequence[np.ndarray]) -> np.ndarray:
    """(X, Y, Z) int32, how often each cell is named."""
    named = np.concatenate([*numbers, np.empty(0, np.int64)])
    return np.bincount(named, minlength=cells.count).astype(np.int32).reshape(cells.size)
