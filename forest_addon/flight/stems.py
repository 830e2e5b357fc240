"""A plane forest without Blender: endless upright trunks, met by rays in closed form.

A ray that is level meets a trunk of radius R at the first root of |p + td| = R. All rays of one origin are
held against the trunks within reach of it, in float64.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ..sensing.rays.caster import Hits, unit_columns
from ..sensing.rays.geometry import SceneGeometry
from ..stand.wind.field import WindField
from .obstacles import StemObstacles


class StemCaster:
    """Closest hits of trunks at places (N, 2) with radii (N,); see ``sensing.rays.RayCaster``."""

    engine = "stems"

    def __init__(self, position: np.ndarray, radius: np.ndarray) -> None:
        self.position, self.radius = position, radius
        self._thickest = float(radius.max(initial=0.0))
        self._tree = cKDTree(position) if len(position) else None

    def cast(
        self, origins: np.ndarray, directions: np.ndarray, max_distance: float = np.inf
    ) -> Hits:
        """The nearest trunk of each ray; of rays that follow each other from one origin, together."""
        hits = Hits.misses(len(origins))
        if self._tree is None or not len(origins):
            return hits
        way = unit_columns(np.asarray(directions).T)[:2]
        starts = np.flatnonzero(np.append(True, (np.diff(origins, axis=0) != 0).any(axis=1)))
        reach = max_distance + self._thickest
        near = self._tree.query_ball_point(origins[starts, :2], reach)
        for first, last, rows in zip(
            starts, np.append(starts[1:], len(origins)), near, strict=True
        ):
            if not rows:
                continue
            away = origins[first, :2] - self.position[rows]
            c = away[:, 0] ** 2 + away[:, 1] ** 2 - self.radius[rows] ** 2
            d = way[:, first:last]
            a = d[0] ** 2 + d[1] ** 2
            b = np.outer(d[0], away[:, 0]) + np.outer(d[1], away[:, 1])
            with np.errstate(invalid="ignore", divide="ignore"):
                share = c / (np.sqrt(b * b - a[:, None] * c) - b)
            share = np.where((b < 0) & (share >= 0), share, np.inf)
            found = share.argmin(axis=1)
            nearest = share[np.arange(last - first), found]
            met = nearest <= max_distance
            hits.distance[first:last][met] = nearest[met]
            hits.instance[first:last][met] = np.asarray(rows)[found[met]]
            hits.triangle[first:last][met] = 0
        return hits


class StemWorld:
    """A forest of trunks that ``simulation.Flyers`` fly in.

    low, high : (2,) of the field, metres. gusts : the wind that carries flyers, None where there is none.
    """

    def __init__(
        self, position: np.ndarray, radius: np.ndarray, low: np.ndarray, high: np.ndarray
    ) -> None:
        self.field = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        self.gusts: WindField | None = None
        self.caster = StemCaster(position, radius)
        self.obstacles = StemObstacles(position, radius)
        none = np.empty(0, dtype=np.int64)
        self.geometry = SceneGeometry((), np.empty((0, 3, 4)), none, (), none, none)

    def ground(self, place: np.ndarray) -> np.ndarray:
        """(N,) height 0."""
        return np.zeros(len(place))
