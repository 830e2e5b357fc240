"""First hits of rays on the exact frusta of a skeleton's segments, float64: no mesh in between.

Each segment is the closed frustum of a cone (its caps included) that ``growth.truth`` sums up. A point at
s along the axis has the radius r₁ + k·s, so with w the way from the start to the ray's origin, and ⊥ what is
at right angles to the axis, |w⊥ + t·d⊥|² = (r₁ + k·(w∥ + t·d∥))² is a quadratic equation in t.
"""

from __future__ import annotations

import numpy as np

from forest_addon.growth.skeleton import Skeleton

PAIRS = 400_000  # rays x segments at a time


def first_hits(skeleton: Skeleton, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(R,) metres along unit directions (R, 3) to the first surface, inf where there is none."""
    distance = np.full(len(origins), np.inf)
    at_once = max(1, PAIRS // max(len(skeleton), 1))
    for first in range(0, len(origins), at_once):
        rows = slice(first, first + at_once)
        distance[rows] = _meet(skeleton, origins[rows], directions[rows])
    return distance


def _meet(skeleton: Skeleton, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """The nearest of all segments, (R,)."""
    axis = skeleton.end - skeleton.start
    length = np.linalg.norm(axis, axis=1)
    axis = axis / length[:, None]
    r1, r2 = skeleton.radius.T
    taper = (r2 - r1) / length
    w = origins[:, None] - skeleton.start  # (R, S, 3)
    along, speed = np.einsum("rsi,si->rs", w, axis), directions @ axis.T
    ww, wd = np.einsum("rsi,rsi->rs", w, w), np.einsum("rsi,ri->rs", w, directions)
    here = r1 + taper * along  # the cone's radius beside the origin
    a = 1.0 - speed**2 * (1.0 + taper**2)
    b = wd - along * speed - taper * speed * here
    c = ww - along**2 - here**2
    nearest = np.full(len(origins), np.inf)
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(b * b - a * c)
        for t in ((-b - root) / a, (-b + root) / a):
            s = along + t * speed
            on = (t >= 0) & (s >= 0) & (s <= length) & (r1 + taper * s >= 0)
            nearest = np.minimum(nearest, np.where(on, t, np.inf).min(axis=1, initial=np.inf))
        for end, radius in ((0.0, r1), (length, r2)):
            t = (end - along) / speed
            off = ww + 2 * t * wd + t * t - end**2  # squared distance from the axis on the cap
            on = (t >= 0) & (off <= radius**2)
            nearest = np.minimum(nearest, np.where(on, t, np.inf).min(axis=1, initial=np.inf))
    return nearest
