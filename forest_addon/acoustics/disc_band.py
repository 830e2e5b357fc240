"""The exact disc at the few wavenumbers of one band: splines over radius and incidence, read row by row.

``disc_table`` gives k·f at one size and incidence after the other, sixteen reads each. A sum over many discs
wants the same wavenumbers k_1 … k_R of every disc: here a row of R values stands at each point of a grid over
radius and incidence, and a disc is sixteen rows, weighted. Rows are made of the larger table along one axis
after the other, for some radii at a time when they are first asked for, and kept.

What crosses a disc comes later than what its rims send back. Times e^{ika·``LATER``} the response lies evenly
around its own delay, and is smoother over the band: fewer wavenumbers do.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from scipy import sparse

from .disc_table import HANDOVER, RIPPLE, ROUNDED, spline_weights, tabulated_on

LATER = 1.0  # radii
SMALLEST = 6.0  # ka from where on radii have rows
LARGEST = HANDOVER - 6.0  # ka up to which
BLOCKS = 8  # an octave of radii, made at once
REACH = 12  # points to which the coefficient of a spline depends on values: 0.27^12 is 1e-7
TAPS = np.array(
    [1 / 36, -5 / 18, 3 / 2, -5 / 18, 1 / 36]
)  # values to coefficients, to the 6th order
MARGIN = 3  # rows beyond a block, for these and for the spline
MISSED = 1.0  # of what the envelope says; at most 0.6 of it was found
MOST_PHASE = 0.8  # radians
KEPT = 6  # sets of wavenumbers


def has_rows(radius: np.ndarray, wavenumber: float) -> np.ndarray:
    """(M,) whether a radius has rows at wavenumbers up to ``wavenumber``."""
    size = wavenumber * _block_radius(_block(radius))
    known: np.ndarray = (size >= SMALLEST) & (size * 2.0 ** (1.0 / BLOCKS) <= LARGEST)
    return known


def phase_for(error: float) -> float:
    """Return the phase in radians that may lie between points of the grid: it misses at most ``error``."""
    return min(float((384.0 * error / (3.0 * MISSED)) ** 0.25), MOST_PHASE)


def missed(
    radius: np.ndarray, incidence: np.ndarray, wavenumber: float, phase: float
) -> np.ndarray:
    """(M,) metres that f may be off that of ``disc_table`` up to a wavenumber, as ``table_error`` has it."""
    size, (row_step, column_step) = wavenumber * radius, _steps(_block(radius), wavenumber, phase)
    sine, cosine = np.sin(incidence), np.cos(incidence)
    over_angle = 2.0 * (size * cosine + RIPPLE * size) * column_step
    over_size = (2.0 * sine + LATER + RIPPLE) * wavenumber * row_step
    rim = np.maximum(2.0 * size * sine, 1.0) ** -0.5
    envelope = 0.5 * size * cosine * np.minimum(1.0, 2.0 * rim**3) + rim
    share = (over_angle**4 + over_size**4) / 384.0 + over_size**6 / 216.0
    off: np.ndarray = radius * envelope * (MISSED * share + ROUNDED)
    return off


def banded(
    wavenumber: np.ndarray, radius: np.ndarray, incidence: np.ndarray, phase: float
) -> np.ndarray:
    """(R, M) complex64 f·e^{ika·LATER} in metres, of discs that have rows.

    wavenumber : (R,) the same at every call, for what is kept. incidence : (M,) 0 to π/2.
    """
    return _band(np.asarray(wavenumber, np.float64).tobytes(), phase).values(radius, incidence).T


class _BandTable:
    """Rows at R wavenumbers, block by block of radii; block b starts at 2^(b/``BLOCKS``) metres."""

    def __init__(self, wavenumber: np.ndarray, phase: float) -> None:
        self._wavenumber, self._phase = wavenumber, phase
        self._highest = float(wavenumber.max())
        self._first = np.empty(0, np.int64)  # rows before each block, in the order of their making
        self._place: dict[int, int] = {}
        self._rows, self._used = np.empty((0, len(wavenumber)), np.complex64), 0

    def values(self, radius: np.ndarray, incidence: np.ndarray) -> np.ndarray:
        """(m, R) complex64."""
        block = _block(radius)
        present, which = np.unique(block, return_inverse=True)
        self._make([one for one in present.tolist() if one not in self._place])
        row_step, column_step = _steps(present, self._highest, self._phase)
        columns = np.rint(0.5 * math.pi / column_step).astype(np.int64)
        first = self._first[[self._place[one] for one in present.tolist()]]
        place = (radius - _block_radius(present)[which]) / row_step[which] + MARGIN
        row = place.astype(np.int64)
        across = (place - row).astype(np.float32)
        place = incidence / column_step[which]
        column = np.minimum(place.astype(np.int64), columns[which] - 1)
        along = (place - column).astype(np.float32)
        width = (columns + 3)[which]
        corner = (first[which] + (row - 1) * width + column).astype(np.int32)

        order = np.argsort(corner, kind="stable")  # rows that lie together are read together
        weights = np.einsum("im,jm->mij", spline_weights(across), spline_weights(along))
        four, wide = np.arange(4, dtype=np.int32), width.astype(np.int32)[order]
        read = corner[order, None, None] + (wide[:, None, None] * four[:, None] + four)
        ends = np.arange(0, 16 * len(radius) + 1, 16, dtype=np.int32)
        shape = (len(radius), len(self._rows))
        picked = sparse.csr_matrix((weights[order].ravel(), read.ravel(), ends), shape=shape)
        values = np.empty((len(radius), self._rows.shape[1]), dtype=np.complex64)
        values[order] = (picked @ self._rows.view(np.float32)).view(np.complex64)
        return values

    def _make(self, blocks: list[int]) -> None:
        """Add the rows of some blocks."""
        for block in blocks:
            made = self._block_rows(block)
            until = self._used + len(made)
            if until > len(self._rows):  # room for more: each row is moved a few times at most
                wider = np.empty((2 * until, self._rows.shape[1]), np.complex64)
                wider[: self._used] = self._rows[: self._used]
                self._rows = wider
            self._rows[self._used : until] = made
            self._place[block] = len(self._first)
            self._first = np.append(self._first, self._used)
            self._used = until

    def _block_rows(self, block: int) -> np.ndarray:
        """(rows · columns, R) coefficients of the splines of a block."""
        one = np.array([block])
        row_step, column_step = (float(step[0]) for step in _steps(one, self._highest, self._phase))
        start, end = _block_radius(one)[0], _block_radius(one + 1)[0]
        count = math.ceil((end - start) / row_step) + 1 + 2 * MARGIN
        radius = start + row_step * (np.arange(count) - MARGIN)
        angle = column_step * np.arange(round(0.5 * math.pi / column_step) + 1)
        size = np.outer(radius, self._wavenumber)
        found = tabulated_on(size.ravel(), angle, _coefficients)
        found *= (
            (np.exp(1j * LATER * size) / self._wavenumber).astype(np.complex64).ravel()[:, None]
        )
        lines = found.view(np.float32).reshape(count, -1)
        outer, inner, middle = TAPS[:3].astype(np.float32).tolist()
        filtered, beside = lines.copy(), np.empty_like(lines[2:-2])
        filtered[2:-2] *= middle
        for tap, apart in ((inner, 1), (outer, 2)):
            np.add(lines[2 - apart : -2 - apart], lines[2 + apart : count - 2 + apart], out=beside)
            beside *= tap
            filtered[2:-2] += beside
        made = filtered.view(np.complex64).reshape(count, len(self._wavenumber), len(angle) + 2)
        return np.ascontiguousarray(made.transpose(0, 2, 1)).reshape(-1, len(self._wavenumber))


@lru_cache(maxsize=KEPT)
def _band(wavenumber: bytes, phase: float) -> _BandTable:
    return _BandTable(np.frombuffer(wavenumber), phase)


def _block(radius: np.ndarray) -> np.ndarray:
    """(M,) number of the block of a radius."""
    number: np.ndarray = np.floor(BLOCKS * np.log2(np.maximum(radius, 1e-30))).astype(np.int64)
    return number


def _block_radius(block: np.ndarray) -> np.ndarray:
    """(M,) metres, the smallest of a block."""
    return np.exp2(block / BLOCKS)


def _steps(block: np.ndarray, wavenumber: float, phase: float) -> tuple[np.ndarray, np.ndarray]:
    """(M,) metres and radians between points of the grid of a block."""
    row_step = np.full(len(block), phase / ((2.0 + LATER) * wavenumber))
    columns = np.ceil(math.pi * wavenumber * _block_radius(block + 1) / phase)
    return row_step, 0.5 * math.pi / columns


def _coefficients(lines: np.ndarray) -> np.ndarray:
    """(U, V + 2) coefficients of splines through values (U, V) over the incidence, even about both ends."""
    turned = np.concatenate(
        [lines[:, REACH + 1 : 0 : -1], lines, lines[:, -2 : -3 - REACH : -1]], axis=1
    )
    found = turned @ _inverse(turned.shape[1])
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
