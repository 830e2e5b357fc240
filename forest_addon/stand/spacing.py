"""Hard cores: no two trees nearer than a distance (Matérn II)."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree


def matern_ii(points: np.ndarray, mark: np.ndarray, distance: float) -> np.ndarray:
    """(N,) bool, which points stay: those with no older point nearer than ``distance``.

    points : (N, 2) metres. mark : (N,) ages, smaller is older; ties count as older both ways.

    A point is judged by all others, kept or not, so the rule does not depend on any order
    (Matérn 1960, his second process).
    """
    keep = np.ones(len(points), dtype=bool)
    if distance <= 0 or len(points) < 2:
        return keep
    pairs = cKDTree(points).query_pairs(distance, output_type="ndarray")
    a, b = pairs.T
    near = np.linalg.norm(points[a] - points[b], axis=1) < distance
    a, b = a[near], b[near]
    keep[np.where(mark[a] < mark[b], b, a)] = False
    tied = mark[a] == mark[b]
    keep[b[tied]] = False
    return keep
