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

from .. import kernels
from .spectrum import phasors

NARROWEST = 3  # points of the kernel
LANES = 4  # complex values of a grid's row that are beside each other; it has a multiple of them
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

    ``spectrum`` gives Σ_r p_rk·Σ_i s_in·w_ir e^{-i2πk·u_i} for R columns of weights, in N sums.
    """

    def __init__(self, count: int, columns: int, width: int, sums: int = 1) -> None:
        self._kernel, self._columns = kernel(width), columns
        self._count = count
        self._size = fft.next_fast_len(max(OVERSAMPLING * count, 2 * width))
        self._grid = grid_of(sums, self._size + width, columns)

    def add(
        self, turns: np.ndarray, cycles: np.ndarray, weight: np.ndarray, several: np.ndarray
    ) -> np.ndarray:
        """Add weights (R, M) complex at delays ``turns`` (M,), 1 the period of the bins, each turned back by
        its cycles (M,); several : (M, N) real, of each in the sums. Returns (M,) the largest sizes of the
        weights of each."""
        place = (turns - np.floor(turns)) * self._size  # 0 … size, both included
        return lay(self._kernel, place, cycles, weight, several, self._grid)

    def spectrum(self, shares: np.ndarray, number: int = 0) -> np.ndarray:
        """(count,) complex, of a sum, once: its columns times their shares p (R, count), added up."""
        grid = self._grid[number, :, : self._columns].T
        grid[:, : self._kernel.width] += grid[:, self._size :]
        transformed = fft.fft(grid[:, : self._size], axis=1)
        below = self._count // 2
        halves = (
            np.einsum("rk,rk->k", transformed[:, self._size - below :], shares[:, :below]),
            np.einsum("rk,rk->k", transformed[:, : self._count - below], shares[:, below:]),
        )
        return np.concatenate(halves) / self._kernel.over_bins(self._count, self._size)


def grid_of(sums: int, points: int, columns: int) -> np.ndarray:
    """(N, points, C) complex zeros, C at least as many as the columns, for ``lay``."""
    return np.zeros((sums, points, -(-columns // LANES) * LANES), np.complex128)


def lay(
    chosen: Kernel,
    place: np.ndarray,
    cycles: np.ndarray,
    heights: np.ndarray,
    weights: np.ndarray,
    grid: np.ndarray,
) -> np.ndarray:
    """Add echoes to N grids (N, S + width, C), of ``grid_of``; returns (M,) their largest heights' sizes.

    place : (M,) grid points, 0 … S. cycles : (M,) that each is turned back. heights : (R, M) complex, R at
    most C. weights : (M, N) real, of each in the grids.
    """
    size = grid.shape[1] - chosen.width
    library = kernels.library()
    if library is not None:
        largest, heights = np.empty(len(place)), np.asarray(heights, np.complex128)
        if not heights.flags.f_contiguous:
            heights = np.ascontiguousarray(heights)
        steps = [step // heights.itemsize for step in heights.strides]
        by_row = heights if heights.flags.c_contiguous else heights.T
        echoes = len(place), place, cycles, len(heights), by_row, *steps
        weights = np.ascontiguousarray(weights, np.float64)
        taken = chosen.width, len(chosen.polynomial), chosen.polynomial, size
        library.lay_echoes(*echoes, len(grid), weights, *taken, grid, largest)
        return largest
    first, taps = chosen.spread(place)
    points = np.where(first < 0, first + size, first)[:, None] + np.arange(chosen.width)
    ends = np.arange(0, points.size + 1, chosen.width)
    turned = (heights * phasors(cycles)).T
    for weight, one in zip(weights.T, grid, strict=True):
        entries = ((taps * weight).T.ravel(), points.ravel(), ends)
        one[:, : len(heights)] += sparse.csr_array(entries, (len(place), len(one))).T @ turned
    return np.asarray(np.abs(heights).max(axis=0))


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
        return np.ascontiguousarray((fitted.T @ powers)[:, ::-1].T)

    @property
    def _places(self) -> np.ndarray:
        return np.arange(self.width) - (self.width - 1) / 2

    def spread(self, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First grid point (N,) and taps (width, N) of pulses at ``place`` (N,), grid points."""
        shifted = place - (self.width - 2) / 2
        first = np.floor(shifted)
        taps: np.ndarray = np.polyval(self.polynomial[:, :, None], 2.0 * (shifted - first) - 1.0)
        return first.astype(np.int64), taps

    @lru_cache(maxsize=64)  # noqa: B019 -- kernels are kept
    def over_bins(self, count: int, size: int) -> np.ndarray:
        """(count,) transform at the bins -(count // 2) … of a grid of ``size`` points."""
        return self.transform((np.arange(count) - count // 2) / size)

    def transform(self, frequency: np.ndarray) -> np.ndarray:
        """Fourier transform at frequencies in cycles a grid point."""
        square = self.shape**2 - (math.pi * self.width * frequency) ** 2
        root = np.sqrt(np.abs(square))
        scale = np.exp(-self.shape) / special.ive(0, self.shape)
        whole = np.where(
            square >= 0, np.sinh(root) / np.maximum(root, 1e-300), np.sinc(root / math.pi)
        )
        return np.asarray(self.width * scale * np.where(root < 1e-8, 1.0, whole))
