"""Sums of many delayed echoes that are made of few modes: Σ_i g_i·e^{-b(f)τ_i}·A_i(f)·e^{-i2πfτ_i}.

With A_i = Σ_r c_ir·U_r(f) (``disc_modes``) the shares of each mode are laid down on a grid of delays, one
transform a mode turns all of them into a spectrum, and Σ_r U_r(f)·(…) is the sum. What the air takes is a
function of frequency and delay alone, so no echo needs it by itself: on the grid

    e^{-b(f)τ} = Σ_j c_j(f)·T_j(τ),   c_j = 2·(-1)^j·I_j(b(f)·half the span of delays),

a few Chebyshev polynomials of the delay (DLMF 10.35.3), each with its transform; a kernel's transform at a
complex frequency takes account of the grid's points not being the delays. Numbers are in single precision
echo by echo, in double where many are added.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from scipy import fft, sparse, special

from ..gridding import ALIASING, NARROWEST, kernel, width_for
from ..kaiser_bessel import OVERSAMPLING
from ..nonuniform import DelayedSum

KERNEL = 0.4  # share of the tolerance that the kernel's error may take
LOST = 0.02  # and the series of what the air takes
MOST_LOST = (
    8.0  # nepers, by which losses differ: beyond, e^16 roundings of double precision would be heard
)
SINGLE = 2.0**-24
AT_ONCE = 1 << 13  # echoes
ADDED = 0.1  # share of the tolerance beyond which they are added up in double precision
STEPS = 16.0  # roundings of a share, in single precision, on its way
OF_LEVEL = 4.0  # and in each step of a transform, where that is
ADDED_UP = 16  # modes whose waves are added up in single precision
TRANSFORMED = 0.15  # share of the tolerance beyond which transforms are in double precision
VALUES = 1 << 22  # on grids at once
DEAR = 300.0  # values on grids for each echo in sums with weights: beyond, modes do not pay


class ModeTable(Protocol):
    """Echoes as sums of modes; see ``DiscModes`` and ``LineModes``."""

    ranks: tuple[int, ...]

    def shares(self, places: Any, rank: int) -> np.ndarray: ...

    def at(self, wavenumber: np.ndarray, rank: int) -> np.ndarray: ...

    def left_out(self, places: Any, loud: np.ndarray) -> tuple[np.ndarray, float]: ...

    def loudest(self, places: Any) -> np.ndarray: ...


@dataclass(frozen=True)
class ModalEchoes:
    """Rows (m,) of a strength as waves (p,) in a table of modes.

    places : (p,) in the table. owner : (p,) which of ``rows`` a wave is of. factor : (p,) what it is
    multiplied with. offset : (p,) metres by which its path is longer. loudest : (m, parts of the band) the
    largest |f| in each, and no more; None: each echo is one wave, which the table knows of. share : of all
    waves, by which they may be off their echoes.
    """

    rows: np.ndarray
    table: ModeTable
    places: Any
    owner: np.ndarray
    factor: np.ndarray
    offset: np.ndarray
    loudest: np.ndarray | None = None
    share: float = 0.0


@dataclass(frozen=True)
class Bins:
    """Frequencies start + (0 … count - 1)·spacing Hz of a band with ``ends``, and the speed of sound."""

    start: float
    spacing: float
    count: int
    ends: tuple[float, float]
    speed: float

    @property
    def frequency(self) -> np.ndarray:
        """(K,) Hz."""
        return self.start + self.spacing * np.arange(self.count)

    @property
    def wavenumber(self) -> np.ndarray:
        """(K,) 1/m."""
        return (2.0 * math.pi / self.speed) * self.frequency

    @property
    def size(self) -> int:
        """Points of the grid of delays."""
        return int(fft.next_fast_len(OVERSAMPLING * self.count))


@dataclass(frozen=True)
class WholeEchoes:
    """M echoes that come as several waves each.

    loudest : (M, parts of the band) about the largest |f| in each, and no more. gain, delay : (M,), not
    negative. share : of all waves, each at its largest, that they are off their echoes at most.
    """

    loudest: np.ndarray
    gain: np.ndarray
    delay: np.ndarray
    share: float


@dataclass(frozen=True)
class Waves:
    """M waves: gain (M,) real, re a table; delay (M,) s; weights (M, W) real, of each in W sums, or None: one
    sum. These are coefficients of one, whose error is the bound's times the largest that they meet."""

    gain: np.ndarray
    delay: np.ndarray
    weights: np.ndarray | None = None

    def ordered(self, order: np.ndarray) -> Waves:
        """The same in another order."""
        weights = None if self.weights is None else self.weights[order]
        return Waves(self.gain[order], self.delay[order], weights)


