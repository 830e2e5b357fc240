"""The sum over trunks in one layer of frequency: pulses on a grid, transforms, filters.

Paths by trunks and what they lose go in, samples come out. In each sector of the scattering angle
H ≈ Σ_r U_r(f)·V_r(cos φ), and in each zone of the path's length the gain is
g ≈ Σ_q G_q(f)·T_q(x) (``path_gain``), so that

    Σ_m w_m·e^{-ikx_m}·H·g ≈ Σ_rq U_r·G_q·Σ_m w_m·V_r·T_q·e^{-ikx_m}.

Many trunks are laid down on an even grid as pulses of these heights, one transform for each product r, q that
the tolerance needs. Where few trunks meet many products, as near by, each trunk's own spectrum,
(Σ_r U_r·V_r)·(Σ_q G_q·T_q), is turned to its time, which costs R + Q products for R·Q transforms. Few trunks
without a gain are heard one by one, as samples: no grid over the whole record is transformed.

H of trunks of one radius as a short sum of products: H(f, φ) ≈ Σ_r U_r(f)·V_r(cos φ) in each sector of φ.

A sampling rate, a radius and a tolerance go in; sectors come out when they are asked for, from straight
back to straight on, each with its own U (as filters in time) and V (as Chebyshev series), by a singular
value decomposition in which every octave counts alike. Straight back, where nearly all trunks of a forest
are, a few terms do; straight on, where the shadow is, it takes tens, but trunks there stand near the line
between source and receiver, and their sounds arrive within a short time (a trunk turns the sound by φ
only if its path is at most D/cos(φ/2)).

H goes with f^1.5 at low frequencies, so that a trunk's answer dies away as slowly as t^-2.5. There are
two layers therefore: a low band at a low sampling rate with filters of seconds, and the rest, which is
over soon, up to the roll-off of the band. A filter's end is faded out, which leaves frequencies above
``FADED`` as they are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import fft, linalg

from ....acoustics import chebyshev
from ....acoustics.cylinder import order_count, partial_waves, transfer
from ....acoustics.gridding import OVERSAMPLING, grid_of, kernel, lay, width_for
from ....acoustics.spectrum import delay_factors
from ....base.kept import LastAsked
from ....base.rng import stream
from ..bands import SPREAD, roll_off, upsampled
from ..forest.losses import Losses
from .path_gain import AirFilter, PathGain, Zone
from .scattering import Check, TrunkPaths

TRUNKS_AT_ONCE = 65536
GRID_AT_ONCE = 1 << 23  # values of the even grid, of as many terms as that allows
SPECTRA_AT_ONCE = 1 << 19  # values of spectra of single trunks
SAMPLES_AT_ONCE = 1 << 16  # of single trunks
MOST_KEPT = 1 << 27  # bytes of filters that a layer keeps as spectra
SINGLE = 1e-4  # from this tolerance on, single precision does; not where seconds of filters are
RINGING = 0.02  # s by which a gain of frequency spreads an arrival to both sides
UNHEARD = 1e-5  # of the loudest frequency: where a layer has nothing but rounding
LEAST = 0.3  # of the tolerance: products of a zone that are smaller at all frequencies are left out
SEEN = 4  # every so many frequencies of a transform tell how large a product is
BESIDE = 160  # samples of a low layer before and after the record; they fade out
LATE = 10  # Chebyshev polynomials of the part of a sample by which a trunk is heard later: 5e-8
DELAYS = 6  # of them that a term needs, in the mean
FAINT = 1e-4  # of the tolerance: where trunks' own samples begin and end
# ns a value: of a trunk's own samples, a product in it; of a point of a term's grid
SAMPLE, SAMPLE_PRODUCT, POINT = 1.0, 0.03, 20.0
# ns a value: of a trunk's own spectrum, a product in it; of a product on the grid; and a sector's on top
OWN, OWN_PRODUCT, GRIDDED, GRID = 12.0, 0.25, 8.0, 5e5
FIRST_SECTOR, GROWTH = 9.0, 2.0  # ka times the angle of the first sector; of each next one
WIDEST_FIRST = 1.0  # radians
CROSSOVER = (150.0, 600.0)  # Hz, from the low to the high layer
CROSSING = 12.8 / (CROSSOVER[1] - CROSSOVER[0])  # s; so far the crossover spreads an arrival
HIGH_RINGING = 25.0  # a/c; sound that creeps around the trunk has left it
LOW_RINGING = 3.0  # s of the low layer's filters, of which the last two thirds fade out
FADED = 12.8 / (2.0 / 3.0 * LOW_RINGING)  # Hz
EXPANSION_GRID = 2  # periods of the filters' spectrum over their length
SHARE = 0.03  # of the tolerance, for leaving out terms: some trunks stand where H nearly vanishes
FEWEST = 200  # frequencies at which terms are found
ROUNDS = 3  # of the equation for a frequency that the air shifts
CHECKED = 24  # angles of a sector at which it is checked, at a frequency of each octave


@dataclass(frozen=True)
class Sector:
    """Scattering angles with ``low`` < cos φ <= ``high`` (from -1 on, the low end belongs to it).

    filters : (R, T) of the terms, the arrival by the axis at a layer's ``lead``.
    series : (C, R) Chebyshev coefficients of V_r over [low, high].
    checks : errors of H at a frequency of each octave. tolerance : of the sum.
    """

    low: float
    high: float
    filters: np.ndarray
    series: np.ndarray
    tolerance: float
    checks: list[Check]

    @property
    def terms(self) -> int:
        """Number of products."""
        return len(self.filters)

    def shares(self, cosine: np.ndarray) -> np.ndarray:
        """(M, R) V_r at cosines (M,)."""
        place = (cosine - self.low) * (2.0 / (self.high - self.low)) - 1.0
        return chebyshev.polynomials(place, len(self.series)).T @ self.series

    @cached_property
    def delayed(self) -> tuple[np.ndarray, np.ndarray, int]:
        """(K, T) Chebyshev coefficients of the filters by how much later they are, up to half a sample, those
        that the tolerance needs; which of all (P·R) these are, and the first sample of them that is heard."""
        count = self.filters.shape[1]
        size = fft.next_fast_len(count + SPREAD, real=True)
        turn = -1j * math.pi / size * np.arange(size // 2 + 1)  # of half a sample
        series = chebyshev.coefficients(np.exp(np.outer(chebyshev.points(LATE), turn)), 0)
        delayed = fft.irfft(fft.rfft(self.filters, size) * series[:, None], size)
        delayed = delayed[:, :, :count].reshape(-1, count)
        norm = np.linalg.norm(delayed, axis=1)
        kept = np.flatnonzero(norm > SHARE * self.tolerance * norm.max())
        large = np.abs(delayed[kept]).max(axis=0)
        heard = np.flatnonzero(large > FAINT * self.tolerance * large.max())
        delayed = np.ascontiguousarray(delayed[kept, heard[0] : heard[-1] + 1])
        return delayed, kept, int(heard[0])


class LayerSum:
    """The sum over one layer's sectors: a band of H of one radius, at a sampling rate that is 1/``step`` of
    the whole, with what the air takes.

    lowest, highest : Hz, below and above which there is nothing. size : samples of a filter, the arrival by
    the axis at sample ``lead``. highs : (S,) upper ends in cos φ of the sectors, the first from -1, the
    last to 1. Filters are kept as spectra for each length of transform that was needed, up to MOST_KEPT.
    """

    def __init__(
        self,
        radius: float,
        rate: float,
        step: int,
        speed: float,
        tolerance: float,
        span: tuple[float, float],
        gain: Callable[[np.ndarray], np.ndarray],
        bark: float,
        air_at: Callable[[float], AirFilter | None],
    ) -> None:
        """radius : metres. span : seconds of the filters before and after the arrival by the axis, besides
        SPREAD. gain : function of the frequency in Hz. air_at : the air by the sampling rate; None: paths
        lose to it, not what is heard."""
        self.radius = radius
        self.step, self.rate, self.speed = step, rate / step, speed
        self.tolerance, self.bark, self.air = tolerance, bark, air_at(rate / step)
        self.lead = SPREAD + math.ceil(span[0] * self.rate)
        self.size = fft.next_fast_len(
            self.lead + SPREAD + math.ceil(span[1] * self.rate), real=True
        )
        self.grid = EXPANSION_GRID * self.size
        self.frequency = np.arange(1, self.grid // 2 + 1) * (self.rate / self.grid)
        self.gain_at, self.gain = gain, gain(self.frequency)
        used = self.frequency[self.gain > 0]
        self.lowest = float(used[0]) if used[0] > CROSSOVER[0] else 0.0
        self.highest = float(used[-1])
        thickness = 2.0 * math.pi / speed * self.highest * radius
        self.waves = self._waves(thickness)
        first = min(WIDEST_FIRST, FIRST_SECTOR / thickness)
        ends = first * GROWTH ** np.arange(64.0)
        self.highs = np.append(-np.cos(ends[ends < 2.0]), 1.0)
        self.triangle = self._triangle()
        self.dtype = np.float32 if tolerance >= SINGLE and self.lowest > 0 else np.float64
        self.complex = np.result_type(self.dtype, np.complex64)
        self.kernel = kernel(width_for(0.3 * tolerance))
        self._sectors: dict[int, Sector] = {}
        self._spectra: LastAsked[tuple, tuple[np.ndarray, np.ndarray]] = LastAsked(
            MOST_KEPT, lambda kept: sum(each.nbytes for each in kept)
        )

    def sum(
        self, paths: TrunkPaths, cosine: np.ndarray, count: int, gain: PathGain | None = None
    ) -> tuple[np.ndarray, list[Check]]:
        """(count,) samples at the full rate, sample 0 when the source sounds, and what checks found."""
        beside = BESIDE if self.step > 1 else self.air.tail if self.air else 0
        total: np.ndarray = np.zeros(-(-count // self.step) + 2 * beside)
        sector_of = np.searchsorted(self.highs, cosine)
        sectors = [(None, rows) for _, rows in _groups(sector_of)]
        for zone, rows in sectors if gain is None else gain.zones(paths.length):
            given = paths.select(rows), cosine[rows], sector_of[rows]
            start, part = self._sum_together(*given, gain, zone)
            _add(total, part, start + beside)
        checks = [check for number, _ in _groups(sector_of) for check in self.sector(number).checks]
        if self.air is not None:
            total = self.air.apply(total, -beside)
        if self.step > 1:
            total = upsampled(total, self.step, BESIDE)
        return total[beside * self.step : beside * self.step + count], checks

    def _sum_together(
        self,
        paths: TrunkPaths,
        cosine: np.ndarray,
        sector_of: np.ndarray,
        gain: PathGain | None,
        zone: Zone | None,
    ) -> tuple[int, np.ndarray]:
        """First sample and samples of one sector's trunks, or of all in one zone of their gain."""
        rings = 0 if zone is None else math.ceil(RINGING * self.rate)
        place, base, size = self._placed(paths.length, zone.rise or 0.0 if zone else 0.0, rings)
        total = np.zeros(size // 2 + 1, np.complex128)
        for number, rows in _groups(sector_of):
            some = paths if zone is None else paths.select(rows)
            turned, at, terms = cosine[rows], place[rows], self.sector(number).terms
            if gain is None or zone is None:
                each = self.size * (SAMPLE + SAMPLE_PRODUCT * DELAYS * terms)
                if len(rows) * each < POINT * OVERSAMPLING * size * terms:
                    start, part = self._one_by_one(number, some, turned, at, size)
                    return base - self.lead + start, part
                total += self._gridded(number, some, turned, at, size)
                continue
            nodes = len(zone.nodes)
            own = len(rows) * (OWN + OWN_PRODUCT * (terms + nodes))
            if own < GRIDDED * 0.6 * terms * nodes + GRID / size:
                total += self._own_spectra(number, some, turned, at, size, gain, zone)
            else:
                total += self._gridded(number, some, turned, at, size, gain, zone)
        return base - self.lead, fft.irfft(total, size)

    def _one_by_one(
        self, number: int, paths: TrunkPaths, cosine: np.ndarray, place: np.ndarray, size: int
    ) -> tuple[int, np.ndarray]:
        """First sample of a sector's filters that is heard, and (size,) samples from there on of trunks at
        ``place`` (N,)."""
        sector = self.sector(number)
        products, kept, heard = sector.delayed
        total = np.zeros(size)
        whole = np.rint(place).astype(np.int64)
        later, term = np.divmod(kept, sector.terms)
        delays = chebyshev.polynomials(2.0 * (place - whole), LATE).T
        shares = sector.shares(cosine) * paths.weight[:, None]
        heights = delays[:, later] * shares[:, term]
        several = max(1, SAMPLES_AT_ONCE // products.shape[1])
        for first in range(0, len(whole), several):
            some = slice(first, first + several)
            for start, samples in zip(whole[some].tolist(), heights[some] @ products, strict=True):
                total[start : start + len(samples)] += samples
        return heard, total

    def _placed(self, length: np.ndarray, rise: float, beside: int) -> tuple[np.ndarray, int, int]:
        """Samples (N,) of paths from a first one on, that one, and the length of a transform for them."""
        place = length * (self.rate / self.speed)
        if rise > 0:
            place += Losses.detour(length, rise) * (self.rate / self.speed)
        width = self.kernel.width
        base = int(place.min()) - width - beside
        span = int(place.max()) - base + width + 2 + self.size + beside
        place -= base
        # One of a few lengths of transform, so that their filters are used again.
        coarse = 1 << max(0, span.bit_length() - 4)
        size = 2 * fft.next_fast_len(-(-span // coarse) * coarse // 2 + 1, real=True)
        return place, base, size

    def _own_spectra(
        self,
        number: int,
        paths: TrunkPaths,
        cosine: np.ndarray,
        place: np.ndarray,
        size: int,
        gain: PathGain,
        zone: Zone,
    ) -> np.ndarray:
        """(size // 2 + 1,) sum of spectra that are made trunk by trunk."""
        filters, gains = self._factors(number, size, gain, zone)  # (F, R), (F, Q)
        lowest = size // 2 + 1 - len(filters)
        shares = self.sector(number).shares(cosine) * paths.weight[:, None]
        shares = shares.astype(self.dtype)
        basis = zone.polynomials(paths.length).astype(self.dtype)
        total = np.zeros(size // 2 + 1, np.complex128)
        several = max(1, SPECTRA_AT_ONCE // len(filters))
        for start in range(0, len(place), several):
            some = slice(start, start + several)
            each = filters @ shares[some].T  # (F, N)
            each *= gains @ basis[some].T
            each *= delay_factors(lowest / size, 1.0 / size, len(filters), place[some])
            total[lowest:] += each.sum(axis=1, dtype=np.complex128)
        return total

    def _factors(
        self, number: int, size: int, gain: PathGain, zone: Zone
    ) -> tuple[np.ndarray, np.ndarray]:
        """(F, R) and (F, Q) spectra of a sector's filters and a zone's gain, at frequencies of the layer."""

        def made() -> tuple[np.ndarray, np.ndarray]:
            lowest = math.floor(self.lowest * size / self.rate)
            spectra = fft.rfft(self.sector(number).filters, size, axis=1)[:, lowest:]
            gains = gain.spectra(zone, self.rate / size, lowest, size // 2)
            return spectra.T.astype(self.complex), gains.T.astype(self.complex)

        return self._spectra.once(("own", number, size, gain.losses, zone.low, zone.rise), made)

    def _gridded(
        self,
        number: int,
        paths: TrunkPaths,
        cosine: np.ndarray,
        place: np.ndarray,
        size: int,
        gain: PathGain | None = None,
        zone: Zone | None = None,
    ) -> np.ndarray:
        """(size // 2 + 1,) spectrum of a sector's trunks, by transforms of pulses of their heights in terms,
        or in products of these and a zone's."""
        sector = self.sector(number)
        filters, kept = self._filter_spectra(number, size, gain, zone)
        total = np.zeros(size // 2 + 1, filters.dtype)
        fine = place * OVERSAMPLING
        several = max(4, GRID_AT_ONCE // (size * OVERSAMPLING))
        for first in range(0, len(filters), several):
            terms = kept[first : first + several]
            count = len(terms)
            grid = grid_of(1, size * OVERSAMPLING, -(-count // 2))
            for start in range(0, len(place), TRUNKS_AT_ONCE):
                some = slice(start, start + TRUNKS_AT_ONCE)
                heights = sector.shares(cosine[some]) * paths.weight[some, None]
                if zone is None:
                    heights = heights[:, terms]
                else:
                    one, other = np.divmod(terms, len(zone.nodes))
                    heights = heights[:, one] * zone.polynomials(paths.length[some])[:, other]
                at = fine[some]
                pairs = np.zeros((len(at), -(-count // 2)), np.complex128)  # of real heights
                pairs.view(np.float64)[:, :count] = heights
                lay(self.kernel, at, np.zeros(len(at)), pairs.T, np.ones((len(at), 1)), grid)
            pulses = grid[0].view(np.float64)[:, :count].astype(self.dtype)
            spectra = fft.rfft(pulses.T, axis=1)[:, : size // 2 + 1]
            total += np.einsum("kf,kf->f", spectra, filters[first : first + several])
        return total

    def _filter_spectra(
        self, number: int, size: int, gain: PathGain | None = None, zone: Zone | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """(K, size // 2 + 1) filters of a sector over the kernel's transform, and which terms they are of.

        In a zone of a gain, of those of the R·Q products that the tolerance needs.
        """

        def made() -> tuple[np.ndarray, np.ndarray]:
            spectra = fft.rfft(self.sector(number).filters, size, axis=1)
            spectra[:, : math.floor(self.lowest * size / self.rate)] = 0.0
            spectra /= self.kernel.transform(np.arange(size // 2 + 1) / (size * OVERSAMPLING))
            kept = np.arange(len(spectra))
            if gain is not None and zone is not None:
                gains = gain.spectra(zone, self.rate / size, 0, size // 2)
                share = np.abs(spectra[:, None, ::SEEN]) * np.abs(gains[:, ::SEEN])
                share = share.reshape(-1, share.shape[-1])
                share /= np.maximum(share.max(axis=0), UNHEARD * share.max() + 1e-300)
                kept = np.flatnonzero(share.max(axis=1) > LEAST * self.tolerance)
                first, second = np.divmod(kept, len(gains))
                gains = gains.astype(self.complex)
                spectra = spectra.astype(self.complex)[first] * gains[second]
            return spectra.astype(self.complex, copy=False), kept

        key = "grid", number, size, gain and gain.losses, zone and (zone.low, zone.rise)
        return self._spectra.once(key, made)

    def few_rows(self, count: int) -> np.ndarray:
        """Rows of some frequencies, evenly by logarithm and evenly."""
        last = int(np.flatnonzero(self.gain > 0)[-1])
        first = int(np.flatnonzero(self.gain > 1e-4)[0])
        rows = np.unique(np.geomspace(first + 1, last + 1, count).astype(np.int64)) - 1
        return np.union1d(rows, np.linspace(first, last, count).astype(np.int64))

    def filters(self, spectra: np.ndarray) -> np.ndarray:
        """(R, T) filters from spectra (R, F)."""
        whole = np.zeros((len(spectra), self.grid // 2 + 1), np.complex128)
        turn = -2j * math.pi * np.arange(1, self.grid // 2 + 1) * (self.lead / self.grid)
        whole[:, 1:] = spectra * np.exp(turn)
        filters: np.ndarray = fft.irfft(whole, self.grid, axis=1)[:, : self.size]
        fading = min(self.size - self.lead, int(2.0 / 3.0 * LOW_RINGING * self.rate))
        if self.size - self.lead > LOW_RINGING * self.rate:
            filters[:, -fading:] *= roll_off(0.45 + 0.05 * np.arange(fading) / fading)
        return filters

    def checks(self, filters: np.ndarray, shares: np.ndarray, cosine: np.ndarray) -> list[Check]:
        """Errors of filters (R, T) times shares (M, R) at cosines (M,), after the air, at a random frequency
        of each octave from 20 Hz."""
        rng = stream(len(cosine), "expansion", "check")
        used = self.frequency[self.gain > 0.5]
        octave = 20.0 * 2.0 ** np.arange(max(0, math.ceil(math.log2(used[-1] / 20.0))))
        frequency = rng.uniform(octave, np.minimum(2.0 * octave, used[-1]))
        frequency = frequency[frequency > used[0]]
        time = (np.arange(self.size) - self.lead) / self.rate
        lost = self.air.loss(frequency) * self.speed if self.air else 0.0
        spectrum = filters @ np.exp(np.outer(time, -2j * math.pi * frequency - lost))
        exact = transfer(frequency[:, None], np.arccos(cosine), self.radius, self.speed, self.bark)
        exact *= self.gain_at(frequency)[:, None]
        gap = np.linalg.norm(spectrum.T @ shares.T - exact, axis=1)
        off = gap / np.linalg.norm(exact, axis=1)
        return list(zip(frequency.tolist(), off.tolist(), strict=True))

    def _waves(self, thickness: float) -> np.ndarray:
        """(N, F) factor of cos nφ in H, times the gain, before the air has taken what it takes of a time.

        What e^{-b(f)ct} makes of sound at t is its spectrum at the frequency f - ibc/2π; H has lost nothing
        there if it is that of f at the frequency f + ibc/2π, to which b belongs. (Conjugates here.)
        """
        frequency = self.frequency
        for _ in range(ROUNDS):
            if self.air is not None:
                lost = self.air.loss(frequency) * (self.speed / (2.0 * math.pi))
                frequency = self.frequency - 1j * lost
        wavenumber = 2.0 * math.pi / self.speed * frequency
        waves = partial_waves(wavenumber * self.radius, order_count(thickness), self.bark)
        waves[1:] *= 2.0
        waves *= self.gain_at(frequency) * np.exp(0.25j * math.pi)
        waves *= np.sqrt(2.0 / (math.pi * wavenumber))
        np.conj(waves, out=waves)
        return waves

    def _triangle(self) -> np.ndarray:
        """(N, N) what is left of H at some frequencies after taking off an orthogonal factor.

        Each frequency counts by 1/√f over the root mean square of H there: octaves count alike.
        """
        rows = self.few_rows(max(FEWEST, 3 * len(self.waves)))
        few = self.waves[:, rows]
        density = np.gradient(np.log(self.frequency[rows]))
        size = np.sqrt(np.square(np.abs(few)).sum(axis=0)) / self.gain[rows]
        few = few * np.sqrt(density) / size
        stacked = np.hstack([few.real, few.imag]).T
        return linalg.qr(stacked, mode="r", check_finite=False)[0][: len(few)]

    def sector(self, number: int) -> Sector:
        """One of the sectors; made once."""
        if number not in self._sectors:
            low = -1.0 if number == 0 else float(self.highs[number - 1])
            self._sectors[number] = self._sector(low, float(self.highs[number]))
        return self._sectors[number]

    def _sector(self, low: float, high: float) -> Sector:
        span = math.acos(low) - math.acos(high)
        points = min(len(self.waves), math.ceil(0.55 * len(self.waves) * span) + 12) + 4
        cosine = chebyshev.points(points, low, high)
        turns = np.cos(np.outer(np.arange(len(self.waves)), np.arccos(np.clip(cosine, -1.0, 1.0))))
        _, sizes, right = linalg.svd(self.triangle @ turns, full_matrices=False, check_finite=False)
        rest = np.sqrt(np.cumsum(np.square(sizes)[::-1])[::-1])
        terms = max(1, int(np.count_nonzero(rest > SHARE * self.tolerance * rest[0])))
        shares = right[:terms].T  # (C, R)
        # H at as many angles as there are terms, chosen for being least alike, tells all U_r.
        pivots = linalg.qr(shares.T, mode="r", pivoting=True, check_finite=False)[1][:terms]
        columns = self.waves.T @ turns[:, pivots]  # (F, R)
        spectra = linalg.solve(shares[pivots], columns.T, check_finite=False)
        coefficients = chebyshev.coefficients(shares, 0)
        large = np.abs(coefficients * sizes[:terms]).max(axis=1)
        kept = int(np.flatnonzero(large > 0.01 * self.tolerance * large.max())[-1]) + 1
        sector = Sector(low, high, self.filters(spectra), coefficients[:kept], self.tolerance, [])
        rng = stream(len(self.highs), "expansion", "angles")
        some = np.clip(rng.uniform(low, high, CHECKED), -1.0, 1.0)
        sector.checks.extend(self.checks(sector.filters, sector.shares(some), some))
        return sector


def expand(
    radius: float,
    rate: float,
    speed: float,
    tolerance: float,
    bark: float,
    air_at: Callable[[float], AirFilter | None],
) -> list[LayerSum]:
    """The layers of trunks of one radius, m, at a sampling rate, Hz; arguments as of ``LayerSum``."""
    scale = radius / speed
    step = int(rate / (2.5 * CROSSOVER[1]))
    after = LOW_RINGING + CROSSING

    def whole(frequency: np.ndarray) -> np.ndarray:
        return roll_off(frequency / rate)

    def high(frequency: np.ndarray) -> np.ndarray:
        return whole(frequency) * (1.0 - _crossover(frequency))

    spread = CROSSING + 2.0 * scale
    ringing = CROSSING + HIGH_RINGING * scale
    layers = [(1, (spread, ringing), high), (step, (spread, after), _crossover)]
    if step < 2:
        layers = [(1, (2.0 * scale, after), whole)]
    return [
        LayerSum(radius, rate, slower, speed, tolerance, span, gain, bark, air_at)
        for slower, span, gain in layers
    ]


def _crossover(frequency: np.ndarray) -> np.ndarray:
    """Share of the low layer at a frequency: 1 to 0 over CROSSOVER, as ``roll_off``."""
    low, high = CROSSOVER
    return roll_off(0.45 + 0.05 * (frequency - low) / (high - low))


def _groups(number: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Each number that occurs and its rows."""
    for each in np.flatnonzero(np.bincount(number)).tolist():
        yield each, np.flatnonzero(number == each)


def _add(total: np.ndarray, part: np.ndarray, start: int) -> None:
    """Add a part that starts at a sample, which may be negative; what does not fit is left out."""
    first, last = max(0, -start), min(len(part), len(total) - start)
    if last > first:
        total[start + first : start + last] += part[first:last]
