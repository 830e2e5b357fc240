"""Ears of a sonar at a glance: a coarse cochleagram of one ping, fast enough to follow a cursor.

The ping is the sonar's own, of a pulse of its whole band, summed to a hundredth of all amplitudes and
without what adds less than a tenth of them; movement and call are left out. Each row is one channel of a
cochlea: a gammatone filter (Patterson, R. D., et al. 1992. Complex sounds and auditory images. Advances in
the Biosciences 83, 429) of constant quality, without phase.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..kind import Observation
from .equipment_files import equip
from .ping import ping
from .targets import EchoTargets

CHANNELS, COLUMNS = 40, 256
QUALITY = 10.0  # centre frequency over the equivalent rectangular bandwidth
ORDER = 4
ERB_TO_WIDTH = 1.019  # of a gammatone's b over its equivalent rectangular bandwidth
TOLERANCE, CULL = 1e-2, 0.1
FAINTEST = 70.0  # dB below the loudest, that are told apart


@dataclass(frozen=True)
class Cochleagram:
    """Levels of what E ears hear in C channels and T slices of time, the lowest channel first.

    level : (E, C, T) dB re the call at 1 m, at least ``FAINTEST`` below the loudest; -inf of silence.
    frequency : (C,) Hz, of channels. reach : metres away that the last slice sounds from.
    """

    level: np.ndarray
    frequency: np.ndarray
    reach: float


def listen(job: Observation, targets: EchoTargets) -> Cochleagram:
    """Echo that a sonar hears of targets from where its settings say, in one ping.

    Raises
    ------
    ValueError : the record would be longer than memory.
    """
    sonar, seen = job.sensor, job.seen
    coarse = sonar.changed(
        route="",
        follow="",
        doppler=False,
        call="impulse",
        receiver=None,
        shading_rays=1,
        tolerance=max(sonar.tolerance, TOLERANCE),
        cull=max(sonar.cull, CULL),
    )
    echo = ping(
        targets,
        coarse,
        job.settings.air,
        seen.wood if "trunks" in coarse.shading else None,
        equipment=equip(coarse, job.folder),
        everything=seen.caster if "extinction" in coarse.shading else None,
    )
    lasts = 2 * coarse.max_range / echo.sound_speed
    low, high = coarse.band
    centre = np.geomspace(low, high, CHANNELS if high > low else 1)
    level = cochleagram(echo.frequency, echo.spectra, centre, lasts)
    return Cochleagram(level, centre, coarse.max_range)


def cochleagram(
    frequency: np.ndarray, spectra: np.ndarray, centre: np.ndarray, lasts: float
) -> np.ndarray:
    """(E, C, T) levels of signals whose spectra (E, K) are known at evenly spaced frequencies (K,) Hz, in
    channels of these centres (C,) Hz, dB; a pulse of 1 has the level 0 in every channel.
    """
    spacing = float(frequency[1] - frequency[0]) if len(frequency) > 1 else 1.0
    many = 1 << int(np.ceil(np.log2(max(len(frequency), COLUMNS))))
    width = ERB_TO_WIDTH * centre / QUALITY
    away = (frequency[None] - centre[:, None]) / width[:, None]
    gain = (1.0 + away**2) ** (-ORDER / 2)
    gain /= gain.sum(axis=1, keepdims=True)
    envelope = np.abs(np.fft.ifft(spectra[:, None] * gain, many, axis=-1)) * many
    slice_of = np.floor(np.arange(many) / (many * spacing) / lasts * COLUMNS).astype(np.int64)
    heard = np.zeros((*envelope.shape[:2], COLUMNS))
    for column in range(COLUMNS):  # the loudest of each slice
        bins = slice_of == column
        if bins.any():
            heard[..., column] = envelope[..., bins].max(axis=-1)
    empty = np.setdiff1d(np.arange(COLUMNS), slice_of)
    before = empty[empty <= slice_of.max()]
    for column in before:  # samples are farther apart than slices
        heard[..., column] = heard[..., column - 1] if column else heard[..., 1]
    with np.errstate(divide="ignore"):
        level = 20 * np.log10(heard)
    floor = level.max(initial=-np.inf) - FAINTEST
    return np.maximum(level, floor) if np.isfinite(floor) else level
