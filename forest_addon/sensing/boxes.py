"""Which instances a ray may meet: rays against axis-aligned boxes, in float64."""

from __future__ import annotations

import numpy as np


def candidates(
    low: np.ndarray,
    high: np.ndarray,
    origins: np.ndarray,
    directions: np.ndarray,
    limit: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of ray and box that meet within the limit, sorted by ray and then by distance of entry.

    low, high : (I, 3) corners; NaN boxes are never met.
    origins, directions : (R, 3), unit directions. limit : (R,) metres.

    Returns ray (P,), box (P,), entry (P,) metres, 0 where the ray starts inside. The boxes are taken
    slightly larger, so that rounding never loses one.
    """
    slack = 1e-9 * (1.0 + np.nanmax(np.abs(np.stack([low, high])), initial=0.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        inverse = 1.0 / directions
        near = np.zeros((len(origins), len(low)))
        far = np.broadcast_to(limit[:, None], near.shape).copy()
        for axis in range(3):
            a = (low[:, axis] - slack - origins[:, axis, None]) * inverse[:, axis, None]
            b = (high[:, axis] + slack - origins[:, axis, None]) * inverse[:, axis, None]
            # A ray in a face's plane gives 0·inf = NaN there: that slab does not limit it.
            near = np.fmax(near, np.fmin(a, b))
            far = np.fmin(far, np.fmax(a, b))
    empty = ~np.isfinite(low).all(axis=1)
    ray, box = np.nonzero((near <= far) & ~empty & np.isfinite(directions).all(axis=1)[:, None])
    entry = near[ray, box]
    order = np.lexsort((entry, ray))
    return ray[order], box[order], entry[order]
