"""The skeleton of a tree: straight segments that know their parent, and where its leaves sit.

What a turtle or a branching model makes and a mesher takes. A child may start anywhere on her parent,
not only at her end; a segment of the same order as its parent continues her axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Skeleton:
    """S segments, perhaps none; a parent comes before her children.

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

    def some(self, keep: np.ndarray) -> Skeleton:
        """The segments where ``keep`` (S,) is true; one whose parent is not kept becomes a root."""
        number = np.cumsum(keep) - 1
        mother = self.parent[keep]
        known = (mother >= 0) & keep[np.maximum(mother, 0)]
        return Skeleton(
            start=self.start[keep],
            end=self.end[keep],
            radius=self.radius[keep],
            parent=np.where(known, number[np.maximum(mother, 0)], -1),
            order=self.order[keep],
            generation=self.generation[keep],
            dead=None if self.dead is None else self.dead[keep],
        )

    def axis(self, first: int) -> list[int]:
        """The segments of one axis, from ``first`` on, each followed by its child of equal order."""
        chain = [first]
        while True:
            onward = np.flatnonzero(
                (self.parent == chain[-1]) & (self.order == self.order[chain[-1]])
            )
            if not len(onward):
                return chain
            chain.append(int(onward[0]))


@dataclass(frozen=True)
class LeafSites:
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
        """No leaves at all."""
        vectors, numbers = np.empty((0, 3)), np.empty(0)
        return cls(vectors, vectors, vectors, numbers, numbers, np.empty(0, np.int64))
