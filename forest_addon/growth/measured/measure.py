"""Measures of a grown tree as a forester takes them, by the definitions of the tables of measured ones.

Diameter: of the stem 1.3 m above the ground. Height: of the highest point. Base of the crown: where the
lowest branch that bears leaves leaves the stem. Width: the mean diameter of the crown seen from above,
over all directions, from the outermost leaf to the outermost leaf: the mean caliper of a convex hull is
its perimeter over π (Cauchy).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ..mesh.axes import first_level
from ..skeleton import LeafSites, Skeleton

BREAST = 1.3  # metres
MANY = 2000  # points, of which an inner hull is made first


def dbh_of(skeleton: Skeleton) -> float:
    """Diameter of the stem at breast height, metres; 0 of a tree that does not reach it."""
    stem = np.flatnonzero(skeleton.order == 0)
    low, high = skeleton.start[stem, 2], skeleton.end[stem, 2]
    across = np.flatnonzero((low <= BREAST) & (high >= BREAST) & (high > low))
    if not len(across):
        return 0.0
    share = (BREAST - low[across]) / (high[across] - low[across])
    r = skeleton.radius[stem[across]]
    return 2 * float((r[:, 0] + share * (r[:, 1] - r[:, 0])).max())


def stem_profile(skeleton: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    """Heights (P,) ascending and diameters (P,) of the stem, metres."""
    stem = np.flatnonzero(skeleton.order == 0)
    z = np.concatenate([skeleton.start[stem, 2], skeleton.end[stem, 2]])
    d = 2 * np.concatenate([skeleton.radius[stem, 0], skeleton.radius[stem, 1]])
    up = np.lexsort((-d, z))
    return z[up], d[up]


def crown_base_of(skeleton: Skeleton, segment: np.ndarray) -> float:
    """Height of the lowest first-level branch that bears leaves, on segments (L,), metres."""
    bears = np.zeros(len(skeleton) + 1, dtype=bool)  # the last for leaves that nothing bears
    bears[segment] = True
    bears = bears[:-1]
    return lowest_branch(skeleton, first_level(skeleton)[bears]) if bears.any() else 0.0


def lowest_branch(skeleton: Skeleton, branch: np.ndarray) -> float:
    """Height of the lowest of first-level branches (L,), metres; without any, of the stem's lowest node."""
    level = first_level(skeleton)
    leafy = np.unique(branch[branch >= 0])
    if not len(leafy):
        return 0.0
    parent = np.maximum(skeleton.parent, 0)
    foot = np.flatnonzero((level >= 0) & ((level != level[parent]) | (skeleton.parent < 0)))
    foot = foot[np.isin(level[foot], leafy)]
    return float(skeleton.start[foot, 2].min())


def width_of(points: np.ndarray) -> float:
    """Mean diameter of points (N, 2 or 3) seen from above, over all directions, metres."""
    if len(points) < 3:
        return 0.0
    flat = points[:, :2]
    try:
        if len(flat) > MANY:  # what lies within the hull of some cannot be on that of all
            some = ConvexHull(flat[:: len(flat) // MANY])
            middle = some.points[some.vertices].mean(axis=0)
            inner = -float((some.equations[:, :2] @ middle + some.equations[:, 2]).max())
            x, y = flat[:, 0] - middle[0], flat[:, 1] - middle[1]
            flat = flat[x * x + y * y >= (0.999 * inner) ** 2]
        return float(ConvexHull(flat).area) / np.pi  # in the plane "area" is the perimeter
    except QhullError:  # all in a line
        return 2 * float(np.linalg.norm(np.ptp(flat, axis=0))) / np.pi


def leaf_tips(sites: LeafSites) -> np.ndarray:
    """(L, 3) where leaves end."""
    return np.asarray(sites.foot + sites.length[:, None] * sites.direction)
