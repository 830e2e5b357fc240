"""Edges of tubes and of leaves, known from how they are made.

Blender needs each edge once and the edge of every corner of every triangle. It can find them itself, but
that takes longer than everything else about a mesh; whoever makes triangles in patterns knows them.
"""

from __future__ import annotations

import numpy as np

from .trimesh import Edges


def tube_edges(
    n: int, vertex: int, edge: int, wall: np.ndarray, feet: np.ndarray, tips: np.ndarray, rings: int
) -> Edges:
    """Edges of a group of tubes with rings of n corners, their triangles in the order of ``meshing``.

    vertex, edge : the first of the group.
    wall : (W,) rings with a wall above, counted within the group.
    feet, tips : (A,) first and last ring of each tube.
    """
    corner = np.arange(n, dtype=np.int32)
    following = (corner + 1) % n
    walls, count = len(wall), len(feet)
    upright = edge + n * rings
    slanted = upright + n * walls
    foot_spoke = slanted + n * walls
    tip_spoke = foot_spoke + n * count

    ends = np.empty((n * (rings + 2 * walls + 2 * count), 2), dtype=np.int32)
    spans = np.split(ends, np.array([upright, slanted, foot_spoke, tip_spoke]) - edge)
    ring = vertex + n * np.arange(rings, dtype=np.int32)[:, None]
    low = vertex + n * wall.astype(np.int32)[:, None]
    middle = vertex + n * rings + np.arange(count, dtype=np.int32)[:, None]
    first = vertex + n * feet.astype(np.int32)[:, None]
    last = vertex + n * tips.astype(np.int32)[:, None]
    for span, start, end in (
        (spans[0], ring + corner, ring + following),
        (spans[1], low + corner, low + n + corner),
        (spans[2], low + corner, low + n + following),
        (spans[3], middle + 0 * corner, first + corner),
        (spans[4], middle + count + 0 * corner, last + corner),
    ):
        span[:, 0], span[:, 1] = start.ravel(), end.ravel()

    of_corner = np.empty((2 * n * (walls + count), 3), dtype=np.int32)
    sides = of_corner[: 2 * n * walls].reshape(walls, n, 2, 3)
    here = n * np.arange(walls, dtype=np.int32)[:, None]
    below = edge + n * wall.astype(np.int32)[:, None]
    sides[:, :, 0, 0], sides[:, :, 0, 1] = below + corner, upright + here + following
    sides[:, :, 0, 2] = sides[:, :, 1, 0] = slanted + here + corner
    sides[:, :, 1, 1], sides[:, :, 1, 2] = below + n + corner, upright + here + corner
    own = n * np.arange(count, dtype=np.int32)[:, None]
    fans = of_corner[2 * n * walls :].reshape(2, count, n, 3)
    fans[0, :, :, 0], fans[0, :, :, 2] = foot_spoke + own + following, foot_spoke + own + corner
    fans[0, :, :, 1] = edge + n * feet.astype(np.int32)[:, None] + corner
    fans[1, :, :, 0], fans[1, :, :, 2] = tip_spoke + own + corner, tip_spoke + own + following
    fans[1, :, :, 1] = edge + n * tips.astype(np.int32)[:, None] + corner
    return Edges(ends, of_corner)


def repeated_edges(triangles: np.ndarray, corners: int, times: int) -> Edges:
    """Edges of a shape (F, 3) with so many corners that is there so many times, one after the other."""
    ahead = np.stack([triangles, triangles[:, [1, 2, 0]]], axis=2).reshape(-1, 2)  # (3F, 2)
    ends, index = np.unique(np.sort(ahead, axis=1), axis=0, return_inverse=True)
    copy = np.arange(times, dtype=np.int32)[:, None, None]
    return Edges(
        (ends.astype(np.int32) + corners * copy).reshape(-1, 2),
        (index.reshape(-1, 3).astype(np.int32) + len(ends) * copy).reshape(-1, 3),
    )
