"""Measures of a recorded or simulated decay: T20 and C50 by octave, and the decay's shape.

A forest's sound falls as a power of time rather than as an exponential, because scattered sound spreads as it
travels. Both laws are fitted, by least squares in dB, to the energy of short frames of an octave; the
residual says which it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import signal
from scipy.io import wavfile

from forest_addon.sensing.reverb.metrics import octave, onset, reverberation_time, room_metrics
from forest_addon.spec import SpecError

FRAME = 0.02  # s
BEGIN = 0.03  # s after the onset, from where laws are fitted
FALL = 40.0  # dB below the largest frame after BEGIN, down to where
LEAD = 0.002  # s kept before the onset


@dataclass(frozen=True)
class Decay:
    """By octave (B,): Hz, t20 in s, c50 in dB, residuals of both laws in dB, the power law's exponent."""

    band: np.ndarray
    t20: np.ndarray
    c50: np.ndarray
    exponential: np.ndarray
    power: np.ndarray
    exponent: np.ndarray


def decay_of(
    samples: np.ndarray, rate: float, bands: np.ndarray, left_db: np.ndarray | None = None
) -> Decay:
    """Of an impulse response; a band of 0 is the whole."""
    measures = room_metrics(samples, rate, left_db)
    rows = [int(np.flatnonzero(measures.band == band)[0]) for band in bands]
    start = onset(samples)
    parts = [octave(samples, rate, float(band)) if band else samples for band in bands]
    laws = np.array([_laws(part, rate, start) for part in parts])
    return Decay(bands, measures.t20[rows], measures.c50[rows], *laws.T)


def read_recording(path: Path, rate: float) -> np.ndarray:
    """(N,) samples at ``rate`` from shortly before the onset on, the mean of all channels.

    Raises
    ------
    SpecError : the file is no recording that can be read.
    """
    try:
        own, found = wavfile.read(path)
    except (OSError, ValueError) as problem:
        raise SpecError(str(path), f"is no WAV that can be read ({problem})") from None
    samples = np.asarray(found, np.float64)
    samples = samples.mean(axis=1) if samples.ndim == 2 else samples
    if own != rate:
        divisor = math.gcd(int(own), int(rate))
        samples = signal.resample_poly(samples, int(rate) // divisor, int(own) // divisor)
    return np.asarray(samples[max(0, onset(samples) - int(LEAD * rate)) :])


def missing_loss(samples: np.ndarray, rate: float, band: float, t20: float, speed: float) -> float:
    """dB a metre of path that an octave must lose besides for its T20 to be ``t20``; NaN: it cannot."""
    heard = octave(samples, rate, band)
    metres = np.arange(len(heard)) * (speed / rate)

    def apart(loss: float) -> float:
        return (
            reverberation_time(heard * 10.0 ** (-loss * metres / 20.0), rate, (-5.0, -25.0)) - t20
        )

    low, high = -0.05, 1.0
    if not (apart(low) > 0 > apart(high)):
        return math.nan
    for _ in range(14):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if apart(middle) > 0 else (low, middle)
    return 0.5 * (low + high)


def _laws(samples: np.ndarray, rate: float, start: int) -> tuple[float, float, float]:
    """Residuals of an exponential and of a power law in dB, and the exponent of the energy's."""
    frame = round(FRAME * rate)
    first = start + round(BEGIN * rate)
    count = (len(samples) - first) // frame
    if count < 8:
        return math.nan, math.nan, math.nan
    energy = np.square(samples[first : first + count * frame]).reshape(count, frame).sum(axis=1)
    level = 10.0 * np.log10(np.maximum(energy, 1e-30))
    quiet = np.flatnonzero(level < level[:5].max() - FALL)
    level = level[: int(quiet[0])] if len(quiet) else level
    if len(level) < 8:
        return math.nan, math.nan, math.nan
    time = BEGIN + FRAME * (np.arange(len(level)) + 0.5)
    found = []
    for axis in (time, 10.0 * np.log10(time)):
        slope, offset = np.polyfit(axis, level, 1)
        found.append((float(np.std(level - slope * axis - offset)), float(slope)))
    return found[0][0], found[1][0], -found[1][1]
