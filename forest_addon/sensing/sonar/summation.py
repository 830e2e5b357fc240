"""The sum over everything that is heard, at every ear.

Y_e(f) = Σ_i A_ie(f)·e^{-i2πfτ_ie}, A = shade·gain·f with the beams and the air in the gain (``station``)
and f of the scatterer. But for its carrier an echo is smooth in the frequency, which
``acoustics/nonuniform`` makes use of; with a tolerance of 0 it adds scatterer by scatterer and bin by bin.
A scatterer may come in parts that are smoother than the whole, each with a delay of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
from scipy import special

from ...acoustics import chebyshev
from ...acoustics.nonuniform import sum_delayed
from ...base.progress import Progress
from .calls import Band, BandGrid, Call
from .scatterers import FACET, LEAF, WOOD
from .search import EarAmplitudes, SearchGroup
from .station import SonarPose, Station


@dataclass(frozen=True)
class EchoSum:
    """Sums at E ears, and how far they may be off.

    spectrum : (E, K), or (E, W, K) with weights. error_bound : no value is farther from the sum over the
    model's amplitudes than this share of Σ max|A|, at any ear. table_error : share by which these may be
    off as well, because they are looked up. size : (E,) Σ max|A|, no more than that.
    """

    spectrum: np.ndarray
    error_bound: float
    table_error: float
    size: np.ndarray


def sum_echoes(
    groups: list[SearchGroup],
    station: Station,
    grid: BandGrid,
    tolerance: float,
    progress: Progress | None = None,
    weights: list[np.ndarray] | None = None,
) -> EchoSum:
    """The spectrum at the ears, without a window.

    tolerance : largest error as a share of Σ max|A|; 0: the direct sum, exact to rounding.
    progress : called as progress(scatterers done, all of them).
    weights : (M, W) for each group, of its scatterers in W sums; errors are then to be multiplied by the
        largest.
    """
    some = panels(grid, station) if tolerance else [grid]
    parts = [_over(groups, station, part, tolerance, progress, weights) for part in some]
    if len(parts) == 1:
        return parts[0]
    size = np.max([part.size for part in parts], axis=0)
    shares = [np.divide(part.size, size, out=np.zeros_like(size), where=size > 0) for part in parts]
    return EchoSum(
        np.concatenate([part.spectrum for part in parts], axis=-1),
        max(p.error_bound * float(s.max()) for p, s in zip(parts, shares, strict=True)),
        max(part.table_error for part in parts),
        size,
    )


def panels(grid: BandGrid, station: Station) -> list[BandGrid]:
    """The grid, cut where a beam's gain has a kink over the frequency."""
    beams = station.equipment.emit, *station.equipment.hears
    kinks = {kink for beam in beams for kink in beam.kinks()}
    cuts = {math.ceil((kink - grid.start) / grid.spacing): kink for kink in sorted(kinks)}
    inside = {cut: kink for cut, kink in cuts.items() if 0 < cut < grid.count}
    edges = [(0, grid.ends[0]), *inside.items(), (grid.count, grid.ends[1])]
    return [
        replace(grid, start=grid.start + first * grid.spacing, count=last - first, ends=(low, high))
        for (first, low), (last, high) in pairwise(edges)
    ]


def _over(
    groups: list[SearchGroup],
    station: Station,
    grid: BandGrid,
    tolerance: float,
    progress: Progress | None,
    weights: list[np.ndarray] | None,
) -> EchoSum:
    """Over a part of the band in which every beam is smooth."""
    total, done = sum(len(group) for group in groups) * len(station.ear), 0
    sums = () if weights is None else (weights[0].shape[1],)
    spectrum = np.zeros((len(station.ear), *sums, grid.count), dtype=np.complex128)
    band = grid.ends
    lowest, highest = (2.0 * math.pi * end / station.sound_speed for end in band)
    error, table, size = np.zeros((3, len(station.ear)))
    for number, group in enumerate(groups):
        for ear in range(len(station.ear)):
            heard = EarAmplitudes(group, station, ear)
            doubtful = heard.strength.error(highest)
            if doubtful is not None:
                table[ear] += float(
                    (heard.gain(np.linspace(*band, 3)).max(axis=0) * doubtful).sum()
                )
            loud, smooth = group.bound * group.shade, tolerance > 0 and lowest < highest
            strength = heard.strength
            parts = strength.parts(lowest, highest) if smooth else strength.whole()
            rows = parts.rows
            delayed = sum_delayed(
                partial(heard.of, parts),
                (heard.length[rows] + parts.offset) / station.sound_speed,
                grid.start,
                grid.spacing,
                grid.count,
                tolerance=tolerance,
                reach=heard.reach(parts, band),
                loudness=loud[rows] * parts.share,
                weights=None if weights is None else weights[number][rows],
                ends=band,
                second=parts.second,
                conjugate=parts.conjugate,
            )
            spectrum[ear] += delayed.spectrum
            error[ear] += delayed.error * delayed.size
            size[ear] += delayed.size
            done += len(group)
            if progress:
                progress(done, total)
    bound, looked_up = (
        float(np.divide(part, size, out=np.zeros_like(size), where=size > 0).max(initial=0.0))
        for part in (error, table)
    )
    return EchoSum(spectrum, bound, looked_up, size)


