"""Echoes held against the exact sum: random bins of random pings, scatterer by scatterer, and random samples.

The sum at a bin is made again with a tolerance of 0, over everything in range, also what was culled as too
weak, where that fits the time; else over what was heard, and the audit says so. Errors are shares of
Σ max|A|, in which tolerance and cull are asked for. Responses, envelopes and waveforms are held against their
spectra, by the Fourier sum at single samples; the spectrum of a call's echo is held against that of the
transfer function, or, of a sonar or scene that moves, against the sum over every path at its own speed, piece
by piece of a call that is cut; of calls in more than ``PIECES`` pieces it is not looked at.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...acoustics import chebyshev
from ...spec import Air, Sonar
from ..audit import LEAST, Audit, Check, joined, sample
from ..rays.caster import RayCaster
from .calls import Band, BandGrid, Call
from .ping import Echo, PingHearing, heard_from
from .search import SearchGroup
from .station import Equipment, Station
from .summation import Moment, factors, fastest, pieces_of, sum_echoes
from .targets import EchoTargets
from .windy import at_moment

MOST = 300_000  # scatterers in range that are all summed
BINS = (4, 32)  # of a ping at a time; of one whose scatterers have to be looked for
SAMPLES = 16  # of a ping at a time
CAUTION = 3.0  # of an estimate
ROUNDING = 1e-12  # besides that of phases
OF_SAMPLES = 1e-9  # of the largest
PIECES = 9  # of a call, which are heard anew
PLACES = 48  # Chebyshev points of a call's spectrum over the speeds of all paths
PARTS = (0.5, 0.3, 0.2)  # of the time, for bins, bins of moving calls, samples


@dataclass(frozen=True)
class _Pings:
    """Pings as sent and heard, and a way to look again."""

    echoes: Sequence[Echo]
    sonar: Sonar
    air: Air
    equipment: Equipment
    targets: EchoTargets
    wood: RayCaster | None
    everything: RayCaster | None

    def moments(self, echo: Echo) -> list[Moment]:
        """Return what the pieces of a call met."""
        station = Station(self.sonar, self.air, echo.pose, self.equipment)
        if echo.moments == 1:
            return [Moment(0.0, station, echo.groups)]
        call = self.equipment.call
        assert call is not None
        band = Band(*self.sonar.band)
        hear = PingHearing(self.targets, station, band, self.wood, self.everything)
        return [hear.moment(t) for t in np.linspace(0.0, call.duration, echo.moments).tolist()]

    def station(self, echo: Echo) -> Station:
        return Station(replace(self.sonar, cull=0.0), self.air, echo.pose, self.equipment)

    def moving(self, echo: Echo) -> bool:
        call = self.equipment.call
        return bool(call and self.sonar.doppler and fastest(echo.groups, echo.pose) > 0)

    @property
    def bins(self) -> int:
        return sum(echo.spectra.size for echo in self.echoes)


def audit_echoes(
    echoes: Sequence[Echo],
    targets: EchoTargets,
    sonar: Sonar,
    air: Air,
    wood: RayCaster | None,
    everything: RayCaster | None,
    equipment: Equipment,
    rng: np.random.Generator,
    seconds: float,
    share: float,
) -> Audit:
    """Of pings that took ``seconds`` together, at a cost of about ``share`` of that.

    wood, everything : casters as of ``ping``.
    """
    pings = _Pings(echoes, sonar, air, equipment, targets, wood, everything)
    band = Band(*sonar.band)
    culled = sonar.cull > 0 and _affordable(echoes, share)

    def batches() -> Iterator[np.ndarray]:
        while True:
            echo = echoes[int(rng.integers(len(echoes)))]
            station, groups = pings.station(echo), echo.groups
            if culled:
                casters = (at_moment(rays, echo.pose.time) for rays in (wood, everything))
                groups = heard_from(station, targets.at(echo.pose.time), band, *casters).groups
            count = min(BINS[culled], len(echo.frequency))
            stride = int(rng.integers(1, max(len(echo.frequency) // count, 1) + 1))
            first = int(rng.integers(0, len(echo.frequency) - (count - 1) * stride))
            rows = first + stride * np.arange(count)
            yield _bin_errors(echo, rows, groups, station)

    found = sample(batches(), PARTS[0] * share * seconds, LEAST)
    which = "everything heard" if sonar.cull > 0 and not culled else "everything in range"
    # A tolerance may be finer than tables are smooth; then an echo says what it is off by.
    promised = sonar.tolerance
    if promised > 0:
        promised = max(promised, CAUTION * max(echo.error_bound for echo in echoes))
    allowed = promised + (sonar.cull if culled else 0.0) + ROUNDING + _of_phases(echoes)
    what = f"bins of the spectrum by the direct sum over {which}"
    checks = (
        Check.on(what, found.errors, pings.bins, allowed, "of all amplitudes"),
        _called(pings, rng, PARTS[1] * share * seconds),
        _samples(pings, rng, PARTS[2] * share * seconds),
    )
    return Audit(joined(checks), seconds, found.seconds_each * pings.bins)


def _of_phases(echoes: Sequence[Echo]) -> float:
    """Radians by which two float64 sums may turn the same echo apart: half a digit of each one's cycles."""
    cycles = 0.0
    for echo in echoes:
        path = max((float(g.paths.length.max()) for g in echo.groups if len(g)), default=0.0)
        cycles = max(cycles, float(echo.frequency.max()) * path / echo.sound_speed)
    return 2 * math.pi * cycles * float(np.finfo(np.float64).eps)


