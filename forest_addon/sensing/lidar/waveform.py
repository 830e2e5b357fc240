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

A receiver that samples (``surveys.digitised``) tells echoes apart by its bins in place of crests.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ... import kernels
from ...base.rows import RowTable

LIGHT = 299_792_458.0  # m/s
FWHM = 2 * np.sqrt(2 * np.log(2))  # of a Gaussian, in standard deviations
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


def sample(
    time: np.ndarray, distance: np.ndarray, energy: np.ndarray, sigma: float | np.ndarray
) -> np.ndarray:
    """(T,) waveform at two-way times (T,) seconds of contacts (C,): energy per metre of range.

    sigma : metres, of all or (C,) of each.
    """
    away = (time[:, None] * LIGHT / 2 - distance) / sigma
    shape = np.exp(-0.5 * away**2) / (sigma * np.sqrt(2 * np.pi))
    wave: np.ndarray = shape @ energy
    return wave


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
        lit, found = np.flatnonzero(energy > 0), []
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
                found.append(
                    (
                        ray[rows[0]] // subrays,
                        echo[0] if np.isnan(place) else place,
                        *(*echo[1:3], rows[first + echo[3]]),
                    )
                )
        pulse, where, total, wide, contact = np.array(found).reshape(-1, 5).T
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
    """Some rows of contacts (C,), by number, pulse by pulse. ray : (C,)."""
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
    found = []
    for first, stop in pairwise([0, *(np.flatnonzero(apart) + 1).tolist(), len(at)]):
        some = slice(first, stop)
        runs = _crests_of_group(at[some], energy[some], width[some])
        found += [(first + start, first + end, crest) for start, end, crest in runs]
    return found


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