# The Doppler effect of a moving sonar: every path plays the call faster or slower.
#
# A sonar that flies at v towards a scatterer hears its call sped up by
#
#     α = (c + v_e)(c − u_t)/((c − v_t)(c + u_e)),
#
# v_t and v_e its velocity towards the scatterer as the call leaves and as the echo comes back to the ear, u_t
# and u_e that of the scatterer away from mouth and ear. A path of the amplitude A and the delay τ then adds
# A(f)·X(f/α)/α·e^{-i2πfτ}, X the call's spectrum. The scatterer's own response is taken at the frequency
# heard, which is off by at most v/c of itself.
#
# X(f/α) is interpolated over α between Chebyshev points: the sum of the echoes, weighted by the polynomial of
# a point, is taken once for each point and meets the call as it is played there. Paths are taken by slices of
# α, so that a long call needs few points at a time.
#
# Velocities are constants for a short time only: where objects move, a call is cut into pieces that fade into
# each other, each sent at a scene as it is in the piece's middle (``moments_of``).


SAFER = 0.02  # of the tolerance: what is bounded is relative to Σ|x|, which is above the spectrum
TURNS = 32.0  # radians by which X(f/α) turns within half a slice of speeds
STEADY = 0.1  # radians that changes of speed turn echoes within a piece of a call, mean by loudness
MOST = 1025  # pieces of a call
KINDS = LEAF, WOOD, FACET


@dataclass(frozen=True)
class Moment:
    """Scatterers heard at a time in a call, s after it begins, from where the sonar is then."""

    time: float
    station: Station
    groups: list[SearchGroup]


def moments_of(
    first: Moment, call: Call, highest: float, hear: Callable[[float], Moment]
) -> list[Moment]:
    """Find the moments of a call between which speeds are even enough: evenly from its begin to its end, or
    the first alone.

    highest : Hz of the band. hear : the moment at a time, s.
    """
    if not any(group.motion.shape[1] for group in first.groups):
        return [first]
    last = hear(call.duration)
    turn = 2.0 * math.pi * highest / first.station.sound_speed
    if turn * _changed(first, last) * call.duration <= STEADY:
        return [first]
    moments = [first, last]
    # Blended from both sides, half way: a quarter of what one side alone is off at the other end.
    while len(moments) < MOST and any(
        turn / 4 * _changed(a, b) * (b.time - a.time) > STEADY for a, b in pairwise(moments)
    ):
        between = [hear((a.time + b.time) / 2) for a, b in pairwise(moments)]
        moments = [m for pair in zip(moments, between, strict=False) for m in pair] + [last]
    return moments


def _changed(one: Moment, other: Moment) -> float:
    """Mean change in m/s, by loudness, of the speeds at which scatterers heard at both moments go away."""
    (key, speed, loud), (later, then, _) = (_speeds_of(moment) for moment in (one, other))
    _, a, b = np.intersect1d(key, later, assume_unique=True, return_indices=True)
    total = float(loud[a].sum())
    return float(loud[a] @ np.abs(speed[a] - then[b])) / total if total > 0 else 0.0


