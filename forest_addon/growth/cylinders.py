"""The branches of a tree as cylinders, in the terms of quantitative structure models (TreeQSM and its kin).

A segment of the skeleton is a cylinder: it knows its parent, its extension (the segment that goes on along
the same axis), its axis and its order. Radii are those at both ends; the cylinder's own is that of equal
volume, r² = (r₁² + r₁r₂ + r₂²)/3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .mesh.axes import find_axes
from .skeleton import Skeleton


@dataclass(frozen=True)
class Cylinders:
    """C cylinders of one tree, a parent before its children.

    start, end : (C, 3) metres. radius : (C, 2) at start and end. parent, extension : (C,) int64, -1 where
    there is none. axis : (C,) int64, counted from the trunk's 0. order : (C,) int64, 0 for the trunk.
    """

    start: np.ndarray
    end: np.ndarray
    radius: np.ndarray
    parent: np.ndarray
    extension: np.ndarray
    axis: np.ndarray
    order: np.ndarray

    def __len__(self) -> int:
        return len(self.parent)

    @property
    def equal_radius(self) -> np.ndarray:
        """(C,) radius of the cylinder of the same length and volume."""
        r1, r2 = self.radius.T
        return np.asarray(np.sqrt((r1**2 + r1 * r2 + r2**2) / 3))

    @property
    def length(self) -> np.ndarray:
        """(C,) metres."""
        return np.asarray(np.linalg.norm(self.end - self.start, axis=1))


def cylinders_of(skeleton: Skeleton) -> Cylinders:
    """The cylinders of a skeleton, in its order."""
    axes = find_axes(skeleton)
    count = len(skeleton)
    axis = np.empty(count, np.int64)
    axis[axes.segment] = np.repeat(np.arange(len(axes)), np.diff(axes.first))
    extension = np.full(count, -1, np.int64)
    before, after = axes.segment[:-1], axes.segment[1:]
    same = axis[before] == axis[after]
    extension[before[same]] = after[same]
    return Cylinders(
        start=skeleton.start,
        end=skeleton.end,
        radius=skeleton.radius,
        parent=skeleton.parent,
        extension=extension,
        axis=axis,
        order=skeleton.order,
    )


def diameter_at(skeleton: Skeleton, height: float) -> float:
    """Diameter of the trunk at a height; of several stems that of a circle of all their area.

    A stem is measured where its axis of order 0 first passes the height, at right angles to the axis. 0 where
    no stem reaches it.
    """
    trunk = skeleton.order == 0
    low, high = skeleton.start[trunk, 2], skeleton.end[trunk, 2]
    passed = (low <= height) & (high > height)
    if not passed.any():
        return 0.0
    share = (height - low[passed]) / (high[passed] - low[passed])
    r1, r2 = skeleton.radius[trunk][passed].T
    return float(2 * np.sqrt(((r1 + share * (r2 - r1)) ** 2).sum()))
