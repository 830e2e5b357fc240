"""Kaiser-Bessel gridding: a sum over arbitrary delays becomes a few deposits and one FFT.

A term e^{-i2πku} of a delay u (in turns of the grid) is laid down on the nearest ``width`` points of an
even grid with twice as many points as there are bins; the FFT of the grid, divided by the kernel's own
transform, is the sum (Dutt & Rokhlin 1993; Jackson et al. 1991 for the Kaiser-Bessel window
I₀(β√(1 - x²)), whose transform is known in closed form).
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from scipy import fft, sparse, special

OVERSAMPLING = 2
SHAPE = 2.32  # β/width: the least aliasing at this oversampling
NARROWEST = 3  # points of the kernel
# Largest error of a term, for kernels of 3, 4, … points.
ALIASING = (
    *(1.7e-2, 2.6e-3, 2.1e-4, 1.7e-5, 1.7e-6, 3e-7, 3.1e-8),
    *(3.4e-9, 5.2e-10, 5.1e-11, 6.2e-12, 5e-13, 7e-14),
)


class Kernel:
    """The kernel that is ``width`` points of the grid wide."""

    def __init__(self, width: int) -> None:
        self.width = width
        self._beta = SHAPE * width
        degree = width  # of the polynomials below: their error is far under the kernel's
        turn = math.pi * (np.arange(degree + 1) + 0.5) / (degree + 1)
        offset = 0.5 * np.cos(turn)
        points = np.arange(width)[:, None] - 0.5 * (width - 1)
        at_nodes = self._window(points - offset)  # (width, degree + 1)
        order = np.arange(degree + 1)[:, None]
        series = (2.0 / (degree + 1)) * np.cos(order * turn)
        series[0] *= 0.5
        self._series = series @ at_nodes.T  # (degree + 1, width), of Chebyshev polynomials

    def taps(self, offset: np.ndarray) -> np.ndarray:
        """(M, width) kernel at its points, for M delays -½ … ½ points off the kernel's middle."""
        x = 2.0 * offset
        powers = np.empty((len(self._series), len(x)))
        powers[0], powers[1] = 1.0, x
        for n in range(2, len(powers)):
            np.multiply(2.0 * x, powers[n - 1], out=powers[n])
            powers[n] -= powers[n - 2]
        taps: np.ndarray = powers.T @ self._series
        return taps

    def transform(self, frequency: np.ndarray) -> np.ndarray:
        """The kernel's Fourier transform, at ``frequency`` in cycles per point of the grid."""
        inside = self._beta**2 - (math.pi * self.width * frequency) ** 2
        root = np.sqrt(np.abs(inside))
        wave = np.where(
            inside > 0, np.sinh(root) / np.maximum(root, 1e-30), np.sinc(root / math.pi)
        )
        value: np.ndarray = self.width / special.i0(self._beta) * wave
        return value

    def _window(self, points: np.ndarray) -> np.ndarray:
        within = np.maximum(1.0 - (2.0 * points / self.width) ** 2, 0.0)
        window: np.ndarray = special.i0(self._beta * np.sqrt(within)) / special.i0(self._beta)
        return window


@lru_cache(maxsize=len(ALIASING))
def kernel(width: int) -> Kernel:
    """The kernel of a width; kept."""
    return Kernel(width)


def width_for(tolerance: float) -> int:
    """Points of the narrowest kernel whose error is at most ``tolerance`` of Σ|weights|; or the widest."""
    enough = [error <= tolerance for error in ALIASING]
    return NARROWEST + (enough.index(True) if enough[-1] else len(enough) - 1)


class DelayGrid:
    """Collects weights at delays, for the bins k = -(count // 2) … count - count // 2 - 1.

    ``spectrum`` gives Σ_i w_ir e^{-i2πk·u_i} for R columns of weights.
    """

    def __init__(self, count: int, columns: int, width: int) -> None:
        self._kernel = kernel(width)
        self._bins = np.arange(count) - count // 2
        self._size = fft.next_fast_len(max(OVERSAMPLING * count, 2 * width))
        self._grid = np.zeros((self._size + width, 2 * columns))

    def add(self, turns: np.ndarray, weight: np.ndarray) -> None:
        """Add weights (M, R) complex at delays ``turns`` (M,), 1 the period of the bins."""
        width = self._kernel.width
        place = (turns - np.floor(turns)) * self._size  # 0 … size, both included
        nearest = np.floor(place + (0.5 if width % 2 else 0.0))
        first = nearest.astype(np.int32) - ((width - 1) // 2)
        taps = self._kernel.taps(place - first - 0.5 * (width - 1))
        first += np.where(first < 0, np.int32(self._size), np.int32(0))
        columns = first[:, None] + np.arange(width, dtype=np.int32)
        rows = np.arange(0, taps.size + 1, width, dtype=np.int32)
        shape = (len(turns), len(self._grid))
        deposit = sparse.csr_matrix((taps.ravel(), columns.ravel(), rows), shape=shape)
        self._grid += deposit.T @ np.ascontiguousarray(weight, dtype=np.complex128).view(np.float64)

    def spectrum(self) -> np.ndarray:
        """(R, count) complex."""
        grid = self._grid[: self._size].copy()
        grid[: len(self._grid) - self._size] += self._grid[self._size :]
        transformed = fft.fft(np.ascontiguousarray(grid.view(np.complex128).T), axis=1)
        spectrum: np.ndarray = transformed[:, self._bins % self._size]
        spectrum /= self._kernel.transform(self._bins / self._size)
        return spectrum
