"""Edges of tubes and of leaves, known from how they are made.

Blender needs each edge once and the edge of every corner of every triangle. It can find them itself, but
that takes longer than everything else about a mesh; whoever makes triangles in patterns knows them.
"""

from __future__ import annotations

import numpy as np

from ...base.trimesh import Edges


def tube_edges(
    n: int, vertex: int, edge: int, wall: np.ndarray, feet: np.ndarray, tips: np.ndarray, rings: int
) -> Edges:
    """Edges of a group of tubes with rings of n corners, their triangles in the order of ``meshing``.

    vertex, edge : the first of the group.
    wall : (W,) rings with a wall above, counted within the group.
    feet, tips : (A,) first and last ring of each tube.

    Every ring has 3n edges: those around it, and the upright and the slanted ones of the wall above.
    Above a last ring there is no wall: there the spokes of the tip and of the foot take their place.
    """
    corner = np.arange(n, dtype=np.int32)
    following = (corner + 1) % n
    count = len(feet)
    around, upright, slanted = corner, n + corner, 2 * n + corner

    pattern = np.concatenate(
        [
            np.stack([corner, following], axis=1),
            np.stack([corner, n + corner], axis=1),
            np.stack([corner, n + following], axis=1),
        ]
    )  # (3n, 2)
    ends = pattern + (vertex + n * np.arange(rings, dtype=np.int32))[:, None, None]
    middle = (vertex + n * rings + np.arange(count, dtype=np.int32))[:, None]
    ends[tips, n : 2 * n, 1] = middle + count
    ends[tips, 2 * n :, 0] = middle
    ends[tips, 2 * n :, 1] = (vertex + n * feet.astype(np.int32))[:, None] + corner

    pattern = np.stack(
        [around, upright[following], slanted, slanted, 3 * n + around, upright], axis=1
    ).reshape(-1)  # (6n,)
    of_corner = np.empty((2 * n * (len(wall) + count), 3), dtype=np.int32)
    below = (edge + 3 * n * wall).astype(np.int32)
    np.add(below[:, None], pattern, out=of_corner[: 2 * n * len(wall)].reshape(-1, 6 * n))
    fans = of_corner[2 * n * len(wall) :].reshape(2, count, 3 * n)
    first = (edge + 3 * n * feet).astype(np.int32)[:, None]
    last = (edge + 3 * n * tips).astype(np.int32)[:, None]
    np.add(last, np.repeat(upright, 3), out=fans[1])
    fans[1, :, 1::3], fans[1, :, 2::3] = last + around, last + upright[following]
    np.add(last, np.repeat(slanted, 3), out=fans[0])
    fans[0, :, 0::3], fans[0, :, 1::3] = last + slanted[following], first + around
    return Edges(ends.reshape(-1, 2), of_corner)


def repeated_edges(
    triangles: np.ndarray, corners: int, times: int, first: Edges | None = None, vertex: int = 0
) -> Edges:
    """Edges of a shape (F, 3) with so many corners that is there so many times, one after the other.

    first : edges that come before them, of ``vertex`` vertices.
    """
    ahead = np.stack([triangles, triangles[:, [1, 2, 0]]], axis=2).reshape(-1, 2)  # (3F, 2)
    low, high = ahead.min(axis=1).astype(np.int64), ahead.max(axis=1)
    base = int(high.max(initial=0)) + 1
    keys, index = np.unique(low * base + high, return_inverse=True)  # quicker than unique rows
    ends = np.stack(np.divmod(keys, base), axis=1).reshape(-1).astype(np.int32)
    before = np.empty((0, 2), np.int32) if first is None else first.ends
    turns = np.empty((0, 3), np.int32) if first is None else first.of_corner
    copy = np.arange(times, dtype=np.int32)[:, None]
    return Edges(
        _behind(before, ends, vertex + corners * copy),
        _behind(turns, index.reshape(-1).astype(np.int32), len(before) + len(keys) * copy),
    )


def _behind(first: np.ndarray, pattern: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Rows (N, C), and behind them a flat pattern of such rows once for each shift (L, 1)."""
    wide = first.shape[1]
    out = np.empty((len(first) + len(shift) * len(pattern) // wide, wide), dtype=np.int32)
    out[: len(first)] = first
    np.add(pattern, shift, out=out[len(first) :].reshape(len(shift), len(pattern)))
    return out
