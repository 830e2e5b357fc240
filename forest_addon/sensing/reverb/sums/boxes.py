"""H of many trunks of unlike radius and angle, at a few wavenumbers, from a table at the corners of boxes.

Radii and angles are cut into boxes in which H is a Chebyshev series of both; the series' values come from a
table over ka and the angle (``field_table``), so that a trunk costs a few products and no Bessel function.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy import special

from ....acoustics import chebyshev
from .field_table import FieldTable, middle, polynomials, series
from .scattering import TrunkPaths

Shift = Callable[[np.ndarray], np.ndarray]  # of angles
REACH = 2.6  # radians by which H turns to both sides of its middle when ka grows by 1
TURN, WIDEST_TURN = 1.5, 6.0  # radians by which H turns from the middle of a box to its side
FULL = 40  # trunks a box; with fewer, boxes are larger
SPARSE = 2  # trunks a node of a sector's angles, below which each trunk has an angle of its own
VALUES_AT_ONCE = 1 << 21


class Boxes:
    """Trunks by radius and angle: in each box their heights are a Chebyshev series of both.

    angles : (C,) of the table's columns. Sectors of the angle that hold few trunks have these trunks'
    own angles for columns.
    """

    def __init__(
        self, paths: TrunkPaths, wavenumber: np.ndarray, allowed: float, bark: float
    ) -> None:
        self.paths = paths
        radius, angle, k = paths.radius, paths.angle, float(wavenumber[1])
        across = REACH * k * float(np.ptp(radius)) / 2
        # both creeping waves, and at the least Rayleigh's 1 - 2cos φ
        around = (1.5 * k * float(radius.max()) + 4.0) * float(np.ptp(angle)) / 2
        turn = TURN
        while True:
            self.bins = _Side(radius, across, turn, allowed, poles=REACH)
            self.sectors = _Side(angle, around, turn, allowed)
            population = np.bincount(self.sectors.of, minlength=self.sectors.count)
            sparse = population <= SPARSE * self.sectors.nodes
            boxes = self.bins.count * int((~sparse).sum())
            if turn >= WIDEST_TURN or boxes * FULL <= len(radius):
                break
            turn *= math.sqrt(2.0)
        self.alone = np.flatnonzero(sparse[self.sectors.of])
        self.filled = np.flatnonzero(~sparse)
        of_sectors = self.sectors.points()[self.filled].ravel()
        self.angles = np.concatenate([of_sectors, angle[self.alone]])
        low, high = wavenumber[0] * radius.min(), wavenumber[1] * radius.max()
        self.table = FieldTable(float(low), float(high), self.angles, bark)

    def heights(self, k: np.ndarray, shift: Shift) -> tuple[np.ndarray, np.ndarray]:
        """Rows (M,) of all trunks in the order of boxes, and H·k^{-3/2}/a² (M, Q) at wavenumbers (Q,)."""
        sectors, bins = self.sectors, self.bins
        key = bins.of * sectors.count + sectors.of
        key[self.alone] = bins.count * sectors.count
        order = np.argsort(key, kind="stable")
        held = len(order) - len(self.alone)
        heights = np.empty((len(order), len(k)), np.complex128)
        heights[held:] = self._each_alone(order[held:], k, shift)
        rows = order[:held]
        around, across = sectors.lagrange(rows), bins.lagrange(rows)
        basis = (around[:, :, None] * across[:, None]).reshape(held, sectors.nodes * bins.nodes)
        starts = np.flatnonzero(np.diff(key[rows], prepend=-1)).tolist()
        ends = [*starts[1:], held]
        box = key[rows[starts]] if starts else np.empty(0, np.int64)
        several = max(1, VALUES_AT_ONCE // (bins.count * bins.nodes * sectors.nodes * len(k)))
        for first in range(0, len(self.filled), several):
            some = self.filled[first : first + several]
            columns = slice(first * sectors.nodes, (first + len(some)) * sectors.nodes)
            values = self._values(k, shift, columns)  # (bins, sectors, T, Q)
            number = np.searchsorted(some, box % sectors.count)
            inside = number < len(some)
            inside[inside] = some[number[inside]] == (box % sectors.count)[inside]
            for n in np.flatnonzero(inside):
                here = slice(starts[n], ends[n])
                of_box = values[box[n] // sectors.count, number[n]].view(np.float64)
                np.matmul(basis[here], of_box, out=heights[here].view(np.float64))
        return order, heights

    def _values(self, k: np.ndarray, shift: Shift, columns: slice) -> np.ndarray:
        """(B, S, T, Q) at the Chebyshev points of the boxes of all bins and some sectors."""
        radii, angles = self.bins.points(), self.angles[columns]
        z = np.multiply.outer(radii, k)  # (B, A, Q)
        values = self.table.at(z.ravel(), columns)
        if shift is not middle:
            values *= np.exp(-1j * np.outer(z, shift(angles) - middle(angles)))
        values = values.reshape(*z.shape, -1, self.sectors.nodes)  # (B, A, Q, S, C)
        packed: np.ndarray = np.ascontiguousarray(values.transpose(0, 3, 4, 1, 2))
        return packed.reshape(len(radii), -1, self.bins.nodes * self.sectors.nodes, len(k))

    def _each_alone(self, rows: np.ndarray, k: np.ndarray, shift: Shift) -> np.ndarray:
        """(m, Q) of the trunks of sparse sectors."""
        first = len(self.filled) * self.sectors.nodes
        column = first + np.searchsorted(self.alone, rows)
        z = np.outer(self.paths.radius[rows], k)
        angle = self.paths.angle[rows]
        found = self.table.each(z, column)
        if shift is not middle:
            found *= np.exp(-1j * z * (shift(angle) - middle(angle))[:, None])
        return found


class _Side:
    """One side of the boxes: equal parts of the span of values (M,) over which H turns so much."""

    def __init__(
        self, values: np.ndarray, turn: float, most: float, allowed: float, poles: float = 0.0
    ) -> None:
        """poles : how far in turns H has poles beside the side, which lie about 1 off in ka; 0: none."""
        self.values = values
        self.low, self.span = float(values.min()), float(np.ptp(values))
        self.count = max(1, math.ceil(turn / most))
        self.nodes = _nodes_for(turn / self.count, allowed, poles) if self.span > 0 else 1
        self.step = self.span / self.count
        share = (values - self.low) / (self.step or 1.0)
        self.of = np.minimum(share.astype(np.int64), self.count - 1)

    def points(self) -> np.ndarray:
        """(parts, nodes) Chebyshev points of each part."""
        within = 0.5 * (chebyshev.points(self.nodes) + 1.0)
        found: np.ndarray = self.low + self.step * (np.arange(self.count)[:, None] + within)
        return found

    def lagrange(self, rows: np.ndarray) -> np.ndarray:
        """(m, nodes) polynomials of each value's part, which are 1 at one of its points and 0 at others."""
        place = 2.0 * ((self.values[rows] - self.low) / (self.step or 1.0) - self.of[rows]) - 1.0
        found: np.ndarray = polynomials(place, self.nodes).T @ series(np.eye(self.nodes), 0)
        return found


def _nodes_for(turn: float, allowed: float, poles: float = 0.0) -> int:
    """Terms of the Chebyshev series of e^{i·turn·x}, |x| <= 1: coefficients 2·i^n·J_n (DLMF 10.12.3).

    With poles at ±i·poles/turn, coefficients fall as ρ^-n, ρ from the ellipse through them, at the least.
    """
    order = np.arange(64)
    count = int(order[2.0 * np.abs(special.jv(order, turn)) > 0.1 * allowed].max()) + 2
    if poles > 0 and turn > 0:
        ellipse = poles / turn + math.hypot(1.0, poles / turn)
        count = max(count, math.ceil(math.log(1.0 / allowed) / math.log(ellipse)) + 1)
    return count
