"""A grid of values with bilinear meaning: an image laid over the ground.

A pixel's value counts at its centre; between four centres the surface is bilinear, over the outer half
pixels constant. Rows are kept from south to north, with one more node on every side that repeats the
edge, so every place of the image lies in a patch between four nodes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .pyramid import Pyramid


@dataclass(frozen=True)
class Grid:
    """nodes : (rows + 2, columns + 2), south first, edges repeated. low, high : (2,) corners, metres."""

    nodes: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def of_image(cls, pixels: np.ndarray, low: np.ndarray, size: np.ndarray) -> Grid:
        """The grid of an image (rows, columns), its first row the north edge."""
        nodes = np.pad(np.asarray(pixels, dtype=np.float64)[::-1], 1, mode="edge")
        low = np.asarray(low, dtype=np.float64)
        return cls(nodes, low, low + np.asarray(size, dtype=np.float64))

    @property
    def step(self) -> np.ndarray:
        """(2,) size of a pixel along x and y."""
        rows, columns = self.nodes.shape
        return (self.high - self.low) / np.array([columns - 2, rows - 2])

    def inside(self, points: np.ndarray) -> np.ndarray:
        """(N,) bool, whether points (N, 2) lie on the image, its edge included."""
        return np.asarray(((points >= self.low) & (points <= self.high)).all(axis=1))

    def at(self, points: np.ndarray) -> np.ndarray:
        """(N,) values at points (N, 2); beyond the image those of its edge."""
        corner, part = self._locate(points)
        a, b, c, d = self._corners(corner)
        south, north = a + (b - a) * part[:, 0], c + (d - c) * part[:, 0]
        return np.asarray(south + (north - south) * part[:, 1])

    def gradient(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) exact derivatives along x and y."""
        corner, part = self._locate(points)
        a, b, c, d = self._corners(corner)
        along_x = (b - a) + ((d - c) - (b - a)) * part[:, 1]
        along_y = (c - a) + ((d - b) - (c - a)) * part[:, 0]
        return np.column_stack([along_x, along_y]) / self.step

    def integral(self, low: np.ndarray, high: np.ndarray) -> float:
        """∫ over a rectangle within the image, closed: each node weighs by its hat function."""
        low, high = np.maximum(low, self.low), np.minimum(high, self.high)
        if (high <= low).any():
            return 0.0
        rows, columns = self.nodes.shape
        (x0, y0), (x1, y1) = self._in_nodes(np.array([low, high]))
        x, y = _hat_integrals(x0, x1, columns), _hat_integrals(y0, y1, rows)
        return float(y @ self.nodes @ x * np.prod(self.step))

    def value_ranges(self) -> Pyramid:
        """Smallest and largest value of every patch."""
        corners = self._patches(self.nodes)
        return Pyramid(np.minimum.reduce(corners), np.maximum.reduce(corners))

    def steepness_ranges(self) -> Pyramid:
        """Smallest and largest |gradient| of every patch, exact: its x part depends on y alone, its y
        part on x alone.
        """
        a, b, c, d = self._patches(self.nodes)
        x, y = np.stack([b - a, d - c]) / self.step[0], np.stack([c - a, d - b]) / self.step[1]
        most = np.hypot(np.abs(x).max(axis=0), np.abs(y).max(axis=0))
        least = np.hypot(
            *(np.where(np.ptp(np.sign(k), axis=0) < 2, np.abs(k).min(axis=0), 0.0) for k in (x, y))
        )
        return Pyramid(least, most)

    def patches_of(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First and last patch, (C, 2) rows and columns, that cells (C, 2) reach."""
        return self._locate(low)[0][:, ::-1], self._locate(high)[0][:, ::-1]

    def exact_range(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest value over cells (C, 2) that reach at most two patches along each axis.

        Bilinear, so the extremes lie where the cell's edges and the lines between patches cross.
        """
        line = self.low + (self._locate(high)[0] - 0.5) * self.step
        middle = np.clip(line, low, high)
        least, most = np.full(len(low), np.inf), np.full(len(low), -np.inf)
        for x in (low[:, 0], middle[:, 0], high[:, 0]):
            for y in (low[:, 1], middle[:, 1], high[:, 1]):
                value = self.at(np.column_stack([x, y]))
                np.minimum(least, value, out=least)
                np.maximum(most, value, out=most)
        return least, most

    def _in_nodes(self, points: np.ndarray) -> np.ndarray:
        counts = np.array(self.nodes.shape[::-1])
        return np.clip((points - self.low) / self.step + 0.5, 0.5, counts - 1.5)

    def _locate(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """South-west node (N, 2) int64 as column and row, and where in its patch, 0 to 1."""
        place = self._in_nodes(points)
        corner = place.astype(np.int64)
        return corner, place - corner

    def _corners(self, corner: np.ndarray) -> tuple[np.ndarray, ...]:
        width = self.nodes.shape[1]
        flat, first = self.nodes.ravel(), corner[:, 1] * width + corner[:, 0]
        return flat[first], flat[first + 1], flat[first + width], flat[first + width + 1]

    @staticmethod
    def _patches(nodes: np.ndarray) -> tuple[np.ndarray, ...]:
        return nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, :-1], nodes[1:, 1:]


def _hat_integrals(low: float, high: float, count: int) -> np.ndarray:
    """(count,) ∫ of the hat function of each node from ``low`` to ``high``, in node spacings."""

    def up_to(x: float) -> np.ndarray:
        t = np.clip(x - np.arange(count), -1, 1)
        return np.where(t < 0, (t + 1) ** 2 / 2, 1 - (1 - t) ** 2 / 2)

    return up_to(high) - up_to(low)
