"""Discs over one band as sums of few modes: what many echoes share, so that a disc is a row of numbers.

Over a band, f of any disc up to some radius is within a small error a sum Σ_r c_r·U_r(k) of functions U_r
that are the same for all: the leading left singular vectors of f over radii and incidences (3 of the
paper's fit, 45 of the exact disc within 3e-4, from 40 to 80 kHz up to 4.4 cm). The
shares c_r are tabulated over radius and incidence: a row stands at each point of a grid, and a disc is
sixteen rows, weighted by cubic splines. Rows are made for some radii at a time when they are first asked for,
and kept; what is made depends on the band, the model and the largest radius alone, never on what came before.

What is left out is bounded cell by cell: the modes beyond a rank from samples of the rows, what splines miss
by ``missed``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import sparse

from ...base.rows import RowTable
from .. import chebyshev
from ..disc import backscatter_amplitude, continued_paper
from ..disc_table import HANDOVER, RIPPLE, ROUNDED, spline_weights, tabulated_on
from .band_modes import KEPT, RANKS, BandModes
from .leading_vectors import leading

SMALLEST = 6.0  # ka from where on radii have rows
LARGEST = HANDOVER - 6.0  # ka up to which
BLOCKS = 4  # an octave of radii, made at once
BASES = 2  # sets of modes an octave of the largest radius
REACH = 12  # points to which the coefficient of a spline depends on values: 0.27^12 is 1e-7
TAPS = (1 / 36, -5 / 18, 3 / 2)  # values to coefficients, from outside in, to the 6th order
MARGIN = 3  # rows beyond a block, for these and for the spline
MISSED = 1.0  # of what the envelope says; at most 0.6 of it was found
MOST_PHASE = 0.8  # radians
LATEST = 2.0 + 2.0 * RIPPLE  # radii, of the delays that count
ECHOING = {"exact": 8.0, "paper": 0.5}  # radii, over which nodes resolve echoes
COARSER = {"exact": 1.0, "paper": 5.0}  # steps of the grid, re those of a rim's phase
STEEP = 40.0  # of the paper's fit: no fourth derivative over its own scales is larger, re the largest |f|
RADII, ANGLES = 20, 60  # discs that modes are found from
CAUTION = 1.5  # between nodes, and between the rows that are looked at (Ehlich & Zeller 1964)
UNSEEN = 2.0  # what may lie beyond all nodes, in parts of the last quarter of a series
APART = 3  # rows and columns between those that are looked at
QUARTERS, FEW = 4, 3  # parts of the band and wavenumbers in each, at which the loudest is known
LEAST = 0.97  # of the loudest at the corners of a cell, within it


@dataclass(frozen=True)
class DiscPlaces(RowTable):
    """M discs in the table, by radius and then incidence, so that rows are read one after the other.

    order : (M,) numbers of the discs. cell : (M,) the first of their sixteen rows. width : (M,) rows from one
    radius to the next. weight : (M, 16).
    """

    order: np.ndarray
    cell: np.ndarray
    width: np.ndarray
    weight: np.ndarray

    def __len__(self) -> int:
        return len(self.cell)


def has_rows(radius: np.ndarray, wavenumber: float) -> np.ndarray:
    """(M,) whether a radius has rows at wavenumbers up to one."""
    size = wavenumber * _block_radius(_block(radius))
    known: np.ndarray = (size >= SMALLEST) & (size * 2.0 ** (1.0 / BLOCKS) <= LARGEST)
    return known


def phase_for(error: float) -> float:
    """Return the phase in radians that may lie between points of the grid: it misses at most ``error``."""
    return min(float((384.0 * error / (3.0 * MISSED)) ** 0.25), MOST_PHASE)


def missed(
    model: str, radius: np.ndarray, incidence: np.ndarray, wavenumber: float, phase: float
) -> np.ndarray:
    """(M,) metres that f may be off that of ``disc`` up to a wavenumber, because of the splines."""
    step = phase * COARSER[model]
    size, (row_step, column_step) = wavenumber * radius, _steps(_block(radius), wavenumber, step)
    if model == "paper":
        slope = size**0.3523 * column_step  # of the error function, and its argument's
        share = STEEP * (slope**4 + (row_step / radius) ** 4) / 384.0 + ROUNDED
        fit: np.ndarray = 0.55 * radius * size * share * np.ones_like(incidence)
        return fit
    sine, cosine = np.sin(incidence), np.cos(incidence)
    over_angle = 2.0 * (size * cosine + RIPPLE * size) * column_step
    over_size = (2.0 * sine + 2.0 * RIPPLE) * wavenumber * row_step
    rim = np.maximum(2.0 * size * sine, 1.0) ** -0.5
    envelope = 0.5 * size * cosine * np.minimum(1.0, 2.0 * rim**3) + rim
    share = (over_angle**4 + over_size**4) / 384.0 + over_size**6 / 216.0
    off: np.ndarray = radius * envelope * (MISSED * share + ROUNDED)
    return off


def modes_of(model: str, ends: tuple[float, float], phase: float, largest: float) -> DiscModes:
    """The modes of discs between two wavenumbers, up to a radius that has rows; kept."""
    return _modes(model, ends, phase, math.floor(BASES * math.log2(largest)) + 1)


@lru_cache(maxsize=KEPT)
def _modes(model: str, ends: tuple[float, float], phase: float, top: int) -> DiscModes:
    return DiscModes(model, ends, phase, 2.0 ** (top / BASES))


class DiscModes(BandModes):
    """Modes of discs between two wavenumbers (1/m), and their rows."""

    def __init__(self, model: str, ends: tuple[float, float], phase: float, largest: float) -> None:
        self._model, self._phase = model, phase
        self._step = phase * COARSER[model]
        across = (ends[1] - ends[0]) / 2 * largest  # radians over half the band, in a radius
        super().__init__(ends, 16 * math.ceil((24.0 + 1.2 * ECHOING[model] * across) / 16.0))
        self.keep(self._found(largest))
        self._first = np.empty(0, np.int64)  # rows before each block, in the order of their making
        self._place: dict[int, int] = {}
        self._parts: list[tuple[np.ndarray, ...]] = []
        self._whole: dict[int, np.ndarray] = {}
        self._cells: tuple[np.ndarray, ...] = ()

    def _found(self, largest: float) -> np.ndarray:
        """(K, R) the modes, of discs spread over all radii and incidences, each re its radius."""
        smallest = SMALLEST / self._ends[1]
        radius = np.exp2(np.linspace(math.log2(min(smallest, largest)), math.log2(largest), RADII))
        angle = (np.arange(ANGLES) + 0.5) * (0.5 * math.pi / ANGLES)
        values = np.empty((self.count, RADII * ANGLES), np.complex128)
        for number, one in enumerate(radius.tolist()):
            size = self.wavenumber[:, None] * one
            some = slice(number * ANGLES, (number + 1) * ANGLES)
            values[:, some] = backscatter_amplitude(size, angle, self._model) / size
        return leading(values, min(RANKS[-1], self.count))

    def places(self, radius: np.ndarray, incidence: np.ndarray) -> DiscPlaces:
        """Find discs in the table; radius (M,) that has rows, incidence (M,) 0 to π/2."""
        block = _block(radius)
        present, which = np.unique(block, return_inverse=True)
        self._make([one for one in present.tolist() if one not in self._place])
        row_step, column_step = _steps(present, self._ends[1], self._step)
        columns = np.rint(0.5 * math.pi / column_step).astype(np.int64)
        first = self._first[[self._place[one] for one in present.tolist()]]
        place = (radius - _block_radius(present)[which]) / row_step[which] + MARGIN
        row = place.astype(np.int64)
        across = (place - row).astype(np.float32)
        place = incidence / column_step[which]
        column = np.minimum(place.astype(np.int64), columns[which] - 1)
        along = (place - column).astype(np.float32)
        width = (columns + 3)[which]
        cell = (row - 1) * width + column  # in its block: these stand in the order of their making
        # Numbers that hold their places sort much faster than places by numbers.
        key = which * (cell.max(initial=0) + 1) + cell
        order = np.sort((key << 32) | np.arange(len(cell))) & 0xFFFFFFFF
        cell = (first[which] + cell).astype(np.int32)[order]
        weight = np.empty((len(radius), 4, 4), np.float32)
        beside = spline_weights(along[order])
        for i, one in enumerate(spline_weights(across[order])):
            for j, other in enumerate(beside):
                np.multiply(one, other, out=weight[:, i, j])
        width = width[order].astype(np.int32)
        return DiscPlaces(order, cell, width, weight.reshape(-1, 16))

    def shares(self, places: DiscPlaces, rank: int) -> np.ndarray:
        """(m, rank) complex64 metres, of the modes in each disc, in the order of the places."""
        rows, four = self._rows(rank), np.arange(4, dtype=np.int32)
        read = places.cell[:, None] + places.width[:, None] * four
        read = read[:, :, None] + four
        ends = np.arange(0, 16 * len(places) + 1, 16, dtype=np.int32)
        shape = (len(places), len(rows))
        picked = sparse.csr_matrix((places.weight.ravel(), read.ravel(), ends), shape=shape)
        found: np.ndarray = (picked @ rows.view(np.float32)).view(np.complex64)
        return found

    def amplitude(
        self, wavenumber: np.ndarray, radius: np.ndarray, angle: np.ndarray
    ) -> np.ndarray:
        """(Q, M) complex64 f in metres by all modes, at wavenumbers (Q,) and incidences (M,)."""
        places, rank = self.places(radius, angle), self.ranks[-1]
        at = self.at(wavenumber, rank).astype(np.complex64)
        found = np.empty((len(wavenumber), len(places)), np.complex64)
        found[:, places.order] = (self.shares(places, rank) @ at).T
        return found

    def left_out(self, places: DiscPlaces, loud: np.ndarray) -> tuple[np.ndarray, float]:
        """Σ loud·|f| that is left out at most: (levels,) by modes beyond each of ``ranks``, and by the
        splines; loud (M,) in the order of the places."""
        left, off, _ = self._bounds()
        runs = np.flatnonzero(np.diff(places.cell, prepend=-1))
        total, cell = np.add.reduceat(loud, runs), places.cell[runs]
        lost = np.einsum("n,nl->l", total, left.take(cell, axis=0))
        return lost, float(np.einsum("n,n->", total, off.take(cell)))

    def errors(self, radius: np.ndarray, incidence: np.ndarray) -> np.ndarray:
        """(M,) metres that ``amplitude`` may be off."""
        places = self.places(radius, incidence)
        left, off, _ = self._bounds()
        error = np.empty(len(places))
        error[places.order] = left[:, -1].take(places.cell) + off.take(places.cell)
        return error

    def loudest(self, places: DiscPlaces) -> np.ndarray:
        """(M, ``QUARTERS``) metres, about the largest |f| in each quarter of the band, and no more, in the
        order of the places."""
        found: np.ndarray = self._bounds()[2].take(places.cell, axis=0)
        return found

    def _bounds(self) -> tuple[np.ndarray, ...]:
        if not self._cells:
            joined = [np.concatenate(column) for column in zip(*self._parts, strict=True)]
            self._cells = tuple(joined[1:])
        return self._cells

    def _rows(self, rank: int) -> np.ndarray:
        if rank not in self._whole:
            self._whole[rank] = np.concatenate([part[0][:, :rank] for part in self._parts])
        return self._whole[rank]

    def _make(self, blocks: list[int]) -> None:
        """Add the rows of some blocks."""
        for block in blocks:
            self._place[block] = len(self._first)
            self._first = np.append(self._first, sum(len(part[0]) for part in self._parts))
            self._parts.append(self._block(block))
        if blocks:
            self._whole, self._cells = {}, ()

    def _block(self, block: int) -> tuple[np.ndarray, ...]:
        """Rows (N, R) of a block, and of each cell what modes leave out (N, levels), what splines miss (N,)
        and the loudest (N, quarters)."""
        one = np.array([block])
        row_step, column_step = (float(s[0]) for s in _steps(one, self._ends[1], self._step))
        start, end = _block_radius(one)[0], _block_radius(one + 1)[0]
        count = math.ceil((end - start) / row_step) + 1 + 2 * MARGIN
        radius = start + row_step * (np.arange(count) - MARGIN)
        angle = column_step * np.arange(round(0.5 * math.pi / column_step) + 1)
        values = _over_rows(self._over_angles(radius, angle))
        shares = values @ np.conj(self.modes).astype(np.complex64)
        left = self._left(values[::APART, ::APART], shares[::APART, ::APART])
        left = np.repeat(np.repeat(left, APART, axis=0), APART, axis=1)[: len(radius), : len(angle)]
        upper = np.clip(radius + row_step, start, end * (1.0 - 1e-12))[:, None]
        off = missed(self._model, upper, angle, self._ends[1], self._phase)
        off = np.maximum(off, np.append(off[:, 1:], off[:, -1:], axis=1))
        loud = self._loud(shares)
        # A cell is named by the first of its sixteen rows: a radius before, and a column before its own.
        flat = [shares.reshape(-1, shares.shape[2])]
        for what in (left, off, loud):
            whole = np.zeros((*shares.shape[:2], *what.shape[2:]), np.float32)
            whole[:-1, : len(angle)] = what[1:]
            flat.append(whole.reshape(-1, *what.shape[2:]))
        return tuple(flat)

    def _over_angles(self, radius: np.ndarray, angle: np.ndarray) -> np.ndarray:
        """(S, V + 2, K) complex64 f, as coefficients of splines over the incidence."""
        size = np.outer(radius, self.wavenumber)
        if self._model == "exact":
            found = tabulated_on(size.ravel(), angle, _coefficients)
        else:
            step = angle[1] - angle[0]
            wider = step * np.arange(-REACH - 1, len(angle) + REACH + 1)
            beside = continued_paper(size.ravel()[:, None], wider)
            found = _coefficients_within(beside.astype(np.complex64))
        found /= np.tile(self.wavenumber, len(radius)).astype(np.float32)[:, None]
        lines = found.reshape(len(radius), self.count, -1)
        return np.ascontiguousarray(lines.transpose(0, 2, 1))

    def _left(self, values: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """(s, v, levels) metres that modes beyond each rank add at most, around some of the rows."""
        rest, modes = values.copy(), self.modes.astype(np.complex64)
        found, begin = [], 0
        for rank in self.ranks:
            rest -= shares[:, :, begin:rank] @ modes[:, begin:rank].T
            found.append(np.abs(rest).max(axis=2))
            begin = rank
        last = chebyshev.series(self.count)[3 * self.count // 4 :].astype(np.float32)
        beyond = np.abs(values @ last.T).sum(axis=2)
        left = CAUTION * np.stack(found, axis=2) + UNSEEN * beyond[:, :, None]
        for axis in (0, 1):  # the four by four rows of a cell lie in three by three of these
            some = np.pad(left, [(1, 1) if a == axis else (0, 0) for a in range(3)], mode="edge")
            some = np.moveaxis(some, axis, 0)
            left = np.moveaxis(np.maximum(np.maximum(some[:-2], some[1:-1]), some[2:]), 0, axis)
        return left

    def _loud(self, shares: np.ndarray) -> np.ndarray:
        """(S, V, quarters) metres, the least at the corners of a cell of the largest |f| in each quarter."""
        low, high = self._ends
        few = low + (high - low) * (np.arange(QUARTERS * FEW) + 0.5) / (QUARTERS * FEW)
        at = self.at(few, shares.shape[2]).astype(np.complex64)
        values = (shares[:, :-2] + 4.0 * shares[:, 1:-1] + shares[:, 2:]) / np.float32(6.0)
        values[1:-1] = (values[:-2] + 4.0 * values[1:-1] + values[2:]) / np.float32(6.0)
        wave = values @ at
        size = np.abs(wave)
        for axis in (0, 1):
            wave, size = np.moveaxis(wave, axis, 0), np.moveaxis(size, axis, 0)
            same = (wave[:-1] * np.conj(wave[1:])).real > 0.0  # otherwise it may vanish between
            size[:-1] = np.where(same, np.minimum(size[:-1], size[1:]), 0.0)
            wave, size = np.moveaxis(wave, 0, axis), np.moveaxis(size, 0, axis)
        loudest: np.ndarray = LEAST * size.reshape(*size.shape[:2], QUARTERS, FEW).max(axis=3)
        return loudest


def _block(radius: np.ndarray) -> np.ndarray:
    """(M,) number of the block of a radius."""
    number: np.ndarray = np.floor(BLOCKS * np.log2(np.maximum(radius, 1e-30))).astype(np.int64)
    return number


def _block_radius(block: np.ndarray) -> np.ndarray:
    """(M,) metres, the smallest of a block."""
    return np.exp2(block / BLOCKS)


def _steps(block: np.ndarray, wavenumber: float, phase: float) -> tuple[np.ndarray, np.ndarray]:
    """(M,) metres and radians between points of the grid of a block."""
    row_step = np.full(np.shape(block), phase / (LATEST * wavenumber))
    columns = np.ceil(math.pi * wavenumber * _block_radius(block + 1) / phase)
    return row_step, 0.5 * math.pi / columns


def _over_rows(lines: np.ndarray) -> np.ndarray:
    """Coefficients of splines along the first axis; within ``MARGIN`` of its ends they are not right."""
    count = len(lines)
    outer, inner, middle = TAPS
    filtered, beside = lines.copy(), np.empty_like(lines[2:-2])
    filtered[2:-2] *= middle
    for tap, apart in ((inner, 1), (outer, 2)):
        np.add(lines[2 - apart : -2 - apart], lines[2 + apart : count - 2 + apart], out=beside)
        beside *= tap
        filtered[2:-2] += beside
    return filtered


def _coefficients(lines: np.ndarray) -> np.ndarray:
    """(U, V + 2) coefficients of splines through values (U, V) over the incidence, even about both ends."""
    before, after = lines[:, REACH + 1 : 0 : -1], lines[:, -2 : -3 - REACH : -1]
    return _coefficients_within(np.concatenate([before, lines, after], axis=1))


def _coefficients_within(lines: np.ndarray) -> np.ndarray:
    """The same of values that go on for ``REACH`` + 1 points at both ends."""
    found = lines @ _inverse(lines.shape[1])
    coefficients: np.ndarray = found[:, REACH : found.shape[1] - REACH]
    return coefficients


@lru_cache(maxsize=16)
def _inverse(count: int) -> sparse.csr_matrix:
    """(count, count) float32 and symmetric, from values to coefficients, away from the ends."""
    offset = np.arange(-REACH, REACH + 1)
    taps = math.sqrt(3.0) * (math.sqrt(3.0) - 2.0) ** np.abs(offset)
    diagonals = [
        np.full(count - abs(o), t, np.float32) for o, t in zip(offset.tolist(), taps, strict=True)
    ]
    return sparse.diags_array(diagonals, offsets=offset, format="csr")
