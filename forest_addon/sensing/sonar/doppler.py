"""The Doppler effect of a moving sonar: every path plays the call faster or slower.

A sonar that flies at v towards a scatterer hears its call sped up by

    α = (c + v_e)(c − u_t)/((c − v_t)(c + u_e)),

v_t and v_e its velocity towards the scatterer as the call leaves and as the echo comes back to the ear, u_t
and u_e that of the scatterer away from mouth and ear. A path of the amplitude A and the delay τ then adds
A(f)·X(f/α)/α·e^{-i2πfτ}, X the call's spectrum. The scatterer's own response is taken at the frequency heard,
which is off by at most v/c of itself.

What arrives within a short time is, but for its common delay, smooth in f: the call lasts so long, the
arrivals lie so far apart, and A is interpolated between a few nodes anyway. So the echoes of a block of time
are summed at as many Chebyshev points of the band as that takes, all of them together go on to every bin,
and X(f/α) is interpolated over α between Chebyshev points of its own.

Velocities are constants for a short time only: where things move, a call is cut into pieces that fade into
each
other, each sent at a scene as it is in the piece's middle (``moments_of``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import special

from ...acoustics import chebyshev
from ...acoustics.nonuniform import nodes_needed
from ...base.products import product
from .bands import Band, BandGrid
from .calls import Call
from .leaves import LeafEchoes
from .poses import SonarPose
from .scatterers import FACET, LEAF, WOOD
from .search import SearchGroup
from .station import EarGain, Station
from .summation import Heard, panels, sum_echoes

SPREAD = 1e-9  # of α; less is one speed
SAFER = 0.02  # of the tolerance: what is bounded is relative to Σ|x|, which is above the spectrum
CLASSES = (6, 12, 24, 48, 96, 200)  # nodes of amplitudes that are interpolated together
BLOCK = 5e-4, 4e-3  # s, the shortest and the longest block
AT_ONCE = 1 << 16  # values at a time
FEW = 25  # points of speed times bins for each echo, up to which sums for each of these points are quicker
LEAST, ROUGH = (
    1e-10,
    2e-4,
)  # tolerances from which on, of what is smooth over the frequency and what is not
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
    found = [first, last]
    # Blended from both sides, half way: a quarter of what one side alone is off at the other end.
    while len(found) < MOST and any(
        turn / 4 * _changed(a, b) * (b.time - a.time) > STEADY for a, b in pairwise(found)
    ):
        between = [hear((a.time + b.time) / 2) for a, b in pairwise(found)]
        found = [m for pair in zip(found, between, strict=False) for m in pair] + [last]
    return found


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
        speeds.append(np.einsum("mi,mi->m", group.paths.direction, relative))
        bounds.append(group.bound * group.shade)
    key, row = np.unique(np.concatenate(keys), return_index=True)
    return key, np.concatenate(speeds)[row], np.concatenate(bounds)[row]


def pieces_of(call: Call, count: int) -> list[tuple[Call, float]]:
    """``count`` pieces of a call about evenly spaced times from its begin to its end, which add up to it,
    each with
    the seconds from its begin to its time."""
    step, rate = call.duration / (count - 1), call.sample_rate
    time, found = np.arange(len(call.samples)) / rate, []
    for number in range(count):
        away = (time - number * step) / step
        rows = np.flatnonzero(np.abs(away) < 1)
        if not len(rows):  # shorter than a sample
            rows = np.array([min(round(number * step * rate), len(time) - 1)])
        weight = np.cos(math.pi / 2 * np.clip(away[rows], -1, 1)) ** 2
        found.append((Call(call.samples[rows] * weight, rate), number * step - rows[0] / rate))
    return found


def played(
    moments: Sequence[Moment], band: Band, grid: BandGrid, tolerance: float, call: Call
) -> np.ndarray:
    """(E, K) spectrum of the call's echoes at the ears, each piece of it sent at its own moment."""
    if len(moments) == 1:
        only = moments[0]
        return shifted_sum(only.groups, only.station, band, grid, tolerance, call)
    total = np.zeros((len(moments[0].station.ear), grid.count), dtype=np.complex128)
    for moment, (piece, lead) in zip(moments, pieces_of(call, len(moments)), strict=True):
        found = shifted_sum(moment.groups, moment.station, band, grid, tolerance, piece, lead)
        total += found * np.exp(-2j * math.pi * np.remainder(grid.frequency * moment.time, 1.0))
    return total


def widened(band: Band, speed: float, sound_speed: float) -> Band:
    """The band in which calls of a band are heard by a sonar that moves at ``speed``."""
    most = (sound_speed + speed) / (sound_speed - speed)
    return Band(band.low / most, band.high * most)


