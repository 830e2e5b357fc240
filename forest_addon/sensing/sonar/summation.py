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

from ...acoustics.modes.line_modes import LineModes
from ...acoustics.modes.mode_sum import Bins, Waves, WholeEchoes, sum_modes
from ...acoustics.nonuniform import DelayedSum, sum_delayed, summed_directly
from ...acoustics.smoothness import Smoothness, smoothness
from ...base.progress import Progress
from .bands import BandGrid
from .beam import Rows
from .leaves import LOOKED_UP
from .scatterers import ScattererPart, Strength
from .search import SearchGroup
from .station import EarGain, Station

SPLIT = 1e-12  # what parts may differ by from the whole
WIDER = 3e-3  # steps of the logarithm of bands that are wider than a sonar's: half a metre a second
PARTIAL = 0.8  # caution: parts are computed at a few frequencies


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
    highest = 2.0 * math.pi * band[1] / station.sound_speed
    error, table, size = np.zeros((3, len(station.ear)))
    for number, group in enumerate(groups):
        for ear in range(len(station.ear)):
            seen, rest = group.seen(station, ear), group
            gain = EarGain(group.paths, station, ear, group.shade)
            doubtful = seen.error(highest)
            if doubtful is not None:
                table[ear] += float((gain(np.array(band[:1]))[0] * doubtful).sum())
            each = None if weights is None else weights[number]
            if not summed_directly(len(group), grid.count, tolerance):
                by_modes = _by_modes(group, seen, station, ear, grid, tolerance, each)
                if by_modes is not None:
                    found, others = by_modes
                    spectrum[ear] += found.spectrum
                    error[ear] += found.error_bound * found.size
                    size[ear] += found.size
                    seen, rest = seen.select(others), group.select(others)
                    gain = EarGain(rest.paths, station, ear, rest.shade)
                    each = None if each is None else each[others]
            if len(rest):
                length = rest.paths.length[ear]
                whole, ends = Heard(seen, gain, station), _table_ends(grid, station)
                heard = _in_parts(whole, length, grid, ends, tolerance, each)
                spectrum[ear] += heard.spectrum
                error[ear] += heard.error_bound * heard.size
                size[ear] += heard.size
            done += len(group)
            if progress:
                progress(done, total)
    known = size > 0
    bound, looked_up = (
        float(np.divide(part, size, out=np.zeros_like(size), where=known).max(initial=0.0))
        for part in (error, table)
    )
    return EchoSum(spectrum, bound, looked_up, size)


def _by_modes(
    group: SearchGroup,
    seen: Strength,
    station: Station,
    ear: int,
    grid: BandGrid,
    tolerance: float,
    weights: np.ndarray | None,
) -> tuple[DelayedSum, np.ndarray] | None:
    """The sum over those of a group that are made of few modes, and the rows of the others; None where none
    are, too few, or a beam changes over the frequency.

    weights : (M, W) real, of echoes in W sums, which are coefficients of one (``sum_modes``).
    """
    level = group.paths.level(station, ear)
    if level is None:
        return None
    lowest, highest = (
        2.0 * math.pi * end / station.sound_speed for end in _table_ends(grid, station)
    )
    made = seen.modal(lowest, highest, tolerance, station.band_loss)
    if made is None:
        return None
    rows, owner = made.rows, made.owner
    level, length = level * group.shade, group.paths.length[ear]
    if len(rows) < len(group):
        level, length = level[rows], length[rows]
    whole, places = None, made.places
    if isinstance(made.table, LineModes) and made.loudest is not None:
        table, offset = made.table, made.offset
        whole = WholeEchoes(made.loudest, level, length / station.sound_speed, made.share)
        places = replace(places, later=offset)
        level = level[owner] * np.exp(table.middle * offset)
        length = length[owner] + offset
    if weights is not None:
        weights = weights[rows[owner]]
    found = sum_modes(
        made.table,
        places,
        Waves(level * made.factor, length / station.sound_speed, weights),
        Bins(grid.start, grid.spacing, grid.count, grid.ends, station.sound_speed),
        lambda f: station.sound_speed * station.loss(f),
        tolerance,
        whole,
    )
    return None if found is None else (found, np.delete(np.arange(len(group)), rows))


