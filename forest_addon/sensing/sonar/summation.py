"""The sum over everything that is heard, at every ear.

Y_e(f) = Σ_i A_ie(f)·e^{-i2πfτ_ie}, A = shade·gain·f with the beams and the air in the gain (``station``)
and f of the scatterer. But for its carrier an echo is smooth in the frequency, which
``acoustics/nonuniform`` makes use of; with a tolerance of 0 it adds scatterer by scatterer and bin by bin.
A scatterer may come in parts that are smoother than the whole, each with a delay of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...acoustics.nonuniform import sum_delayed
from ...base.progress import Progress
from .bands import BandGrid
from .beam import Rows
from .scatterers import ScattererPart, Strength
from .search import SearchGroup
from .station import EarGain, Station


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
    found = [_over(groups, station, part, tolerance, progress, weights) for part in some]
    if len(found) == 1:
        return found[0]
    size = np.max([part.size for part in found], axis=0)
    shares = [np.divide(part.size, size, out=np.zeros_like(size), where=size > 0) for part in found]
    return EchoSum(
        np.concatenate([part.spectrum for part in found], axis=-1),
        max(p.error_bound * float(s.max()) for p, s in zip(found, shares, strict=True)),
        max(part.table_error for part in found),
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
            seen = group.seen(station, ear)
            gain = EarGain(group.paths, station, ear, group.shade)
            doubtful = seen.error(highest)
            if doubtful is not None:
                table[ear] += float((gain(np.array(band[:1]))[0] * doubtful).sum())
            heard, length = Heard(seen, gain, station), group.paths.length[:, ear]
            loud = group.bound * group.shade
            parts = [ScattererPart(np.arange(len(group)), np.zeros(len(group)), seen)]
            if tolerance > 0 and lowest < highest:
                parts = seen.parts(lowest, highest)
            for part in parts:
                some = heard.part(part)
                found = sum_delayed(
                    some,
                    (length[part.rows] + part.offset) / station.sound_speed,
                    grid.start,
                    grid.spacing,
                    grid.count,
                    tolerance=tolerance,
                    reach=some.reach(band),
                    loudness=loud[part.rows],
                    weights=None if weights is None else weights[number][part.rows],
                    ends=band,
                )
                spectrum[ear] += found.spectrum
                error[ear] += found.error * found.size
                size[ear] += found.size
            done += len(group)
            if progress:
                progress(done, total)
    known = size > 0
    bound, looked_up = (
        float(np.divide(part, size, out=np.zeros_like(size), where=known).max(initial=0.0))
        for part in (error, table)
    )
    return EchoSum(spectrum, bound, looked_up, size)


class Heard:
    """Amplitudes at one ear of echoes, or of a part of them: rows of ``gain``, all where left out."""

    def __init__(
        self, strength: Strength, gain: EarGain, station: Station, rows: Rows = slice(None)
    ) -> None:
        self.strength, self.gain, self.speed = strength, gain, station.sound_speed
        self._station, self._rows = station, rows

    def part(self, part: ScattererPart) -> Heard:
        """A part of all."""
        return Heard(part.strength, self.gain, self._station, part.rows)

    def __call__(self, frequency: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """(Q, m) complex A of some rows at frequencies (Q,)."""
        wavenumber = 2.0 * math.pi * frequency / self.speed
        amplitude = self.strength.select(rows).amplitude(wavenumber)
        mine = rows if isinstance(self._rows, slice) else self._rows[rows]
        amplitude *= self.gain(frequency, mine, single=amplitude.dtype == np.complex64)
        return amplitude

    def reach(self, band: tuple[float, float]) -> np.ndarray:
        """(M,) s, about how far responses reach, with what their gains change over a band."""
        low, high = (self.gain(np.array([end]), self._rows)[0] for end in band)
        changed = np.abs(np.log(np.maximum(low, 1e-300) / np.maximum(high, 1e-300)))
        width = max(band[1] - band[0], 1e-9)
        wavenumber = 2.0 * math.pi * band[0] / self.speed
        return self.strength.reach(wavenumber) / self.speed + changed / (2.0 * math.pi * width)
