"""Intensity functions: expected trees per square metre.

An ``Intensity`` knows its value at points, true bounds over cells (what exact thinning needs), and its
integral over a rectangle where that is closed. Hills are Tanveer et al.'s formula in its squared form, λ(x,
y) = Σ C·exp(-(x-a)²/h² - (y-b)²/l²). Masks are intensities of 0 and 1: a product of one with anything keeps
it within. Images, painted meshes, polygons and limits of the terrain are in modules of their own.

Cells of a quadtree have true bounds of an intensity and are small where it varies. The field is cut into
nearly square cells; a cell is quartered while the room between its bounds, times its area, is more than it
may be. Exact thinning and integration both stand on these cells.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np
from scipy.special import erf, erfc

from .surface import IntensityError


class Intensity(ABC):
    """Expected trees per square metre over the plane; never negative."""

    @abstractmethod
    def at(self, points: np.ndarray) -> np.ndarray:
        """λ (N,) at points (N, 2), metres."""

    @abstractmethod
    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """True lower and upper bounds (C,) of λ over the closed cells ``low`` to ``high`` (C, 2)."""

    def closed_integral(self, low: np.ndarray, high: np.ndarray) -> float | None:
        """∫λ over the rectangle ``low`` to ``high`` (2,) in closed form, None where there is none."""
        return None


@dataclass(frozen=True)
class Constant(Intensity):
    """The same everywhere."""

    value: float

    def at(self, points: np.ndarray) -> np.ndarray:
        return np.full(len(points), self.value)

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        same = np.full(len(low), self.value)
        return same, same

    def closed_integral(self, low: np.ndarray, high: np.ndarray) -> float:
        return self.value * float(np.prod(high - low))


@dataclass(frozen=True)
class Mixture(Intensity):
    """Gaussian hills. peak : (G,) trees/m². centre, width : (G, 2) metres; σ is width/√2."""

    peak: np.ndarray
    centre: np.ndarray
    width: np.ndarray

    def at(self, points: np.ndarray) -> np.ndarray:
        value = np.zeros(len(points))
        for peak, centre, width in zip(self.peak, self.centre, self.width, strict=True):
            value += peak * np.exp(-(((points - centre) / width) ** 2).sum(axis=1))
        return value

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        lower, upper = np.zeros(len(low)), np.zeros(len(low))
        for peak, centre, width in zip(self.peak, self.centre, self.width, strict=True):
            nearest = np.clip(centre, low, high)
            farthest = np.where(centre - low > high - centre, low, high)
            upper += peak * np.exp(-(((nearest - centre) / width) ** 2).sum(axis=1))
            lower += peak * np.exp(-(((farthest - centre) / width) ** 2).sum(axis=1))
        return lower, upper

    def closed_integral(self, low: np.ndarray, high: np.ndarray) -> float:
        spans = _erf_between((low - self.centre) / self.width, (high - self.centre) / self.width)
        return float(self.peak @ np.prod(self.width * np.sqrt(np.pi) / 2 * spans, axis=1))

    def whole(self) -> np.ndarray:
        """(G,) ∫ of each hill over the plane, C·π·h·l."""
        return np.asarray(self.peak * np.pi * self.width.prod(axis=1))


def _erf_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """erf(b) - erf(a) for a <= b; in a tail by erfc, where erf has no digits left."""
    right, left = a > 0, b < 0
    near, far = np.where(left, -b, a), np.where(left, -a, b)
    return np.where(right | left, erfc(near) - erfc(far), erf(b) - erf(a))


@dataclass(frozen=True)
class Sum(Intensity):
    """Several intensities added."""

    parts: tuple[Intensity, ...]

    def at(self, points: np.ndarray) -> np.ndarray:
        return np.asarray(sum((part.at(points) for part in self.parts), np.zeros(len(points))))

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        lower, upper = np.zeros(len(low)), np.zeros(len(low))
        for part in self.parts:
            least, most = part.bounds(low, high)
            lower, upper = lower + least, upper + most
        return lower, upper

    def closed_integral(self, low: np.ndarray, high: np.ndarray) -> float | None:
        closed = [part.closed_integral(low, high) for part in self.parts]
        return None if None in closed else float(sum(c for c in closed if c is not None))


@dataclass(frozen=True)
class Product(Intensity):
    """Several intensities multiplied; a mask is a factor of 0 and 1."""

    parts: tuple[Intensity, ...]
    factor: float = field(default=1.0)

    def at(self, points: np.ndarray) -> np.ndarray:
        value = np.full(len(points), self.factor)
        for part in self.parts:
            value *= part.at(points)
        return value

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        lower, upper = np.full(len(low), self.factor), np.full(len(low), self.factor)
        for part in self.parts:
            least, most = part.bounds(low, high)
            lower, upper = lower * least, upper * most
        return lower, upper

    def closed_integral(self, low: np.ndarray, high: np.ndarray) -> float | None:
        """Closed where all factors but one are constant."""
        constants = [part.value for part in self.parts if isinstance(part, Constant)]
        others = [part for part in self.parts if not isinstance(part, Constant)]
        factor = self.factor * float(np.prod(constants))
        if len(others) > 1:
            return None
        closed = (others[0] if others else Constant(1.0)).closed_integral(low, high)
        return None if closed is None else factor * closed


class Mask(Intensity):
    """An intensity of 0 and 1: where trees may stand."""


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
