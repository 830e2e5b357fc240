"""A straight tapered stem as a skeleton, for closed forms of beams."""

from __future__ import annotations

import numpy as np

from forest_addon.growth.skeleton import Skeleton


def rod(
    foot: float, tip: float, height: float = 20.0, count: int = 40, lean: float = 0.0
) -> Skeleton:
    """``count`` segments from the origin, of linear taper; lean : radians from the vertical to +X."""
    along = np.linspace(0.0, height, count + 1)
    way = np.array([np.sin(lean), 0.0, np.cos(lean)])
    points = along[:, None] * way
    radius = np.interp(along, [0.0, height], [foot, tip])
    return Skeleton(
        points[:-1],
        points[1:],
        np.column_stack([radius[:-1], radius[1:]]),
        np.arange(count) - 1,
        np.zeros(count, np.int64),
        np.arange(count),
    )
