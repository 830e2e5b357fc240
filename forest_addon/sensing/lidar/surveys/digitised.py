"""Scans as HELIOS++ makes them: rings of rays, echoes as maxima of a waveform in bins, and voxels that light
passes by chance.

The light of each ray is a short pulse (t/τ)²·exp(-t/τ) of a seventh of its length τ (Carlsson et al. 2001),
which starts in a bin of its own, counted from the nearest ray's. A bin is an echo that is larger than all
others within the window, none of which is empty. How many echoes a footprint gives that is long in range
then depends on bins, window and rings; their ranges here are those of the light that belongs to each,
without bins.

Distances are times in one direction there: light that is 1 m farther is 3.3 ns later, not 6.7.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from ....base.rng import daughter_keys, keyed_uniform
from ....formats.helios.device import Digitiser
from ...moving_rays import MovingCaster
from ...rays.caster import Hits, RayCaster
from ..footprint import BeamFrames, rays_at
from ..passage import Contacts, Received, scalars_of
from ..pattern import LiDAR, Pattern, Pulses
from ..radiometry import intensity
from ..scan import RAYS_AT_ONCE, Scan
from ..waveform import LIGHT, WaveformEchoes, gathered

BINS_AT_ONCE = 4_000_000  # of all waveforms in work
METRES_A_NS = LIGHT * 1e-9


class DigitisedScan(Scan):
    """A scan whose footprints are HELIOS++'s rings of rays, and whose echoes are found in bins.

    Beams that meet one face, and a short way of it, have one echo without that.
    across : radians by which the first ray of a ring is turned from the direction of the sweep.
    """

    def __init__(
        self,
        scanner: LiDAR,
        caster: RayCaster | MovingCaster,
        seed: int,
        pattern: Pattern,
        digitiser: Digitiser,
        across: float = 0.0,
    ) -> None:
        super().__init__(scanner, caster, seed, pattern=pattern)  # type: ignore[arg-type]
        self._digitiser, self._across = digitiser, across
        self._rings = rings(digitiser.rings)

    def _frames(self, pulses: Pulses, keys: np.ndarray) -> BeamFrames:
        half = 0.5e-3 * np.array(self.scanner.beam.divergence_mrad)[:, None, None]
        beside = np.cross(pulses.direction, pulses.across)
        cos, sin = np.cos(self._across), np.sin(self._across)
        none = np.zeros_like(beside)
        return BeamFrames(
            origin=pulses.origin,
            axis=pulses.direction,
            exit_x=none,
            exit_y=none,
            turn_x=half[0] * (cos * pulses.across + sin * beside),
            turn_y=half[1] * (cos * beside - sin * pulses.across),
        )

    def _on_faces(
        self, beams: BeamFrames, rows: np.ndarray, face: np.ndarray
    ) -> Iterator[tuple[np.ndarray, Received]]:
        at_once = RAYS_AT_ONCE // len(self._rings.away)
        for first in range(0, len(rows), at_once):
            part = slice(first, first + at_once)
            yield rows[part], self._on_face(beams.select(rows[part]), face[part])

    def _on_face(self, beams: BeamFrames, face: np.ndarray) -> Received:
        """Echoes of beams (P,) that meet these faces with all their rays."""
        planes, ring = self._planes, self._rings
        normal = planes.normal[face]
        scalars = scalars_of(beams, planes.foot[face], normal)[:, :, None]
        height, _, _, facing, turn_x, turn_y = scalars
        half = 0.5e-3 * self.scanner.beam.divergence_mrad[0]
        lean = facing + ring.x * turn_x
        lean += ring.y * turn_y
        lean /= np.sqrt(1 + (half * ring.away) ** 2)
        distance = height / lean
        light = planes.reflectance[face][:, None] * ring.share
        energy = intensity(light, lean, distance, self.scanner.beam.extinction)
        inside = (distance >= self.scanner.min_range) & (distance <= self.scanner.max_range)
        pulse, subray = np.nonzero((energy > 0) & inside)
        echoes = self._digitised(pulse, subray, distance[pulse, subray], energy[pulse, subray])
        beam, ray = pulse[echoes.contact], subray[echoes.contact]
        way = beams.axis[beam] + ring.x[ray, None] * beams.turn_x[beam]
        way += ring.y[ray, None] * beams.turn_y[beam]
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        met = face[beam]
        told = planes.instance[met], planes.triangle[met], normal[beam]
        hits = Hits(distance[beam, ray], *told)
        return Received(echoes, hits, way, normal[beam])

    def _rays(self, beams: BeamFrames) -> tuple[np.ndarray, np.ndarray]:
        return rays_at(beams, self._rings.x, self._rings.y)

    def _light(self, contacts: Contacts, reflectance: np.ndarray) -> np.ndarray:
        share = self._rings.share[contacts.ray % len(self._rings.share)]
        return np.asarray(reflectance * contacts.light * share)

    def _echoes(
        self,
        rays: tuple[np.ndarray, np.ndarray],
        contacts: Contacts,
        counts: np.ndarray,
        energy: np.ndarray,
        ways: np.ndarray,
        normal: np.ndarray,
    ) -> WaveformEchoes:
        pulse, subray = np.divmod(contacts.ray[counts], len(self._rings.share))
        return self._digitised(pulse, subray, contacts.hits.distance[counts], energy[counts])

    def _digitised(
        self, pulse: np.ndarray, subray: np.ndarray, distance: np.ndarray, energy: np.ndarray
    ) -> WaveformEchoes:
        pulse_ns = self.scanner.beam.pulse_ns
        return digitised(pulse, subray, distance, energy, pulse_ns, self._digitiser)


@dataclass(frozen=True)
class Rings:
    """Rays of a beam: (N,) angles from the axis in half divergences, angles around it, shares of light."""

    away: np.ndarray
    around: np.ndarray
    share: np.ndarray

    @cached_property
    def x(self) -> np.ndarray:
        """(N,) half divergences from the axis, along the first ray of a ring."""
        return np.asarray(self.away * np.cos(self.around))

    @cached_property
    def y(self) -> np.ndarray:
        """(N,) half divergences from the axis, across that."""
        return np.asarray(self.away * np.sin(self.around))


def rings(quality: int) -> Rings:
    """One ray, and rings of 6, 12, … at even angles, of which the outermost is just inside the divergence.

    Ring k of n rays is weighed by ((2k + 1)/n)², as HELIOS++'s energy model does far from the scanner: its
    share of the light and of the footprint.
    """
    away, around, share = [0.0], [0.0], [1.0]
    for ring in range(1, quality):
        count = int(2 * np.pi * ring)
        away += [2.0 * ring / quality] * count
        around += (2 * np.pi / count * np.arange(count)).tolist()
        share += [((2 * ring + 1) / count) ** 2] * count
    return Rings(np.array(away), np.array(around), np.array(share) / sum(share))


def pulse_shape(pulse_ns: float, bin_ns: float) -> np.ndarray:
    """(B,) light of a pulse in the bins from its start on."""
    time = bin_ns * np.arange(max(int(pulse_ns / bin_ns), 1)) * 7 / pulse_ns
    return np.asarray(time**2 * np.exp(-time))


def digitised(
    pulse: np.ndarray,
    subray: np.ndarray,
    distance: np.ndarray,
    energy: np.ndarray,
    pulse_ns: float,
    digitiser: Digitiser,
) -> WaveformEchoes:
    """The echoes of C contacts; see ``waveform.find_echoes``.

    Light in no echo belongs to the nearest one of its pulse; a pulse without any has none.
    """
    order = np.lexsort((distance, pulse))
    pulse, subray, distance, energy = (v[order] for v in (pulse, subray, distance, energy))
    new = np.append(True, np.diff(pulse) != 0) if len(pulse) else np.zeros(0, dtype=bool)
    nearest = distance[np.flatnonzero(new)][np.cumsum(new) - 1] if len(pulse) else distance
    place = ((distance - nearest) / (METRES_A_NS * digitiser.bin_ns) + 1e-9).astype(np.int64)
    shape = pulse_shape(pulse_ns, digitiser.bin_ns)
    window = int(digitiser.window_ns / digitiser.bin_ns)
    far = len(shape) + window  # bins beyond which lights do not meet
    apart = new.copy()
    apart[1:] |= np.diff(place) > far
    group = np.cumsum(apart) - 1
    start = np.flatnonzero(apart)
    bins = place - place[start][group]
    lone = pulse[start]
    opens = np.append(True, np.diff(lone) != 0) if len(lone) else new
    ends = np.stack([opens, np.append(opens[1:], True)]) if len(lone) else np.zeros((2, 0), bool)
    peak_group, peak_bin = _maxima(group, bins, energy, ends, shape, window)
    owner = _owners(pulse, place, start, peak_group, peak_bin, int(np.argmax(shape)))
    rows = np.flatnonzero(owner >= 0)
    rows = rows[np.argsort(owner[rows], kind="stable")]
    pulse, subray, distance, energy = (v[rows] for v in (pulse, subray, distance, energy))
    if not len(rows):
        return WaveformEchoes(pulse, distance, energy, distance, rows)
    number = np.cumsum(np.diff(owner[rows], prepend=owner[rows[0]]) != 0)
    own = pulse_ns / 7 * np.sqrt(3.0) * METRES_A_NS / 2  # the spread of the pulse itself
    found = gathered(number, pulse, subray, distance, energy, np.zeros(len(rows)), own)
    return replace(found, contact=order[rows[found.contact]])


def _maxima(
    group: np.ndarray,
    bins: np.ndarray,
    energy: np.ndarray,
    ends: np.ndarray,
    shape: np.ndarray,
    window: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Groups of contacts, and bins in them, at which the waveform has an echo; in that order.

    ends : (2, G) bool, groups with which the waveform of a pulse begins, and ends: nothing is beyond.
    """
    length = np.zeros(ends.shape[1], dtype=np.int64)
    np.maximum.at(length, group, bins)
    length += len(shape)
    found_group, found_bin = [], []
    by_length = np.argsort(length, kind="stable")
    first = 0
    while first < len(by_length):
        widest = length[by_length[first : first + 4096]]
        count = int(np.searchsorted(np.arange(1, len(widest) + 1) * widest, BINS_AT_ONCE)) or 1
        some = by_length[first : first + count]
        first += len(some)
        row = np.full(ends.shape[1], -1)
        row[some] = np.arange(len(some))
        rows = np.flatnonzero(row[group] >= 0)
        wave = np.zeros((len(some), int(length[some].max())))
        flat = row[group[rows]] * wave.shape[1] + bins[rows]
        for shift, light in enumerate(shape):
            wave.ravel()[:] += np.bincount(
                flat + shift, weights=energy[rows] * light, minlength=wave.size
            )
        peak = wave > 0
        for away in range(1, window):
            before = np.pad(wave, ((0, 0), (away, 0)), constant_values=-1.0)[:, : wave.shape[1]]
            after = np.pad(wave, ((0, 0), (0, away)), constant_values=-1.0)[:, away:]
            bin_ = np.arange(wave.shape[1])
            before_all = (bin_ - away <= 0) & ends[0, some][:, None]
            beyond_all = (bin_ + away >= length[some][:, None]) & ends[1, some][:, None]
            peak &= ((before > 0) & (before < wave)) | before_all
            peak &= ((after > 0) & (after < wave)) | beyond_all
        where, at = np.nonzero(peak)
        found_group.append(some[where])
        found_bin.append(at)
    which, at = (
        np.concatenate([*found_group, np.zeros(0, int)]),
        np.concatenate([*found_bin, np.zeros(0, int)]),
    )
    order = np.lexsort((at, which))
    return which[order], at[order]


