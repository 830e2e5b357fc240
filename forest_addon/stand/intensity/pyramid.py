"""Smallest and largest of a grid's cells over any rectangle of them.

Every level halves the one below, so a rectangle of any size is covered by at most three blocks along each
axis of the level whose blocks are half its extent or more. What is found is a true bound; it is exact for
rectangles of up to two cells, because those are looked up themselves.
"""

from __future__ import annotations

import numpy as np


class Pyramid:
    """Ranges of a grid of cells (rows, columns), each with its own smallest and largest value."""

    def __init__(self, lowest: np.ndarray, highest: np.ndarray) -> None:
        lows, highs = [lowest], [highest]
        while max(lows[-1].shape) > 1:
            lows.append(_halve(lows[-1], np.minimum, np.inf))
            highs.append(_halve(highs[-1], np.maximum, -np.inf))
        sizes = np.array([level.size for level in lows])
        self._offset = np.cumsum(sizes) - sizes
        self._width = np.array([level.shape[1] for level in lows])
        self._low = np.concatenate([level.ravel() for level in lows])
        self._high = np.concatenate([level.ravel() for level in highs])

    def over(self, first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(C,) smallest and largest over the cells from ``first`` to ``last``, both included.

        first, last : (C, 2) int64, row and column.
        """
        extent = (last - first + 1).max(axis=1)
        level = np.ceil(np.log2(np.maximum(extent, 2) / 2)).astype(np.int64)
        start, end = first >> level[:, None], last >> level[:, None]
        middle = (start + end) >> 1
        low, high = np.full(len(first), np.inf), np.full(len(first), -np.inf)
        offset, width = self._offset[level], self._width[level]
        for row in (start[:, 0], middle[:, 0], end[:, 0]):
            for column in (start[:, 1], middle[:, 1], end[:, 1]):
                place = offset + row * width + column
                np.minimum(low, self._low[place], out=low)
                np.maximum(high, self._high[place], out=high)
        return low, high


def _halve(level: np.ndarray, pick: np.ufunc, nothing: float) -> np.ndarray:
    rows, columns = level.shape
    even = np.pad(level, ((0, rows % 2), (0, columns % 2)), constant_values=nothing)
    across = pick(even[:, ::2], even[:, 1::2])
    return np.asarray(pick(across[::2], across[1::2]))
