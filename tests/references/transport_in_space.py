"""Transport in space by packets whose ways through a volume are measured: no estimation towards a point.

``in_layer`` is held against the product, ``in_ball`` against waves. Nothing is shared with the product.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np


def in_layer(
    trunk_rate: float,
    draw_turn: Callable[[np.random.Generator, int], np.ndarray],
    rate: float,
    height: float,
    source: np.ndarray,
    ring: tuple[float, float],
    heights: tuple[float, float],
    edges: np.ndarray,
    packets: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """(X,) energy density a metre of path that isotropic scatterers turned at least once.

    Trunks turn about the vertical, by ``trunk_rate`` a metre of level way; isotropic scatterers fill the
    layer at ``rate``; the ground is hard, what leaves by the top is gone. Measured in a ring.
    """
    step = 0.25
    place = np.tile(np.asarray(source, float), (packets, 1))
    sine, turn = rng.uniform(-1, 1, packets), rng.uniform(0, 2 * math.pi, packets)
    met = np.zeros(packets, bool)
    found, travelled = np.zeros(len(edges) - 1), 0.0
    while travelled < edges[-1] and len(place):
        level = np.sqrt(1 - sine**2)
        place += step * np.column_stack([level * np.cos(turn), level * np.sin(turn), sine])
        travelled += step
        under = place[:, 2] < 0
        place[under, 2] *= -1
        sine[under] *= -1
        kept = place[:, 2] < height
        place, sine, turn, met = place[kept], sine[kept], turn[kept], met[kept]
        r = np.hypot(*(place[:, :2] - source[:2]).T)
        inside = met & (r > ring[0]) & (r < ring[1])
        inside &= (place[:, 2] > heights[0]) & (place[:, 2] < heights[1])
        column = int(np.searchsorted(edges, travelled - step / 2, side="right")) - 1
        if 0 <= column < len(found):
            found[column] += inside.sum() * step
        by_trunk = rng.random(len(place)) < 1 - np.exp(-trunk_rate * step * np.sqrt(1 - sine**2))
        turn[by_trunk] += draw_turn(rng, int(by_trunk.sum()))
        spread = rng.random(len(place)) < 1 - np.exp(-rate * step)
        sine[spread] = rng.uniform(-1, 1, int(spread.sum()))
        turn[spread] = rng.uniform(0, 2 * math.pi, int(spread.sum()))
        met |= spread
    volume = math.pi * (ring[1] ** 2 - ring[0] ** 2) * (heights[1] - heights[0])
    return found * 4 * math.pi / packets / volume / np.diff(edges)


def in_ball(
    rate: float,
    radius: float,
    source: np.ndarray,
    receiver: np.ndarray,
    edges: np.ndarray,
    packets: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """(X,) energy a metre that isotropic scatterers in a ball send to a point, by next-event estimation."""
    place = np.tile(np.asarray(source, float), (packets, 1))
    travelled = np.zeros(packets)
    found = np.zeros(len(edges) - 1)
    while len(place):
        way = rng.normal(size=place.shape)
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        step = rng.exponential(1 / rate, len(place))
        place = place + step[:, None] * way
        travelled = travelled + step
        kept = (np.linalg.norm(place, axis=1) < radius) & (travelled < edges[-1])
        place, travelled = place[kept], travelled[kept]
        distance = np.linalg.norm(receiver - place, axis=1)
        counted = np.exp(-rate * distance) / (4 * math.pi * np.maximum(distance, 0.05) ** 2)
        found += np.histogram(travelled + distance, edges, weights=counted)[0]
    return found * 4 * math.pi / packets / np.diff(edges)


def in_ball_turned(
    rate: float,
    turned: np.ndarray,
    radius: float,
    apart: tuple[float, float],
    edges: np.ndarray,
    packets: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """(X,) energy a metre of scatterers that turn sound by ``turned`` (C,), over even cells of the cosine.

    apart : m, of sources from the ball's middle, and of receivers within the ball from them, all ways.
    """
    density = turned / (turned.mean() * 4 * math.pi)
    sums = np.concatenate([[0.0], np.cumsum(turned) / turned.sum()])
    cosines = np.linspace(-1.0, 1.0, len(sums))

    def ways(count: int) -> np.ndarray:
        way = rng.normal(size=(count, 3))
        return way / np.linalg.norm(way, axis=1, keepdims=True)

    place, way, travelled = apart[0] * ways(packets), ways(packets), np.zeros(packets)
    receiver, found = place + apart[1] * ways(packets), np.zeros(len(edges) - 1)
    while len(place):
        step = rng.exponential(1 / rate, len(place))
        place, travelled = place + step[:, None] * way, travelled + step
        kept = (np.linalg.norm(place, axis=1) < radius) & (travelled < edges[-1])
        place, way, travelled, receiver = (each[kept] for each in (place, way, travelled, receiver))
        away = receiver - place
        distance = np.linalg.norm(away, axis=1)
        cosine = np.clip((away * way).sum(axis=1) / distance, -1.0, 1.0)
        cell = np.minimum((0.5 * (cosine + 1.0) * len(density)).astype(int), len(density) - 1)
        counted = density[cell] * np.exp(-rate * distance)
        counted *= np.where(distance < 0.3, 3 / 0.3**2, distance**-2.0)
        found += np.histogram(travelled + distance, edges, weights=counted)[0]
        cosine = np.interp(rng.random(len(place)), sums, cosines)
        aside = np.cross(way, ways(len(place)))
        aside /= np.linalg.norm(aside, axis=1, keepdims=True)
        way = cosine[:, None] * way + np.sqrt(1 - cosine**2)[:, None] * aside
    return found * 4 * math.pi / packets / np.diff(edges)
