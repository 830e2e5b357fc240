"""Trunks and frequencies that nothing of a record would miss: what far ones lose on their way.

Paths go in; whether a group of them is heard in a band of frequencies comes out. It is not if at every
frequency of the band its energy, estimated from above, lies below UNHEARD of a tolerance times

- the energy of all trunks at that frequency, estimated from below, and
- the energy that the same lengths of path have at the frequency where they are loudest,

so that neither an octave nor a part of the record changes by more than that. Energies are those of trunks
that stand at random, w²·a·min(ka, 1)³·e^{-2b(f)x}; the ground, which may cancel any of them, and turns are
left to the margin.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ....base.rows import distinct
from .scattering import TrunkPaths

UNHEARD, MOST_UNHEARD = (
    1e-2,
    1e-6,
)  # of the tolerance, and of the sound: 40 dB are left for the ground
BINS = 64  # of path length
USUAL = np.array([125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0])  # Hz at which lengths are loud
TRIED = 3  # frequencies of a band


class Audibility:
    """Of the paths of a record. loss : (F,) nepers of amplitude per metre at frequencies (F,)."""

    def __init__(
        self,
        paths: TrunkPaths,
        loss: Callable[[np.ndarray], np.ndarray],
        speed: float,
        tolerance: float,
    ) -> None:
        self.loss, self.speed = loss, speed
        self.share = min(UNHEARD * tolerance, MOST_UNHEARD) ** 2
        low = max(float(paths.length.min(initial=1.0)), 1e-3)
        high = max(float(paths.length.max(initial=1.0)), low) * 1.001
        self.edges = np.geomspace(low, high, BINS + 1)
        self.whole = self.energy_of(paths)

    def heard(self, some: dict[int, np.ndarray], first: float, last: float) -> bool:
        """Return whether paths are heard between two frequencies in Hz, by their energies."""
        frequency = np.linspace(first, last, TRIED)
        most = self._at(some, frequency, self.edges[:-1], 2.0)  # (F, BINS)
        least = self._at(self.whole, frequency, self.edges[1:], 1.0).sum(axis=1)
        if (most.sum(axis=1) > self.share * least).any():
            return True
        loudest = self._at(some, USUAL, self.edges[1:], 1.0) * USUAL[:, None]
        within = most * frequency[:, None] > self.share * loudest.max(axis=0)
        return bool(within.any())

    def energy_of(self, paths: TrunkPaths) -> dict[int, np.ndarray]:
        """{octave of the radius: (BINS,) w²·a by path length}."""
        wide = paths.radius > 0
        octave = np.floor(np.log2(np.where(wide, paths.radius, 1.0))).astype(np.int64)
        strength = np.where(wide, np.square(paths.weight) * paths.radius, 0.0)
        column = np.searchsorted(self.edges, paths.length, side="right") - 1
        column = np.clip(column, 0, BINS - 1)
        found = {}
        for number in distinct(octave[wide]).tolist():
            rows = octave == number
            found[number] = np.bincount(column[rows], strength[rows], BINS)
        return found

    def _at(
        self, energy: dict[int, np.ndarray], frequency: np.ndarray, length: np.ndarray, upper: float
    ) -> np.ndarray:
        """(F, BINS); upper : 2 for the thick end of an octave of radii, 1 for the thin one."""
        found = np.zeros((len(frequency), BINS))
        wavenumber = 2.0 * math.pi / self.speed * frequency
        for number, row in energy.items():
            size = np.minimum(wavenumber * (upper * 2.0**number), 1.0) ** 3
            found += size[:, None] * row
        return found * np.exp(-2.0 * np.outer(self.loss(frequency), length))
