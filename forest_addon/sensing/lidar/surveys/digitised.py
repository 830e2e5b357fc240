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

from copy import copy
from dataclasses import dataclass
from typing import Self

import numpy as np

from ....base.rng import child_keys, keyed_uniform
from ....formats.helios.device import Digitiser
from ...rays.caster import Hits
from ...rays.cells import Cells, walk
from ..footprint import BeamFrames, rays_at
from ..passage import Contacts
from ..pattern import Pulses
from ..scan import Scan
from ..waveform import LIGHT, Bins

METRES_A_NS = LIGHT * 1e-9


def rings(quality: int) -> tuple[np.ndarray, np.ndarray]:
    """Rays of a beam: half divergences from the axis (N, 2), along the first ray of a ring and across, and
    shares of the light (N,).

    One ray, and rings of 6, 12, … at even angles, of which the outermost is just inside the divergence. Ring
    k of n rays is weighed by ((2k + 1)/n)², as HELIOS++'s energy model does far from the scanner: its share
    of the light and of the footprint.
    """
    away, around, share = [0.0], [0.0], [1.0]
    for ring in range(1, quality):
        count = int(2 * np.pi * ring)
        away += [2.0 * ring / quality] * count
        around += (2 * np.pi / count * np.arange(count)).tolist()
        share += [((2 * ring + 1) / count) ** 2] * count
    place = np.stack([np.cos(around), np.sin(around)], axis=1) * np.array(away)[:, None]
    return place, np.array(share) / sum(share)


def bins_of(pulse_ns: float, digitiser: Digitiser) -> Bins:
    """Bins of a pulse's light, from its start on."""
    count = max(int(pulse_ns / digitiser.bin_ns), 1)
    time = digitiser.bin_ns * np.arange(count) * 7 / pulse_ns
    window = int(digitiser.window_ns / digitiser.bin_ns)
    return Bins(time**2 * np.exp(-time), METRES_A_NS * digitiser.bin_ns, window)


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
        distance, left = np.full(len(origins), np.inf), depth.copy()
        inward = np.linalg.inv(self.transform[:, :3]) / self.size
        start = (origins - self.transform[:, 3]) @ inward.T - self.low / self.size
        grid = Cells(np.zeros(3, np.int64), np.array(self.density.shape), 1.0)
        for step in walk(grid, start, directions @ inward.T, farthest):
            density = self.density.ravel()[step.cell]
            crossed = density * (step.leave - step.enter)
            met = crossed >= left[step.line]
            row = step.line[met]
            distance[row] = step.enter[met] + left[row] / density[met]
            left[step.line] -= crossed
            left[row] = np.inf  # no farther
        return distance


class SurveyScan(Scan):
    """A scan that may find echoes as HELIOS++ does, and whose light may pass voxels by chance."""

    _hazes: tuple[Haze, ...] = ()
    _rings: np.ndarray | None = None
    _across = 0.0

    def among(self, hazes: tuple[Haze, ...]) -> Self:
        """The same scan with voxels that light passes by chance."""
        other = copy(self)
        other._hazes, other._by_chance = hazes, self._by_chance or bool(hazes)
        return other

    def sampled(self, digitiser: Digitiser, across: float = 0.0) -> Self:
        """The same scan with HELIOS++'s rings of rays, whose echoes are found in bins.

        across : radians by which the first ray of a ring is turned from the direction of the sweep.
        """
        other, pulse_ns = copy(self), self.scanner.beam.pulse_ns
        other._rings, other._share = rings(digitiser.rings)
        other._across, other._subrays = across, len(other._share)
        other._bins = bins_of(pulse_ns, digitiser)
        other._sigma = pulse_ns / 7 * np.sqrt(3.0) * METRES_A_NS / 2
        return other

    def _rays(self, pulses: Pulses, keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if self._rings is None:
            return super()._rays(pulses, keys)
        along, across = 0.5e-3 * np.array(self.scanner.beam.divergence_mrad)
        beside = np.cross(pulses.direction, pulses.across)
        cos, sin = np.cos(self._across), np.sin(self._across)
        none = np.zeros_like(beside)
        turn_x = along * (cos * pulses.across + sin * beside)
        turn_y = across * (cos * beside - sin * pulses.across)
        beams = BeamFrames(pulses.origin, pulses.direction, none, none, turn_x, turn_y)
        return rays_at(beams, self._rings)

    def _met(
        self, rays: tuple[np.ndarray, np.ndarray], keys: np.ndarray, at: np.ndarray
    ) -> Contacts:
        contacts = super()._met(rays, keys, at)
        for number, haze in enumerate(self._hazes):
            nearest = np.full(len(keys), self.scanner.max_range)
            np.minimum.at(nearest, contacts.ray, contacts.hits.distance)
            chance = keyed_uniform(child_keys(keys, number), "voxels")
            distance = haze.reach(*rays, -np.log(chance), nearest)
            met = np.flatnonzero(np.isfinite(distance))
            kept = contacts.select(np.flatnonzero(contacts.hits.distance <= distance[contacts.ray]))
            first = np.zeros(len(met), dtype=np.int64)
            there = np.full(len(met), haze.instance)
            hits = Hits(distance[met], there, first, -rays[1][met])
            organ = self.caster.scene.meshes[haze.instance].part[first]
            new = Contacts(met, hits, organ, np.ones(len(met)), *(one[met] for one in rays))
            contacts = Contacts.joined([kept, new])
            contacts = contacts.select(np.lexsort((contacts.hits.distance, contacts.ray)))
        return contacts
