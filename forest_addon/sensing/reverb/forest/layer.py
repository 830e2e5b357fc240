"""Sound in the layer of a forest, in three dimensions: what branches and leaves turned once at least.

Trunks' phase functions, the scatter of branches and leaves by height, the ground and two ends go in; energy
by path length goes out, for all octaves at once. Packets leave the source all ways; trunks turn them about
the vertical and keep their slope, branches and leaves turn them in space, the ground keeps |R|² of them,
and above the canopy they are gone, or come back as much as is stated. At every meeting what would go on to
the receiver, straight and by way of the ground, is counted (next-event estimation, Lux & Koblinger 1991), if
branches, leaves or litter turned the packet before: what only trunks turned is in ``transport``, where the
ground is a wave's. A trunk sends along a cone, which never meets a point: its slopes count over SMEAR.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ....base.vectors import azimuth_of
from .clutter import ANGLES, LAYER, Scatter
from .transport import SHARES, PhaseFunction, Sent, Turns

SMEAR = 0.12  # radians
NEAREST = (
    0.5  # m; energy that is turned nearer to the receiver is counted as its mean over that ball
)
FAINT = 1e-4  # of a packet, below which it is not followed
MOST = 2000  # meetings, real or not


@dataclass(frozen=True)
class Layer:
    """B octaves of a stand.

    trunks : per m². phases : of its trunks. scatters : of branches and leaves. top : m, of the canopy.
    back : share of what leaves by the top that comes back. resistance, reactance : (B,) of the ground over
    that of air; infinite: hard. rough : (B,) share of what the ground reflects that goes all ways.
    """

    trunks: float
    phases: tuple[PhaseFunction, ...]
    scatters: tuple[Scatter, ...]
    top: float
    back: float
    impedance: np.ndarray
    rough: float = 0.0

    def reflected(self, band: np.ndarray, sine: np.ndarray) -> np.ndarray:
        """(N,) |R|² of plane waves at slopes of these sines."""
        z = self.impedance[band]
        hard = ~np.isfinite(z)
        z = np.where(hard, 1.0, z)
        return np.where(hard, 1.0, np.abs((z * sine - 1.0) / (z * sine + 1.0)) ** 2)


class _Tables:
    """Tables that packets look up, (B, ...) each."""

    def __init__(self, layer: Layer) -> None:
        self.trunks = Turns(np.array([phase.density for phase in layer.phases]))
        self.width = layer.trunks * np.array([phase.width for phase in layer.phases])
        self.kept = np.array([phase.kept for phase in layer.phases])
        cells = max((len(s.scattered) for s in layer.scatters), default=1) or 1
        bands = len(layer.scatters)
        self.scattered, self.taken = np.zeros((bands, cells)), np.zeros((bands, cells))
        for row, scatter in enumerate(layer.scatters):
            self.scattered[row, : len(scatter.scattered)] = scatter.scattered
            self.taken[row, : len(scatter.scattered)] = scatter.scattered + scatter.absorbed
        self.depth = np.concatenate(
            [np.zeros((bands, 1)), np.cumsum(self.taken, axis=1) * LAYER], axis=1
        )
        self.density = np.array([scatter.density for scatter in layer.scatters])
        solid = -2.0 * math.pi * np.diff(np.cos(np.linspace(0.0, math.pi, ANGLES + 1)))
        self.in_space = Turns(self.density * solid)
        self.most = self.width + self.taken.max(axis=1)

    def through(self, band: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """(N,) mean of what is taken a metre between two heights."""
        apart = np.abs(high - low)
        rise = self._depth(band, high) - self._depth(band, low)
        here = self.taken[band, self._cell(low)]
        return np.where(apart > 1e-3, np.abs(rise) / np.maximum(apart, 1e-3), here)

    def _cell(self, height: np.ndarray) -> np.ndarray:
        return np.clip((height / LAYER).astype(np.int64), 0, self.taken.shape[1] - 1)

    def _depth(self, band: np.ndarray, height: np.ndarray) -> np.ndarray:
        place = np.clip(height / LAYER, 0.0, self.taken.shape[1])
        cell = np.minimum(place.astype(np.int64), self.taken.shape[1] - 1)
        return self.depth[band, cell] + (place - cell) * LAYER * self.taken[band, cell]

    def at(self, band: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N,) taken and scattered a metre, at heights; none above the layers."""
        cell, inside = self._cell(height), height < LAYER * self.taken.shape[1]
        return self.taken[band, cell] * inside, self.scattered[band, cell] * inside


