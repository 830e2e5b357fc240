"""Tanveer et al.'s (2020a and 2020b) trees without templates: all of the skeleton is wood, and tips bear
leaves (Tanveer et al. 2020a).

First-level branches are set as often as the grammar's ``copies`` says, each copy turned about the
vertical and raised along the trunk. Every growing tip bears nodes of leaves, each node turned on from
the one before it by the fan angle.
"""

from __future__ import annotations

import numpy as np

from ..base.rng import daughter_keys, keyed_uniform
from ..spec import Species
from .lsystem.grammar import string_of
from .lsystem.turtle import interpret
from .mesh.axes import TOUCH, first_level
from .mesh.foliage import across, set_leaves
from .skeleton import LeafSites, Skeleton

SPREAD = 0.3  # share of its rise by which a copy may sit lower


def grow_whole(species: Species, key: int, rng: np.random.Generator) -> tuple[Skeleton, LeafSites]:
    """The skeleton and leaves of one tree."""
    grammar = species.grammar
    skeleton = interpret(string_of(grammar), grammar, species.jitter, rng)
    skeleton = _copied(skeleton, grammar.copies, key)
    return skeleton, _tip_leaves(skeleton, species, key) if species.leaf.on else LeafSites.none()


def _copied(skeleton: Skeleton, copies: int, key: int) -> Skeleton:
    """The skeleton with further copies of all first-level branches, behind the first."""
    level = first_level(skeleton)
    aloft = np.flatnonzero(level >= 0)
    if copies == 1 or not len(aloft):
        return skeleton
    roots = aloft[np.unique(level[aloft], return_index=True)[1]]
    trunk = skeleton.parent[roots]  # the segment that each first-level branch leaves
    onward = np.full(len(skeleton), -1)
    stem = np.flatnonzero((skeleton.order == 0) & (skeleton.parent >= 0))
    onward[skeleton.parent[stem]] = stem
    follows = onward[trunk] >= 0
    axis = np.where(
        follows[:, None], skeleton.end[onward[trunk]] - skeleton.start[onward[trunk]], 0.0
    )
    parts = [skeleton]
    for copy in range(1, copies):
        keys = daughter_keys(np.full(len(roots), key, np.uint64), np.arange(len(roots)))
        share = copy / copies * (1 - SPREAD * keyed_uniform(keys, f"rise {copy}"))
        foot = skeleton.start[roots]
        raised = foot + share[:, None] * axis
        turn = np.pi * copy / copies
        cos, sin = np.cos(turn), np.sin(turn)
        matrix = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        owner = level[aloft]
        number = np.full(len(skeleton), -1)
        number[aloft] = sum(map(len, parts)) + np.arange(len(aloft))
        first = skeleton.order[np.maximum(skeleton.parent[aloft], 0)] == 0
        bearer = np.where(follows, onward[trunk], trunk)[owner]
        parts.append(
            Skeleton(
                start=(skeleton.start[aloft] - foot[owner]) @ matrix.T + raised[owner],
                end=(skeleton.end[aloft] - foot[owner]) @ matrix.T + raised[owner],
                radius=skeleton.radius[aloft],
                parent=np.where(first, bearer, number[skeleton.parent[aloft]]),
                order=skeleton.order[aloft],
                generation=skeleton.generation[aloft],
            )
        )
    names = ("start", "end", "radius", "parent", "order", "generation")
    return Skeleton(**{n: np.concatenate([getattr(p, n) for p in parts]) for n in names})


def _tip_leaves(skeleton: Skeleton, species: Species, key: int) -> LeafSites:
    """Nodes of leaves along every segment whose end bears nothing, the last node at its end."""
    leaf = species.leaf
    goes_on = np.zeros(len(skeleton), bool)
    mother = skeleton.parent
    gap = np.abs(skeleton.start - skeleton.end[mother]).max(axis=1)
    goes_on[mother[(mother >= 0) & (gap < TOUCH)]] = True
    tip = np.flatnonzero(~goes_on)
    each = leaf.nodes * leaf.per_node
    segment = np.repeat(tip, each)
    number = np.tile(np.arange(each), len(tip))
    node, side = number // leaf.per_node, number % leaf.per_node
    keys = daughter_keys(np.full(len(segment), key, np.uint64), segment)
    keys = daughter_keys(daughter_keys(keys, "leaf"), number)
    along = skeleton.end[segment] - skeleton.start[segment]
    foot = skeleton.start[segment] + ((node + 1) / leaf.nodes)[:, None] * along
    heading = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    azimuth = 2 * np.pi * side / leaf.per_node + np.deg2rad(leaf.fan_deg) * node
    return set_leaves(leaf, keys, foot, heading, across(heading), azimuth, segment)