def sum_modes(
    table: ModeTable,
    places: Any,
    waves: Waves,
    bins: Bins,
    loss: Callable[[np.ndarray], np.ndarray],
    tolerance: float,
    whole: WholeEchoes | None = None,
) -> DelayedSum | None:
    """The sum of M echoes; None where modes do not keep to the tolerance, delays are not on the grid,
    losses differ too much over them, or weights are too many for so few echoes.

    places : (M,) of the echoes in the table. waves : their delays in one period of the bins. loss : nepers
    per second of delay at frequencies (Q,), least at the lowest. tolerance : largest error of a value, of
    Σ max|A|.
    """
    waves = waves.ordered(places.order)
    gain, delay, weights = waves.gain, waves.delay, waves.weights
    width = width_for(KERNEL * tolerance)
    reach = width / (bins.size * bins.spacing)
    if delay.min() < reach or delay.max() > 1.0 / bins.spacing - reach:
        return None
    loud = np.abs(gain) * np.exp(-float(loss(np.array(bins.ends[:1]))[0]) * delay)
    if whole is None:
        laid = size = float(_largest(table.loudest(places), gain, delay, bins, loss).sum())
    else:
        size = float(_largest(whole.loudest, whole.gain, whole.delay, bins, loss).sum())
        laid = float(np.einsum("m,m->", loud, table.loudest(places)[:, 0]))
    left, off = table.left_out(places, loud)
    fixed = ALIASING[width - NARROWEST] + LOST * tolerance
    fixed += 0.0 if whole is None else whole.share
    span = _Span.of(delay, bins, loss, width, LOST * tolerance)
    if span is None:
        return None
    precision = _Precision.of(table, waves, bins, span, width, tolerance)
    errors = left + off + (fixed + precision.rounded) * laid
    enough = np.flatnonzero(errors <= tolerance * size)
    if not len(enough):
        return None
    rank = table.ranks[int(enough[0])]
    if weights is not None and rank * weights.shape[1] * bins.size > DEAR * len(delay):
        return None
    deposit = _Deposit(bins, width, precision.laid)
    waves = replace(waves, gain=gain * np.exp(-span.middle * delay))
    step = max(1, VALUES // (rank * bins.size))
    grids = (deposit.of(table, places, some, rank) for some in _pieces(waves, step))
    found = [_collected(grid, table, bins, span, width, precision.transformed) for grid in grids]
    spectrum = found[0][0] if weights is None else np.concatenate(found)
    error = float(errors[int(enough[0])]) / size if size > 0 else 0.0
    return DelayedSum(spectrum, size, 0.0, error, {rank: len(delay)})


def _pieces(waves: Waves, step: int) -> Iterator[Waves]:
    """The same with a few of the weights at a time."""
    if waves.weights is None:
        yield waves
        return
    for first in range(0, waves.weights.shape[1], step):
        yield replace(waves, weights=waves.weights[:, first : first + step])


@dataclass(frozen=True)
class _Precision:
    """Types of numbers that are laid down and transformed, and (levels,) what roundings come to, as a share
    of all that is laid down."""

    laid: type[np.floating]
    transformed: type[np.complexfloating]
    rounded: np.ndarray

    @classmethod
    def of(
        cls, table: ModeTable, waves: Waves, bins: Bins, span: _Span, width: int, tolerance: float
    ) -> _Precision:
        unit = 2.0 * SINGLE * np.sqrt(table.ranks)  # 2·√R: of Σ_r |c_r·U_r| re |A|
        if waves.weights is not None:
            unit = unit * float(np.abs(waves.weights).sum(axis=1).max())
        added: float = _crowd(waves.delay, bins, width)
        double = unit[-1] * added > ADDED * tolerance
        # What is near is laid down as faint as if it were in the middle of the span, and made louder again.
        transformed = _uneven(width) * (OF_LEVEL * math.log2(bins.size) + ADDED_UP)
        transformed *= math.exp(2.0 * span.most)
        exactly = unit[-1] * transformed > TRANSFORMED * tolerance
        rounded = unit * (STEPS + (0.0 if double else added) + (0.0 if exactly else transformed))
        laid = np.float64 if double else np.float32
        return cls(laid, np.complex128 if exactly else np.complex64, rounded)


def _uneven(width: int) -> float:
    """Return how much larger a kernel's transform is in the middle of the bins than at their ends."""
    ends = kernel(width).transform(np.array([0.0, 0.5 / OVERSAMPLING]))
    return float(ends[0] / ends[1])


def _crowd(delay: np.ndarray, bins: Bins, width: int) -> int:
    """Return how many echoes at most are added in single precision at a point of the grid."""
    place = (delay * (bins.size * bins.spacing)).astype(np.int64)
    total = np.append(0, np.cumsum(np.bincount(place)))
    most = (
        total[-1] if len(total) <= width + 1 else (total[width + 1 :] - total[: -width - 1]).max()
    )
    return min(int(most), AT_ONCE)


def _largest(
    loudest: np.ndarray,
    gain: np.ndarray,
    delay: np.ndarray,
    bins: Bins,
    loss: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:
    """(M,) about max|A|, and no more: of parts of the band, each weakened as at its upper end."""
    low, high = bins.ends
    parts = loudest.shape[1]
    upper = loss(low + (high - low) * (np.arange(parts) + 1.0) / parts).astype(np.float32)
    found = loudest * np.exp(np.outer(delay.astype(np.float32), -upper))
    return gain * found.max(axis=1)


@dataclass(frozen=True)
class _Span:
    """Losses over a span of delays: about ``middle`` nepers a second, which echoes have by themselves, they
    differ by ``rate`` (K,), and delays by ``half`` s from ``centre``: by ``most`` nepers; ``orders``
    polynomials do."""

    middle: float
    rate: np.ndarray
    centre: float
    half: float
    most: float
    orders: int

    @classmethod
    def of(
        cls,
        delay: np.ndarray,
        bins: Bins,
        loss: Callable[[np.ndarray], np.ndarray],
        width: int,
        error: float,
    ) -> _Span | None:
        rate = loss(bins.frequency)
        middle = float(rate.max() + rate.min()) / 2
        first, last = float(delay.min()), float(delay.max())
        half = (last - first) / 2 + width / (bins.size * bins.spacing)
        most = float(np.abs(rate - middle).max()) * half
        if most > MOST_LOST:
            return None
        order = np.arange(64)
        after = np.cumsum((2.0 * special.iv(order, most))[::-1])[::-1]
        orders = max(1, int(np.searchsorted(-after, -error * math.exp(-most))))
        return cls(middle, rate - middle, (first + last) / 2, half, most, orders)


@dataclass(frozen=True)
class _Deposit:
    """Laying down of shares on the grid of delays, with a kernel ``width`` points wide."""

    bins: Bins
    width: int
    dtype: type[np.floating]

    def of(self, table: ModeTable, places: Any, waves: Waves, rank: int) -> np.ndarray:
        """(W, size, rank) complex, shares times gains and weights at their delays about the middle of the
        bins; W is 1 where there are no weights."""
        delay, several = waves.delay, waves.weights
        bins, width = self.bins, self.width
        cycles = (bins.start + (bins.count // 2) * bins.spacing) * delay
        turn = np.asarray(-2.0 * math.pi * (cycles - np.rint(cycles)), np.float32)
        place = delay * (bins.size * bins.spacing)
        first, taps = kernel(width).spread(place, self.dtype)
        carried = np.empty(len(delay), np.complex64)
        carried.real, carried.imag = waves.gain * np.cos(turn), waves.gain * np.sin(turn)
        points = np.arange(width, dtype=np.int32)
        sums = 1 if several is None else several.shape[1]
        ends = width * np.arange(AT_ONCE + 1, dtype=np.int32)
        grids = np.zeros((sums, bins.size, 2 * rank))
        for begin in range(0, len(delay), AT_ONCE):
            some = slice(begin, min(begin + AT_ONCE, len(delay)))
            shares = table.shares(places.select(some), rank)
            shares *= carried[some, None]
            values = shares.view(np.float32).astype(self.dtype, copy=False)
            row = (first[some, None] + points).ravel()
            for number, grid in enumerate(grids):
                mine = taps[:, some] if several is None else taps[:, some] * several[some, number]
                deposit = sparse.csc_matrix(
                    (mine.astype(self.dtype, copy=False).T.ravel(), row, ends[: len(values) + 1]),
                    shape=(bins.size, len(values)),
                )
                grid += deposit @ values
        return grids.view(np.complex128)


def _collected(
    laid: np.ndarray,
    table: ModeTable,
    bins: Bins,
    span: _Span,
    width: int,
    dtype: type[np.complexfloating],
) -> np.ndarray:
    """(W, K) the spectra of what is laid down (W, size, rank)."""
    below = bins.count // 2  # the middle of the bins
    above = bins.count - below
    modes = table.at(bins.wavenumber, laid.shape[2]).astype(dtype)
    place = (np.arange(bins.size) / (bins.size * bins.spacing) - span.centre) / span.half
    series = [(-1.0) ** j * special.iv(j, span.rate * span.half) for j in range(span.orders)]
    polynomials = special.eval_chebyt(np.arange(span.orders)[:, None], np.clip(place, -1.0, 1.0))
    polynomials = polynomials.astype(modes.real.dtype)
    total = np.zeros((len(laid), bins.count), np.complex128)
    some = np.empty(laid.shape[:0:-1], dtype)
    for summed, grid in zip(total, laid, strict=True):
        columns = np.ascontiguousarray(grid.T, dtype)
        for order, (weight, polynomial) in enumerate(zip(series, polynomials, strict=True)):
            np.multiply(columns, polynomial, out=some)
            transformed = fft.fft(some, axis=1, overwrite_x=True)
            weight = 2.0 * weight if order else weight
            for first in range(0, len(modes), ADDED_UP):
                rows = slice(first, first + ADDED_UP)
                low, high = transformed[rows, bins.size - below :], transformed[rows, :above]
                low = np.einsum("rk,rk->k", modes[rows, :below], low)
                high = np.einsum("rk,rk->k", modes[rows, below:], high)
                summed += weight * np.concatenate([low, high])
    away = np.arange(bins.count) - below
    total *= np.exp(-span.rate * span.centre)
    turns = (away - 1j * span.rate / (2.0 * math.pi * bins.spacing)) / bins.size
    total /= kernel(width).transform(turns)
    return total