def _table_ends(grid: BandGrid, station: Station) -> tuple[float, float]:
    """Ends of a band of which modes are known, that holds that of the grid: one wider than the sonar's,
    because something moves, has one of few widths, so that not every speed has a table of its own."""
    low, high = station.sonar.band
    wider = math.log(max(low / grid.ends[0], grid.ends[1] / high))
    if wider <= 0:
        return grid.ends
    factor = math.exp(WIDER * math.ceil(wider / WIDER))
    return min(low / factor, grid.ends[0]), max(high * factor, grid.ends[1])


def _in_parts(
    heard: Heard,
    length: np.ndarray,
    grid: BandGrid,
    ends: tuple[float, float],
    tolerance: float,
    weights: np.ndarray | None,
) -> DelayedSum:
    """The sum over a group's echoes, each as smooth parts between ``ends``, Hz; length (M,) metres of the
    paths."""
    lowest, highest = (2.0 * math.pi * end / heard.speed for end in ends)
    parts = [_whole(heard.strength, len(length))]
    if not summed_directly(len(length), grid.count, tolerance):
        parts = heard.strength.parts(lowest, highest, tolerance)
    whole = len(parts) == 1 or sum(len(part.rows) for part in parts) == len(length)
    spectrum: np.ndarray | complex = 0.0
    error = size = 0.0
    for part in parts:
        alone = whole or np.count_nonzero(part.offset) == 0
        share = 1.0 if alone else _together(heard.gain, part.rows, grid.ends)
        each = None if weights is None else weights[part.rows]
        found, off = _of_part(heard, part, length[part.rows], grid, tolerance * share, each)
        spectrum = spectrum + found.spectrum
        error += off + (found.error_bound + (0.0 if alone else SPLIT)) * found.size
        size += found.size if alone else PARTIAL * found.least
    return DelayedSum(np.asarray(spectrum), size, 0.0, error / size if size > 0 else 0.0, {})


def _of_part(
    heard: Heard,
    part: ScattererPart,
    length: np.ndarray,
    grid: BandGrid,
    tolerance: float,
    weights: np.ndarray | None,
) -> tuple[DelayedSum, float]:
    """The sum over a part of a group's echoes, and what it is off by because the part is; where that would
    take more of the tolerance than is its share, the part is summed as it would be without."""
    off = 0.0
    if part.off is not None:
        lowest = np.array(grid.ends[:1])
        off = float((heard.gain(lowest, part.rows)[0] * part.off).sum())
    some = heard.part(part)
    found = sum_delayed(
        some,
        (length + part.offset) / heard.speed,
        grid.start,
        grid.spacing,
        grid.count,
        tolerance=tolerance * (1.0 - LOOKED_UP if off else 1.0),
        ends=grid.ends,
        weights=weights,
        smooth=some.smooth(grid.ends) if tolerance else None,
    )
    if off > LOOKED_UP * tolerance * found.size and part.without is not None:
        plain = replace(part, strength=part.without, off=None)
        return _of_part(heard, plain, length, grid, tolerance, weights)
    return found, off


def _together(gain: EarGain, rows: np.ndarray, band: tuple[float, float]) -> float:
    """Return what parts that are somewhere in phase have at least in common, of the largest of each."""
    first, last = (gain(np.array([end]), rows)[0].sum() for end in band)
    share = math.sqrt(band[0] / band[1]) * last / first if first > 0 else 1.0
    return PARTIAL * float(min(share, 1.0))


def _whole(strength: Strength, count: int) -> ScattererPart:
    return ScattererPart(np.arange(count), np.zeros(count), strength)


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

    def smooth(self, band: tuple[float, float]) -> Smoothness:
        """Return how smooth they are in a band."""
        losses = self.gain.losses(self._rows)
        gain = self.gain(np.array(band[:1]), self._rows)[0]
        return smoothness(self.strength.profile(), band, self.speed, gain, losses)
