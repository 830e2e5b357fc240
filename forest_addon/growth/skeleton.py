"""The skeleton of a tree: straight segments that know their mother."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Skeleton:
    """S segments; a mother comes before her daughters.

    start, end : (S, 3) metres.
    radius : (S, 2) at start and end, metres.
    parent : (S,) int64, -1 for the root.
    order : (S,) int64, 0 for the trunk, 1 for first-level branches, ...
    generation : (S,) int64, number of segments below on the way to the root.
    """

    start: np.ndarray
    end: np.ndarray
    radius: np.ndarray
    parent: np.ndarray
    order: np.ndarray
    generation: np.ndarray

    def __len__(self) -> int:
        return len(self.parent)

    def axis(self, first: int) -> list[int]:
        """The segments of one axis, from ``first`` on, each followed by its daughter of equal order."""
        chain = [first]
        while True:
            onward = np.flatnonzero(
                (self.parent == chain[-1]) & (self.order == self.order[chain[-1]])
            )
            if not len(onward):
                return chain
            chain.append(int(onward[0]))
