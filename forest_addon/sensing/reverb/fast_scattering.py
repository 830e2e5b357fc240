"""The sum over trunks in milliseconds: deposit, transform, filter, and the air at the end.

Paths by trunks go in, samples come out. In each sector of the scattering angle,
H(f, φ, a) ≈ Σ_r U_r(f)·V_r(cos φ, a) (``expansion``), so that

    Σ_m w_m·e^{-ikx_m}·H(f, φ_m, a_m) ≈ Σ_r U_r(f)·Σ_m w_m·V_r(cos φ_m, a_m)·e^{-ikx_m}

and the inner sums are pulses of the heights w_m·V_r at the times x_m/c: a Kaiser-Bessel kernel spreads
them over an even grid, one sparse product for all r, and a Fourier transform follows. The air comes
after the sum over sectors, as a filter that changes in time (``air_filter``).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy import fft, sparse

from ...acoustics.kaiser_bessel import OVERSAMPLING, Kernel
from ...spec import Air
from .air_filter import AirFilter
from .expansion import Key, Layer, Store, expand, precision
from .scattering import SPREAD, TrunkPaths

TRUNKS_AT_ONCE, HEIGHTS_AT_ONCE = 32768, 1 << 20  # at least so many trunks; so many heights
GRID_AT_ONCE = 1 << 24  # values of the even grid, of as many terms as that allows
MOST_KEPT = 1 << 28  # bytes of filters that a layer keeps as spectra
FEW_RADII = 4
WIDEST = 256.0  # thickest over thinnest radius of an expansion
BESIDE = 64  # samples of a low layer that are kept before and after the record


class Expansions:
    """What the fast sum has set up so far, for any number of sources and receivers.

    store : keeps expansions from one run to the next; None: they are computed anew.
    """

    def __init__(self, store: Store | None = None) -> None:
        self.store = store
        self._layers: dict[tuple[Key, Air], list[_LayerSum]] = {}
        self._airs: dict[tuple[float, Air, float], AirFilter] = {}

    def sum(
        self, paths: TrunkPaths, rate: float, count: int, air: Air, tolerance: float
    ) -> np.ndarray:
        """(count,) samples at ``rate`` Hz, sample 0 when the source sounds.

        Few different radii have an expansion each, more of them share one.
        """
        size = SPREAD + count + SPREAD
        total = np.zeros(size)
        cosine = np.cos(paths.angle)
        for rows, key in _groups(paths.radius, rate, air.speed(), tolerance):
            some, turned = paths.select(rows), cosine[rows]
            for layer in self._set_up(key, air):
                total += layer.sum(some, turned, size)
        air_filter = self._airs.setdefault((rate, air, tolerance), AirFilter(rate, air, tolerance))
        total = total.astype(precision(tolerance))
        return air_filter.apply(total, -SPREAD)[SPREAD:-SPREAD].astype(np.float64)

    def _set_up(self, key: Key, air: Air) -> list[_LayerSum]:
        if (key, air) not in self._layers:
            layers = self.store.load(key) if self.store else None
            if layers is None:
                layers = expand(key)
                if self.store:
                    self.store.save(key, layers)
            self._layers[key, air] = [_LayerSum(layer, key, air) for layer in layers]
        return self._layers[key, air]


def _groups(
    radius: np.ndarray, rate: float, speed: float, tolerance: float
) -> Iterator[tuple[np.ndarray | slice, Key]]:
    """Rows of trunks that share an expansion, and its key. A trunk of no width scatters nothing."""
    if len(radius) and radius.min() == radius.max() > 0:
        only = float(radius[0])
        yield slice(None), Key(rate, only, only, speed, tolerance)
        return
    different = np.unique(radius[radius > 0]).tolist()
    if len(different) <= FEW_RADII:
        for each in different:
            yield radius == each, Key(rate, each, each, speed, tolerance)
    else:
        # Rounded outwards, so that an expansion serves other stands as well.
        thickest = 2.0 ** (math.ceil(4.0 * math.log2(different[-1])) / 4.0)
        thinnest = 2.0 ** (math.floor(2.0 * math.log2(different[0])) / 2.0)
        key = Key(rate, max(thinnest, thickest / WIDEST), thickest, speed, tolerance)
        yield radius >= key.thinnest, key
        if thinnest < key.thinnest:
            yield (
                (radius > 0) & (radius < key.thinnest),
                key._replace(thinnest=thinnest, thickest=key.thinnest),
            )


class _LayerSum:
    """The sum over one layer's sectors, before the air.

    Filters are kept as spectra for each length of transform that was needed, up to MOST_KEPT.
    """

    def __init__(self, layer: Layer, key: Key, air: Air) -> None:
        self.step, self.rate, self.speed = layer.step, key.rate / layer.step, key.speed
        self.radii = key.thinnest, key.thickest
        self.kernel = Kernel.for_tolerance(key.tolerance)
        self.dtype = precision(key.tolerance)
        losing = AirFilter(self.rate, air, key.tolerance)
        self.sectors = [
            replace(sector, filters=losing.undone(sector.filters, sector.lead))
            for sector in layer.sectors
        ]
        self._spectra: dict[tuple[int, int], np.ndarray] = {}

    def sum(self, paths: TrunkPaths, cosine: np.ndarray, count: int) -> np.ndarray:
        """(count,) samples at the full rate, sample SPREAD when the source sounds."""
        first = -(SPREAD // self.step) - BESIDE * (self.step > 1)
        last = -(-(count - SPREAD) // self.step) + BESIDE * (self.step > 1)
        total: np.ndarray = np.zeros(last - first, self.dtype)
        left: np.ndarray | slice = slice(None)  # trunks of the sectors to come
        for number, sector in enumerate(self.sectors):
            within = cosine[left] <= sector.high
            if within.all():
                rows, left = left, np.empty(0, np.int64)
            else:
                numbers = np.arange(len(cosine))[left]
                rows, left = numbers[within], numbers[~within]
            some, turned = paths.select(rows), cosine[rows]
            if len(turned):
                start, part = self._sector_sum(number, some, turned)
                _add(total, part, start - first)
        if self.step == 1:
            return total
        skipped = -SPREAD - first * self.step
        return _upsampled(total, self.step)[skipped : skipped + count]

    def _sector_sum(
        self, number: int, paths: TrunkPaths, cosine: np.ndarray
    ) -> tuple[int, np.ndarray]:
        """First sample and samples of one sector's trunks."""
        sector, width = self.sectors[number], self.kernel.width
        place = paths.length * (self.rate / self.speed)
        base = int(place.min()) - width
        span = int(place.max()) - base + width + 2 + sector.filters.shape[1]
        size = transform_size(span)
        place -= base
        place *= OVERSAMPLING
        angular = (cosine - sector.low) * (2.0 / (sector.high - sector.low)) - 1.0
        radial, filters = self._radial(paths.radius), self._filter_spectra(number, size)
        total = np.zeros(size // 2 + 1, filters.dtype)
        several = max(8, GRID_AT_ONCE // (size * OVERSAMPLING))
        for first in range(0, sector.terms, several):
            terms = slice(first, first + several)
            series = sector.series[..., terms]
            grid: np.ndarray = np.zeros((size * OVERSAMPLING, series.shape[-1]), self.dtype)
            for rows, heights in _heights(series, angular, radial, paths.weight):
                grid += self._deposit(place[rows], heights, len(grid))
            spectra = fft.rfft(grid.T.copy(), axis=1)[:, : size // 2 + 1]
            spectra *= filters[terms]
            total += spectra.sum(axis=0)
        return base - sector.lead, fft.irfft(total, size)

    def _radial(self, radius: np.ndarray) -> np.ndarray:
        """Radii from 0, the thinnest, to 1, the thickest."""
        thinnest, thickest = self.radii
        if thinnest == thickest:
            return np.zeros(1)
        share: np.ndarray = np.clip((radius - thinnest) / (thickest - thinnest), 0.0, 1.0)
        return share

    def _deposit(self, place: np.ndarray, heights: np.ndarray, size: int) -> np.ndarray:
        """(size, R) pulses of the heights (N, R) at grid places (N,)."""
        first, taps = self.kernel.spread(place, self.dtype)
        width = self.kernel.width
        rows = first[:, None] + np.arange(width, dtype=np.int32)
        ends = np.arange(0, rows.size + 1, width, dtype=np.int32)
        spread = sparse.csc_array((taps.T.ravel(), rows.ravel(), ends), shape=(size, len(place)))
        return spread @ heights

    def _filter_spectra(self, number: int, size: int) -> np.ndarray:
        """(R, size // 2 + 1) filters of a sector over the kernel's transform."""
        if (number, size) in self._spectra:
            return self._spectra[number, size]
        spectra = fft.rfft(self.sectors[number].filters, size, axis=1)
        of_kernel = self.kernel.transform(np.arange(size // 2 + 1) / (size * OVERSAMPLING))
        spectra /= of_kernel.astype(self.dtype)
        if sum(each.nbytes for each in self._spectra.values()) + spectra.nbytes < MOST_KEPT:
            self._spectra[number, size] = spectra
        return spectra


def _heights(
    series: np.ndarray, angular: np.ndarray, radial: np.ndarray, weight: np.ndarray
) -> Iterator[tuple[np.ndarray | slice, np.ndarray]]:
    """Rows of several trunks at once, and the heights (N, R) of their pulses.

    series : (B, A, C, R) of a sector. angular : (N,) in [-1, 1]. radial : (N,) in [0, 1].
    """
    bins, across_bin, across_sector, terms = series.shape
    dtype = series.dtype
    several = max(TRUNKS_AT_ONCE, HEIGHTS_AT_ONCE // terms)
    if bins * across_bin == 1:
        for start in range(0, len(angular), several):
            piece = slice(start, start + several)
            in_sector = _chebyshev(angular[piece], across_sector, dtype, weight[piece])
            yield piece, in_sector.T @ series[0, 0]
        return
    place = radial * bins
    bin_of = np.minimum(place.astype(np.int64), bins - 1)
    by_bin = np.argsort(bin_of, kind="stable")
    for start in range(0, len(by_bin), several):
        some = by_bin[start : start + several]
        ends = np.searchsorted(bin_of[some], np.arange(bins + 1))
        heights = np.empty((len(some), terms), dtype)
        for number in np.flatnonzero(np.diff(ends)):
            here = slice(ends[number], ends[number + 1])
            rows = some[here]
            in_bin = _chebyshev(2.0 * (place[rows] - number) - 1.0, across_bin, dtype)
            in_sector = _chebyshev(angular[rows], across_sector, dtype, weight[rows])
            products = (in_bin[:, None] * in_sector).reshape(-1, len(rows))
            heights[here] = products.T @ series[number].reshape(-1, terms)
        yield some, heights


def _chebyshev(
    x: np.ndarray, count: int, dtype: np.dtype, scale: np.ndarray | float = 1.0
) -> np.ndarray:
    """(count, N) Chebyshev polynomials at x (N,), times a scale."""
    x = x.astype(dtype)
    values = np.empty((count, len(x)), dtype)
    values[0] = scale
    if count > 1:
        np.multiply(x, values[0], out=values[1])
    x *= 2
    for n in range(2, count):
        np.multiply(x, values[n - 1], out=values[n])
        values[n] -= values[n - 2]
    return values


def transform_size(least: int) -> int:
    """One of a few lengths of transform, so that their filters are used again."""
    step = 1 << max(0, least.bit_length() - 4)
    return 2 * fft.next_fast_len(-(-least // step) * step // 2 + 1, real=True)


def _upsampled(samples: np.ndarray, step: int) -> np.ndarray:
    """(N·step,) samples at ``step`` times the rate; the band has nothing at its old end."""
    size = fft.next_fast_len(len(samples) + BESIDE, real=True)
    spectrum = fft.rfft(samples, size)
    wide = np.zeros(size * step // 2 + 1, spectrum.dtype)
    wide[: len(spectrum)] = spectrum
    whole: np.ndarray = fft.irfft(wide, size * step)
    return whole[: len(samples) * step]


def _add(total: np.ndarray, part: np.ndarray, start: int) -> None:
    """Add a part that starts at a sample, which may be negative; what does not fit is left out."""
    first, last = max(0, -start), min(len(part), len(total) - start)
    if last > first:
        total[start + first : start + last] += part[first:last]
