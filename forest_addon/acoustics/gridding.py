"""Kaiser-Bessel gridding: a sum over arbitrary delays becomes a few deposits and one FFT.

A term e^{-i2πku} of a delay u (in turns of the grid) is laid down on the nearest ``width`` points of an
even grid with twice as many points as there are bins; the FFT of the grid, divided by the transform of the
kernel (``kaiser_bessel``), is the sum (Dutt & Rokhlin 1993).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy import fft, sparse

from .kaiser_bessel import OVERSAMPLING, Kernel

NARROWEST = 3  # points of the kernel
# Largest error of a term, for kernels of 3, 4, … points.
ALIASING = (
    *(1.7e-2, 2.6e-3, 2.1e-4, 1.7e-5, 1.7e-6, 3e-7, 3.1e-8),
    *(3.4e-9, 5.2e-10, 5.1e-11, 6.2e-12, 5e-13, 7e-14),
)


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

    ``spectrum`` gives Σ_i s_in·w_ir e^{-i2πk·u_i} for R columns of weights, in N sums.
    """

    def __init__(self, count: int, columns: int, width: int, sums: int = 1) -> None:
        self._kernel = kernel(width)
        self._bins = np.arange(count) - count // 2
        self._size = fft.next_fast_len(max(OVERSAMPLING * count, 2 * width))
        self._grid = np.zeros((sums, self._size + width, 2 * columns))

    def add(self, turns: np.ndarray, weight: np.ndarray, several: np.ndarray | None = None) -> None:
        """Add weights (M, R) complex at delays ``turns`` (M,), 1 the period of the bins; several : (M, N)
        real, of each in the sums."""
        width = self._kernel.width
        place = (turns - np.floor(turns)) * self._size  # 0 … size, both included
        values = np.ascontiguousarray(weight, dtype=np.complex128).view(np.float64)
        first, taps = self._kernel.spread(place, np.float64)
        first += np.where(first < 0, np.int32(self._size), np.int32(0))
        columns = first[:, None] + np.arange(width, dtype=np.int32)
        rows = np.arange(0, taps.size + 1, width, dtype=np.int32)
        shape = (len(turns), self._grid.shape[1])
        for number, grid in enumerate(self._grid):
            mine = taps if several is None else taps * several[:, number]
            deposit = sparse.csr_matrix((mine.T.ravel(), columns.ravel(), rows), shape=shape)
            grid += deposit.T @ values

    def spectrum(self, number: int = 0) -> np.ndarray:
        """(R, count) complex, of a sum."""
        whole = self._grid[number]
        grid = whole[: self._size].copy()
        grid[: len(whole) - self._size] += whole[self._size :]
        transformed = fft.fft(np.ascontiguousarray(grid.view(np.complex128).T), axis=1)
        spectrum: np.ndarray = transformed[:, self._bins % self._size]
        spectrum /= self._kernel.transform(self._bins / self._size)
        return spectrum
