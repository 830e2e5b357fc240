"""The spectrum of many echoes at once: Σ_i A_i(f)·e^{-i2πfτ_i} on an even grid of frequencies.

But for its carrier an echo is smooth in frequency. So A_i is computed at a few Chebyshev nodes f_r of the
band only; with the polynomials ℓ_r that interpolate between them (Lagrange) it is a short sum of products,

    Σ_i A_i(f)·e^{-i2πfτ_i} = Σ_r ℓ_r(f)·[Σ_i A_i(f_r)·e^{-i2πfτ_i}],

whose brackets are sums over delays alone, which ``gridding`` does with an FFT.

How many nodes an echo needs follows from how far its response reaches around its delay and from how loud it
is: the series of e^{iθx} falls as n·(α - tanh α) beyond n = θ·cosh α (Debye), and every echo may be off by
as much as any other. How strict that has to be is measured: some echoes, drawn evenly and by loudness, are
computed in more nodes than any will need, and what their Chebyshev series hold beyond their nodes is the
error that all of them make. Errors cancel as the echoes themselves do: they are first taken to add up as
random ones, and where the sum is louder than such echoes are, it is made again with errors as much louder.

Several sums of the same echoes, weighted differently, share their amplitudes.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from . import chebyshev
from .gridding import ALIASING, NARROWEST, DelayGrid, width_for
from .spectrum import delay_factors

Amplitude = Callable[[np.ndarray, np.ndarray], np.ndarray]

# Numbers of nodes.
LEVELS = np.unique(np.rint(2.0 * 1.2 ** np.arange(29)).astype(np.int64))  # up to 330
# Echoes are told apart by short floats but for their last digits: radians that they turn, 16 steps for each
# doubling, and how loud they are over the loudest, 4 steps; 128 of these are enough, and 2^16 for both.
APART = np.array([[[1e-3], [1e-9]], [[1e4], [1.0]]], np.float32)
DIGITS = np.array([[19], [21]], np.uint32)
FIRST_KIND = APART[0].view(np.uint32) >> DIGITS
_alpha = np.linspace(0.0, 8.0, 4000)
FALLS = (
    _alpha * np.cosh(_alpha) - np.sinh(_alpha),
    np.cosh(_alpha),
)  # nepers and nodes, over the turn
# Nepers by which errors may be asked to be smaller than the tolerance, or larger: one after the other.
STRICTNESS = np.concatenate([np.arange(-18.0, 30.0, 0.5), 30.0 * 1.2 ** np.arange(40)])
SAMPLES = 256  # echoes that are measured, and of many more
SPARE = 12  # nodes beyond those that the farthest reaching of them should need
RESOLVED = 0.01  # of the tolerance, that the last quarter of a series may hold
FLAT = 3.0  # times what is left beyond two thirds of it: amplitudes are no smoother
SAFE = 0.5  # of the tolerance, for what a few echoes tell of all
UNSEEN = 0.1  # of it, that they may not tell
KERNEL = 0.25  # of the tolerance, for the transform
TYPICAL = 0.4  # root of the mean square of the transform's error, over the largest
PEAK = 3.5  # largest of many random values over their root of the mean square, about
ALIKE = 1.5  # times as loud as echoes are together, of their own, errors may be
VALUES_AT_ONCE = 1 << 17  # amplitudes at once: more leave the cache before they are laid down
DIRECT_AT_ONCE = 1 << 15  # and of those at every bin
ROUNDING = 16.0 * 2.0**-53  # of a sum, and for each period of the carrier
FEW = 1 << 15  # products of echoes and bins that are summed directly: the fast way costs more
DEPOSITED = 1 << 22  # values on the grid of the nodes and weights that are deposited at once
TRANSFORM = 1.5  # of the time of an amplitude, that of a bin of a transform
LEVEL = 1 << 13  # amplitudes that take as long as all else of a number of nodes


@dataclass(frozen=True)
class DelayedSum:
    """Result of ``sum_delayed``.

    spectrum : (K,) complex, or (W, K) where W weights were given.
    size : Σ_i of the largest |A_i| at the nodes.
    error : how far at most, as a share of the size, values of the spectrum are from the exact sum; with
        weights, of those of 1. It is estimated from some of the echoes, and may be above the tolerance where
        amplitudes themselves are not smooth.
    nodes : {number of nodes: how many echoes were interpolated with it}, K for those summed directly.
    """

    spectrum: np.ndarray
    size: float
    error: float
    nodes: dict[int, int]


def sum_delayed(
    amplitude: Amplitude,
    delay: np.ndarray,
    start: float,
    spacing: float,
    count: int,
    *,
    tolerance: float = 1e-6,
    reach: ArrayLike = 0.0,
    loudness: ArrayLike = 1.0,
    weights: np.ndarray | None = None,
    ends: tuple[float, float] | None = None,
    second: np.ndarray | None = None,
    conjugate: bool = False,
) -> DelayedSum:
    """Σ_i A_i(f)·e^{-i2πfτ_i} at f = start + (0 … count - 1)·spacing, K = count values.

    amplitude : called as amplitude(frequency (R,) Hz, rows (m,) int64) for A (R, m), real or complex,
        of the echoes ``rows`` at any frequencies of the band; may be called more than once for a row.
    delay : (M,) s, finite, of either sign; (2, M) of echoes that sound twice.
    start, spacing : Hz, spacing larger than 0.
    tolerance : largest error of a value, relative to Σ_i max|A_i|; 0: the direct sum.
    reach : (M,) or one, s, about how far an echo's own response reaches to both sides of its delay.
    loudness : (M,) or one, about the largest |A_i|, or in proportion to it.
    weights : (M, W) real, of the echoes in W sums; left out: one sum, all weights 1.
    ends : Hz, of a band around the bins, in whose nodes A is asked for; left out: the first and last bin.
    second : (M,) 1 or -1, by which A_i is multiplied where it sounds again. conjugate : then it is conj A_i.

    ``reach`` and ``loudness`` bear on the time; the error is measured. The carrier is exact to 2π·2⁻⁵³ times
    the number of its periods.
    """
    delay = np.atleast_2d(np.asarray(delay, np.float64))
    given = amplitude, delay, weights, start, spacing, count, ends, second, conjugate
    task = _Task(*given)
    if tolerance < 2.0 * ALIASING[-1] or delay.size * count <= FEW:
        task.direct(np.arange(len(delay[0])))
        return task.result(0.0, 0.0, 0.0)
    loud = np.maximum(np.broadcast_to(loudness, delay[0].shape), 1e-300)
    alike, even = PEAK, float(np.linalg.norm(loud) / loud.sum()) / math.sqrt(len(delay))
    while True:
        width = width_for(KERNEL * tolerance / _summed(alike * even))
        kernel = ALIASING[width - NARROWEST]
        allowed = SAFE * (1.0 - KERNEL) * tolerance
        plan, error, scattered = _planned(task, reach, loud, allowed, alike)
        for nodes, rows in plan:
            if nodes == 0:
                task.direct(rows)
            else:
                task.interpolate(rows, nodes, width)
        delayed_sum = task.result(kernel, error, scattered, UNSEEN * tolerance)
        if delayed_sum.error <= tolerance or (task.alike <= alike and task.even <= even):
            return delayed_sum
        alike, even = max(alike, task.alike), max(even, task.even)
        task = _Task(*given)


def _summed(together: float) -> float:
    """Return the share of the transform's largest error that many echoes make, together as loud as this share
    of them in phase."""
    together = min(together, 1.0)
    return together * (TYPICAL + (1.0 - TYPICAL) * together)


def _planned(
    task: _Task, reach: ArrayLike, loud: np.ndarray, allowed: float, alike: float
) -> tuple[list[tuple[int, np.ndarray]], float, float]:
    """Nodes, 0: directly, and the rows that get so many, with errors of at most ``allowed``·Σ max|A| as far
    as some tell; these errors, of Σ max|A|: all in phase, and their root of the sum of squares.

    alike : how many times their root of the sum of squares errors are together, at most.
    """
    low, high = task.ends
    # Powers of the frequency turn by about as much as the band is wide, over its upper end.
    octave = max((high - low) / (abs(high) or 1.0), 1e-3)
    turn = np.broadcast_to(octave + math.pi * (high - low) * np.abs(reach), loud.shape)
    # Echoes that turn about alike and are about as loud are planned as one.
    alike_in = np.stack([turn, loud / loud.max()]).astype(np.float32).clip(*APART)
    steep, faint = (alike_in.view(np.uint32) >> DIGITS) - FIRST_KIND
    kind = (128 * steep + faint).astype(np.uint16)
    echoes = np.bincount(kind)
    there = np.flatnonzero(echoes)
    middles = ((np.stack([there >> 7, there & 127]) + FIRST_KIND) << DIGITS) + (1 << DIGITS - 1)
    echoes, (turns, louds) = echoes[there], middles.astype(np.uint32).view(np.float32)
    share = louds * (len(loud) / float(echoes @ louds))  # of the mean loudness
    chance = (0.5 + 0.5 * share) / len(loud)  # of each echo being drawn, over how many are
    drawn = np.cumsum(echoes * chance)
    draws = min(SAMPLES + len(loud) // 256, len(loud))
    places = (np.arange(draws) + 0.5) / draws * drawn[-1]
    of = np.searchsorted(drawn, places).clip(0, len(there) - 1)
    before = ((drawn[of] - places) / chance[of]).astype(np.int64).clip(0, echoes[of] - 1)
    some = np.argsort(kind, kind="stable")[np.cumsum(echoes)[of] - 1 - before]
    weight = 1.0 / (draws * chance[of])
    dense = int(_nodes_for(turn[some].max(), 7.0 - math.log(allowed))) + SPARE
    terms, largest, rough = np.empty((0, draws)), np.empty(draws), np.arange(draws)
    while True:
        # In double precision, so that what is left of a series is not its rounding.
        values = np.ascontiguousarray(task.values(dense, some[rough]), np.complex128)
        series = chebyshev.coefficients(values.view(np.float64), 0).view(np.complex128)
        terms = np.append(terms, np.zeros((dense + 1 - len(terms), draws)), axis=0)
        terms[:dense, rough], largest[rough] = np.abs(series), np.abs(values).max(axis=0)
        beyond = PEAK * np.sqrt(np.square(terms[3 * dense // 4 :]).sum(axis=0))
        size = float(weight @ largest)
        little = RESOLVED * allowed * size
        if dense >= min(LEVELS[-1], 2 * task.count) or weight @ beyond <= little:
            break
        rough = np.flatnonzero(beyond > 0.5 * little / weight.sum())
        dense = min(2 * dense, 2 * int(LEVELS[-1]))
    # (dense + 1, S) that interpolation between n nodes misses: root of the mean square, and at most.
    # Twice at the ends of the band, where a term and what the nodes take it for are in phase.
    root = np.sqrt(np.cumsum(np.square(terms[::-1]), axis=0)[::-1]) + beyond
    after = 2.0 * np.minimum(np.cumsum(terms[::-1], axis=0)[::-1], PEAK * root) + beyond
    root[0] = after[0] = 0.0  # directly
    fallen = np.log(share) - math.log(allowed)  # every echo may be off by the same
    levels = np.append(LEVELS[max(min(dense, task.count // 2), LEVELS[0]) >= LEVELS], 0)
    # Directly, where that is as cheap as more nodes.
    last = len(levels) - 1 - (task.count > 2 * dense)

    def leveled(kinds: np.ndarray | slice, strictness: float) -> np.ndarray:
        """The first level by which series have fallen by so many nepers more, at most the last."""
        nodes = _nodes_for(turns[kinds], strictness + fallen[kinds])
        return np.minimum(np.searchsorted(LEVELS, nodes), last)

    def missed(nodes: np.ndarray) -> tuple[float, float]:
        """Errors of the drawn echoes: all in phase, and their root of the sum of squares."""
        kept = nodes * draws + np.arange(draws)
        in_phase, random = after.take(kept), root.take(kept)
        return float(in_phase @ weight), 2.0 * math.sqrt(random**2 @ weight / len(task.delay))

    def together(nodes: np.ndarray) -> float:
        in_phase, random = missed(nodes)
        return min(in_phase, alike * random)

    def at_most(strictness: float) -> bool:
        return together(levels[leveled(of, strictness)]) <= enough

    enough = max(allowed * size, FLAT * together(np.full(draws, 2 * dense // 3)))
    chosen = bisect_left(STRICTNESS, True, key=at_most)
    level = leveled(slice(None), float(STRICTNESS[min(chosen, len(STRICTNESS) - 1)]))
    nodes = _together(level, echoes, levels, task.count)
    error, scattered = (off / (size or 1.0) for off in missed(nodes[of]))
    of_kinds = np.zeros(there[-1] + 1, np.int16)
    of_kinds[there] = nodes
    of_all, used = of_kinds.take(kind), sorted(set(nodes.tolist()))
    return [(number, np.flatnonzero(of_all == number)) for number in used], error, scattered


def _nodes_for(turn: np.ndarray, nepers: np.ndarray | float) -> np.ndarray:
    """(M,) nodes n for which the series of e^{i·turn·x} has fallen by so much: by n·(α - tanh α) where
    cosh α = n/turn, which is turn·(α·cosh α - sinh α)."""
    return np.asarray(turn * np.interp(nepers / turn, *FALLS))


def _together(level: np.ndarray, held: np.ndarray, levels: np.ndarray, count: int) -> np.ndarray:
    """(C,) nodes of levels (C,), some raised to the next that are used: transforms of their own cost more.

    held : (C,) echoes of each. levels : the last is 0, directly.
    """
    echoes = np.bincount(level, held, minlength=len(levels))
    raised = np.arange(len(levels))
    used = np.flatnonzero(echoes[:-1]).tolist()
    for here, following in pairwise(used):
        more = levels[following] - levels[here]
        if echoes[here] * more < TRANSFORM * count * levels[here] + LEVEL:
            echoes[following] += echoes[here]
            raised[raised == here] = following
    return np.asarray(levels[raised[level]])


class _Task:
    """One sum: what it is made of, and how far it has come."""

    def __init__(
        self,
        amplitude: Amplitude,
        delay: np.ndarray,
        weights: np.ndarray | None,
        start: float,
        spacing: float,
        count: int,
        ends: tuple[float, float] | None,
        second: np.ndarray | None,
        conjugate: bool,
    ) -> None:
        self._amplitude, self.delay, self._conjugate = amplitude, delay, conjugate
        self._one = weights is None
        weights = np.ones((len(delay[0]), 1)) if weights is None else weights
        self._weights = weights, weights if second is None else weights * second[:, None]
        self._start, self._spacing, self.count = start, spacing, count
        self._middle = start + (count // 2) * spacing
        last = start + (count - 1) * spacing
        self.ends = (start, last) if ends is None else (min(ends[0], start), max(ends[1], last))
        self._spectrum = np.zeros((weights.shape[1], count), dtype=np.complex128)
        self._size = self._squares = self._interpolated = 0.0
        self._nodes: dict[int, int] = {}

    def values(self, nodes: int, rows: np.ndarray) -> np.ndarray:
        """(R, m) amplitudes at the nodes."""
        return np.asarray(self._amplitude(chebyshev.points(nodes, *self.ends), rows))

    def interpolate(self, rows: np.ndarray, nodes: int, width: int) -> None:
        """Add the echoes ``rows``, which are smooth enough for so many nodes."""
        low, high = self.ends
        places = [
            (2.0 * end - low - high) / ((high - low) or 1.0)
            for end in (self._start, self._start + (self.count - 1) * self._spacing)
        ]
        spread = _lagrange(nodes, self.count, *places)
        step, sums = max(1, VALUES_AT_ONCE // nodes), max(1, DEPOSITED // (nodes * self.count))
        for first in range(0, len(self._spectrum), sums):
            block = slice(first, min(first + sums, len(self._spectrum)))
            grid = DelayGrid(self.count, nodes, width, block.stop - block.start)
            for begin in range(0, len(rows), step):
                some = rows[begin : begin + step]
                values = self.values(nodes, some)
                for delays, weights in zip(self.delay, self._weights, strict=False):
                    at, shares = delays.take(some), weights.take(some, 0)[:, block]
                    largest = grid.add(at * self._spacing, at * self._middle, values, shares)
                    values = np.conj(values) if self._conjugate else values
                if first == 0:
                    self._interpolated += self._measure(largest)
            for number in range(first, block.stop):
                self._spectrum[number] += grid.spectrum(spread, number - first)
        self._nodes[nodes] = self._nodes.get(nodes, 0) + len(rows)

    def _measure(self, largest: np.ndarray) -> float:
        """Add sizes (m,) of amplitudes; returns their sum."""
        size = len(self.delay) * float(largest.sum())
        self._size += size
        self._squares += len(self.delay) * float(largest @ largest)
        return size

    def direct(self, rows: np.ndarray) -> None:
        """Add the echoes ``rows`` bin by bin."""
        frequency = self._start + self._spacing * np.arange(self.count)
        step = max(1, DIRECT_AT_ONCE // self.count)
        for first in range(0, len(rows), step):
            some = rows[first : first + step]
            values = np.asarray(self._amplitude(frequency, some))
            self._measure(np.abs(values).max(axis=0))
            for delay, weights in zip(self.delay, self._weights, strict=False):
                carrier = delay_factors(self._start, self._spacing, self.count, delay[some])
                carrier *= values
                self._spectrum += (carrier @ weights[some]).T
                values = np.conj(values) if self._conjugate else values
            self._nodes[self.count] = self._nodes.get(self.count, 0) + len(some)

    def result(
        self, kernel: float, error: float, scattered: float, unseen: float = 0.0
    ) -> DelayedSum:
        """Finish the sum and tell its error.

        kernel, error : of a term by interpolation and on the grid. scattered : of all terms, if their
        errors are not in phase. unseen : what was not sampled of it.
        """
        spectrum = self._spectrum[0] if self._one else self._spectrum
        if not self._size:
            return DelayedSum(spectrum, 0.0, 0.0, self._nodes)
        turns = (self._start + self._spacing * self.count) * float(np.abs(self.delay).max())
        rounding = ROUNDING * (1.0 + turns)
        kernel *= min(self._interpolated / self._size, 1.0)
        kernel *= _summed(self.alike * self.even)
        told = min(error, self.alike * scattered) + kernel + rounding + unseen
        return DelayedSum(spectrum, self._size, told, self._nodes)

    @property
    def even(self) -> float:
        """Root of the sum of squares over the sum, of the echoes' sizes."""
        return math.sqrt(self._squares) / (self._size or 1.0)

    @property
    def alike(self) -> float:
        """Largest value over the root of the sum of squares, in which errors are alike; ``PEAK`` at least."""
        loudest = float(np.abs(self._spectrum).max())
        return max(ALIKE * loudest / math.sqrt(self._squares or 1.0), PEAK)


@lru_cache(maxsize=64)
def _lagrange(nodes: int, bins: int, first: float, last: float) -> np.ndarray:
    """(R, K) Lagrange polynomials of the nodes at K even points from ``first`` to ``last``."""
    return chebyshev.lagrange(nodes, np.linspace(first, last, bins))
