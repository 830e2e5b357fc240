"""Sums of delayed pulses by way of an even grid: a Kaiser-Bessel kernel, its taps and its transform.

A pulse between two grid points becomes ``width`` taps around it; the Fourier transform of the grid,
divided by the kernel's, is that of the pulses (Jackson et al. 1991; Barnett, Magland & af Klinteberg
2019 for width and shape). The grid is finer than the band needs by ``OVERSAMPLING``, which is what keeps
its images out of the band.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import chebyshev
from scipy import special

OVERSAMPLING = 2
SHAPE = 2.32  # β/width: the least aliasing at this oversampling


@dataclass(frozen=True)
class Kernel:
    """A Kaiser-Bessel kernel that is ``width`` grid points wide."""

    width: int

    @classmethod
    def for_tolerance(cls, tolerance: float) -> Kernel:
        """The narrowest kernel whose error stays below the tolerance, 1e-2 to 1e-11."""
        return cls(math.ceil(-math.log10(tolerance) + 1.0))

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
