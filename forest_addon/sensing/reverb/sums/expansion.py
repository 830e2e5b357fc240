"""H of trunks of one radius as a short sum of products: H(f, φ) ≈ Σ_r U_r(f)·V_r(cos φ) in each sector of φ.

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
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import fft, linalg

from ....acoustics import chebyshev
from ....acoustics.cylinder import order_count, partial_waves, transfer
from ....base.rng import stream
from ..band import SPREAD, roll_off
from .field_table import polynomials, series

FIRST_SECTOR, GROWTH = 9.0, 2.0  # ka times the angle of the first sector; of each next one
WIDEST_FIRST = 1.0  # radians
CROSSOVER = (150.0, 600.0)  # Hz, from the low to the high layer
CROSSING = 12.8 / (CROSSOVER[1] - CROSSOVER[0])  # s; so far the crossover spreads an arrival
HIGH_RINGING = 25.0  # a/c; sound that creeps around the trunk has left it
LOW_RINGING = 3.0  # s of the low layer's filters, of which the last two thirds fade out
FADED = 12.8 / (2.0 / 3.0 * LOW_RINGING)  # Hz
GRID = 2  # periods of the filters' spectrum over their length
SHARE = 0.1  # of the tolerance, for leaving out terms
FEWEST = 200  # frequencies at which terms are found
CHECKED = 24  # angles of a sector at which it is checked, at a frequency of each octave


@dataclass(frozen=True)
class Sector:
    """Scattering angles with ``low`` < cos φ <= ``high`` (from -1 on, the low end belongs to it).

    filters : (R, T) of the terms, the arrival by the axis at sample ``lead``.
    series : (C, R) Chebyshev coefficients of V_r over [low, high].
    errors : {lower end of an octave in Hz: largest relative error of H found by the check}.
    """

    low: float
    high: float
    filters: np.ndarray
    series: np.ndarray
    lead: int
    errors: dict[float, float]

    @property
    def terms(self) -> int:
        """Return how many products."""
        return len(self.filters)

    def shares(self, cosine: np.ndarray) -> np.ndarray:
        """(M, R) V_r at cosines (M,)."""
        place = (cosine - self.low) * (2.0 / (self.high - self.low)) - 1.0
        found: np.ndarray = polynomials(place, len(self.series)).T @ self.series
        return found


class ExpansionLayer:
    """A band of H of one radius at a sampling rate that is 1/``step`` of the whole, and its filters.

    lowest, highest : Hz, below and above which there is nothing. size : samples of a filter, the arrival by
    the axis at sample ``lead``. highs : (S,) upper ends in cos φ of the sectors, the first from -1, the
    last to 1.
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
        bark: float = 0.0,
    ) -> None:
        """radius : metres. span : seconds of the filters before and after the arrival by the axis, besides
        SPREAD. gain : function of the frequency in Hz."""
        self.radius = radius
        self.step, self.rate, self.speed = step, rate / step, speed
        self.tolerance, self.bark = tolerance, bark
        self.lead = SPREAD + math.ceil(span[0] * self.rate)
        self.size = fft.next_fast_len(
            self.lead + SPREAD + math.ceil(span[1] * self.rate), real=True
        )
        self.grid = GRID * self.size
        self.frequency = np.arange(1, self.grid // 2 + 1) * (self.rate / self.grid)
        self.gain_at, self.gain = gain, gain(self.frequency)
        used = self.frequency[self.gain > 0]
        self.lowest = float(used[0]) if used[0] > CROSSOVER[0] else 0.0
        self.highest = float(used[-1])
        self.wavenumber = 2.0 * math.pi / speed * self.frequency
        thickness = 2.0 * math.pi / speed * self.highest * radius
        self.waves = self._waves(thickness)
        first = min(WIDEST_FIRST, FIRST_SECTOR / thickness)
        ends = first * GROWTH ** np.arange(64.0)
        self.highs = np.append(-np.cos(ends[ends < 2.0]), 1.0)
        self.triangle = self._triangle()
        self._sectors: dict[int, Sector] = {}

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
        found: np.ndarray = fft.irfft(whole, self.grid, axis=1)[:, : self.size]
        fading = min(self.size - self.lead, int(2.0 / 3.0 * LOW_RINGING * self.rate))
        if self.size - self.lead > LOW_RINGING * self.rate:
            found[:, -fading:] *= roll_off(0.45 + 0.05 * np.arange(fading) / fading)
        return found

    def errors(
        self, filters: np.ndarray, shares: np.ndarray, cosine: np.ndarray
    ) -> dict[float, float]:
        """Largest error of filters (R, T) times shares (M, R) at cosines (M,), at a random frequency of each
        octave from 20 Hz."""
        rng = stream(len(cosine), "expansion", "check")
        used = self.frequency[self.gain > 0.5]
        octave = 20.0 * 2.0 ** np.arange(max(0, math.ceil(math.log2(used[-1] / 20.0))))
        frequency = rng.uniform(octave, np.minimum(2.0 * octave, used[-1]))
        octave, frequency = octave[frequency > used[0]], frequency[frequency > used[0]]
        time = (np.arange(self.size) - self.lead) / self.rate
        spectrum = filters @ np.exp(-2j * math.pi * np.outer(time, frequency))
        exact = transfer(frequency[:, None], np.arccos(cosine), self.radius, self.speed, self.bark)
        exact *= self.gain_at(frequency)[:, None]
        gap = np.linalg.norm(spectrum.T @ shares.T - exact, axis=1)
        return dict(
            zip(octave.tolist(), (gap / np.linalg.norm(exact, axis=1)).tolist(), strict=True)
        )

    def _waves(self, thickness: float) -> np.ndarray:
        """(N, F) factor of cos nφ in H, times the gain."""
        waves = partial_waves(self.wavenumber * self.radius, order_count(thickness), self.bark)
        waves[1:] *= 2.0
        waves *= self.gain * np.exp(0.25j * math.pi) * np.sqrt(2.0 / (math.pi * self.wavenumber))
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
        triangle: np.ndarray = linalg.qr(stacked, mode="r", check_finite=False)[0][: len(few)]
        return triangle

    def sector(self, number: int) -> Sector:
        """One of the sectors; made once."""
        if number not in self._sectors:
            low = -1.0 if number == 0 else float(self.highs[number - 1])
            self._sectors[number] = self._sector(low, float(self.highs[number]))
        return self._sectors[number]

    def _sector(self, low: float, high: float) -> Sector:
        span = math.acos(low) - math.acos(high)
        points = min(len(self.waves), math.ceil(0.55 * len(self.waves) * span) + 12) + 4
        cosine = low + 0.5 * (high - low) * (chebyshev.points(points) + 1.0)
        turns = np.cos(np.outer(np.arange(len(self.waves)), np.arccos(np.clip(cosine, -1.0, 1.0))))
        _, sizes, right = linalg.svd(self.triangle @ turns, full_matrices=False, check_finite=False)
        rest = np.sqrt(np.cumsum(np.square(sizes)[::-1])[::-1])
        terms = max(1, int(np.count_nonzero(rest > SHARE * self.tolerance * rest[0])))
        shares = right[:terms].T  # (C, R)
        # H at as many angles as there are terms, chosen for being least alike, tells all U_r.
        pivots = linalg.qr(shares.T, mode="r", pivoting=True, check_finite=False)[1][:terms]
        columns = self.waves.T @ turns[:, pivots]  # (F, R)
        spectra = linalg.solve(shares[pivots], columns.T, check_finite=False)
        coefficients = series(shares, 0)
        large = np.abs(coefficients * sizes[:terms]).max(axis=1)
        kept = int(np.flatnonzero(large > 0.01 * self.tolerance * large.max())[-1]) + 1
        found = Sector(low, high, self.filters(spectra), coefficients[:kept], self.lead, {})
        rng = stream(len(self.highs), "expansion", "angles")
        some = np.clip(rng.uniform(low, high, CHECKED), -1.0, 1.0)
        found.errors.update(self.errors(found.filters, found.shares(some), some))
        return found


def expand(
    radius: float, rate: float, speed: float, tolerance: float, bark: float = 0.0
) -> tuple[ExpansionLayer, ...]:
    """The layers of trunks of one radius, m, at a sampling rate, Hz. bark : share that it absorbs."""
    scale = radius / speed
    step = int(rate / (2.5 * CROSSOVER[1]))
    after = LOW_RINGING + CROSSING
    if step < 2:
        return (
            ExpansionLayer(
                radius,
                rate,
                1,
                speed,
                tolerance,
                (2 * scale, after),
                lambda f: roll_off(f / rate),
                bark,
            ),
        )

    def high(frequency: np.ndarray) -> np.ndarray:
        return roll_off(frequency / rate) * (1.0 - _crossover(frequency))

    spread = CROSSING + 2.0 * scale
    ringing = CROSSING + HIGH_RINGING * scale
    return (
        ExpansionLayer(radius, rate, 1, speed, tolerance, (spread, ringing), high, bark),
        ExpansionLayer(radius, rate, step, speed, tolerance, (spread, after), _crossover, bark),
    )


def _crossover(frequency: np.ndarray) -> np.ndarray:
    """Share of the low layer at a frequency: 1 to 0 over CROSSOVER, as ``roll_off``."""
    low, high = CROSSOVER
    return roll_off(0.45 + 0.05 * (frequency - low) / (high - low))
