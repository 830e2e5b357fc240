"""Axes of a skeleton: the segments of each, and the first-level branch that each belongs to.

An axis goes on from a segment to its first child of equal order that starts where the segment ends;
every other child starts an axis of its own. Both questions are answered for all segments at once by
pointer doubling: a segment that has jumped k parents towards its end of the chain jumps 2k next time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..skeleton import Skeleton

TOUCH = 1e-6  # metres between the end of a segment and the start of the one that continues it


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


def find_axes(skeleton: Skeleton) -> Axes:
    """Sort the segments of a skeleton into axes."""
    before = _before(skeleton)
    head = _root(before)
    segment = np.argsort(head, kind="stable")  # a parent comes first, so an axis stays in order
    starts = np.flatnonzero(np.diff(head[segment], prepend=-1))
    return Axes(segment, np.append(starts, len(segment)).astype(np.int64))


def first_level(skeleton: Skeleton) -> np.ndarray:
    """(S,) int64: the first-level branch of each segment, counted from 0; -1 on the trunk."""
    order, parent = skeleton.order, skeleton.parent
    starts = (order == 1) & ((parent < 0) | (order[np.maximum(parent, 0)] == 0))
    number = np.where(starts, np.cumsum(starts) - 1, -1)
    up = np.where(starts | (order == 0), -1, parent)
    return np.asarray(np.where(order == 0, -1, number[_root(up)]))


def _before(skeleton: Skeleton) -> np.ndarray:
    """(S,) the segment that each one continues, -1 where an axis starts."""
    parent = skeleton.parent
    mother = np.maximum(parent, 0)
    gap = np.abs(skeleton.start - skeleton.end[mother]).max(axis=1, initial=0.0)
    onward = np.flatnonzero(
        (parent >= 0) & (skeleton.order == skeleton.order[mother]) & (gap <= TOUCH)
    )
    chosen = np.full(len(parent), -1, dtype=np.int64)
    chosen[parent[onward[::-1]]] = onward[::-1]  # written backwards: the first child stays
    before = np.full(len(parent), -1, dtype=np.int64)
    continued = np.flatnonzero(chosen >= 0)
    before[chosen[continued]] = continued
    return before


def _root(up: np.ndarray) -> np.ndarray:
    """(S,) where a chain of pointers ends; -1 points nowhere."""
    at = np.where(up < 0, np.arange(len(up)), up)
    while True:
        further = at[at]
        if np.array_equal(further, at):
            return at
        at = further
