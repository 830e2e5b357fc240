"""A dry sound in the forest: convolution with an impulse response, at the impulse response's rate.

The dry sound is resampled by a polyphase filter where rates differ (Kaiser window, 80 dB), so that its
pitch stays. Every channel of the impulse response is one of the wet sound; a dry sound of several
channels is mixed to one, because a source is a point.

Background noise at a stated level in each octave, the same at all times and independent by channel.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np


def auralise(
    response: np.ndarray, dry: np.ndarray, response_rate: float, dry_rate: float
) -> np.ndarray:
    """(N + M - 1, C) wet samples at ``response_rate``.

    response : (N,) or (N, C). dry : (M,) or (M, D), mixed to one channel.
    """
    from scipy.signal import fftconvolve  # here: it takes half a second to import

    mono = np.asarray(dry, np.float64)
    mono = mono.mean(axis=1) if mono.ndim == 2 else mono
    mono = resample(mono, dry_rate, response_rate)
    channels = np.asarray(response, np.float64).reshape(len(response), -1)
    return fftconvolve(channels, mono[:, None], axes=0)


def resample(samples: np.ndarray, rate: float, new_rate: float) -> np.ndarray:
    """(M,) samples at another rate; the band above half the lower rate is taken away."""
    if rate == new_rate:
        return samples
    from scipy.signal import resample_poly

    ratio = Fraction(new_rate).limit_denominator(10**6) / Fraction(rate).limit_denominator(10**6)
    ratio = ratio.limit_denominator(10_000)
    return resample_poly(samples, ratio.numerator, ratio.denominator, window=("kaiser", 8.0))


def normalised(samples: np.ndarray, peak_db: float) -> tuple[np.ndarray, float]:
    """Samples whose largest is at ``peak_db`` dB re full scale, and the gain in dB; silence stays."""
    peak = float(np.abs(samples).max(initial=0.0))
    if peak == 0:
        return samples, 0.0
    gain = 10.0 ** (peak_db / 20.0) / peak
    return samples * gain, float(20.0 * np.log10(gain))


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
    noise = np.empty((count, len(gains)))
    for column, gain in enumerate(gains):
        white = np.fft.rfft(rng.standard_normal(size))
        noise[:, column] = gain * np.fft.irfft(white * np.sqrt(power), size)[:count]
    return noise
