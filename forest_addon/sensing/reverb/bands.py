"""Samples from spectra that ring long at low frequencies and briefly at high ones.

A trunk's answer goes with f^1.5 towards 0 and dies away as t^-2.5; so do the air's relaxations and the ground
far below 100 Hz. Above, answers are over within milliseconds. A function that gives a spectrum on any even
grid comes in; it is asked three times, for bands that give way to each other smoothly, each on a grid as fine
as what rings there needs, and the samples of all bands together go out. Nothing that a tolerance would notice
wraps around, at the cost of a few thousand bins. ``roll_off`` is the end of every response's band.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import fft, special

SPREAD = 256  # samples; so far does the roll-off spread an arrival, to 1e-8 of its peak
SPANS = ((10.0, 40.0), (150.0, 600.0))  # Hz over which a band gives way to the next
HIGH_RINGING, MIDDLE_RINGING = 0.5, 2.5  # s, besides what thick trunks take
BEFORE = 0.3  # of it, before the first sound: losses without dispersion sound there
CREEPING = 40.0  # a/c; sound that creeps around a trunk has left it
LOW_RINGING = 2.5  # s, after which LEFT of a trunk's sound is still to come, at the least
LEFT, POWER = (
    3e-7,
    2.3,
)  # of all, a metre thick; of the time by which it falls (measured, 2 cm to 2 m)
LONGEST = 400.0  # s
QUIETEST = 1e-5  # of the whole: tenths of a record that are judged
STEEP = 5.5  # of the step between two bands
BESIDE = 400  # samples of a slow band beside the record, which fade out
ROOM = 4.0  # sampling rate of a slow band over its highest frequency

SpectrumOf = Callable[[float, int, int], np.ndarray]  # spacing, first and last bin; (last + 1,)


@dataclass(frozen=True)
class OctaveBand:
    """low, high : Hz over which it rises and falls, None at an end. ringing : s that it lasts."""

    low: tuple[float, float] | None
    high: tuple[float, float] | None
    ringing: float

    def gain(self, frequency: np.ndarray) -> np.ndarray:
        """(F,) share of the whole."""
        gain = np.ones(len(frequency))
        if self.high:
            gain = fall(frequency, self.high)
        return gain * (1.0 - fall(frequency, self.low)) if self.low else gain


def fall(frequency: np.ndarray, span: tuple[float, float]) -> np.ndarray:
    """1 to 0 over a span of frequencies; 4e-15 from both at its ends."""
    place = 2.0 * (frequency - span[0]) / (span[1] - span[0]) - 1.0
    smooth: np.ndarray = 0.5 * special.erfc(STEEP * place)
    return np.where(place <= -1.0, 1.0, np.where(place >= 1.0, 0.0, smooth))


def roll_off(share: np.ndarray) -> np.ndarray:
    """Gain at a share of the sampling rate: 1 up to 0.45, a Gaussian step down to 0 at 0.5.

    A band that ends at once gives every arrival that is not on a sample tails of 1/t. A complex share has
    the step's analytic continuation.
    """
    step = 0.5 * special.erfc((share - 0.475) / 0.025 * 4.0)  # 8e-9 from 0 and 1 at the ends
    return np.where(np.real(share) <= 0.45, 1.0, np.where(np.real(share) >= 0.5, 0.0, step))


def bands_of(
    rate: float, thickest: float, speed: float, tolerance: float
) -> tuple[OctaveBand, ...]:
    """The lowest first. thickest : radius of the thickest trunk, m. tolerance : 0 for the finest."""
    aim = max(tolerance, 1e-7) * QUIETEST * 0.3
    low = LOW_RINGING * max(1.0, LEFT * max(thickest, 0.1) / aim) ** (1.0 / POWER)
    creeping = CREEPING * thickest / speed
    ringing = (min(LONGEST, low), MIDDLE_RINGING + creeping, HIGH_RINGING + creeping)
    spans = [span for span in SPANS if span[1] < 0.4 * rate]
    edges = (None, *spans, None)
    return tuple(OctaveBand(edges[n], edges[n + 1], ringing[n]) for n in range(len(spans) + 1))


def samples_of(
    spectrum: SpectrumOf,
    bands: tuple[OctaveBand, ...],
    rate: float,
    count: int,
    last: float,
    first: float = 0.0,
) -> np.ndarray:
    """(count,) samples at ``rate`` Hz with the band's smooth end.

    first, last : s, when the first and the last sound begin. A band is transformed from a part of its
    ringing before the first to all of it after the last; elsewhere it is silent.
    """
    total = np.zeros(count)
    for band in bands:
        step = 1 if band.high is None else max(1, int(rate / (ROOM * band.high[1])))
        slow = rate / step
        beside = 0 if step == 1 else BESIDE
        start = max(0, math.floor((first - BEFORE * band.ringing) * slow) - SPREAD) * step
        if start >= count:
            continue
        longest = last - start / rate if first > 0 else max(last, count / rate)
        size = math.ceil((longest + band.ringing) * slow) + 2 * max(SPREAD, beside)
        size = int(fft.next_fast_len(size, real=True))
        spacing = slow / size
        top = 0.5 * rate if band.high is None else band.high[1]
        highest = min(size // 2, math.ceil(top / spacing))
        lowest = max(1, math.floor((band.low[0] if band.low else 0.0) / spacing))
        frequency = np.arange(highest + 1) * spacing
        part = np.zeros(size // 2 + 1, np.complex128)
        gain = band.gain(frequency) * roll_off(frequency / rate)
        part[: highest + 1] = spectrum(spacing, lowest, highest) * gain
        if start > 0:
            part *= np.exp(2j * math.pi / size * (np.arange(len(part)) * (start // step) % size))
        samples = fft.irfft(part, size)
        needed = min(count - start, (size - SPREAD - beside) * step)
        total[start : start + needed] += (
            samples[:needed] if step == 1 else _upsampled(samples, step, needed)
        )
    return total


def _upsampled(periodic: np.ndarray, step: int, count: int) -> np.ndarray:
    """(count,) at ``step`` times the rate, of samples that go round; nothing is in their upper half band."""
    needed = -(-count // step) + 2 * BESIDE
    some = np.take(periodic, np.arange(-BESIDE, needed - BESIDE), mode="wrap")
    return upsampled(some, step, BESIDE)[BESIDE * step : BESIDE * step + count]


def upsampled(samples: np.ndarray, step: int, beside: int) -> np.ndarray:
    """(N·step,) samples at ``step`` times the rate, of a band that has nothing at its old end.

    beside : samples at both ends that fade out, and are changed.
    """
    fade = fall(np.arange(beside) + 0.5, (0.0, float(beside)))
    samples[: len(fade)] *= fade[::-1]
    samples[-len(fade) :] *= fade
    size = fft.next_fast_len(len(samples) + len(fade), real=True)
    spectrum = fft.rfft(samples, size)
    wide = np.zeros(size * step // 2 + 1, spectrum.dtype)
    wide[: len(spectrum)] = spectrum
    whole: np.ndarray = fft.irfft(wide, size * step)
    return whole[: len(samples) * step]
