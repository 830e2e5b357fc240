"""H of trunks of many radii at low frequencies as a short sum of products, Σ_r U_r(f)·V_r(cos φ, a).

A class of radii, of which the thickest is RATIO times the thinnest, and a sampling rate go in; sectors of the
angle come out, as of ``expansion``, whose V is a Chebyshev series of both the logarithm of the radius and
the cosine. Below CROSSOVER a trunk is at most a few wavelengths round: 10 to 25 terms do for a class where
the whole band would take 50 to 100, which is why thick and thin trunks share filters only there. H/a² is
what is expanded: relative to each trunk's own sound where it is longest, below ka = 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import fft, linalg

from ....acoustics import chebyshev
from ....acoustics.cylinder import order_count, partial_waves
from ....base.rng import stream
from .bands import SPANS, fall
from .expansion import CROSSING, CROSSOVER, FEWEST, LOW_RINGING, FilterBand
from .field_table import polynomials

THINNEST, RATIO = 0.005, 4.0  # m, of the first class; thickest over thinnest of each
HIGHS = (-0.8, 0.3, 1.0)  # upper ends in cos φ of the sectors
SHARE = 0.03  # of the tolerance, for leaving out terms
CHECKED = 24  # trunks of a sector at which it is checked


def class_of(radius: np.ndarray) -> np.ndarray:
    """Number of the class of radii (M,)."""
    found: np.ndarray = np.floor(np.log(np.maximum(radius, 1e-6) / THINNEST) / math.log(RATIO))
    return found.astype(np.int64)


@dataclass(frozen=True)
class SpanSector:
    """Scattering angles with ``low`` < cos φ <= ``high`` and radii from ``thin`` to ``thick``.

    filters : (R, T) of the terms, the arrival by the axis at sample ``lead``. series : (A, C, R) Chebyshev
    coefficients of V_r/a² over the logarithm of the radius and the cosine. errors : as of ``Sector``.
    """

    low: float
    high: float
    thin: float
    thick: float
    filters: np.ndarray
    series: np.ndarray
    lead: int
    errors: dict[float, float]

    @property
    def terms(self) -> int:
        """Return how many products."""
        return len(self.filters)

    def shares(self, cosine: np.ndarray, radius: np.ndarray) -> np.ndarray:
        """(M, R) V_r at cosines and radii (M,)."""
        turned = (cosine - self.low) * (2.0 / (self.high - self.low)) - 1.0
        place = 2.0 * np.log(radius / self.thin) / math.log(self.thick / self.thin) - 1.0
        radii, cosines, terms = self.series.shape
        both = polynomials(place, radii)[:, None] * polynomials(turned, cosines)[None]
        found = both.reshape(radii * cosines, -1).T @ self.series.reshape(-1, terms)
        return np.asarray(found * np.square(radius)[:, None])


class SpanLayer(FilterBand):
    """The low layer of a class of radii. highs : as of ``ExpansionLayer``."""

    def __init__(
        self, number: int, rate: float, speed: float, tolerance: float, bark: float = 0.0
    ) -> None:
        """number : of the class of radii."""
        self.thin = THINNEST * RATIO**number
        self.thick = self.thin * RATIO
        span = CROSSING + 2.0 * self.thick / speed, LOW_RINGING + CROSSING
        step = int(rate / (2.5 * CROSSOVER[1]))
        super().__init__(rate, step, speed, tolerance, span, lambda f: fall(f, SPANS[-1]), bark)
        self.highs = np.array(HIGHS)
        self._sectors: dict[int, SpanSector] = {}

    def sector(self, number: int) -> SpanSector:
        """One of the sectors; made once."""
        if number not in self._sectors:
            low = -1.0 if number == 0 else float(self.highs[number - 1])
            self._sectors[number] = self._sector(low, float(self.highs[number]))
        return self._sectors[number]

    def _sector(self, low: float, high: float) -> SpanSector:
        size = 2.0 * math.pi / self.speed * self.highest * self.thick
        radii = 10 + math.ceil(2.0 * size)
        cosines = 8 + math.ceil(0.7 * size * (math.acos(low) - math.acos(high)))
        place = 0.5 * (chebyshev.points(radii) + 1.0)
        radius = self.thin * (self.thick / self.thin) ** place
        cosine = low + 0.5 * (high - low) * (chebyshev.points(cosines) + 1.0)
        rows = self.few_rows(FEWEST)
        few = np.array([self._levelled(a, cosine, rows) for a in radius])  # (A, F, C)
        few = few.transpose(1, 0, 2).reshape(len(rows), -1)
        weight = np.sqrt(np.gradient(np.log(self.frequency[rows]))) * self.gain[rows]
        weight /= np.sqrt(np.mean(np.square(np.abs(few)), axis=1))
        few *= weight[:, None]
        stacked = np.vstack([few.real, few.imag])
        _, sizes, right = linalg.svd(stacked, full_matrices=False, check_finite=False)
        rest = np.sqrt(np.cumsum(np.square(sizes)[::-1])[::-1])
        terms = max(1, int(np.count_nonzero(rest > SHARE * self.tolerance * rest[0])))
        shares = right[:terms].T  # (A·C, R)
        # H at as many trunks as there are terms, chosen for being least alike, tells all U_r
        pivots = linalg.qr(shares.T, mode="r", pivoting=True, check_finite=False)[1][:terms]
        every = np.arange(len(self.frequency))
        columns = np.empty((terms, len(every)), np.complex128)
        for a in np.unique(pivots // cosines).tolist():
            here = np.flatnonzero(pivots // cosines == a)
            at = cosine[pivots[here] % cosines]
            columns[here] = (self._levelled(radius[a], at, every) * self.gain[:, None]).T
        spectra = linalg.solve(shares[pivots], columns, check_finite=False)
        series = shares.reshape(radii, cosines, terms)
        for axis in range(2):
            series = fft.dct(np.flip(series, axis), type=2, axis=axis) / series.shape[axis]
            series[(slice(None),) * axis + (0,)] *= 0.5
        large = np.abs(series * sizes[:terms]).max(axis=2)
        large = large > 0.003 * self.tolerance * large.max()
        radii, cosines = (int(np.flatnonzero(large.any(axis=1 - n))[-1]) + 1 for n in range(2))
        series = np.ascontiguousarray(series[:radii, :cosines])
        found = SpanSector(
            low, high, self.thin, self.thick, self.filters(spectra), series, self.lead, {}
        )
        rng = stream(radii, "span", "checks")
        some = rng.uniform(low, high, CHECKED)
        sizes_of = self.thin * (self.thick / self.thin) ** rng.random(CHECKED)
        given = found.shares(some, sizes_of), some, sizes_of
        found.errors.update(self.errors(found.filters, *given))
        return found

    def _levelled(self, radius: float, cosine: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """(F, C) H/a² at some of the frequencies, up to the last that has a gain; 0 beyond."""
        wavenumber = self.wavenumber[rows]
        used = wavenumber <= 2.0 * math.pi / self.speed * self.highest
        wavenumber = wavenumber[used]
        size = wavenumber * radius
        waves = partial_waves(size, order_count(float(size.max())), self.bark)
        waves[1:] *= 2.0
        waves *= np.exp(0.25j * math.pi) * np.sqrt(2.0 / (math.pi * wavenumber)) / radius**2
        turns = np.cos(np.outer(np.arange(len(waves)), np.arccos(np.clip(cosine, -1.0, 1.0))))
        found = np.zeros((len(rows), len(cosine)), np.complex128)
        found[used] = np.conj(waves).T @ turns
        return found
