"""The sum over trunks of many radii, panel by panel of frequency: H at a few nodes, then transforms.

Paths by trunks go in, Σ_m w_m·e^{-(b+ik)x_m}·H(f, φ_m, a_m) comes out on an even grid of frequencies, as
from ``scattering.scattered_spectrum``, which is the exact sum. In a panel of frequencies

    w_m·e^{-b(f)x_m}·H(f)·e^{+ikx_m'} = f^{3/2}·Σ_q ℓ_q(f)·h_mq,   x' = x less ``middle`` of the radius,

with the polynomials ℓ_q of a few Chebyshev nodes f_q, and Σ_m h_mq·e^{-ikx_m'} is a non-uniform Fourier
transform for each q (``acoustics/gridding``). Air, radius and angle are in the heights h, each trunk's
own, and every panel has its own scale: the error is relative in each band. The heights come from a table
over ka and φ by Chebyshev series over boxes of radius and angle. In each panel the
heights of some trunks are compared with partial wave sums at frequencies between the nodes.

H of many trunks of unlike radius and angle, at a few wavenumbers, from a table at the corners of boxes.

Radii and angles are cut into boxes in which H is a Chebyshev series of both; the series' values come from a
table over ka and the angle (``field_table``), so that a trunk costs a few products and no Bessel function.

H of trunks at some angles for every size ka between two, from a few hundred partial wave sums.

H·k^{-3/2}/a² is a function of z = ka and of the angle φ alone: one table serves all radii, frequencies and
sampling rates. Along z it is kept as Chebyshev series over short stretches, times (1 + z²)^{3/4}, which
levels it from Rayleigh's law (z -> 0) to geometrical optics, and without its middle delay: the echo off
the near face comes 2a·sin(φ/2)/c before, the wave that creeps around by φ comes aφ/c after the axis'
own time, so that a·(sin(φ/2) - φ/2)/c is the middle of both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from scipy import special

from ....acoustics import chebyshev
from ....acoustics.cylinder import order_count, partial_waves, scattering_sum
from ....acoustics.gridding import DelayGrid, width_for
from ....base.rng import stream
from ....base.rows import distinct
from ..forest.losses import NEAR
from .path_gain import PathGain
from .scattering import Check, TrunkPaths

USUAL, LOST, MOST_GROUPS = (
    500.0,
    2.0,
    16,
)  # Hz; nepers by which paths that share panels differ there
RATIO = 4.0  # thickest over thinnest radius of the trunks that share panels
FIRST, GROWTH, WIDEST = (
    0.1,
    4.0,
    16.0,
)  # ends of panels in ka of the thickest: the first; factor; step
MOST_NODES, TRIED_NODES = 40, 64  # of a panel; at which its series is looked at
TRIED_ANGLES = 96  # of the table, at most
FARTHER = (0.0, 0.02, 0.1, 0.3, 0.6, 1.0)  # shares of the trunks, at which the air is looked at
FEW_BINS = 6  # of a panel that needs no interpolation
SHARE = 0.5  # of the tolerance, for each approximation
TRUNKS_AT_ONCE = 8192
PROBES = 24  # trunks whose heights are checked in each panel


def panel_spectrum(
    paths: TrunkPaths,
    spacing: float,
    count: int,
    loss: Callable[[np.ndarray], np.ndarray],
    speed: float,
    tolerance: float,
    gain: PathGain | None = None,
    bark: float = 0.0,
    lowest: int = 1,
    heard: Callable[[float, float], bool] | None = None,
) -> tuple[np.ndarray, list[Check]]:
    """(F,) spectrum at 0, 1, … ``count`` - 1 times ``spacing`` Hz, 0 below ``lowest``, and what checks found.

    loss : what is lost at frequencies (F,) in Hz, nepers per metre; smooth, or panels become narrow.
    gain : of each path, by frequency and length; None: 1. bark : share that it absorbs head on.
    heard : whether these paths are heard between two frequencies in Hz; None: everywhere.
    """
    spectrum = np.zeros(count, np.complex128)
    checks = []
    for rows in _of_like_radius(paths.radius):
        group = _Group(paths.select(rows), spacing, loss, speed, tolerance, gain, bark)
        checks += group.add_to(spectrum, lowest, heard)
    return spectrum, checks


def _of_like_radius(radius: np.ndarray) -> Iterator[np.ndarray]:
    """Rows of trunks that share panels, the thickest first; those of no width scatter nothing."""
    left = np.flatnonzero(radius > 0)
    while len(left):
        alike = radius[left] >= radius[left].max() / RATIO
        yield left[alike]
        left = left[~alike]


def by_distance(
    length: np.ndarray, gain: PathGain | None, loss_per_metre: float
) -> Iterator[np.ndarray]:
    """Rows of trunks whose paths lose alike, and near ones, over which a gain changes fast, apart.

    loss_per_metre : nepers, by which paths of a group differ by LOST at most.
    """
    span = float(np.ptp(length))
    count = int(np.clip(math.ceil(span * loss_per_metre / LOST), 1, MOST_GROUPS))
    number = np.minimum((length - length.min()) * (count / max(span, 1e-9)), count - 1).astype(int)
    if gain is not None:
        number = 2 * number + (length >= NEAR)
    for n in distinct(number):
        yield np.flatnonzero(number == n)


class _Group:
    """Trunks whose radii differ by RATIO at most."""

    def __init__(
        self,
        paths: TrunkPaths,
        spacing: float,
        loss: Callable[[np.ndarray], np.ndarray],
        speed: float,
        tolerance: float,
        gain: PathGain | None,
        bark: float,
    ) -> None:
        self.paths, self.spacing, self.loss, self.speed = paths, spacing, loss, speed
        self.gain, self.bark = gain, bark
        # errors of loud trunks are spread over the record: its faint end feels them first
        self.allowed = SHARE * tolerance * min(1.0, tolerance / 1e-4) ** 0.25
        self.kernel = width_for(SHARE * tolerance)
        self.thickest = float(paths.radius.max())
        self.farther = np.quantile(paths.length, FARTHER)
        self.loudness = np.square(paths.weight * paths.radius**2)
        self.nearest = float(paths.length.min())
        rng = stream(len(paths.length), "panels", "checks")
        loudness = np.square(paths.weight * paths.radius)
        drawn = (
            rng.choice(len(loudness), PROBES, p=loudness / loudness.sum())
            if loudness.any()
            else [0]
        )
        self.probed, self.rng = np.zeros(len(loudness), bool), rng
        self.probed[drawn] = True

    def add_to(
        self,
        spectrum: np.ndarray,
        lowest: int,
        heard: Callable[[float, float], bool] | None,
    ) -> list[Check]:
        """Add these trunks' sound in the panels where it is heard."""
        of_bin = 2.0 * math.pi / self.speed * self.spacing * self.thickest  # ka
        last, first, end, checks = len(spectrum) - 1, lowest, FIRST, []
        while end < of_bin * first:
            end = min(GROWTH * end, end + WIDEST)
        while first <= last:
            stop = min(last, max(first, int(end / of_bin)))
            if heard is None or heard(first * self.spacing, stop * self.spacing):
                panel = _Panel(self, first, stop)
                while not panel.fits:  # it turns too much for one
                    stop = (first + stop) // 2
                    panel = _Panel(self, first, stop)
                spectrum[first : stop + 1] += panel.spectrum()
                checks += panel.checks
            first, end = stop + 1, min(GROWTH * end, end + WIDEST)
        return checks


