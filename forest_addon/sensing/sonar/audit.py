"""Parts of an echo that an audit looks at, and how each value is computed again.

Combs of bins of a spectrum, evenly apart over the band, are summed with a tolerance of 0 over all that is in
range, also what was culled, where there is little of it; else over what was heard, and the audit says so.
Errors are shares of Σ max|A|, in which tolerance and cull are asked for, and that sum is held against the
comb's. Responses, envelopes and waveforms are derived from the spectra, whole; the spectrum of a call's echo
from that of the transfer function, or, of a sonar or scene that moves, summed over every path at its own
speed, piece by piece of a call that is cut; of calls in more than ``PIECES`` pieces it is not looked at.
What a receiver made of the waveforms is made again, with the same noise. Times, frequencies, counts and
poses are computed again; what is heard is searched for and listed again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...acoustics import chebyshev
from ...spec import Air, Sonar
from ..audit import LEAST, AuditPart, figure_error, figures, shares
from ..rays.caster import RayCaster
from .calls import Band, BandGrid, Call, grid_of
from .echo import Echo
from .ping import PingHearing, contributions, heard_from
from .receiver import receive
from .search import Found
from .station import Ears, Equipment, SonarPose, Station
from .summation import Moment, factors, fastest, pieces_of, sum_echoes, widened
from .targets import EchoTargets
from .windy import at_moment

MOST = 300_000  # scatterers in range that are all summed
SEARCHED = 20_000  # that are searched again, of however few pings
SUMMED = 3_000_000  # scatterers by bins by ears of a ping that is summed again as it was
COMB = 17  # bins
WORK = 1_000_000  # scatterers by bins by ears that are summed
COMBS = 4  # at most, of few pings
CAUTION = 3.0  # of an estimate
SIZES = 0.5  # by which Σ max|A| may be above that of a comb, between whose bins it may be larger
SHORT = 0.1  # by which it may be below it, as it is estimated
ROUNDING = 1e-12  # besides that of phases
OF_SAMPLES = 1e-9  # of the largest
PIECES = 9  # of a call, which are heard anew
PLACES = 48  # Chebyshev points of a call's spectrum over the speeds of all paths
PATHS = 20  # times as much as a scatterer of a comb takes a path at its own speed


@dataclass(frozen=True)
class Pings:
    """Pings as sent and heard, and a way to look again; wood, everything, seed : as of ``ping``."""

    echoes: Sequence[Echo]
    poses: Sequence[SonarPose]
    targets: EchoTargets
    sonar: Sonar
    air: Air
    wood: RayCaster | None
    everything: RayCaster | None
    equipment: Equipment
    seed: int = 0

    @cached_property
    def band(self) -> Band:
        """The band that is listened to."""
        return Band(*self.sonar.band)

    def station(self, echo: Echo, **changes: float) -> Station:
        """Station of a ping, with some settings changed."""
        return Station(replace(self.sonar, **changes), self.air, echo.pose, self.equipment)

    def search(self, station: Station, echo: Echo) -> Found:
        """Scatterers that are heard from a station, found again."""
        time = echo.pose.time
        casters = (at_moment(rays, time) for rays in (self.wood, self.everything))
        return heard_from(station, self.targets.at(time), self.band, *casters)

    def moments(self, echo: Echo) -> list[Moment]:
        """Moments of the scene that the pieces of a call met."""
        station, call = self.station(echo), self.equipment.call
        if echo.moments == 1 or call is None:
            return [Moment(0.0, station, echo.groups)]
        hear = PingHearing(self.targets, station, self.band, self.wood, self.everything)
        return [hear.moment(t) for t in np.linspace(0.0, call.duration, echo.moments).tolist()]

    def moving(self, echo: Echo) -> float:
        """Speed for which a ping's band is wider, m/s."""
        if self.equipment.call is None or not self.sonar.doppler:
            return 0.0
        return max(fastest(moment.groups, echo.pose) for moment in self.moments(echo))


