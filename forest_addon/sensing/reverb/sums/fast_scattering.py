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
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ....base.kept import LastAsked
from ....base.progress import Progress
from ....spec import Air
from ..band import SPREAD
from ..forest.losses import Losses, loss_per_metre
from ..forest.tail import Tail
from .air_filter import AirFilter
from .bands import bands_of, samples_of
from .expansion import expand
from .layer_sum import LayerSum
from .loud import loud_trunks, unheard, whole_energy
from .panel_sum import USUAL, by_distance, panel_spectrum
from .path_gain import PathGain
from .scattering import TrunkPaths, direct_sum

FEW_RADII = 4
KEPT_LAYERS, KEPT_AIRS, KEPT_GAINS = 24, 16, 64  # of what sums set up, for the next ones
KEPT_TAILS = 128  # pairs
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
        """By panels of frequency, but for loud trunks, which are summed exactly."""
        speed, bark = air.speed(), losses.bark if losses else 0.0
        bands = bands_of(rate, float(paths.radius.max(initial=0.0)), speed, tolerance)

        def loss_at(frequency: np.ndarray) -> np.ndarray:
            loss = loss_per_metre(frequency, air, losses)
            return loss if losses is None else loss + 0.5 * losses.removed(frequency)

        loud = loud_trunks(paths, rate, count, loss_at, speed)
        total = direct_sum(paths.select(loud), rate, count, air, None, losses, tolerance, bands)
        rest = paths.select(~loud) if loud.any() else paths
        gain = self._gain(losses and losses.unthinned, rate, tolerance)
        errors: dict[float, float] = {}
        whole = whole_energy(paths, loss_at, speed)
        done = 0
        for band in bands:
            usual = min(USUAL, band.high[0]) if band.high else USUAL
            lost = float(loss_at(np.array([usual]))[0])
            for rows in by_distance(rest.length, gain, lost):
                some = rest.select(rows)

                def heard(low: float, high: float, some: TrunkPaths = some) -> bool:
                    return not unheard(some, (low, high), whole, loss_at, speed, tolerance)

                def spectrum(
                    spacing: float,
                    lowest: int,
                    highest: int,
                    some: TrunkPaths = some,
                    heard: Callable[[float, float], bool] = heard,
                ) -> np.ndarray:
                    found, checks = panel_spectrum(
                        some,
                        spacing,
                        highest + 1,
                        loss_at,
                        speed,
                        tolerance,
                        gain,
                        bark,
                        lowest,
                        heard,
                    )
                    for check in checks:
                        octave = 20.0 * 2.0 ** math.floor(math.log2(check.frequency / 20.0))
                        if octave >= 20.0:
                            errors[octave] = max(check.error, errors.get(octave, 0.0))
                    return found

                first, last = float(some.earliest.min()), float(some.length.max())
                total += samples_of(
                    spectrum, (band,), rate, count, last / speed, max(first / speed, 1e-9)
                )
                done += len(rows)
                if progress:
                    progress(done, len(bands) * len(rest.length))
        return FastSum(total, errors)

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


def _filters_serve(tolerance: float, losses: Losses | None, radii: np.ndarray) -> bool:
    """Not where tolerances are finer, and trunks are thick."""
    if radii.max(initial=0.0) > THICKEST:
        return False
    plain = losses is None or (losses.passes and not losses.among_leaves)
    return tolerance >= FINEST_FILTERS[0 if plain else 1]
