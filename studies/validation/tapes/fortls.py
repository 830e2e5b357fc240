"""Diameters as FORTLS finds them in one terrestrial scan, restated from the algorithm of its first release
(Molina-Valero et al. 2022, Environ. Model. Softw. 150, 105337).

Of a slice 10 cm thick, cells two steps of the scanner wide are kept that hold more points than the mean
cell, and of these the columns, one step wide, of more than one point. The centre is that crossing of a grid
of 1 cm from which distances vary least; the radius is their mean. Diameters of three slices, brought to
breast height by one taper, are averaged. The cells take the limbs away, where the surface is seen at a slant,
so that the arc that is left is shorter than the half that was seen. Left out is its first filter, of places
that are rough within 5 cm: it took no point of ours.
"""

from __future__ import annotations

import numpy as np

from forest_addon.base.vectors import azimuth_of

BREAST, SECTIONS, HALF = 1.3, (1.0, 1.3, 1.6), 0.05  # m: heights of slices, half of their thickness
GRID, WIDER = 0.01, 1.5  # m; the grid's half over half of what the points span
MOST_SPREAD = 0.1  # of the radius, of distances from the centre
REGULAR = 0.995  # correlation of azimuths with their order, of an arc that is partly hidden
AT_ONCE = 200  # crossings of the grid


def sections_of(points: np.ndarray, eye: float, step: float) -> np.ndarray:
    """(K, 2) height and diameter, m, of the slices of a stem that pass as circles.

    points : (P, 3) of one stem, m, from a scanner at (0, 0, ``eye``), the ground at z = 0. step : of the
    scanner, radians.
    """
    found = []
    for height in SECTIONS:
        cut = points[np.abs(points[:, 2] - height) < HALF]
        diameter = _diameter(cut, eye, step) if len(cut) else None
        if diameter is not None:
            found.append((height, diameter))
    return np.array(found).reshape(-1, 2)


def taper_of(stems: list[np.ndarray]) -> float:
    """Change of the diameter with height, m/m, of all stems' slices by one line of least squares."""
    height, diameter = np.concatenate(stems).T
    return float(np.polyfit(height, diameter, 1)[0]) if len(np.unique(height)) > 1 else 0.0


def breast_diameter(sections: np.ndarray, taper: float) -> float:
    """Mean diameter, m, of slices (K, 2) brought to breast height; NaN of none."""
    if not len(sections):
        return np.nan
    return float(np.mean(sections[:, 1] + taper * (BREAST - sections[:, 0])))


def _diameter(cut: np.ndarray, eye: float, step: float) -> float | None:
    away = float(np.linalg.norm(cut - [0.0, 0.0, eye], axis=1).mean())
    full = 2 * HALF / (step * away)  # points of a column that is seen whole
    if len(cut) < full:
        return None
    xy = cut[:, :2]
    middle, half = (xy.min(axis=0) + xy.max(axis=0)) / 2, WIDER * np.ptp(xy, axis=0).max() / 2
    xy = xy[_crowded(_cells(xy, middle - half, 2 * step * away))]
    turn = np.arctan2(*middle[::-1])
    azimuth = (azimuth_of(xy) - turn + np.pi) % (2 * np.pi) - np.pi
    many = _counts(_cells(azimuth[:, None], azimuth[:, None].min(), step))
    if many.max() < np.floor(full) or not (many > 1).any():
        return None
    xy, azimuth = xy[many > 1], azimuth[many > 1]
    centre, distance = _centre(xy, middle, half)
    radius, range_ = float(distance.mean()), np.hypot(*xy.T)
    if distance.std(ddof=1) > MOST_SPREAD * radius or np.quantile(range_, 0.05) > np.hypot(*centre):
        return None
    if np.quantile(distance, 0.05) < radius / 2:
        return None
    spread = float(np.ptp(azimuth)) > 0
    regular = spread and np.corrcoef(np.arange(len(azimuth)), np.sort(azimuth))[0, 1] > REGULAR
    return 2 * radius if regular or _ends_behind(azimuth, range_, step) else None


def _cells(place: np.ndarray, low: np.ndarray | float, size: float) -> np.ndarray:
    """(P, K) numbers of the cells, the first about ``low``, that hold places (P, K)."""
    return np.asarray(np.ceil((place - low) / size - 0.5).astype(np.int64))


def _counts(cell: np.ndarray) -> np.ndarray:
    """(P,) points in the cell of each."""
    _, which, many = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(many[which.ravel()])


def _crowded(cell: np.ndarray) -> np.ndarray:
    """(P,) points in cells of more points than the mean of all that hold any; all where none has more."""
    many = _counts(cell)
    more = many > len(many) / np.sum(1 / many)
    return np.asarray(more if more.any() else np.ones(len(many), dtype=bool))


def _centre(xy: np.ndarray, middle: np.ndarray, half: float) -> tuple[np.ndarray, np.ndarray]:
    """Crossing (2,) of the grid from which distances (P,) of points (P, 2) vary least, and these."""
    axes = [np.arange(m - half, m + half + 1e-9, GRID) for m in middle]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    variance = np.concatenate(
        [
            np.hypot(xy[:, 0] - some[:, :1], xy[:, 1] - some[:, 1:]).var(axis=1)
            for some in np.split(grid, range(AT_ONCE, len(grid), AT_ONCE))
        ]
    )
    best = grid[int(variance.argmin())]
    return best, np.hypot(*(xy - best).T)


def _ends_behind(azimuth: np.ndarray, range_: np.ndarray, step: float) -> bool:
    """Return whether both ends of an arc are farther from the scanner than its middle."""
    low, high = np.quantile(azimuth, (0.01, 0.99))
    middle = (azimuth.min() + azimuth.max()) / 2
    near = np.abs(azimuth - middle) <= step
    if not near.any():
        return False
    front = range_[near].mean()
    return bool(range_[azimuth <= low].mean() > front and range_[azimuth >= high].mean() > front)