def _owners(
    pulse: np.ndarray,
    place: np.ndarray,
    start: np.ndarray,
    peak_group: np.ndarray,
    peak_bin: np.ndarray,
    crest: int,
) -> np.ndarray:
    """(C,) number of the echo that a contact belongs to: the nearest of its pulse; -1 where it has none."""
    reach = int(place.max(initial=0)) + 1_000
    at = pulse[start][peak_group] * reach + place[start][peak_group] + peak_bin - crest
    mine = pulse * reach + place
    after = np.searchsorted(at, mine)
    best = np.full(len(mine), -1)
    away = np.full(len(mine), np.inf)
    for side in (after - 1, after):
        there = np.flatnonzero((side >= 0) & (side < len(at)))
        same = there[pulse[start][peak_group[side[there]]] == pulse[there]]
        gap = np.abs(at[side[same]] - mine[same])
        better = gap < away[same]
        best[same[better]], away[same[better]] = side[same[better]], gap[better]
    return best


# Voxels that light passes by chance: plant area as a haze, of one density in each cell of a grid.
#
# A ray goes s = -ln U / σ before it meets a plant, in a medium that has σ m² of area in its way a m³. As
# that law has no memory, one U a ray and grid, spent on σ times the way in each cell that it crosses, is the
# law of HELIOS++, which draws one a voxel (Weiser et al. 2021, Remote Sens. 13, 4).


