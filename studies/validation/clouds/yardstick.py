"""One yardstick for clouds of plots, measured or simulated: what stands in them, by the same rules."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial import cKDTree

from .circles import circle, stems_of

VOXEL, LOWEST, BRANCHY = (
    0.05,
    0.3,
    4.0,
)  # metres: edge of a voxel; heights between which stems are told
COLUMN, ABOVE = 0.2, 2.0  # metres: side of a column, and height from which on it is full or empty
STEP, TALLEST = 0.4, 12.0  # metres between circles up a stem, and up to where it is followed
ON_STEM = 0.03  # metres from a circle


@dataclass(frozen=True)
class PlotMeasures:
    """stems : (S, 5) x, y, radius, m, arc, residual, m. not_stem : share of the voxels from 0.3 to 4 m.
    empty : share of columns of 20 cm without a voxel above 2 m. profile : (60,) share of the voxels by
    metre.
    """

    stems: np.ndarray
    not_stem: float
    empty: float
    profile: np.ndarray


def measure_plot(points: np.ndarray) -> PlotMeasures:
    """Measure what stands in a cloud (N, 3) of a plot, metres."""
    points = points - points.min(axis=0)
    height = points[:, 2] - ground_below(points)
    found = stems_of(points, height)
    rows = voxels(points)
    p, h = points[rows], height[rows]
    low = (h > LOWEST) & (h < BRANCHY)
    on = _on_stems(p, h, found)
    side = np.maximum(np.floor(np.ptp(points[:, :2], axis=0) / COLUMN), 1)
    column = np.minimum(np.floor(p[h > ABOVE, :2] / COLUMN), side - 1)
    return PlotMeasures(
        found,
        float((low & ~on).sum() / max(low.sum(), 1)),
        float(1 - len(np.unique(column, axis=0)) / side.prod()),
        _profile(h),
    )


def profile(points: np.ndarray, floor: float | np.ndarray = 0.0) -> np.ndarray:
    """(60,) share of the occupied voxels above 0.3 m in each metre of height."""
    return _profile((points[:, 2] - floor)[voxels(points)])


def voxels(points: np.ndarray) -> np.ndarray:
    """The first point of each occupied voxel, by number."""
    return np.unique(np.floor(points / VOXEL).astype(np.int64), axis=0, return_index=True)[1]


def ground_below(points: np.ndarray) -> np.ndarray:
    """(P,) height of the ground below points: the 1st percentile in cells of 1 m, the median of nine."""
    cell = np.floor(points[:, :2] - points[:, :2].min(axis=0)).astype(int)
    low = np.full(cell.max(axis=0) + 1, np.nan)
    key = cell[:, 0] * low.shape[1] + cell[:, 1]
    order = np.argsort(key, kind="stable")
    keys, first = np.unique(key[order], return_index=True)
    for number, part in zip(keys, np.split(points[order, 2], first[1:]), strict=True):
        low.ravel()[number] = np.percentile(part, 1)
    low = np.where(np.isnan(low), np.nanmedian(low), low)
    return np.asarray(median_filter(low, size=3)[tuple(cell.T)])


def _profile(height: np.ndarray) -> np.ndarray:
    count = np.histogram(height[height > LOWEST], np.arange(61.0))[0]
    return np.asarray(count / max(count.sum(), 1))


def _on_stems(points: np.ndarray, height: np.ndarray, found: np.ndarray) -> np.ndarray:
    """(N,) whether a point lies within 3 cm of a circle that was followed up or down its stem."""
    mark, tree = np.zeros(len(points), dtype=bool), cKDTree(points[:, :2])
    for x0, y0, r0 in found[:, :3]:
        for step in (STEP, -STEP):
            x, y, r, missed, z = x0, y0, r0, 0, 1.3 if step > 0 else 0.9
            while LOWEST < z < TALLEST and missed < 2:
                some = np.array(tree.query_ball_point([x, y], r + 0.12), dtype=int)
                some = some[np.abs(height[some] - z) < 0.2]
                fit = circle(points[some, :2]) if len(some) >= 15 else None
                if fit is not None and _goes_on(fit, x, y, r0):
                    away = np.hypot(*(points[some, :2] - fit[:2]).T) - fit[2]
                    mark[some[np.abs(away) < ON_STEM]] = True
                    x, y, r, missed = fit[0], fit[1], (r + fit[2]) / 2, 0
                else:
                    missed += 1
                z += step
    return mark


def _goes_on(fit: np.ndarray, x: float, y: float, radius: float) -> bool:
    """Return whether a circle is the same stem's, a little farther along it."""
    near = np.hypot(fit[0] - x, fit[1] - y) < 0.08
    return bool(near and 0.6 * radius < fit[2] < 1.35 * radius and fit[3] > 0.25)
