"""A triangle mesh seen from above: which triangle is topmost at a place.

Triangles are projected to the ground plan and sorted into a grid of bins; a point asks the triangles of
its bin, by signed areas in float64, and takes the highest of those that hold it. Triangles on edge have no
area from above and are never met.
"""

from __future__ import annotations

import numpy as np

from .pyramid import Pyramid

PER_BIN = 2.0  # triangles a bin holds on average, as far as sizes allow
CHUNK = 1 << 18
EDGE = 1e-12  # share of a triangle's area that a point may lie outside: neighbours share their edge


class IntensitySurface:
    """vertices : (V, 3) float64, metres. triangles : (T, 3) int64, those with an area from above."""

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray) -> None:
        """Raises ValueError where no triangle has an area from above, or a vertex is not finite."""
        self.vertices = np.asarray(vertices, dtype=np.float64).reshape(-1, 3)
        self.triangles = np.asarray(triangles, dtype=np.int64).reshape(-1, 3)
        if not np.isfinite(self.vertices).all():
            raise ValueError("a vertex of the surface is not finite; mend the mesh")
        corners = self.vertices[self.triangles]
        self._first = corners[:, 0, :2]
        self._sides = corners[:, 1:, :2] - corners[:, :1, :2]  # (T, 2, 2)
        self.area = _cross(self._sides[:, 0], self._sides[:, 1]) / 2  # signed, from above
        self._seen = self.area != 0
        if not self._seen.any():
            raise ValueError("the surface has no area from above; give one that lies flat")
        self.low, self.high = (
            corners[self._seen, :, :2].min(axis=(0, 1)),
            corners[self._seen, :, :2].max(axis=(0, 1)),
        )
        self._fill_bins(corners[:, :, :2])

    def locate(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Topmost triangle (N,) at points (N, 2), -1 where there is none, and its height (N,), NaN."""
        triangle, height = np.full(len(points), -1), np.full(len(points), np.nan)
        for start in range(0, len(points), CHUNK):
            part = slice(start, start + CHUNK)
            triangle[part], height[part] = self._locate(points[part])
        return triangle, height

    def weights(self, points: np.ndarray, triangle: np.ndarray) -> np.ndarray:
        """(N, 3) barycentric coordinates of points in their triangles."""
        offset, sides = points - self._first[triangle], self._sides[triangle]
        double = 2 * self.area[triangle]
        b = _cross(offset, sides[:, 1]) / double
        c = _cross(sides[:, 0], offset) / double
        return np.column_stack([1 - b - c, b, c])

    def interpolate(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """(N,) values (V,) of the vertices, linear over the topmost triangles; NaN off the surface."""
        triangle, _ = self.locate(points)
        found = (self.weights(points, triangle) * values[self.triangles[triangle]]).sum(axis=1)
        return np.where(triangle >= 0, found, np.nan)

    def gradients(self, values: np.ndarray) -> np.ndarray:
        """(T, 2) derivatives along x and y of values (V,) over each triangle; 0 for those on edge."""
        corner = values[self.triangles]
        rise = corner[:, 1:] - corner[:, :1]
        (ax, ay), (bx, by) = self._sides[:, 0].T, self._sides[:, 1].T
        double = np.where(self._seen, 2 * self.area, np.inf)
        return np.column_stack(
            [
                (rise[:, 0] * by - rise[:, 1] * ay) / double,
                (rise[:, 1] * ax - rise[:, 0] * bx) / double,
            ]
        )

    def ranges(self, least: np.ndarray, most: np.ndarray) -> Pyramid:
        """Range over bins of what lies between ``least`` and ``most`` (T,) on each triangle."""
        low, high = np.full(self._count, np.inf), np.full(self._count, -np.inf)
        bins = np.repeat(np.arange(self._count), np.diff(self._start))
        np.minimum.at(low, bins, least[self._members])
        np.maximum.at(high, bins, most[self._members])
        return Pyramid(low.reshape(self._shape), high.reshape(self._shape))

    def bins_of(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First and last bin, (C, 2) rows and columns, of cells (C, 2)."""
        return self._bin(low)[:, ::-1], self._bin(high)[:, ::-1]

    def _fill_bins(self, corners: np.ndarray) -> None:
        span = np.maximum(self.high - self.low, 1e-9)
        wanted = max(1.0, len(self.triangles) / PER_BIN)
        columns = int(np.clip(np.sqrt(wanted * span[0] / span[1]), 1, 2048))
        rows = int(np.clip(wanted / columns, 1, 2048))
        self._shape, self._count = (rows, columns), rows * columns
        self._size = span / np.array([columns, rows])
        seen = np.flatnonzero(self._seen)
        first, last = self._bin(corners[seen].min(axis=1)), self._bin(corners[seen].max(axis=1))
        extent = last - first + 1
        copies = extent.prod(axis=1)
        owner = np.repeat(np.arange(len(seen)), copies)
        number = np.arange(int(copies.sum())) - np.repeat(np.cumsum(copies) - copies, copies)
        column = first[owner, 0] + number % extent[owner, 0]
        row = first[owner, 1] + number // extent[owner, 0]
        place = row * columns + column
        order = np.argsort(place, kind="stable")
        self._members = seen[owner[order]]
        self._start = np.searchsorted(place[order], np.arange(self._count + 1))

    def _bin(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) column and row of the bin of each point; the nearest for those beyond."""
        last = np.array(self._shape[::-1]) - 1
        return np.clip(np.floor((points - self.low) / self._size), 0, last).astype(np.int64)

    def _locate(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        column, row = self._bin(points).T
        home = row * self._shape[1] + column
        count = self._start[home + 1] - self._start[home]
        owner = np.repeat(np.arange(len(points)), count)
        step = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
        candidate = self._members[self._start[home][owner] + step]
        weights = self.weights(points[owner], candidate)
        holds = (weights >= -EDGE).all(axis=1)
        owner, candidate, weights = owner[holds], candidate[holds], weights[holds]
        corner = self.vertices[self.triangles[candidate], 2]
        rise = corner[:, 1:] - corner[:, :1]  # from the first corner: level ground stays level
        height = corner[:, 0] + (weights[:, 1:] * rise).sum(axis=1)
        order = np.lexsort((height, owner))
        owner, candidate, height = owner[order], candidate[order], height[order]
        last = np.append(owner[1:] != owner[:-1], True) if len(owner) else np.zeros(0, dtype=bool)
        triangle, top = np.full(len(points), -1), np.full(len(points), np.nan)
        triangle[owner[last]], top[owner[last]] = candidate[last], height[last]
        return triangle, top


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
