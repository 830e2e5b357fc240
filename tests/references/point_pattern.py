"""Kernel estimates and K functions as their formulas say, one pair at a time, on a rectangle.

Plain Python and the error function; nothing is shared with the product. Time grows with the square of the
number of points.
"""

import math
from collections.abc import Sequence

Point = Sequence[float]


def kernel_direct(
    at: Point, points: Sequence[Point], low: Point, high: Point, sigma: float, *, skip: bool = False
) -> float:
    """λ at a place, Σ κ(at - x)/e(x) (Jones 1993); ``skip`` leaves out points that stand there."""
    total = 0.0
    for point in points:
        if skip and point[0] == at[0] and point[1] == at[1]:
            continue
        squared = (at[0] - point[0]) ** 2 + (at[1] - point[1]) ** 2
        edge = 1.0
        for k in range(2):
            right = math.erf((high[k] - point[k]) / sigma / math.sqrt(2))
            edge *= (right - math.erf((low[k] - point[k]) / sigma / math.sqrt(2))) / 2
        total += math.exp(-squared / 2 / sigma**2) / (2 * math.pi * sigma**2) / edge
    return total


def k_direct(
    points: Sequence[Point],
    intensity: Sequence[float],
    low: Point,
    high: Point,
    radius: Sequence[float],
) -> list[float]:
    """Inhomogeneous K with translation correction (Baddeley, Møller & Waagepetersen 2000)."""
    width, height = high[0] - low[0], high[1] - low[1]
    found = []
    for reach in radius:
        total = 0.0
        for i, (x, y) in enumerate(points):
            for j, (u, v) in enumerate(points):
                if i != j and math.hypot(u - x, v - y) <= reach:
                    overlap = (width - abs(u - x)) * (height - abs(v - y))
                    total += 1 / (intensity[i] * intensity[j] * overlap)
        found.append(total)
    return found
