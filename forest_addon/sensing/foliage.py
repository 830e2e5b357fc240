"""The sum over leaves: who is in it, what each adds, and what the others could add at most.

``audible`` turns leaf discs into scatterers, loudest first, each with a bound on its amplitude over the
whole band. ``sum_echoes`` is the direct sum over scatterers and frequencies in float64, in blocks that
fit the cache: Y(f) = Σ A_i(f)·e^{-i2kr_i}, A = gain·f_i·e^{-2br}. Everything is exact to rounding; on an
even grid of frequencies the carriers are products of short tables.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from ..acoustics.air import absorption
from ..acoustics.disc import amplitude_bound, backscatter_amplitude
from ..acoustics.spectrum import delay_factors
from ..spec import Air, Sonar
from .beam import beam_gain
from .discs import LeafDiscs

Progress = Callable[[int, int], None]
LEAVES_AT_ONCE = 64
BINS_AT_ONCE = 2048


@dataclass(frozen=True)
class Grid:
    """``count`` frequencies from ``start`` Hz, ``spacing`` Hz apart, in air.

    wavenumber : (K,) 1/m. loss : (K,) absorption, nepers per metre.
    """

    start: float
    spacing: float
    count: int
    sound_speed: float
    wavenumber: np.ndarray
    loss: np.ndarray

    @classmethod
    def of(cls, start: float, spacing: float, count: int, sonar: Sonar, air: Air) -> Grid:
        """A grid in the air that a sonar works in."""
        frequency = start + spacing * np.arange(count)
        loss = np.zeros(count)
        if sonar.absorption:
            loss = absorption(frequency, air.temperature_c, air.humidity, air.pressure_kpa)
        speed = air.speed()
        return cls(start, spacing, count, speed, 2.0 * math.pi * frequency / speed, loss)

    @property
    def frequency(self) -> np.ndarray:
        """(K,) Hz."""
        return self.start + self.spacing * np.arange(self.count)

    def part(self, first: int, last: int) -> Grid:
        """The frequencies number ``first`` to ``last - 1``."""
        return Grid(
            self.start + first * self.spacing,
            self.spacing,
            last - first,
            self.sound_speed,
            self.wavenumber[first:last],
            self.loss[first:last],
        )


@dataclass(frozen=True)
class Scatterers:
    """M leaves as one sonar meets them.

    row : (M,) int64, number in the discs. direction : (M, 3) unit, from the sonar.
    distance, radius : (M,) metres. incidence : (M,) radians between ray and normal, 0 to π/2.
    gain : (M,) 1/m², beam out and back over r². bound : (M,) no |A| in the band is larger.
    """

    row: np.ndarray
    direction: np.ndarray
    distance: np.ndarray
    incidence: np.ndarray
    radius: np.ndarray
    gain: np.ndarray
    bound: np.ndarray

    def __len__(self) -> int:
        return len(self.row)

    def select(self, rows: slice | np.ndarray) -> Scatterers:
        """Some of them."""
        return Scatterers(*(getattr(self, field.name)[rows] for field in fields(self)))


def audible(discs: LeafDiscs, rows: np.ndarray, sonar: Sonar, band: Grid) -> Scatterers:
    """The discs ``rows`` (M,) as scatterers, loudest bound first.

    band : its first and last frequency are the ends of the band.

    The bound takes each factor of A at its largest in the band: ``disc.amplitude_bound``, and the
    absorption, which grows with frequency, at the lowest.
    """
    offset = discs.centre[rows] - np.asarray(sonar.position)
    distance = np.linalg.norm(offset, axis=1)
    direction = offset / distance[:, None]
    facing = np.abs(np.einsum("mi,mi->m", direction, discs.normal[rows]))
    grazing = np.linalg.norm(np.cross(direction, discs.normal[rows]), axis=1)
    incidence = np.arctan2(grazing, facing)  # keeps its digits face-on and edge-on
    beam = beam_gain(
        direction,
        math.radians(sonar.azimuth_deg),
        math.radians(sonar.elevation_deg),
        (math.radians(sonar.beam_width_deg[0]), math.radians(sonar.beam_width_deg[1])),
    )
    gain = (beam / distance) ** 2
    lowest, highest = float(band.wavenumber[0]), float(band.wavenumber[-1])
    bound = gain * np.exp(-2.0 * band.loss[0] * distance)
    bound *= amplitude_bound(lowest, highest, discs.radius[rows], incidence, sonar.leaf_model)
    loudest = np.argsort(-bound, kind="stable")
    every = Scatterers(rows, direction, distance, incidence, discs.radius[rows], gain, bound)
    return every.select(loudest)


def amplitudes(leaves: Scatterers, grid: Grid, model: str) -> np.ndarray:
    """(K, M) complex A of every leaf at every frequency, without the carrier."""
    k = grid.wavenumber[:, None]
    amplitude = backscatter_amplitude(k * leaves.radius, leaves.incidence, model)
    amplitude *= np.exp(np.outer(-2.0 * grid.loss, leaves.distance)) * (leaves.gain / k)
    return amplitude


def sum_echoes(
    leaves: Scatterers,
    grid: Grid,
    model: str,
    weight: np.ndarray,
    progress: Progress | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Spectrum (K,) complex, Σ|A| (K,), and each leaf's mean |A| (M,) over the grid.

    weight : (K,) of the frequencies in that mean.
    progress : called as progress(leaves done, all leaves).
    """
    spectrum, whole = np.zeros(grid.count, dtype=np.complex128), np.zeros(grid.count)
    mean = np.zeros(len(leaves))
    for first in range(0, len(leaves), LEAVES_AT_ONCE):
        some = slice(first, first + LEAVES_AT_ONCE)
        group = leaves.select(some)
        delay = 2.0 * group.distance / grid.sound_speed
        for low in range(0, grid.count, BINS_AT_ONCE):
            bins = slice(low, min(low + BINS_AT_ONCE, grid.count))
            part = grid.part(bins.start, bins.stop)
            amplitude = amplitudes(group, part, model)
            size = np.abs(amplitude)
            whole[bins] += size.sum(axis=1)
            mean[some] += weight[bins] @ size
            carrier = delay_factors(part.start, part.spacing, part.count, delay)
            spectrum[bins] += np.einsum("km,km->k", amplitude, carrier)
        if progress:
            progress(min(first + LEAVES_AT_ONCE, len(leaves)), len(leaves))
    return spectrum, whole, mean / weight.sum()
