"""Interpolation between Chebyshev points of the first kind, x_r = -cos(π(r + 1/2)/R) for r = 0 … R - 1.

The Lagrange polynomial of a point is ℓ_r(x) = (2/R)·Σ'_n T_n(x_r)·T_n(x), n = 0 … R - 1, the first term
halved, because the T_n are orthogonal in sums over the points.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np


def points(count: int) -> np.ndarray:
    """(R,) in -1 … 1."""
    place: np.ndarray = -np.cos(math.pi * (np.arange(count) + 0.5) / count)
    return place


@lru_cache(maxsize=64)
def series(count: int) -> np.ndarray:
    """(R, R): values at the points to Chebyshev coefficients."""
    rows: np.ndarray = (2.0 / count) * np.cos(np.arange(count)[:, None] * np.arccos(points(count)))
    rows[0] *= 0.5
    return rows


def lagrange(count: int, place: np.ndarray) -> np.ndarray:
    """(R, M) polynomials of R points at places (M,) in -1 … 1."""
    order = np.arange(count)[:, None]
    polynomials: np.ndarray = series(count).T @ np.cos(order * np.arccos(np.clip(place, -1.0, 1.0)))
    return polynomials
