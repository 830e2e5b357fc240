"""The sum over trunks of many radii, panel by panel of frequency: H at a few nodes, then transforms.

Paths by trunks go in, Σ_m w_m·e^{-(b+ik)x_m}·H(f, φ_m, a_m) comes out on an even grid of frequencies, as
from ``scattering.scattered_spectrum``, which is the exact sum. In a panel of frequencies

    w_m·e^{-b(f)x_m}·H(f)·e^{+ikx_m'} = f^{3/2}·Σ_q ℓ_q(f)·h_mq,   x' = x less a share of the radius,

with the polynomials ℓ_q of a few Chebyshev nodes f_q, and Σ_m h_mq·e^{-ikx_m'} is a non-uniform Fourier
transform for each q (``acoustics/gridding``). Air, radius and angle are in the heights h, each trunk's
own, and every panel has its own scale: the error is relative in each band. The heights come from a table
over ka and φ (``field_table``) by Chebyshev series over boxes of radius and angle. In each panel the
heights of some trunks are compared with partial wave sums at frequencies between the nodes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ....acoustics import chebyshev
from ....acoustics.cylinder import scattering_sum
from ....acoustics.gridding import DelayGrid, width_for
from ....acoustics.spectrum import phasors
from ....base.rng import stream
from ....base.rows import distinct
from ..forest.losses import NEAR
from .audible import Audibility
from .boxes import Boxes, Shift
from .field_table import middle, near_face, series
from .path_gain import PathGain
from .scattering import TrunkPaths

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


@dataclass(frozen=True)
class PanelCheck:
    """Relative error of H at a frequency, in Hz, the root of its mean square over some trunks."""

    frequency: float
    error: float


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
    heard: Audibility | None = None,
) -> tuple[np.ndarray, list[PanelCheck]]:
    """(F,) spectrum at 0, 1, … ``count`` - 1 times ``spacing`` Hz, 0 below ``lowest``, and what checks found.

    loss : what is lost at frequencies (F,) in Hz, nepers per metre; smooth, or panels become narrow.
    gain : of each path, by frequency and length; None: 1. bark : share that it absorbs head on.
    heard : panels in which nothing is heard of these paths are left out; None: all are summed.
    """
    spectrum = np.zeros(count, np.complex128)
    checks = []
    for rows in _of_like_radius(paths.radius):
        group = _Group(paths.select(rows), spacing, loss, speed, tolerance, gain, bark)
        checks += group.add_to(spectrum, lowest, heard)
    return spectrum, checks


def _of_like_radius(radius: np.ndarray) -> Iterator[np.ndarray]:
    """Rows of trunks that share panels, the thickest first; those of no width scatter nothing."""
    left = np.argsort(radius, kind="stable")
    left = left[radius[left] > 0]
    while len(left):
        start = int(np.searchsorted(radius[left], radius[left[-1]] / RATIO))
        yield left[start:]
        left = left[:start]


def by_distance(
    length: np.ndarray, gain: PathGain | None, loss_per_metre: float
) -> Iterator[np.ndarray]:
    """Rows of trunks whose paths lose alike, and near ones, over which a gain changes fast, apart.

    loss_per_metre : nepers at USUAL.
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
        self.probes, self.rng = np.unique(drawn), rng

    def add_to(
        self, spectrum: np.ndarray, lowest: int = 1, heard: Audibility | None = None
    ) -> list[PanelCheck]:
        """Add these trunks' sound in the panels where it is heard."""
        of_bin = 2.0 * math.pi / self.speed * self.spacing * self.thickest  # ka
        last, first, end, checks = len(spectrum) - 1, lowest, FIRST, []
        energy = heard.energy_of(self.paths) if heard else {}
        while end < of_bin * first:
            end = min(GROWTH * end, end + WIDEST)
        while first <= last:
            stop = min(last, max(first, int(end / of_bin)))
            within = first * self.spacing, stop * self.spacing
            if heard is None or heard.heard(energy, *within):
                panel = _Panel(self, first, stop)
                while not panel.fits:  # it turns too much for one
                    stop = (first + stop) // 2
                    panel = _Panel(self, first, stop)
                spectrum[first : stop + 1] += panel.spectrum()
                checks += panel.checks
            first, end = stop + 1, min(GROWTH * end, end + WIDEST)
        return checks


