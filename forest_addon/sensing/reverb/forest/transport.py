"""Sound that trunks scatter again and again, as energy: transport in the plane, spread in height.

A stand's density, trunks' radii, and where source and receiver are come in; energy by path length goes out.
Energy goes straight for a free path 1/(nσ), meets a trunk, is turned by an angle drawn from |H(f, φ)|², and
so on; at every meeting what would go to the receiver is counted (next-event estimation, Lux & Koblinger
1991). In the units of the response, a source of energy 1/r² at r, the energy a metre of path is

    E(x) = 2π·P(r, x)/x,

P the density in the plane: trunks keep the vertical wavenumber, so that what reaches the receiver travelled
level, and spread in height as any sound has over x. Where trunks send alike all round P has a closed
form (Paasschens 1997). What is lost a metre, and the ground, depend on x alone (``losses``) and come later.

With ``energy`` extinction the shadow, which goes straight on, is not a meeting: the lobe around straight on
that holds so much of the energy is taken off |H|².
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ....acoustics.cylinder import transfer
from ....acoustics.extinction import cross_sections
from ....base.vectors import azimuth_of

ANGLES = 1440  # of the table of |H|², 0 to π
MOST_MEETINGS = 400
STEPS = 24  # of the density along a way
NEAREST = (
    0.5  # m; energy that is turned nearer to the receiver is counted as its mean over that disc
)
FAINT = 1e-7  # of the packets' energy, below which they are not followed
THINNED = 10.0  # mean free paths from which on fewer packets stand for the rest
SHARES = 8  # of the packets, whose energies apart tell how far all together may be off

Sent = Callable[[np.ndarray], np.ndarray]  # energy that a source sends on ways (N, 3), re its axis


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
        """Largest density of all places."""
        return max(float(self.cells.max(initial=0.0)), self.around)

    @property
    def mean(self) -> float:
        """Mean density of the cells, or that around them where there are none."""
        return float(self.cells.mean()) if self.cells.size else self.around

    def at(self, place: np.ndarray) -> np.ndarray:
        """(...,) at places (..., 2)."""
        if self.cells.size == 0:
            return np.full(place.shape[:-1], self.around)
        if self.cells.size == 1:
            return np.where(self.inside(place), self.cells[0, 0], self.around)
        cell = np.floor((place - self.corner) / self.cell)
        inside = ((cell >= 0) & (cell < self.cells.shape)).all(axis=-1)
        i, j = np.where(inside[..., None], cell, 0).astype(np.int64).reshape(-1, 2).T
        return np.where(inside, self.cells[i, j].reshape(inside.shape), self.around)

    def inside(self, place: np.ndarray) -> np.ndarray:
        """(...,) bool, whether places (..., 2) lie within the outer edges of all cells."""
        within = np.ones(place.shape[:-1], bool)
        for axis, count in enumerate(self.cells.shape):
            along = place[..., axis] - self.corner[axis]
            within &= (along >= 0) & (along < count * self.cell[axis])
        return within

    def between(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """(N,) trunks per m of width on straight ways from (N, 2) to (2,)."""
        length = np.hypot(*(end - start).T)
        if self.cells.size == 0:
            return self.around * length
        if self.cells.size == 1:
            inside = np.ones(len(start))
            if not self.inside(end):
                inside = self._within(start, end - start)
            elif not (within := self.inside(start)).all():
                inside[~within] = self._within(start[~within], (end - start)[~within])
            return length * (self.around + inside * (float(self.cells[0, 0]) - self.around))
        share = (np.arange(STEPS) + 0.5) / STEPS
        places = start[:, None] + share[:, None] * (end - start)[:, None]
        return self.at(places).mean(axis=1) * length

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
        sections = cross_sections(2.0 * math.pi * frequency / speed * radii, bark)
        width = float((sections.extinction * radii).mean())
        if extinction == "energy":
            less = float((sections.energy * radii).mean())
            mean = without_shadow(mean, width - less)
            width = less
        step = math.pi / ANGLES
        return cls(width, 2.0 * step * float(mean.sum()) / width, angle, mean / width)


def without_shadow(scattered: np.ndarray, shadow: float) -> np.ndarray:
    """|H|² by angle, less a lobe around straight on that holds an energy, metres."""
    if shadow <= 0:
        return scattered
    step = math.pi / len(scattered)
    held = 2.0 * step * np.cumsum(scattered)
    last = min(int(np.searchsorted(held, shadow)), len(held) - 1)
    unshadowed = scattered.copy()
    over = held[last] - shadow  # of the cell in which the lobe ends
    unshadowed[:last] = 0.0
    unshadowed[last] = max(over, 0.0) / (2.0 * step)
    return unshadowed


@dataclass(frozen=True)
class Energy:
    """E(x) of a source and a receiver, without losses along the path.

    edges : (X + 1,) metres of path. once, again : (X,) per metre, scattered once and more than once.
    drawn : (SHARES, X) again by shares of the packets; None: of a law.
    """

    edges: np.ndarray
    once: np.ndarray
    again: np.ndarray
    drawn: np.ndarray | None = None

    @property
    def middle(self) -> np.ndarray:
        """(X,) metres."""
        return np.sqrt(self.edges[1:] * self.edges[:-1])

    def at(self, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """once and again at path lengths, by their logarithms; 0 before the first."""
        values_at = []
        for part in (self.once, self.again):
            heard = part > 0
            if heard.sum() < 2:
                values_at.append(np.zeros(len(length)))
                continue
            values = np.interp(np.log(length), np.log(self.middle[heard]), np.log(part[heard]))
            values_at.append(np.where(length >= self.edges[0], np.exp(values), 0.0))
        return values_at[0], values_at[1]


def transported_bands(
    phases: Sequence[PhaseFunction],
    density: Density,
    ends: tuple[np.ndarray, np.ndarray],
    edges: np.ndarray,
    bins: Sequence[int],
    packets: int,
    rng: np.random.Generator,
    sent: Sequence[Sent] = (),
) -> list[Energy]:
    """The energy by path length of each of B bands, by packets that start at the source, all together.

    phases : of each band. ends : source and receiver, (2,) metres. edges : (X + 1,) metres of path, rising.
    bins : (B,) how many of the bins between them packets of a band are followed through. packets : of each
    band. sent : (B,) energy by ways (N, 3); none: alike to all sides.
    """
    (source, receiver), tables = ends, Turns(np.array([phase.density for phase in phases]))
    width = np.array([phase.width for phase in phases])
    kept = np.array([phase.kept for phase in phases])
    rates = density.largest * width  # meetings a metre, real and not
    gathered = np.zeros((SHARES, 2, len(phases), len(edges) - 1))
    last = np.array([edges[count] for count in bins])
    moving = _LevelPackets(np.flatnonzero(rates > 0), source, packets, rng, sent)
    for _ in range(MOST_MEETINGS * 4):
        rate = rates[moving.band]
        moving.go(rng.exponential(1.0, len(rate)) / rate, rate, rng)
        moving.keep(density, last)
        if len(moving.band) == 0:
            break
        rows = moving.real(density, rng)
        away = receiver - moving.place[rows]
        band, weight = moving.band[rows], moving.weight[rows]
        distance = np.hypot(away[:, 0], away[:, 1])
        turned = azimuth_of(away) - moving.heading[rows]
        turned = np.abs((turned + math.pi) % (2.0 * math.pi) - math.pi)
        lost = density.between(moving.place[rows], receiver) * width[band]
        counted = weight * tables.towards(band, turned) * np.exp(-lost)
        counted *= 2.0 * math.pi * np.where(distance < NEAREST, 2.0 / NEAREST, 1.0 / distance)
        length = moving.travelled[rows] + distance
        again = (moving.met[rows] > 0).astype(np.int64)
        column = np.searchsorted(edges, length, side="right") - 1
        inside = (column >= 0) & (length < last[band])
        place = ((2 * moving.share[rows] + again) * len(phases) + band) * gathered.shape[3] + column
        add = np.bincount(place[inside], counted[inside] / length[inside], gathered.size)
        gathered += add.reshape(gathered.shape)
        moving.turn(rows, tables.draw(band, rng), kept[band])
    gathered /= np.maximum(moving.drawn, 1)[:, None, None, None] * np.diff(edges)
    once, again = np.average(gathered, axis=0, weights=moving.drawn)
    return [
        Energy(
            edges[: count + 1], once[row, :count], again[row, :count], gathered[:, 1, row, :count]
        )
        for row, count in enumerate(bins)
    ]


class Turns:
    """Angles by which sound is turned in each band: densities (B, A) over even cells from 0 to π."""

    def __init__(self, density: np.ndarray) -> None:
        self.density, (bands, self.count) = density, density.shape
        whole = np.cumsum(density, axis=1)
        whole = np.concatenate([np.zeros((bands, 1)), whole / whole[:, -1:]], axis=1)
        self.whole = (whole + np.arange(bands)[:, None]).ravel()  # rising over all bands

    def draw(self, band: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(N,) angles, to both sides."""
        share = 2.0 * rng.random(len(band)) - 1.0
        at = band + np.abs(share)
        cell = np.searchsorted(self.whole, at, side="right") - 1
        cell = np.minimum(cell, band * (self.count + 1) + self.count - 1)
        low, high = self.whole[cell], self.whole[cell + 1]
        within = np.clip((at - low) / np.maximum(high - low, 1e-300), 0.0, 1.0)
        turned = (cell - band * (self.count + 1) + within) * (math.pi / self.count)
        return np.asarray(np.copysign(turned, share))

    def towards(self, band: np.ndarray, turned: np.ndarray) -> np.ndarray:
        """(N,) density at angles in 0 to π."""
        cell = np.minimum((turned * (self.count / math.pi)).astype(np.int64), self.count - 1)
        return np.asarray(self.density.ravel()[band * self.count + cell])


