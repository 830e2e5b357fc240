"""Wahed et al.'s trees after Honda (1971): a parent bears children by angle, divergence and ratios,
recursively.

All branches of a level are grown at once. A branch is a chain of straight pieces, each bent at random
and towards the ground, and its children leave it at its apex or at random places along it. Per tree
are drawn: levels, length and radius of the trunk, both ratios; per branch: number of children and of
leaves, places, angle, twist, crookedness; per leaf: length, width, angle. A draw is a hash of the
lineage of what draws it, so pruning a branch or leaving leaves off moves nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.rng import daughter_keys, keyed_uniform
from ..base.runs import numbered
from ..spec import MAX_REACH, Honda, Leaf
from .draw import GOLDEN, draw_discrete, draw_normal, mean_of
from .lsystem.system import written
from .mesh.blades import set_leaves
from .skeleton import LeafSites, Skeleton

MAX_SEGMENTS = 5_000_000
LEADER = 1 << 32  # a child's number that no other child has


@dataclass(frozen=True)
class _Branches:
    """B branches of one level before they are drawn."""

    key: np.ndarray  # (B,) uint64
    foot: np.ndarray  # (B, 3)
    heading: np.ndarray  # (B, 3)
    across: np.ndarray  # (B, 3) at right angles to the heading; azimuth 0
    length: np.ndarray  # (B,)
    radius: np.ndarray  # (B,) at the foot
    parent: np.ndarray  # (B,) segment that bears it
    order: np.ndarray  # (B,)
    generation: np.ndarray  # (B,) of its first piece


@dataclass(frozen=True)
class _Chains:
    """B drawn branches of P pieces."""

    node: np.ndarray  # (B, P + 1, 3)
    heading: np.ndarray  # (B, P, 3)
    across: np.ndarray  # (B, P, 3)
    first: int  # segment number of the first piece of the first branch


def predict_branches(honda: Honda) -> float:
    """The expected number of branches of a tree."""
    leader = honda.leader_ratio > 0
    weights = honda.levels.weights or (1.0,) * len(honda.levels.values)
    total = 0.0
    for levels, weight in zip(honda.levels.values, weights, strict=True):
        here = branches = 1.0
        for level in range(levels):
            trunk = honda.trunk_daughters if level == 0 else None
            here *= mean_of(trunk or honda.daughters) + leader
            branches += here
        total += branches * weight / sum(weights)
    return total


def grow_honda(honda: Honda, leaf: Leaf, key: int) -> tuple[Skeleton, LeafSites]:
    """The skeleton and leaves of one tree.

    key : 64 bits, the lineage of the tree.

    Raises
    ------
    ValueError : more than ``MAX_SEGMENTS`` segments, or a reach beyond ``MAX_REACH``; says how much.
    """
    tree = daughter_keys(np.array([key], np.uint64), "honda")
    levels = int(draw_discrete(honda.levels, tree, "levels")[0])
    _refuse_if_large(honda)
    length_ratio = float(draw_normal(honda.length_ratio, tree, "length ratio")[0])
    radius_ratio = float(draw_normal(honda.radius_ratio, tree, "radius ratio")[0])
    here = _Branches(
        key=tree,
        foot=np.zeros((1, 3)),
        heading=np.array([[0.0, 0.0, 1.0]]),
        across=np.array([[1.0, 0.0, 0.0]]),
        length=draw_normal(honda.length, tree, "length"),
        radius=draw_normal(honda.radius, tree, "radius"),
        parent=np.array([-1]),
        order=np.array([0]),
        generation=np.array([0]),
    )
    skeletons, leaves, drawn = [], [], 0
    for level in range(levels + 1):
        chains = _draw(honda, here, drawn)
        skeletons.append(_segments(here, chains, honda.tip))
        drawn += len(skeletons[-1])
        if leaf.on and level > levels - honda.leaf_levels:
            leaves.append(_leaves(honda, leaf, here, chains))
        if level < levels:
            here = _daughters(honda, here, chains, length_ratio, radius_ratio, level)
            if drawn + len(here.key) * honda.pieces > MAX_SEGMENTS:
                raise ValueError(_too_many(drawn + len(here.key) * honda.pieces))
    return Skeleton.joined(skeletons), LeafSites.joined([LeafSites.none(), *leaves])


def _refuse_if_large(honda: Honda) -> None:
    segments = predict_branches(honda) * honda.pieces
    if segments > MAX_SEGMENTS:
        raise ValueError(_too_many(segments))
    ratio = max(honda.length_ratio.bounds()[1], honda.leader_ratio)
    longest = honda.length.bounds()[1]
    reach = longest * sum(ratio**level for level in range(max(honda.levels.values) + 1))
    if reach > MAX_REACH:
        raise ValueError(
            f"branches would reach {written(reach)} m from the foot, more than {MAX_REACH:g} m; "
            "use a smaller ratio or fewer levels"
        )


def _too_many(segments: float) -> str:
    return (
        f"a tree of about {written(segments)} segments, more than {MAX_SEGMENTS:,}; "
        "use fewer levels, daughters or pieces"
    )


def _draw(honda: Honda, here: _Branches, first: int) -> _Chains:
    """Piece by piece, all branches at once: bent to both sides, then towards the ground."""
    count, pieces = len(here.key), honda.pieces
    node = np.empty((count, pieces + 1, 3))
    headings = np.empty((count, pieces, 3))
    acrosses = np.empty((count, pieces, 3))
    droop = np.where(here.order >= honda.droop_from, honda.droop, 0.0)
    node[:, 0], heading, across = here.foot, here.heading, here.across
    for piece in range(pieces):
        if piece:
            aside = np.cross(heading, across)
            for axis, name in ((across, "crook"), (aside, "crook aside")):
                angle = np.deg2rad(draw_normal(honda.crook_deg, here.key, f"{name} {piece}"))
                heading, across = _turn(heading, axis, angle), _turn(across, axis, angle)
        if droop.any():
            down = np.cross(heading, np.array([0.0, 0.0, -1.0]))
            size = np.linalg.norm(down, axis=1)
            axis = down / np.maximum(size, 1e-12)[:, None]
            # Not past the vertical: a hanging twig hangs.
            angle = np.clip(droop / pieces * size, -np.inf, np.arctan2(size, -heading[:, 2]))
            heading, across = _turn(heading, axis, angle), _turn(across, axis, angle)
        across = across - np.einsum("bi,bi->b", across, heading)[:, None] * heading
        across = across / np.linalg.norm(across, axis=1, keepdims=True)
        heading = heading / np.linalg.norm(heading, axis=1, keepdims=True)
        headings[:, piece], acrosses[:, piece] = heading, across
        node[:, piece + 1] = node[:, piece] + (here.length / pieces)[:, None] * heading
    return _Chains(node, headings, acrosses, first)


def _turn(vectors: np.ndarray, axes: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Vectors (B, 3) turned about unit axes, right-handed (Rodrigues)."""
    cos, sin = np.cos(angles)[:, None], np.sin(angles)[:, None]
    along = np.einsum("bi,bi->b", axes, vectors)[:, None] * axes
    return np.asarray(cos * vectors + sin * np.cross(axes, vectors) + (1 - cos) * along)


