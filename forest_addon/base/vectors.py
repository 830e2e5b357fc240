"""Vectors row by row."""

from __future__ import annotations

import numpy as np

from .rows import lengths


def cross_rows(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross products (N, 3) of rows; several times as fast as ``numpy.cross``."""
    out = np.empty_like(a)
    out[:, 0] = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    out[:, 1] = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    out[:, 2] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return out


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) over their lengths; one without a length stays as it is."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, np.finfo(float).tiny))


def column(vectors: np.ndarray, number: int) -> np.ndarray:
    """A column (...) of vectors (..., N), in memory of its own.

    Functions of columns need it to give the same bits every time: numpy 1.26 computes them in one of two
    ways, by where the result happens to lie in memory, and the two differ in the last bit.
    """
    return np.ascontiguousarray(vectors[..., number])


def azimuth_of(ways: np.ndarray) -> np.ndarray:
    """Azimuths (...) of directions (..., 2 or 3), radians from +X towards +Y."""
    return np.asarray(np.arctan2(column(ways, 1), column(ways, 0)))


def zenith_of(ways: np.ndarray) -> np.ndarray:
    """Angles (...) of directions (..., 3) from +Z, radians."""
    return np.asarray(np.arctan2(np.hypot(ways[..., 0], ways[..., 1]), column(ways, 2)))


def elevation_of(ways: np.ndarray) -> np.ndarray:
    """Angles (...) of directions (..., 3) above the horizon, radians."""
    return np.asarray(np.arctan2(column(ways, 2), np.hypot(ways[..., 0], ways[..., 1])))


def nearest_on_triangles(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Places (N, 3) on triangles (N, 3, 3), one each, that are nearest to points (N, 3)."""
    normal = cross_rows(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    square = np.einsum("ni,ni->n", normal, normal)
    high = np.einsum("ni,ni->n", points - corners[:, 0], normal) / np.where(square > 0, square, 1.0)
    nearest = points - high[:, None] * normal
    inside = square > 0
    for k, n in enumerate((1, 2, 0)):
        turn = cross_rows(corners[:, n] - corners[:, k], nearest - corners[:, k])
        inside &= np.einsum("ni,ni->n", turn, normal) >= 0
    least = np.where(inside, 0.0, np.inf)  # within its triangle the place in the plane is nearest
    for k, n in enumerate((1, 2, 0)):
        edge, away = corners[:, n] - corners[:, k], points - corners[:, k]
        size = np.maximum(np.einsum("ni,ni->n", edge, edge), 1e-300)
        along = np.clip(np.einsum("ni,ni->n", away, edge) / size, 0.0, 1.0)
        gap = away - along[:, None] * edge
        distance = np.einsum("ni,ni->n", gap, gap)
        nearer = distance < least
        nearest[nearer] = (points - gap)[nearer]
        least = np.where(nearer, distance, least)
    return nearest


def beside_segments(
    points: np.ndarray, start: np.ndarray, way: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Shares (...) of segments from ``start`` (..., 3) along ``way`` (..., 3) next to points (..., 3), and
    from there to them (..., 3)."""
    offset = points - start
    square = np.maximum(np.einsum("...i,...i", way, way), 1e-18)
    share = np.clip(np.einsum("...i,...i", offset, way) / square, 0.0, 1.0)
    return share, offset - share[..., None] * way


def winding_number(point: np.ndarray, corners: np.ndarray) -> float:
    """Times that triangles (T, 3, 3) go round a point (3,): 1 inside a closed mesh, 0 outside.

    Solid angles by Van Oosterom & Strackee 1983.
    """
    a, b, c = (corners[:, k] - point for k in range(3))
    la, lb, lc = lengths(a), lengths(b), lengths(c)
    above = np.einsum("ti,ti->t", a, cross_rows(b, c))
    ab, bc, ca = (np.einsum("ti,ti->t", *pair) for pair in ((a, b), (b, c), (c, a)))
    below = la * lb * lc + ab * lc + bc * la + ca * lb
    return abs(float(np.arctan2(above, below).sum())) / (2 * np.pi)
