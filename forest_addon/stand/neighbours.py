"""Pairs of points that may be near each other, found in a grid of bins.

A bin is at least as wide as the reach, so what is near a point is in its own bin or the eight around it.
Points are sorted by bin, row by row: the three bins of a row are one run of that order. Pairs come in
portions of bounded size.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

PORTION = 2_000_000  # pairs at once
PER_BIN = 1.0  # points of a bin on average, at least


class Neighbours:
    """Points (N, 2) sorted into bins, for distances of up to ``reach``."""

    def __init__(self, points: np.ndarray, reach: float) -> None:
        self._low = points.min(axis=0)
        span = points.max(axis=0) - self._low
        side = max(reach, float(np.sqrt(max(span.prod(), 0.0) * PER_BIN / len(points))))
        side = max(side, float(span.max()) / (4 * len(points) + 16), 1e-300)
        self._side = side * (1 + 1e-9)  # rounding of the division
        self._columns, self._rows = (span // self._side).astype(np.int64) + 1
        column, row = self._bin(points)
        home = row * self._columns + column
        self._order = np.argsort(home, kind="stable")
        self._home = home[self._order]

    def pairs(self, queries: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Numbers of queries (Q, 2) and of points: every pair within reach, and others, in portions."""
        column, row = self._bin(queries)
        left = np.maximum(column - 1, 0)
        right = np.minimum(column + 1, self._columns - 1)
        for step in (-1, 0, 1):
            at = row + step
            known = (at >= 0) & (at < self._rows) & (left < self._columns) & (right >= 0)
            query = np.flatnonzero(known)
            first = np.searchsorted(self._home, (at * self._columns + left)[query], "left")
            last = np.searchsorted(self._home, (at * self._columns + right)[query], "right")
            yield from self._runs(query, first, np.maximum(last - first, 0))

    def _runs(
        self, query: np.ndarray, first: np.ndarray, count: np.ndarray
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        done = np.cumsum(count)
        start = 0
        while start < len(query):
            before = done[start - 1] if start else 0
            end = max(start + 1, int(np.searchsorted(done, before + PORTION, "right")))
            n = count[start:end]
            owner = np.repeat(np.arange(start, end), n)
            place = np.arange(len(owner)) - np.repeat(np.cumsum(n) - n, n)
            yield query[owner], self._order[first[owner] + place]
            start = end

    def _bin(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        number = np.floor((points - self._low) / self._side).astype(np.int64)
        return number[:, 0], number[:, 1]
