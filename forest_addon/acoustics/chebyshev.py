"""Interpolation between Chebyshev points of the first kind, x_r = -cos(π(r + 1/2)/R) for r = 0 … R - 1.

The coefficients of the polynomial through values v_r are c_n = (2/R)·Σ_r v_r·T_n(x_r), c_0 half of that,
because the T_n are orthogonal in sums over the points. The Lagrange polynomial of a point is
ℓ_r(x) = w_r/(x - x_r) / Σ_s w_s/(x - x_s), w_r = (-1)^r·sin(π(r + 1/2)/R) (Berrut & Trefethen 2004).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np


def points(
    count: int, low: float | np.ndarray = -1.0, high: float | np.ndarray = 1.0
) -> np.ndarray:
    """(R,) from ``low`` to ``high``, or (..., R) between many of both, (..., 1)."""
    within = -np.cos(math.pi * (np.arange(count) + 0.5) / count)
    return np.asarray(0.5 * (low + high) + 0.5 * (high - low) * within)


def coefficients(values: np.ndarray, axis: int) -> np.ndarray:
    """Chebyshev coefficients of values (..., R, ...) at the points, along an axis."""
    return np.moveaxis(np.tensordot(_sums(values.shape[axis]), values, (1, axis)), 0, axis)


@lru_cache(maxsize=64)
def _sums(count: int) -> np.ndarray:
    """(R, R) what values are multiplied with and added up to coefficients."""
    quarters = np.outer(np.arange(count), 2 * np.arange(count)[::-1] + 1) % (4 * count)
    share = np.where(np.arange(count) > 0, 2.0, 1.0) / count
    return np.asarray(share[:, None] * np.cos(0.5 * math.pi / count * quarters))


def terms_needed(size: np.ndarray, allowed: np.ndarray | float) -> int:
    """Number of first coefficients, of sizes (R, F), that leave no series more than is allowed (F,)."""
    left = np.cumsum(size[::-1], axis=0)[::-1]
    large = np.flatnonzero((left > allowed).any(axis=1))
    return int(large[-1]) + 2 if len(large) else 1


def polynomials(x: np.ndarray, count: int) -> np.ndarray:
    """(count, N) Chebyshev polynomials at x (N,)."""
    values = np.empty((count, len(x)))
    values[0] = 1.0
    if count > 1:
        values[1] = x
    twice = 2.0 * x
    for n in range(2, count):
        np.multiply(twice, values[n - 1], out=values[n])
        values[n] -= values[n - 2]
    return values


def lagrange(count: int, place: np.ndarray) -> np.ndarray:
    """(R, M) polynomials of R points at places (M,) in -1 … 1, by the barycentric formula."""
    turn = math.pi * (np.arange(count) + 0.5) / count
    weight = np.sin(turn) * (-1.0) ** np.arange(count)
    away = np.clip(place, -1.0, 1.0) - points(count)[:, None]
    at = away == 0.0
    share = weight[:, None] / np.where(at, 1.0, away)
    polynomials: np.ndarray = share / share.sum(axis=0)
    met = at.any(axis=0)
    polynomials[:, met] = at[:, met]
    return polynomials


@dataclass(frozen=True)
class Cubics:
    """A complex function from ``first`` on as cubics in cells a ``step`` wide, which take no time to look up.

    table : (cells, 4) complex128, coefficients of a cubic in parts of each, lowest power first.
    """

    first: float
    step: float
    table: np.ndarray

    @classmethod
    def of(
        cls, function: Callable[[np.ndarray], np.ndarray], first: float, last: float, cells: int
    ) -> Cubics:
        """The cubics through a function's values at four Chebyshev points of each cell."""
        places, step = points(4, 0.0, 1.0), (last - first) / cells
        values = function(first + step * (np.arange(cells)[:, None] + places))
        powers = np.linalg.inv(np.vander(places, increasing=True))
        return cls(first, step, np.ascontiguousarray(values @ powers.T, np.complex128))

    @property
    def given(self) -> tuple[float, float, int, np.ndarray]:
        """Arguments of the kernels."""
        return self.first, self.step, len(self.table), self.table

    def at(self, x: np.ndarray) -> np.ndarray:
        """Values at places of any shape; beyond either end, that of the end."""
        place = np.clip((x - self.first) / self.step, 0.0, len(self.table))
        cell = np.minimum(np.nan_to_num(place).astype(np.int64), len(self.table) - 1)
        return np.polyval(np.moveaxis(self.table[cell], -1, 0)[::-1], place - cell)
