"""Intensity functions: expected trees per square metre.

An ``Intensity`` knows its value at points, true bounds over cells (what exact thinning needs), and its
integral over a rectangle where that is closed. Hills are Tanveer et al.'s formula in its squared form,
λ(x, y) = Σ C·exp(-(x-a)²/h² - (y-b)²/l²). Masks are intensities of 0 and 1: a product of one with
anything keeps it within. Images, painted meshes, polygons and limits of the terrain are in modules of
their own.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np
from scipy.special import erf, erfc

from ...spec import SpecError


class IntensityError(SpecError):
    """An intensity that cannot be used: one sentence with what, where and what to do."""

    def __init__(self, sentence: str) -> None:
        super().__init__("", sentence)


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
