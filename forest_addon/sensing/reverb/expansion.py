"""H of trunks as a short sum of products: H(f, φ, a) ≈ Σ_r U_r(f)·V_r(cos φ, a) in each sector of φ.

A sampling rate, a range of radii and a tolerance go in; sectors come out, from straight back to straight
on, each with its own U (as filters in time) and V (as Chebyshev series), by singular value
decomposition. Sectors are cut where the number of terms for the thickest trunk passes ``TERMS``:
straight back, where nearly all trunks of a forest are, a few terms do; straight on, where the shadow is,
it takes tens, but trunks there stand near the line between source and receiver, and their sounds arrive
within a short time (a trunk turns the sound by φ only if its path is at most D/cos(φ/2)).

A range of radii takes about as many terms as its time-bandwidth product, the spread of delays between
the thinnest and the thickest trunk's echo times the band, however many radii are in it.

H goes with f^1.5 at low frequencies, so that a trunk's answer dies away as slowly as t^-2.5. There are
two layers therefore: a low band at a low sampling rate with long filters, and the rest, which is over
soon, up to the roll-off of the band.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.polynomial import chebyshev
from scipy import fft, linalg

from ...acoustics.cylinder import order_count, partial_waves
from .scattering import SPREAD, roll_off

VERSION = 1  # of what is computed here; a stored expansion of another one is not used
TERMS = (4, 6, 9, 13, 19, 28)  # of the sectors, from straight back, at 1e-4; then LAST_TERMS
LAST_TERMS = 60
CROSSOVER = (0.073, 0.365)  # c/a; from the low to the high layer, 100 to 500 Hz for 0.25 m
CROSSING = 12.8 / (CROSSOVER[1] - CROSSOVER[0])  # a/c; so far the crossover spreads an arrival
HIGH_RINGING = 10.0  # a/c; sound that creeps around the trunk has left it
RINGING, RINGING_ERROR = 60.0, 2.4e-3  # a/c of the low layer at this tolerance; error falls as t^-2
GRID = 2  # periods of the filters' spectrum over their length
SHARE = 0.2  # of the tolerance, for leaving out terms
FEWEST = 400  # frequencies at which terms are found
TURN = 6.0  # radians by which H turns over a bin of radii
FAINT = 0.03  # radii whose H is fainter than this share of the thickest's count as if of this share
SINGLE = 3e-6  # from this tolerance on, single precision does
VALUES_AT_ONCE = 4_000_000


class Key(NamedTuple):
    """What an expansion depends on: Hz, metres, m/s, relative error."""

    rate: float
    thinnest: float
    thickest: float
    speed: float
    tolerance: float
    version: int = VERSION


@dataclass(frozen=True)
class Sector:
    """Scattering angles with ``low`` < cos φ <= ``high`` (from -1 on, the low end belongs to it).

    filters : (R, T) of the terms, the arrival by the axis at sample ``lead``.
    series : (B, A, C, R) Chebyshev coefficients of V_r, C over [low, high] and A over each of B even
    bins between the thinnest and the thickest radius; a single radius has one of each.
    """

    low: float
    high: float
    filters: np.ndarray
    series: np.ndarray
    lead: int

    @property
    def terms(self) -> int:
        """How many products."""
        return len(self.filters)


@dataclass(frozen=True)
class Layer:
    """A band of H at a sampling rate that is 1/``step`` of the whole."""

    step: int
    sectors: tuple[Sector, ...]


class Store(Protocol):
    """Keeps expansions from one run to the next."""

    def load(self, key: Key) -> tuple[Layer, ...] | None:
        """The layers of a key, None where there are none to be had."""

    def save(self, key: Key, layers: tuple[Layer, ...]) -> None:
        """Keep the layers of a key."""


def precision(tolerance: float) -> type[np.floating]:
    """The floating point numbers that are good enough."""
    return np.float32 if tolerance >= SINGLE else np.float64


def expand(key: Key) -> tuple[Layer, ...]:
    """The layers of a range of radii at a sampling rate."""
    rate, scale = key.rate, key.thickest / key.speed
    ringing = RINGING * math.sqrt(max(1.0, RINGING_ERROR / key.tolerance))
    step = int(rate * scale / (2.0 * CROSSOVER[1]))
    if step < 2:
        return (Layer(1, _Band(key, rate, 2.0, ringing, roll_off).sectors()),)

    def low(share: np.ndarray) -> np.ndarray:
        return _crossover(share * (rate / step) * scale)

    def high(share: np.ndarray) -> np.ndarray:
        return roll_off(share) * (1.0 - _crossover(share * rate * scale))

    return (
        Layer(1, _Band(key, rate, CROSSING, CROSSING + HIGH_RINGING, high).sectors()),
        Layer(step, _Band(key, rate / step, CROSSING, CROSSING + ringing, low).sectors()),
    )


def _crossover(frequency: np.ndarray) -> np.ndarray:
    """Share of the low layer at a frequency in c/a: 1 to 0 over CROSSOVER, as ``roll_off``."""
    low, high = CROSSOVER
    return roll_off(0.45 + 0.05 * (frequency - low) / (high - low))


class _Band:
    """H times a gain, at one sampling rate, on the way to its sectors.

    before, after : length of the filters before and after the arrival by the axis, in a/c of the
    thickest trunk, besides SPREAD. gain : function of the frequency's share of the rate.
    """

    def __init__(
        self,
        key: Key,
        rate: float,
        before: float,
        after: float,
        gain: Callable[[np.ndarray], np.ndarray],
    ) -> None:
        scale = key.thickest / key.speed * rate
        self.lead = SPREAD + math.ceil(before * scale)
        self.size = fft.next_fast_len(self.lead + SPREAD + math.ceil(after * scale), real=True)
        self.grid = GRID * self.size
        share = np.arange(1, self.grid // 2 + 1) / self.grid
        self.gain = gain(share)
        self.wavenumber = 2.0 * math.pi * rate / key.speed * share
        self.highest = float(self.wavenumber[self.gain > 0].max())
        self.orders = order_count(self.highest * key.thickest) + 1
        self.extra = max(0, round(-math.log10(SHARE * key.tolerance)) - 4)
        # Of a range of radii, a stand may have those alone that fit worst.
        self.tolerance = SHARE * key.tolerance * (1.0 if key.thinnest == key.thickest else 0.3)
        self.dtype = precision(key.tolerance)
        self.thinnest, self.thickest = key.thinnest, key.thickest
        self.radii = self._radii()
        stride = max(1, len(share) // max(FEWEST, 3 * self.orders))
        self.few = self.waves(self.radii, slice(None, None, stride))  # (A, F, N)
        norms = np.sqrt(np.square(np.abs(self.few)).sum(axis=(1, 2)))
        self.weight = 1.0 / np.maximum(norms, FAINT * norms.max())

    def _radii(self) -> np.ndarray:
        """(A,) Chebyshev points between the thinnest and the thickest radius."""
        if self.thinnest == self.thickest:
            return np.array([self.thickest])
        turn = 0.5 * math.pi * self.highest * (self.thickest - self.thinnest)
        count = math.ceil(turn + 5.0 * turn ** (1 / 3) + 8.0)
        return _between(_points(count), self.thinnest, self.thickest)

    def waves(self, radii: np.ndarray, rows: slice) -> np.ndarray:
        """(A, F, N) factor of cos nφ in H of some radii, times the gain, at some frequencies."""
        k, gain = self.wavenumber[rows], self.gain[rows]
        waves = np.zeros((self.orders, len(radii) * len(k)), np.complex128)
        last = min(order_count(self.highest * float(radii.max())), self.orders - 1)
        waves[: last + 1] = partial_waves(np.outer(radii, k).ravel(), last)
        waves[1:] *= 2.0
        scale = gain * np.exp(0.25j * math.pi) * np.sqrt(2.0 / (math.pi * k))
        shaped = waves.reshape(self.orders, len(radii), len(k)) * scale
        return np.conj(np.moveaxis(shaped, 0, 2))

    def sectors(self) -> tuple[Sector, ...]:
        """All sectors, from straight back to straight on."""
        drafts = [self._draft(low, high) for low, high in self._cuts()]
        columns = [np.empty((len(draft.pivots), len(self.gain)), complex) for draft in drafts]
        several = max(1, VALUES_AT_ONCE // (self.orders * len(self.gain)))
        for first in range(0, len(self.radii), several):
            number = np.arange(first, min(first + several, len(self.radii)))
            for radius, waves in zip(
                number, self.waves(self.radii[number], slice(None)), strict=True
            ):
                for draft, column in zip(drafts, columns, strict=True):
                    of_radius, point = np.divmod(draft.pivots, draft.turns.shape[1])
                    here = of_radius == radius
                    column[here] = (waves @ draft.turns[:, point[here]]).T
        return tuple(
            Sector(draft.low, draft.high, self._filters(draft, column), draft.series, self.lead)
            for draft, column in zip(drafts, columns, strict=True)
        )

    def _cuts(self) -> list[tuple[float, float]]:
        """Ends of the sectors in cos φ, from -1 to 1, by the terms of the thickest trunk."""
        thickest = self.waves(self.radii[[np.argmax(self.radii)]], slice(None, None, 2))[0]
        stacked = np.vstack([thickest.real, thickest.imag])
        triangle = linalg.qr(stacked, mode="r", check_finite=False)[0][: self.orders]

        def terms(low: float, high: float) -> int:
            turns = self._turns(self._enough_points(low, high), low, high)
            return self._count(linalg.svdvals(triangle @ turns, check_finite=False))

        cuts = []
        low, wanted = -1.0, list(TERMS)
        while low < 1.0:
            most = (wanted.pop(0) if wanted else LAST_TERMS) + self.extra
            fits, fails = (1.0, 1.0) if terms(low, 1.0) <= most else (low, 1.0)
            while fits < fails and (fails - fits > 0.05 * (fails - low) or fits == low):
                # cos φ near -1 is passed in angle, where terms grow about evenly
                middle = math.cos(0.5 * (math.acos(fits) + math.acos(fails)))
                if terms(low, middle) <= most:
                    fits = middle
                else:
                    fails = middle
            cuts.append((low, fits))
            low = fits
        return cuts

    def _count(self, sizes: np.ndarray) -> int:
        """Terms to keep of singular values in falling order."""
        rest = np.sqrt(np.cumsum(np.square(sizes)[::-1])[::-1])
        return max(1, int(np.count_nonzero(rest > self.tolerance * rest[0])))

    def _turns(self, count: int, low: float, high: float) -> np.ndarray:
        """(N, C) cos nφ at Chebyshev points of a sector."""
        angle = np.arccos(np.clip(_between(_points(count), low, high), -1.0, 1.0))
        return np.cos(np.arange(self.orders)[:, None] * angle)

    def _draft(self, low: float, high: float) -> _Draft:
        """V_r of a sector, and the trunks from which U_r follow."""
        turns = self._turns(self._points_across(low, high), low, high)  # (N, C)
        values = np.einsum("a,afn->fan", self.weight, self.few) @ turns  # (F, A, C)
        values = values.reshape(len(values), -1)
        sizes, right = _right_vectors(np.vstack([values.real, values.imag]))
        terms = self._count(sizes)
        shares = right[:, :terms]
        # H of as many trunks as there are terms, chosen for being least alike, tells all U_r.
        pivots = linalg.qr(shares.T, mode="r", pivoting=True, check_finite=False)[1][:terms]
        shares = shares.reshape(len(self.radii), -1, terms) / self.weight[:, None, None]
        chosen = shares.reshape(-1, terms)[pivots]
        return _Draft(low, high, turns, pivots, chosen, self._series(shares, sizes[:terms]))

    def _enough_points(self, low: float, high: float) -> int:
        """Chebyshev points over a sector in cos φ that leave nothing of cos nφ out."""
        span = math.acos(low) - math.acos(high)
        return min(self.orders, math.ceil(0.55 * self.orders * span) + 8) + 16

    def _points_across(self, low: float, high: float) -> int:
        """Chebyshev points over a sector: of a range of radii no more than the tolerance asks for."""
        count = self._enough_points(low, high)
        if len(self.radii) == 1:
            return count
        values = self.few[np.argmax(self.radii)] @ self._turns(count, low, high)
        size = np.abs(_fit(values.T)).max(axis=1)
        return int(np.flatnonzero(size > 0.01 * self.tolerance * size.max())[-1]) + 4

    def _filters(self, draft: _Draft, columns: np.ndarray) -> np.ndarray:
        """(R, T) filters from the spectra (R, F) of the chosen trunks."""
        spectrum = np.zeros((len(columns), self.grid // 2 + 1), np.complex128)
        spectrum[:, 1:] = linalg.solve(draft.chosen, columns, check_finite=False)
        spectrum *= np.exp(-2j * math.pi * np.arange(self.grid // 2 + 1) * (self.lead / self.grid))
        whole: np.ndarray = fft.irfft(spectrum, self.grid, axis=1)[:, : self.size]
        return whole.astype(self.dtype)

    def _series(self, shares: np.ndarray, sizes: np.ndarray) -> np.ndarray:
        """(B, A, C, R) Chebyshev coefficients from the values (A, C, R) at the points."""
        across = shares.shape[1]
        series = _fit(np.moveaxis(shares, 1, 0))  # (C, A, R)
        bins, width = 1, 1
        if len(self.radii) > 1:
            turn = math.pi * self.highest * (self.thickest - self.thinnest)
            bins = math.ceil(turn / TURN)
            width = 5 + math.ceil(-math.log10(self.tolerance)) if bins > 1 else len(self.radii)
            # The series over all radii, evaluated at the points of each bin, becomes one of the bin.
            of_radii = _fit(np.moveaxis(series, 1, 0))  # (A, C, R)
            ends = np.linspace(-1.0, 1.0, bins + 1)
            points = _between(_points(width)[:, None], ends[:-1], ends[1:])  # (A', B)
            values = chebyshev.chebvander(points, len(of_radii) - 1) @ of_radii.reshape(
                len(of_radii), -1
            )
            series = _fit(values.reshape(width, bins, across, -1))
            series = np.moveaxis(series, 1, 0)  # (B, A', C, R)
        else:
            series = np.moveaxis(series, 1, 0)[None]
        # A coefficient counts by what it adds to H: V_r times the size of its U_r.
        weight = (np.abs(series) * sizes).max(axis=(0, 3))  # (A', C)
        kept = weight > 0.1 * self.tolerance * weight.max()
        rows = int(np.flatnonzero(kept.any(axis=1))[-1]) + 1
        columns = int(np.flatnonzero(kept.any(axis=0))[-1]) + 1
        assert columns <= across
        return np.ascontiguousarray(series[:, :rows, :columns], dtype=self.dtype)


@dataclass(frozen=True)
class _Draft:
    """A sector without its filters.

    turns : (N, C) cos nφ at the sector's points. pivots : (R,) numbers of the chosen trunks among all
    radii and points. chosen : (R, R) their V_r. series : of the sector.
    """

    low: float
    high: float
    turns: np.ndarray
    pivots: np.ndarray
    chosen: np.ndarray
    series: np.ndarray


def _right_vectors(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Singular values, falling, and right singular vectors (C, R) of a matrix (F, C)."""
    if values.shape[1] <= values.shape[0]:
        triangle = linalg.qr(values, mode="r", check_finite=False)[0][: values.shape[1]]
        _, sizes, right = linalg.svd(triangle, check_finite=False)
        return sizes, right.T
    # Wide: by the Gram matrix; it loses what is below 1e-8 of the largest, which no tolerance asks for
    squares, left = linalg.eigh(values @ values.T, check_finite=False)
    sizes = np.sqrt(np.maximum(squares[::-1], 0.0))
    kept = sizes > 1e-8 * sizes[0]
    return sizes[kept], values.T @ (left[:, ::-1][:, kept] / sizes[kept])


def _points(count: int) -> np.ndarray:
    """(C,) Chebyshev points of the first kind in [-1, 1]."""
    return np.cos(math.pi * (np.arange(count) + 0.5) / count)


def _between(x: np.ndarray, low: float | np.ndarray, high: float | np.ndarray) -> np.ndarray:
    """From [-1, 1] to [low, high]."""
    return low + (high - low) * (x + 1.0) / 2.0


def _fit(values: np.ndarray) -> np.ndarray:
    """Chebyshev coefficients (C, ...) of values (C, ...) at the Chebyshev points."""
    series = fft.dct(values, type=2, axis=0) / len(values)
    series[0] /= 2.0
    return series
