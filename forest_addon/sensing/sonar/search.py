"""Search for the scatterers that are heard: block by block, until the rest can add next to nothing.

What stands before a scatterer weakens it before it is counted in Σ|A|; what is left out counts as if
nothing did.

Blocks are opened in order of their bounds, loudest first, until the bounds of those that stay shut are at
most a fifth of ``cull``·Σ|A|; of the scatterers within, the weakest go until their bounds fill the rest:
to look at one takes a sixth of the time of hearing it. Σ|A| is known from below by the loudest few, each
averaged over the band (Hann), so the promise is kept whatever the others add:

    Σ bound of what is left out  <=  cull · Σ|A| of what is heard.

A bound holds at every frequency of the band, so it also holds at every instant of the impulse response.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ... import kernels
from ...acoustics.disc import bound_tables
from ...acoustics.disc_table import HANDOVER, STEPS
from ...base.rows import RowTable
from .calls import SAMPLED, Band
from .leaves import ASIDE, CLOSEST, FAR, LeafEchoes, NearFaces, near_groups
from .scatterers import Scatterers, Sight, StrengthParts
from .station import EchoPaths, Station
from .targets import Candidates, EchoTargets

MANY, FEWER = 512, 7  # scatterers whose Σ|A| is known from so few frequencies
LOUDEST = 4096  # scatterers whose Σ|A| is a lower bound
CAUTION = 0.9  # a mean over few frequencies may be a little too large
SHUT = 0.2  # of what may be left out, in blocks that stay shut
GUESS = 0.01  # of Σ|A| over the bounds of the blocks, where the search starts


@dataclass(frozen=True)
class SearchGroup(RowTable):
    """M scatterers of one kind with their instances and ways; ``shade`` (M,) is what is left of each by
    what stands before it, 0 where wood hides it. motion : (M, 6) velocity, m/s, and the place at rest, m, NaN
    where it is not there; (M, 0) where all stand still."""

    scatterers: Scatterers
    instance: np.ndarray
    paths: EchoPaths
    bound: np.ndarray
    shade: np.ndarray
    motion: np.ndarray

    @property
    def velocity(self) -> np.ndarray:
        """(M, 3) m/s; (M, 0) where all stand still."""
        return self.motion[:, :3]

    def ways(self, point: np.ndarray) -> np.ndarray:
        """(M, 3) unit, from the mouth, which is at a point (3,)."""
        return np.asarray((self.scatterers.centre - point) / self.paths.distance[:, None])


@dataclass
class Counts:
    """Counts of scatterers left out: beyond the range, too near, not finite, hidden by wood."""

    far: int = 0
    near: int = 0
    broken: int = 0
    hidden: int = 0
    late: int = 0


@dataclass(frozen=True)
class Found:
    """Groups that are heard, what the others add at most as a share of Σ|A|, and the counts."""

    groups: list[SearchGroup]
    bound: float
    counts: Counts


def search(
    targets: EchoTargets,
    station: Station,
    band: Band,
    shade: Callable[[SearchGroup], np.ndarray] | None,
    latest: float,
) -> Found:
    """Find what is heard from a station.

    shade : (M,) of a group, what is left of its pressure by what stands before it; None: all.
    latest : seconds; later echoes are cut.
    """
    sonar = station.sonar
    blocks, far = targets.candidates(sonar, station.point, *station.wavenumbers)
    bound = station.ceiling(blocks)
    order = np.argsort(-bound, kind="stable")
    order = order[: np.count_nonzero(bound)]
    rest = np.append(np.cumsum(bound[order][::-1])[::-1], 0.0)
    unbounded = int(np.count_nonzero(np.isinf(bound)))  # with something not finite: they come first
    finder = _Finder(targets, station, band, shade, latest)

    opened, known, told = 0, GUESS * float(rest[unbounded]), 0
    while True:
        until = max(int(np.searchsorted(-rest, -SHUT * sonar.cull * known)), opened, unbounded)
        if until == opened:
            return finder.keep(sonar.cull * known, float(rest[opened]), known, far)
        finder.open(blocks.select(order[opened:until]))
        opened = until
        if told < LOUDEST:
            told, known = finder.least()


class _Finder:
    """Opened blocks as groups, and how loud they are at least."""

    def __init__(
        self,
        targets: EchoTargets,
        station: Station,
        band: Band,
        shade: Callable[[SearchGroup], np.ndarray] | None,
        latest: float,
    ) -> None:
        self._targets, self._station, self._band = targets, station, band
        self._shade, self._latest = shade, latest * station.sound_speed
        self._tally = np.zeros(4, np.int64)  # not finite, too near, too far, too late
        sonar = station.sonar
        self._sight = Sight(
            station.point, station.wavenumbers[1], sonar.max_range, sonar.near_limit
        )
        self._groups: list[SearchGroup] = []  # shade is NaN where it has not been asked for

    def open(self, blocks: Candidates) -> None:
        """Move the scatterers of some blocks into the world and bound each."""
        sonar, library = self._station.sonar, kernels.library()
        if library is not None:
            runs, blocks = self._targets.still_leaves(sonar, blocks)
            self._open_leaves(library, runs)
        for made, instance, motion in self._targets.scatterers(sonar, blocks, self._sight):
            self._add(made, instance, motion)

    def _open_leaves(self, library: Any, runs: list[tuple[Any, ...]]) -> None:
        """Open blocks of ``EchoTargets.still_leaves`` by the kernel."""
        station, sonar, (places, frames) = self._station, self._station.sonar, self._station.ends
        told = (
            *(sonar.near_limit, sonar.max_range, 0.5 * sonar.near_limit * (station.apart > 0)),
            *(self._latest, station.least_loss, FAR, ASIDE, CLOSEST),
            *(*station.wavenumbers, HANDOVER, *STEPS),
        )
        by = len(places), places, frames, station.steepness, np.array(told, np.float64)
        room = sum(int((last - first).sum()) for _, first, last, *_ in runs)
        (number, instance), kept = np.empty((2, room), np.int64), np.zeros(2, np.int64)
        centre, normal = np.empty((2, room, 3))
        radius, nearness, bound = np.empty((3, room))
        made = LeafEchoes(centre, number, normal, radius, nearness, sonar.leaf_model)
        paths, still = EchoPaths.empty(room, len(places)), np.empty((room, 0))
        output = room, kept, self._tally, centre, number, normal, radius, nearness, instance
        for run in runs:
            tables = *by, *bound_tables(sonar.leaf_model)
            library.open_leaves(*run, *tables, *output, paths.away, paths.offset, bound)
        far, near = kept.tolist()
        opened = made.select(slice(far)), instance[:far], paths.select(slice(far))
        if np.isnan(station.steepness).any():
            bound[:far] *= opened[2].bound(station)
        self._take(*opened, bound[:far], still[:far])
        if near:
            leaves = made.select(np.arange(room - 1, room - 1 - near, -1))
            for part, row in near_groups(leaves, self._sight):
                self._add(part, instance[room - 1 - row], still[row])

    def _add(self, made: Scatterers, instance: np.ndarray, motion: np.ndarray) -> None:
        """Bound scatterers that are moved, and keep those that may be heard."""
        station, sonar = self._station, self._station.sonar
        paths = station.paths(made.centre)
        finite = np.isfinite(paths.distance) & _finite(made)
        kept = finite & (paths.distance >= sonar.near_limit)
        near, far = finite & ~kept, finite & (paths.distance > sonar.max_range)
        if isinstance(made, NearFaces):  # of leaves whose middles are within the range
            near = far = np.zeros(1, dtype=bool)
        kept &= ~far
        for leg in paths.leg.T if station.apart else ():  # an ear may be nearer than the mouth
            kept &= leg >= 0.5 * sonar.near_limit
        late = np.zeros(len(made), dtype=bool)
        for length in paths.length.T if self._latest < np.inf else ():
            late |= length > self._latest
        late &= kept
        some = [int(np.count_nonzero(rows)) for rows in (~finite, near, far)]
        self._tally += np.array([*some, made.count(instance, late)])
        if late.any() or not kept.all():
            rows = np.flatnonzero(kept & ~late)
            made, paths = made.select(rows), paths.select(rows)
            instance, motion = instance[rows], motion[rows]
        bound = paths.bound(station) * made.seen(station.point).bound(*station.wavenumbers)
        self._take(made, instance, paths, bound, motion)

    def _take(
        self,
        made: Scatterers,
        instance: np.ndarray,
        paths: EchoPaths,
        bound: np.ndarray,
        motion: np.ndarray,
    ) -> None:
        """Have what is loud at all as a group."""
        shade = np.full(len(bound), 1.0 if self._shade is None else np.nan)
        group = SearchGroup(made, instance, paths, bound, shade, motion)
        group = group if (bound > 0).all() else group.select(bound > 0)
        if len(group):
            self._groups.append(group)

    def least(self) -> tuple[int, float]:
        """Number of scatterers opened, and Σ|A| of the loudest, by their bounds: no more than of all."""
        bounds = np.concatenate([group.bound for group in self._groups] or [np.empty(0)])
        count = min(LOUDEST, len(bounds))
        limit = np.partition(bounds, -count)[-count] if count else 0.0
        total = 0.0
        for number in range(len(self._groups)):
            rows = np.flatnonzero(self._groups[number].bound >= limit)
            self._look(number, rows)
            group = self._groups[number].select(rows)
            few = FEWER if len(rows) >= MANY else SAMPLED
            total += float(mean_amplitude(group, self._station, self._band, few).sum())
        return len(bounds), CAUTION * total

    def keep(self, budget: float, shut: float, known: float, far: int) -> Found:
        """All but the weakest, whose bounds and ``shut`` add up to at most ``budget``.

        known : Σ|A| at least. far : how many were too far to be looked at.
        """
        bounds = np.concatenate([group.bound for group in self._groups] or [np.empty(0)])
        ascending = np.sort(bounds)
        dropped = int(np.searchsorted(np.cumsum(ascending), budget - shut, side="right"))
        limit = ascending[dropped] if dropped < len(bounds) else np.inf
        kept, left_out, hidden = [], 0.0, 0
        for number in range(len(self._groups)):
            rows = np.flatnonzero(self._groups[number].bound >= limit)
            self._look(number, rows)
            group = self._groups[number]
            left_out += float(group.bound.sum() - group.bound[rows].sum())
            group = group.select(rows)
            lit = group.shade > 0
            hidden += group.scatterers.count(group.instance, ~lit)
            kept.append(group if lit.all() else group.select(np.flatnonzero(lit)))
        rest = shut + (max(left_out, 0.0) if dropped else 0.0)
        broken, near, farther, late = self._tally.tolist()
        counts = Counts(far + farther, near, broken, hidden, late)
        return Found(merged(kept), rest / known if rest > 0 else 0.0, counts)

    def _look(self, number: int, rows: np.ndarray) -> None:
        """Ask what stands before rows of a group that have not been asked for."""
        group = self._groups[number]
        rows = rows[np.isnan(group.shade[rows])]
        if self._shade is not None and len(rows):
            group.shade[rows] = self._shade(group.select(rows))


class EarAmplitudes:
    """Amplitudes A of M echoes of a group at one ear: scattering times what beams, way, air and shade leave.

    strength : of the group, towards half way between mouth and ear.
    """

    def __init__(self, group: SearchGroup, station: Station, ear: int) -> None:
        self._station, paths = station, group.paths
        leg = paths.leg[:, ear]
        self.length = paths.distance + leg
        offset, steady = paths.offset.T, np.zeros(len(group))
        beams = {0: station.equipment.emit, 1 + ear: station.equipment.hear(ear)}
        terms = {end: beam.terms(*offset[:, end]) for end, beam in beams.items()}
        for end in [end for end in beams if not np.isnan(beams[end].steepness).any()]:
            steady += terms.pop(end)[0]  # the same at every frequency
        self._level = group.shade * np.exp(steady) / (paths.distance * leg)
        self._beams = [beams[end] for end in terms]
        self._terms = np.concatenate([*terms.values(), -self.length[None]])
        self.strength = group.scatterers.seen((station.point + station.ear[ear]) / 2)

    def _basis(self, frequency: np.ndarray) -> np.ndarray:
        beams = [beam.basis(frequency) for beam in self._beams]
        return np.concatenate([*beams, self._station.loss(frequency)[None]])

    def gain(self, frequency: np.ndarray) -> np.ndarray:
        """(Q, M) of all."""
        return np.exp(np.einsum("dq,dm->qm", self._basis(frequency), self._terms)) * self._level

    def of(
        self, parts: StrengthParts, frequency: np.ndarray, rows: np.ndarray | slice
    ) -> np.ndarray:
        """(Q, m) complex A of some rows of parts at frequencies (Q,)."""
        some, turns = parts.rows[rows], 2.0 * np.pi * frequency
        amplitude = parts.strength.select(rows).amplitude(turns / self._station.sound_speed)
        basis = self._basis(frequency)
        library = kernels.library()
        if library is None:
            return amplitude * self.gain(frequency)[:, some]
        given = len(self._level), self._level, *basis.shape[:1], basis, self._terms, amplitude
        library.weigh_echoes(*amplitude.shape, some, *given)
        return amplitude

    def reach(self, parts: StrengthParts, band: tuple[float, float]) -> np.ndarray:
        """(m,) s, about how far responses of parts reach, with what their gains change over a band."""
        basis = np.diff(self._basis(np.array(band)), axis=1)[:, 0]
        change = np.einsum("d,dm->m", basis, self._terms)
        width, speed = max(band[1] - band[0], 1e-9), self._station.sound_speed
        own = parts.strength.reach(2.0 * np.pi * band[0] / speed) / speed
        return np.asarray(own + np.abs(change[parts.rows]) / (2.0 * np.pi * width))


def mean_amplitude(
    group: SearchGroup, station: Station, band: Band, count: int = SAMPLED
) -> np.ndarray:
    """(M,) mean |A| over the band (Hann) at the first ear, on the band's own few frequencies."""
    frequency, weight = band.sample(count)
    heard = EarAmplitudes(group, station, 0)
    return np.asarray(weight @ np.abs(heard.of(heard.strength.whole(), frequency, slice(None))))


def merged(groups: list[SearchGroup]) -> list[SearchGroup]:
    """Groups of the same kind as one."""
    kinds = dict.fromkeys(type(group.scatterers) for group in groups if len(group))
    return [SearchGroup.joined([g for g in groups if type(g.scatterers) is k]) for k in kinds]


def _finite(made: Scatterers) -> np.ndarray:
    """(M,) whether every number of each is finite."""
    values = [v for v in vars(made).values() if isinstance(v, np.ndarray) and v.dtype.kind == "f"]
    return np.isfinite(sum(v.sum(axis=tuple(range(1, v.ndim))) for v in values))