class _Panel:
    """The bins ``first`` to ``last``.

    nodes : (Q,) Hz. fits : whether MOST_NODES are enough.
    shift : what is taken off the paths, over the radius, as a function of the angle.
    """

    def __init__(self, group: _Group, first: int, last: int) -> None:
        self.group, self.first = group, first
        self.frequency = np.arange(first, last + 1) * group.spacing
        ends = 2.0 * math.pi / group.speed * self.frequency[[0, -1]]
        self.boxes = Boxes(group.paths, ends, group.allowed, group.bark)
        self.checks: list[PanelCheck] = []
        loss = self._loss(self.frequency[[len(self.frequency) // 2]])
        loud = group.loudness * np.exp(-2.0 * loss * (group.paths.length - group.nearest))
        loud += 1e-300
        self.typical = float(
            np.average(group.paths.length, weights=loud)
        )  # m; air is taken off so far
        nodes, self.shift = self._nodes()
        self.fits = nodes is not None
        self.nodes = self.frequency[:0] if nodes is None else nodes

    def _nodes(self) -> tuple[np.ndarray | None, Shift]:
        """As few as the thickest trunks need, with the better of two shifts."""
        if len(self.frequency) <= FEW_BINS:
            return self.frequency, middle
        tried = self._spread(TRIED_NODES)
        z = self._wavenumber(tried) * self.group.thickest
        step = -(-len(self.boxes.angles) // TRIED_ANGLES)
        angles = self.boxes.angles[::step]
        values = self.boxes.table.at(z, slice(None, None, step))
        # what the air leaves of it, relative to the loudest trunks'
        farther = self.group.farther
        left = np.exp(-np.outer(self._loss(tried), farther - self.typical)).astype(np.complex128)
        if self.group.gain is not None:
            left *= self.group.gain.at(tried, farther).T
            left /= np.sqrt(np.mean(np.abs(left) ** 2, axis=0))
        best, shift = MOST_NODES + 1, middle
        for way in (near_face, middle):
            turned = values * np.exp(-1j * np.outer(z, way(angles) - middle(angles)))
            size = np.abs(series(turned[:, :, None] * left[:, None], 0)).max(axis=2)
            tail = np.cumsum(size[::-1], axis=0)[::-1]
            large = (tail > self.group.allowed * np.abs(values).min(axis=0)).any(axis=1)
            count = max(3, int(np.flatnonzero(large)[-1]) + 2)
            if count < best:
                best, shift = count, way
        return (self._spread(best) if best <= MOST_NODES else None), shift

    def _spread(self, count: int) -> np.ndarray:
        low, high = self.frequency[[0, -1]]
        return low + 0.5 * (high - low) * (chebyshev.points(count) + 1.0)

    def _wavenumber(self, frequency: np.ndarray) -> np.ndarray:
        return 2.0 * math.pi / self.group.speed * frequency

    def _loss(self, frequency: np.ndarray) -> np.ndarray:
        """Nepers per metre."""
        return self.group.loss(frequency)

    def spectrum(self) -> np.ndarray:
        """(K,) of the bins."""
        group, count = self.group, len(self.frequency)
        k = self._wavenumber(self.nodes)
        rows, heights = self.boxes.heights(k, self.shift)
        paths = group.paths.select(rows)
        self._check(rows, paths, heights)
        heights *= np.exp(-np.outer(paths.length - self.typical, self._loss(self.nodes)))
        if group.gain is not None:
            heights *= group.gain.at(self.nodes, paths.length)
        weight = paths.weight * paths.radius**2
        delay = (paths.length - paths.radius * self.shift(paths.angle)) / group.speed
        level = self._wavenumber(self.frequency) ** 1.5
        level *= np.exp(-self.typical * self._loss(self.frequency))
        if count <= FEW_BINS:
            carried = phasors(np.outer(delay, self.nodes))
            return (weight[:, None] * heights * carried).sum(axis=0) * level
        heights *= (weight * phasors(self.frequency[count // 2] * delay))[:, None]
        grid = DelayGrid(count, len(k), group.kernel)
        for start in range(0, len(rows), TRUNKS_AT_ONCE):
            some = slice(start, start + TRUNKS_AT_ONCE)
            grid.add(delay[some] * group.spacing, heights[some])
        parts = grid.spectrum()
        parts *= chebyshev.lagrange(len(k), np.linspace(-1.0, 1.0, count))
        found: np.ndarray = parts.sum(axis=0) * level
        return found

    def _check(self, rows: np.ndarray, paths: TrunkPaths, heights: np.ndarray) -> None:
        """Compare the heights of some trunks, between the nodes, with partial wave sums."""
        here = np.flatnonzero(np.isin(rows, self.group.probes))
        some = paths.select(here)
        low, high = self.frequency[[0, -1]]
        frequency = self.group.rng.uniform(low, high)
        k = float(self._wavenumber(np.array(frequency)))
        place = (
            np.array([2.0 * (frequency - low) / (high - low) - 1.0]) if high > low else np.zeros(1)
        )
        if len(self.frequency) <= FEW_BINS:
            k, found = float(self._wavenumber(self.nodes[0])), heights[here, 0]
            frequency = float(self.nodes[0])
        else:
            found = heights[here] @ chebyshev.lagrange(len(self.nodes), place)[:, 0]
        z = k * some.radius
        exact = np.conj(np.exp(0.25j * math.pi) * scattering_sum(z, some.angle, self.group.bark))
        exact *= math.sqrt(2.0 / math.pi) / z**2 * np.exp(-1j * z * self.shift(some.angle))
        size = some.weight * some.radius**2
        error = np.linalg.norm(size * (found - exact)) / np.linalg.norm(size * exact)
        self.checks.append(PanelCheck(frequency, float(error)))
