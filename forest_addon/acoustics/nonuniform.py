"""The spectrum of many echoes at once: Σ_i A_i(f)·e^{-i2πfτ_i} on an even grid of frequencies.

But for its carrier an echo is smooth in f. So A_i is computed at a few Chebyshev nodes f_r of the band
only, and with the polynomials ℓ_r that interpolate between them (Lagrange)

    Σ_i A_i(f)·e^{-i2πfτ_i} = Σ_r ℓ_r(f)·[Σ_i A_i(f_r)·e^{-i2πfτ_i}],

whose brackets are sums over delays alone: ``gridding`` does them with an FFT. How many nodes an echo
needs is read off its own Chebyshev coefficients, whose tail is the error of the interpolation: echoes
whose tail is too large are done again with more nodes, and in the end directly, bin by bin. So the
tolerance holds for any amplitude, and a smooth one costs a few evaluations. Several sums of the same
echoes, weighted differently, share these.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from . import chebyshev
from .gridding import ALIASING, NARROWEST, DelayGrid, width_for
from .spectrum import delay_factors

Amplitude = Callable[[np.ndarray, np.ndarray], np.ndarray]

LEVELS = (3, 4, 5, 6, 8, 10, 12, 15, 18, 22, 27, 33, 40, 48, 58, 70, 85, 100, 120, 150, 200)
VALUES_AT_ONCE = 1 << 16  # amplitudes at once: what is computed on the way fits a core's cache
FEW = 1 << 16  # products of echoes and bins that are summed directly: the fast way costs more
PROBED = 64  # echoes that show how many nodes the others start with
OVERHEAD = 3  # what the deposit of an echo costs, in evaluations of its amplitude
COLUMNS = 256  # nodes by weights that are deposited at once


@dataclass(frozen=True)
class DelayedSum:
    """What ``sum_delayed`` found.

    spectrum : (K,) complex, or (W, K) where W weights were given.
    size : Σ_i of the largest |A_i| at the nodes.
    error_bound : no value of the spectrum is farther from the exact sum; with weights, this times the
        largest.
    nodes : {number of nodes: how many echoes were interpolated with it}, K for those summed directly.
    """

    spectrum: np.ndarray
    size: float
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
) -> DelayedSum:
    """Σ_i A_i(f)·e^{-i2πfτ_i} at f = start + (0 … count - 1)·spacing, K = count values.

    amplitude : called as amplitude(frequency (R,) Hz, rows (m,) int64) for A (R, m), real or complex,
        of the echoes ``rows`` at any frequencies of the band; may be called more than once for a row.
    delay : (M,) s, finite, of either sign.
    start, spacing : Hz, spacing larger than 0.
    tolerance : largest error of a value, relative to Σ_i max|A_i|; 0: the direct sum.
    spread : (M,) or one, s; if known, how far an echo's own response reaches around its delay (a disc's:
        2a·sinβ/c). It saves evaluations and does not bear on the error.
    weights : (M, W) real, of the echoes in W sums; left out: one sum, all weights 1.

    The carrier is exact to 2π·2⁻⁵³ times the number of its periods. The time is that of evaluating
    the amplitudes, plus about 0.2 µs an echo at 1e-6.
    """
    delay = np.asarray(delay, dtype=np.float64)
    direct = tolerance < 2.0 * ALIASING[-1] or len(delay) * count <= FEW
    levels = [] if direct else [level for level in LEVELS if level <= count // 2]
    given = np.ones((len(delay), 1)) if weights is None else weights
    task = _Task(amplitude, delay, given, start, spacing, count, tolerance)
    pending = task.groups(levels, np.broadcast_to(np.asarray(spread, np.float64), delay.shape))
    rejected = np.empty(0, dtype=np.int64)
    for nodes, rows in zip(levels, pending, strict=False):
        rows = np.concatenate([rejected, rows])
        rejected = task.interpolate(rows, nodes) if len(rows) else rows
    task.direct(np.concatenate([rejected, *pending[len(levels) :]]))
    found = task.result()
    return found if weights is not None else replace(found, spectrum=found.spectrum[0])


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
        tolerance: float,
    ) -> None:
        self._amplitude, self._delay, self._weights = amplitude, delay, weights
        self._start, self._spacing, self._count = start, spacing, count
        self._middle = start + (count // 2) * spacing
        self._width = width_for(0.5 * tolerance)
        self._allowed = 0.25 * tolerance  # tail of an echo, relative to it or to the mean of all
        self._spectrum = np.zeros((weights.shape[1], count), dtype=np.complex128)
        self._size = self._error = 0.0
        self._nodes: dict[int, int] = {}

    def groups(self, levels: list[int], spread: np.ndarray) -> list[np.ndarray]:
        """Rows that start at each level, and one group more for those that are summed directly."""
        if not levels or not len(spread):
            return [np.arange(len(spread))] if not levels else [np.arange(0)] * (len(levels) + 1)
        reach = _reach(self._allowed)[: len(levels)]
        level = np.searchsorted(reach, math.pi * self._count * self._spacing * np.abs(spread))
        level += self._head_start(levels, level)
        np.clip(level, 0, len(levels), out=level)
        order = np.argsort(level, kind="stable")
        return np.split(order, np.searchsorted(level[order], np.arange(1, len(levels) + 1)))

    def _head_start(self, levels: list[int], level: np.ndarray) -> int:
        """How many levels above what the spread asks for the echoes start, at the least cost.

        A few of them are tried at every level; one that starts too low is computed again at the next.
        """
        probe = np.arange(0, len(level), -(-len(level) // PROBED))
        fits = np.zeros((len(levels) + 1, len(probe)), dtype=bool)
        fits[-1] = True  # summed directly
        for index, nodes in enumerate(levels):
            fits[index] = self._tail_fits(self._values(nodes, probe))
            if fits[index].all():
                fits[index:] = True
                break
        good = np.where(fits, np.arange(len(fits))[:, None], len(levels))
        fitting = np.minimum.accumulate(good[::-1])[::-1]  # from each level on, the first
        cost = np.cumsum([0, *(nodes + OVERHEAD for nodes in levels), self._count])
        shifts = np.arange(-len(levels), len(levels) + 1)
        first = np.clip(level[probe] + shifts[:, None], 0, len(levels))
        last = fitting[first, np.arange(len(probe))]
        return int(shifts[np.argmin((cost[last + 1] - cost[first]).sum(axis=1))])

    def _values(self, nodes: int, rows: np.ndarray) -> np.ndarray:
        """(R, m) amplitudes at the nodes."""
        half = 0.5 * (self._count - 1) * self._spacing
        frequency = self._start + half + half * chebyshev.points(nodes)
        return np.asarray(self._amplitude(frequency, rows))

    def _tail_fits(self, values: np.ndarray) -> np.ndarray:
        """(m,) bool, whether interpolation between the values (R, m) is accurate enough.

        The next two coefficients are taken to be as much smaller than the last two as these are than
        the two before: those of an analytic function fall at least so fast.
        """
        last = np.abs(_tail_series(len(values)) @ values)
        tail, before = last[-1] + last[-2], last[0] + (last[1] if len(last) > 3 else 0.0)
        tail *= np.minimum(1.0, tail / np.where(before > 0, before, np.inf))
        peak = np.abs(values).max(axis=0)
        fits: np.ndarray = tail <= self._allowed * np.maximum(peak, peak.mean())
        return fits

    def interpolate(self, rows: np.ndarray, nodes: int) -> np.ndarray:
        """Add the echoes ``rows``; what comes back are those that need more nodes."""
        first, *others = self._blocks(nodes)
        grid, step = self._grid(nodes, first), VALUES_AT_ONCE // nodes
        kept, rejected = [], [rows[:0]]
        for begin in range(0, len(rows), step):
            some = rows[begin : begin + step]
            values = self._values(nodes, some)
            fits = self._tail_fits(values)
            if not fits.all():
                rejected.append(some[~fits])
                some, values = some[fits], values[:, fits]
            self._deposit(grid, some, values, first)
            kept.append(some)
            self._size += float(np.abs(values).max(axis=0).sum())
            self._nodes[nodes] = self._nodes.get(nodes, 0) + len(some)
        self._collect(grid, nodes, first)
        for block in others:
            grid = self._grid(nodes, block)
            for some in kept:
                self._deposit(grid, some, self._values(nodes, some), block)
            self._collect(grid, nodes, block)
        return np.concatenate(rejected)

    def _blocks(self, nodes: int) -> list[slice]:
        """The weights in runs whose grids are of a bounded size."""
        count, step = self._weights.shape[1], max(1, COLUMNS // nodes)
        return [slice(first, min(first + step, count)) for first in range(0, count, step)]

    def _grid(self, nodes: int, block: slice) -> DelayGrid:
        return DelayGrid(self._count, nodes * (block.stop - block.start), self._width)

    def _deposit(self, grid: DelayGrid, rows: np.ndarray, values: np.ndarray, block: slice) -> None:
        """Lay amplitudes (R, m) times their weights down at their delays."""
        delay = self._delay[rows]
        turned = (values * _turn(self._middle * delay)).T
        weighted = turned[:, None, :] * self._weights[rows, block, None]
        grid.add(delay * self._spacing, weighted.reshape(len(rows), math.prod(weighted.shape[1:])))

    def _collect(self, grid: DelayGrid, nodes: int, block: slice) -> None:
        """Add what was laid down to the sums of some weights."""
        parts = grid.spectrum().reshape(-1, nodes, self._count)
        self._spectrum[block] += np.einsum("wrk,rk->wk", parts, _lagrange(nodes, self._count))

    def direct(self, rows: np.ndarray) -> None:
        """Add the echoes ``rows`` bin by bin."""
        frequency = self._start + self._spacing * np.arange(self._count)
        step = max(1, VALUES_AT_ONCE // self._count)
        for first in range(0, len(rows), step):
            some = rows[first : first + step]
            values = np.asarray(self._amplitude(frequency, some))
            carrier = delay_factors(self._start, self._spacing, self._count, self._delay[some])
            self._spectrum += ((values * carrier) @ self._weights[some]).T
            self._size += float(np.abs(values).max(axis=0).sum())
            self._nodes[self._count] = self._nodes.get(self._count, 0) + len(some)

    def result(self) -> DelayedSum:
        kernel = ALIASING[self._width - NARROWEST]
        interpolated = sum(self._nodes.values()) - self._nodes.get(self._count, 0)
        error = (kernel + 2.0 * self._allowed) * self._size if interpolated else 0.0
        return DelayedSum(self._spectrum, self._size, error, self._nodes)


def _turn(cycles: np.ndarray) -> np.ndarray:
    """e^{-i2π·cycles}; whole cycles are taken off first, where the exponential would lose digits."""
    turned: np.ndarray = np.exp(-2j * math.pi * (cycles - np.rint(cycles)))
    return turned


@lru_cache(maxsize=64)
def _tail_series(count: int) -> np.ndarray:
    """(4 or fewer, R): values at the nodes to the last Chebyshev coefficients."""
    order = np.arange(max(1, count - 4), count)[:, None]
    rows: np.ndarray = (2.0 / count) * np.cos(order * np.arccos(chebyshev.points(count)))
    return rows


@lru_cache(maxsize=64)
def _lagrange(nodes: int, bins: int) -> np.ndarray:
    """(R, K) Lagrange polynomials of the nodes at K even points from -1 to 1."""
    return chebyshev.lagrange(nodes, np.linspace(-1.0, 1.0, bins))


@lru_cache(maxsize=16)
def _reach(tolerance: float) -> np.ndarray:
    """Largest z for each level such that its nodes interpolate e^{izx}, -1 <= x <= 1, to ``tolerance``.

    The Chebyshev coefficients of e^{izx} are 2·i^n·J_n(z) (DLMF 10.12.3); up to z = n they grow with z.
    """
    z = np.linspace(0.0, 1.0, 257)
    reach = []
    for level in LEVELS:
        small = 2.0 * np.abs(special.jv(level, level * z)) <= tolerance
        reach.append(level * z[int(np.argmin(small)) - 1])
    return np.array(reach)