def _segments(here: _Branches, chains: _Chains, tip: float) -> Skeleton:
    count, pieces = chains.heading.shape[:2]
    number = chains.first + np.arange(count * pieces).reshape(count, pieces)
    parent = np.concatenate([here.parent[:, None], number[:, :-1]], axis=1)
    taper = 1 + (tip - 1) * np.arange(pieces + 1) / pieces
    radius = here.radius[:, None] * taper
    return Skeleton(
        start=chains.node[:, :-1].reshape(-1, 3),
        end=chains.node[:, 1:].reshape(-1, 3),
        radius=np.stack([radius[:, :-1], radius[:, 1:]], axis=2).reshape(-1, 2),
        parent=parent.ravel(),
        order=np.repeat(here.order, pieces),
        generation=(here.generation[:, None] + np.arange(pieces)).ravel(),
    )


def _daughters(
    honda: Honda,
    here: _Branches,
    chains: _Chains,
    length_ratio: float,
    radius_ratio: float,
    level: int,
) -> _Branches:
    """The next level: children of every branch, and its leader."""
    choice = (honda.trunk_daughters if level == 0 else None) or honda.daughters
    born = draw_discrete(choice, here.key, "daughters")
    parent, number = numbered(born)
    key = daughter_keys(here.key[parent], number)
    share = np.ones(len(parent))
    if honda.sprouting == "along":
        share = honda.bare + (1 - honda.bare) * keyed_uniform(key, "place")
        upwards = np.lexsort((share, parent))  # twists are counted from the foot up
        key, share = key[upwards], share[upwards]
        total = np.cumsum(np.deg2rad(draw_normal(honda.twist_deg, key, "twist")))
        before = np.concatenate([[0.0], total])[np.cumsum(born) - born]
        azimuth = total - np.repeat(before, born)
    else:  # evenly around the tip
        turned = np.deg2rad(draw_normal(honda.twist_deg, here.key, "twist of daughters"))
        azimuth = turned[parent] + 2 * np.pi * number / born[parent]
    angle = np.deg2rad(draw_normal(honda.angle_deg, key, "angle"))
    shorter = 1 - honda.cone * (share - honda.bare) / (1 - honda.bare)
    length = here.length[parent] * length_ratio * np.minimum(shorter, 1.0)
    radius = here.radius[parent] * radius_ratio
    order = here.order[parent] + 1

    if honda.leader_ratio > 0:
        every = np.arange(len(born))
        leader = daughter_keys(here.key, LEADER)
        parent, share = np.concatenate([parent, every]), np.concatenate([share, np.ones(len(born))])
        key, angle = np.concatenate([key, leader]), np.concatenate([angle, np.zeros(len(born))])
        twist = np.deg2rad(draw_normal(honda.twist_deg, leader, "twist"))
        azimuth = np.concatenate([azimuth, twist])
        length = np.concatenate([length, here.length * honda.leader_ratio])
        radius = np.concatenate([radius, here.radius * honda.tip])
        order = np.concatenate([order, here.order])

    foot, forward, across, piece, segment = _along(chains, parent, share)
    local = here.radius[parent] * (1 + (honda.tip - 1) * share)
    around = np.cos(azimuth)[:, None] * across
    around = around + np.sin(azimuth)[:, None] * np.cross(forward, across)
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return _Branches(
        key=key,
        foot=foot,
        heading=cos * forward + sin * around,
        across=cos * around - sin * forward,  # in the plane of parent and child
        length=length,
        radius=np.minimum(radius, local),  # no thicker than the parent where it leaves it
        parent=segment,
        order=order,
        generation=here.generation[parent] + piece + 1,
    )


def _along(chains: _Chains, branch: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, ...]:
    """Places (N, 3) at shares (N,) of the length of branches (N,), heading and across (N, 3) there, and
    the piece and the segment (N,) that they are on."""
    pieces = chains.heading.shape[1]
    piece = np.minimum((share * pieces).astype(np.int64), pieces - 1)
    part = (share * pieces - piece)[:, None]
    start, end = chains.node[branch, piece], chains.node[branch, piece + 1]
    return (
        start + part * (end - start),
        chains.heading[branch, piece],
        chains.across[branch, piece],
        piece,
        chains.first + branch * pieces + piece,
    )


def _leaves(honda: Honda, leaf: Leaf, here: _Branches, chains: _Chains) -> LeafSites:
    """Evenly along every branch, the last at its very tip."""
    born = draw_discrete(honda.leaves, here.key, "leaves")
    branch, number = numbered(born)
    key = daughter_keys(daughter_keys(here.key[branch], "leaf"), number)
    foot, heading, across, _, segment = _along(chains, branch, (number + 1) / born[branch])
    phase = 2 * np.pi * keyed_uniform(here.key, "leaf phase")[branch]
    return set_leaves(leaf, key, foot, heading, across, phase + GOLDEN * number, segment)
