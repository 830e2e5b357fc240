"""What one receiver hears of one source by way of the trunks: the exact sum, or a fast one.

Trunks, a source and a receiver go in, samples come out. ``tolerance`` chooses the way: 0, or less
than the fast sum keeps, sums every trunk at every frequency (``scattering``), a larger one allows a
relative error and uses separable expansions (``fast_scattering``). A few trunks
are summed exactly in any case, because that is as fast.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import fft

from ....spec import Air, Reverb
from ..band import SPREAD, roll_off
from ..forest.losses import Losses, loss_per_metre
from ..trunks.slices import Trunks
from .fast_scattering import FEW_RADII, Expansions
from .record import left_out_db, record_length
from .scattering import (
    RINGING,
    TrunkPaths,
    exact_ringing,
    scattered_spectrum,
    transform_length,
    trunk_paths,
)

Progress = Callable[[int, int], None]
NEAREST = 0.1  # m; a source has an extent: its direct sound is not louder than at this distance
FINEST, THICK = 1e-6, 0.5  # tolerance of the fast sum, and metres of radius beyond which it rises
FEW = 50  # trunks of few different radii that are summed exactly
FEW_SUMMANDS = 5e6  # trunks of many radii by samples of the response that are summed exactly


@dataclass(frozen=True)
class TreeResponse:
    """The pressure at the receiver by way of the trunks, sample 0 when the source sounds.

    samples : (N,) re the source's impulse at 1 m.
    heard : (M,) bool, which trunks are heard before the end.
    clamped : how many trunks cover the source or the receiver.
    exact : whether every trunk was summed at every frequency.
    left_db : (1 + B,) energy of trunks after the end, dB re all sound, of the whole band and of octaves.
    errors : {lower end of an octave in Hz: relative error of the fast sum, found by its checks}.
    """

    samples: np.ndarray
    heard: np.ndarray
    clamped: int
    exact: bool
    left_db: np.ndarray
    errors: dict[float, float]


def tree_response(
    trunks: Trunks,
    source: np.ndarray,
    receiver: np.ndarray,
    reverb: Reverb,
    air: Air,
    *,
    gain: np.ndarray | None = None,
    losses: Losses | None = None,
    last: float = math.inf,
    expansions: Expansions | None = None,
    progress: Progress | None = None,
) -> TreeResponse:
    """The sound of all trunks from a source to a receiver, each (3,) or (2,) metres.

    reverb : its sample_rate, duration (0: as long as these paths need), strength, spreading and
        tolerance are used.
    gain : (M,) amplitude of each trunk's path besides Kaneko & Gamper's weight, as of a directed source;
        None: 1.
    losses : of the paths, of a model ``forest``; None: Kaneko & Gamper's weights, and the air's losses alone.
    last : metres of path after which trunks are not summed; they are noise there.
    expansions : what the fast sum set up for other pairs; None: it is set up for this one.
    progress : called as progress(trunks done, all trunks), by the exact sum alone.
    """
    ends = np.asarray(source)[:2], np.asarray(receiver)[:2]
    paths = trunk_paths(trunks, *ends, reverb.strength, reverb.spreading, gain, losses is not None)
    rate, speed = reverb.sample_rate, air.speed()
    direct = (max(math.dist(source, receiver), NEAREST),)
    duration = reverb.duration or record_length(paths, direct, rate, air, losses)
    count = max(1, round(duration * rate))
    heard = paths.earliest <= (duration + SPREAD / rate) * speed
    summed = heard & (paths.earliest <= last)
    within = paths.select(summed)
    exact = reverb.tolerance < finest(within.radius)
    exact = exact or len(within.length) <= _soon_summed(within.radius, count)
    errors: dict[float, float] = {}
    if exact:
        ringing = exact_ringing(within, reverb.tolerance)
        samples = direct_sum(within, rate, count, air, progress, losses, ringing)
    else:
        prepared = Expansions() if expansions is None else expansions
        found = prepared.sum(within, rate, count, air, reverb.tolerance, losses)
        samples, errors = found.samples, found.errors
    silent = float(within.earliest.min(initial=math.inf)) / speed * rate - SPREAD
    samples[: int(min(max(silent, 0.0), count))] = 0.0  # but for rounding
    left = left_out_db(paths, heard, direct, rate, air, losses)
    return TreeResponse(samples, heard, int(paths.clamped.sum()), exact, left, errors)


def finest(radius: np.ndarray) -> float:
    """The least tolerance that the fast sum keeps: its tables and, of thick trunks, how long they ring."""
    return FINEST * max(1.0, float(radius.max(initial=0.0)) / THICK)


def _soon_summed(radius: np.ndarray, count: int) -> int:
    """Up to so many trunks the exact sum takes no longer than the fast one."""
    few = len(np.unique(radius)) <= FEW_RADII
    return FEW if few else int(FEW_SUMMANDS / count)


def direct_sum(
    paths: TrunkPaths,
    rate: float,
    count: int,
    air: Air,
    progress: Progress | None = None,
    losses: Losses | None = None,
    ringing: float = RINGING,
) -> np.ndarray:
    """(count,) samples at ``rate`` Hz from every trunk at every frequency, in float64.

    ringing : seconds after the last path that count.

    The transform is longer than the last path and its ringing: nothing wraps around.
    """
    if len(paths.length) == 0:
        return np.zeros(count)
    size = transform_length(paths, rate, count, air.speed(), ringing)
    frequency = np.arange(size // 2 + 1) * (rate / size)
    loss = loss_per_metre(frequency, air, losses)
    gain = None if losses is None or losses.passes else losses.gain
    bark = losses.bark if losses else 0.0
    spectrum = scattered_spectrum(paths, rate / size, loss, air.speed(), progress, gain, bark)
    whole: np.ndarray = fft.irfft(spectrum * roll_off(frequency / rate), size)
    return whole[:count]