def _affordable(echoes: Sequence[Echo], share: float) -> bool:
    """Return whether looking for all that one ping could hear fits into a share of the time of all pings."""
    first = echoes[0]
    in_range = first.leaves + first.others - first.far
    heard = sum(len(group) for group in first.groups)
    return in_range <= MOST and in_range <= share * len(echoes) * max(heard, 1)


def _bin_errors(
    echo: Echo, rows: np.ndarray, groups: list[SearchGroup], station: Station
) -> np.ndarray:
    """(E·R,) errors of bins that are evenly apart, at the ears, as shares of Σ max|A|."""
    exact = sum_echoes(groups, station, _bins(echo, rows), 0.0).spectrum
    return _shares(echo.spectra[:, rows] - exact, echo).ravel()


def _called(pings: _Pings, rng: np.random.Generator, seconds: float) -> Check | None:
    """Bins of the spectra of a call's echoes; None where there is no call."""
    call = pings.equipment.call
    if call is None:
        return None
    loudest = float(np.abs(call.spectrum(pings.echoes[0].frequency)).max(initial=0.0))
    among = [echo for echo in pings.echoes if echo.moments <= PIECES]
    if not among:
        return None
    known: dict[int, list[Moment]] = {}  # of one ping at a time

    def batches() -> Iterator[np.ndarray]:
        while True:
            number = int(rng.integers(len(among)))
            echo = among[number]
            if pings.moving(echo) or echo.moments > 1:
                row = int(rng.integers(len(echo.frequency)))
                if number not in known:
                    known.clear()
                    known[number] = pings.moments(echo)
                exact = _played(echo, row, call, known[number])
                yield _shares(echo.called[:, row] - exact, echo) / loudest
            else:
                rows = rng.integers(0, len(echo.frequency), SAMPLES)
                sent = _spectrum(call, echo.frequency[rows])
                exact = echo.spectra[:, rows] * sent
                yield (_shares(echo.called[:, rows] - exact, echo) / loudest).ravel()

    found = sample(batches(), seconds, LEAST)
    allowed = pings.sonar.tolerance + 1e-9
    what = "bins of the call's echo, path by path"
    return Check.on(what, found.errors, pings.bins, allowed, "of all amplitudes")


