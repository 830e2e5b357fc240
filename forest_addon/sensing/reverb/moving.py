"""Sound heard where a source or a receiver moves: a dry one through impulse responses of moments.

Responses of moments on a path (``at``) and a dry sound go in; wet sound goes out. Trees and noise are
faded from moment to moment, linearly and in time: their pitch shifts only as far as moments are
closer than a quarter of a wavelength. The direct and the ground's sound keep their filter, less their delay;
that is exact at every sample: sound heard at t left at t', t = t' + |r(t) - s(t')|/c, places between moments
along straight lines, so that a tone is heard at f·(1 + v_r·n/c)/(1 - v_s·n/c) as it must be (n: from receiver
to source for v_r, from source to receiver for v_s). Amplitudes follow 1/distance of that path.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from .bands import SPREAD
from .channels import ImpulseResponse

HALF, KAISER = (
    64,
    8.0,
)  # samples to either side from which one between is interpolated; their window
PHASES = 1024  # places between two samples that the window is computed at
AT_ONCE = 4096
AFTER = 1024  # samples of a direct sound's filter after its arrival
ROUNDS = 12  # of the equation for t'; each gains a factor of the Mach number


def heard_moving(found: ImpulseResponse, dry: np.ndarray, sound_speed: float) -> np.ndarray:
    """(N + M, C) wet samples of dry ones (N,) at the responses' rate, which begin when the path does.

    sound_speed : m/s. C : channels of one moment.
    """
    channels = found.channels
    times = sorted({channel.at for channel in channels})
    each = len(channels) // len(times)
    rows = [channels[number::each] for number in range(each)]
    return np.column_stack(
        [_channel(row, np.array(times) - times[0], dry, sound_speed) for row in rows]
    )


def _channel(
    row: tuple[ImpulseResponse, ...], times: np.ndarray, dry: np.ndarray, speed: float
) -> np.ndarray:
    rate = row[0].sample_rate
    source = np.array([one.source for one in row])
    receiver = np.array([one.receiver for one in row])
    late = np.array([one.trees for one in row])
    whole = len(dry) + late.shape[1] - 1
    sent = bool(np.ptp(source, axis=0).max() > 0)  # what is sent moves; else what hears does
    total = _faded(dry, late, times * rate, sent, whole)
    for name, mirror in (("direct", 1.0), ("ground", -1.0)):
        parts = np.array([getattr(one, name) for one in row])
        if not parts.any():
            continue
        image = source * (1.0, 1.0, mirror)
        path = np.linalg.norm(receiver - image, axis=1)
        filters = _undelayed(parts, path / speed * rate) * path[:, None]
        sounding = _faded(dry, filters, times * rate, True, len(dry) + filters.shape[1] - 1)
        total += _carried(sounding, image, receiver, times, rate, speed, whole)
    return total


def _faded(
    dry: np.ndarray, responses: np.ndarray, moments: np.ndarray, sent: bool, count: int
) -> np.ndarray:
    """(count,) of a sound through responses (T, K), each around its moment (T,) in samples.

    sent : faded as the sound is sent, else as it is heard.
    """
    from scipy.signal import fftconvolve  # here: it takes half a second to import

    total = np.zeros(count)
    length = responses.shape[1]
    for number, response in enumerate(responses):
        low = 0.0 if number == 0 else moments[number - 1]
        high = math.inf if number == len(responses) - 1 else moments[number + 1]
        ends = len(dry) if sent else count
        first, last = math.floor(low), int(min(high + 2, ends))
        if last <= first:
            continue
        place = np.arange(first, last)
        weight = np.interp(place, moments, np.eye(len(responses))[number])
        if sent:
            part = fftconvolve(dry[first:last] * weight, response)
            part = part[: count - first]
            total[first : first + len(part)] += part
            continue
        begin = max(0, first - length + 1)
        some = dry[begin : min(last, len(dry))]
        if len(some):
            part = fftconvolve(some, response)[first - begin : last - begin]
            total[first : first + len(part)] += part * weight[: len(part)]
    return total


def _undelayed(parts: np.ndarray, delay: np.ndarray) -> np.ndarray:
    """(T, K) filters of arrivals (T, N), their delays (T,) in samples taken off but for SPREAD of them."""
    size = parts.shape[1] + 2 * SPREAD
    frequency = np.fft.rfftfreq(size)
    turned = np.exp(2j * math.pi * frequency * (delay[:, None] - SPREAD))
    filters: np.ndarray = np.fft.irfft(np.fft.rfft(parts, size, axis=1) * turned, size, axis=1)
    return filters[:, : SPREAD + min(AFTER, parts.shape[1])]


def _carried(
    sounding: np.ndarray,
    source: np.ndarray,
    receiver: np.ndarray,
    times: np.ndarray,
    rate: float,
    speed: float,
    count: int,
) -> np.ndarray:
    """(count,) heard of what sounds (N,) at source (T, 3), at receiver (T, 3), by its own way and time."""

    def place(path: np.ndarray, when: np.ndarray) -> np.ndarray:
        return np.column_stack([np.interp(when, times, axis) for axis in path.T])

    heard = np.arange(count) / rate
    ear, left = place(receiver, heard), heard
    for _ in range(ROUNDS):
        distance = np.linalg.norm(ear - place(source, left), axis=1)
        left = heard - distance / speed
    distance = np.linalg.norm(ear - place(source, left), axis=1)
    return _between(sounding, left * rate + SPREAD) / np.maximum(distance, 1e-3)


def _between(samples: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(M,) values at places (M,) between samples (N,), by a windowed sinc; silence before and after."""
    padded = np.pad(samples, 2 * HALF)
    values_between = np.zeros(len(at))
    inside = np.flatnonzero((at > -HALF) & (at < len(samples) + HALF))
    table, steps = _kernel(), np.arange(1 - HALF, HALF + 1) + 2 * HALF
    for first in range(0, len(inside), AT_ONCE):
        rows = inside[first : first + AT_ONCE]
        base = np.floor(at[rows]).astype(np.int64)
        place = (at[rows] - base) * PHASES
        low = np.minimum(place.astype(np.int64), PHASES - 1)
        share = (place - low)[:, None]
        weight = (1.0 - share) * table[low] + share * table[low + 1]
        values_between[rows] = (padded[base[:, None] + steps] * weight).sum(axis=1)
    return values_between


@cache
def _kernel() -> np.ndarray:
    """(PHASES + 1, 2·HALF) weights of samples around places between two of them."""
    apart = np.linspace(0.0, 1.0, PHASES + 1)[:, None] - np.arange(1 - HALF, HALF + 1)
    window = np.i0(KAISER * np.sqrt(np.maximum(1.0 - (apart / HALF) ** 2, 0.0))) / np.i0(KAISER)
    return np.sinc(apart) * window