class _LevelPackets:
    """Packets of energy: bands (N,), places (N, 2), headings, weights."""

    def __init__(
        self,
        bands: np.ndarray,
        source: np.ndarray,
        packets: int,
        rng: np.random.Generator,
        sent: Sequence[Sent],
    ) -> None:
        """Send ``packets`` packets in each of these bands."""
        count = len(bands) * packets
        self.band = np.repeat(bands, packets)
        self.place = np.tile(np.asarray(source, np.float64), (count, 1))
        even = np.tile(np.arange(packets), len(bands))
        self.heading = 2.0 * math.pi * (even + rng.random(count)) / max(packets, 1)
        self.way = np.column_stack([np.cos(self.heading), np.sin(self.heading)])
        self.travelled, self.met = np.zeros(count), np.zeros(count, np.int64)
        self.share, self.drawn = (
            even % SHARES,
            np.bincount(np.arange(packets) % SHARES, minlength=SHARES),
        )
        self.weight = np.ones(count)
        for band in bands.tolist() if sent else ():
            rows = self.band == band
            self.weight[rows] = sent[band](np.column_stack([self.way[rows], np.zeros(packets)]))
        self._going = np.ones(count, bool)

    def go(self, step: np.ndarray, rate: np.ndarray, rng: np.random.Generator) -> None:
        """Travel; after THINNED mean free paths fewer stand for the rest, as many in each bin of 1/x."""
        self.place += step[:, None] * self.way
        before = np.maximum(self.travelled, THINNED / rate)
        self.travelled += step
        left = np.minimum(before / self.travelled, 1.0)
        self.weight /= left
        self._going = rng.random(len(left)) < left

    def keep(self, density: Density, last: np.ndarray) -> None:
        """Drop those that were thinned out, are faint, or meet no trunk before a path of ``last`` (B,)."""
        going = self._going & (self.travelled < last[self.band]) & (self.weight > FAINT)
        going &= self.met < MOST_MEETINGS
        if density.cells.size and density.around == 0:
            # who met a trunk came from within: outside there is no way back
            beyond = ~density.inside(self.place)
            fresh = np.flatnonzero(beyond & (self.met == 0))
            beyond[fresh] = density.left(self.place[fresh], self.way[fresh])
            going &= ~beyond
        if not going.all():
            for name in ("band", "share", "place", "heading", "way", "travelled", "met", "weight"):
                setattr(self, name, getattr(self, name)[going])

    def real(self, density: Density, rng: np.random.Generator) -> np.ndarray:
        """Rows of those that meet a trunk."""
        if not density.cells.size:
            return np.arange(len(self.band))
        chance = rng.random(len(self.band)) * density.largest
        return np.flatnonzero(chance < density.at(self.place))

    def turn(self, rows: np.ndarray, by: np.ndarray, kept: np.ndarray) -> None:
        """Turn some by angles; they keep a share of their weight."""
        heading = self.heading[rows] + by
        self.heading[rows] = heading
        self.way[rows, 0], self.way[rows, 1] = np.cos(heading), np.sin(heading)
        self.weight[rows] *= kept
        self.met[rows] += 1
