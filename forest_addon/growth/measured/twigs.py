"""Twigs on the thin branches of a skeleton, and leaves on twigs, as many as the leaf area asks for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...base.rng import daughter_keys, keyed_uniform
from ...base.vectors import cross_rows
from ...spec import Crown, Leaf
from ..draw import draw_normal
from ..mesh.foliage import across, set_leaves
from ..skeleton import LeafSites, Skeleton

GOLDEN = np.pi * (3 - np.sqrt(5))
FEW_TIPS = 5  # a segment bears twigs if at most so many branches end beyond it
TAPER, SHORTEST = 6.0, 0.35  # mean twigs below the top where twigs are whole; length of the topmost
SPARSEST = 0.2  # twigs a metre of branch at the top, over those below


@dataclass(frozen=True)
class Twigs:
    """T twigs: where each leaves its segment, where it ends, and which segment that is."""

    start: np.ndarray  # (T, 3)
    end: np.ndarray
    segment: np.ndarray  # (T,)
    key: np.ndarray  # (T,) uint64


def seat_twigs(
    crown: Crown, skeleton: Skeleton, tips: np.ndarray, count: int, key: np.ndarray
) -> Twigs:
    """Set twigs evenly along all thin segments, fewer where short branches crowd below the top.

    tips : (S,) branches that end beyond each segment. key : (1,) lineage of the tree.
    """
    bearing = np.flatnonzero(tips <= FEW_TIPS)  # also the top of the stem
    if not len(bearing):
        bearing = np.flatnonzero(tips <= max(FEW_TIPS, tips.min()))
    way = skeleton.end[bearing] - skeleton.start[bearing]
    length = np.sqrt(np.einsum("si,si->s", way, way))
    below = skeleton.end[:, 2].max() - skeleton.end[bearing, 2]
    thinned = np.clip(below / (TAPER * crown.twig.mean), SPARSEST, 1.0)
    reach = np.cumsum(length * thinned)
    keys = daughter_keys(np.repeat(key, count), np.arange(count))
    at = (np.arange(count) + keyed_uniform(keys, "twig place")) / count * reach[-1]
    pick = np.minimum(np.searchsorted(reach, at, side="right"), len(bearing) - 1)
    share = 1 - (reach[pick] - at) / np.diff(reach, prepend=0.0)[pick]
    segment = bearing[pick]
    heading = way[pick] / length[pick, None]
    start = skeleton.start[segment] + np.clip(share, 0, 1)[:, None] * way[pick]
    side = across(heading)
    azimuth = GOLDEN * np.arange(count) + 0.5 * keyed_uniform(keys, "twig turn")
    angle = np.deg2rad(draw_normal(crown.twig_angle_deg, keys, "twig angle"))[:, None]
    around = np.cos(azimuth)[:, None] * side
    around += np.sin(azimuth)[:, None] * cross_rows(heading, side)
    direction = np.cos(angle) * heading + np.sin(angle) * around
    direction[:, 2] += crown.rise - crown.hang
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    length = draw_normal(crown.twig, keys, "twig length")
    room = skeleton.end[:, 2].max() - start[:, 2]  # to the top, where twigs are of this year
    length = length * np.clip(room / (TAPER * crown.twig.mean), SHORTEST, 1.0)
    end = start + length[:, None] * direction
    return Twigs(start, end, segment, keys)


def with_twigs(skeleton: Skeleton, twigs: Twigs, radius: float) -> Skeleton:
    """The skeleton and its twigs, a segment each."""
    count = len(twigs.segment)
    order = skeleton.order[twigs.segment] + 1
    return Skeleton(
        start=np.concatenate([skeleton.start, twigs.start]),
        end=np.concatenate([skeleton.end, twigs.end]),
        radius=np.concatenate([skeleton.radius, np.tile([radius, 0.6 * radius], (count, 1))]),
        parent=np.concatenate([skeleton.parent, twigs.segment]),
        order=np.concatenate([skeleton.order, order]),
        generation=np.concatenate([skeleton.generation, skeleton.generation[twigs.segment] + 1]),
    )


def leaves_on(leaf: Leaf, twigs: Twigs, first: int, count: int, stalk: bool) -> LeafSites:
    """Leaves along twigs, evenly, the last at the tip.

    first : segment number of the first twig. stalk : a shoot at a twig's tip goes on along it.
    """
    many = len(twigs.segment)
    each = np.full(many, count // many)
    each[: count - each.sum()] += 1
    twig = np.repeat(np.arange(many), each)
    number = np.arange(count) - np.repeat(np.cumsum(each) - each, each)
    share = 1 - number / np.maximum(each[twig], 1) * 0.85
    way = twigs.end - twigs.start
    heading = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    foot = twigs.start[twig] + share[:, None] * way[twig]
    keys = daughter_keys(twigs.key[twig], number)
    azimuth = GOLDEN * number + 2 * np.pi * keyed_uniform(twigs.key, "leaf phase")[twig]
    side = across(heading)
    sites = set_leaves(leaf, keys, foot, heading[twig], side[twig], azimuth, first + twig)
    if not stalk:
        return sites
    direction = np.where((number == 0)[:, None], heading[twig], sites.direction)
    up = cross_rows(direction, across(direction))
    return replace(sites, direction=direction, up=up)
