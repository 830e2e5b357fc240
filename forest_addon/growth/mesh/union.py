"""Volume of the union of closed pieces of a mesh that reach into each other, as grafted branches do.

Upright lines on a grid cross the mesh; a running sum of the signs of their crossings is the winding number,
so the length of a line within any piece, and that within each piece added up, follow. Their ratio times the
volume by the divergence theorem, which counts what is shared twice, is the union's; errors of the grid are
alike in both and cancel. Lines through a piece that is not closed say nothing and are left out.
"""

from __future__ import annotations

import numpy as np

from ...base.rng import stream

TESTS = 600_000  # of a triangle against a line, about


def shared_once(corners: np.ndarray) -> float:
    """Volume of the union over that of all pieces added up, 0 to 1, of triangles (T, 3, 3) facing outwards.

    1 where no line says anything.
    """
    low, high = corners[:, :, :2].min(axis=1), corners[:, :, :2].max(axis=1)
    wide = np.maximum(high - low, 1e-9)
    cell = _cell(wide)
    shift = stream(0, "union").random(2) * cell  # not along anything that was modelled
    first = np.ceil((low - shift) / cell).astype(np.int64)
    count = np.maximum(np.floor((high - shift) / cell).astype(np.int64) - first + 1, 0)
    each = count.prod(axis=1)
    triangle = np.repeat(np.arange(len(each)), each)
    place = np.arange(len(triangle)) - np.repeat(np.cumsum(each) - each, each)
    column = first[triangle] + np.stack(
        [place // count[triangle, 1], place % count[triangle, 1]], axis=1
    )
    height, sign, hit = _crossings(corners[triangle], column * cell + shift)
    return _ratio(column[hit], height[hit], sign[hit])


def _cell(wide: np.ndarray) -> float:
    """Distance of lines with which about ``TESTS`` of triangles of these widths (T, 2) are made."""
    a, b = float(wide.prod(axis=1).sum()), float(wide.sum())
    return max((b + np.sqrt(b * b + 4 * TESTS * a)) / (2 * TESTS), 1e-6)


def _crossings(corners: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Height and sign (M,) of upright lines through (M, 2) with triangles (M, 3, 3); whether they meet."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    u, v, w = b - a, c - a, at - a[:, :2]
    twice = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    safe = np.where(twice == 0, 1.0, twice)
    p = (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / safe
    q = (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]) / safe
    hit = (twice != 0) & (p >= 0) & (q >= 0) & (p + q <= 1)
    return a[:, 2] + p * u[:, 2] + q * v[:, 2], -np.sign(twice), hit


def _ratio(column: np.ndarray, height: np.ndarray, sign: np.ndarray) -> float:
    """Length within any piece over that within each, of crossings (M,) by column (M, 2)."""
    order = np.lexsort((height, column[:, 1], column[:, 0]))
    column, height, sign = column[order], height[order], sign[order]
    new = np.ones(len(order), bool)
    new[1:] = (np.diff(column, axis=0) != 0).any(axis=1)
    line = np.cumsum(new) - 1
    total = np.bincount(line, sign) if len(line) else np.empty(0)
    level = np.cumsum(sign)
    level -= (level - sign)[new][line] if len(line) else 0.0  # from 0 in every line
    sound = (total == 0)[line] if len(line) else np.empty(0, bool)
    inside = np.append(np.diff(height), 0.0) * np.append(~new[1:], False) * sound
    deep = np.maximum(level, 0.0)
    added = float((inside * deep).sum())
    return float((inside * (deep > 0)).sum()) / added if added > 0 else 1.0
