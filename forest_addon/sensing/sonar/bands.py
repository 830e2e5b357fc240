"""The frequencies of an echo: the band and its window, the grid of the record.

A ``Band`` is what a sonar listens to, a ``BandGrid`` the even frequencies that belong to the length of its
record.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import fft

SAMPLED = 17  # frequencies of a mean over the band
TAILS = 64.0  # periods of the bandwidth after which the Hann pulse has fallen to 1/(π·64³) = 1e-6
MOST_SAMPLES = 2**27


@dataclass(frozen=True)
class Band:
    """From ``low`` to ``high`` Hz; the same twice is a tone."""

    low: float
    high: float

    def sample(self, count: int = SAMPLED) -> tuple[np.ndarray, np.ndarray]:
        """A few frequencies (Q,) Hz and the weights (Q,) of a mean over the band by a Hann window."""
        if self.low == self.high:
            return np.array([self.low]), np.ones(1)
        share = (np.arange(count) + 0.5) / count
        weight = np.sin(math.pi * share) ** 2
        return self.low + share * (self.high - self.low), weight / weight.sum()

    def window(self, frequency: np.ndarray) -> np.ndarray:
        """Hann window over the band, 0 beyond, at frequencies (K,)."""
        if self.low == self.high:
            return np.ones(len(frequency))
        share = np.clip((frequency - self.low) / (self.high - self.low), 0.0, 1.0)
        turn = 2.0 * math.pi * share
        window: np.ndarray = 0.5 - 0.5 * np.cos(turn)
        return window


@dataclass(frozen=True)
class BandGrid:
    """``count`` frequencies from ``start`` Hz, ``spacing`` apart, of a record that holds ``samples``.

    length : samples of the transform; what is beyond ``samples`` is time before the call.
    ends : Hz, of the band that they lie in.
    """

    start: float
    spacing: float
    count: int
    samples: int
    length: int
    ends: tuple[float, float]

    @property
    def frequency(self) -> np.ndarray:
        """(K,) Hz."""
        return self.start + self.spacing * np.arange(self.count)


def grid_of(band: Band, rate: float, latest: float, record: float, after: float = 0.0) -> BandGrid:
    """The grid of a record that no echo wraps around in.

    latest : seconds until the last echo. record : seconds that are wanted, 0: as long as needed.
    after : seconds that a call goes on.

    Raises
    ------
    ValueError : the record would be longer than memory; the sentence says what to change.
    """
    width = band.high - band.low
    tail = TAILS / width if width else 0.0
    needed = (latest + after + 2.0 * tail) * rate
    wanted = (record or latest + after + tail) * rate
    if max(needed, wanted) > MOST_SAMPLES:
        raise ValueError(
            f"the echo would have {max(needed, wanted):.2g} samples; "
            "widen the band, or lower max_range, record or sample_rate"
        )
    samples = max(1, math.ceil(wanted))
    if not width:
        return BandGrid(band.low, rate, 1, samples, samples, (band.low, band.high))
    length = fft.next_fast_len(max(math.ceil(needed), math.ceil(wanted + tail * rate)))
    spacing = rate / length
    first, last = math.ceil(band.low / spacing), math.floor(band.high / spacing)
    count = last - first + 1
    return BandGrid(first * spacing, spacing, count, samples, length, (band.low, band.high))
