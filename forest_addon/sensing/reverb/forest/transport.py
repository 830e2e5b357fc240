"""Sound that trunks scatter again and again, as energy: transport in the plane, spread in height.

A stand's density, trunks' radii, and where source and receiver are come in; energy by path length goes out.
Energy goes straight for a free path 1/(nσ), meets a trunk, is turned by an angle drawn from |H(f, φ)|², and
so on; at every meeting what would go to the receiver is counted (next-event estimation, Lux & Koblinger
1991). In the units of the response, a source of energy 1/r² at r, the energy a metre of path is

    E(x) = 2π·P(r, x)/x,

P the density in the plane: trunks keep the vertical wavenumber, so that what reaches the receiver travelled
level, and spread in height as any sound has over x. ``isotropic`` is P where trunks send alike all round
(Paasschens 1997). What is lost a metre, and the ground, depend on x alone (``losses``) and come later.

With ``energy`` extinction the shadow, which goes straight on, is not a meeting: the lobe around straight on
that holds so much of the energy is taken off |H|².
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ....acoustics.cylinder import transfer
from ....acoustics.extinction import cross_sections
from ....base.vectors import azimuth_of

ANGLES = 1440  # of the table of |H|², 0 to π
EDGES = np.linspace(0.0, math.pi, ANGLES + 1)
MOST_MEETINGS = 400
STEPS = 24  # of the density along a way
NEAREST = 0.05  # m; energy that meets a trunk so near the receiver is counted as at this distance
FAINT = 1e-7  # of the packets' energy, below which they are not followed
THINNED = 20.0  # mean free paths from which on fewer packets stand for the rest

Sent = Callable[[np.ndarray], np.ndarray]  # energy that a source sends on ways (N, 3), re its axis


def alike(way: np.ndarray) -> np.ndarray:
    """(N,) ones: a source that sends alike to all sides."""
    return np.ones(len(way))


@dataclass(frozen=True)
class Density:
    """Trunks per m²: of cells (A, B) of ``cell`` metres from a corner, and around them.

    A single cell is a stand that is even inside its edges.
    """

    cells: np.ndarray
    corner: tuple[float, float]
    cell: tuple[float, float]
    around: float

    @classmethod
    def even(cls, density: float) -> Density:
        """The same everywhere."""
        return cls(np.zeros((0, 0)), (0.0, 0.0), (1.0, 1.0), density)

    @property
    def largest(self) -> float:
        """Of all places."""
        return max(float(self.cells.max(initial=0.0)), self.around)

    @property
    def mean(self) -> float:
        """Of the cells; around them where there are none."""
        return float(self.cells.mean()) if self.cells.size else self.around

    def at(self, place: np.ndarray) -> np.ndarray:
        """(...,) at places (..., 2)."""
        if self.cells.size == 0:
            return np.full(place.shape[:-1], self.around)
        if self.cells.size == 1:
            inside = np.ones(place.shape[:-1], bool)
            for axis in range(2):
                along = place[..., axis] - self.corner[axis]
                inside &= (along >= 0) & (along < self.cell[axis])
            return np.where(inside, self.cells[0, 0], self.around)
        cell = np.floor((place - self.corner) / self.cell)
        inside = ((cell >= 0) & (cell < self.cells.shape)).all(axis=-1)
        i, j = np.where(inside[..., None], cell, 0).astype(np.int64).reshape(-1, 2).T
        found = self.cells[i, j].reshape(inside.shape)
        return np.where(inside, found, self.around)

    def between(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """(N,) trunks per m of width on straight ways from (N, 2) to (2,)."""
        length = np.hypot(*(end - start).T)
        if self.cells.size == 0:
            return self.around * length
        if self.cells.size == 1:
            inside = self._within(start, end - start)
            return length * (self.around + inside * (float(self.cells[0, 0]) - self.around))
        share = (np.arange(STEPS) + 0.5) / STEPS
        places = start[:, None] + share[:, None] * (end - start)[:, None]
        found: np.ndarray = self.at(places).mean(axis=1) * length
        return found

    def left(self, place: np.ndarray, way: np.ndarray) -> np.ndarray:
        """(N,) bool, whether straight ways (N, 2) from places (N, 2) meet no trunk any more."""
        if self.cells.size == 0 or self.around > 0:
            return np.zeros(len(place), bool)
        return self._within(place, way * 1e9) <= 0

    def _within(self, start: np.ndarray, way: np.ndarray) -> np.ndarray:
        """(N,) share of straight ways (N, 2) that lies within the outer edges of all cells."""
        enter, leave = np.zeros(len(start)), np.ones(len(start))
        corner, cell = np.broadcast_to(self.corner, 2), np.broadcast_to(self.cell, 2)
        for axis in range(2):  # column by column: rows of two are slow to reduce
            low = corner[axis] - start[:, axis]
            high = low + cell[axis] * self.cells.shape[axis]
            safe = np.where(way[:, axis] == 0, 1e-300, way[:, axis])
            first, second = low / safe, high / safe
            enter = np.maximum(enter, np.minimum(first, second))
            leave = np.minimum(leave, np.maximum(first, second))
        return np.asarray(np.maximum(leave - enter, 0.0))


@dataclass(frozen=True)
class PhaseFunction:
    """Phase function of a stand's trunks at a frequency.

    width : m, what a trunk takes out. kept : share of that that is scattered, the rest stays in the bark.
    angle : (A,) 0 to π. density : (A,) per radian to one side, its integral over both sides is ``kept``.
    """

    width: float
    kept: float
    angle: np.ndarray
    density: np.ndarray

    @classmethod
    def of(
        cls, frequency: float, radii: np.ndarray, speed: float, bark: float, extinction: str
    ) -> PhaseFunction:
        """The mean over radii. extinction : "energy" without the shadow, else with it."""
        angle = math.pi * (np.arange(ANGLES) + 0.5) / ANGLES
        scattered = np.abs(transfer(frequency, angle[:, None], radii, speed, bark)) ** 2
        mean = scattered.mean(axis=1)
        size = 2.0 * math.pi * frequency / speed * radii
        found = cross_sections(size, bark)
        width = float((found.extinction * radii).mean())
        if extinction == "energy":
            less = float((found.energy * radii).mean())
            mean = _without_shadow(mean, width - less)
            width = less
        step = math.pi / ANGLES
        return cls(width, 2.0 * step * float(mean.sum()) / width, angle, mean / width)

    @cached_property
    def _whole(self) -> np.ndarray:
        """(A + 1,) the density's sums, from straight on."""
        return np.concatenate([[0.0], np.cumsum(self.density)])

    def draw(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """(N,) angles, to both sides."""
        whole = self._whole
        turned = np.interp(rng.random(count) * whole[-1], whole, EDGES)
        found: np.ndarray = turned * rng.choice((-1.0, 1.0), count)
        return found

    def towards(self, turned: np.ndarray) -> np.ndarray:
        """(N,) share per radian that is turned by angles in 0 to π."""
        row = np.minimum((turned * (ANGLES / math.pi)).astype(np.int64), ANGLES - 1)
        found: np.ndarray = self.density[row]
        return found


def _without_shadow(scattered: np.ndarray, shadow: float) -> np.ndarray:
    """|H|² by angle, less a lobe around straight on that holds an energy, metres."""
    if shadow <= 0:
        return scattered
    step = math.pi / len(scattered)
    held = 2.0 * step * np.cumsum(scattered)
    last = min(int(np.searchsorted(held, shadow)), len(held) - 1)
    found = scattered.copy()
    over = held[last] - shadow  # of the cell in which the lobe ends
    found[:last] = 0.0
    found[last] = max(over, 0.0) / (2.0 * step)
    return found


@dataclass(frozen=True)
class Energy:
    """E(x) of a source and a receiver, without losses along the path.

    edges : (X + 1,) metres of path. once, again : (X,) per metre, scattered once and more than once.
    """

    edges: np.ndarray
    once: np.ndarray
    again: np.ndarray

    @property
    def middle(self) -> np.ndarray:
        """(X,) metres."""
        return np.sqrt(self.edges[1:] * self.edges[:-1])

    def at(self, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """once and again at path lengths, by their logarithms; 0 before the first."""
        found = []
        for part in (self.once, self.again):
            heard = part > 0
            if heard.sum() < 2:
                found.append(np.zeros(len(length)))
                continue
            values = np.interp(np.log(length), np.log(self.middle[heard]), np.log(part[heard]))
            found.append(np.where(length >= self.edges[0], np.exp(values), 0.0))
        return found[0], found[1]


def transported(
    phase: PhaseFunction,
    density: Density,
    source: np.ndarray,
    receiver: np.ndarray,
    edges: np.ndarray,
    packets: int,
    rng: np.random.Generator,
    sent: Sent = alike,
) -> Energy:
    """The energy by path length, by packets that start at the source.

    source, receiver : (2,) metres. edges : (X + 1,) metres of path, rising. sent : energy by ways (N, 3).
    """
    rate = density.largest * phase.width  # meetings a metre, real and not
    found = np.zeros((2, len(edges) - 1))
    if rate > 0 and packets > 0:
        place = np.tile(np.asarray(source, np.float64), (packets, 1))
        heading = 2.0 * math.pi * (np.arange(packets) + rng.random(packets)) / packets
        travelled, met = np.zeros(packets), np.zeros(packets, np.int64)
        weight = sent(np.column_stack([np.cos(heading), np.sin(heading), np.zeros(packets)]))
        way = np.column_stack([np.cos(heading), np.sin(heading)])
        for _ in range(MOST_MEETINGS * 4):
            step = rng.exponential(1.0 / rate, len(place))
            place += step[:, None] * way
            before = np.maximum(travelled, THINNED / rate)
            travelled += step
            left = np.minimum(before / travelled, 1.0)  # by chance: as many meet in each bin of 1/x
            weight /= left
            going = (travelled < edges[-1]) & (rng.random(len(left)) < left)
            going &= (met < MOST_MEETINGS) & (weight > FAINT)
            if density.cells.size:
                going &= ~density.left(place, way)
            if not going.all():
                place, way, heading = place[going], way[going], heading[going]
                travelled, weight, met = travelled[going], weight[going], met[going]
            if len(place) == 0:
                break
            if density.cells.size:
                real = rng.random(len(place)) * density.largest < density.at(place)
            else:
                real = np.ones(len(place), bool)
            rows = np.flatnonzero(real)
            away = receiver - place[rows]
            distance = np.hypot(away[:, 0], away[:, 1])
            turned = azimuth_of(away) - heading[rows]
            turned = np.abs((turned + math.pi) % (2.0 * math.pi) - math.pi)
            through = np.exp(-density.between(place[rows], receiver) * phase.width)
            counted = weight[rows] * phase.towards(turned) * through
            counted *= 2.0 * math.pi / np.maximum(distance, NEAREST)
            length = travelled[rows] + distance
            again = (met[rows] > 0).astype(np.int64)
            column = np.searchsorted(edges, length, side="right") - 1
            inside = (column >= 0) & (column < len(edges) - 1)
            np.add.at(found, (again[inside], column[inside]), counted[inside] / length[inside])
            heading[rows] += phase.draw(rng, len(rows))
            way[rows] = np.column_stack([np.cos(heading[rows]), np.sin(heading[rows])])
            weight[rows] *= phase.kept
            met[rows] += 1
    found /= max(packets, 1) * np.diff(edges)
    return Energy(edges, found[0], found[1])


def isotropic(
    distance: float, length: np.ndarray, free_path: float
) -> tuple[np.ndarray, np.ndarray]:
    """Once and more than once scattered energy a metre, 2π·P/x, of a free path (Paasschens 1997).

    distance : m between source and receiver. length : (X,) metres of path, larger than that.
    """
    root = np.sqrt(np.maximum(length**2 - distance**2, 1e-300))
    once = np.exp(-length / free_path) / (free_path * root * length)
    return once, once * np.expm1(root / free_path)
