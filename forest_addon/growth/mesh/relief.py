"""The relief of bark: radii that change around a stem and along it, by harmonics and by ridges.

Ridges, plates and scales are functions of the way around the stem and of that along it, both in metres, and
run on without a seam. A cross-section is oval besides, and its long side turns slowly on the way up. Every
ring keeps its area: its radii r·f are divided by √mean(f²), so that volumes and the DBH of a circle of the
same area stay.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.rng import stream
from ...base.runs import numbered
from .nodes import Line

FROM = 0.05  # metres of radius, below which an axis is smooth
FULL = 0.12  # metres of radius, from which furrows have all of their depth
AROUND = 5  # corners a ridge around the stem
ALONG = 3.0  # rings a ridge's width along it
RUNNING = 1.0  # the same of furrows, which run up the stem seven widths
MOST_CORNERS = 360
SMALLEST = 0.035  # metres: scales that are smaller are meshed as if they had this size
DEEPEST = 0.25  # of a ring's radius, that a furrow is deep at most
TURNS = 1.3  # radians a metre, by which the long side of an oval turns at most


@dataclass(frozen=True)
class Relief:
    """Bark in relief.

    texture : as ``spec.Bark`` has it. size, depth : of ridges, metres. ovality : relative.
    upper_from : share of an axis' length from which it is nearly smooth. seed : of all draws.
    """

    texture: str
    size: float
    depth: float
    ovality: float
    upper_from: float
    seed: int

    @property
    def rings(self) -> float:
        """Rings a ridge's width along an axis: few where bark changes slowly on the way up."""
        return ALONG if self.texture in ("plated", "cracked") else RUNNING

    def most(self, radius: float) -> float:
        """Bound how far the surface of a stem of this radius lies from its circle, metres."""
        return self.depth + 0.7 * self.ovality * radius if radius >= FROM else 0.0

    def corners(self, radius: np.ndarray) -> np.ndarray:
        """(A,) corners that rings of these radii (A,) need; 0 of a smooth axis."""
        wanted = 8 * np.ceil(2 * np.pi * radius / self.size * AROUND / 8)
        return np.where(radius < FROM, 0, np.clip(wanted, 16, MOST_CORNERS)).astype(np.int64)

    def densified(self, line: Line) -> Line:
        """The axes with rings so close that ridges show; ``line`` is sorted by corners."""
        last = line.first[1:] - 1
        thick = np.maximum.reduceat(line.above, line.first[:-1]) if len(last) else np.empty(0)
        step = np.zeros(len(line.point))
        step[:-1] = np.linalg.norm(np.diff(line.point, axis=0), axis=1)
        axis = np.repeat(np.arange(len(last)), np.diff(line.first))
        rough = (thick >= FROM)[axis]
        rough[last] = False
        times = np.where(rough, np.ceil(step * self.rings / self.size), 1).astype(np.int64)
        times = np.maximum(times, 1)
        node, number = numbered(times)
        part = number / times[node]
        onward = np.minimum(node + 1, len(times) - 1)
        point = line.point[node] + part[:, None] * (line.point[onward] - line.point[node])
        between = line.above[node] + part * (line.below[onward] - line.above[node])
        below = np.where(part == 0, line.below[node], between)
        first = np.concatenate([[0], np.cumsum(times)[last]])
        return Line(first, point, below, between, line.order, line.sides)

    def factor(
        self, corners: int, radius: np.ndarray, metres: np.ndarray, length: float, axis: int
    ) -> np.ndarray:
        """(R, corners) radii over their means, of rings of one axis.

        radius, metres : (R,) of rings, and how far along the axis they are. length : of the axis, metres.
        """
        rng = stream(self.seed, "relief", axis)
        angle = 2 * np.pi * np.arange(corners) / corners
        f = 1 + self._oval(angle, metres, rng)
        depth = self.depth * np.minimum(radius / FULL, 1.0)
        share = np.clip((metres / max(length, 1e-9) - self.upper_from) / 0.15, 0.0, 1.0)
        depth = depth * (1 - 0.85 * share)
        if self.depth > 0:
            ridges = self._ridges(angle, metres, float(radius.max()), rng)
            low = ridges - ridges.mean(axis=1, keepdims=True)
            f = f + low * np.minimum(depth / np.maximum(radius, 1e-9), DEEPEST)[:, None]
        area = np.mean(f * np.roll(f, 1, axis=1), axis=1)
        return np.asarray(f / np.sqrt(area)[:, None])

    def _oval(self, angle: np.ndarray, metres: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Oval cross-sections, and the weaker third and fourth harmonics that stems have."""
        total = np.zeros((len(metres), len(angle)))
        for order, share in ((2, 0.5), (3, 0.12), (4, 0.06)):
            phase, wander = rng.uniform(0, 2 * np.pi, 2)
            turn = phase + TURNS / 0.7 * np.sin(0.7 * metres + wander)
            total += self.ovality * share * np.cos(order * (angle - turn[:, None] / order))
        return total

    def _ridges(
        self, angle: np.ndarray, metres: np.ndarray, thick: float, rng: np.random.Generator
    ) -> np.ndarray:
        """(R, N) from 0 in furrows to 1 on ridges."""
        many = max(3, round(2 * np.pi * thick / self.size))
        if self.texture == "furrowed":
            return _lozenges(angle, metres, many, self.size, rng)
        if self.texture == "smooth":
            return _waves(angle, metres, self.size, rng)
        if self.texture == "peeling":
            foot = np.exp(-((metres / 1.2) ** 2))[:, None]
            cracked = _lozenges(angle, metres, many, self.size, rng)
            return np.asarray(foot * cracked + (1 - foot) * (0.4 * _waves(angle, metres, 0.1, rng)))
        tall = 2.0 if self.texture == "plated" else 1.4
        return _plates(angle, metres, many, self.size * tall, rng)


def _waves(
    angle: np.ndarray, metres: np.ndarray, size: float, rng: np.random.Generator
) -> np.ndarray:
    """(R, N) from 0 to 1: a few long waves."""
    total = np.zeros((len(metres), len(angle)))
    for order in range(2, 8):
        along = rng.uniform(-1, 1) / (4 * size)
        total += np.cos(order * angle + along * metres[:, None] + rng.uniform(0, 2 * np.pi)) / order
    return np.asarray(0.5 + total / 3)


def _lozenges(
    angle: np.ndarray, metres: np.ndarray, many: int, size: float, rng: np.random.Generator
) -> np.ndarray:
    """(R, N): furrows of two families that lean either way and wander, so that ridges part and meet."""
    families = []
    for lean in (1.0, -1.0):
        wander = np.zeros((len(metres), len(angle)))
        for order in (0, 1, 2, 3):
            along = rng.uniform(0.5, 1.5) / (3 * size)
            phase = order * angle + along * metres[:, None] + rng.uniform(0, 2 * np.pi)
            wander += 0.7 * np.sin(phase)
        half = 0.5 * many * angle if many % 2 == 0 else 0.5 * (many + 1) * angle
        families.append(np.abs(np.sin(half + lean * np.pi * metres[:, None] / (7 * size) + wander)))
    return np.asarray(np.minimum(*families) ** 0.6)


def _plates(
    angle: np.ndarray, metres: np.ndarray, many: int, tall: float, rng: np.random.Generator
) -> np.ndarray:
    """(R, N): plates around strewn points, furrows where two are equally near, each of its own height."""
    rows = int(np.ceil(float(metres.max(initial=0.0)) / tall)) + 3
    jitter = rng.uniform(-0.38, 0.38, (2, rows, many))
    high = rng.uniform(0.75, 1.0, (rows, many))
    x, y = angle / (2 * np.pi) * many, metres / tall + 1
    cell_x, cell_y = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    first = np.full((len(y), len(x)), np.inf)
    second, best = first.copy(), np.ones_like(first)
    for dy in (-1, 0, 1):
        row = np.clip(cell_y + dy, 0, rows - 1)
        for dx in (-1, 0, 1):
            column = (cell_x + dx) % many
            at = row[:, None], column[None]
            stagger = 0.5 * (row % 2)[:, None]
            away_x = cell_x[None] + dx + 0.5 + 0.6 * stagger + jitter[0][at] - x[None]
            away_y = (cell_y + dy)[:, None] + 0.5 + jitter[1][at] - y[:, None]
            far = np.hypot(away_x, away_y)
            nearer = far < first
            second = np.where(nearer, first, np.minimum(second, far))
            best = np.where(nearer, high[at], best)
            first = np.where(nearer, far, first)
    edge = np.clip((second - first) / 0.3, 0.0, 1.0)
    return np.asarray(best * edge * (2 - edge))
