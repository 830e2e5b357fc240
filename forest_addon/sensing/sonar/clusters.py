"""Points in blocks: which of many scatterers can be passed over without looking at each.

The points of one mesh are cut in halves along the widest axis until a block holds at most ``SIZE``; a
block knows its bounding sphere. Instances share the blocks of their mesh, so a forest of millions of
leaves is searched by a few thousand spheres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SIZE = 96


@dataclass(frozen=True)
class Blocks:
    """B blocks of N points, block by block.

    order : (N,) the points' numbers before, in the order of the blocks. first : (B + 1,).
    centre : (B, 3). radius : (B,) metres; every point, with its own extent, lies within.
    """

    order: np.ndarray
    first: np.ndarray
    centre: np.ndarray
    radius: np.ndarray

    def __len__(self) -> int:
        return len(self.radius)

    @property
    def count(self) -> np.ndarray:
        """(B,) points of each block."""
        return np.diff(self.first)

    def largest(self, values: np.ndarray) -> np.ndarray:
        """(B,) the largest of values (N,), which are in the order of the blocks."""
        if not len(self):
            return np.empty(0)
        return np.maximum.reduceat(values, self.first[:-1])

    def sums(self, values: np.ndarray) -> np.ndarray:
        """(B,) the sum of values (N,), which are in the order of the blocks."""
        if not len(self):
            return np.empty(0)
        return np.add.reduceat(values, self.first[:-1])


def cluster(points: np.ndarray, extent: np.ndarray) -> Blocks:
    """Blocks of points (N, 3) that reach ``extent`` (N,) metres around themselves.

    Points that are not finite come last, in a block that is infinitely large and so always looked at.
    """
    finite = np.isfinite(points).all(axis=1) & np.isfinite(extent)
    runs: list[np.ndarray] = []
    pending = [np.flatnonzero(finite)]
    while pending:
        rows = pending.pop()
        if len(rows) <= SIZE:
            if len(rows):
                runs.append(rows)
            continue
        widest = int(np.argmax(np.ptp(points[rows], axis=0)))
        middle = len(rows) // 2
        rows = rows[np.argpartition(points[rows, widest], middle)]
        pending += [rows[middle:], rows[:middle]]
    spheres = [_sphere(points[rows], extent[rows]) for rows in runs]
    if not finite.all():
        runs.append(np.flatnonzero(~finite))
        spheres.append((np.zeros(3), np.inf))
    return Blocks(
        order=np.concatenate(runs) if runs else np.empty(0, np.int64),
        first=np.concatenate([[0], np.cumsum([len(rows) for rows in runs])]).astype(np.int64),
        centre=np.array([centre for centre, _ in spheres]).reshape(-1, 3),
        radius=np.array([radius for _, radius in spheres], dtype=np.float64),
    )


def _sphere(points: np.ndarray, extent: np.ndarray) -> tuple[np.ndarray, float]:
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    return centre, float((np.linalg.norm(points - centre, axis=1) + extent).max())
