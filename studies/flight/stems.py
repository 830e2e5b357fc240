"""A plane forest without Blender: endless upright trunks, which level rays and flyers meet in closed form.

A ray that is level meets a trunk of radius R at the first root of |p + td| = R; a flyer of radius r meets it
at that of R + r. All rays of one origin are held against the trunks within reach of it, in float64.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ..inside import FREE_ROOM, Hits, SceneGeometry, unit_columns


class PlaneTrunks:
    """Trunks at places (N, 2) with radii (N,): what rays meet (``RayCaster``), and what stops a flyer
    (``MeshObstacles``).
    """

    engine = "stems"
    moves = False

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
        way = unit_columns(np.asarray(directions).T)[:2].T
        starts = np.flatnonzero(np.append(True, (np.diff(origins, axis=0) != 0).any(axis=1)))
        reach = max_distance + self._thickest
        near = self._tree.query_ball_point(origins[starts, :2], reach)
        for first, last, rows in zip(
            starts, np.append(starts[1:], len(origins)), near, strict=True
        ):
            if not rows:
                continue
            away = origins[first, :2] - self.position[rows]
            share = _roots(away[None], way[first:last], self.radius[rows])
            found = share.argmin(axis=1)
            nearest = share[np.arange(last - first), found]
            met = nearest <= max_distance
            hits.distance[first:last][met] = nearest[met]
            hits.instance[first:last][met] = np.asarray(rows)[found[met]]
            hits.triangle[first:last][met] = 0
        return hits

    def at(self, _time: float) -> PlaneTrunks:
        """Return them as they stand at a time: always alike."""
        return self

    def room(self, place: np.ndarray) -> np.ndarray:
        """(N,) metres around places (N, 3) in which surely nothing stands."""
        if self._tree is None:
            return np.full(len(place), FREE_ROOM)
        nearest, _ = self._tree.query(place[:, :2])
        return np.clip(nearest - self._thickest, 0.0, FREE_ROOM)

    def touch(self, start: np.ndarray, end: np.ndarray, radius: float) -> np.ndarray:
        """(M,) shares of ways (M, 3) to (M, 3) at which spheres first touch; ``inf``: never."""
        share = np.full(len(start), np.inf)
        if self._tree is None:
            return share
        way = (end - start)[:, :2]
        reach = (np.hypot(*way.T) / 2 + radius + self._thickest) * (1 + 1e-9)
        near = self._tree.query_ball_point((start[:, :2] + end[:, :2]) / 2, reach)
        for row, rows in enumerate(near):
            if rows:
                away = start[row, :2] - self.position[rows]
                thick = self.radius[rows] + radius
                met = _roots(away[None], way[[row]], thick)[0]
                inside = np.hypot(*away.T) <= thick
                share[row] = np.where(inside, 0.0, np.where(met <= 1.0, met, np.inf)).min()
        return share

    def encloses(self, place: np.ndarray) -> bool:
        """Return whether a place (3,) is inside of a trunk."""
        return bool((np.hypot(*(self.position - place[:2]).T) < self.radius).any())


def _roots(away: np.ndarray, way: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """(M, K) shares of ways (M, 2) at which points come within ``reach`` (K,) of centres that they are away
    from, (1 or M, K, 2), first; ``inf``: never, or they are there.
    """
    c = away[..., 0] ** 2 + away[..., 1] ** 2 - reach**2
    b = away[..., 0] * way[:, None, 0] + away[..., 1] * way[:, None, 1]
    a = way[:, 0] ** 2 + way[:, 1] ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        share = c / (np.sqrt(b * b - a[:, None] * c) - b)
    return np.where((b < 0) & (share >= 0), share, np.inf)


class StemWorld:
    """A forest of trunks that flyers fly in.

    low, high : (2,) of the field, metres. gusts : the wind that carries flyers: there is none.
    """

    gusts = None

    def __init__(
        self, position: np.ndarray, radius: np.ndarray, low: np.ndarray, high: np.ndarray
    ) -> None:
        self.field = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        self.caster = self.obstacles = PlaneTrunks(position, radius)
        none = np.empty(0, dtype=np.int64)
        self.geometry = SceneGeometry((), np.empty((0, 3, 4)), none, (), none, none)

    def ground(self, place: np.ndarray) -> np.ndarray:
        """(N,) height 0."""
        return np.zeros(len(place))
