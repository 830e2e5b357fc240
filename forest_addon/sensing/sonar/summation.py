"""The sum over everything that is heard, at every ear.

Y_e(f) = Σ_i A_ie(f)·e^{-i2πfτ_ie}, A = shade·gain·f with the beams and the air in the gain (``station``)
and f of the scatterer. But for its carrier an echo is smooth in the frequency, which
``acoustics/nonuniform`` makes use of; with a tolerance of 0 it adds scatterer by scatterer and bin by bin.
A scatterer may come in parts that are smoother than the whole, each with a delay of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ...acoustics.nonuniform import sum_delayed
from .bands import Grid
from .scatterers import Part, Strength
from .search import Group
from .station import Station

Progress = Callable[[int, int], None]


def sum_echoes(
    groups: list[Group],
    station: Station,
    grid: Grid,
    tolerance: float,
    progress: Progress | None = None,
    weights: list[np.ndarray] | None = None,
) -> np.ndarray:
    """(E, K) spectrum at the ears, without a window; with weights (E, W, K).

    tolerance : largest error as a share of Σ max|A|, not below what the amplitudes themselves are known
        to (``Strength.noise``); 0: the direct sum, exact to rounding.
    progress : called as progress(scatterers done, all of them).
    weights : (M, W) for each group, of its scatterers in W sums.
    """
    total, done = sum(len(group) for group in groups) * len(station.ear), 0
    sums = () if weights is None else (weights[0].shape[1],)
    spectrum = np.zeros((len(station.ear), *sums, grid.count), dtype=np.complex128)
    lowest = 2.0 * math.pi * grid.start / station.sound_speed
    for number, group in enumerate(groups):
        for ear in range(len(station.ear)):
            seen = group.seen(station, ear)
            for part in seen.parts(lowest) if tolerance else [_whole(seen, len(group))]:
                some = group if len(part.rows) == len(group) else group.select(part.rows)
                spectrum[ear] += sum_delayed(
                    _Heard(some, part.strength, station, ear),
                    (some.paths.length[ear] + part.offset) / station.sound_speed,
                    grid.start,
                    grid.spacing,
                    grid.count,
                    tolerance=max(tolerance, part.strength.noise) if tolerance else 0.0,
                    spread=part.strength.reach() / station.sound_speed,
                    weights=None if weights is None else weights[number][part.rows],
                ).spectrum
            done += len(group)
            if progress:
                progress(done, total)
    return spectrum


def _whole(strength: Strength, count: int) -> Part:
    return Part(np.arange(count), np.zeros(count), strength)


class _Heard:
    """The amplitudes of a group at one ear."""

    def __init__(self, group: Group, strength: Strength, station: Station, ear: int) -> None:
        self._group, self._strength = group, strength
        self._station, self._ear = station, ear

    def __call__(self, frequency: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """(Q, m) complex A of some rows at frequencies (Q,)."""
        wavenumber = 2.0 * math.pi * frequency / self._station.sound_speed
        amplitude = self._strength.select(rows).amplitude(wavenumber)
        gain = self._group.paths.select(rows).gain(self._station, self._ear, frequency)
        gain *= self._group.shade[rows]
        amplitude *= gain
        return amplitude
