"""Cells with true bounds of an intensity, small where it varies.

The field is cut into nearly square cells; a cell is quartered while the room between its bounds, times its
area, is more than it may be. Exact thinning and integration both stand on these cells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .functions import Intensity, IntensityError

MAX_CELLS = 1 << 22
MAX_ASPECT = 1024  # cells along the longer side of the first cut


@dataclass(frozen=True)
class QuadtreeCells:
    """low, high : (C, 2) corners, metres. lower, upper : (C,) bounds of λ over the closed cells."""

    low: np.ndarray
    high: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    def __len__(self) -> int:
        return len(self.lower)

    @property
    def area(self) -> np.ndarray:
        """(C,) m²."""
        return np.asarray((self.high - self.low).prod(axis=1))

    @property
    def gap(self) -> np.ndarray:
        """(C,) trees between what the bounds allow."""
        return np.asarray((self.upper - self.lower) * self.area)

    def where(self, chosen: np.ndarray) -> QuadtreeCells:
        """Some of the cells."""
        return QuadtreeCells(
            self.low[chosen], self.high[chosen], self.lower[chosen], self.upper[chosen]
        )


def refine(
    intensity: Intensity, low: np.ndarray, high: np.ndarray, spare: float, share: float = 0.0
) -> QuadtreeCells:
    """Cells that cover the rectangle ``low`` to ``high`` and leave little room between their bounds.

    spare : gap of a cell, in trees, below which it is not cut any more.
    share : the same as a share of the sum of all gaps; the larger of the two counts.

    Raises
    ------
    IntensityError : a bound is not finite.
    """
    done: list[QuadtreeCells] = []
    kept, settled = 0, 0.0
    active = _bounded(intensity, *_first_cut(low, high))
    while len(active):
        gap = active.gap
        middle = (active.low + active.high) / 2
        cut = (gap > max(spare, share * (gap.sum() + settled))) & (
            (middle > active.low) & (middle < active.high)
        ).all(axis=1)
        if kept + len(active) + 3 * int(cut.sum()) > MAX_CELLS:
            cut[:] = False
        done.append(active.where(~cut))
        kept, settled = kept + len(done[-1]), settled + float(gap[~cut].sum())
        active = _bounded(intensity, *_quarters(active.low[cut], middle[cut], active.high[cut]))
    return QuadtreeCells(
        *(
            np.concatenate([getattr(part, n) for part in done])
            for n in ("low", "high", "lower", "upper")
        )
    )


def _bounded(intensity: Intensity, low: np.ndarray, high: np.ndarray) -> QuadtreeCells:
    lower, upper = intensity.bounds(low, high)
    bad = ~np.isfinite(upper)
    if bad.any():
        k = int(np.argmax(bad))
        raise IntensityError(
            f"the intensity has no finite bound between {low[k].tolist()} and {high[k].tolist()}; "
            "lower it there"
        )
    return QuadtreeCells(low, high, lower, upper)


def _first_cut(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    size = high - low
    counts = np.clip(np.rint(size / size.min()), 1, MAX_ASPECT).astype(int)
    x, y = (np.linspace(low[k], high[k], counts[k] + 1) for k in (0, 1))

    def corners(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)

    return corners(x[:-1], y[:-1]), corners(x[1:], y[1:])


def _quarters(
    low: np.ndarray, middle: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    lows, highs = [], []
    for right in (0, 1):
        for top in (0, 1):
            lows.append(np.column_stack([(low, middle)[right][:, 0], (low, middle)[top][:, 1]]))
            highs.append(np.column_stack([(middle, high)[right][:, 0], (middle, high)[top][:, 1]]))
    return np.concatenate(lows), np.concatenate(highs)
