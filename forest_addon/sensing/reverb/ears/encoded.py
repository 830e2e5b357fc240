"""Channels of a receiver that tells directions: the response of a pair, part by part from where it comes.

Direct sound comes from the source, the ground's from its image, a trunk's level from its axis, noise of what
trunks turned from all sides level, noise of what branches or leaves turned from all sides in space: each
direction with noise of its own, so that two ears hear it as alike as a diffuse field lets them.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ....base.rng import stream
from ..forest.tail import FADE
from ..pair import ImpulseResponse, Pair
from ..sums.fast_scattering import Expansions
from .hearing import OMNI_EAR, Hearing


def encoded(
    pair: Pair, plain: ImpulseResponse, hearing: Hearing, expansions: Expansions
) -> list[ImpulseResponse]:
    """Channels of a receiver that hears what ``plain`` is of one microphone."""
    if hearing is OMNI_EAR:
        return [plain]
    count, size = len(plain.direct), len(hearing.names)
    way = pair.source - pair.receiver
    direct = _through(plain.direct, hearing.taps(way))
    ground = _through(plain.ground, hearing.taps(way - np.array([0.0, 0.0, 2.0 * pair.source[2]])))
    tail = pair.tail(expansions)
    noise = np.zeros((size, count))
    kept, last = np.ones(count), math.inf
    if tail is not None:
        kept = tail.kept(np.arange(count) * (pair.air.speed() / plain.sample_rate))
        last = FADE * tail.joint
        blocks = tail.blocks(plain.sample_rate, count, pair.air)
        for number, part in enumerate(hearing.noise()):
            more = (number,) if number else ()  # the first has the noise of ``plain``
            rng = stream(int(pair.key[0]), *pair.key[1:], "tail", *more)
            drawn = blocks.samples(rng, part.level, part.space)
            noise += _through(drawn, part.taps)
    trees = noise.copy()
    forest = pair.loud[0]
    azimuth = np.arctan2(*(forest.position - pair.receiver[:2]).T[::-1])
    single = plain.trees if plain.tail is None else plain.trees - plain.tail
    for group in hearing.groups(azimuth):
        rows = np.flatnonzero(group.gain)
        samples = single
        if len(rows) < len(forest) or not (group.gain == 1.0).all():
            if not len(rows):
                continue
            found = pair.trees(forest.select(rows), expansions, None, last, group.gain[rows])
            samples = found.samples * kept
        trees += _through(samples, group.taps)
    keep = plain if (hearing.taps(way)[0] != 1.0).any() else None  # W is a microphone's already
    return [
        replace(
            plain,
            direct=direct[row],
            ground=ground[row],
            trees=trees[row],
            tail=noise[row] if plain.tail is not None else None,
            channel=f"{plain.channel} {name}",
            component=row,
            plain=keep if row == 0 else None,
        )
        for row, name in enumerate(hearing.names)
    ]


def _through(samples: np.ndarray, taps: np.ndarray) -> np.ndarray:
    """(C, N) samples (N,) through filters (C, K)."""
    if taps.shape[1] == 1:
        return taps * samples
    from scipy.signal import fftconvolve  # here: it takes half a second to import

    found: np.ndarray = fftconvolve(samples[None], taps, axes=1)[:, : len(samples)]
    return found
