"""The sum over trunks in milliseconds: deposit, transform, filter, and the air at the end.

Paths by trunks go in, samples come out. Trunks of a few radii are summed radius by radius and layer by layer
of frequency (``layer_sum``): in each sector of the scattering angle H(f, φ) ≈ Σ_r U_r(f)·V_r(cos φ), so that

    Σ_m w_m·e^{-ikx_m}·H(f, φ_m) ≈ Σ_r U_r(f)·Σ_m w_m·V_r(cos φ_m)·e^{-ikx_m}

and the inner sums are pulses of the heights w_m·V_r at the times x_m/c: of many trunks, a Kaiser-Bessel
kernel spreads them over an even grid, and a transform follows; few are summed as samples. The air comes
after the sum over sectors, as a filter that changes in time (``path_gain``), or is in the gain of paths.
Trunks of many radii are summed by panels of frequency (``panel_sum``), where nothing has to be set up.

Trunks that are heard above all others of a record, and those that nothing of it would miss.

A fast sum's error of a trunk is a share of that trunk's sound, and is spread over the whole record. Near
trunks, or all early ones where much is lost on the way, are many times as loud as the record's faint end:
they are summed one by one. Far ones, at frequencies that are lost on the way, are not heard at all.
Energies are those of trunks that stand at random, w²·a·min(ka, 1)³·e^{-2b(f)x}.

Contract of the tolerance of a sum over trunks, in one place: for users, the audit and the tests.

A relative error ε, from 1e-2 to 1e-6, holds against the formula (``scattering``) in the L2 norm of

- the whole record,
- each octave from 20 Hz to 0.45 of the sampling rate that is less than 120 dB below the whole,
- each tenth of the record in which the sound of a trunk begins and that is less than 100 dB below the whole
  (90 dB at 1e-6),

for all trunks of 1 mm to 2 m, all air, grounds and losses that the settings take, and all sampling rates.
It is a bound by search: of 1,401 drawn stands (``tests/references/tolerances``: thin trunks, moving sources,
any air, leaves that absorb all but infrasound; 1e-2 to 1e-6) three were over, up to 1.6 times in a tenth of a
record; those that were further over in earlier searches are mended, and tests. The error that is told of an
octave is the tolerance, or what checks of H find where they find more; then it is an estimate, and a warning.
Octaves are those of the record with its end faded out over 40 ms, and its start before the first arrival
faded in: a record that ends at once sounds at all frequencies. The formula's sound before the first
arrival, of a band that ends smoothly and of losses without dispersion, is part of it. Finer than 1e-6, and
at 0, every trunk is summed at every frequency, which keeps 1e-9 of the whole; a tolerance between 0 and
1e-9 is refused (``spec/reverb``).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy import fft

from ....base.kept import LastAsked
from ....base.progress import Progress
from ....spec import Air
from ..bands import bands_of, roll_off, samples_of
from ..forest.losses import Losses, loss_per_metre
from ..forest.tail import Tail
from .layer_sum import LayerSum, expand
from .panel_sum import USUAL, by_distance, panel_spectrum
from .path_gain import AirFilter, PathGain
from .scattering import Check, TrunkPaths, direct_sum

FEW_RADII = 4
KEPT_LAYERS, KEPT_AIRS, KEPT_GAINS = 24, 16, 64  # of what sums set up, for the next ones
KEPT_TAILS = 128  # pairs
THICKEST = 0.6  # m of radius
FINEST_FILTERS = (
    1e-5,
    1e-4,
)  # tolerances from which on filters serve: of air alone, and of a path's gain


Summed = tuple[np.ndarray, dict[float, float]]  # samples, and errors by the lower end of an octave


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
    ) -> Summed:
        """(count,) samples at ``rate`` Hz, sample 0 when the source sounds; {lower end of an octave in Hz:
        relative error at most}: the tolerance, or what checks of H found where they found more.

        losses : of paths, besides what the air takes; None: nothing.
        progress : called as progress(trunks done, all trunks); of many radii in parts of the work.
        """
        alike = len(paths.radius) > 0 and paths.radius.min() == paths.radius.max() > 0
        different = paths.radius[:1] if alike else np.unique(paths.radius[paths.radius > 0])

        def loss_at(frequency: np.ndarray) -> np.ndarray:
            loss = loss_per_metre(frequency, air, losses)
            return loss if losses is None else loss + 0.5 * losses.removed(frequency)

        few = len(different) <= FEW_RADII and _filters_serve(tolerance, losses, different)
        if not few or _is_infrasound(paths, rate, loss_at, air.speed()):
            return self._of_many_radii(
                paths, rate, count, air, tolerance, losses, loss_at, progress
            )
        gained = self._gain(losses, rate, tolerance, whole=True) is not None
        total = np.zeros(count)
        cosine, done = np.cos(paths.angle), 0
        checks: list[Check] = []
        for radius in different.tolist():
            rows = slice(None) if alike else paths.radius == radius
            some, turned = paths.select(rows), cosine[rows]
            if progress:
                progress(done, len(paths.length))
            done += len(turned)
            for layer in self._set_up(radius, rate, air, tolerance, losses, gained):
                gain = self._gain(losses, rate, tolerance, whole=True, highest=layer.highest)
                samples, found = layer.sum(some, turned, count, gain)
                total += samples
                checks += found
        if progress:
            progress(len(paths.length), len(paths.length))
        return total, _told(checks, tolerance)

    def _of_many_radii(
        self,
        paths: TrunkPaths,
        rate: float,
        count: int,
        air: Air,
        tolerance: float,
        losses: Losses | None,
        loss_at: Loss,
        progress: Progress | None,
    ) -> Summed:
        """Sum by panels of frequency, but for loud trunks, which are summed exactly."""
        speed, bark = air.speed(), losses.bark if losses else 0.0
        bands = bands_of(rate, float(paths.radius.max(initial=0.0)), speed, tolerance)
        loud = loud_trunks(paths, rate, count, loss_at, speed)
        total = direct_sum(paths.select(loud), rate, count, air, None, losses, tolerance, bands)
        # by angle: then those of a box (``panel_sum``) lie together in memory
        rest = paths.select(~loud)
        rest = rest.select(np.argsort(rest.angle))
        gain = self._gain(losses and losses.unthinned, rate, tolerance)
        checks: list[Check] = []
        whole = energies(_classes(paths), OCTAVES, loss_at, speed).sum(axis=1)
        done = 0
        for band in bands:
            usual = min(USUAL, band.high[0]) if band.high else USUAL
            lost = float(loss_at(np.array([usual]))[0])
            for rows in by_distance(rest.length, gain, lost):
                some = rest.select(rows)
                classes = _classes(some)

                def heard(low: float, high: float, classes: TrunkPaths = classes) -> bool:
                    return not unheard(classes, (low, high), whole, loss_at, speed, tolerance)

                def spectrum(
                    spacing: float,
                    lowest: int,
                    highest: int,
                    some: TrunkPaths = some,
                    heard: Callable[[float, float], bool] = heard,
                ) -> np.ndarray:
                    values, found = panel_spectrum(
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
                    checks.extend(found)
                    return values

                first, last = float(some.earliest.min()), float(some.length.max())
                total += samples_of(
                    spectrum, (band,), rate, count, last / speed, max(first / speed, 1e-9)
                )
                done += len(rows)
                if progress:
                    progress(done, len(bands) * len(rest.length))
        return total, _told(checks, tolerance)

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

        def air_at(slower: float) -> AirFilter | None:
            return None if gained else self._air(slower, air, tolerance)

        return self._layers.once(
            key, lambda: expand(radius, rate, air.speed(), tolerance, bark, air_at)
        )


def _told(checks: list[Check], tolerance: float) -> dict[float, float]:
    """{lower end of an octave in Hz: relative error at most}: the tolerance, or what checks found over it."""
    errors: dict[float, float] = {}
    for frequency, error in checks:
        octave = LOWEST * 2.0 ** math.floor(math.log2(frequency / LOWEST))
        if octave >= LOWEST:
            errors[octave] = max(error, errors.get(octave, tolerance))
    return errors


def _filters_serve(tolerance: float, losses: Losses | None, radii: np.ndarray) -> bool:
    """True where filters serve: not for finer tolerances and thick trunks."""
    if radii.max(initial=0.0) > THICKEST:
        return False
    plain = losses is None or (losses.passes and not losses.among_leaves)
    return tolerance >= FINEST_FILTERS[0 if plain else 1]


def _is_infrasound(paths: TrunkPaths, rate: float, loss: Loss, speed: float) -> bool:
    """Return whether so much is lost on the way that more than INFRASOUND of the energy is below what filters
    of some seconds keep."""
    band = np.array([f for f in BANDS if f < 0.4 * rate])
    some = paths.select(slice(None, None, 1 + len(paths.length) // SEEN))
    energy = energies(some, band, loss, speed).sum(axis=1) * band
    return bool(energy[0] > INFRASOUND * energy.sum())


FINEST = 1e-6  # of the fast sums
LOWEST = 20.0  # Hz
INFRASOUND, SEEN = 1e-3, 256  # of the energy, at LOWEST; paths that tell it
FAINTEST_OCTAVE, FAINTEST_TENTH = 1e-6, 1e-5  # of the whole, in amplitude
EXACT = 3e-11  # of the whole: what the exact sum is good for at any time
FADED = 0.04  # s of the record's end


def arrivals_of(paths: TrunkPaths, losses: Losses | None, speed: float) -> np.ndarray:
    """(M,) seconds, when trunks are first heard: off their near faces, between ends of unlike heights."""
    way = paths.length - 2.0 * paths.radius * np.sin(paths.angle / 2)
    if losses is not None:
        way = way + losses.detour(paths.length, losses.rises[0])
    return np.asarray(way / speed)


def judged(
    found: np.ndarray, exact: np.ndarray, rate: float, tolerance: float, arrivals: np.ndarray
) -> dict[str, float]:
    """Relative errors of all that a tolerance promises, by what they are of.

    found, exact : (N,) samples at ``rate`` Hz. arrivals : (M,) seconds, when trunks are first heard.
    """
    gap, whole = found - exact, float(np.linalg.norm(exact))
    if whole == 0:
        return {"whole": float(np.linalg.norm(gap))}
    result = {"whole": float(np.linalg.norm(gap)) / whole}
    first = int(0.8 * float(arrivals.min()) * rate) if len(arrivals) else 0
    result |= _octaves(gap, exact, rate, tolerance, first)
    least = max(FAINTEST_TENTH, EXACT / max(tolerance, FINEST)) * whole
    for number, part in enumerate(np.array_split(np.arange(len(exact)), 10)):
        size = float(np.linalg.norm(exact[part]))
        begins = len(part) and ((arrivals * rate > part[0]) & (arrivals * rate < part[-1])).any()
        if begins and size > least:
            result[f"tenth {number + 1}"] = float(np.linalg.norm(gap[part])) / size
    return result


def _octaves(
    gap: np.ndarray, exact: np.ndarray, rate: float, tolerance: float, first: int
) -> dict[str, float]:
    """first : samples before anything is heard, over which the record fades in."""
    end = min(int(FADED * rate), len(exact))
    fade = np.ones(len(exact))
    fade[len(exact) - end :] = roll_off(0.45 + 0.05 * np.arange(end) / max(end, 1))
    start = min(first, int(FADED * rate), len(exact))
    fade[:start] *= roll_off(0.5 - 0.05 * np.arange(start) / max(start, 1))
    least = max(FAINTEST_OCTAVE, EXACT / max(tolerance, FINEST))
    errors = octave_errors(gap * fade, exact * fade, rate, least)
    return {f"{low:g} Hz": error for low, error in errors.items()}


def octave_errors(
    gap: np.ndarray,
    exact: np.ndarray,
    rate: float,
    quietest: float,
    lowest: float = LOWEST,
    highest: float = math.inf,
) -> dict[float, float]:
    """{lower end in Hz: relative error} of octaves that are louder than a share of the whole, between two
    frequencies. gap : (M,) samples, no more than the exact ones (N,)."""
    off, true = fft.rfft(gap, len(exact)), fft.rfft(exact)
    frequency = fft.rfftfreq(len(exact), 1.0 / rate)
    least = quietest * float(np.linalg.norm(true))
    errors, low = {}, lowest
    while low < min(0.45 * rate, highest):
        rows = (frequency >= low) & (frequency < min(2.0 * low, 0.45 * rate))
        size = float(np.linalg.norm(true[rows]))
        if size > least:
            errors[low] = float(np.linalg.norm(off[rows])) / size
        low *= 2.0
    return errors


BANDS = (LOWEST, 125.0, 1000.0, 4000.0)  # Hz at which loudness is estimated
LOUDER = 10.0  # times a tenth of the record that all of the others are together
MOST_SINGLE, MOST = 400, 20_000  # trunks that are summed one by one; among so many
UNHEARD, MOST_UNHEARD = 1e-2, 1e-6  # of the tolerance, of the sound: 40 dB are left for the ground
OCTAVES = 20.0 * 2.0 ** np.arange(0, 13, 0.5)  # Hz at which all sound is known

ALIKE = 0.02  # by the logarithm, of lengths and radii of a class

Loss = Callable[[np.ndarray], np.ndarray]  # nepers of amplitude per metre at frequencies (F,)


def energies(paths: TrunkPaths, frequency: np.ndarray, loss: Loss, speed: float) -> np.ndarray:
    """(F, M) expected energy of each trunk's sound at frequencies (F,), but for a factor."""
    size = np.outer(2.0 * np.pi / speed * frequency, paths.radius)
    lost = np.exp(-2.0 * np.outer(loss(frequency), paths.length))
    return np.asarray(np.square(paths.weight) * paths.radius * np.minimum(size, 1.0) ** 3 * lost)


