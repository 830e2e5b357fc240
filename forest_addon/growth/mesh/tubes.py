"""A polyline with radii to a closed tube of triangles.

Rings follow the line by parallel transport, so that nothing twists. A ring of n corners is widened by
π/(n·sin(π/n)): its perimeter, and so its mean silhouette, is then the circle's, where an inscribed
8-gon would be 2.6 % too thin. n is chosen so that the polygon departs from the circle by at most a
tolerance.
"""

from __future__ import annotations

import numpy as np


def sides_for(radius: float, tolerance: float) -> int:
    """Corners of a ring that stays within ``tolerance`` metres of a circle of ``radius`` metres."""
    return int(np.clip(np.ceil(np.pi / np.arccos(1 - min(tolerance / radius, 0.9))), 3, 64))


def tube(points: np.ndarray, radius: np.ndarray, sides: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (P·sides + 2, 3) and triangles (T, 3) of a tube with closed ends, facing outwards.

    points : (P, 3) the axis, P >= 2, no two neighbours equal.
    radius : (P,) metres.
    """
    count = len(points)
    step = np.diff(points, axis=0)
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    between = step[:-1] + step[1:]
    sharp = np.linalg.norm(between, axis=1) < 1e-6  # the line turns back on itself: keep its way
    between[sharp] = step[:-1][sharp]
    tangent = np.concatenate([step[:1], between, step[-1:]])
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)

    around = np.empty((count, 3))
    around[0] = _across(tangent[0])
    for ring in range(1, count):  # parallel transport: keep the last direction, made normal again
        kept = around[ring - 1] - around[ring - 1] @ tangent[ring] * tangent[ring]
        size = np.linalg.norm(kept)
        around[ring] = kept / size if size > 1e-9 else _across(tangent[ring])
    across = np.cross(tangent, around)

    angle = 2 * np.pi * np.arange(sides) / sides
    widened = radius * np.pi / (sides * np.sin(np.pi / sides))
    ring_points = points[:, None] + widened[:, None, None] * (
        np.cos(angle)[:, None] * around[:, None] + np.sin(angle)[:, None] * across[:, None]
    )
    vertices = np.concatenate([ring_points.reshape(-1, 3), points[:1], points[-1:]])

    corner = np.arange(sides)
    following = (corner + 1) % sides
    low = (np.arange(count - 1) * sides)[:, None]
    a, b, c, d = low + corner, low + following, low + sides + following, low + sides + corner
    walls = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2).reshape(-1, 3)
    foot, tip = count * sides, count * sides + 1
    last = (count - 1) * sides
    caps = [
        np.stack([np.full(sides, foot), following, corner], axis=1),
        np.stack([np.full(sides, tip), last + corner, last + following], axis=1),
    ]
    return vertices, np.concatenate([walls, *caps]).astype(np.int32)


def _across(direction: np.ndarray) -> np.ndarray:
    """A unit vector at right angles to a unit direction."""
    normal = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    unit: np.ndarray = normal / np.linalg.norm(normal)
    return unit
