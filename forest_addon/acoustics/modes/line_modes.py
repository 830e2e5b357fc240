"""Echoes over one band as sums of few modes, where one length tells them apart: what ``disc_modes`` is for
radius and incidence, along a line.

Over a band, functions f(k, s) of a family are within a small error sums Σ_r c_r(s)·U_r(k) of functions U_r
that all share (the leading left singular vectors of samples). The shares c_r stand at points along s, and an
echo is four of these rows, weighted by the cubic polynomial through them. Several families (lines) have
their modes in common, so that waves of all are added up together.

What is left out, by modes and by polynomials, is measured in each cell when the table is made.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from ...base.rows import RowTable
from .. import chebyshev
from .band_modes import RANKS, BandModes
from .leading_vectors import leading

SAMPLES = 160  # of each line, that modes are found from
BETWEEN = np.array([0.25, 0.5, 0.75])  # places in a cell at which errors are looked at
CAUTION = 1.5  # between these, and between twice as many nodes
HIGHER = 1.1  # of the largest at the ends of a cell, within it

FARTHEST = 0.1  # m by which waves may be later, for the choice of modes
Values = Callable[
    [np.ndarray, np.ndarray], np.ndarray
]  # of wavenumbers (K, 1) and lengths (S,): (K, S)
BandLoss = Callable[[np.ndarray], np.ndarray]  # hashable; nepers per metre at wavenumbers (K,)


@dataclass(frozen=True)
class ModeLine:
    """One family: ``values`` at wavenumbers (K, 1) and lengths (S,) are (K, S) complex.

    low, high : metres, from where to where it is tabulated. step : from row to row, of s·``warp`` or, where
    that is 0, of s itself in metres; with a warp (1/m) of log(1 + warp·s).
    beside : the function next to which this one is heard; None: itself.
    """

    values: Values
    low: float
    high: float
    step: float
    warp: float = 0.0
    beside: Values | None = None

    def place(self, length: np.ndarray) -> np.ndarray:
        """(M,) where lengths lie, in steps."""
        along = np.log1p(self.warp * length) if self.warp else length
        place: np.ndarray = along / self.step
        return place

    def length(self, place: np.ndarray) -> np.ndarray:
        """(M,) metres at places."""
        along = place * self.step
        length: np.ndarray = np.expm1(along) / self.warp if self.warp else along
        return length


@dataclass(frozen=True)
class LinePlaces(RowTable):
    """M waves in the table.

    cell : (M,) the first of their four rows. weight : (M, 4). later : (M,) metres that their paths are longer
    than those of their echoes.
    """

    cell: np.ndarray
    weight: np.ndarray
    later: np.ndarray

    @property
    def order(self) -> np.ndarray:
        """(M,) their numbers, as they were asked for."""
        return np.arange(len(self.cell))

    def __len__(self) -> int:
        return len(self.cell)


class LineModes(BandModes):
    """Modes of lines between two wavenumbers (1/m), and their rows.

    nodes : Chebyshev points of the band that resolve every function. loss : nepers per metre of path at
    wavenumbers, which the sum counts along the path of each wave, but which is that of its echo's: of waves
    that are ``later`` it is taken off, e^{b·later} as e^{b₀·later}·(1 + (b - b₀)·later), b₀ = ``middle``.
    """

    def __init__(
        self, lines: Sequence[ModeLine], ends: tuple[float, float], nodes: int, loss: BandLoss
    ) -> None:
        super().__init__(ends, nodes)
        self._lines, self._loss = lines, loss
        lost = loss(self.wavenumber)
        self.middle = float(lost.max() + lost.min()) / 2
        self.most = float(np.abs(lost - self.middle).max())
        k = self.wavenumber[:, None]
        samples: list[np.ndarray] = []
        values: list[np.ndarray] = []
        self._start: list[int] = []
        self._first: list[int] = []
        for line in lines:
            low, high = (float(line.place(np.array(end))) for end in (line.low, line.high))
            start = math.floor(low) - (1 if math.floor(low) > 1 else 0)
            count = max(math.ceil(high) + 2 - start, 4)
            self._start.append(start)
            self._first.append(sum(len(some) for some in values))
            values.append(line.values(k, line.length(start + np.arange(count))).T)
            length = line.length(np.linspace(low, high, SAMPLES))
            size = np.abs((line.beside or line.values)(k, length)).max(axis=0)
            some = line.values(k, length)[:, size > 0] / size[size > 0]
            samples += [some, FARTHEST * (lost - self.middle)[:, None] * some]
        self.keep(leading(np.concatenate(samples, axis=1), min(RANKS[-1], nodes)))
        rows, leans = (
            [((some * along) @ np.conj(self.modes)).astype(np.complex64) for some in values]
            for along in (1.0, lost - self.middle)
        )
        self._rows = np.concatenate(rows + leans)
        self._left, self._left_later = (
            np.concatenate(
                [
                    self._missed(*parts, power)
                    for parts in zip(lines, self._start, made, strict=True)
                ]
            )
            for power, made in enumerate((rows, leans))
        )
        peaks = [np.abs(some).max(axis=1) for some in values]
        self._most = np.concatenate([HIGHER * _spread(peak) for peak in peaks])

    def places(self, line: int, length: np.ndarray) -> LinePlaces:
        """Find waves of one line by their lengths (M,), from its low to its high."""
        place = self._lines[line].place(length) - self._start[line]
        count = (self._first[line + 1 :] or [len(self._left)])[0] - self._first[line]
        cell = np.clip(place.astype(np.int32), 1, count - 3)
        weight = _weights((place - cell).astype(np.float32))
        return LinePlaces(cell + (self._first[line] - 1), weight, np.zeros(len(cell)))

    def beside(self, places: LinePlaces, line: int, other: int) -> LinePlaces:
        """The same places of another line, which is tabulated at the same lengths."""
        return replace(places, cell=places.cell + (self._first[other] - self._first[line]))

    def shares(self, places: LinePlaces, rank: int) -> np.ndarray:
        """(m, rank) complex64, of the modes in each wave."""
        rows = np.ascontiguousarray(self._rows[:, :rank])
        read = places.cell[:, None] + np.arange(4, dtype=np.int32)
        weight = places.weight
        if places.later.any():
            read = np.hstack([read, read + np.int32(len(self._left))])
            weight = np.hstack([weight, weight * places.later.astype(np.float32)[:, None]])
        ends = np.arange(0, read.size + 1, read.shape[1], dtype=np.int32)
        picked = sparse.csr_matrix(
            (weight.ravel(), read.ravel(), ends), shape=(len(places), len(rows))
        )
        found: np.ndarray = (picked @ rows.view(np.float32)).view(np.complex64)
        return found

    def left_out(self, places: LinePlaces, loud: np.ndarray) -> tuple[np.ndarray, float]:
        """Σ loud·|f| that is left out at most: (levels,) by modes beyond each of ``ranks`` and by the
        polynomials; and because the loss of those that are later is a straight line (twice that)."""
        total = np.bincount(places.cell, weights=loud, minlength=len(self._left))
        lost = np.einsum("n,nl->l", total, self._left)
        total = np.bincount(places.cell, loud * np.abs(places.later), len(self._left))
        bent = np.einsum(
            "m,m,m->", loud, self.loudest(places)[:, 0], (self.most * places.later) ** 2
        )
        return lost + np.einsum("n,nl->l", total, self._left_later), float(bent)

    def loudest(self, places: LinePlaces) -> np.ndarray:
        """(M, 1) about the largest |f| over the band, and no less."""
        found: np.ndarray = self._most.take(places.cell)[:, None]
        return found

    def _missed(self, line: ModeLine, start: int, rows: np.ndarray, power: int) -> np.ndarray:
        """(S, levels) largest errors in the cells of a line, by the first of the four rows of each; power :
        0 for the functions themselves, 1 for those times b - b₀."""
        found = np.zeros((len(rows), len(self.ranks)))
        low, high = self._ends
        between = (low + high) / 2 + (high - low) / 2 * chebyshev.points(2 * self.count + 1)
        modes = self.at(between, self.ranks[-1]).astype(np.complex64)
        along = (self._loss(between) - self.middle) ** power
        inner = np.arange(1, len(rows) - 2)
        within = [(along, inner) for along in BETWEEN]  # the outermost also hold what lies beyond
        within += [(along - 1.0, inner[:1]) for along in BETWEEN]
        within += [(along + 1.0, inner[-1:]) for along in BETWEEN]
        for place, cell in within:
            weight = _weights(np.full(len(cell), place, np.float32))
            value = line.values(between[:, None], line.length(start + cell + place)).T
            shares = sum(weight[:, j, None] * rows[cell - 1 + j] for j in range(4))
            rest, begin = value * along, 0
            for level, rank in enumerate(self.ranks):
                rest -= shares[:, begin:rank] @ modes[begin:rank]
                begin = rank
                missed = CAUTION * np.abs(rest).max(axis=1)
                found[cell - 1, level] = np.maximum(found[cell - 1, level], missed)
        return found


def _weights(along: np.ndarray) -> np.ndarray:
    """(M, 4) of the rows at -1, 0, 1 and 2 (Lagrange)."""
    weight = np.empty((len(along), 4), along.dtype)
    before, after, beyond = along + 1, along - 1, along - 2
    inner, outer = after * beyond, before * along
    np.multiply(along * inner, -1 / 6, out=weight[:, 0])
    np.multiply(before * inner, 1 / 2, out=weight[:, 1])
    np.multiply(outer * beyond, -1 / 2, out=weight[:, 2])
    np.multiply(outer * after, 1 / 6, out=weight[:, 3])
    return weight


def _spread(peak: np.ndarray) -> np.ndarray:
    """(S,) the largest of four values from each on."""
    padded = np.pad(peak, (0, 3), mode="edge")
    return np.max([padded[j : j + len(peak)] for j in range(4)], axis=0)


def least(
    values: Values,
    wavenumber: np.ndarray,
    length: np.ndarray,
) -> np.ndarray:
    """(S - 1, K) no |f| between two of the lengths (S,) is much smaller; 0 where f may change its sign."""
    value = values(wavenumber[:, None], length).T
    size = np.abs(value)
    same = (value[:-1] * np.conj(value[1:])).real > 0.0
    found: np.ndarray = np.where(same, np.minimum(size[:-1], size[1:]), 0.0).astype(np.float32)
    return found
