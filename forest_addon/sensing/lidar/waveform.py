"""Full waveforms of pulses, and the echoes in them.

Every sub-ray that meets a surface at range R sends light back after the two-way time 2R/c. A short pulse of
Gaussian shape makes of that a sum of Gaussians, f = Σ e_j/s_j·exp(-(x - t_j)²/2s_j²); an echo is a crest of
this sum. Ranges R and time t = 2R/c are the same axis here, with widths in metres: σ of the pulse, and
s_j² = σ² + b_j² where the light of a contact is spread along the surface (``footprint``).

Contacts farther apart than 8 widths do not matter to each other (1e-14) and are cut into groups. Where
f' = 0, (f'/Σ w_j)' = Var_w(t_j)/s² - 1 ≤ 0 for the weights w_j = e_j/s_j³·exp(…) and the smallest width s:
a group of at most 2s has one crest, as a variance within an interval is at most a quarter of its length
squared (Popoviciu). Longer groups are searched in steps of s/4, where the slope changes its sign; two crests
closer than that count as one. Newton's method, held by bisection, finds the place. A contact belongs to the
crest between whose valleys it lies; a crest that no contact lies at is no echo.

A receiver that samples (``surveys.digitised``) tells echoes apart by its bins in place of crests. One that
records (``record``) keeps the waveform itself, and one that decomposes it (``decompose``) fits Gaussians to
its samples, one for each crest (Hofton, Minster & Blair 2000, IEEE Trans. Geosci. Remote Sens. 38, 1989;
Wagner et al. 2006, ISPRS J. 60, 100).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ... import kernels
from ...base.rng import child_keys, keyed_normal
from ...base.rows import RowTable, distinct
from ...spec import Beam, Receiver

LIGHT = 299_792_458.0  # m/s
FWHM = 2 * np.sqrt(2 * np.log(2))  # of a Gaussian, in standard deviations
FAR = 1e6  # m, farther than any range: parts pulses on one axis
APART = 8.0  # standard deviations beyond which contacts are treated alone
STEP = 0.25  # of the smallest width in a group, of the search for crests

Runs = list[tuple[int, int, float]]  # contacts of an echo, from and to before, and where it is


@dataclass(frozen=True)
class WaveformEchoes(RowTable):
    """E echoes, sorted by pulse and then by range.

    pulse : (E,) pulse. distance : (E,) metres, of the crest. energy : (E,) all that belongs to it.
    width : (E,) metres, standard deviation of its share of the waveform.
    contact : (E,) number of the contact that stands for it: of those with at least half the energy of the
        strongest, the one nearest to the axis of the beam.
    """

    pulse: np.ndarray
    distance: np.ndarray
    energy: np.ndarray
    width: np.ndarray
    contact: np.ndarray


@dataclass(frozen=True)
class Bins:
    """Bins of a receiver that samples, so many ``metres`` long: the light of a pulse in each (``shape``), and
    how many are its window."""

    shape: np.ndarray
    metres: float
    window: int


def pulse_length(pulse_ns: float) -> float:
    """Standard deviation, in metres of range, of a pulse of this full width at half maximum."""
    return pulse_ns * 1e-9 * LIGHT / 2 / FWHM


def find_echoes(
    ray: np.ndarray,
    subrays: int,
    distance: np.ndarray,
    energy: np.ndarray,
    sigma: float,
    blur: np.ndarray | None = None,
    bins: Bins | None = None,
) -> WaveformEchoes:
    """The echoes of C contacts; one without energy is no contact.

    ray : (C,) numbers of rays, from pulse to pulse and in each from the axis outwards.
    distance : (C,) metres. energy : (C,). sigma : metres, see ``pulse_length``.
    blur : (C,) metres, standard deviation in range of a contact's own light; left out: none.
    bins : of a receiver that samples: its echoes are where the light of their contacts is on average, and
        light in no echo belongs to the nearest one; a pulse without any has none.
    """
    blur = np.zeros(len(ray)) if blur is None else blur
    library = kernels.library()
    if library is None:
        lit, echoes = np.flatnonzero(energy > 0), []
        pulse = ray[lit] // subrays
        if bins is None and (np.diff(pulse) > 0).all():  # one contact a pulse: that is its echo
            width = np.hypot(sigma, blur[lit])
            return WaveformEchoes(pulse, distance[lit], energy[lit], width, lit)
        for rows in by_pulse(ray, subrays, lit):
            rows = rows[np.argsort(distance[rows], kind="stable")]
            at, light, width = distance[rows], energy[rows], np.hypot(sigma, blur[rows])
            runs = _crests(at, light, width, sigma) if bins is None else _peaks(at, light, bins)
            for first, stop, place in runs:
                some = slice(first, stop)
                echo = _echo(at[some], light[some], width[some], ray[rows[some]] % subrays, sigma)
                echoes.append(
                    (
                        ray[rows[0]] // subrays,
                        echo[0] if np.isnan(place) else place,
                        *(*echo[1:3], rows[first + echo[3]]),
                    )
                )
        pulse, where, total, wide, contact = np.array(echoes).reshape(-1, 5).T
        return WaveformEchoes(pulse.astype(int), where, total, wide, contact.astype(int))
    count, given = len(ray), bins or Bins(np.zeros(0), 1.0, 0)
    room = count * (len(given.shape) + given.window + 1) + len(given.shape)
    whole, real = np.empty((2, count), dtype=np.int64), np.empty((3, count))
    many = library.find_echoes(
        count,
        np.argsort(ray, kind="stable"),
        ray,
        subrays,
        np.ascontiguousarray(distance),
        np.ascontiguousarray(energy),
        blur,
        sigma,
        len(given.shape),
        given.window,
        given.shape,
        given.metres,
        np.empty(4 * count + room, dtype=np.int64),
        np.empty(6 * count + room),
        *(whole[0], *real, whole[1]),
    )
    where, total, wide = real[:, :many]
    return WaveformEchoes(whole[0, :many], where, total, wide, whole[1, :many])


def by_pulse(ray: np.ndarray, subrays: int, rows: np.ndarray) -> list[np.ndarray]:
    """Rows of contacts (C,), by number, pulse by pulse. ray : (C,)."""
    pulse = ray[rows] // subrays
    order = np.argsort(pulse, kind="stable")
    return np.split(rows[order], np.flatnonzero(np.diff(pulse[order])) + 1) if len(rows) else []


def _echo(
    at: np.ndarray, energy: np.ndarray, width: np.ndarray, subray: np.ndarray, sigma: float
) -> tuple[float, float, float, int]:
    """Mean, energy and width of contacts (C,), and which of them stands for them."""
    if len(at) == 1:
        return at[0], energy[0], width[0], 0
    share = energy / energy.sum()
    mean = share @ (at - at[0])
    spread = share @ ((at - at[0] - mean) ** 2 + width**2 - sigma**2)
    strong = np.flatnonzero(energy >= 0.5 * energy.max())
    chosen = int(strong[subray[strong].argmin()])
    return at[0] + mean, energy.sum(), np.sqrt(sigma**2 + spread), chosen


def _crests(at: np.ndarray, energy: np.ndarray, width: np.ndarray, sigma: float) -> Runs:
    """Crests of the waveform of a pulse's contacts (C,), sorted by range, with those that belong to each."""
    apart = np.diff(at) > APART * sigma
    if (width > sigma).any():  # a contact reaches as far as 8 of its widths beyond another's 4
        reach = APART * (width - sigma / 2)
        before = np.maximum.accumulate(at + reach)
        apart = before[:-1] < np.minimum.accumulate((at - reach)[::-1])[::-1][1:]
    crests = []
    for first, stop in pairwise([0, *(np.flatnonzero(apart) + 1).tolist(), len(at)]):
        some = slice(first, stop)
        runs = _crests_of_group(at[some], energy[some], width[some])
        crests += [(first + start, first + end, crest) for start, end, crest in runs]
    return crests