def _speeds_of(moment: Moment) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(M,) names of scatterers at a moment, how fast they go away from the sonar, m/s, and bounds on how loud
    they are."""
    names = np.dtype([("kind", "i8"), ("instance", "i8"), ("number", "i8")])
    keys, speeds, bounds = [np.empty(0, names)], [np.empty(0)], [np.empty(0)]
    for group in moment.groups:
        key = np.empty(len(group), names)
        key["kind"], key["instance"] = KINDS.index(group.scatterers.kind), group.instance
        key["number"] = group.scatterers.number
        keys.append(key)
        relative = group.velocity - moment.station.pose.velocity
        speeds.append(np.einsum("mi,mi->m", group.ways(moment.station.point), relative))
        bounds.append(group.bound * group.shade)
    key, row = np.unique(np.concatenate(keys), return_index=True)
    return key, np.concatenate(speeds)[row], np.concatenate(bounds)[row]


def pieces_of(call: Call, count: int) -> list[tuple[Call, float]]:
    """``count`` pieces of a call about evenly spaced times from its begin to its end, which add up to it,
    each with the seconds from its begin to its time."""
    step, rate = call.duration / (count - 1), call.sample_rate
    time, pieces = np.arange(len(call.samples)) / rate, []
    for number in range(count):
        away = (time - number * step) / step
        rows = np.flatnonzero(np.abs(away) < 1)
        if not len(rows):  # shorter than a sample
            rows = np.array([min(round(number * step * rate), len(time) - 1)])
        weight = np.cos(math.pi / 2 * np.clip(away[rows], -1, 1)) ** 2
        pieces.append((Call(call.samples[rows] * weight, rate), number * step - rows[0] / rate))
    return pieces


def played(moments: Sequence[Moment], grid: BandGrid, tolerance: float, call: Call) -> np.ndarray:
    """(E, K) spectrum of the call's echoes at the ears, each piece of it sent at its own moment."""
    pieces = pieces_of(call, len(moments)) if len(moments) > 1 else [(call, 0.0)]
    total = np.zeros((len(moments[0].station.ear), grid.count), dtype=np.complex128)
    for moment, (piece, lead) in zip(moments, pieces, strict=True):
        spectrum = shifted_sum(moment.groups, moment.station, grid, tolerance, piece, lead)
        total += spectrum * np.exp(-2j * math.pi * np.remainder(grid.frequency * moment.time, 1.0))
    return total


def widened(band: Band, speed: float, sound_speed: float) -> Band:
    """The band in which calls of a band are heard by a sonar that moves at ``speed``."""
    most = (sound_speed + speed) / (sound_speed - speed)
    return Band(band.low / most, band.high * most)


def factors(group: SearchGroup, station: Station, ear: int) -> np.ndarray:
    """(M,) α of every path to an ear."""
    velocity, speed = station.pose.velocity, station.sound_speed
    way = group.ways(station.point)
    back = (group.scatterers.centre - station.ear[ear]) / group.paths.leg[:, ear, None]
    alpha = (speed + back @ velocity) / (speed - way @ velocity)
    if group.velocity.shape[1]:
        off, return_off = (np.einsum("mi,mi->m", w, group.velocity) for w in (way, back))
        alpha *= (speed - off) / (speed + return_off)
    return np.asarray(alpha)


def fastest(groups: list[SearchGroup], pose: SonarPose) -> float:
    """Return the speed of the sonar and of the fastest scatterer together, m/s."""
    own = float(np.linalg.norm(pose.velocity))
    speeds = [np.linalg.norm(group.velocity, axis=1).max(initial=0.0) for group in groups]
    return own + float(max(speeds, default=0.0))


def shifted_sum(
    groups: list[SearchGroup],
    station: Station,
    grid: BandGrid,
    tolerance: float,
    call: Call,
    lead: float = 0.0,
) -> np.ndarray:
    """(E, K) spectrum of the call's echoes at the ears, each path with its own speed.

    lead : s after the call begins, when scatterers are where they are and from when delays count.
    """
    total = np.zeros((len(station.ear), grid.count), dtype=np.complex128)
    if not groups:
        return total
    alpha = [factors(group, station, 0) for group in groups]
    low, high = min(a.min() for a in alpha), max(a.max() for a in alpha)
    # Within X(f/α) are phases 2πf·t/α up to the ends of the call.
    turns = math.pi * grid.ends[1] * (high - low) / low**2
    turns *= max(abs(lead), abs(call.duration - lead))
    slices = max(1, math.ceil(turns / TURNS))
    points = _points(turns / slices, SAFER * (tolerance or 1e-10))
    half = max((high - low) / (2 * slices), 1e-15)
    number = [np.minimum((a - low) // (2 * half), slices - 1) for a in alpha]
    for slice_ in range(slices):
        rows = [np.flatnonzero(n == slice_) for n in number]
        some = [group.select(r) for group, r in zip(groups, rows, strict=True) if len(r)]
        if not some:
            continue
        middle = low + (2 * slice_ + 1) * half
        weights = [
            chebyshev.lagrange(points, (a[r] - middle) / half).T
            for a, r in zip(alpha, rows, strict=True)
            if len(r)
        ]
        summed = sum_echoes(some, station, grid, tolerance, weights=weights).spectrum
        speeds = middle + half * chebyshev.points(points)
        sent = call.spectra_on(grid.start, grid.spacing, grid.count, speeds, lead)
        total += np.einsum("ewk,wk->ek", summed, sent)
    return total


def _points(turns: float, error: float) -> int:
    """Chebyshev points for e^{i·turns·x}: its coefficients are 2·i^n·J_n(turns), DLMF 10.12.3."""
    order = np.arange(1, math.ceil(1.2 * turns) + 60)
    tail = 4.0 * np.cumsum(np.abs(special.jv(order, turns))[::-1])[::-1]
    return int(order[int(np.argmax(tail <= error))])
