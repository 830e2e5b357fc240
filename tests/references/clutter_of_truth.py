"""Branches and leaves of a tree as sound meets them, from its skeleton and leaves rather than its mesh."""

import numpy as np

from forest_addon.growth.mesh.leaves import Leaves
from forest_addon.growth.skeleton import Skeleton
from forest_addon.sensing.reverb.forest.clutter import Blades, Rods


def rods_of_skeleton(skeleton: Skeleton) -> Rods:
    """All wood but the trunk."""
    rows = skeleton.order > 0
    way = skeleton.end[rows] - skeleton.start[rows]
    length = np.linalg.norm(way, axis=1)
    return Rods(
        length,
        skeleton.radius[rows].mean(axis=1),
        0.5 * (skeleton.start[rows] + skeleton.end[rows])[:, 2],
        np.abs(way[:, 2]) / np.maximum(length, 1e-12),
    )


def blades_of_leaves(leaves: Leaves) -> Blades:
    """Of a tree's truth."""
    return Blades(np.pi * leaves.radius**2, leaves.radius, leaves.centre[:, 2], 0.0 * leaves.radius)
