"""The sum over everything that is heard, at every ear.

Y_e(f) = Σ_i A_ie(f)·e^{-i2πfτ_ie}, A = shade·gain·f with the beams and the air in the gain (``station``)
and f of the scatterer. But for its carrier an echo is smooth in the frequency, which
``acoustics/nonuniform`` makes use of; with a tolerance of 0 it adds scatterer by scatterer and bin by bin.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..acoustics.nonuniform import sum_delayed
from .bands import Band, Grid
from .search import Group
from .station import Station

Progress = Callable[[int, int], None]


def sum_echoes(
    groups: list[Group],
    station: Station,
    band: Band,
    grid: Grid,
    tolerance: float,
    progress: Progress | None = None,
) -> tuple[np.ndarray, list[np.ndarray]]:
    """(E, K) spectrum at the ears, without a window, and the mean |A| of every group's scatterers (M,)
    over the band (Hann) at the first ear.

    tolerance : largest error as a share of Σ max|A|, not below what the amplitudes themselves are known
        to (``Strength.noise``); 0: the direct sum, exact to rounding.
    progress : called as progress(scatterers done, all of them).
    """
    total, done = sum(len(group) for group in groups) * len(station.ear), 0
    spectrum = np.zeros((len(station.ear), grid.count), dtype=np.complex128)
    means = []
    for group in groups:
        for ear in range(len(station.ear)):
            heard = _Heard(group, station, ear, band, grid.count)
            found = sum_delayed(
                heard,
                group.paths.length[ear] / station.sound_speed,
                grid.start,
                grid.spacing,
                grid.count,
                tolerance=max(tolerance, heard.noise) if tolerance else 0.0,
                spread=heard.reach / station.sound_speed,
            )
            spectrum[ear] += found.spectrum
            if ear == 0:
                means.append(heard.mean)
            done += len(group)
            if progress:
                progress(done, total)
    return spectrum, means


class _Heard:
    """The amplitudes of a group at one ear; keeps their mean as they pass by."""

    def __init__(self, group: Group, station: Station, ear: int, band: Band, bins: int) -> None:
        self._group, self._station, self._ear = group, station, ear
        self._band, self._bins = band, bins
        self._strength = group.seen(station, ear)
        self.reach, self.noise = self._strength.reach(), self._strength.noise
        self.mean = np.zeros(len(group))

    def __call__(self, frequency: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """(Q, m) complex A of some rows at frequencies (Q,)."""
        wavenumber = 2.0 * math.pi * frequency / self._station.sound_speed
        amplitude = self._strength.select(rows).amplitude(wavenumber)
        paths = self._group.paths.select(rows)
        amplitude *= paths.gain(self._station, self._ear, frequency) * self._group.shade[rows]
        if self._ear == 0:
            weight = self._band.mean_weights(frequency, even=len(frequency) == self._bins)
            self.mean[rows] = weight @ np.abs(amplitude)
        return amplitude
