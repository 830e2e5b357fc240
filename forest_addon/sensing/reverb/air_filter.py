"""The air as a filter that changes in time: what arrives after t has lost e^{-b(f)ct}.

Samples go in that have lost nothing yet, and those that have come out. e^{-b(f)x} ≈ Σ_q A_q(f)·B_q(x) by
singular value decomposition, so that a few products and transforms do, for all paths at once:
Σ_q A_q · FFT(B_q(ct)·samples). A scattered sound of several arrivals from one trunk loses by the axis'
path and not by each arrival's own; ``undone`` changes the filters of such sounds accordingly.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial import chebyshev
from scipy import fft, linalg

from ...acoustics.air import absorption
from ...spec import Air

NODES = 120  # in distance
FREQUENCIES = 500
PADDING = 512  # samples after the end; the filters' answers are shorter
BEFORE = 2048  # samples before 0 for which the air's gain is defined
SHARE = 0.2  # of the tolerance, for leaving out terms


class AirFilter:
    """The air at one sampling rate, to a relative tolerance."""

    def __init__(self, rate: float, air: Air, tolerance: float) -> None:
        self.rate, self.air, self.tolerance = rate, air, tolerance
        self.step = air.speed() / rate  # metres a sample
        self._bases: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        self._tables: dict[tuple[int, int, int, type], tuple[np.ndarray, np.ndarray]] = {}

    def loss(self, frequency: np.ndarray) -> np.ndarray:
        """b(f) in nepers per metre."""
        air = self.air
        return absorption(frequency, air.temperature_c, air.humidity, air.pressure_kpa)

    def apply(self, samples: np.ndarray, first: int) -> np.ndarray:
        """(N,) samples with the air's loss; samples[0] is heard ``first`` samples after the source.

        What is heard before the source sounds, the roll-off's ringing, is gained e^{-b(f)ct} > 1.
        """
        size = fft.next_fast_len(len(samples) + PADDING, real=True)
        gains, shapes = self._table(first, size, len(samples), samples.dtype.type)
        spectra = fft.rfft(shapes * samples, size, axis=1)
        spectra *= gains
        filtered: np.ndarray = fft.irfft(spectra.sum(axis=0), size)[: len(samples)]
        return filtered

    def undone(self, filters: np.ndarray, lead: int, rounds: int = 4) -> np.ndarray:
        """Filters (R, T) that become the given ones when the air is applied from -lead on.

        By fixed-point iteration; each round's error is that of the one before times the air's loss
        within a filter, a few per cent.
        """
        changed = filters.copy()
        for _ in range(rounds):
            changed += filters - np.array([self.apply(row, -lead) for row in changed])
        return changed

    def _table(
        self, first: int, size: int, count: int, dtype: type
    ) -> tuple[np.ndarray, np.ndarray]:
        """(Q, size // 2 + 1) gains in frequency and (Q, count) gains in time."""
        key = (first, size, count, dtype)
        if key not in self._tables:
            octave = max(10, math.ceil(math.log2(first + count + 1)))
            series, nodes, right = self._basis(octave)
            frequency = np.arange(size // 2 + 1) * (self.rate / size)
            gains = np.exp(-np.outer(self.loss(frequency), nodes)) @ right
            x = _to_unit((np.arange(count) + first) * self.step, *self._span(octave))
            shapes = chebyshev.chebval(x, series)
            self._tables[key] = gains.T.astype(dtype), shapes.astype(dtype)
        return self._tables[key]

    def _span(self, octave: int) -> tuple[float, float]:
        return -BEFORE * self.step, (1 << octave) * self.step

    def _basis(self, octave: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Chebyshev series (C, Q) of B_q, the nodes (C,) in metres, and what turns e^{-bx} into A_q."""
        if octave not in self._bases:
            low, high = self._span(octave)
            x = np.cos(math.pi * (np.arange(NODES) + 0.5) / NODES)
            nodes = low + (high - low) * ((x + 1.0) / 2.0) ** 2
            loss = self.loss(np.linspace(0.0, self.rate / 2, FREQUENCIES))
            _, size, right = linalg.svd(np.exp(-np.outer(loss, nodes)), full_matrices=False)
            rest = np.sqrt(np.cumsum(size[::-1] ** 2)[::-1])
            terms = int(np.count_nonzero(rest > SHARE * self.tolerance * rest[0]))
            series = chebyshev.chebfit(x, right[:terms].T, NODES - 1)
            self._bases[octave] = series, nodes, right[:terms].T
        return self._bases[octave]


def _to_unit(distance: np.ndarray, low: float, high: float) -> np.ndarray:
    """Distances from low to high as -1 to 1, by their square root: the near ones are wide apart."""
    share = np.clip((distance - low) / (high - low), 0.0, 1.0)
    unit: np.ndarray = 2.0 * np.sqrt(share) - 1.0
    return unit
