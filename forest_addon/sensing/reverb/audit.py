"""A response held against the exact sum: random trunks of it, each at every frequency in float64.

The fast sum is made again over some of the trunks that were heard, drawn at random, and beside it the direct
sum over the same; the error of a draw is the largest of the whole and of each octave from 20 Hz, as a share
of the exact one's norm there. That is what the tolerance is given in. A response that is the direct sum
itself is held against one that lets trunks ring longer: what it cuts off is its error.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy import fft

from ...spec import Air, Reverb
from ..audit import Audit, sample
from .band import SPREAD
from .forest.losses import Losses, Stand
from .response import ImpulseResponse
from .sums.fast_scattering import Expansions
from .sums.scattering import TrunkPaths, direct_sum, trunk_paths
from .trunks.slices import Trunks

LEAST, MOST = 20, 200  # trunks at a time
PACE = 2e-7  # s of a trunk at a frequency
LONGEST = 12_000  # samples of the part of the record that is compared
LOWEST = 20.0  # Hz
RINGING = 1.0  # s of frequencies beside a record's, all bands together
CUT_OFF = 1e-6  # of an octave, that a direct sum to no tolerance cuts off at most
QUIET = 1e-9  # of the whole: octaves below that are noise of float64


def audit_response(
    found: ImpulseResponse,
    trunks: Trunks,
    source: np.ndarray,
    receiver: np.ndarray,
    reverb: Reverb,
    air: Air,
    expansions: Expansions,
    rng: np.random.Generator,
    seconds: float,
    share: float,
    stand: Stand | None = None,
) -> Audit:
    """Of a response that took ``seconds``, at a cost of about ``share`` of that.

    trunks : of the first channel. expansions : what the response was made with.
    stand : that paths lose to, of a model ``forest``.
    """
    ends = np.asarray(source)[:2], np.asarray(receiver)[:2]
    losses = Losses.of(reverb, air, stand, source, receiver) if stand else None
    upright = losses is not None
    paths = trunk_paths(trunks, *ends, reverb.strength, reverb.spreading, None, upright)
    rate = reverb.sample_rate
    allowed = max(reverb.tolerance or CUT_OFF, *found.errors.values(), 1e-12)
    count = min(len(found.samples), LONGEST)
    heard = np.flatnonzero(paths.earliest <= count / rate * air.speed())

    def direct(some: TrunkPaths, tolerance: float) -> np.ndarray:
        return direct_sum(some, rate, count + SPREAD, air, None, losses, tolerance)

    frequencies = (count + SPREAD + RINGING * rate) / 2
    drawn = int(np.clip(share * seconds / (PACE * frequencies), LEAST, MOST))

    def batches() -> Iterator[np.ndarray]:
        while len(heard):
            some = paths.select(np.sort(rng.permutation(heard)[:drawn]))
            exact = direct(some, 0.0)
            if found.exact:
                yield octave_errors(direct(some, reverb.tolerance), exact, rate)
                continue
            fast = expansions.sum(some, rate, count + SPREAD, air, reverb.tolerance, losses).samples
            yield octave_errors(fast, exact, rate)

    checked = sample(batches(), share * seconds)
    per_trunk = checked.seconds_each * max(len(checked.errors), 1) / drawn
    return Audit(
        what=f"octaves of {drawn} trunks at a time by the direct sum",
        checked=len(checked.errors),
        error=checked.largest,
        rms=checked.rms,
        allowed=allowed,
        seconds=seconds,
        exact_seconds=per_trunk * found.trunks * len(found.channels) * len(found.samples) / count,
        unit="of the octave",
    )


def octave_errors(fast: np.ndarray, exact: np.ndarray, rate: float) -> np.ndarray:
    """(1 + B,) relative L2 errors of the whole and of octaves from 20 Hz that hold any sound."""
    apart, true = fft.rfft(fast - exact), fft.rfft(exact)
    frequency = np.arange(len(true)) * rate / len(exact)
    whole = float(np.linalg.norm(true))
    if whole == 0:
        return np.array([float(np.linalg.norm(apart))])
    errors = [float(np.linalg.norm(apart)) / whole]
    for octave in range(int(math.log2(max(0.45 * rate / LOWEST, 1)))):
        low = LOWEST * 2.0**octave
        rows = (frequency >= low) & (frequency < 2 * low)
        size = float(np.linalg.norm(true[rows]))
        if size > QUIET * whole:
            errors.append(float(np.linalg.norm(apart[rows])) / size)
    return np.array(errors)