def _samples(pings: _Pings, rng: np.random.Generator, seconds: float) -> Check:
    """Samples of responses, envelopes and waveforms by the Fourier sums of their spectra."""
    call, band = pings.equipment.call, Band(*pings.sonar.band)

    def batches() -> Iterator[np.ndarray]:
        while True:
            echo = pings.echoes[int(rng.integers(len(pings.echoes)))]
            rows = rng.integers(0, len(echo.time), SAMPLES)
            window = band.window(echo.frequency)
            analytic = _fourier(echo, echo.spectra * window, rows) / window.sum()
            exact = [analytic.real, np.abs(analytic)]
            made = [echo.responses, echo.envelopes]
            if call is None:
                exact.append(analytic.real)
            else:
                exact.append(_fourier(echo, echo.called, rows).real * 2.0 / _length(echo))
            for true, whole in zip(exact, [*made, echo.waveforms], strict=True):
                size = max(float(np.abs(whole).max(initial=0.0)), 1e-300)
                yield (np.abs(whole[:, rows] - true) / size).ravel()

    whole = sum(3 * echo.responses.size for echo in pings.echoes)
    found = sample(batches(), seconds, 3 * LEAST)
    what = "samples of responses, envelopes and waveforms by their spectra"
    return Check.on(what, found.errors, whole, OF_SAMPLES, "of the largest")


def _length(echo: Echo) -> int:
    """Samples of the transform that made a record; 1 of a tone."""
    if len(echo.frequency) == 1:
        return 1
    return round(echo.sample_rate / float(np.diff(echo.frequency).mean()))


def _fourier(echo: Echo, spectra: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(E, R) Σ_k S_k·e^{i2πf_k t} at some samples."""
    turns = np.outer(echo.frequency, rows / echo.sample_rate)
    summed: np.ndarray = spectra @ np.exp(2j * math.pi * np.remainder(turns, 1.0))
    return summed


def _spectrum(call: Call, frequency: np.ndarray) -> np.ndarray:
    """(K,) the call's spectrum, sample by sample."""
    turns = np.outer(frequency, np.arange(len(call.samples)) / call.sample_rate)
    summed: np.ndarray = np.exp(-2j * math.pi * np.remainder(turns, 1.0)) @ call.samples
    return summed


def _played(echo: Echo, row: int, call: Call, moments: list[Moment]) -> np.ndarray:
    """(E,) the echo of a call at one frequency: every path of every piece of the call at its own speed."""
    frequency = float(echo.frequency[row])
    total = np.zeros(len(moments[0].station.ear), dtype=np.complex128)
    cut = pieces_of(call, len(moments)) if len(moments) > 1 else [(call, 0.0)]
    for moment, (piece, lead) in zip(moments, cut, strict=True):
        turn = np.exp(-2j * math.pi * frequency * moment.time)
        total += turn * _piece(echo, row, piece, lead, moment)
    return total


def _piece(echo: Echo, row: int, call: Call, lead: float, moment: Moment) -> np.ndarray:
    """(E,) the echo of a piece of a call, whose own time is ``lead`` s after it begins."""
    one, frequency = _bins(echo, np.array([row])), float(echo.frequency[row])
    station = moment.station
    total = np.zeros(len(station.ear), dtype=np.complex128)
    for group in moment.groups:
        alpha = factors(group, station, 0)
        low, high = float(alpha.min()), float(alpha.max())
        middle, half = (low + high) / 2, max((high - low) / 2, 1e-15)
        at = middle + half * chebyshev.points(PLACES)
        weight = chebyshev.lagrange(PLACES, (alpha - middle) / half).T @ (
            _spectrum(call, frequency / at) / at * np.exp(2j * math.pi * frequency * lead / at)
        )
        parts = np.stack([weight.real, weight.imag], axis=1)
        summed = sum_echoes([group], station, one, 0.0, weights=[parts]).spectrum[:, :, 0]
        total += summed[:, 0] + 1j * summed[:, 1]
    return total


def _bins(echo: Echo, rows: np.ndarray) -> BandGrid:
    """The grid of some of the bins, evenly apart."""
    frequency = echo.frequency[rows]
    spacing = echo.sample_rate
    if len(rows) > 1:
        spacing = float(frequency[-1] - frequency[0]) / (len(rows) - 1)
    ends = float(frequency[0]), float(frequency[-1])
    return BandGrid(ends[0], spacing, len(rows), 1, 1, ends)


def _shares(apart: np.ndarray, echo: Echo) -> np.ndarray:
    """Of differences (E,) or (E, K): shares of Σ max|A| at each ear."""
    size = np.where(echo.size > 0, echo.size, 1.0)
    share: np.ndarray = np.abs(apart) / (size if apart.ndim == 1 else size[:, None])
    return share
