"""What an impulse response says of a place: energy decay, reverberation time, clarity (ISO 3382-1).

An impulse response goes in as samples, broadband as it is. The onset, where early and late sound are
counted from, is the first sample within 20 dB of the largest (ISO 3382-1, 5.3.2 note).
"""

from __future__ import annotations

import math

import numpy as np

ONSET_DB = -20.0


def energy_decay_db(samples: np.ndarray) -> np.ndarray:
    """(N,) energy still to come, dB re all of it (Schroeder's backward integral, 1965).

    -inf where nothing follows; all -inf for silence.
    """
    remaining = np.cumsum(np.square(np.asarray(samples, np.float64))[::-1])[::-1]
    total = remaining[0] if len(remaining) else 0.0
    share = remaining / total if total > 0 else np.zeros(len(remaining))
    with np.errstate(divide="ignore"):
        return np.asarray(10.0 * np.log10(share))


def reverberation_time(
    samples: np.ndarray, sample_rate: float, fall: tuple[float, float] = (-5.0, -35.0)
) -> float:
    """Seconds in which the energy decay falls by 60 dB, from a straight line through part of it.

    fall : dB from, to; (-5, -35) is the T30 of ISO 3382-1, (-5, -25) the T20.

    NaN where the decay does not reach so far, or does so within three samples.
    """
    decay = energy_decay_db(samples)
    used = np.flatnonzero((decay <= fall[0]) & (decay >= fall[1]))
    if len(used) < 3 or not (decay < fall[1]).any():
        return math.nan
    slope = np.polyfit(used / sample_rate, decay[used], 1)[0]  # dB/s
    return float(-60.0 / slope)


def onset(samples: np.ndarray) -> int:
    """The first sample within 20 dB of the largest; 0 for silence."""
    size = np.abs(np.asarray(samples, np.float64))
    largest = size.max(initial=0.0)
    return int(np.argmax(size >= largest * 10.0 ** (ONSET_DB / 20.0))) if largest > 0 else 0


def clarity_db(samples: np.ndarray, sample_rate: float, early: float = 0.05) -> float:
    """Energy of the first ``early`` seconds after the onset over that of the rest, dB (C50).

    What lies before the onset counts as early. Inf where nothing follows, NaN for silence.
    """
    energy = np.square(np.asarray(samples, np.float64))
    border = onset(samples) + round(early * sample_rate)
    first, rest = float(energy[:border].sum()), float(energy[border:].sum())
    if rest == 0:
        return math.inf if first > 0 else math.nan
    return 10.0 * math.log10(first / rest)