def factors(group: SearchGroup, station: Station, ear: int) -> np.ndarray:
    """(M,) α of every path to an ear."""
    velocity, speed = station.pose.velocity, station.sound_speed
    way = group.paths.direction
    back = (group.scatterers.centre - station.ear[ear]) / group.paths.leg[ear][:, None]
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
    band: Band,
    grid: BandGrid,
    tolerance: float,
    call: Call,
    lead: float = 0.0,
) -> np.ndarray:
    """(E, K) spectrum of the call's echoes at the ears, each path with its own speed.

    lead : s after the call begins, when scatterers are where they are and from when delays count.
    """
    alpha = [factors(group, station, 0) for group in groups]
    if not groups:
        return np.zeros((len(station.ear), grid.count), dtype=np.complex128)
    low, high = min(a.min() for a in alpha), max(a.max() for a in alpha)
    if high - low < SPREAD:
        plain = sum_echoes(groups, station, grid, tolerance).spectrum
        turn = np.exp(2j * math.pi * np.remainder(grid.frequency * lead / float(low), 1.0))
        return plain * call.spectrum_at(grid.frequency, float(low)) * turn
    speeds = _Speeds(call, lead, float(low), float(high), band.high, SAFER * (tolerance or 1e-10))
    many = [
        speeds.few * grid.count <= FEW * len(group) and tolerance >= _least(group)
        for group in groups
    ]
    total = np.zeros((len(station.ear), grid.count), dtype=np.complex128)
    weighted = [number for number, some in enumerate(many) if some]
    if weighted:
        weights = [speeds.weights(alpha[number]) for number in weighted]
        some = [groups[number] for number in weighted]
        summed = sum_echoes(some, station, grid, tolerance, weights=weights).spectrum
        total += np.einsum("ewk,wk->ek", summed, speeds.on(grid))
    for number in np.flatnonzero(~np.array(many)).tolist():
        total += np.concatenate(
            [
                _over(groups[number], alpha[number], lead, station, panel, tolerance, speeds)
                for panel in panels(grid, station)
            ],
            axis=1,
        )
    return total


def _least(group: SearchGroup) -> float:
    """Return the tolerance from which on echoes of a group are summed for each point of speed."""
    scatterers = group.scatterers
    smooth = isinstance(scatterers, LeafEchoes) and scatterers.model != "exact"
    return LEAST if smooth else ROUGH


def _over(
    group: SearchGroup,
    alpha: np.ndarray,
    lead: float,
    station: Station,
    grid: BandGrid,
    tolerance: float,
    speeds: _Speeds,
) -> np.ndarray:
    """(E, K) over a part of the band in which every beam is smooth, in blocks of time."""
    ends = (grid.start, grid.start + grid.spacing * (grid.count - 1))
    lowest, highest = (2.0 * math.pi * end / station.sound_speed for end in ends)
    total = np.zeros((len(station.ear), grid.count), dtype=np.complex128)
    for ear in range(len(station.ear)):
        seen = group.seen(station, ear)
        whole = Heard(seen, EarGain(group.paths, station, ear, group.shade), station)
        for part in seen.parts(lowest, highest):
            heard, factor = whole.part(part), alpha[part.rows]
            late = (group.paths.length[ear][part.rows] + part.offset) / station.sound_speed
            late -= lead / factor
            needed = np.zeros(len(late), np.int64)
            if tolerance:
                loud = (group.bound * group.shade)[part.rows]
                asked = grid.start, grid.spacing, grid.count, heard.reach(ends), loud
                needed = nodes_needed(heard, *asked, tolerance)
            total[ear] += _played(heard, late, factor, needed, grid, speeds)
    return total


class _Speeds:
    """A call at all speeds from ``low`` to ``high``, within an error; its own time is ``lead`` s after it
    begins."""

    def __init__(
        self, call: Call, lead: float, low: float, high: float, highest: float, error: float
    ) -> None:
        self.call, self.error, self._lead = call, error, lead
        self._kept: dict[tuple[int, float, float], np.ndarray] = {}
        self._middle, self._half = (low + high) / 2, (high - low) / 2
        # Within X(f/α) are phases 2πf·t/α up to the end of the call.
        turns = math.pi * highest * (high - low) / low**2
        self._count = _points(turns * call.duration, error)
        self._factor = self._middle + self._half * chebyshev.points(self._count)
        self.few = _points(turns * max(abs(lead), abs(call.duration - lead)), error)

    def weights(self, alpha: np.ndarray) -> np.ndarray:
        """(M, W) of speeds (M,), of calls on the bins of a grid as ``on`` has them."""
        return chebyshev.lagrange(self.few, (alpha - self._middle) / self._half).T

    def on(self, grid: BandGrid) -> np.ndarray:
        """(W, K) of the call, whose own time is when delays count from; kept."""
        key = (grid.count, grid.start, grid.spacing)
        if key not in self._kept:
            factor = self._middle + self._half * chebyshev.points(self.few)
            given = grid.start, grid.spacing, grid.count
            self._kept[key] = self.call.spectra_on(*given, factor, self._lead)
        return self._kept[key]

    def shares(self, alpha: np.ndarray) -> np.ndarray:
        """(W, M) polynomials of the points at speeds (M,)."""
        return chebyshev.lagrange(self._count, (alpha - self._middle) / self._half)

    def known(self, frequency: np.ndarray) -> np.ndarray:
        """(F, W) of the call at the points; kept."""
        key = (len(frequency), float(frequency[0]), float(frequency[-1]))
        if key not in self._kept:
            self._kept[key] = self._spectra(frequency)
        return self._kept[key]

    def _spectra(self, frequency: np.ndarray) -> np.ndarray:
        """By interpolation of X(g)·e^{iπgT}, which turns half as often, between its own points."""
        place = frequency[:, None] / self._factor
        low, high = float(place.min()), float(place.max())
        middle, half = (low + high) / 2, max((high - low) / 2, 1e-9)
        lasts = self.call.duration
        at = middle + half * chebyshev.points(_points(math.pi * half * lasts, self.error))
        turns = np.outer(at, np.arange(len(self.call.samples)) / self.call.sample_rate - lasts / 2)
        values = np.exp(-2j * math.pi * turns) @ self.call.samples
        spread = chebyshev.lagrange(len(at), ((place - middle) / half).ravel())
        found: np.ndarray = (values @ spread).reshape(place.shape)
        return found * np.exp(-1j * math.pi * lasts * place) / self._factor


