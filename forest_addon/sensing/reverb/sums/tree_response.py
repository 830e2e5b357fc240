"""Response of trunks at one receiver to one source: the exact sum, or a fast one.

Trunks, a source and a receiver go in, samples come out. ``tolerance`` chooses the way: 0, or less
than the fast sum keeps, sums every trunk at every frequency (``scattering``), a larger one allows a
relative error and uses separable expansions (``fast_scattering``). A few trunks
are summed exactly in any case, because that is as fast.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ....base.progress import Progress
from ....spec import Air, Reverb
from ..band import SPREAD
from ..forest.losses import Losses
from ..trunks.slices import Trunks
from .contract import FINEST
from .fast_scattering import FEW_RADII, Expansions
from .record import left_out_db, record_length
from .scattering import direct_sum, trunk_paths

NEAREST = 0.1  # m; a source has an extent: its direct sound is not louder than at this distance
FEW = 200  # trunks of few different radii that are summed exactly
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
    last : metres of path after which trunks are not summed, and samples are 0: all is noise there.
    expansions : what the fast sum set up for other pairs; None: it is set up for this one.
    progress : called as progress(trunks done, all trunks).
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
    exact = reverb.tolerance < FINEST
    part = count if math.isinf(last) else min(count, math.ceil(last / speed * rate) + 1)
    plain = losses is None or losses.passes
    exact = exact or len(within.length) <= soon_summed(within.radius, part, plain)
    errors: dict[float, float] = {}
    samples = np.zeros(count)
    if exact:
        samples[:part] = direct_sum(within, rate, part, air, progress, losses, reverb.tolerance)
    else:
        prepared = Expansions() if expansions is None else expansions
        found = prepared.sum(within, rate, part, air, reverb.tolerance, losses, progress)
        samples[:part], errors = found.samples, found.errors
    left = left_out_db(paths, heard, direct, rate, air, losses)
    return TreeResponse(samples, heard, int(paths.clamped.sum()), exact, left, errors)


def soon_summed(radius: np.ndarray, count: int, plain: bool) -> int:
    """Return up to how many trunks the exact sum takes no longer than the fast one.

    plain : whether paths have no gain of their own, which takes longer than the trunks do.
    """
    few = len(np.unique(radius)) <= FEW_RADII
    found = FEW if few else int(FEW_SUMMANDS / count)
    return found if plain else min(found, FEW // 4)
