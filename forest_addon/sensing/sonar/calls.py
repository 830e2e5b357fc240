"""Frequencies and calls of a sonar: the band and its window, the grid of a record, what is sent.

A ``Band`` is what a sonar listens to, a ``BandGrid`` the even frequencies that belong to the length of its
record.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import fft

from ...acoustics.spectrum import phasors
from ...spec import Sonar

SAMPLED = 17  # frequencies of a mean over the band
TAILS = 64.0  # periods of the bandwidth after which the Hann pulse has fallen to 1/(π·64³) = 1e-6
MOST_SAMPLES = 2**27


@dataclass(frozen=True)
class Band:
    """A band from ``low`` to ``high`` Hz; the same twice is a tone."""

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
        return np.asarray(0.5 - 0.5 * np.cos(2.0 * math.pi * share))


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


# Calls of a sonar, as samples and as spectra.
#
# A pulse of the whole band (Hann window, the seed's), a hyperbolic sweep (FM), a tone that ends in such a
# sweep (CF-FM, a horseshoe bat's), or samples of one's own. A call is sent at 1 m on the axis with a
# largest pressure of 1; an echo's spectrum is the call's times the transfer function of the scene.


EDGE = 0.1  # share of a call over which it fades in, and out
ROOM = 0.05  # share of the band left free at each end, where a call's spectrum falls off
SWEEP = 0.2  # share of a CF-FM call that is its sweep


@dataclass(frozen=True)
class Call:
    """N samples of pressure re 1 m on the axis, the largest 1, and their rate in Hz; or of another sound."""

    samples: np.ndarray
    sample_rate: float

    @property
    def duration(self) -> float:
        """Seconds."""
        return len(self.samples) / self.sample_rate

    def spectrum(self, frequency: np.ndarray) -> np.ndarray:
        """(K,) complex Σ x_n e^{-i2πfn/rate} at frequencies that are even steps apart."""
        first, last = float(frequency[0]), float(frequency[-1])
        grid = first, (last - first) / max(len(frequency) - 1, 1), len(frequency)
        return _spectrum_on(self.samples.astype(np.float64).tobytes(), self.sample_rate, *grid)

    def spectra_on(
        self, start: float, spacing: float, count: int, factors: np.ndarray, lead: float = 0.0
    ) -> np.ndarray:
        """(W, K) the spectra of the call played faster by factors (W,), at ``count`` frequencies from
        ``start`` Hz, ``spacing`` apart; its own time is ``lead`` s after it begins (Bluestein 1970)."""
        place = np.arange(len(self.samples)) - lead * self.sample_rate
        step = spacing / (self.sample_rate * factors[:, None])  # turns a sample and bin
        bins, first = np.arange(count), start / (self.sample_rate * factors[:, None])
        length = fft.next_fast_len(count + len(place) - 1)
        # With n·k = (n² + k² - (n - k)²)/2 the sum is a convolution.
        other = np.arange(1 - len(place), count) + lead * self.sample_rate  # k - n
        sent = self.samples * phasors(first * place + step * place**2 / 2)
        chirp = fft.fft(phasors(-step * other**2 / 2), length)
        summed = fft.ifft(fft.fft(sent, length) * chirp)
        spectra: np.ndarray = summed[:, len(place) - 1 : len(place) - 1 + count]
        spectra *= phasors(step * bins**2 / 2) / factors[:, None]
        return spectra


@lru_cache(maxsize=16)
def _spectrum_on(
    samples: bytes, rate: float, start: float, spacing: float, count: int
) -> np.ndarray:
    """(K,) spectrum of samples (N,) float64; kept, since a call is the same from ping to ping."""
    call = Call(np.frombuffer(samples), rate)
    return np.asarray(call.spectra_on(start, spacing, count, np.ones(1))[0])


def synthesise(sonar: Sonar) -> Call:
    """The FM or CF-FM call of a sonar, a little within its band."""
    rate = sonar.sample_rate
    time = np.arange(max(2, round(sonar.call_duration * rate))) / rate
    room = ROOM * (sonar.band[1] - sonar.band[0])
    low, high = sonar.band[0] + room, sonar.band[1] - room
    sweep = sonar.call_duration * (1.0 if sonar.call == "fm" else SWEEP)
    turns = _sweep(time - (sonar.call_duration - sweep), sweep, low, high)
    samples = np.sin(2.0 * math.pi * turns) * _fade(len(time))
    return Call(samples / np.abs(samples).max(), rate)


def resampled(samples: np.ndarray, rate: float, sonar: Sonar) -> Call:
    """Samples (N,) or (N, channels) of any rate at the sonar's, the first channel, as loud as they are.

    Raises
    ------
    ValueError : they are silent.
    """
    from scipy.signal import resample

    first = np.asarray(samples, dtype=np.float64).reshape(len(samples), -1)[:, 0]
    if not np.abs(first).max(initial=0.0) > 0:
        raise ValueError("the WAV file is silent; give one with a sound in it")
    count = max(1, round(len(first) * sonar.sample_rate / rate))
    if count != len(first):
        first = resample(first, count)
    return Call(first, sonar.sample_rate)


def _sweep(time: np.ndarray, length: float, low: float, high: float) -> np.ndarray:
    """Turns of a tone at ``high`` until 0, then of a fall to ``low`` in which the period grows evenly."""
    rate = (1.0 / low - 1.0 / high) / length  # of the period, per second
    falling = np.log1p(np.maximum(time, 0.0) * rate * high) / rate if rate > 0 else high * time
    return np.where(time < 0, high * time, falling)


def _fade(count: int) -> np.ndarray:
    """(N,) Tukey's window, whose cosines take ``EDGE`` of its length at either end, without its zeros."""
    # Here, since scipy.signal takes a second to import.
    place = np.arange(1, count + 1) / (count + 1)
    return np.asarray(
        0.5 - 0.5 * np.cos(math.pi * np.clip(np.minimum(place, 1 - place) / EDGE, 0, 1))
    )