def parts_of_echoes(pings: Pings, share: float) -> list[AuditPart]:
    """Parts of pings, ``share`` of which are searched again."""
    echoes, sonar, call = pings.echoes, pings.sonar, pings.equipment.call
    count = len(echoes)
    first = max(echoes, key=lambda echo: echo.leaves + echo.others - echo.far)
    in_range = first.leaves + first.others - first.far
    heard = sum(len(group) for group in first.groups)
    culled = sonar.cull > 0 and in_range <= min(MOST, share * count * max(heard, 1))
    strides = [max(len(echo.frequency) // COMB, 1) for echo in echoes]
    work = max((in_range if culled else heard) * COMB * len(first.spectra), 1)
    combs = int(np.clip(WORK // work, 1, max(COMBS, share * count)))
    which = "everything heard" if sonar.cull > 0 and not culled else "everything in range"
    # A tolerance may be finer than tables are smooth; then an echo says what it is off by.
    promised, told = sonar.tolerance, max(echo.error_bound for echo in echoes)
    if 0 < promised < told:
        promised = CAUTION * told
    allowed = promised + (sonar.cull if culled else 0.0) + ROUNDING + _of_phases(echoes)
    what = (
        f"{'comb' if combs == 1 else 'combs'} of {COMB} bins of the spectrum by the direct sum "
        f"over {which}"
    )
    part = _Rows(echoes, strides)
    made = [figures(vars(echo), _figures(pings, echo)) for echo in echoes if echo.moments <= PIECES]
    made += [
        figures(vars(echo.pose), vars(pose)) for echo, pose in zip(echoes, pings.poses, strict=True)
    ]
    made += [
        AuditPart(
            part.count,
            part.look(lambda echo, rows: _combs(pings, echo, rows, culled)),
            ((what, allowed, "of all amplitudes"), ("sizes near those of combs", 0.0, "")),
            combs,
            exact=True,
        ),
        AuditPart(
            count,
            lambda number: np.array([_derived(pings, echoes[n]) for n in number.tolist()]),
            (
                (
                    "responses, envelopes and waveforms by their spectra",
                    OF_SAMPLES,
                    "of the largest",
                ),
            ),
        ),
    ]
    if pings.equipment.receiver is not None:
        what = "receptions, received again from the waveforms"
        made.append(
            AuditPart(
                count,
                lambda number: np.array([_received(pings, n) for n in number.tolist()]),
                ((what, OF_SAMPLES, "of each"),),
            )
        )
    again = max(1, int(share * count))
    if again > 1 or in_range <= SEARCHED:
        kind = "pings searched and listed again", OF_SAMPLES, "of each"
        made.append(
            AuditPart(
                count,
                lambda number: np.array([_searched(pings, echoes[n]) for n in number.tolist()]),
                (kind,),
                again,
            )
        )
    among = [echo for echo in echoes if echo.moments <= PIECES]
    if call is not None and among:
        still = not any(pings.moving(echo) for echo in among)
        bins = _Rows(among, [len(echo.frequency) for echo in among])
        kind = "bins of the call's echo, path by path", sonar.tolerance + 1e-9, "of all amplitudes"
        few = int(np.clip(WORK // (PATHS * work // COMB + 1), 2, LEAST))
        look = bins.look(lambda echo, rows: _called(pings, echo, rows))
        made.append(AuditPart(bins.count, look, (kind,), None if still else few))
    return made


class _Rows:
    """Rows of several pings, numbered one ping after the other."""

    def __init__(self, echoes: Sequence[Echo], counts: Sequence[int]) -> None:
        self._echoes, self._ends = echoes, np.cumsum(counts)
        self.count = int(self._ends[-1])

    def look(
        self, errors: Callable[[Echo, np.ndarray], np.ndarray]
    ) -> Callable[[np.ndarray], np.ndarray]:
        """The errors (K, N) of rows by number, ping by ping."""

        def look(number: np.ndarray) -> np.ndarray:
            which = np.searchsorted(self._ends, number, side="right")
            begin = np.append(0, self._ends)[which]
            return np.hstack(
                [
                    np.atleast_2d(errors(self._echoes[n], (number - begin)[which == n]))
                    for n in np.unique(which).tolist()
                ]
            )

        return look


def _grid(pings: Pings, echo: Echo) -> BandGrid:
    """The frequencies and times of a ping, by what it heard."""
    sonar, call, speed, latest = pings.sonar, pings.equipment.call, pings.air.speed(), 0.0
    for group in echo.groups:
        latest = max(latest, group.paths.latest)
    moving, band = pings.moving(echo), pings.band
    band = widened(band, moving, speed) if moving else band
    lasts = 0.0 if call is None else call.duration
    return grid_of(band, sonar.sample_rate, latest / speed, sonar.record, lasts)


def _figures(pings: Pings, echo: Echo) -> dict[str, object]:
    """Figures of a ping besides its sums, computed again; what it heard is taken as it is."""
    sonar, station, grid = pings.sonar, pings.station(echo), _grid(pings, echo)
    targets = pings.targets.at(echo.pose.time)
    leaves = targets.total(sonar, "leaf")
    highest = station.wavenumbers[1]
    cut = pings.equipment.call is not None and sonar.doppler
    right: dict[str, object] = {} if cut else {"moments": 1}
    right |= {} if pings.equipment.receiver else {"received": None}
    return right | {
        "frequency": grid.frequency,
        "time": np.arange(grid.samples) / sonar.sample_rate,
        "leaves": leaves,
        "others": targets.total(sonar) - leaves,
        "close": sum(group.scatterers.count_close(group.instance) for group in echo.groups),
        "doubtful": sum(g.scatterers.count_doubtful(station.point, highest) for g in echo.groups),
        "sound_speed": pings.air.speed(),
        "sample_rate": sonar.sample_rate,
    }


def _searched(pings: Pings, echo: Echo) -> float:
    """Largest difference of what is heard, its counts and its list from the same found again, and, where that
    is little work, of the bounds of its sum."""
    station = pings.station(echo)
    searched, targets = pings.search(station, echo), pings.targets.at(echo.pose.time)
    right: dict[str, object] = vars(searched.counts) | {"cull_bound": searched.bound}
    if sum(map(len, echo.groups)) * echo.spectra.size <= SUMMED and echo.moments <= PIECES:
        again = sum_echoes(searched.groups, station, _grid(pings, echo), pings.sonar.tolerance)
        right |= {name: getattr(again, name) for name in ("error_bound", "table_error", "size")}
    pairs = [(getattr(echo, name), value) for name, value in right.items()]
    listed = contributions(echo.groups, station, pings.band, targets)
    pairs += [(getattr(echo.heard, name), value) for name, value in vars(listed).items()]
    pairs.append((len(echo.groups), len(searched.groups)))
    for ours, theirs in zip(echo.groups, searched.groups, strict=False):
        for name in ("instance", "bound", "shade", "motion"):
            pairs.append((getattr(ours, name), getattr(theirs, name)))
        pairs.append((ours.scatterers.number, theirs.scatterers.number))
        pairs.append((ours.paths.length, theirs.paths.length))
    return max(figure_error(one, other) for one, other in pairs)


def _received(pings: Pings, number: int) -> float:
    """Largest error of what the receiver made of a ping."""
    echo, receiver = pings.echoes[number], pings.equipment.receiver
    assert receiver is not None
    key = number, f"{echo.pose.time:.9f}"
    ears = Ears.of(pings.sonar).offset
    again = receive(receiver, echo.waveforms, ears, pings.air.speed(), pings.seed, *key)
    if echo.received is None:
        return math.inf
    pairs = zip(vars(echo.received).values(), vars(again).values(), strict=True)
    return max(figure_error(one, other) for one, other in pairs)


def _of_phases(echoes: Sequence[Echo]) -> float:
    """Radians by which two float64 sums may turn the same echo apart: a digit of each one's cycles."""
    cycles = 0.0
    for echo in echoes:
        path = max((g.paths.latest for g in echo.groups if len(g)), default=0.0)
        cycles = max(cycles, float(echo.frequency.max()) * path / echo.sound_speed)
    return 4 * math.pi * cycles * float(np.finfo(np.float64).eps)


def _combs(pings: Pings, echo: Echo, rows: np.ndarray, culled: bool) -> np.ndarray:
    """(2, R) errors of combs that begin at some bins, as shares of Σ max|A|; infinite where this is not near
    that of the comb."""
    station = pings.station(echo, cull=0.0)
    groups = pings.search(station, echo).groups if culled else echo.groups
    stride = max(len(echo.frequency) // COMB, 1)
    errors = np.empty((2, len(rows)))
    last = len(echo.frequency) - 1
    ends = sum_echoes(groups, station, _bins(echo, np.unique([0, last])), 0.0).size
    for number, row in enumerate(rows.tolist()):
        bins = np.arange(row, last + 1, stride)[:COMB]
        exact = sum_echoes(groups, station, _bins(echo, bins), 0.0)
        errors[0, number] = _of_size(echo.spectra[:, bins] - exact.spectrum, echo).max(initial=0.0)
        size = np.maximum(exact.size, ends)
        off = echo.size / np.where(size > 0, size, 1.0) - (size > 0)
        errors[1, number] = 0.0 if ((off >= -SHORT) & (off <= SIZES)).all() else np.inf
    return errors


def _derived(pings: Pings, echo: Echo) -> float:
    """Largest error of a ping's samples by the transforms of its spectra, as a share of the largest."""
    window = pings.band.window(echo.frequency)
    analytic = _in_time(echo, echo.spectra * window) / window.sum()
    waves = analytic.real
    if pings.equipment.call is not None:
        waves = _in_time(echo, echo.called).real * 2.0 / _length(echo)
    exact = (echo.responses, analytic.real), (echo.envelopes, np.abs(analytic))
    errors = [figure_error(one, other) for one, other in (*exact, (echo.waveforms, waves))]
    return max(errors)


def _in_time(echo: Echo, spectra: np.ndarray) -> np.ndarray:
    """(E, N) Σ_k S_k·e^{i2πf_k t} at all samples."""
    time, length = np.arange(echo.responses.shape[-1]), _length(echo)
    if length == 1:
        turns = float(echo.frequency[0]) / echo.sample_rate * time
        return spectra * np.exp(2j * math.pi * np.remainder(turns, 1.0))
    length = max(length, len(time))  # of frequencies that are wrong
    full = np.zeros((len(spectra), length), np.complex128)
    bins = np.rint(echo.frequency / echo.sample_rate * length).astype(np.int64)
    full[:, bins.clip(0, length - 1)] = spectra
    return np.fft.ifft(full)[:, time] * length


def _called(pings: Pings, echo: Echo, rows: np.ndarray) -> np.ndarray:
    """(R,) errors of bins of the spectrum of a call's echo, as shares of the loudest there could be."""
    call = pings.equipment.call
    assert call is not None
    loudest = float(np.abs(call.spectrum(echo.frequency)).max(initial=0.0))
    if pings.moving(echo):
        moments = pings.moments(echo)
        exact = np.stack([_played(echo, row, call, moments) for row in rows.tolist()], axis=1)
    else:
        exact = echo.spectra[:, rows] * call.spectrum(echo.frequency[rows])
        few = rows[:: max(len(rows) // LEAST, 1)]
        sent = _spectrum(call, echo.frequency[few])
        exact[:, np.searchsorted(rows, few)] = echo.spectra[:, few] * sent
    return _of_size(echo.called[:, rows] - exact, echo).max(axis=0, initial=0.0) / loudest


def _of_size(apart: np.ndarray, echo: Echo) -> np.ndarray:
    """Differences (E, K) as shares of Σ max|A| at each ear."""
    return shares(apart, np.zeros_like(apart), np.where(echo.size > 0, echo.size, 1.0)[:, None])


def _length(echo: Echo) -> int:
    """Samples of the transform that made a record; 1 of a tone."""
    if len(echo.frequency) == 1:
        return 1
    return round(echo.sample_rate / float(np.diff(echo.frequency).mean()))


def _spectrum(call: Call, frequency: np.ndarray) -> np.ndarray:
    """(K,) the call's spectrum, sample by sample."""
    turns = np.outer(frequency, np.arange(len(call.samples)) / call.sample_rate)
    return np.exp(-2j * math.pi * np.remainder(turns, 1.0)) @ call.samples


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