def _classes(paths: TrunkPaths) -> TrunkPaths:
    """Paths in place of all of about the same length and radius, with the energy of these."""
    sides = np.maximum([paths.length, paths.radius], 1e-6)
    number = np.floor(np.log(sides) / ALIKE).astype(np.int64)
    low = number.min(axis=1, keepdims=True)
    along, across = number - low
    count = int(across.max()) + 1
    energy = np.bincount(along * count + across, np.square(paths.weight) * paths.radius)
    some = np.flatnonzero(energy)
    length, radius = np.exp((np.array(np.divmod(some, count)) + low + 0.5) * ALIKE)
    weight = np.sqrt(energy[some] / radius)
    return replace(paths.select(slice(len(some))), length=length, radius=radius, weight=weight)


def unheard(
    some: TrunkPaths,
    ends: tuple[float, float],
    whole: np.ndarray,
    loss: Loss,
    speed: float,
    tolerance: float,
) -> bool:
    """Return whether nothing between two frequencies in Hz would miss some trunks.

    whole : (F,) energy of all trunks at OCTAVES. They are fainter there than UNHEARD of the tolerance of all,
    and of their own sound where it is loudest: neither an octave nor a part of the record changes by more.
    """
    share = min(UNHEARD * tolerance, MOST_UNHEARD) ** 2
    here = np.array(ends)
    energy = energies(some, here, loss, speed).sum(axis=1)
    every = np.interp(np.log(here), np.log(OCTAVES), np.log(whole + 1e-300))
    if (energy > share * np.exp(every)).any():
        return False
    band = np.array(BANDS)
    own = (energies(some, band, loss, speed).sum(axis=1) * band).max()
    return bool((energy * here <= share * own).all())


def loud_trunks(paths: TrunkPaths, rate: float, count: int, loss: Loss, speed: float) -> np.ndarray:
    """(M,) bool."""
    loud = np.zeros(len(paths.length), bool)
    if not 1 < len(loud) <= MOST:
        return loud
    band = np.array([f for f in BANDS if f < 0.4 * rate])
    energy = (energies(paths, band, loss, speed) * band[:, None]).sum(axis=0)
    tenth = np.floor(10.0 * paths.earliest / speed * rate / count).astype(np.int64)
    within = (tenth >= 0) & (tenth < 10)
    of_tenth = np.bincount(tenth[within], energy[within], minlength=10)
    heard = of_tenth > FAINTEST_TENTH**2 * of_tenth.sum()
    if not heard.any():
        return loud
    order = np.argsort(-energy, kind="stable")
    left = np.cumsum(energy[order][::-1])[::-1]  # of this and all fainter ones
    needed = int((left > LOUDER**2 * of_tenth[heard].min()).sum())
    loud[order[: min(needed, MOST_SINGLE)]] = True
    return loud
