"""Stems of a cloud and the circles that fit them: upright clusters from 1 to 3 m, six heights, two must
agree."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from forest_addon.base.rng import stream

from ..stems import taubin

SLICES = (1.0, 1.3, 1.6, 1.9, 2.2, 2.5)  # m, where circles are fitted
LOW, HIGH = 1.0, 3.0  # m
CELL, LAYERS, FILLED = 0.05, 20, 7  # m; layers of a cell, and how many of them a stem has points in
HANG = 1.5  # cells between two of one stem
SECTORS = 24
RADII = (0.03, 0.5)  # m


def circle(xy: np.ndarray) -> np.ndarray | None:
    """x, y, radius, arc (share of 24 sectors), residual (m), share of points on it, share well inside it.

    None where too few points are on a circle of a stem's size. RANSAC, then least squares with soft L1.
    """
    rng, most, on = stream(0, "circle"), 0, None
    for _ in range(200):
        centre, radius = taubin(xy[rng.choice(len(xy), 3, replace=False)])
        if RADII[0] < radius < RADII[1]:
            away = np.abs(np.linalg.norm(xy - centre, axis=1) - radius)
            if (away < 0.015).sum() > most:
                most, on = int((away < 0.015).sum()), away < 0.03
    if on is None or on.sum() < 12:
        return None
    some = xy[on]
    centre, radius = taubin(some)

    def misfit(q: np.ndarray) -> np.ndarray:
        return np.asarray(np.hypot(some[:, 0] - q[0], some[:, 1] - q[1]) - q[2])

    x, y, r = least_squares(misfit, [*centre, radius], loss="soft_l1", f_scale=0.01).x
    angle = np.arctan2(some[:, 1] - y, some[:, 0] - x)
    arc = len(np.unique(((angle + np.pi) / (2 * np.pi) * SECTORS).astype(int))) / SECTORS
    inside = (np.hypot(xy[:, 0] - x, xy[:, 1] - y) < 0.6 * r).mean()
    return np.array([x, y, abs(r), arc, np.std(misfit(np.array([x, y, r]))), on.mean(), inside])


def stems_of(place: np.ndarray, height: np.ndarray) -> np.ndarray:
    """(S, 5) x, y, radius, arc and residual of the stems of points (N, 3) at heights (N,) over ground."""
    band = (height > LOW) & (height < HIGH)
    p, h = place[band], height[band]
    cell, which = np.unique(np.floor(p[:, :2] / CELL).astype(int), axis=0, return_inverse=True)
    filled = np.zeros((len(cell), LAYERS), bool)
    layer = ((h - LOW) / (HIGH - LOW) * LAYERS).astype(int)
    filled[which.ravel(), np.clip(layer, 0, LAYERS - 1)] = True
    cell = cell[filled.sum(axis=1) >= FILLED]
    if not len(cell):
        return np.zeros((0, 5))
    pairs = cKDTree(cell).query_pairs(HANG, output_type="ndarray")
    joined = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(cell),) * 2)
    label = connected_components(joined, directed=False)[1]
    found = []
    for group in range(label.max() + 1):
        stem = _stem(p, h, cell[label == group] * CELL + CELL / 2)
        if stem is not None:
            found.append(stem)
    kept: list[np.ndarray] = []
    for stem in sorted(found, key=lambda stem: -stem[5]):
        if all(np.hypot(*(stem[:2] - other[:2])) > 0.3 for other in kept):
            kept.append(stem)
    return np.array([stem[:5] for stem in kept]).reshape(-1, 5)


def _stem(p: np.ndarray, h: np.ndarray, cells: np.ndarray) -> np.ndarray | None:
    """x, y, radius, arc, residual, number of slices of a cluster; None where fewer than two agree."""
    reach = max(0.35, float(np.ptp(cells, axis=0).max()) / 2 + 0.15)
    near = np.hypot(*(p[:, :2] - cells.mean(axis=0)).T) < reach
    fits = []
    for z in SLICES:
        some = near & (np.abs(h - z) < 0.15)
        fit = circle(p[some, :2]) if some.sum() >= 15 else None
        if fit is not None and fit[3] >= 0.3 and fit[4] < 0.02 and fit[5] > 0.4 and fit[6] < 0.25:
            fits.append(fit)
    if len(fits) < 2:
        return None
    fitted = np.array(fits)
    middle = np.median(fitted[:, 2])
    fitted = fitted[np.abs(fitted[:, 2] - middle) < 0.35 * middle + 0.01]
    if len(fitted) < 2:
        return None
    whole = [*np.median(fitted[:, :3], axis=0), *fitted[:, 3:5].mean(axis=0), len(fitted)]
    return np.array(whole)
