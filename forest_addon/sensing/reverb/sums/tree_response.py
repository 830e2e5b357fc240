"""Response of trunks at one receiver to one source: the exact sum, or a fast one.

Trunks, a source and a receiver go in, samples come out. ``tolerance`` chooses the way: 0, or less
than the fast sum keeps, sums every trunk at every frequency (``scattering``), a larger one allows a
relative error and uses separable expansions (``fast_scattering``). A few trunks
are summed exactly in any case, because that is as fast.

Length of a record, and the share of the sound that one which ends earlier leaves out.

Paths go in; by octaves, the energy that is still to come at each path's arrival is estimated without
summing their sound: trunks stand at random, so that their energies add up,

    E_m = w_m²·e^{-2b(f)x_m}·mean over φ of |H(f, φ, a_m)|² = w_m²·e^{-2b(f)x_m}·(2/πk)·Σ_n ε_n·sin²γ_n

(Parseval; ``acoustics/cylinder``). A record without a given duration goes on until less than RANGE_DB is
left in every octave, or to the last trunk, at most LONGEST. The measures of a record need to know what
it leaves out (``metrics``).

Trunks that add nothing above the end of a record, and what they could add at most.

Paths go in, the rows of those that may be left out come out. No trunk is louder in an octave up to f₂ than

    |h_m| <= w_m·e^{-b(f₁)x_m}·√(2/πk)·Σ_n ε_n|sin γ_n|,

whatever the angle; n over all orders, the largest of that for sizes up to k₂a. The weakest are left out as
long as the sum of their norms, as if they all were in phase, stays below ``RANGE_DB`` under the expected
energy of all sound in every octave. ``Weak.bound`` sets that against the sound that came out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy import fft

from ....acoustics.cylinder import order_count, partial_waves
from ....acoustics.extinction import cross_sections
from ....base.progress import Progress
from ....spec import Air, Reverb
from ..bands import SPREAD
from ..forest.losses import Losses, loss_per_metre
from ..metrics import octave_bands
from ..trunks import Trunks
from .fast_scattering import FEW_RADII, FINEST, Expansions
from .scattering import TrunkPaths, direct_sum, trunk_paths

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
    errors : {lower end of an octave in Hz: relative error of the fast sum at most}.
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
    part = part_until(last / speed, rate, count)
    exact = summed_exactly(within.radius, part, reverb.tolerance, losses)
    errors: dict[float, float] = {}
    samples = np.zeros(count)
    if exact:
        samples[:part] = direct_sum(within, rate, part, air, progress, losses, reverb.tolerance)
    else:
        prepared = Expansions() if expansions is None else expansions
        samples[:part], errors = prepared.sum(
            within, rate, part, air, reverb.tolerance, losses, progress
        )
    left = left_out_db(paths, heard, direct, rate, air, losses)
    return TreeResponse(samples, heard, int(paths.clamped.sum()), exact, left, errors)


def part_until(last: float, rate: float, count: int) -> int:
    """Samples of a record of ``count`` up to so many seconds."""
    return count if math.isinf(last) else min(count, math.ceil(last * rate) + 1)


def summed_exactly(radius: np.ndarray, count: int, tolerance: float, losses: Losses | None) -> bool:
    """Return whether trunks (M,) are summed exactly: no other sum is as fine, or is sooner done."""
    most = FEW if len(np.unique(radius)) <= FEW_RADII else int(FEW_SUMMANDS / count)
    if losses is not None and not losses.passes:  # a gain of paths takes longer than the trunks do
        most = min(most, FEW // 4)
    return tolerance < FINEST or len(radius) <= most


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
    loss = loss_per_metre(band, air)
    wavenumber = 2.0 * math.pi * band / air.speed()
    thickest = max(1e-3, float((wavenumber.max(initial=0.0) * paths.radius).max(initial=0.0)))
    size = np.geomspace(1e-4, thickest, SIZES)
    scattered, size = np.log(0.25 * size * cross_sections(size).scattering), np.log(size)
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
    mean_square = losses.mean_square(every[:, None], length)
    return np.asarray(mean_square * np.exp(-2.0 * np.outer(losses.along(every), length)))


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


WEAK_SIZES = 400  # ka at which the largest answer is computed
WITH_GROUND = 2.0  # times as loud as a path alone is one with its reflection, at most


@dataclass(frozen=True)
class Weak:
    """rows : (M,) bool, which paths are left out. norms : (B,) that they add at most in each octave."""

    rows: np.ndarray
    norms: np.ndarray

    def bound(self, samples: np.ndarray, sample_rate: float) -> float:
        """Largest share that what is left out adds to any octave of a sound (N,)."""
        if not self.rows.any():
            return 0.0
        size = fft.next_fast_len(len(samples), real=True)
        power = np.square(np.abs(fft.rfft(samples, size))) * (sample_rate / size)
        frequency = np.arange(len(power)) * (sample_rate / size)
        shares = [0.0]
        for middle, norm in zip(octave_bands(sample_rate), self.norms.tolist(), strict=True):
            low, high = middle / math.sqrt(2), middle * math.sqrt(2)
            heard = math.sqrt(float(power[(frequency >= low) & (frequency < high)].sum()))
            shares.append(norm / heard if heard > 0 else math.inf)
        return max(shares)

    def told(self, samples: np.ndarray, sample_rate: float) -> dict[str, Any]:
        """Number of them and their bound, as a response has them."""
        return {
            "weak": int(self.rows.sum()),
            "weak_bound": self.bound(samples, sample_rate),
        }


def weak_trunks(
    paths: TrunkPaths,
    direct: tuple[float, ...],
    sample_rate: float,
    air: Air,
    losses: Losses | None = None,
    loudest: float = 1.0,
) -> Weak:
    """Paths that together add next to nothing; arguments as of ``arrival_energies``.

    loudest : of the source in any direction, re its axis.
    """
    bands = np.array(octave_bands(sample_rate))
    norms = _largest(paths, bands, air) * loudest
    norms *= WITH_GROUND if losses is not None else 1.0
    energies, unscattered = arrival_energies(paths, direct, sample_rate, air, losses)
    whole = np.sqrt((energies.sum(axis=1) + unscattered) * math.sqrt(0.5))  # an octave is f/√2 wide
    allowed = 10 ** (-RANGE_DB / 20) * whole
    share = np.divide(
        norms, allowed[:, None], out=np.full(norms.shape, np.inf), where=allowed[:, None] > 0
    ).max(axis=0, initial=0.0)
    order = np.argsort(share, kind="stable")
    rows = np.zeros(len(share), dtype=bool)
    rows[order[np.cumsum(share[order]) <= 1.0]] = True
    return Weak(rows, norms[:, rows].sum(axis=1))


def _largest(paths: TrunkPaths, bands: np.ndarray, air: Air) -> np.ndarray:
    """(B, M) norms over octaves that no angle exceeds."""
    low, high = bands / math.sqrt(2), bands * math.sqrt(2)
    k = 2.0 * math.pi * high / air.speed()
    thickest = max(1e-3, float((k.max(initial=0.0) * paths.radius).max(initial=0.0)))
    size = np.geomspace(1e-5, thickest * 1.001, WEAK_SIZES)
    waves = np.abs(partial_waves(size, order_count(thickest)))
    answer = (waves[0] + 2.0 * waves[1:].sum(axis=0)) * np.sqrt(2.0 / (math.pi * size))
    answer = np.maximum.accumulate(answer)  # of all sizes up to each
    loss = loss_per_metre(low, air)
    norms = np.empty((len(bands), len(paths.length)))
    for row in range(len(bands)):
        above = np.searchsorted(size, k[row] * paths.radius)  # the next larger: never too small
        norms[row] = answer[np.minimum(above, WEAK_SIZES - 1)] * np.sqrt(paths.radius)
        norms[row] *= np.abs(paths.weight) * np.exp(-loss[row] * paths.length)
        norms[row] *= math.sqrt(high[row] - low[row])
    return norms