@dataclass(frozen=True)
class Haze:
    """A grid of plant area in a scene.

    instance : number of what stands for it in the scene. transform : (3, 4) grid to world, a turn, an even
    scale and a shift. low : (3,) lowest corner of the grid, and size : edge of its cells, in its own metres.
    density : (X, Y, Z) area in the way of light, m² a m³ of the world.
    """

    instance: int
    transform: np.ndarray
    low: np.ndarray
    size: float
    density: np.ndarray

    def reach(
        self, origins: np.ndarray, directions: np.ndarray, depth: np.ndarray, farthest: np.ndarray
    ) -> np.ndarray:
        """(R,) metres at which rays have crossed so much area, ∞ where they do not up to ``farthest``.

        depth : (R,) area that a ray crosses, m² a m². origins, directions : (R, 3). farthest : (R,) metres.
        """
        found = np.full(len(origins), np.inf)
        inward = np.linalg.inv(self.transform[:, :3]) / self.size
        start = (origins - self.transform[:, 3]) @ inward.T - self.low / self.size
        way = directions @ inward.T
        cells = np.array(self.density.shape)
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([(0 - start) / way, (cells - start) / way])
        along = way == 0
        outside = along & ((start < 0) | (start >= cells))
        ends[:, along] = np.array([[-np.inf], [np.inf]])
        enters = np.maximum(ends.min(axis=0).max(axis=1), 0.0)
        leaves = np.minimum(ends.max(axis=0).min(axis=1), farthest)
        rows = np.flatnonzero((enters < leaves) & ~outside.any(axis=1))
        start, way, at, last = start[rows], way[rows], enters[rows], leaves[rows]
        left = depth[rows].copy()
        ahead = way > 0
        cell = np.clip(np.floor(start + at[:, None] * way), 0, cells - 1).astype(np.int64)
        while len(rows):
            with np.errstate(divide="ignore", invalid="ignore"):
                border = (cell + ahead - start) / way
            border[way == 0] = np.inf
            axis = border.argmin(axis=1)
            lines = np.arange(len(rows))
            stop = np.clip(border[lines, axis], at, last)
            density = self.density[cell[:, 0], cell[:, 1], cell[:, 2]]
            crossed = density * (stop - at)
            met = crossed >= left
            found[rows[met]] = at[met] + left[met] / density[met]
            cell[lines, axis] += np.where(ahead[lines, axis], 1, -1)
            inside = ((cell >= 0) & (cell < cells)).all(axis=1)
            on = np.flatnonzero(~met & (stop < last) & inside)
            rows, at, left = rows[on], stop[on], (left - crossed)[on]
            start, way, last, cell, ahead = start[on], way[on], last[on], cell[on], ahead[on]
        return found


