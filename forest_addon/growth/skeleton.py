"""The skeleton of a tree: straight segments that know their parent, and where its leaves sit.

What a turtle or a branching model makes and a mesher takes. A child may start anywhere on its parent,
not only at the end; a segment of the same order as its parent continues that axis.

An axis goes on from a segment to its first child of equal order that starts where the segment ends;
every other child starts an axis of its own. Such questions are answered for all segments at once by
pointer doubling: a segment that has jumped k parents towards its end of the chain jumps 2k next time.

In the terms of quantitative structure models (TreeQSM and its kin) a segment is a cylinder: it knows its
parent, its extension (the segment that goes on along the same axis), its axis and its order. Radii are those
at both ends; the cylinder's own is that of equal volume, r² = (r₁² + r₁r₂ + r₂²)/3.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..base.rows import RowTable

TOUCH = 1e-6  # metres between the end of a segment and the start of the one that continues it


@dataclass(frozen=True)
class Skeleton(RowTable):
    """S segments, perhaps none; a parent comes before its children.

    start, end : (S, 3) metres.
    radius : (S, 2) at start and end, metres.
    parent : (S,) int64, -1 for the root.
    order : (S,) int64, 0 for the trunk, 1 for first-level branches, ...
    generation : (S,) int64, number of segments below on the way to the root.
    dead : (S,) bool, wood that lives no more, leafless and broken; None: all of it lives.
    """

    start: np.ndarray
    end: np.ndarray
    radius: np.ndarray
    parent: np.ndarray
    order: np.ndarray
    generation: np.ndarray
    dead: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.parent)

    @property
    def is_dead(self) -> np.ndarray:
        """(S,) bool, whether each segment is dead."""
        return np.zeros(len(self), dtype=bool) if self.dead is None else self.dead

    @property
    def length(self) -> np.ndarray:
        """(S,) metres."""
        return np.asarray(np.linalg.norm(self.end - self.start, axis=1))

    @property
    def volume(self) -> np.ndarray:
        """(S,) m³, as frustums of cones."""
        return frustums(self.length, self.radius)

    @classmethod
    def of_chains(
        cls,
        node: np.ndarray,
        radius: np.ndarray,
        parent: np.ndarray,
        order: np.ndarray,
        generation: np.ndarray,
        first: int,
    ) -> Skeleton:
        """Branches of as many segments each, branch by branch, numbered from ``first`` on.

        node, radius : (B, P + 1, 3), (B, P + 1) of each branch from foot to tip. parent : (B,) segments that
        bear them. order, generation : (B,) of each branch, and of its first segment.
        """
        count, pieces = len(node), node.shape[1] - 1
        number = first + np.arange(count * pieces).reshape(count, pieces)
        return cls(
            start=node[:, :-1].reshape(-1, 3),
            end=node[:, 1:].reshape(-1, 3),
            radius=np.stack([radius[:, :-1], radius[:, 1:]], axis=2).reshape(-1, 2),
            parent=np.concatenate([parent[:, None], number[:, :-1]], axis=1).ravel(),
            order=np.repeat(order, pieces),
            generation=(generation[:, None] + np.arange(pieces)).ravel(),
        )

    def some(self, keep: np.ndarray) -> Skeleton:
        """The segments where ``keep`` (S,) is true; one whose parent is not kept becomes a root."""
        number = np.cumsum(keep) - 1
        above = self.parent[keep]
        known = (above >= 0) & keep[np.maximum(above, 0)]
        parent = np.where(known, number[np.maximum(above, 0)], -1)
        return replace(self.select(keep), parent=parent)

    def axis(self, first: int) -> list[int]:
        """The segments of one axis, from ``first`` on, each followed by that by which the axis goes on."""
        chain: list[int] = find_axes(self).chain(first).tolist()
        return chain[chain.index(first) :]


@dataclass(frozen=True)
class LeafSites(RowTable):
    """Sites of L leaves on a skeleton, before they have a shape.

    foot : (L, 3) where the leaf leaves the wood, metres.
    direction : (L, 3) unit, from the foot along the leaf's midrib.
    up : (L, 3) unit, normal of the leaf's upper side, at right angles to ``direction``.
    length, width : (L,) metres.
    segment : (L,) int64, the segment that bears it, -1 where there is none.
    """

    foot: np.ndarray
    direction: np.ndarray
    up: np.ndarray
    length: np.ndarray
    width: np.ndarray
    segment: np.ndarray

    def __len__(self) -> int:
        return len(self.length)

    @classmethod
    def none(cls) -> LeafSites:
        """An empty set of leaves."""
        vectors, numbers = np.empty((0, 3)), np.empty(0)
        return cls(vectors, vectors, vectors, numbers, numbers, np.empty(0, np.int64))


@dataclass(frozen=True)
class Axes:
    """S segments sorted into A axes.

    segment : (S,) int64, the segments axis by axis, from foot to tip.
    first : (A + 1,) int64, where each axis starts within ``segment``; the last entry is S.
    """

    segment: np.ndarray
    first: np.ndarray

    def __len__(self) -> int:
        return len(self.first) - 1

    @property
    def of_row(self) -> np.ndarray:
        """(S,) the axis of each entry of ``segment``."""
        return np.repeat(np.arange(len(self)), np.diff(self.first))

    @property
    def of_segment(self) -> np.ndarray:
        """(S,) the axis of each segment."""
        axis = np.empty(len(self.segment), np.int64)
        axis[self.segment] = self.of_row
        return axis

    def chain(self, segment: int) -> np.ndarray:
        """(K,) the segments of the axis that a segment is of, from foot to tip."""
        axis = self.of_segment[segment]
        return self.segment[self.first[axis] : self.first[axis + 1]]

    @property
    def onward(self) -> np.ndarray:
        """(S,) the segment by which the axis goes on from each segment, -1 from a last one."""
        onward = np.full(len(self.segment), -1, np.int64)
        within = np.diff(self.of_row) == 0
        onward[self.segment[:-1][within]] = self.segment[1:][within]
        return onward


def find_axes(skeleton: Skeleton) -> Axes:
    """Sort the segments of a skeleton into axes."""
    parent = skeleton.parent
    above = np.maximum(parent, 0)
    gap = np.abs(skeleton.start - skeleton.end[above]).max(axis=1, initial=0.0)
    onward = np.flatnonzero(
        (parent >= 0) & (skeleton.order == skeleton.order[above]) & (gap <= TOUCH)
    )
    chosen = np.full(len(parent), -1, dtype=np.int64)
    chosen[parent[onward[::-1]]] = onward[::-1]  # written backwards: the first child stays
    before = np.full(len(parent), -1, dtype=np.int64)  # the segment that each one continues
    continued = np.flatnonzero(chosen >= 0)
    before[chosen[continued]] = continued
    head = root_of(before)
    segment = np.argsort(head, kind="stable")  # a parent comes first, so an axis stays in order
    starts = np.flatnonzero(np.diff(head[segment], prepend=-1))
    return Axes(segment, np.append(starts, len(segment)).astype(np.int64))


def branch_feet(skeleton: Skeleton) -> np.ndarray:
    """(B,) first segment of each first-level branch."""
    order, parent = skeleton.order, skeleton.parent
    return np.flatnonzero((order == 1) & ((parent < 0) | (order[np.maximum(parent, 0)] == 0)))


def first_level(skeleton: Skeleton) -> np.ndarray:
    """(S,) int64: the first-level branch of each segment, counted from 0; -1 on the trunk."""
    feet, number = branch_feet(skeleton), np.full(len(skeleton), -1)
    number[feet] = np.arange(len(feet))
    up = np.where((number >= 0) | (skeleton.order == 0), -1, skeleton.parent)
    return np.asarray(np.where(skeleton.order == 0, -1, number[root_of(up)]))


def frustums(length: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """(S,) m³ of frustums of cones of these lengths (S,) and radii (S, 2) at both ends, metres."""
    r1, r2 = radius.T
    return np.asarray(np.pi * length * (r1**2 + r1 * r2 + r2**2) / 3)


def equal_radius(radius: np.ndarray) -> np.ndarray:
    """(S,) radii of cylinders of the length and volume of frustums of these radii (S, 2) at both ends."""
    r1, r2 = radius.T
    return np.asarray(np.sqrt((r1**2 + r1 * r2 + r2**2) / 3))


def root_of(up: np.ndarray) -> np.ndarray:
    """(S,) where chains of pointers (S,) end; -1 points nowhere. Each round goes twice as far."""
    at = np.where(up < 0, np.arange(len(up)), up)
    while True:
        further = at[at]
        if np.array_equal(further, at):
            return at
        at = further


def stem_radii(skeleton: Skeleton, height: float) -> np.ndarray:
    """(N,) radii of the stems where axes of order 0 pass a height, at right angles to the axis."""
    trunk = np.flatnonzero(skeleton.order == 0)
    low, high = skeleton.start[trunk, 2], skeleton.end[trunk, 2]
    passed = (low <= height) & (high > height)
    share = (height - low[passed]) / (high[passed] - low[passed])
    r1, r2 = skeleton.radius[trunk[passed]].T
    return np.asarray(r1 + share * (r2 - r1))


def diameter_at(skeleton: Skeleton, height: float) -> float:
    """Diameter of the trunk at a height; of several stems that of a circle of all their area; 0 above all."""
    return float(2 * np.sqrt((stem_radii(skeleton, height) ** 2).sum()))


def depths(parent: np.ndarray, each: np.ndarray | None = None) -> np.ndarray:
    """(N,) how many ancestors each of N things has, by their parents (N,), -1 for none.

    each : (N,) what a step to the parent counts, where that is not 1.
    """
    has = parent >= 0
    depth, above = np.where(has, 1 if each is None else each, 0).astype(np.int64), parent
    while has.any():  # twice as far with each round
        depth = depth + np.where(has, depth[np.maximum(above, 0)], 0)
        above = np.where(has, above[np.maximum(above, 0)], -1)
        has = above >= 0
    return depth