def _played(
    heard: Heard,
    late: np.ndarray,
    alpha: np.ndarray,
    needed: np.ndarray,
    grid: BandGrid,
    speeds: _Speeds,
) -> np.ndarray:
    """(K,) the call's echoes by M paths of delays and speeds (M,).

    needed : (M,) nodes between which amplitudes may be interpolated, 0: none.
    """
    total = np.zeros(grid.count, dtype=np.complex128)
    half = 0.5 * (grid.count - 1) * grid.spacing
    middle = grid.start + half
    block = float(np.clip(0.5 * speeds.call.duration, *BLOCK))
    lasts = block + speeds.call.duration / float(alpha.min(initial=1.0))
    level = np.searchsorted(CLASSES, needed)
    level[needed == 0] = len(CLASSES)
    for number in np.unique(level).tolist():
        rows = np.flatnonzero(level == number)
        if number == len(CLASSES):  # at every bin, as they are
            step = max(1, AT_ONCE // grid.count)
            for first in range(0, len(rows), step):
                some = rows[first : first + step]
                values = heard(grid.frequency, some)
                both = values.real, values.imag
                total += _sum(both, grid.frequency, late[some], speeds, alpha[some])
            continue
        rows = rows[np.argsort(late[rows], kind="stable")]
        nodes = CLASSES[number]
        count = nodes + _points(math.pi * half * lasts, speeds.error)
        frequency = middle + half * chebyshev.points(count)
        onwards = chebyshev.lagrange(nodes, chebyshev.points(count)).T
        which = np.floor((late[rows] - late[rows[0]]) / block).astype(np.int64)
        edges = np.append(np.flatnonzero(np.diff(which, prepend=-1)), len(rows))
        centre = late[rows[0]] + (which[edges[:-1]] + 0.5) * block + 0.5 * speeds.call.duration
        sums = np.zeros((len(centre), count), dtype=np.complex128)
        at_nodes = middle + half * chebyshev.points(nodes)
        step = max(1, AT_ONCE // count)
        for b, (begin, end) in enumerate(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)):
            for first in range(begin, end, step):
                some = rows[first : min(first + step, end)]
                values = heard(at_nodes, some)
                both = product(onwards, values.real), product(onwards, values.imag)
                away = late[some] - centre[b]
                sums[b] += _sum(both, frequency, away, speeds, alpha[some])
        spread = chebyshev.lagrange(count, np.linspace(-1.0, 1.0, grid.count))
        carried = np.exp(-2j * math.pi * np.outer(centre, grid.frequency))
        total += np.einsum("bk,bk->k", sums @ spread, carried)
    return total


def _sum(
    values: tuple[np.ndarray, np.ndarray],
    frequency: np.ndarray,
    late: np.ndarray,
    speeds: _Speeds,
    alpha: np.ndarray,
) -> np.ndarray:
    """(F,) amplitudes (F, M), their real and imaginary parts, times the call at the speeds (M,), at delays
    (M,).

    Paths are added up for each point of speed, and only then meet the call: in real numbers, whose sines and
    products take a fifth of the time of complex ones.
    """
    real, imaginary = values
    turns = np.outer(frequency, late)
    turns -= np.rint(turns)
    turns *= 2.0 * math.pi
    cos, sin = np.cos(turns), np.sin(turns, out=turns)
    one, two = real * cos, imaginary * sin
    one += two
    cos *= imaginary
    sin *= real
    cos -= sin
    shares = speeds.shares(alpha).T
    summed = np.empty((len(frequency), shares.shape[1]), dtype=np.complex128)
    summed.real, summed.imag = product(one, shares), product(cos, shares)
    summed *= speeds.known(frequency)
    found: np.ndarray = summed.sum(axis=1)
    return found


def _points(turns: float, error: float) -> int:
    """Chebyshev points for e^{i·turns·x}: its coefficients are 2·i^n·J_n(turns), DLMF 10.12.3."""
    order = np.arange(1, math.ceil(1.2 * turns) + 60)
    tail = 4.0 * np.cumsum(np.abs(special.jv(order, turns))[::-1])[::-1]
    return int(order[max(int(np.argmax(tail <= error)), 1)])
