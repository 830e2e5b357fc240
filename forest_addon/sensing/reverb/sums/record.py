"""Length of a record, and the share of the sound that one which ends earlier leaves out.

Paths go in; by octaves, the energy that is still to come at each path's arrival is estimated without
summing their sound: trunks stand at random, so that their energies add up,

    E_m = w_m²·e^{-2b(f)x_m}·mean over φ of |H(f, φ, a_m)|² = w_m²·e^{-2b(f)x_m}·(2/πk)·Σ_n ε_n·sin²γ_n

(Parseval; ``acoustics/cylinder``). A record without a given duration goes on until less than RANGE_DB is
left in every octave, or to the last trunk, at most LONGEST. The measures of a record need to know what
it leaves out (``metrics``).
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from ....acoustics.air import absorption
from ....acoustics.cylinder import order_count, partial_waves
from ....spec import Air
from ..forest.losses import Losses
from ..metrics import octave_bands
from .scattering import TrunkPaths

RANGE_DB = 75.0  # below the energy of all sound: what T60, read down to -65 dB, does not notice
LONGEST = 20.0  # s
AFTER = 0.1  # s for which the last trunk may ring
FIRST, APART = 1.0, 1.01  # m, ratio: lengths of paths at which losses are computed
TOGETHER = 64  # of them
LEAST = 1e-300
SIZES = 160  # ka at which the scattered energy is computed


def arrival_energies(
    paths: TrunkPaths,
    direct: tuple[float, ...],
    sample_rate: float,
    air: Air,
    losses: Losses | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """(B, M) expected energy of each trunk's sound in each octave, and (B,) of what does not pass a trunk.

    direct : lengths in metres of paths that are heard with 1/length.
    losses : of the paths by way of trunks; None: the air takes all.
    """
    band = np.array(octave_bands(sample_rate))
    loss = absorption(band, air.temperature_c, air.humidity, air.pressure_kpa)
    wavenumber = 2.0 * math.pi * band / air.speed()
    thickest = max(1e-3, float((wavenumber.max(initial=0.0) * paths.radius).max(initial=0.0)))
    size = np.geomspace(1e-4, thickest, SIZES)
    waves = np.square(np.abs(partial_waves(size, order_count(thickest))))
    scattered = np.log(waves[0] + 2.0 * waves[1:].sum(axis=0))
    size = np.log(size)
    different, row_of = _different(paths.radius)
    first, place, share = _places(paths.length)
    length = FIRST * APART ** np.arange(first, first + int(place.max(initial=0)) + 2)
    lost = np.exp(-2.0 * np.outer(loss, length))
    if losses is not None and len(paths.length):
        start = first - first % TOGETHER
        count = -(-(first + len(length) - start) // TOGETHER) * TOGETHER
        known = _lost(losses, tuple(band.tolist()), start, count)
        lost = known[:, first - start : first - start + len(length)]
    energies = np.empty((len(band), len(paths.length)))
    strength = np.where(paths.radius > 0, np.square(paths.weight), 0.0)
    for row, k in enumerate(wavenumber):
        z = np.log(np.maximum(k * different, 1e-4))
        answer = np.exp(np.interp(z, size, scattered)) * (2.0 / (math.pi * k)) * band[row]
        table = np.maximum(lost[row], LEAST)
        gain = table[place] + share * np.diff(table)[place]
        energies[row] = strength * gain
        energies[row] *= answer[row_of] if len(different) > 1 else answer
    unscattered = np.array(
        [
            f * sum(math.exp(-2.0 * b * d) / d**2 for d in direct)
            for f, b in zip(band, loss, strict=True)
        ]
    )
    return energies, unscattered


def _different(radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Radii that differ, and which one each trunk has."""
    if len(radius) and radius.min() == radius.max():  # without a sort
        return radius[:1], np.zeros(len(radius), np.int64)
    different, row_of = np.unique(radius, return_inverse=True)
    return different, row_of


def _places(length: np.ndarray) -> tuple[int, np.ndarray, np.ndarray]:
    """Number of the first of the lengths FIRST·APART^n that are needed; of each path (M,), how many lengths
    the one below it comes after the first, and how far it is to the next, by logarithms."""
    if not len(length):
        return 0, np.zeros(0, np.int64), np.zeros(0)
    place = np.log(length / FIRST) / math.log(APART)
    below = np.floor(place).astype(np.int64)
    first = int(below.min())
    return first, below - first, place - below


@lru_cache(maxsize=32)
def _lost(losses: Losses, band: tuple[float, ...], first: int, count: int) -> np.ndarray:
    """(B, count) share of the energy that is left at lengths from a number on."""
    length, every = FIRST * APART ** np.arange(first, first + count), np.array(band)
    found = losses.mean_square(every[:, None], length)
    return np.asarray(found * np.exp(-2.0 * np.outer(losses.along(every), length)))


def record_length(
    paths: TrunkPaths,
    direct: tuple[float, ...],
    sample_rate: float,
    air: Air,
    losses: Losses | None = None,
) -> float:
    """Seconds until less than RANGE_DB is left in every octave."""
    last = max(direct, default=0.0)
    if len(paths.length):
        energies, unscattered = arrival_energies(paths, direct, sample_rate, air, losses)
        allowed = (energies.sum(axis=1) + unscattered) * 10.0 ** (-RANGE_DB / 10.0)
        last = max(last, _last_needed(paths.length, energies, allowed))
    return min(LONGEST, last / air.speed() + AFTER)


def _last_needed(length: np.ndarray, energies: np.ndarray, allowed: np.ndarray) -> float:
    """The longest path (M,) after which, with it, more than what is allowed (B,) of energies (B, M) comes."""
    _, place, _ = _places(length)
    cells = np.array([np.bincount(place, row) for row in energies])
    left = np.cumsum(cells[:, ::-1], axis=1)[:, ::-1]
    needed = np.flatnonzero((left > allowed[:, None]).any(axis=0))
    if not len(needed):
        return 0.0
    rows = np.flatnonzero(place == needed[-1])  # only there it matters which trunk is first
    rows = rows[np.argsort(length[rows], kind="stable")]
    after = left[:, needed[-1] + 1] if needed[-1] + 1 < left.shape[1] else 0.0 * allowed
    within = np.cumsum(energies[:, rows[::-1]], axis=1)[:, ::-1] + after[:, None]
    exact = np.flatnonzero((within > allowed[:, None]).any(axis=0))
    return float(length[rows[exact[-1]]]) if len(exact) else float(length[rows[0]])


def left_out_db(
    paths: TrunkPaths,
    heard: np.ndarray,
    direct: tuple[float, ...],
    sample_rate: float,
    air: Air,
    losses: Losses | None = None,
) -> np.ndarray:
    """(1 + B,) energy after the record's end, dB re all of it: of the whole band, then of octaves.

    heard : (M,) bool, which trunks are in the record. -inf where nothing is left out.
    """
    if heard.all():
        return np.full(1 + len(octave_bands(sample_rate)), -np.inf)
    energies, unscattered = arrival_energies(paths, direct, sample_rate, air, losses)
    whole = energies.sum(axis=1) + unscattered
    late = energies[:, ~heard].sum(axis=1)
    whole, late = np.append(whole.sum(), whole), np.append(late.sum(), late)
    share = np.divide(late, whole, out=np.zeros_like(late), where=whole > 0)
    with np.errstate(divide="ignore"):
        return np.asarray(10.0 * np.log10(share))
