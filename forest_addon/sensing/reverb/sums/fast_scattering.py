"""The sum over trunks in milliseconds: deposit, transform, filter, and the air at the end.

Paths by trunks go in, samples come out. Trunks of a few radii are summed radius by radius: in each sector
of the scattering angle H(f, φ) ≈ Σ_r U_r(f)·V_r(cos φ) (``expansion``), so that

    Σ_m w_m·e^{-ikx_m}·H(f, φ_m) ≈ Σ_r U_r(f)·Σ_m w_m·V_r(cos φ_m)·e^{-ikx_m}

and the inner sums are pulses of the heights w_m·V_r at the times x_m/c: a Kaiser-Bessel kernel spreads
them over an even grid, one sparse product for all r, and a Fourier transform follows. The air comes
after the sum over sectors, as a filter that changes in time (``air_filter``). Trunks of many radii are
summed by panels of frequency (``panel_sum``), where nothing has to be set up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import fft, sparse

from ....acoustics.kaiser_bessel import OVERSAMPLING, Kernel
from ....base.progress import Progress
from ....spec import Air
from ..band import SPREAD, roll_off
from ..forest.losses import Losses, loss_per_metre
from ..forest.tail import Tail
from .air_filter import AirFilter
from .audible import Audibility
from .bands import bands_of, samples_of
from .expansion import ExpansionLayer, expand
from .loud import loud_trunks
from .panel_sum import USUAL, by_distance, panel_spectrum
from .path_gain import PathGain, Zone
from .scattering import TrunkPaths, direct_sum

TRUNKS_AT_ONCE = 65536
GRID_AT_ONCE = 1 << 23  # values of the even grid, of as many terms as that allows
MOST_KEPT = 1 << 27  # bytes of filters that a layer keeps as spectra
FEW_RADII = 4
THICKEST = 0.6  # m of radius
FINEST_FILTERS = (
    1e-5,
    1e-4,
)  # tolerances from which on filters serve: of air alone, and of a path's gain
SINGLE = 1e-4  # from this tolerance on, single precision does; not where seconds of filters are
RINGING = 0.02  # s by which a gain of frequency spreads an arrival to both sides
UNHEARD = 1e-5  # of the loudest frequency: where a layer has nothing but rounding
LEAST = 0.3  # of the tolerance: products of a zone that are smaller at all frequencies are left out
SEEN = 4  # every so many frequencies of a transform tell how large a product is
BESIDE = 160  # samples of a low layer before and after the record; they fade out


@dataclass(frozen=True)
class FastSum:
    """samples : (N,). errors : {lower end of an octave in Hz: relative error of H found by checks}."""

    samples: np.ndarray
    errors: dict[float, float]


class Expansions:
    """Expansions that the fast sum has set up so far, for any number of sources and receivers."""

    def __init__(self) -> None:
        self._layers: dict[tuple, list[_LayerSum]] = {}
        self._airs: dict[tuple, AirFilter] = {}
        self._gains: dict[tuple, PathGain] = {}
        self.tails: dict[tuple, Tail | None] = {}  # of pairs

    def sum(
        self,
        paths: TrunkPaths,
        rate: float,
        count: int,
        air: Air,
        tolerance: float,
        losses: Losses | None = None,
        progress: Progress | None = None,
    ) -> FastSum:
        """(count,) samples at ``rate`` Hz, sample 0 when the source sounds.

        losses : of paths, besides what the air takes; None: nothing.
        progress : called as progress(trunks done, all trunks); of many radii in parts of the work.
        """
        alike = len(paths.radius) > 0 and paths.radius.min() == paths.radius.max() > 0
        different = paths.radius[:1] if alike else np.unique(paths.radius[paths.radius > 0])
        if len(different) > FEW_RADII or not _filters_serve(tolerance, losses, different):
            unthinned = self._gain(losses and losses.unthinned, rate, tolerance)
            loud = loud_trunks(paths, rate, count, air, losses)
            rest = paths.select(~loud) if loud.any() else paths
            found = _by_panels(rest, rate, count, air, tolerance, losses, unthinned, progress)
            exact = direct_sum(paths.select(loud), rate, count, air, None, losses, tolerance)
            return FastSum(found.samples + exact, found.errors)
        gain = self._gain(losses, rate, tolerance, whole=True)
        air_filter = None if gain else self._air(rate, air, tolerance)
        size = SPREAD + count + (max(SPREAD, air_filter.tail) if air_filter else SPREAD)
        total = np.zeros(size)
        cosine, done = np.cos(paths.angle), 0
        errors: dict[float, float] = {}
        for radius in different.tolist():
            rows = slice(None) if alike else paths.radius == radius
            some, turned = paths.select(rows), cosine[rows]
            if progress:
                progress(done, len(paths.length))
            done += len(turned)
            for layer in self._set_up(radius, rate, air, tolerance, losses, air_filter is None):
                total += layer.sum(some, turned, size, gain)
                for octave, error in layer.errors.items():
                    errors[octave] = max(error, errors.get(octave, 0.0))
        samples = air_filter.apply(total, -SPREAD) if air_filter else total
        samples = samples[SPREAD : SPREAD + count]
        if progress:
            progress(len(paths.length), len(paths.length))
        return FastSum(samples, errors)

    def _gain(
        self, losses: Losses | None, rate: float, tolerance: float, whole: bool = False
    ) -> PathGain | None:
        if losses is None or (losses.passes and not (whole and losses.among_leaves)):
            return None
        key = losses, rate, tolerance, whole
        if key not in self._gains:
            self._gains[key] = PathGain(losses, 0.5 * rate, tolerance, whole)
        return self._gains[key]

    def _air(self, rate: float, air: Air, tolerance: float) -> AirFilter:
        key = rate, air, tolerance
        if key not in self._airs:
            self._airs[key] = AirFilter(rate, air, tolerance)
        return self._airs[key]

    def _set_up(
        self,
        radius: float,
        rate: float,
        air: Air,
        tolerance: float,
        losses: Losses | None,
        gained: bool,
    ) -> list[_LayerSum]:
        """gained : the air is in the gain of paths."""
        bark = losses.bark if losses else 0.0
        key = radius, rate, air, tolerance, bark, gained
        if key not in self._layers:
            self._layers[key] = [
                _LayerSum(layer, None if gained else self._air(layer.rate, air, tolerance))
                for layer in expand(radius, rate, air.speed(), tolerance, bark)
            ]
        return self._layers[key]


def _filters_serve(tolerance: float, losses: Losses | None, radii: np.ndarray) -> bool:
    """Not where tolerances are finer, and trunks are thick."""
    if radii.max(initial=0.0) > THICKEST:
        return False
    plain = losses is None or (losses.passes and not losses.among_leaves)
    return tolerance >= FINEST_FILTERS[0 if plain else 1]


def _by_panels(
    paths: TrunkPaths,
    rate: float,
    count: int,
    air: Air,
    tolerance: float,
    losses: Losses | None,
    gain: PathGain | None,
    progress: Progress | None = None,
) -> FastSum:
    speed, bark = air.speed(), losses.bark if losses else 0.0
    errors: dict[float, float] = {}
    total = np.zeros(count)

    def loss_at(frequency: np.ndarray) -> np.ndarray:
        loss = loss_per_metre(frequency, air, losses)
        return loss if losses is None else loss + 0.5 * losses.removed(frequency)

    heard = Audibility(paths, loss_at, speed, tolerance)
    bands = bands_of(rate, float(paths.radius.max(initial=0.0)), speed, tolerance)
    lost, done = float(loss_at(np.array([USUAL]))[0]), 0
    for rows in by_distance(paths.length, gain, lost):
        some = paths.select(rows)

        def spectrum(
            spacing: float, lowest: int, highest: int, some: TrunkPaths = some
        ) -> np.ndarray:
            found, checks = panel_spectrum(
                some, spacing, highest + 1, loss_at, speed, tolerance, gain, bark, lowest, heard
            )
            for check in checks:
                octave = 20.0 * 2.0 ** math.floor(math.log2(check.frequency / 20.0))
                if octave >= 20.0:
                    errors[octave] = max(check.error, errors.get(octave, 0.0))
            return found

        first, last = float(some.earliest.min()), float(some.length.max())
        total += samples_of(spectrum, bands, rate, count, last / speed, max(first / speed, 1e-9))
        done += len(rows)
        if progress:
            progress(done, len(paths.length))
    return FastSum(total, errors)


class _LayerSum:
    """The sum over one layer's sectors, before the air.

    Filters are kept as spectra for each length of transform that was needed, up to MOST_KEPT.
    """

    def __init__(self, layer: ExpansionLayer, air: AirFilter | None) -> None:
        self.layer, self.air = layer, air
        self.step, self.rate, self.speed = layer.step, layer.rate, layer.speed
        self.dtype = np.float32 if layer.tolerance >= SINGLE and layer.lowest > 0 else np.float64
        self.kernel = Kernel.for_tolerance(0.3 * layer.tolerance)
        self.errors: dict[float, float] = {}
        self._filters: dict[int, np.ndarray] = {}
        self._spectra: dict[tuple, tuple[np.ndarray, np.ndarray]] = {}

    def sum(
        self, paths: TrunkPaths, cosine: np.ndarray, count: int, gain: PathGain | None = None
    ) -> np.ndarray:
        """(count,) samples at the full rate, sample SPREAD when the source sounds."""
        first = -(SPREAD // self.step) - BESIDE * (self.step > 1)
        last = -(-(count - SPREAD) // self.step) + BESIDE * (self.step > 1)
        total: np.ndarray = np.zeros(last - first)
        sector_of = np.searchsorted(self.layer.highs, cosine)
        for number in np.flatnonzero(np.bincount(sector_of)).tolist():
            rows = np.flatnonzero(sector_of == number)
            if gain is None:
                start, part = self._sector_sum(number, paths.select(rows), cosine[rows])
                _add(total, part, start - first)
                continue
            of_sector = paths.select(rows)
            for zone, near in gain.zones(of_sector.length):
                some = of_sector.select(near)
                start, part = self._sector_sum(number, some, cosine[rows[near]], gain, zone)
                _add(total, part, start - first)
        if self.step == 1:
            return total
        skipped = -SPREAD - first * self.step
        return _upsampled(total, self.step)[skipped : skipped + count]

    def _sector_sum(
        self,
        number: int,
        paths: TrunkPaths,
        cosine: np.ndarray,
        gain: PathGain | None = None,
        zone: Zone | None = None,
    ) -> tuple[int, np.ndarray]:
        """First sample and samples of one sector's trunks, in one zone of their gain."""
        sector, width = self.layer.sector(number), self.kernel.width
        for octave, error in sector.errors.items():
            self.errors[octave] = max(error, self.errors.get(octave, 0.0))
        place = paths.length * (self.rate / self.speed)
        if zone is not None and zone.rise > 0:
            place += Losses.detour(paths.length, zone.rise) * (self.rate / self.speed)
        beside = 0 if zone is None else math.ceil(RINGING * self.rate)
        base = int(place.min()) - width - beside
        span = int(place.max()) - base + width + 2 + sector.filters.shape[1] + beside
        size = transform_size(span)
        place -= base
        place *= OVERSAMPLING
        filters, kept = self._filter_spectra(number, size, gain, zone)
        total = np.zeros(size // 2 + 1, filters.dtype)
        several = max(4, GRID_AT_ONCE // (size * OVERSAMPLING))
        for first in range(0, len(filters), several):
            terms = slice(first, first + several)
            grid = np.zeros((size * OVERSAMPLING, len(filters[terms])), self.dtype)
            for start in range(0, len(cosine), TRUNKS_AT_ONCE):
                some = slice(start, start + TRUNKS_AT_ONCE)
                heights = sector.shares(cosine[some]) * paths.weight[some, None]
                if zone is not None:
                    basis = zone.polynomials(paths.length[some])
                    pairs = np.divmod(kept[terms], basis.shape[1])
                    heights = heights[:, pairs[0]] * basis[:, pairs[1]]
                else:
                    heights = heights[:, terms]
                heights = heights.astype(self.dtype)
                grid += self._deposit(place[some], heights, len(grid))
            spectra = fft.rfft(grid.T.copy(), axis=1)[:, : size // 2 + 1]
            spectra *= filters[terms]
            total += spectra.sum(axis=0)
        return base - sector.lead, fft.irfft(total, size)

    def _deposit(self, place: np.ndarray, heights: np.ndarray, size: int) -> np.ndarray:
        """(size, R) pulses of the heights (N, R) at grid places (N,)."""
        first, taps = self.kernel.spread(place, self.dtype)
        width = self.kernel.width
        rows = first[:, None] + np.arange(width, dtype=np.int32)
        ends = np.arange(0, rows.size + 1, width, dtype=np.int32)
        spread = sparse.csc_array((taps.T.ravel(), rows.ravel(), ends), shape=(size, len(place)))
        return spread @ heights

    def _filter_spectra(
        self, number: int, size: int, gain: PathGain | None, zone: Zone | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """(K, size // 2 + 1) filters of a sector over the kernel's transform, and which terms they are of.

        In a zone of a gain, of those of the R·Q products that the tolerance needs.
        """
        key = number, size, gain and gain.losses, zone and (zone.low, zone.rise)
        if key in self._spectra:
            return self._spectra[key]
        if number not in self._filters:
            sector = self.layer.sector(number)
            found = sector.filters
            if self.air is not None:
                found = self.air.undone(found, sector.lead)
            self._filters[number] = found
        spectra = fft.rfft(self._filters[number], size, axis=1)
        spectra[:, : math.floor(self.layer.lowest * size / self.rate)] = 0.0
        spectra /= self.kernel.transform(np.arange(size // 2 + 1) / (size * OVERSAMPLING))
        kept = np.arange(len(spectra))
        if gain is not None and zone is not None:
            gains = gain.filters(zone, np.arange(size // 2 + 1) * (self.rate / size))
            share = np.abs(spectra[:, None, ::SEEN]) * np.abs(gains[:, ::SEEN])
            share = share.reshape(-1, share.shape[-1])
            share /= np.maximum(share.max(axis=0), UNHEARD * share.max() + 1e-300)
            kept = np.flatnonzero(share.max(axis=1) > LEAST * self.layer.tolerance)
            first, second = np.divmod(kept, len(gains))
            spectra = spectra[first] * gains[second]
        spectra = spectra.astype(np.result_type(self.dtype, np.complex64), copy=False)
        if sum(each.nbytes for each, _ in self._spectra.values()) + spectra.nbytes < MOST_KEPT:
            self._spectra[key] = spectra, kept
        return spectra, kept


def transform_size(least: int) -> int:
    """One of a few lengths of transform, so that their filters are used again."""
    step = 1 << max(0, least.bit_length() - 4)
    return 2 * fft.next_fast_len(-(-least // step) * step // 2 + 1, real=True)


def _upsampled(samples: np.ndarray, step: int) -> np.ndarray:
    """(N·step,) samples at ``step`` times the rate; the band has nothing at its old end."""
    fade = roll_off(0.45 + 0.05 * np.arange(BESIDE) / BESIDE)
    samples[:BESIDE] *= fade[::-1]
    samples[-BESIDE:] *= fade
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
