"""The sum over everything that is heard, at every ear.

Y_e(f) = Σ_i A_ie(f)·e^{-i2πfτ_ie}, A = shade·gain·f with the beams and the air in the gain (``station``)
and f of the scatterer. But for its carrier an echo is smooth in the frequency, which
``acoustics/nonuniform`` makes use of; with a tolerance of 0 it adds scatterer by scatterer and bin by bin.
A scatterer may come in parts that are smoother than the whole, each with a delay of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from ...acoustics.nonuniform import sum_delayed
from ...base.progress import Progress
from .bands import BandGrid
from .search import EarAmplitudes, SearchGroup
from .station import Station


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
            heard, length = EarAmplitudes(group, station, ear), group.paths.length[:, ear]
            doubtful = heard.whole.strength.error(highest)
            if doubtful is not None:
                table[ear] += float((heard.gain(np.array(band[:1]))[0] * doubtful).sum())
            loud, parts = group.bound * group.shade, [heard.whole]
            if tolerance > 0 and lowest < highest:
                parts = heard.whole.strength.parts(lowest, highest)
            for part in parts:
                found = sum_delayed(
                    partial(heard.of, part),
                    (length[part.rows] + part.offset) / station.sound_speed,
                    grid.start,
                    grid.spacing,
                    grid.count,
                    tolerance=tolerance,
                    reach=heard.reach(part, band),
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
