"""Background noise at a stated level in each octave, the same at all times and independent by channel."""

from __future__ import annotations

import numpy as np

LOWEST = 63.0  # Hz, middle of the first octave


def background(
    levels_db: tuple[float, ...],
    dry: np.ndarray,
    rate: float,
    count: int,
    gains: tuple[float, ...],
    rng: np.random.Generator,
) -> np.ndarray:
    """(count, C) noise whose mean square in the octaves from 63 Hz is so many dB re that of a dry sound (N,).

    gains : (C,) of amplitude, 1 for a microphone. Octaves above half the rate are left out.
    """
    size = max(count, 1)
    frequency = np.arange(size // 2 + 1) * (rate / size)
    power = np.zeros(len(frequency))
    mean = float(np.mean(np.square(dry))) if len(dry) else 0.0
    for number, level in enumerate(levels_db):
        middle = LOWEST * 2.0**number
        inside = (frequency >= middle / np.sqrt(2)) & (frequency < middle * np.sqrt(2))
        width = middle * np.sqrt(0.5)  # Hz; one that is cut by the band has its part of the energy
        power[inside] = mean * 10.0 ** (level / 10.0) * rate / (2.0 * width)
    found = np.empty((count, len(gains)))
    for column, gain in enumerate(gains):
        white = np.fft.rfft(rng.standard_normal(size))
        found[:, column] = gain * np.fft.irfft(white * np.sqrt(power), size)[:count]
    return found
