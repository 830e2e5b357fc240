"""Room measures of an impulse response: energy decay, reverberation time, clarity (ISO 3382-1).

An impulse response goes in as samples, numbers come out, of the whole band or of octaves. The onset,
where early and late sound are counted from, is the first sample within 20 dB of the largest (ISO
3382-1, 5.3.2 note); octaves count from the onset of the whole band. The decay is integrated to the end
of the record, without a correction for noise: simulated records have none. A record that ends before the
sound does is short of what comes later: a measure that this would change is NaN.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

ONSET_DB = -20.0
BELOW = 10.0  # dB that the energy after the record must lie below the end of a decay that is read
RAMP = 1 / 3  # octave over which neighbouring octave filters share a frequency
EARLIEST, LATEST = 31.25, 16000.0  # Hz, middle of the lowest and of the highest octave
ECHO_WINDOW = 0.025  # s over which the energy is levelled
ECHO_FRAME = 0.2  # s of which the density is that of the middle
GAUSSIAN = 0.5 - 1.0 / math.pi  # echo density of Gaussian noise, see ``echo_density``


@dataclass(frozen=True)
class RoomMetrics:
    """Measures of one impulse response: the whole band first, then octaves.

    band : (B,) Hz, the octaves' middle; 0 stands for the whole band.
    edt, t20, t30, t60 : (B,) seconds a fall of 60 dB takes, read from 0 to -10, -5 to -25, -5 to -35 and
    -5 to -65 dB of the energy decay; NaN where it does not reach so far.
    All are NaN where the record is cut too early for them.
    c50, c80 : (B,) dB. d50 : (B,) share of the energy. centre_time : (B,) seconds after the onset.
    """

    band: np.ndarray
    edt: np.ndarray
    t20: np.ndarray
    t30: np.ndarray
    t60: np.ndarray
    c50: np.ndarray
    c80: np.ndarray
    d50: np.ndarray
    centre_time: np.ndarray


def room_metrics(
    samples: np.ndarray, sample_rate: float, left_db: np.ndarray | None = None
) -> RoomMetrics:
    """All measures of an impulse response (N,).

    left_db : (B,) energy after the record's end, dB re all, by band; None: nothing.
    """
    octaves = octave_bands(sample_rate)
    left = np.full(1 + len(octaves), -math.inf) if left_db is None else left_db
    start = onset(samples)
    rows = []
    for band, cut in zip((0.0, *octaves), left.tolist(), strict=True):
        heard = octave(samples, sample_rate, band) if band else np.asarray(samples, np.float64)
        rows.append(
            [
                band,
                *(
                    reverberation_time(heard, sample_rate, fall, cut)
                    for fall in ((0.0, -10.0), (-5.0, -25.0), (-5.0, -35.0), (-5.0, -65.0))
                ),
                *(
                    value if cut <= -2.0 * BELOW else math.nan
                    for value in (
                        clarity_db(heard, sample_rate, 0.05, start),
                        clarity_db(heard, sample_rate, 0.08, start),
                        definition(heard, sample_rate, 0.05, start),
                        centre_time(heard, sample_rate, start),
                    )
                ),
            ]
        )
    return RoomMetrics(*np.array(rows).T)


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
    samples: np.ndarray,
    sample_rate: float,
    fall: tuple[float, float] = (-5.0, -35.0),
    left_db: float = -math.inf,
) -> float:
    """Seconds in which the energy decay falls by 60 dB, from a straight line through part of it.

    fall : dB from, to; (-5, -35) is the T30 of ISO 3382-1, (-5, -25) the T20.
    left_db : energy after the record's end, dB re all. The decay lacks it, and falls too fast.

    NaN where the decay does not reach so far, or does so within three samples, or where what is left is
    not BELOW its end.
    """
    if left_db > fall[1] - BELOW:
        return math.nan
    decay = energy_decay_db(samples)
    used = np.flatnonzero((decay <= fall[0]) & (decay >= fall[1]))
    used = used[used >= onset(samples)]
    if len(used) < 3 or not (decay < fall[1]).any():
        return math.nan
    slope = np.polyfit(used / sample_rate, decay[used], 1)[0]  # dB/s
    return float(-60.0 / slope)


def onset(samples: np.ndarray) -> int:
    """The first sample within 20 dB of the largest; 0 for silence."""
    size = np.abs(np.asarray(samples, np.float64))
    largest = size.max(initial=0.0)
    return int(np.argmax(size >= largest * 10.0 ** (ONSET_DB / 20.0))) if largest > 0 else 0


def clarity_db(
    samples: np.ndarray, sample_rate: float, early: float = 0.05, start: int | None = None
) -> float:
    """Energy of the first ``early`` seconds after the onset over that of the rest, dB (C50, C80).

    start : sample of the onset; None: of these samples. What lies before it counts as early.

    Inf where nothing follows, NaN for silence.
    """
    first, rest = _early_and_late(samples, sample_rate, early, start)
    if rest == 0:
        return math.inf if first > 0 else math.nan
    return 10.0 * math.log10(first / rest) if first > 0 else -math.inf


def definition(
    samples: np.ndarray, sample_rate: float, early: float = 0.05, start: int | None = None
) -> float:
    """Share of the energy in the first ``early`` seconds after the onset (D50); NaN for silence."""
    first, rest = _early_and_late(samples, sample_rate, early, start)
    return first / (first + rest) if first + rest > 0 else math.nan


def centre_time(samples: np.ndarray, sample_rate: float, start: int | None = None) -> float:
    """Seconds from the onset to the centre of gravity of the energy after it; NaN for silence."""
    first = onset(samples) if start is None else start
    energy = np.square(np.asarray(samples, np.float64)[first:])
    total = float(energy.sum())
    return float(energy @ np.arange(len(energy))) / total / sample_rate if total > 0 else math.nan


def _early_and_late(
    samples: np.ndarray, sample_rate: float, early: float, start: int | None
) -> tuple[float, float]:
    energy = np.square(np.asarray(samples, np.float64))
    border = (onset(samples) if start is None else start) + round(early * sample_rate)
    return float(energy[:border].sum()), float(energy[border:].sum())


def octave_bands(sample_rate: float) -> tuple[float, ...]:
    """Middle of the octaves that lie wholly below 0.45 of the sampling rate, where the band ends."""
    middles = EARLIEST * 2.0 ** np.arange(1 + round(math.log2(LATEST / EARLIEST)))
    within = middles * 2.0 ** (0.5 + RAMP / 2) <= 0.45 * sample_rate
    return tuple(middles[within].tolist())


def octave(samples: np.ndarray, sample_rate: float, middle: float) -> np.ndarray:
    """(N,) the samples' part in one octave, by a filter without phase.

    The power gains of neighbouring octaves add up to 1: the energy of a sound is that of its octaves.
    """
    ringing = math.ceil(8.0 / (RAMP * middle) * sample_rate)  # also before the samples
    size = scipy.fft.next_fast_len(len(samples) + ringing, real=True)
    frequency = np.arange(size // 2 + 1) * (sample_rate / size)
    with np.errstate(divide="ignore"):
        away = np.abs(np.log2(frequency / middle))  # octaves
    share = np.clip((away - (0.5 - RAMP / 2)) / RAMP, 0.0, 1.0)
    filtered: np.ndarray = scipy.fft.irfft(
        scipy.fft.rfft(np.asarray(samples, np.float64), size) * np.cos(0.5 * math.pi * share), size
    )
    return filtered[: len(samples)]


def echo_density(
    samples: np.ndarray, sample_rate: float, step: float = 0.01
) -> tuple[np.ndarray, np.ndarray]:
    """Times (F,) in seconds and echo densities (F,): near 0 for few echoes, 1 for Gaussian noise.

    The sparsity measure of Tukuljac et al. 2019: the energy, levelled by its mean over 25 ms (a Tukey
    window), is sorted in falling order within a frame of 200 ms; the density is the place of its centre
    of gravity in the frame, over that of Gaussian noise, E[min(x², y²)]/2 = 1/2 - 1/π. NaN for silence.

    step : seconds between frames.
    """
    energy = np.square(np.asarray(samples, np.float64))
    share = np.linspace(0.0, 1.0, max(3, round(ECHO_WINDOW * sample_rate)))
    window = 0.5 - 0.5 * np.cos(math.pi * np.minimum(1.0, 4.0 * np.minimum(share, 1.0 - share)))
    size = scipy.fft.next_fast_len(len(energy) + len(window) - 1, real=True)
    spectrum = scipy.fft.rfft(energy, size) * scipy.fft.rfft(window / window.sum(), size)
    mean = scipy.fft.irfft(spectrum, size)[(len(window) - 1) // 2 :][: len(energy)]
    floor = 1e-12 * energy.max(initial=0.0)  # what the transform of the convolution leaves
    level = np.divide(energy, mean, out=np.zeros_like(energy), where=mean > floor)
    length = max(2, round(ECHO_FRAME * sample_rate))
    starts = np.arange(0, max(0, len(level) - length) + 1, max(1, round(step * sample_rate)))
    place = (np.arange(length) + 0.5) / length
    density = np.full(len(starts), math.nan)
    for row, first in enumerate(starts):
        frame = np.sort(level[first : first + length])[::-1]
        if frame.sum() > 0:
            density[row] = frame @ place[: len(frame)] / frame.sum() / GAUSSIAN
    return (starts + length / 2) / sample_rate, density
