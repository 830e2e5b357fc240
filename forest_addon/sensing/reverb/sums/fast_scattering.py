"""The sum over trunks in milliseconds: deposit, transform, filter, and the air at the end.

Paths by trunks go in, samples come out. Trunks of a few radii are summed radius by radius and layer by layer
of frequency (``layer_sum``): in each sector of the scattering angle H(f, φ) ≈ Σ_r U_r(f)·V_r(cos φ)
(``expansion``), so that

    Σ_m w_m·e^{-ikx_m}·H(f, φ_m) ≈ Σ_r U_r(f)·Σ_m w_m·V_r(cos φ_m)·e^{-ikx_m}

and the inner sums are pulses of the heights w_m·V_r at the times x_m/c: a Kaiser-Bessel kernel spreads
them over an even grid, one sparse product for all r, and a Fourier transform follows. The air comes
after the sum over sectors, as a filter that changes in time (``air_filter``), or is in the gain of paths.
Trunks of many radii are summed by panels of frequency (``panel_sum``), where nothing has to be set up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ....base.kept import LastAsked
from ....base.progress import Progress
from ....base.rows import distinct
from ....spec import Air
from ..band import SPREAD
from ..forest.losses import Losses, loss_per_metre
from ..forest.tail import Tail
from .air_filter import AirFilter
from .audible import Audibility
from .bands import OctaveBand, bands_of, samples_of
from .expansion import expand
from .layer_sum import LayerSum
from .loud import loud_trunks
from .panel_sum import USUAL, by_distance, panel_spectrum
from .path_gain import PathGain
from .scattering import TrunkPaths, direct_sum
from .span_layer import SpanLayer, class_of

FEW_RADII = 4
KEPT_LAYERS, KEPT_AIRS, KEPT_GAINS = 24, 16, 64  # of what sums set up, for the next ones
KEPT_TAILS = 128  # pairs
MANY, LEAST_RATE = (
    4000,
    6e3,
)  # trunks of many radii, and Hz, from which on low frequencies are summed apart
THICKEST = 0.6  # m of radius
FINEST_FILTERS = (
    1e-5,
    1e-4,
)  # tolerances from which on filters serve: of air alone, and of a path's gain


@dataclass(frozen=True)
class FastSum:
    """samples : (N,). errors : {lower end of an octave in Hz: relative error of H found by checks}."""

    samples: np.ndarray
    errors: dict[float, float]


class Expansions:
    """Expansions that the fast sum has set up so far, for any number of sources and receivers."""

    def __init__(self) -> None:
        self._layers: LastAsked[tuple, list[LayerSum]] = LastAsked(KEPT_LAYERS)
        self._airs: LastAsked[tuple, AirFilter] = LastAsked(KEPT_AIRS)
        self._gains: LastAsked[tuple, PathGain] = LastAsked(KEPT_GAINS)
        self.tails: LastAsked[tuple, Tail | None] = LastAsked(KEPT_TAILS)  # of pairs

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
            return self._of_many_radii(paths, rate, count, air, tolerance, losses, progress)
        gained = self._gain(losses, rate, tolerance, whole=True) is not None
        air_filter = None if gained else self._air(rate, air, tolerance)
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
            for layer in self._set_up(radius, rate, air, tolerance, losses, gained):
                gain = self._gain(losses, rate, tolerance, whole=True, highest=layer.highest)
                total += layer.sum(some, turned, size, gain)
                for octave, error in layer.errors.items():
                    errors[octave] = max(error, errors.get(octave, 0.0))
        samples = air_filter.apply(total, -SPREAD) if air_filter else total
        samples = samples[SPREAD : SPREAD + count]
        if progress:
            progress(len(paths.length), len(paths.length))
        return FastSum(samples, errors)

    def _of_many_radii(
        self,
        paths: TrunkPaths,
        rate: float,
        count: int,
        air: Air,
        tolerance: float,
        losses: Losses | None,
        progress: Progress | None,
    ) -> FastSum:
        """High frequencies, or all of few trunks, by panels, and low ones by expansions over radii too."""
        bands = bands_of(rate, float(paths.radius.max(initial=0.0)), air.speed(), tolerance)
        low = FastSum(np.zeros(count), {})
        if _spans_serve(paths, rate, tolerance, losses):
            low = self._of_low_frequencies(
                paths, rate, count, air, tolerance, losses, _half(progress, 0)
            )
            bands, progress = bands[-1:], _half(progress, 1)
        loud = loud_trunks(paths, rate, count, air, losses)
        rest = paths.select(~loud) if loud.any() else paths
        given = rate, count, air, tolerance, losses, bands
        found = self._by_panels(rest, *given, progress)
        exact = direct_sum(paths.select(loud), rate, count, air, None, losses, tolerance, bands)
        errors = found.errors | {
            octave: max(error, found.errors.get(octave, 0.0))
            for octave, error in low.errors.items()
        }
        return FastSum(low.samples + found.samples + exact, errors)

    def _by_panels(
        self,
        paths: TrunkPaths,
        rate: float,
        count: int,
        air: Air,
        tolerance: float,
        losses: Losses | None,
        bands: tuple[OctaveBand, ...],
        progress: Progress | None = None,
    ) -> FastSum:
        speed, bark = air.speed(), losses.bark if losses else 0.0
        gain = self._gain(losses and losses.unthinned, rate, tolerance)
        errors: dict[float, float] = {}
        total = np.zeros(count)

        def loss_at(frequency: np.ndarray) -> np.ndarray:
            loss = loss_per_metre(frequency, air, losses)
            return loss if losses is None else loss + 0.5 * losses.removed(frequency)

        heard = Audibility(paths, loss_at, speed, tolerance)
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
            total += samples_of(
                spectrum, bands, rate, count, last / speed, max(first / speed, 1e-9)
            )
            done += len(rows)
            if progress:
                progress(done, len(paths.length))
        return FastSum(total, errors)

    def _of_low_frequencies(
        self,
        paths: TrunkPaths,
        rate: float,
        count: int,
        air: Air,
        tolerance: float,
        losses: Losses | None,
        progress: Progress | None,
    ) -> FastSum:
        gained = self._gain(losses, rate, tolerance, whole=True) is not None
        air_filter = None if gained else self._air(rate, air, tolerance)
        size = SPREAD + count + (max(SPREAD, air_filter.tail) if air_filter else SPREAD)
        total = np.zeros(size)
        errors: dict[float, float] = {}
        number, cosine, done = class_of(paths.radius), np.cos(paths.angle), 0
        for each in distinct(number[paths.radius > 0]).tolist():
            rows = np.flatnonzero((number == each) & (paths.radius > 0))
            layer = self._span(each, rate, air, tolerance, losses, gained)
            gain = self._gain(losses, rate, tolerance, whole=True, highest=layer.highest)
            total += layer.sum(paths.select(rows), cosine[rows], size, gain)
            for octave, error in layer.errors.items():
                errors[octave] = max(error, errors.get(octave, 0.0))
            done += len(rows)
            if progress:
                progress(done, len(paths.length))
        samples = air_filter.apply(total, -SPREAD) if air_filter else total
        return FastSum(samples[SPREAD : SPREAD + count], errors)

    def _span(
        self,
        number: int,
        rate: float,
        air: Air,
        tolerance: float,
        losses: Losses | None,
        gained: bool,
    ) -> LayerSum:
        """Of a class of radii."""
        bark = losses.bark if losses else 0.0
        key = "span", number, rate, air, tolerance, bark, gained

        def made() -> list[LayerSum]:
            layer = SpanLayer(number, rate, air.speed(), tolerance, bark)
            return [LayerSum(layer, None if gained else self._air(layer.rate, air, tolerance))]

        return self._layers.once(key, made)[0]

    def _gain(
        self,
        losses: Losses | None,
        rate: float,
        tolerance: float,
        whole: bool = False,
        highest: float = math.inf,
    ) -> PathGain | None:
        """highest : Hz, up to which it serves; inf: all."""
        if losses is None or (losses.passes and not (whole and losses.among_leaves)):
            return None
        top = min(highest, 0.5 * rate)
        key = losses, top, tolerance, whole
        return self._gains.once(key, lambda: PathGain(losses, top, tolerance, whole))

    def _air(self, rate: float, air: Air, tolerance: float) -> AirFilter:
        key = rate, air, tolerance
        return self._airs.once(key, lambda: AirFilter(rate, air, tolerance))

    def _set_up(
        self,
        radius: float,
        rate: float,
        air: Air,
        tolerance: float,
        losses: Losses | None,
        gained: bool,
    ) -> list[LayerSum]:
        """gained : the air is in the gain of paths."""
        bark = losses.bark if losses else 0.0
        key = radius, rate, air, tolerance, bark, gained

        def made() -> list[LayerSum]:
            return [
                LayerSum(layer, None if gained else self._air(layer.rate, air, tolerance))
                for layer in expand(radius, rate, air.speed(), tolerance, bark)
            ]

        return self._layers.once(key, made)


def _half(progress: Progress | None, number: int) -> Progress | None:
    """Progress of the first or the second of two parts, as of the whole; None: of none."""
    if progress is None:
        return None
    whole = progress
    return lambda done, every: whole(number * every + done, 2 * every)


def _filters_serve(tolerance: float, losses: Losses | None, radii: np.ndarray) -> bool:
    """Not where tolerances are finer, and trunks are thick."""
    if radii.max(initial=0.0) > THICKEST:
        return False
    plain = losses is None or (losses.passes and not losses.among_leaves)
    return tolerance >= FINEST_FILTERS[0 if plain else 1]


def _spans_serve(paths: TrunkPaths, rate: float, tolerance: float, losses: Losses | None) -> bool:
    """Return whether trunks are many, and low frequencies a small part of the band."""
    many = len(paths.length) >= MANY and rate >= LEAST_RATE
    return many and _filters_serve(tolerance, losses, paths.radius)
