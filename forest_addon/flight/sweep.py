"""First touch of a moving sphere: triangles and upright trunks, in closed form.

A sphere of radius r goes from p along w. Its centre first comes within r of a triangle on one of the
surfaces that bound all such places: the triangle's plane shifted by r, a cylinder of radius r around an
edge, a sphere around a corner. Each gives a root of at most the second degree in the share t of the way,
so nothing is stepped and nothing can be jumped over, however long the way is. An upright trunk is the
circle of it in the plane. All in float64; roots are taken as c/(√(b² - ac) - b), which loses no digits.
"""

from __future__ import annotations

import numpy as np

NEXT = (1, 2, 0)


def touches(start: np.ndarray, way: np.ndarray, radius: float, corners: np.ndarray) -> np.ndarray:
    """(T,) shares of ways at which spheres touch one triangle each of (T, 3, 3); ``inf``: never.

    start, way : (3,) or (T, 3).
    """
    start, way = (np.broadcast_to(v, (len(corners), 3)) for v in (start, way))
    share = _faces(start, way, radius, corners)
    for k, n in enumerate(NEXT):
        np.minimum(share, _edges(start, way, radius, corners[:, k], corners[:, n]), out=share)
        np.minimum(share, _spheres(start, way, radius, corners[:, k]), out=share)
    share[distances(start, corners) <= radius] = 0.0
    return share


def distances(point: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(T,) metres from a point (3,), or (T, 3) one each, to triangles (T, 3, 3)."""
    nearest = np.full(len(corners), np.inf)
    for k, n in enumerate(NEXT):
        edge = corners[:, n] - corners[:, k]
        away = point - corners[:, k]
        along = np.einsum("ti,ti->t", away, edge) / np.maximum(
            np.einsum("ti,ti->t", edge, edge), 1e-300
        )
        away -= np.clip(along, 0.0, 1.0)[:, None] * edge
        np.minimum(nearest, np.sqrt(np.einsum("ti,ti->t", away, away)), out=nearest)
    normal, length = _normals(corners)
    high = np.einsum("ti,ti->t", point - corners[:, 0], normal)
    foot = point - high[:, None] * normal
    inside = _inside(foot, corners, normal) & (length > 0)
    nearest[inside] = np.abs(high[inside])
    return nearest


def first_trunk(
    start: np.ndarray, way: np.ndarray, reach: np.ndarray, centre: np.ndarray
) -> np.ndarray:
    """(M,) shares of ways (M, 2) from (M, 2) at which points come within ``reach`` (M, K) of centres
    (M, K, 2) first; 0 where they are, ``inf`` where they never come.
    """
    away = start[:, None] - centre
    c = away[..., 0] ** 2 + away[..., 1] ** 2 - reach**2
    b = away[..., 0] * way[:, None, 0] + away[..., 1] * way[:, None, 1]
    a = way[:, 0] ** 2 + way[:, 1] ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        root = b * b - a[:, None] * c
        share = c / (np.sqrt(root) - b)
    share = np.where((root >= 0) & (b < 0) & (share <= 1.0), share, np.inf)
    return np.where(c <= 0, 0.0, share).min(axis=1, initial=np.inf)


def _faces(start: np.ndarray, way: np.ndarray, radius: float, corners: np.ndarray) -> np.ndarray:
    """Return where spheres touch the insides of triangles."""
    normal, length = _normals(corners)
    high = np.einsum("ti,ti->t", start - corners[:, 0], normal)
    side = np.sign(high)
    towards = side * np.einsum("ti,ti->t", way, normal)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = (np.abs(high) - radius) / -towards
        met = (share >= 0) & (share <= 1) & (towards < 0) & (length > 0)
    share[~met] = np.inf
    rows = met.nonzero()[0]
    if len(rows):
        n, some = normal[rows], share[rows, None]
        foot = start[rows] + some * way[rows] - radius * side[rows, None] * n
        share[rows[~_inside(foot, corners[rows], n)]] = np.inf
    return share


def _edges(
    start: np.ndarray, way: np.ndarray, radius: float, one: np.ndarray, other: np.ndarray
) -> np.ndarray:
    """Return where spheres touch edges (T, 3), (T, 3) between their ends: at right angles to each, a
    circle."""
    edge = other - one
    square = np.einsum("ti,ti->t", edge, edge)
    away = start - one
    size = np.maximum(square, 1e-300)
    away_along, way_along = (
        np.einsum("ti,ti->t", away, edge) / size,
        np.einsum("ti,ti->t", edge, way) / size,
    )
    away = away - away_along[:, None] * edge
    across = way - way_along[:, None] * edge
    a = np.einsum("ti,ti->t", across, across)
    b = np.einsum("ti,ti->t", away, across)
    c = np.einsum("ti,ti->t", away, away) - radius**2
    with np.errstate(invalid="ignore", divide="ignore"):
        root = b * b - a * c
        share = c / (np.sqrt(root) - b)
        along = away_along + share * way_along
        met = (root >= 0) & (b < 0) & (c > 0) & (share <= 1) & (along >= 0) & (along <= 1)
    return np.where(met & (square > 0), share, np.inf)


def _spheres(start: np.ndarray, way: np.ndarray, radius: float, point: np.ndarray) -> np.ndarray:
    away = start - point
    a = np.einsum("ti,ti->t", way, way)
    b = np.einsum("ti,ti->t", away, way)
    c = np.einsum("ti,ti->t", away, away) - radius**2
    with np.errstate(invalid="ignore", divide="ignore"):
        root = b * b - a * c
        share = c / (np.sqrt(root) - b)
        met = (root >= 0) & (b < 0) & (c > 0) & (share <= 1)
    return np.where(met, share, np.inf)


def _normals(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(T, 3) unit normals, 0 where a triangle has no area, and (T,) twice the areas."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.sqrt(np.einsum("ti,ti->t", normal, normal))
    return normal / np.where(length > 0, length, 1.0)[:, None], length


def _inside(foot: np.ndarray, corners: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(T,) whether places (T, 3) in the planes of triangles lie within them."""
    inside = np.ones(len(corners), dtype=bool)
    for k, n in enumerate(NEXT):
        turn = np.cross(corners[:, n] - corners[:, k], foot - corners[:, k])
        inside &= np.einsum("ti,ti->t", turn, normal) >= 0
    return inside