def _crests_of_group(at: np.ndarray, energy: np.ndarray, width: np.ndarray) -> Runs:

    def slope(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Slope of f at places (X,) over Σ w_j, metres, and the derivative of that."""
        away = at - x[:, None]
        power = 0.5 * away**2 / width**2
        weight = np.exp(power.min(axis=1, keepdims=True) - power) * energy / width**3
        weight /= weight.sum(axis=1, keepdims=True)
        mean, drift = (weight * away).sum(axis=1), (weight * away / width**2).sum(axis=1)
        return mean, (weight * away**2 / width**2).sum(axis=1) - 1 - mean * drift

    if at[-1] - at[0] <= 2 * width.min():
        return [(0, len(at), _refined(slope, at[0], at[-1]))]
    nodes = int(np.ceil((at[-1] - at[0]) / (STEP * width.min()))) + 1
    step = (at[-1] - at[0]) / (nodes - 1)
    x = at[0] + np.arange(nodes) * step
    up = slope(x)[0] > 0
    up[0], up[-1] = True, False  # outside all contacts the way to them is up
    top, valley = np.flatnonzero(up[:-1] & ~up[1:]), np.flatnonzero(~up[:-1] & up[1:])
    cell = np.minimum(((at - at[0]) / step).astype(np.int64), nodes - 2)
    owner = np.searchsorted(valley, cell)
    # one that lies in the same step as a valley is behind it where the way up leads on
    owner += np.isin(cell, valley) & (slope(at)[0] > 0)
    owner = np.maximum.accumulate(owner)
    ends = pairwise([0, *(np.flatnonzero(np.diff(owner)) + 1).tolist(), len(at)])
    steps = [(first, stop, top[owner[first]]) for first, stop in ends]
    return [(first, stop, _refined(slope, x[k], x[k + 1])) for first, stop, k in steps]


def _refined(
    slope: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], low: float, high: float
) -> float:
    """Crest within a bracket: Newton, held by bisection."""
    x, fine = (low + high) / 2, 1e-13 * (high - low)
    for _ in range(60 if high > low else 0):
        (rise,), (bend,) = slope(np.array([x]))
        low, high = (x, high) if rise > 0 else (low, x)
        after = x - rise / bend if bend < 0 else np.inf
        after = after if low <= after <= high else (low + high) / 2
        moved, x = abs(after - x) - 1e-13 * abs(x), after
        if moved <= fine:
            break
    return x


def _peaks(at: np.ndarray, energy: np.ndarray, bins: Bins) -> Runs:
    """Bins of the light of a pulse's contacts (C,) that are larger than all others within the window, none of
    which is empty, with the contacts that are nearest to each; no place."""
    place = ((at - at[0]) / bins.metres + 1e-9).astype(np.int64)
    far = np.flatnonzero(np.diff(place) > len(bins.shape) + bins.window) + 1  # lights do not meet
    peaks = []
    for first, stop in pairwise([0, *far.tolist(), len(at)]):
        lit = np.bincount(place[first:stop] - place[first], energy[first:stop])
        wave = np.convolve(lit, bins.shape)
        peak, last = wave > 0, len(wave) - 1
        for away in range(1, bins.window):
            left, right = np.arange(len(wave)) - away, np.arange(len(wave)) + away
            before, after = wave[np.maximum(left, 0)], wave[np.minimum(right, last)]
            below = (left >= 0) & (before > 0) & (before < wave)
            above = (right <= last) & (after > 0) & (after < wave)
            # beyond the ends of a pulse's light there is nothing
            peak &= below | ((first == 0) & (left <= 0))
            peak &= above | ((stop == len(at)) & (right > last))
        peaks += (place[first] + np.flatnonzero(peak) - np.argmax(bins.shape)).tolist()
    if not peaks:
        return []
    owner = np.abs(place[:, None] - np.array(peaks)).argmin(axis=1)
    ends = pairwise([0, *(np.flatnonzero(np.diff(owner)) + 1).tolist(), len(at)])
    return [(first, stop, np.nan) for first, stop in ends]


# Waveforms as a receiver records them, in even steps of range from the scanner on, and Gaussians fitted to
# such records.
#
# Each contact is laid down as a Gaussian, and the whole is folded with weights, so that both together are the
# pulse's shape: one Gaussian as wide as the pulse and no weights, or for a shape told by samples Gaussians of
# 0.7 steps, which alias by 6e-5. Its zero is where one Gaussian that is fitted to it has its middle: so
# instruments count ranges from the pulse that they have sent.


REACH = 6.0  # standard deviations that a contact's light is laid down to each side
FINE = 0.7  # steps, of the Gaussians that a told shape is made of
BEYOND = 16  # samples, and whole multiples of them, that a record is long
PLAIN = 0.005  # of a record's largest power, below which there is no crest
ROUNDS, SETTLED = 60, 1e-10  # of a fit, and steps of its parameters at which it ends
FLATTEST = 1e-10  # least damping, and slope of a parameter over that of the steepest
BASELINE = 1000  # counts where no light is
LEVELS = 65535  # counts
SPAN = 30.0  # dB over the faintest echo that counts hold where no dynamic range is told


@dataclass(frozen=True)
class Waveforms(RowTable):
    """N samples of the light of pulses, by pulse and range; none lie between contacts that are far apart.

    pulse : (N,) pulse. index : (N,) steps of range from the scanner. value : (N,) energy a metre of range, or
    counts of a converter. step : metres of range. gain : energy a metre of a count. las_format : point format
    of the LAS files that name them.
    """

    pulse: np.ndarray
    index: np.ndarray
    value: np.ndarray
    step: float
    gain: float = 1.0
    las_format: int = 9

    def select(self, rows: np.ndarray | slice) -> Waveforms:
        """All: no sample is a row of the returns that it is kept with."""
        return self

    @property
    def starts(self) -> np.ndarray:
        """(S,) rows at which a record begins: samples that follow each other without a gap."""
        new = (np.diff(self.pulse) != 0) | (np.diff(self.index) != 1)
        return np.flatnonzero(np.append(len(self.pulse) > 0, new))

    def counted(self, faintest: float, keys: np.ndarray, receiver: Receiver) -> Waveforms:
        """The same in counts of 16 bits, with noise where the threshold has a ratio to it.

        faintest : energy a metre at the crest of the faintest echo that is seen. keys : (P,) uint64 keys of
        the pulses. receiver : its threshold over the noise, and the dB over the faintest, 30 where none are
        told, at which its converter is full.
        """
        noise = faintest / receiver.threshold_snr if receiver.threshold_snr else 0.0
        drawn = child_keys(keys[self.pulse], self.index)
        value = self.value + noise * keyed_normal(drawn, "waveform")
        gain = faintest * 10 ** ((receiver.dynamic_range or SPAN) / 10) / (LEVELS - BASELINE)
        counts = np.rint(np.clip(value / gain + BASELINE, 0, LEVELS)).astype(np.uint16)
        return Waveforms(self.pulse, self.index, counts, self.step, gain, int(receiver.las_format))


def sent_pulse(beam: Beam, step: float) -> tuple[float, np.ndarray, int]:
    """The shape of a beam's pulse: standard deviation, metres, of Gaussians one step of range apart, their
    weights (K,), which sum to 1, and which of them lies at the range. step : metres."""
    sigma = pulse_length(beam.pulse_ns)
    if not beam.pulse_shape:
        return sigma, np.ones(1), 0
    from scipy.interpolate import CubicSpline  # here: few scanners tell one

    told, apart = np.pad(np.array(beam.pulse_shape), BEYOND), beam.shape_step_ns * 1e-9 * LIGHT / 2
    count = np.arange(len(told))
    crest = np.array([[int(told.argmax())]])
    (_, (middle,), _) = (values[0] for values in _fitted(told[None], crest, sigma / apart))
    zero = int(np.ceil(middle * apart / step))
    last = int((len(told) - 1 - middle) * apart / step)
    place = middle + np.arange(-zero, last + 1) * step / apart
    shape = CubicSpline(count, told)(place)
    away = np.arange(len(shape))[:, None] - np.arange(len(shape))
    weight = np.linalg.solve(np.exp(-0.5 * (away / FINE) ** 2), shape)
    return FINE * step, weight / weight.sum(), zero


def record(
    ray: np.ndarray,
    subrays: int,
    distance: np.ndarray,
    energy: np.ndarray,
    blur: np.ndarray,
    sent: tuple[float, np.ndarray, int],
    step: float,
) -> Waveforms:
    """Samples of the waveforms of contacts; see ``find_echoes``. sent : as ``sent_pulse`` tells it. step :
    metres of range."""
    sigma, weights, zero = sent
    lit = np.flatnonzero(energy > 0)
    lit = lit[np.lexsort((distance[lit], ray[lit] // subrays))]
    pulse, at, width = ray[lit] // subrays, distance[lit], np.hypot(sigma, blur[lit])
    if not len(lit):
        return Waveforms(pulse, pulse, at, step)
    reach, middle = np.ceil(REACH * width / step).astype(int), np.rint(at / step).astype(int)
    low = middle - reach - zero
    high = middle + reach + len(weights) - zero + BEYOND
    apart = pulse << 40
    new = (
        np.maximum.accumulate(high + apart)[:-1]
        < np.minimum.accumulate((low + apart)[::-1])[-2::-1]
    )
    first = np.flatnonzero(np.append(True, new))
    begin = np.minimum.reduceat(low, first)
    count = -((begin - np.maximum.reduceat(high, first) + BEYOND) // BEYOND) * BEYOND
    place = np.cumsum(count) - count - begin  # row of a step of range
    whole = np.arange(count.sum())
    index = whole - np.repeat(place, count)
    each = 2 * reach + 1
    laid = np.repeat(middle - reach - np.cumsum(each) + each, each) + np.arange(each.sum())
    of = np.repeat(np.arange(len(lit)), each)
    away = (laid * step - at[of]) / width[of]
    power = (energy[lit] / (width * np.sqrt(2 * np.pi)))[of] * np.exp(-0.5 * away**2)
    row = np.repeat(place, np.diff(np.append(first, len(lit))))[of] + laid
    power = np.bincount(row, power, len(whole))
    padded = np.pad(power, (len(weights) - 1 - zero, zero))
    folded = sum(
        weight * padded[len(weights) - 1 - k :][: len(whole)]
        for k, weight in enumerate(weights.tolist())
    )
    return Waveforms(np.repeat(pulse[first], count), index, np.asarray(folded), step)


def decompose(
    waves: Waveforms, sigma: float, faintest: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pulse, distance, energy and width (E,) of Gaussians fitted to records, one for each of their crests.

    sigma : metres, of the pulse, with which fits begin. faintest : energy a metre below which nothing is a
    crest.
    """
    power, start = waves.value, waves.starts
    if not len(start):
        return waves.pulse, power, power, power
    length = np.diff(np.append(start, len(power)))
    least = np.maximum(PLAIN * np.maximum.reduceat(power, start), faintest)
    higher = (power > np.roll(power, 1)) & (power >= np.roll(power, -1))
    higher &= power > np.repeat(least, length)
    higher[start] = higher[start + length - 1] = False
    crest, owner = np.flatnonzero(higher), np.repeat(np.arange(len(start)), length)[higher]
    many, blocks = np.bincount(owner, minlength=len(start)), -(-length // (4 * BEYOND))
    kinds = (many << 20) + blocks  # so that what is fitted together does not depend on what else is
    padded, fits_of_pulses = np.append(power, 0.0), [np.empty((4, 0))]
    for kind in distinct(kinds[many > 0]).tolist():
        rows, step = np.flatnonzero(kinds == kind), np.arange((kind & 0xFFFFF) * 4 * BEYOND)
        begin = start[rows, None]
        some = padded[np.where(step < length[rows, None], begin + step, len(power))]
        at = crest[np.isin(owner, rows)].reshape(len(rows), -1) - begin
        height, middle, width = _fitted(some, at, sigma / waves.step)
        sound = (middle >= 0) & (middle < len(step)) & (width < len(step))
        with np.errstate(over="ignore"):  # of those that are not sound
            energy = height * width * waves.step * np.sqrt(2 * np.pi)
        distance = (middle + waves.index[begin]) * waves.step
        fits = waves.pulse[begin] + 0 * middle, distance, energy, width * waves.step
        fits_of_pulses.append(np.stack(fits)[:, sound])
    fitted = np.concatenate(fits_of_pulses, axis=1)
    pulse, *others = fitted[:, np.lexsort(fitted[1::-1])]
    return pulse.astype(np.int64), *others


def _fitted(power: np.ndarray, crest: np.ndarray, sigma: float) -> np.ndarray:
    """(3, R, K) heights, middles and standard deviations, in samples, of K Gaussians each, fitted to R
    records (R, T) from their crests (R, K) on, by Levenberg and Marquardt's steps."""
    known = np.stack([np.take_along_axis(power, crest, 1), crest, np.full(crest.shape, sigma)])
    going, damping = np.arange(len(power)), np.full(len(power), 1e-3)
    time = np.arange(power.shape[1])[:, None]
    unit = np.eye(3 * crest.shape[1])
    for _ in range(ROUNDS):
        some, fit = power[going], known[:, going]
        height, middle, width = fit[:, :, None]
        away = (time - middle) / width
        bell = np.exp(-0.5 * away**2)
        slope = np.concatenate(
            [bell, height * bell * away / width, height * bell * away**2 / width], 2
        )
        miss = some - (height * bell).sum(axis=2)
        normal = np.matmul(slope.transpose(0, 2, 1), slope)
        scale = np.einsum("rii->ri", normal)  # not 0, where a Gaussian has left its record
        scale = np.maximum(scale, FLATTEST * scale.max(axis=1, keepdims=True) + 1e-300)
        damped = damping[going, None, None] * scale[:, :, None]
        toward = np.matmul(slope.transpose(0, 2, 1), miss[:, :, None])
        step = np.linalg.solve(normal + damped * unit, toward)[:, :, 0]
        trial = fit + step.reshape(len(going), 3, crest.shape[1]).transpose(1, 0, 2)
        shape = np.exp(-0.5 * ((time - trial[1][:, None]) / trial[2][:, None]) ** 2)
        left = (some - (trial[0][:, None] * shape).sum(axis=2)) ** 2
        better = left.sum(axis=1) < (miss**2).sum(axis=1)
        better &= (trial[[0, 2]] > 0).all(axis=(0, 2))
        known[:, going] = np.where(better[:, None], trial, fit)
        damping[going] = np.maximum(damping[going] * np.where(better, 0.1, 10.0), FLATTEST)
        still = (np.abs(step) > SETTLED * np.abs(fit).max(axis=(0, 2))[:, None]).any(axis=1)
        going = going[still & (damping[going] < 1e12)]
    return known


def fitted_echoes(
    waves: Waveforms,
    ray: np.ndarray,
    subrays: int,
    distance: np.ndarray,
    energy: np.ndarray,
    sigma: float,
    faintest: float,
) -> WaveformEchoes:
    """Echoes of contacts by the Gaussians of their waveforms; see ``find_echoes`` and ``decompose``.

    A contact stands for the Gaussian that is nearest to it; one that is nearest to none is no echo.
    """
    pulse, crest, light, width = decompose(waves, sigma, faintest)
    if not len(pulse):
        return WaveformEchoes(pulse, crest, light, width, pulse)
    lit = np.flatnonzero(energy > 0)
    pulse_of_contact, place = ray[lit] // subrays, crest + pulse * FAR
    owner = np.searchsorted((place[:-1] + place[1:]) / 2, distance[lit] + pulse_of_contact * FAR)
    strongest = np.zeros(len(place))
    np.maximum.at(strongest, owner, energy[lit])
    weak = energy[lit] < 0.5 * strongest[owner]
    order = np.lexsort((ray[lit] % subrays, weak, owner))
    order = order[np.append(True, np.diff(owner[order]) != 0)]
    order = order[pulse[owner[order]] == pulse_of_contact[order]]
    kept = owner[order]
    return WaveformEchoes(pulse[kept], crest[kept], light[kept], width[kept], lit[order])
