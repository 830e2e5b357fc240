"""Smoothness of echoes in frequency: bounds on their Chebyshev series, for whole classes of echoes.

Interpolated between R Chebyshev points, a function with the coefficients c_n is off by at most
|c_R| + 2·Σ|c_n| over n > R (T_R vanishes at the points, and T_n beyond is mistaken for a lower one).
An echo's amplitude is scale·F(kℓ, ·)·e^{-Σ w_j·e_j(f)}: F of a ``Family``, of which many echoes share
a class of kℓ and of what else F depends on, and what air and beams take, by classes of w. A class's |c_n|
is the largest of samples all over it, so that no echo is taken to be smoother than its neighbours because
one of its coefficients happens to vanish. The product of two series follows from
T_m·T_n = ½T_{m+n} + ½T_{|m-n|}.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Protocol

import numpy as np

from . import chebyshev

LEVELS = (3, 4, 5, 6, 7, 8, 10, 12, 15, 18, 24, 32, 42, 56, 75, 100, 150, 200)
STEP = 0.1  # width of a class in log(kℓ)
SMALLEST = 1e-3  # kℓ of the first class and all below
ACROSS = 1 << 8  # most classes of the second variable
ORDERS = (32, 48, 64, 96, 128, 192, 256, 320)  # of a series
SPARE = 24  # orders beyond what F turns through
CAUTION = 1.5  # what a class may hold beyond its samples
UNSEEN = 4.0  # what may lie beyond a series, in parts of its last quarter
FLOOR = 2.5  # times what lies beyond: here more nodes stop paying
WEAKEST, RATIO = 0.02, 1.25  # classes of losses: nepers over the band
ALIKE = 1e-5  # of lengths and of second variables: what a mesh in single precision differs by
AT_ONCE = 1 << 17  # samples
DECAYS = 64  # orders of what losses leave


class Family(Protocol):
    """Functions F(y, second), y = kℓ, that many echoes share. Hashable.

    scaled : whether the second variable is a length too, taken times k.
    """

    @property
    def scaled(self) -> bool: ...

    def __hash__(self) -> int: ...

    def evaluate(self, scale: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """(N, C) at ``scale`` (N, 1) times the wavenumber of y = ``first`` and ``second`` (C,)."""
        ...

    def place(self, second: np.ndarray) -> np.ndarray:
        """(M,) where the second variable lies, 0 to ``ACROSS``; a class is a whole number wide."""
        ...

    def at(self, place: np.ndarray) -> np.ndarray:
        """The second variable at places."""
        ...

    def turns(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """(C,) radians of phase that F(y, ·) runs through from 0 to y, about."""
        ...


@dataclass(frozen=True)
class SmoothnessProfile:
    """M amplitudes scale·F(k·length, second); (M,) each, scale and length in metres."""

    family: Family
    scale: np.ndarray
    length: np.ndarray
    second: np.ndarray


@dataclass(frozen=True)
class Loss:
    """e^{-weight·exponent(f)}, weights (M,) not negative; the exponent is least at the lowest f."""

    exponent: Callable[[np.ndarray], np.ndarray]
    weight: np.ndarray


@dataclass(frozen=True)
class Change:
    """Another change of echoes over the frequency, by classes: bounds(band, N) are (G, N) on |c_n| of each,
    re its value at the lowest frequency; ``kind`` (M,) says which an echo is of.

    The bounds are the coefficients of a function themselves, of one whose products bound those of what it
    bounds.
    """

    bounds: Callable[[tuple[float, float], int], np.ndarray]
    kind: np.ndarray


@dataclass(frozen=True)
class Smoothness:
    """Smoothness of M echoes: the errors that interpolation makes.

    kind : (M,) row of ``errors`` (C, levels). scale : (M,) what these are
    multiples of: between ``LEVELS[i]`` nodes echo m is off by at most scale[m]·errors[kind[m], i].
    floor : (C,) what more nodes do not improve on, because F itself is a table. typical : (C,) about
    the largest |A|, in parts of the scale. shape : (M,) the same for echoes that differ by a factor.
    """

    kind: np.ndarray
    scale: np.ndarray
    errors: np.ndarray
    floor: np.ndarray
    typical: np.ndarray
    shape: np.ndarray

    @property
    def size(self) -> np.ndarray:
        """(M,) about the largest |A|."""
        size: np.ndarray = self.scale * self.typical[self.kind]
        return size


def smoothness(
    profile: SmoothnessProfile,
    band: tuple[float, float],
    speed: float,
    gain: np.ndarray,
    losses: Sequence[Loss | Change],
) -> Smoothness:
    """Of echoes in a band (Hz) of sound of a speed; ``gain`` (M,) is theirs at the band's lower end."""
    low, high = (2.0 * math.pi * end / speed for end in band)
    middle, ratio = (low + high) / 2, (high - low) / (high + low)
    classes = _place(middle * profile.length) * ACROSS
    second = profile.second * middle if profile.family.scaled else profile.second
    classes += np.clip(profile.family.place(second), 0, ACROSS - 1).astype(np.int64)
    some, of_echo = numbered(classes)
    series, length, beyond, size = _known(profile.family, round(ratio, 12)).of(some)
    decay, of_decay = _decays(losses, band, len(classes))
    pairs, of_echo = numbered(of_echo * len(decay) + of_decay)
    line, other = np.divmod(pairs, len(decay))
    errors = np.empty((len(pairs), len(LEVELS)))
    order = np.lexsort((length[line], other))
    line, other = line[order], other[order]
    begins = np.flatnonzero((np.diff(other, prepend=-1) != 0) | np.diff(length[line], prepend=-1))
    step = max(1, AT_ONCE // (len(LEVELS) * series.shape[1]))
    first = np.searchsorted(other[begins], np.arange(0, len(decay) + step, step))
    ends = np.append(begins[1:], len(pairs))
    for block, (start, stop) in enumerate(pairwise(first.tolist())):
        products = _beyond(decay[block * step : (block + 1) * step], series.shape[1])
        for begin, end in zip(begins[start:stop].tolist(), ends[start:stop].tolist(), strict=True):
            long = int(length[line[begin]])
            product = products[other[begin] - block * step, :long]
            errors[order[begin:end]] = series[line[begin:end], :long] @ product
    line, other = np.divmod(pairs, len(decay))
    unseen = beyond[line] * decay.sum(axis=1)[other]
    return Smoothness(
        of_echo,
        profile.scale * gain,
        errors + unseen[:, None],
        FLOOR * np.where(np.isfinite(unseen), unseen, 0.0),
        size[line],
        np.rint(np.log(np.maximum(profile.length, 1e-30)) / ALIKE)
        + 1j * np.rint(profile.second / ALIKE),
    )


def numbered(classes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The classes there are, and of each echo which of these; np.unique without a sort."""
    if not len(classes):
        return classes, classes
    least = int(classes.min())
    present = np.zeros(int(classes.max()) - least + 1, dtype=bool)
    present[classes - least] = True
    some = np.flatnonzero(present)
    number = np.cumsum(present) - 1
    return some + least, number[classes - least]


def _place(y: np.ndarray) -> np.ndarray:
    """(M,) class of y; 0 holds all that is small."""
    logarithm = np.log(np.maximum(y, SMALLEST) / SMALLEST)
    return np.ceil(logarithm / STEP).astype(np.int64)


@lru_cache(maxsize=64)
def _known(family: Family, ratio: float) -> _Classes:
    return _Classes(family, ratio)


def forget() -> None:
    """Start with no class known, as the first call does."""
    _known.cache_clear()


class _Classes:
    """Series of classes of one family, in bands of one ratio of half width to middle; kept."""

    def __init__(self, family: Family, ratio: float) -> None:
        self._family, self._ratio = family, ratio
        self._found: dict[int, tuple[np.ndarray, float, float]] = {}
        self._tables = self._tabled()

    def of(self, classes: np.ndarray) -> tuple[np.ndarray, ...]:
        """(C, N) bounds on |c_n| and how many they are, (C,) on all beyond, infinite where F turns too
        often, and (C,) about the largest |F|."""
        missing = np.array([c for c in classes.tolist() if c not in self._found], dtype=np.int64)
        if len(missing):
            self._find(missing)
            self._tables = self._tabled()
        known, series, length, beyond, size = self._tables
        row = np.searchsorted(known, classes)
        long = length[row]
        return series[row, : long.max(initial=1)], long, beyond[row], size[row]

    def _tabled(self) -> tuple[np.ndarray, ...]:
        """All that is found, in the order of the classes."""
        known = np.array(sorted(self._found), dtype=np.int64)
        found = [self._found[c] for c in known.tolist()]
        length = np.array([len(row) for row, *_ in found], dtype=np.int64)
        series = np.zeros((len(found), length.max(initial=1)))
        for line, (row, *_) in zip(series, found, strict=True):
            line[: len(row)] = row
        beyond, size = np.array([rest for _, *rest in found]).reshape(-1, 2).T
        return known, series, length, beyond, size

    def _find(self, classes: np.ndarray) -> None:
        inner, across = np.divmod(classes, ACROSS)
        share = np.array([0.0, 0.37, 0.71, 1.0])
        log = STEP * (inner[:, None] - 1 + share)
        first = np.where(inner[:, None] > 0, SMALLEST * np.exp(log), SMALLEST * share)
        second = self._family.at(across[:, None] + share)
        first, second = np.repeat(first, len(share), axis=1), np.tile(second, len(share))
        turns = self._family.turns(first[:, -1] * (1.0 + self._ratio), second[:, -1])
        orders = SPARE + 1.2 * self._ratio / (1.0 + self._ratio) * turns
        level = np.searchsorted(ORDERS, orders)
        for number, order in enumerate(ORDERS):
            rows = np.flatnonzero(level == number)
            step = max(1, AT_ONCE // (order * first.shape[1]))
            for begin in range(0, len(rows), step):
                some = rows[begin : begin + step]
                self._sample(classes[some], first[some], second[some], order)
        for one in classes[level == len(ORDERS)].tolist():
            self._found[one] = (np.zeros(1), math.inf, 1.0)

    def _sample(
        self, classes: np.ndarray, first: np.ndarray, second: np.ndarray, order: int
    ) -> None:
        scale = 1.0 + self._ratio * chebyshev.points(order)[:, None]
        values = self._family.evaluate(scale, first.ravel(), second.ravel())
        series = np.abs(chebyshev.series(order) @ values).reshape(order, *first.shape)
        sizes = np.abs(values).max(axis=0).reshape(first.shape).mean(axis=1)
        # What lies beyond an order, of the sample that has most of it there, as a series.
        beyond = np.cumsum(series[::-1], axis=0)[::-1].max(axis=2)
        bounds = CAUTION * (beyond - np.append(beyond[1:], 0.0 * beyond[:1], axis=0)).T
        rest = UNSEEN * bounds[:, 3 * order // 4 :].sum(axis=1)
        known = zip(classes.tolist(), bounds, rest.tolist(), sizes.tolist(), strict=True)
        for one, row, left, size in known:
            self._found[one] = (row, left, size)


def _decays(
    losses: Sequence[Loss | Change], band: tuple[float, float], count: int
) -> tuple[np.ndarray, np.ndarray]:
    """(G, N) bounds on |c_n| of what losses leave, 1 at the lowest frequency; and of each echo which."""
    order = DECAYS
    bounds, of_echo = _lost([loss for loss in losses if isinstance(loss, Loss)], band, count)
    for change in losses:
        if isinstance(change, Change):
            others = change.bounds(band, order)
            pairs, of_echo = numbered(of_echo * len(others) + change.kind)
            line, other = np.divmod(pairs, len(others))
            series = chebyshev.series(order)
            values = np.linalg.inv(series)
            product = (bounds[line] @ values.T) * (others[other] @ values.T)
            bounds = np.abs(product @ series.T)
    return bounds, of_echo


def _lost(
    losses: Sequence[Loss], band: tuple[float, float], count: int
) -> tuple[np.ndarray, np.ndarray]:
    """The same of losses alone."""
    order = DECAYS
    frequency = band[0] + (band[1] - band[0]) * (1.0 + chebyshev.points(order)) / 2
    edges, classes = [], np.zeros(count, dtype=np.int64)
    radix: list[tuple[np.ndarray, float]] = []
    for loss in losses:
        exponent = loss.exponent(frequency) - float(loss.exponent(np.array(band[:1]))[0])
        span = max(float(np.abs(exponent).max()), 1e-30)
        place = np.ceil(np.log(np.maximum(loss.weight * (span / WEAKEST), 1.0)) / math.log(RATIO))
        classes = classes * 64 + np.minimum(place, 63).astype(np.int64)
        radix.append((exponent / span, span))
    some, of_echo = numbered(classes)
    most = least = np.zeros((len(some), order))
    for exponent, _ in reversed(radix):
        some, digit = np.divmod(some, 64)
        most = most + np.outer(WEAKEST * RATIO ** digit.astype(float), exponent)
        below = np.where(digit > 0, WEAKEST * RATIO ** (digit - 1.0), 0.0)
        least = least + np.outer(below, exponent)
    edges = [np.exp(-most), np.exp(-least)]
    bounds = np.max([np.abs(edge @ chebyshev.series(order).T) for edge in edges], axis=0)
    return np.atleast_2d(bounds), of_echo


def _beyond(decay: np.ndarray, orders: int) -> np.ndarray:
    """(D, N, levels): errors of the product with a series of numbers (D, G), for each coefficient of
    another."""
    level, order = np.array(LEVELS), np.arange(orders)[:, None]
    after = np.zeros((len(decay), decay.shape[1] + 1))  # Σ from n on
    after[:, :-1] = np.cumsum(decay[:, ::-1], axis=1)[:, ::-1]
    most = decay.shape[1]
    total = np.zeros((len(decay), orders, len(level)))
    for start in (level, level + 1):
        for place in (start - order, order + start):
            total += 0.5 * after.take(np.clip(place, 0, most), axis=1)
        lower = after[:, :1, None] - after.take(np.clip(order - start + 1, 0, most), axis=1)
        total += 0.5 * np.where(order >= start, lower, 0.0)
    return total
