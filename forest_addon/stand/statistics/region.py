"""Region where an intensity is large enough to be judged: pixels of a window.

A tree counts 1/λ in the inhomogeneous K function, so a few trees far out on a hill would outweigh all
others. Pairs are therefore counted within a region where λ is not small, by Kaneko & Gamper's own
definition with that region as the window.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import map_coordinates

from .k_function import At
from .window import Window

PIXELS = 256  # along the longer side of the window
SMALLEST = 0.1  # λ within the region, over the mean of λ over trees


@dataclass(frozen=True)
class Region:
    """filled : (rows, columns) bool, pixels that belong, row 0 in the south. low, cell : (2,) metres."""

    filled: np.ndarray
    low: np.ndarray
    cell: np.ndarray

    @property
    def area(self) -> float:
        """m²."""
        return float(self.filled.sum() * self.cell.prod())

    @property
    def extent(self) -> np.ndarray:
        """(2,) sides of its bounding box, metres."""
        rows, columns = (np.flatnonzero(self.filled.any(axis=k)) for k in (1, 0))
        span = np.array([np.ptp(columns) + 1, np.ptp(rows) + 1])
        return np.asarray(span * self.cell)

    def contains(self, points: np.ndarray) -> np.ndarray:
        """(N,) bool of points (N, 2) within the window's bounding box."""
        rows, columns = self.filled.shape
        place = ((points - self.low) / self.cell).astype(int)
        x, y = np.clip(place, 0, [columns - 1, rows - 1]).T
        return np.asarray(self.filled[y, x])

    def set_covariance(self, shift: np.ndarray) -> np.ndarray:
        """(N,) area that it shares with itself moved by shift (N, 2), m²; exact, as between whole pixels
        the overlap of pixels is bilinear."""
        middle = np.array(self._overlaps.shape) // 2
        at = shift[:, ::-1] / self.cell[::-1] + middle
        read: np.ndarray = map_coordinates(self._overlaps, at.T, order=1, mode="constant")
        return read

    @cached_property
    def _overlaps(self) -> np.ndarray:
        from scipy.signal import fftconvolve  # here: it takes half a second to import

        image = self.filled.astype(float)
        overlaps = np.rint(fftconvolve(image, image[::-1, ::-1])) * self.cell.prod()
        return np.pad(overlaps, 1)


def region_of(at: At, window: Window) -> Region:
    """The pixels wholly within a window where λ is at least a tenth of its mean over trees."""
    columns, rows = np.maximum(np.ceil(PIXELS * window.extent / window.extent.max()), 4).astype(int)
    cell = window.extent / [columns, rows]
    x, y = (window.low[k] + (np.arange(n) + 0.5) * cell[k] for k, n in enumerate((columns, rows)))
    value = at(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)).reshape(rows, columns)
    value = value * (window.coverage((rows, columns)) > 1 - 1e-9)
    mean = float((value**2).sum() / max(value.sum(), 1e-300))
    return Region((value > 0) & (value >= SMALLEST * mean), window.low, cell)