def diffused(
    layer: Layer,
    source: np.ndarray,
    receiver: np.ndarray,
    edges: np.ndarray,
    packets: int,
    rng: np.random.Generator,
    sent: Sequence[Sent] = (),
) -> np.ndarray:
    """(SHARES, B, X) energy a metre of path between ``edges`` (X + 1,), without the air, by each share of the
    packets; their mean is of all.

    source, receiver : (3,) metres above a level ground. packets : of each octave, SHARES or more.
    """
    tables, bands = _Tables(layer), len(layer.scatters)
    gathered = np.zeros((SHARES, bands, len(edges) - 1))
    moving = _Packets(np.repeat(np.arange(bands), packets), np.asarray(source, np.float64), rng)
    for band, energy in enumerate(sent):
        moving.weight[moving.band == band] = energy(moving.way[moving.band == band])
    moving.keep(tables.most[moving.band] > 0)
    for _ in range(MOST):
        if not len(moving.band):
            break
        step = rng.exponential(1.0, len(moving.band)) / tables.most[moving.band]
        moving.go(step, layer, rng)
        moving.keep((moving.travelled < edges[-1]) & (moving.weight > FAINT))
        taken, scattered = tables.at(moving.band, moving.place[:, 2])
        level = np.sqrt(np.maximum(1.0 - moving.way[:, 2] ** 2, 0.0))
        chance = rng.random(len(moving.band)) * tables.most[moving.band]
        trunk = chance < tables.width[moving.band] * level
        turned = ~trunk & (chance < tables.width[moving.band] * level + taken)
        moving.weight[turned] *= scattered[turned] / np.maximum(taken[turned], 1e-300)
        moving.weight[trunk] *= tables.kept[moving.band[trunk]]
        moving.met |= turned
        rows = np.flatnonzero(moving.met & (trunk | turned))
        _count(gathered, moving, rows, trunk[rows], tables, layer, np.asarray(receiver), edges)
        moving.turn_at_trunks(np.flatnonzero(trunk), tables, rng)
        moving.turn_in_space(np.flatnonzero(turned), tables, rng)
    return gathered * (4.0 * math.pi * SHARES / packets) / np.diff(edges)


