"""The spectrum of many echoes at once: Σ_i A_i(f)·e^{-i2πfτ_i} on an even grid of frequencies.

But for its carrier an echo is smooth in f. So A_i is computed at a few Chebyshev nodes f_r of the band
only, and with the polynomials ℓ_r that interpolate between them (Lagrange)

    Σ_i A_i(f)·e^{-i2πfτ_i} = Σ_r ℓ_r(f)·[Σ_i A_i(f_r)·e^{-i2πfτ_i}],

whose brackets are sums over delays alone: ``gridding`` does them with an FFT. How many nodes an echo
needs is known beforehand for its class (``smoothness``). Echoes of which nothing is known are looked at
in twice the nodes, until the second half of their Chebyshev series is small enough to be left out, and in
the end summed directly, bin by bin. What was left out is added up, echo by echo, to the bound on the
error; while that is above the tolerance, the sum is done again with more nodes. Several sums of the same
echoes, weighted differently, share their amplitudes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from . import chebyshev
from .gridding import ALIASING, NARROWEST, DelayGrid, width_for
from .node_plan import NodePlan, planned
from .smoothness import LEVELS, Smoothness
from .spectrum import delay_factors, phasors

Amplitude = Callable[[np.ndarray, np.ndarray], np.ndarray]

DENSE = (8, 16, 32, 64, 128, 256)  # nodes in which an unknown echo is looked at
UNSEEN = 4.0  # what may lie beyond these, in parts of their last quarter
VALUES_AT_ONCE = 1 << 16  # amplitudes at once: what is computed on the way fits a core's cache
DIRECT_AT_ONCE = 1 << 15  # and of those at every bin
ROUNDING = 16.0 * 2.0**-53  # of a sum, and for each period of the carrier
FEW = 1 << 16  # products of echoes and bins that are summed directly: the fast way costs more
DEPOSITED = 1 << 22  # values on the grid of the nodes and weights that are deposited at once
KERNEL = 0.5  # share of the tolerance that the kernel's error may take
TAIL = (
    0.5  # of what is left, for an echo of which nothing is known: of itself, or of the mean of all
)
SAFE = 0.8  # of the budget that is planned for, since sizes are known by classes only
ATTEMPTS = 4
SAMPLED, NODES_SAMPLED = 256, 8  # echoes and nodes of an estimate of all amplitudes


@dataclass(frozen=True)
class DelayedSum:
    """Result of ``sum_delayed``.

    spectrum : (K,) complex, or (W, K) where W weights were given.
    size, least : Σ_i of the largest and of the smallest |A_i| at the nodes.
    error_bound : no value of the spectrum is farther from the exact sum than this share of Σ_i max|A_i|
        over the band; with weights, this times the largest. It may be above the tolerance where the
        amplitudes themselves are not smooth enough (``Smoothness.floor``).
    nodes : {number of nodes: how many echoes were interpolated with it}, K for those summed directly.
    """

    spectrum: np.ndarray
    size: float
    least: float
    error_bound: float
    nodes: dict[int, int]


def sum_delayed(
    amplitude: Amplitude,
    delay: np.ndarray,
    start: float,
    spacing: float,
    count: int,
    *,
    tolerance: float = 1e-6,
    spread: ArrayLike = 0.0,
    weights: np.ndarray | None = None,
    smooth: Smoothness | None = None,
    ends: tuple[float, float] | None = None,
) -> DelayedSum:
    """Σ_i A_i(f)·e^{-i2πfτ_i} at f = start + (0 … count - 1)·spacing, K = count values.

    amplitude : called as amplitude(frequency (R,) Hz, rows (m,) int64) for A (R, m), real or complex,
        of the echoes ``rows`` at any frequencies of the band; may be called more than once for a row.
    delay : (M,) s, finite, of either sign.
    start, spacing : Hz, spacing larger than 0.
    tolerance : largest error of a value, relative to Σ_i max|A_i|; 0: the direct sum.
    spread : (M,) or one, s; if known, how far an echo's own response reaches around its delay (a disc's:
        2a·sinβ/c). It saves evaluations where nothing else is known, and does not bear on the error.
    weights : (M, W) real, of the echoes in W sums; left out: one sum, all weights 1.
    smooth : what is known of the echoes in this band.
    ends : Hz, of a band around the bins, in whose nodes A is asked for; left out: the first and last bin.

    The carrier is exact to 2π·2⁻⁵³ times the number of its periods. The time is that of evaluating
    the amplitudes, plus about 0.2 µs an echo at 1e-6.
    """
    delay = np.asarray(delay, dtype=np.float64)
    direct = summed_directly(len(delay), count, tolerance)
    given = np.ones((len(delay), 1)) if weights is None else weights
    spread = np.broadcast_to(np.asarray(spread, np.float64), delay.shape)
    task = _Task(amplitude, delay, given, start, spacing, count, ends)
    if direct:
        task.direct(np.arange(len(delay)))
        found = task.result(0)
    else:
        found = _fast(task, tolerance, spread, smooth)
    return found if weights is not None else replace(found, spectrum=found.spectrum[0])


def summed_directly(echoes: int, count: int, tolerance: float) -> bool:
    """Return whether so many echoes are summed at each of ``count`` frequencies: few, or to all digits."""
    return tolerance < 2.0 * ALIASING[-1] or echoes * count <= FEW


def nodes_needed(
    amplitude: Amplitude,
    start: float,
    spacing: float,
    count: int,
    echoes: int,
    tolerance: float,
    smooth: Smoothness | None = None,
) -> np.ndarray:
    """(M,) Chebyshev nodes between which amplitudes are interpolated within a tolerance; 0: none serve.

    Arguments as of ``sum_delayed``; echoes : M.
    """
    if smooth is None:
        nothing = np.zeros(echoes)
        task = _Task(amplitude, nothing, nothing[:, None], start, spacing, count)
        plan = task.unknown(nothing, TAIL * tolerance)
    else:
        plan = planned(smooth, SAFE * tolerance, count)
    needed: np.ndarray = np.append(LEVELS, 0)[plan.level]
    return needed


def _fast(
    task: _Task, tolerance: float, spread: np.ndarray, smooth: Smoothness | None
) -> DelayedSum:
    """With as many nodes as keep the bound below the tolerance, if any number does."""
    width = width_for(KERNEL * tolerance)
    kernel = ALIASING[width - NARROWEST]
    budget = max(tolerance - kernel, 0.1 * tolerance)
    share = SAFE
    loudness = 1.0 if smooth is None else task.loudness(smooth.size)
    for _ in range(ATTEMPTS):
        if smooth is None:
            plan = task.unknown(spread, TAIL * share * budget)
        else:
            plan = planned(smooth, share * loudness * budget, task.count)
        task.clear()
        for index in np.unique(plan.level).tolist():
            rows = np.flatnonzero(plan.level == index)
            if index < len(LEVELS) and LEVELS[index] <= task.count // 2:
                task.interpolate(rows, LEVELS[index], width)
                task.error += float(plan.error[rows].sum())
            else:
                task.direct(rows)
        found = task.result(kernel)
        excess = plan.reducible / (found.size or 1.0) / budget
        if task.error <= budget * found.size or excess <= 0.1:
            break
        share *= min(0.7 / excess, 0.5)
    return found


class _Task:
    """One sum: what it is made of, and how far it has come."""

    def __init__(
        self,
        amplitude: Amplitude,
        delay: np.ndarray,
        weights: np.ndarray,
        start: float,
        spacing: float,
        count: int,
        ends: tuple[float, float] | None = None,
    ) -> None:
        self._amplitude, self._delay, self._weights = amplitude, delay, weights
        self._start, self._spacing, self.count = start, spacing, count
        self._middle = start + (count // 2) * spacing
        last = start + (count - 1) * spacing
        self._ends = (start, last) if ends is None else (min(ends[0], start), max(ends[1], last))
        self.clear()

    def clear(self) -> None:
        """Start from nothing."""
        self._spectrum = np.zeros((self._weights.shape[1], self.count), dtype=np.complex128)
        self._size = self._least = self._interpolated = self.error = 0.0
        self._nodes: dict[int, int] = {}

    def _values(self, nodes: int, rows: np.ndarray) -> np.ndarray:
        """(R, m) amplitudes at the nodes."""
        low, high = self._ends
        frequency = (low + high) / 2 + (high - low) / 2 * chebyshev.points(nodes)
        return np.asarray(self._amplitude(frequency, rows))

    def loudness(self, size: np.ndarray) -> float:
        """Return how large amplitudes are, of what classes say, from a few echoes, mostly loud ones."""
        total = np.cumsum(size)
        if not total[-1] > 0:
            return 1.0
        places = (np.arange(SAMPLED) + 0.5) / SAMPLED * total[-1]
        rows = np.searchsorted(total, places).clip(0, len(size) - 1)
        largest = np.abs(self._values(NODES_SAMPLED, rows)).max(axis=0)
        return float(np.mean(largest / size[rows]))

    def unknown(self, spread: np.ndarray, allowed: float) -> NodePlan:
        """Of echoes that nothing is known of, by looking at each in more nodes than it will need."""
        level = np.full(len(spread), len(LEVELS))
        error = np.zeros(len(spread))
        reach = math.pi * self.count * self._spacing * np.abs(spread)
        stage = np.searchsorted(DENSE, np.minimum(2.0 * reach, DENSE[-1]))
        pending = np.empty(0, dtype=np.int64)
        for number, dense in enumerate(DENSE):
            rows = np.concatenate([pending, np.flatnonzero(stage == number)])
            if dense > 2 * self.count:
                break
            rejected = [rows[:0]]
            step = max(1, VALUES_AT_ONCE // dense)
            for begin in range(0, len(rows), step):
                some = rows[begin : begin + step]
                level[some], error[some] = self._look(some, dense, allowed)
                rejected.append(some[level[some] == len(LEVELS)])
            pending = np.concatenate(rejected)
        return NodePlan(level, error, float(error.sum()))

    def _look(self, rows: np.ndarray, dense: int, allowed: float) -> tuple[np.ndarray, np.ndarray]:
        """Level (m,) and error (m,) of some echoes, from their series of ``dense`` terms."""
        values = self._values(dense, rows)
        terms = np.abs(chebyshev.series(dense) @ values)
        beyond = UNSEEN * terms[3 * dense // 4 :].sum(axis=0)
        after = np.append(np.cumsum(terms[::-1], axis=0)[::-1], np.zeros((1, len(rows))), axis=0)
        levels = [nodes for nodes in LEVELS if nodes <= dense // 2]
        error = np.array([after[n] + after[n + 1] for n in levels]) + 2.0 * beyond
        peak = np.abs(values).max(axis=0)
        enough = error <= allowed * np.maximum(peak, peak.mean())
        level = np.where(enough.any(axis=0), enough.argmax(axis=0), len(LEVELS))
        error = np.append(error, np.zeros((1, len(rows))), axis=0)
        last = np.where(level < len(LEVELS), level, len(levels))
        return level, error[last, np.arange(len(rows))]

    def interpolate(self, rows: np.ndarray, nodes: int, width: int) -> None:
        """Add the echoes ``rows``, which are smooth enough for so many nodes."""
        first, *others = self._blocks(nodes)
        grid, step = self._grid(nodes, first, width), max(1, VALUES_AT_ONCE // nodes)
        for begin in range(0, len(rows), step):
            some = rows[begin : begin + step]
            values = self._values(nodes, some)
            self._deposit(grid, some, values, first)
            absolute = values.real**2 + values.imag**2
            size = float(np.sqrt(absolute.max(axis=0)).sum(dtype=np.float64))
            self._size += size
            self._interpolated += size
            self._least += float(np.sqrt(absolute.min(axis=0)).sum(dtype=np.float64))
        self._nodes[nodes] = self._nodes.get(nodes, 0) + len(rows)
        self._collect(grid, nodes, first)
        for block in others:
            grid = self._grid(nodes, block, width)
            for begin in range(0, len(rows), step):
                some = rows[begin : begin + step]
                self._deposit(grid, some, self._values(nodes, some), block)
            self._collect(grid, nodes, block)

    def _blocks(self, nodes: int) -> list[slice]:
        """The weights in runs whose grids are of a bounded size."""
        count, step = self._weights.shape[1], max(1, DEPOSITED // (nodes * self.count))
        return [slice(first, min(first + step, count)) for first in range(0, count, step)]

    def _grid(self, nodes: int, block: slice, width: int) -> DelayGrid:
        return DelayGrid(self.count, nodes, width, block.stop - block.start)

    def _deposit(self, grid: DelayGrid, rows: np.ndarray, values: np.ndarray, block: slice) -> None:
        """Lay amplitudes (R, m) times their weights down at their delays."""
        delay = self._delay[rows]
        turn = phasors(self._middle * delay)
        if self._weights.shape[1] == 1:
            grid.add(delay * self._spacing, (values * (turn * self._weights[rows, 0])).T)
        else:
            grid.add(delay * self._spacing, (values * turn).T, self._weights[rows, block])

    def _collect(self, grid: DelayGrid, nodes: int, block: slice) -> None:
        """Add what was laid down to the sums of some weights."""
        low, high = self._ends
        places = [
            (2.0 * end - low - high) / ((high - low) or 1.0)
            for end in (self._start, self._start + (self.count - 1) * self._spacing)
        ]
        spread = _lagrange(nodes, self.count, *places)
        for number in range(block.stop - block.start):
            found = np.einsum("rk,rk->k", grid.spectrum(number), spread)
            self._spectrum[block.start + number] += found

    def direct(self, rows: np.ndarray) -> None:
        """Add the echoes ``rows`` bin by bin."""
        frequency = self._start + self._spacing * np.arange(self.count)
        step = max(1, DIRECT_AT_ONCE // self.count)
        for first in range(0, len(rows), step):
            some = rows[first : first + step]
            values = np.asarray(self._amplitude(frequency, some))
            carrier = delay_factors(self._start, self._spacing, self.count, self._delay[some])
            carrier *= values
            if self._weights.shape[1] == 1:  # a matrix product has no columns to work on here
                self._spectrum[0] += np.einsum("km,m->k", carrier, self._weights[some, 0])
            else:
                self._spectrum += (carrier @ self._weights[some]).T
            absolute = values.real**2 + values.imag**2
            self._size += float(np.sqrt(absolute.max(axis=0)).sum())
            self._least += float(np.sqrt(absolute.min(axis=0)).sum())
            self._nodes[self.count] = self._nodes.get(self.count, 0) + len(some)

    def result(self, kernel: float) -> DelayedSum:
        """With the error of a term on the grid."""
        error = 0.0
        if self._size:
            error = kernel * min(self._interpolated / self._size, 1.0) + self.error / self._size
            turns = (self._start + self._spacing * self.count) * float(np.abs(self._delay).max())
            error += ROUNDING * (1.0 + turns)
        return DelayedSum(self._spectrum, self._size, self._least, error, self._nodes)


@lru_cache(maxsize=64)
def _lagrange(nodes: int, bins: int, first: float, last: float) -> np.ndarray:
    """(R, K) Lagrange polynomials of the nodes at K even points from ``first`` to ``last``."""
    return chebyshev.lagrange(nodes, np.linspace(first, last, bins))
