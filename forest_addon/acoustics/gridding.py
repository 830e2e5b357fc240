"""Kaiser-Bessel gridding: a sum over arbitrary delays becomes a few deposits and one FFT.

A term e^{-i2πku} of a delay u (in turns of the grid) is laid down on the nearest ``width`` points of an
even grid with twice as many points as there are bins; the FFT of the grid, divided by the transform of the
kernel, is the sum (Dutt & Rokhlin 1993; Jackson et al. 1991; Barnett, Magland & af Klinteberg 2019 for the
kernel's width and shape). The grid is finer than the band needs by ``OVERSAMPLING``, which is what keeps its
images out of the band.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.polynomial import chebyshev
from scipy import fft, sparse, special

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


OVERSAMPLING = 2
SHAPE = 2.32  # β/width: the least aliasing at this oversampling


@dataclass(frozen=True)
class Kernel:
    """A Kaiser-Bessel kernel that is ``width`` grid points wide."""

    width: int

    @property
    def shape(self) -> float:
        """β of the kernel I₀(β√(1 - (2u/width)²))."""
        return SHAPE * self.width

    @cached_property
    def polynomial(self) -> np.ndarray:
        """(degree + 1, width) each tap as a polynomial of twice the offset, highest power first."""
        degree = self.width + 3
        x = np.cos(math.pi * (np.arange(4 * degree) + 0.5) / (4 * degree))
        away = self._places[:, None] - x / 2
        inside = np.sqrt(np.maximum(1.0 - (2.0 * away / self.width) ** 2, 0.0))
        taps = special.ive(0, self.shape * inside) * np.exp(self.shape * (inside - 1.0))
        taps /= special.ive(0, self.shape)
        fitted = chebyshev.chebfit(x, taps.T, degree)
        powers = np.eye(degree + 1)  # of x in each Chebyshev polynomial, T_n = 2x·T_{n-1} - T_{n-2}
        for n in range(2, degree + 1):
            powers[n] = 2.0 * np.roll(powers[n - 1], 1) - powers[n - 2]
        return np.asarray((fitted.T @ powers)[:, ::-1].T)

    @property
    def _places(self) -> np.ndarray:
        return np.arange(self.width) - (self.width - 1) / 2

    def spread(self, place: np.ndarray, dtype: type[np.floating]) -> tuple[np.ndarray, np.ndarray]:
        """First grid point (N,) int32 and taps (width, N) of pulses at ``place`` (N,), grid points."""
        shifted = place - (self.width - 2) / 2
        first = np.floor(shifted)
        x: np.ndarray = ((shifted - first) * 2.0 - 1.0).astype(dtype)
        taps: np.ndarray = np.empty((self.width, len(place)), dtype)
        for tap, powers in zip(taps, self.polynomial.T.astype(dtype), strict=True):
            np.multiply(x, powers[0], out=tap)
            for power in powers[1:-1]:
                tap += power
                tap *= x
            tap += powers[-1]
        return first.astype(np.int32), taps

    def transform(self, frequency: np.ndarray) -> np.ndarray:
        """Fourier transform at frequencies in cycles a grid point; complex ones are of decaying waves."""
        if np.iscomplexobj(frequency):
            root = np.sqrt(self.shape**2 - (math.pi * self.width * frequency) ** 2)
            scale = np.exp(-self.shape) / special.ive(0, self.shape)
            decaying: np.ndarray = self.width * scale * np.sinh(root) / root
            return decaying
        square = self.shape**2 - (math.pi * self.width * frequency) ** 2
        root = np.sqrt(np.abs(square))
        scale = np.exp(-self.shape) / special.ive(0, self.shape)
        whole = np.where(
            square >= 0, np.sinh(root) / np.maximum(root, 1e-300), np.sinc(root / math.pi)
        )
        result: np.ndarray = self.width * scale * np.where(root < 1e-8, 1.0, whole)
        return result