class _Panel:
    """The bins ``first`` to ``last``. nodes : (Q,) Hz. fits : whether MOST_NODES are enough."""

    def __init__(self, group: _Group, first: int, last: int) -> None:
        self.group, self.first = group, first
        self.frequency = np.arange(first, last + 1) * group.spacing
        ends = 2.0 * math.pi / group.speed * self.frequency[[0, -1]]
        self.boxes = Boxes(group.paths, ends, group.allowed, group.bark)
        self.checks: list[Check] = []
        loss = self.group.loss(self.frequency[[len(self.frequency) // 2]])
        loud = group.loudness * np.exp(-2.0 * loss * (group.paths.length - group.nearest)) + 1e-300
        self.typical = float(
            np.average(group.paths.length, weights=loud)
        )  # m; air is taken off so far
        self.nodes = self._nodes()
        self.fits = len(self.nodes) <= MOST_NODES

    def _nodes(self) -> np.ndarray:
        """The fewest nodes that the thickest trunks need."""
        if len(self.frequency) <= FEW_BINS:
            return self.frequency
        ends = float(self.frequency[0]), float(self.frequency[-1])
        tried = chebyshev.points(TRIED_NODES, *ends)
        z = self._wavenumber(tried) * self.group.thickest
        step = -(-len(self.boxes.angles) // TRIED_ANGLES)
        values = self.boxes.table.at(z, slice(None, None, step))
        # what the air leaves of it, relative to the loudest trunks'
        farther = self.group.farther
        left = np.exp(-np.outer(self.group.loss(tried), farther - self.typical)).astype(
            np.complex128
        )
        if self.group.gain is not None:
            left *= self.group.gain.at(tried, farther).T
            left /= np.sqrt(np.mean(np.abs(left) ** 2, axis=0))
        size = np.abs(chebyshev.coefficients(values[:, :, None] * left[:, None], 0)).max(axis=2)
        needed = chebyshev.terms_needed(size, self.group.allowed * np.abs(values).min(axis=0))
        return chebyshev.points(max(3, needed), *ends)

    def _wavenumber(self, frequency: np.ndarray) -> np.ndarray:
        return 2.0 * math.pi / self.group.speed * frequency

    def spectrum(self) -> np.ndarray:
        """(K,) of the bins."""
        group, count = self.group, len(self.frequency)
        k, loss = self._wavenumber(self.nodes), self.group.loss(self.nodes)
        level = self._wavenumber(self.frequency) ** 1.5
        level *= np.exp(-self.typical * self.group.loss(self.frequency))
        grid = DelayGrid(count, len(k), group.kernel)
        checked = []
        for rows, heights in self.boxes.heights(k):
            probed = np.flatnonzero(group.probed[rows])
            checked.append((rows[probed], heights[probed]))
            paths = group.paths.select(rows)
            heights *= np.exp(np.outer(self.typical - paths.length, loss))
            if group.gain is not None:
                heights *= group.gain.at(self.nodes, paths.length)
            weight = paths.weight * paths.radius**2
            delay = (paths.length - paths.radius * middle(paths.angle)) / group.speed
            middle_of = self.frequency[count // 2] * delay
            grid.add(delay * group.spacing, middle_of, heights.T, weight[:, None])
        probes, of_probes = (np.concatenate(each) for each in zip(*checked, strict=True))
        self._check(group.paths.select(probes), of_probes)
        polynomials = (
            np.eye(count)
            if count <= FEW_BINS
            else chebyshev.lagrange(len(k), np.linspace(-1.0, 1.0, count))
        )
        return grid.spectrum(polynomials) * level

    def _check(self, some: TrunkPaths, heights: np.ndarray) -> None:
        """Compare the heights (M, Q) of some trunks, between the nodes, with partial wave sums."""
        low, high = self.frequency[[0, -1]]
        frequency = self.group.rng.uniform(low, high)
        k = float(self._wavenumber(np.array(frequency)))
        if len(self.frequency) <= FEW_BINS:
            k, summed = float(self._wavenumber(self.nodes[0])), heights[:, 0]
            frequency = float(self.nodes[0])
        else:
            share = np.array([(frequency - low) / (high - low)])
            summed = heights @ chebyshev.lagrange(len(self.nodes), 2.0 * share - 1.0)[:, 0]
        z = k * some.radius
        exact = np.conj(np.exp(0.25j * math.pi) * scattering_sum(z, some.angle, self.group.bark))
        exact *= math.sqrt(2.0 / math.pi) / z**2 * np.exp(-1j * z * middle(some.angle))
        size = some.weight * some.radius**2
        error = np.linalg.norm(size * (summed - exact)) / np.linalg.norm(size * exact)
        self.checks.append((frequency, float(error)))


REACH = 2.6  # radians by which H turns to both sides of its middle when ka grows by 1
TURN, WIDEST_TURN = 0.75, 6.0  # radians by which H turns from the middle of a box to its side
FULL = 40  # trunks a box; with fewer, boxes are larger
LEAST = 0.03  # of the tolerance, for leaving out a term
SPARSE = 2  # trunks a node of a sector's angles, below which each trunk has an angle of its own
VALUES_AT_ONCE = 1 << 21


class Boxes:
    """Trunks by radius and angle: in each box their heights are a Chebyshev series of both, whose terms of
    high order in both are left out.

    angles : (C,) of the table's columns. Sectors of the angle that hold few trunks have these trunks'
    own angles for columns. kept : of each order of the angle, how many of the radius.
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
        sizes = np.outer(self.sectors.sizes, self.bins.sizes)
        self.kept = (sizes > LEAST * allowed).sum(axis=1).tolist()
        self.alone = np.flatnonzero(sparse[self.sectors.of])
        self.filled = np.flatnonzero(~sparse)
        of_sectors = self.sectors.points()[self.filled].ravel()
        self.angles = np.concatenate([of_sectors, angle[self.alone]])
        low, high = wavenumber[0] * radius.min(), wavenumber[1] * radius.max()
        self.table = FieldTable(float(low), float(high), self.angles, bark)

    def heights(self, k: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Rows (m,) of some trunks and their H·k^{-3/2}/a² (m, Q) at wavenumbers (Q,), until all were."""
        sectors, bins = self.sectors, self.bins
        for rows in _some_of(self.alone):
            column = len(self.angles) - len(self.alone) + np.searchsorted(self.alone, rows)
            yield rows, self.table.each(np.outer(self.paths.radius[rows], k), column)
        of = np.searchsorted(self.filled, sectors.of)
        of[self.alone] = len(self.filled)
        key = of * bins.count + bins.of
        few_bytes = np.min_scalar_type((len(self.filled) + 1) * bins.count)
        order = np.argsort(key.astype(few_bytes), kind="stable")
        several = max(1, VALUES_AT_ONCE // (bins.count * bins.nodes * sectors.nodes * len(k)))
        for first in range(0, len(self.filled), several):
            last = min(first + several, len(self.filled))
            columns = slice(first * sectors.nodes, last * sectors.nodes)
            series = self._series(k, columns)
            ends = np.searchsorted(key, np.array([first, last]) * bins.count, sorter=order)
            for rows in _some_of(order[slice(*ends)]):
                across = bins.polynomials(rows)
                around = zip(sectors.polynomials(rows), self.kept, strict=True)
                basis = np.concatenate([one * across[:kept] for one, kept in around]).T
                box = key[rows] - first * bins.count
                starts = np.flatnonzero(np.diff(box, prepend=-1))
                heights = np.empty((len(rows), len(k)), np.complex128)
                parts = zip(starts.tolist(), [*starts[1:].tolist(), len(rows)], strict=True)
                for start, end in parts:
                    out = heights[start:end].view(np.float64)
                    np.matmul(basis[start:end], series[box[start]], out=out)
                yield rows, heights

    def _series(self, k: np.ndarray, columns: slice) -> np.ndarray:
        """(S·B, T, 2Q) real coefficients in the boxes of some sectors and all bins."""
        nodes, z = self.sectors.nodes, np.multiply.outer(self.bins.points(), k)  # (B, A, Q)
        values = self.table.at(z.ravel(), columns)
        values = values.reshape(*z.shape, -1, nodes)  # (B, A, Q, S, C)
        packed = np.ascontiguousarray(values.transpose(3, 0, 4, 1, 2)).view(np.float64)
        across = chebyshev.coefficients(np.eye(self.bins.nodes), 0)
        around = zip(chebyshev.coefficients(np.eye(nodes), 0), self.kept, strict=True)
        terms = np.concatenate([np.kron(one, across[:kept]) for one, kept in around])
        return np.asarray(terms @ packed.reshape(-1, terms.shape[1], 2 * len(k)))


def _some_of(rows: np.ndarray) -> Iterator[np.ndarray]:
    """TRUNKS_AT_ONCE of rows (M,) at a time."""
    for start in range(0, len(rows), TRUNKS_AT_ONCE):
        yield rows[start : start + TRUNKS_AT_ONCE]


class _Side:
    """One side of the boxes: equal parts of the span of values (M,) over which H turns so much."""

    def __init__(
        self, values: np.ndarray, turn: float, most: float, allowed: float, poles: float = 0.0
    ) -> None:
        """poles : how far in turns H has poles beside the side, which lie about 1 off in ka; 0: none."""
        self.values = values
        self.low, self.span = float(values.min()), float(np.ptp(values))
        self.count = max(1, math.ceil(turn / most))
        self.sizes = np.ones(1)
        if self.span > 0:
            sizes = _term_sizes(turn / self.count, poles)
            self.sizes = sizes[: np.count_nonzero(sizes > LEAST * allowed) + 1]
        self.nodes = len(self.sizes)
        self.step = self.span / self.count
        share = (values - self.low) / (self.step or 1.0)
        self.of = np.minimum(share.astype(np.int64), self.count - 1)

    def points(self) -> np.ndarray:
        """(parts, nodes) Chebyshev points of each part."""
        within = chebyshev.points(self.nodes, 0.0, 1.0)
        return self.low + self.step * (np.arange(self.count)[:, None] + within)

    def polynomials(self, rows: np.ndarray) -> np.ndarray:
        """(nodes, m) Chebyshev polynomials of each value's place in its part."""
        place = 2.0 * ((self.values[rows] - self.low) / (self.step or 1.0) - self.of[rows]) - 1.0
        return chebyshev.polynomials(place, self.nodes)


def _term_sizes(turn: float, poles: float) -> np.ndarray:
    """(N,) largest coefficient, from each order on, of the Chebyshev series of e^{i·turn·x}, |x| <= 1:
    2·i^n·J_n (DLMF 10.12.3).

    With poles at ±i·poles/turn, coefficients fall as 2·ρ^-n, ρ from the ellipse through them, at the least.
    """
    order = np.arange(64)
    sizes = 2.0 * np.abs(special.jv(order, turn))
    if poles > 0 and turn > 0:
        sizes = np.maximum(sizes, 2.0 * (poles / turn + math.hypot(1.0, poles / turn)) ** -order)
    return np.maximum.accumulate(sizes[::-1])[::-1]


STRETCHES = (0.5, 2.0, 6.0)  # ends of the first in z; then WIDTH each
WIDTH = 6.0
NODES = 40  # of a stretch: 1e-8 or better of H
SMALLEST = 1e-7  # z below which H/z² is constant to rounding
FIRST_SERIES = 64  # values at once


def middle(angle: np.ndarray) -> np.ndarray:
    """Lead, over the radius, of the middle of a trunk's answer before the axis' own time."""
    return np.sin(0.5 * angle) - 0.5 * angle


class FieldTable:
    """H·k^{-3/2}/a²·e^{-iz·middle(φ)} for z from ``low`` to ``high`` at angles (C,)."""

    def __init__(self, low: float, high: float, angles: np.ndarray, bark: float = 0.0) -> None:
        ends = np.array([0.0, *STRETCHES, *np.arange(STRETCHES[-1] + WIDTH, high + WIDTH, WIDTH)])
        first = max(0, int(np.searchsorted(ends, low)) - 1)
        self._ends = ends[first : int(np.searchsorted(ends, high)) + 1]
        z = chebyshev.points(NODES, self._ends[:-1, None], self._ends[1:, None])
        values = field(z.ravel(), angles, bark)
        values *= np.exp(-1j * np.outer(z, middle(angles))) * ((1.0 + z**2) ** 0.75).reshape(-1, 1)
        self._series = chebyshev.coefficients(values.reshape(len(z), NODES, len(angles)), 1)

    def at(self, z: np.ndarray, columns: slice = slice(None)) -> np.ndarray:
        """(Z, C) values at sizes (Z,) of some of the angles."""
        stretch, place = self._place(z)
        values = np.empty((len(z), self._series[0, :, columns].shape[1]), np.complex128)
        for number in np.unique(stretch):
            rows = np.flatnonzero(stretch == number)
            coefficients = np.ascontiguousarray(self._series[number, :, columns])
            part = chebyshev.polynomials(place[rows], NODES).T @ coefficients.view(np.float64)
            values[rows] = part.view(np.complex128)
        values *= ((1.0 + z**2) ** -0.75)[:, None]
        return values

    def each(self, z: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """(M, Q) values at sizes (M, Q), each row at the angle of its column (M,)."""
        values = np.empty(z.shape, np.complex128)
        for start in range(0, len(z), FIRST_SERIES):
            some = slice(start, start + FIRST_SERIES)
            stretch, place = self._place(z[some])
            basis = chebyshev.polynomials(place.ravel(), NODES).T.reshape(*place.shape, NODES)
            series_of = self._series[stretch, :, columns[some, None]]  # (m, Q, NODES)
            values[some] = (basis * series_of).sum(axis=2)
        values *= (1.0 + z**2) ** -0.75
        return values

    def _place(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Stretch of sizes, and where in it, from -1 to 1."""
        stretch = np.clip(np.searchsorted(self._ends, z) - 1, 0, len(self._ends) - 2)
        low, high = self._ends[stretch], self._ends[stretch + 1]
        return stretch, 2.0 * (z - low) / (high - low) - 1.0


def field(z: np.ndarray, angles: np.ndarray, bark: float = 0.0) -> np.ndarray:
    """(Z, C) H·k^{-3/2}/a² at sizes (Z,) and angles (C,), by partial waves."""
    z = np.maximum(z, SMALLEST)
    waves = partial_waves(z, order_count(float(z.max())), bark)
    waves[1:] *= 2.0
    waves *= np.exp(0.25j * math.pi) * math.sqrt(2.0 / math.pi) / z**2
    turns = np.cos(np.outer(np.arange(len(waves)), angles))
    return waves.real.T @ turns - 1j * (waves.imag.T @ turns)
