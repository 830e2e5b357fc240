"""Branches that grow into a crown: space colonisation (Runions, Lane & Prusinkiewicz 2007).

Points strewn in the envelope of a crown attract branches. Each point pulls at the node that is nearest to
it; a node that is pulled grows by one step in the mean direction of its points; points that a node has come
near are gone. Only nodes that are new can be nearer than those before, so each round asks a tree (k-d) of
the new ones alone, and the whole costs about as many queries as there are points and rounds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...spec import Crown

STEP, KILL = 0.55, 0.8  # over the mean distance of points
MOST_ROUNDS = 400
ALIKE = 0.98  # cosine between two steps of one node that are the same branch


@dataclass(frozen=True)
class Nodes:
    """N nodes of a tree's axes, a parent before her children.

    place : (N, 3) metres. parent : (N,) int64, -1 for the foot. trunk : (N,) bool, of the first stem.
    """

    place: np.ndarray
    parent: np.ndarray
    trunk: np.ndarray


def outline(crown: Crown, share: np.ndarray) -> np.ndarray:
    """(N,) radius of the crown over its largest, at shares (N,) of its length from the base up."""
    above = np.clip((share - crown.widest) / (1 - crown.widest), 0, 1)
    below = np.clip((crown.widest - share) / max(crown.widest, 1e-9), 0, 1)
    return np.asarray(
        np.where(
            share >= crown.widest, 1 - above**crown.top, 0.15 + 0.85 * (1 - below**crown.underside)
        )
    )


def colonise(
    crown: Crown,
    height: float,
    base: float,
    width: float,
    rng: np.random.Generator,
    scaffold: tuple[Nodes, np.ndarray] | None = None,
) -> Nodes:
    """The axes of a tree whose crown reaches from ``base`` to ``height`` and is ``width`` wide, metres.

    scaffold : its stem and limbs, and which of their nodes (N,) bear branches; None: a stem alone.
    """
    count = round(crown.points / (1 - crown.gaps)) if scaffold else crown.points
    points = _points(crown, (height, base, width), count, rng)
    span = height - base
    volume = np.pi * (width / 2) ** 2 * span * 0.45
    if scaffold is not None and crown.gaps:
        points = _near(points, scaffold[0].place[scaffold[1]], crown.points)
        volume *= 1 - crown.gaps
    apart = (volume / max(len(points), 1)) ** (1 / 3)
    step, kill = STEP * apart, KILL * apart
    if scaffold is None:
        stem = _trunk(crown, height, base, step, rng)
        along = np.arange(-1, len(stem) - 1)
        # Below the crown the stem bears nothing: its nodes attract no points.
        bearing = stem[:, 2] >= base - 1e-9
        scaffold = Nodes(stem, along, np.ones(len(stem), dtype=bool)), bearing
    given, bearing = scaffold
    place, parent = [given.place], [given.parent]
    count = len(given.place)
    fresh, number = given.place, np.arange(count)
    fresh, number = (
        (fresh[bearing], number[bearing]) if bearing.any() else (fresh[-1:], number[-1:])
    )
    near = np.full(len(points), np.inf)
    owner = np.zeros(len(points), dtype=np.int64)
    every = place[0]
    steps = np.zeros((count, 3))  # the last step of each node, so that none is taken twice
    for _ in range(MOST_ROUNDS):
        if not len(points) or not len(fresh):
            break
        distance, found = cKDTree(fresh).query(points)
        nearer = distance < near
        near = np.where(nearer, distance, near)
        owner = np.where(nearer, number[found], owner)
        kept = near > kill
        points, near, owner = points[kept], near[kept], owner[kept]
        if not len(points):
            break
        pull = (points - every[owner]) / near[:, None]
        grown, which = np.unique(owner, return_inverse=True)
        way = np.stack([np.bincount(which, pull[:, k], len(grown)) for k in range(3)], axis=1)
        way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
        way += crown.crook * rng.standard_normal(way.shape)
        way[:, 2] += crown.rise
        way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
        again = np.einsum("ni,ni->n", way, steps[grown]) > ALIKE
        stuck = np.isin(owner, grown[again])  # between two points it would step for ever
        points, near, owner = points[~stuck], near[~stuck], owner[~stuck]
        grown, way = grown[~again], way[~again]
        steps[grown] = way
        fresh = every[grown] + step * way
        number = count + np.arange(len(fresh))
        count += len(fresh)
        place.append(fresh)
        parent.append(grown)
        every = np.concatenate([every, fresh])
        steps = np.concatenate([steps, np.zeros_like(fresh)])
    trunk = np.zeros(count, dtype=bool)
    trunk[: len(given.trunk)] = given.trunk
    return Nodes(every, np.concatenate(parent).astype(np.int64), trunk)


def _near(points: np.ndarray, limbs: np.ndarray, count: int) -> np.ndarray:
    """So many of points (A, 3): those nearest to limbs (N, 3), so that the sky shows between limbs."""
    away, _ = cKDTree(limbs).query(points)
    return points[np.sort(np.argsort(away, kind="stable")[:count])]


def _points(
    crown: Crown, size: tuple[float, float, float], count: int, rng: np.random.Generator
) -> np.ndarray:
    """(A, 3) points in the envelope, at random but none in a gap or a clump: strata by volume.

    size : the tree's height, its crown's base and width, metres.
    """
    height, base, width = size
    shares = (np.arange(64) + 0.5) / 64
    weight = np.cumsum(outline(crown, shares) ** 2)
    at = (np.arange(count) + rng.random(count)) / count
    share = np.interp(at, np.concatenate([[0.0], weight / weight[-1]]), np.linspace(0, 1, 65))
    inner = rng.random(count) ** (0.5 * (1 - 0.7 * crown.shell))
    radius = width / 2 * outline(crown, share) * inner
    azimuth = 2 * np.pi * ((np.arange(count) * 0.618034) % 1 + 0.3 * rng.random(count))
    return np.column_stack(
        [radius * np.cos(azimuth), radius * np.sin(azimuth), base + share * (height - base)]
    )


def _trunk(
    crown: Crown, height: float, base: float, step: float, rng: np.random.Generator
) -> np.ndarray:
    """(T, 3) the first stem, from the ground to where it divides."""
    top = base + max(crown.leader, 0.02) * 0.97 * (height - base)
    below = np.linspace(0.0, base, max(2, int(np.ceil(base / max(step, 0.25))) + 1))
    above = np.linspace(base, top, max(2, int(np.ceil((top - base) / step)) + 1))[1:]
    return stem_line(crown, np.concatenate([below, above]), height, rng)


def stem_line(crown: Crown, z: np.ndarray, height: float, rng: np.random.Generator) -> np.ndarray:
    """(T, 3) a stem at heights (T,), metres; straight, but for a slow sway."""
    sway = 0.06 * crown.crook * height * rng.standard_normal((2, 2))
    t = (z / height)[:, None]
    aside = sway[0] * t**2 + 0.5 * sway[1] * np.sin(2 * np.pi * t) * t
    return np.column_stack([aside, z])
