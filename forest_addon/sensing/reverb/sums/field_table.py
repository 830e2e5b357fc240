"""H of trunks at some angles for every size ka between two, from a few hundred partial wave sums.

H·k^{-3/2}/a² is a function of z = ka and of the angle φ alone: one table serves all radii, frequencies and
sampling rates. Along z it is kept as Chebyshev series over short stretches, times (1 + z²)^{3/4}, which
levels it from Rayleigh's law (z -> 0) to geometrical optics, and without its middle delay: the echo off
the near face comes 2a·sin(φ/2)/c before, the wave that creeps around by φ comes aφ/c after the axis'
own time, so that a·(sin(φ/2) - φ/2)/c is the middle of both.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import fft

from ....acoustics import chebyshev
from ....acoustics.cylinder import order_count, partial_waves
from ....base.rows import distinct

STRETCHES = (0.5, 2.0, 6.0)  # ends of the first in z; then WIDTH each
WIDTH = 6.0
NODES = 40  # of a stretch: 1e-8 or better of H
SMALLEST = 1e-7  # z below which H/z² is constant to rounding
FIRST_SERIES = 64  # values at once


def middle(angle: np.ndarray) -> np.ndarray:
    """Return how far, over the radius, the middle of a trunk's answer lies before the axis' own time."""
    return np.sin(0.5 * angle) - 0.5 * angle


def near_face(angle: np.ndarray) -> np.ndarray:
    """Return how far, over the radius, the echo off the near face comes before the axis' own time."""
    return 2.0 * np.sin(0.5 * angle)


class FieldTable:
    """H·k^{-3/2}/a²·e^{-iz·middle(φ)} for z from ``low`` to ``high`` at angles (C,)."""

    def __init__(self, low: float, high: float, angles: np.ndarray, bark: float = 0.0) -> None:
        ends = np.array([0.0, *STRETCHES, *np.arange(STRETCHES[-1] + WIDTH, high + WIDTH, WIDTH)])
        first = max(0, int(np.searchsorted(ends, low)) - 1)
        self._ends = ends[first : int(np.searchsorted(ends, high)) + 1]
        span = np.diff(self._ends)
        z = self._ends[:-1, None] + span[:, None] * 0.5 * (chebyshev.points(NODES) + 1.0)
        values = field(z.ravel(), angles, bark)
        values *= np.exp(-1j * np.outer(z, middle(angles))) * ((1.0 + z**2) ** 0.75).reshape(-1, 1)
        self._series = series(values.reshape(len(z), NODES, len(angles)), 1)

    def at(self, z: np.ndarray, columns: slice = slice(None)) -> np.ndarray:
        """(Z, C) values at sizes (Z,) of some of the angles."""
        stretch, place = self._place(z)
        found = np.empty((len(z), self._series[0, :, columns].shape[1]), np.complex128)
        for number in distinct(stretch):
            rows = np.flatnonzero(stretch == number)
            coefficients = np.ascontiguousarray(self._series[number, :, columns])
            part = polynomials(place[rows], NODES).T @ coefficients.view(np.float64)
            found[rows] = part.view(np.complex128)
        found *= ((1.0 + z**2) ** -0.75)[:, None]
        return found

    def each(self, z: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """(M, Q) values at sizes (M, Q), each row at the angle of its column (M,)."""
        found = np.empty(z.shape, np.complex128)
        for start in range(0, len(z), FIRST_SERIES):
            some = slice(start, start + FIRST_SERIES)
            stretch, place = self._place(z[some])
            basis = polynomials(place.ravel(), NODES).T.reshape(*place.shape, NODES)
            series_of = self._series[stretch, :, columns[some, None]]  # (m, Q, NODES)
            found[some] = (basis * series_of).sum(axis=2)
        found *= (1.0 + z**2) ** -0.75
        return found

    def _place(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Stretch of sizes, and where in it, from -1 to 1."""
        stretch = np.clip(np.searchsorted(self._ends, z) - 1, 0, len(self._ends) - 2)
        low, high = self._ends[stretch], self._ends[stretch + 1]
        return stretch, 2.0 * (z - low) / (high - low) - 1.0


def field(z: np.ndarray, angles: np.ndarray, bark: float = 0.0) -> np.ndarray:
    """(Z, C) H·k^{-3/2}/a² at sizes (Z,) and angles (C,), by partial waves."""
    z = np.maximum(z, SMALLEST)
    waves = partial_waves(z, order_count(float(z.max())), bark)
    waves[1:] *= 2.0
    waves *= np.exp(0.25j * math.pi) * math.sqrt(2.0 / math.pi) / z**2
    turns = np.cos(np.outer(np.arange(len(waves)), angles))
    return waves.real.T @ turns - 1j * (waves.imag.T @ turns)


def series(values: np.ndarray, axis: int) -> np.ndarray:
    """Chebyshev coefficients of values at the Chebyshev points, along an axis."""
    count = values.shape[axis]
    found: np.ndarray = fft.dct(np.flip(values, axis), type=2, axis=axis) / count
    found[(slice(None),) * axis + (0,)] *= 0.5
    return found


def polynomials(x: np.ndarray, count: int) -> np.ndarray:
    """(count, N) Chebyshev polynomials at x (N,)."""
    found = np.empty((count, len(x)))
    found[0] = 1.0
    if count > 1:
        found[1] = x
    twice = 2.0 * x
    for n in range(2, count):
        np.multiply(twice, found[n - 1], out=found[n])
        found[n] -= found[n - 2]
    return found
