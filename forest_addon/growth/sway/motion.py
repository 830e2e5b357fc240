"""Interface of moving trees to sensors: points held by a skeleton, displaced at a time.

The rest geometry of a tree stays as it grew. A point of it (a vertex, a leaf's centre) is tied to the
skeleton once for each variant, as ``Anchors``; a ``Motion`` says how far the point is from its place at
rest at any time. Displacements within a triangle are linear between those of its corners.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np


@dataclass(frozen=True)
class Anchors:
    """Holds of N points of a variant at rest on its moving skeleton, in the variant's own frame.

    bone : (N,) int32, the member of the reduced skeleton that moves the point.
    along : (N,) float32 share of the member's length, from 0 at its start to 1 at its end.
    arm : (N, 3) float32 metres from the member's axis there to the point.
    leaf : (N,) int32 number of the leaf that the point is of, -1 where it is wood.
    reach : (N, 3) float32 metres from the leaf's foot to the point, zeros where it is wood.
    """

    bone: np.ndarray
    along: np.ndarray
    arm: np.ndarray
    leaf: np.ndarray
    reach: np.ndarray

    def __len__(self) -> int:
        return len(self.bone)

    def __getitem__(self, rows: np.ndarray) -> Anchors:
        """The anchors of some points, by numbers or a mask; of corners (N, 3), flat them first."""
        return Anchors(*(getattr(self, f.name)[rows] for f in fields(self)))


class Motion(Protocol):
    """Trees of a stand that move: a pure function of place and time, the same in any order and process.

    A tree is named by its number in the stand, the one that sensors report. Results are in world axes, on
    top of the point's place at rest in the world (``GrownForest.transforms`` times the variant's point).
    """

    def displacement(self, tree: np.ndarray, at: Anchors, time: np.ndarray) -> np.ndarray:
        """(N, 3) metres that points of trees ``tree`` (N,) are off their rest at ``time`` (N,) seconds.

        Smooth in time, with a continuous first derivative.
        """
        ...

    def velocity(self, tree: np.ndarray, at: Anchors, time: np.ndarray) -> np.ndarray:
        """(N, 3) metres a second, the exact derivative of ``displacement``."""
        ...

    def reach(self, tree: np.ndarray) -> np.ndarray:
        """(N,) metres of six standard deviations, which points of each tree hardly ever exceed."""
        ...

    def anchors(self, tree: int) -> Anchors:
        """Anchors of the mesh vertices of a tree's variant, in the order of ``Tree.mesh.vertices``."""
        ...

    def anchors_of(self, tree: int, points: np.ndarray, leaf: np.ndarray) -> Anchors:
        """Anchors of points (N, 3) of a tree's variant in its own frame; leaf : (N,) its leaf, -1 wood."""
        ...