class _Packets:
    """Packets of energy: places (N, 3), ways (N, 3), weights (N,)."""

    def __init__(self, band: np.ndarray, source: np.ndarray, rng: np.random.Generator) -> None:
        count = len(band)
        self.band, self.place = band, np.tile(source, (count, 1))
        sine = 2.0 * (rng.permutation(count) + rng.random(count)) / count - 1.0
        turn = 2.0 * math.pi * rng.random(count)
        level = np.sqrt(np.maximum(1.0 - sine**2, 0.0))
        self.way = np.column_stack([level * np.cos(turn), level * np.sin(turn), sine])
        self.travelled, self.weight = np.zeros(count), np.ones(count)
        self.met, self.share = np.zeros(count, bool), np.arange(count) % SHARES

    def keep(self, rows: np.ndarray) -> None:
        """Drop all others."""
        for name in ("band", "share", "place", "way", "travelled", "weight", "met"):
            setattr(self, name, getattr(self, name)[rows])

    def go(self, step: np.ndarray, layer: Layer, rng: np.random.Generator) -> None:
        """Travel; the ground reflects, the top lets out, as often as it takes."""
        self.place += step[:, None] * self.way
        self.travelled += step
        for _ in range(100):
            low, high = self.place[:, 2] < 0, self.place[:, 2] > layer.top
            if not (low.any() or high.any()):
                return
            self.weight[low] *= layer.reflected(self.band[low], -self.way[low, 2])
            self.place[low, 2] *= -1.0
            self.weight[high] *= layer.back
            self.place[high, 2] = 2.0 * layer.top - self.place[high, 2]
            self.way[low | high, 2] *= -1.0
            if layer.rough > 0:
                self._spread(np.flatnonzero(low), layer.rough, rng)
            self.place[self.weight <= FAINT, 2] = 0.5 * layer.top

    def _spread(self, rows: np.ndarray, share: float, rng: np.random.Generator) -> None:
        """Send some of what the ground reflects all ways (Lambert)."""
        rows = rows[rng.random(len(rows)) < share]
        sine = np.sqrt(rng.random(len(rows)))
        turn, level = 2.0 * math.pi * rng.random(len(rows)), np.sqrt(1.0 - sine**2)
        behind = self.place[rows, 2] / np.maximum(self.way[rows, 2], 1e-6)
        self.place[rows] -= behind[:, None] * self.way[rows]
        self.way[rows] = np.column_stack([level * np.cos(turn), level * np.sin(turn), sine])
        self.place[rows] += behind[:, None] * self.way[rows]
        self.met[rows] = True

    def turn_at_trunks(self, rows: np.ndarray, tables: _Tables, rng: np.random.Generator) -> None:
        """About the vertical."""
        turn = tables.trunks.draw(self.band[rows], rng)
        x, y = self.way[rows, 0].copy(), self.way[rows, 1].copy()
        self.way[rows, 0] = x * np.cos(turn) - y * np.sin(turn)
        self.way[rows, 1] = x * np.sin(turn) + y * np.cos(turn)

    def turn_in_space(self, rows: np.ndarray, tables: _Tables, rng: np.random.Generator) -> None:
        """Turn directions by an angle drawn from the table, at any azimuth about them."""
        angle = tables.in_space.draw(
            self.band[rows], rng
        )  # of either sign: it is turned about, too
        around = 2.0 * math.pi * rng.random(len(rows))
        way = self.way[rows]
        other = np.where(np.abs(way[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
        first = np.cross(way, other)
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        second = np.cross(way, first)
        aside = np.cos(around)[:, None] * first + np.sin(around)[:, None] * second
        turned = np.cos(angle)[:, None] * way + np.sin(angle)[:, None] * aside
        self.way[rows] = turned / np.linalg.norm(turned, axis=1, keepdims=True)


def _count(
    energy: np.ndarray,
    moving: _Packets,
    rows: np.ndarray,
    trunk: np.ndarray,
    tables: _Tables,
    layer: Layer,
    receiver: np.ndarray,
    edges: np.ndarray,
) -> None:
    """Add what would go to the receiver straight, by the ground and by the top, from packets' meetings."""
    band, place, way = moving.band[rows], moving.place[rows], moving.way[rows]
    ways = ("straight", "ground", "top") if layer.back > 0 else ("straight", "ground")
    for by in ways:
        end = np.array(receiver)
        if by != "straight":
            end[2] = -receiver[2] if by == "ground" else 2.0 * layer.top - receiver[2]
        away = end - place
        distance = np.linalg.norm(away, axis=1)
        away /= np.maximum(distance, 1e-9)[:, None]
        level = np.sqrt(np.maximum(1.0 - away[:, 2] ** 2, 0.0))
        cosine = np.clip((away * way).sum(axis=1), -1.0, 1.0)
        cell = np.minimum((np.arccos(cosine) * (ANGLES / math.pi)).astype(np.int64), ANGLES - 1)
        share = tables.density[band, cell]
        share[trunk] = _of_trunks(band[trunk], way[trunk], away[trunk], tables)
        low, high = place[:, 2], np.full(len(rows), receiver[2])
        if by == "straight":
            lost = tables.through(band, low, high)
        else:
            edge = np.full(len(rows), 0.0 if by == "ground" else layer.top)
            first, second = np.abs(low - edge), np.abs(high - edge)
            lost = first * tables.through(band, edge, low) + second * tables.through(
                band, edge, high
            )
            lost /= np.maximum(first + second, 1e-6)
            kept = layer.reflected(band, -away[:, 2]) if by == "ground" else layer.back
            share = share * kept
        lost = (lost + tables.width[band] * level) * distance
        counted = moving.weight[rows] * share * np.exp(-lost)
        counted *= np.where(distance < NEAREST, 3.0 / NEAREST**2, distance**-2.0)
        column = np.searchsorted(edges, moving.travelled[rows] + distance, side="right") - 1
        inside = (column >= 0) & (column < energy.shape[2])
        row = moving.share[rows] * energy.shape[1] + band
        at = row[inside] * energy.shape[2] + column[inside]
        energy += np.bincount(at, counted[inside], energy.size).reshape(energy.shape)


def _of_trunks(band: np.ndarray, way: np.ndarray, away: np.ndarray, tables: _Tables) -> np.ndarray:
    """(N,) per steradian from one way to another by a trunk, over slopes that are alike."""
    turned = azimuth_of(away) - azimuth_of(way)
    turned = np.abs((turned + math.pi) % (2.0 * math.pi) - math.pi)
    around = tables.trunks.towards(band, turned) / np.maximum(tables.kept[band], 1e-9)
    rise = np.arcsin(np.clip(away[:, 2], -1, 1)) - np.arcsin(np.clip(way[:, 2], -1, 1))
    slope = np.exp(-0.5 * (rise / SMEAR) ** 2) / (SMEAR * math.sqrt(2.0 * math.pi))
    level = np.sqrt(np.maximum(1.0 - away[:, 2] ** 2, 1e-4))
    return np.asarray(around * slope / level)
