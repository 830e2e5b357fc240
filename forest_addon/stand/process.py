"""A Poisson process: an intensity on a rectangular field, and the number of trees it expects.

∫λ is closed where the intensity knows it, else summed over the cells of a quadtree by Gauss-Legendre
quadrature, with an error that is stated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .intensity.functions import Intensity, Product
from .intensity.quadtree import refine

CELLS = 20_000  # that the integral of an intensity without a closed form is summed over, at least


@dataclass(frozen=True)
class Integral:
    """A number of trees and how far it may be off; 0 for a closed form."""

    value: float
    error: float = 0.0


@dataclass(frozen=True)
class Process:
    """intensity : λ. low, high : (2,) corners of the field, metres. factor : multiplies λ."""

    intensity: Intensity
    low: np.ndarray
    high: np.ndarray
    factor: float = 1.0

    def at(self, points: np.ndarray) -> np.ndarray:
        """λ (N,) at points (N, 2); zero outside the field."""
        inside = ((points >= self.low) & (points <= self.high)).all(axis=1)
        return np.where(inside, self.factor * self.intensity.at(points), 0.0)

    @cached_property
    def total(self) -> Integral:
        """∫λ over the field."""
        return self.integral(self.low, self.high)

    def integral(self, low: np.ndarray, high: np.ndarray) -> Integral:
        """∫λ over a rectangle; what lies outside the field counts nothing."""
        low, high = np.maximum(low, self.low), np.minimum(high, self.high)
        if (high <= low).any():
            return Integral(0.0)
        closed = self.intensity.closed_integral(low, high)
        found = Integral(closed) if closed is not None else quadrature(self.intensity, low, high)
        return Integral(self.factor * found.value, self.factor * found.error)

    def expected(self, low: np.ndarray | None = None, high: np.ndarray | None = None) -> float:
        """∫λ over a rectangle within the field, by default the whole of it."""
        if low is None and high is None:
            return self.total.value
        return self.integral(
            self.low if low is None else low, self.high if high is None else high
        ).value

    def scaled(self, factor: float) -> Process:
        """λ times a factor."""
        made = replace(self, factor=self.factor * factor)
        total = self.__dict__.get("total")
        if total is not None:  # no need to integrate again
            made.__dict__["total"] = Integral(total.value * factor, total.error * factor)
        return made

    def whole(self) -> Intensity:
        """λ with its factor, as one intensity."""
        return Product((self.intensity,), self.factor)


def quadrature(intensity: Intensity, low: np.ndarray, high: np.ndarray) -> Integral:
    """∫λ over a rectangle by 3 x 3 Gauss points in every cell of a quadtree.

    The stated error compares with 2 x 2 points: by the sums, which differ where λ bends, and by three
    standard errors of the cells, whose errors are random where an edge of a mask or a pixel crosses them.
    """
    cells = refine(intensity, low, high, 0.0, 1 / CELLS)
    fine, coarse = (_gauss(intensity, cells.low, cells.high, order) for order in (3, 2))
    apart = fine - coarse
    return Integral(
        float(fine.sum()), float(abs(apart.sum()) + 3 * np.sqrt(np.square(apart).sum()))
    )


def _gauss(intensity: Intensity, low: np.ndarray, high: np.ndarray, order: int) -> np.ndarray:
    """(C,) ∫λ over cells by order x order points."""
    places, weights = np.polynomial.legendre.leggauss(order)
    total = np.zeros(len(low))
    middle, half = (low + high) / 2, (high - low) / 2
    for x, wx in zip(places, weights, strict=True):
        for y, wy in zip(places, weights, strict=True):
            total += wx * wy * intensity.at(middle + half * [x, y])
    return total * half.prod(axis=1)
