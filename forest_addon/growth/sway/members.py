"""Reduction of a skeleton to a few straight members, which carry all the rest of the tree as mass.

Short segments of one axis become a member of up to a fortieth of the tree's height; of those the thickest
stay. What is thinner rides rigidly on the member that it grows from.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..skeleton import Skeleton

LONGEST = 1 / 40  # of the tree's height, of a member
MOST = 240  # members


@dataclass(frozen=True)
class Members:
    """B straight tapered members of a tree and how its S segments ride on them.

    start, end : (B, 3) metres. radius : (B, 2) at start and end, metres, that give the segments' volume.
    node : (B, 2) int64, nodes of start and end; node 0 is the ground, b + 1 the end of member b.
    offset : (B, 3) metres from the start's node to the member's start.
    of_segment : (S,) int64, the member that each segment is part of, or rides on.
    kept : (S,) bool, part of a member. along : (S, 2) share of the member's length where each segment's start
    and end hold on to it.
    """

    start: np.ndarray
    end: np.ndarray
    radius: np.ndarray
    node: np.ndarray
    offset: np.ndarray
    of_segment: np.ndarray
    kept: np.ndarray
    along: np.ndarray

    def __len__(self) -> int:
        return len(self.start)

    @property
    def nodes(self) -> np.ndarray:
        """(B + 1, 3) places of the nodes, metres."""
        return np.concatenate([self.start[:1], self.end])


def members_of(skeleton: Skeleton, most: int = MOST) -> Members:
    """Reduce a skeleton of at least one segment to members."""
    height = float(skeleton.end[:, 2].max() - skeleton.start[:, 2].min())
    member = _joined(skeleton, LONGEST * height)
    count = int(member.max()) + 1
    first, last = _ends(member, count)
    mother = skeleton.parent[first]
    above = np.where(mother >= 0, member[np.maximum(mother, 0)], -1)
    girth = skeleton.radius[first].mean(axis=1)
    for b in range(count):  # a member is no thicker than the one that it grows from
        if above[b] >= 0:
            girth[b] = min(girth[b], girth[above[b]])
    stays = np.zeros(count, dtype=bool)
    stays[np.argsort(-girth, kind="stable")[:most]] = True
    number = np.cumsum(stays) - 1
    bearer = np.arange(count)
    for b in range(count):
        if not stays[b]:
            bearer[b] = bearer[above[b]] if above[b] >= 0 else 0
    own = bearer[member]
    start, end = skeleton.start[first[stays]], skeleton.end[last[stays]]
    radius = _radii(skeleton, member, first, last)[stays]
    node, offset = _nodes(start, end, np.where(above >= 0, number[above], -1)[stays])
    along = _along(skeleton, stays[member], number[own], start, end)
    return Members(start, end, radius, node, offset, number[own], stays[member], along)


def _joined(skeleton: Skeleton, longest: float) -> np.ndarray:
    """(S,) the member of each segment: on along its axis until that is long enough; parents come first."""
    length = np.linalg.norm(skeleton.end - skeleton.start, axis=1).tolist()
    parent, order = skeleton.parent.tolist(), skeleton.order.tolist()
    member = [0] * len(parent)
    went_on = [False] * len(parent)
    reach: list[float] = []
    for s, mother in enumerate(parent):
        on = mother >= 0 and order[mother] == order[s] and not went_on[mother]
        if on:
            went_on[mother] = True
        if on and reach[member[mother]] + length[s] <= longest:
            member[s] = member[mother]
            reach[member[s]] += length[s]
        else:
            member[s] = len(reach)
            reach.append(length[s])
    return np.array(member)


def _ends(member: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(B,) the first and the last segment of each member."""
    rows = np.arange(len(member))
    first, last = np.full(count, len(member)), np.zeros(count, dtype=np.int64)
    np.minimum.at(first, member, rows)
    np.maximum.at(last, member, rows)
    return first, last


def _radii(
    skeleton: Skeleton, member: np.ndarray, first: np.ndarray, last: np.ndarray
) -> np.ndarray:
    """(B, 2) radii of members whose volume is that of their segments."""
    radius = np.stack([skeleton.radius[first, 0], skeleton.radius[last, 1]], axis=1)
    chord = np.linalg.norm(skeleton.end[last] - skeleton.start[first], axis=1)
    volume = np.bincount(member, frustum(skeleton.start, skeleton.end, skeleton.radius))
    r1, r2 = np.maximum(radius, 1e-5).T
    own = np.pi * np.maximum(chord, 1e-9) * (r1 * r1 + r1 * r2 + r2 * r2) / 3
    scale = np.sqrt(np.clip(volume / own, 0.25, 4.0))
    return np.stack([r1, r2], axis=1) * scale[:, None]


def frustum(start: np.ndarray, end: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """(S,) volumes of tapered segments, m³."""
    r1, r2 = radius.T
    return np.pi * np.linalg.norm(end - start, axis=1) * (r1 * r1 + r1 * r2 + r2 * r2) / 3


def _nodes(start: np.ndarray, end: np.ndarray, above: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(B, 2) nodes of members and (B, 3) from its node, the nearer end of the mother, to each start."""
    count = len(start)
    base = np.zeros(count, dtype=np.int64)
    node = np.stack([base, np.arange(count) + 1], axis=1)
    place = np.concatenate([start[:1], end])
    for b in range(1, count):
        if above[b] < 0:
            continue
        ends = node[above[b]]
        away = np.linalg.norm(place[ends] - start[b], axis=1)
        node[b, 0] = ends[int(np.argmin(away))]
    return node, np.where((above < 0)[:, None], 0.0, start - place[node[:, 0]])


def _along(
    skeleton: Skeleton,
    kept: np.ndarray,
    own: np.ndarray,
    start: np.ndarray,
    end: np.ndarray,
) -> np.ndarray:
    """(S, 2) where segments hold on; what rides does so where the first of it leaves the member."""
    axis = (end - start)[own]
    square = np.maximum((axis * axis).sum(axis=1), 1e-18)

    def share(points: np.ndarray) -> np.ndarray:
        return np.clip(((points - start[own]) * axis).sum(axis=1) / square, 0.0, 1.0)

    along = np.stack([share(skeleton.start), share(skeleton.end)], axis=1)
    for s in np.flatnonzero(~kept).tolist():
        mother = skeleton.parent[s]
        rides = mother >= 0 and not kept[mother]
        along[s] = along[mother, 0] if rides else along[s, 0]
    return along