class HazyScan(Scan):
    """A scan of a scene in which light passes voxels by chance."""

    _hazes: tuple[Haze, ...] = ()

    def among(self, hazes: tuple[Haze, ...]) -> Self:
        """The same scan with voxels that light passes by chance."""
        if not hazes:
            return self
        other = copy(self)
        other._hazes, other._faces, other._sure = hazes, None, False
        other.at_once = max(1, RAYS_AT_ONCE // self.scanner.beam.subrays)
        return other

    def _met(
        self, rays: tuple[np.ndarray, np.ndarray], keys: np.ndarray, at: np.ndarray | None
    ) -> Contacts:
        found = super()._met(rays, keys, at)
        for number, haze in enumerate(self._hazes):
            nearest = np.full(len(keys), self.scanner.max_range)
            np.minimum.at(nearest, found.ray, found.hits.distance)
            chance = keyed_uniform(daughter_keys(keys, number), "voxels")
            distance = haze.reach(*rays, -np.log(chance), nearest)
            met = np.flatnonzero(np.isfinite(distance))
            kept = found.select(np.flatnonzero(found.hits.distance <= distance[found.ray]))
            first = np.zeros(len(met), dtype=np.int64)
            there = np.full(len(met), haze.instance)
            hits = Hits(distance[met], there, first, -rays[1][met])
            organ = self.caster.scene.meshes[haze.instance].part[first]
            found = Contacts.joined([kept, Contacts(met, hits, organ, np.ones(len(met)))])
            found = found.select(np.lexsort((found.hits.distance, found.ray)))
        return found

    def _normals(self, hits: Hits, ways: np.ndarray, time: np.ndarray) -> np.ndarray:
        normal = super()._normals(hits, ways, time)
        hazy = np.isin(hits.instance, [haze.instance for haze in self._hazes])
        return np.where(hazy[:, None], -ways, normal) if hazy.any() else normal
