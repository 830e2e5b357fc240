"""An engine's hits held against float64, ray by ray: which of the two is right.

Engines search in float32 and refine what they find. Where they part from float64, the ray may pass an edge so
closely that either is right: then a ray that is moved aside by ``EDGE`` finds what the engine found. Two
surfaces may lie so closely behind one another, as the front and the back beside an outer edge do, that
single precision does not tell which is first: then the distance to the triangle that the engine named counts.
And a chained ray may pass over what lies closely behind the surface that it leaves.
"""

from __future__ import annotations

import numpy as np

from .caster import Hits, RayCaster
from .exact import ExactCaster
from .geometry import SceneGeometry

EDGE = 2e-5  # m; engines search in float32, whose steps are so large 100 m away
SURE = 1e-10  # m; where an engine is off by more, it may have named another triangle
SAME = 1e-3  # m; nearer surfaces count as the same one when a ray is moved aside
BEHIND = 2e-4  # m behind a surface that is left, where an engine may be blind
TURNS = np.arange(8) * np.pi / 4


class Referee(RayCaster):
    """A ``RayCaster`` that asks an engine and float64: what the engine found where that is right, else what
    is there.

    scene : that is true; left out: the engine's own.
    """

    engine = "float64"

    def __init__(self, caster: RayCaster, scene: SceneGeometry | None = None) -> None:
        self.scene = caster.scene if scene is None else scene
        self._caster = caster
        self._exact = ExactCaster(self.scene)

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: float | np.ndarray = np.inf,
        *,
        min_distance: float | np.ndarray = 0.0,
        leaving: Hits | None = None,
    ) -> Hits:
        """The closest hit of each ray."""
        origins, directions = np.asarray(origins), np.asarray(directions)
        far = np.broadcast_to(np.asarray(max_distance, np.float64), len(origins))
        near = np.broadcast_to(np.asarray(min_distance, np.float64), len(origins))
        ours = self._caster.cast(
            origins, directions, max_distance, min_distance=min_distance, leaving=leaving
        )
        nothing = ~np.isfinite(ours.distance)
        if (nothing & ours.found).any():
            ours = Hits(ours.distance.copy(), ours.instance.copy(), ours.triangle.copy())
            ours.put(nothing, Hits.misses(int(nothing.sum())))
        limit = np.where(ours.found, np.minimum(ours.distance + SAME, far), far)
        exact = self._exact.cast(origins, directions, limit, min_distance=near, leaving=leaving)
        gone = np.flatnonzero(ours.found & ~exact.found)
        if len(gone):
            left = None if leaving is None else leaving.select(gone)
            again = self._exact.cast(
                origins[gone], directions[gone], far[gone], min_distance=near[gone], leaving=left
            )
            exact.put(gone, again)
        differ, distance = self._compare(origins, directions, ours, exact)
        wrong = np.flatnonzero(differ)
        other = np.flatnonzero(~_alike(ours.select(wrong), exact.select(wrong)))
        ask = wrong[other]
        excused = self._at_an_edge(origins[ask], directions[ask], ours.select(ask), far[ask])
        wrong = np.delete(wrong, other[excused])
        if leaving is not None and len(wrong):
            blind = self._exact.cast(
                origins[wrong], directions[wrong], far[wrong], min_distance=near[wrong] + BEHIND
            )
            wrong = wrong[~_alike(blind, ours.select(wrong))]
        right = Hits(distance, ours.instance.copy(), ours.triangle.copy())
        right.put(wrong, exact.select(wrong))
        return right

    def _compare(
        self, origins: np.ndarray, directions: np.ndarray, ours: Hits, exact: Hits
    ) -> tuple[np.ndarray, np.ndarray]:
        """(R,) bool: rays for which what the engine named is not there, or not the first; (R,) metres to
        what it named.
        """
        differ, distance = ours.found != exact.found, ours.distance.copy()
        both = np.flatnonzero(ours.found & exact.found)
        named = (ours.instance[both] == exact.instance[both]) & (
            ours.triangle[both] == exact.triangle[both]
        )
        apart = np.abs(ours.distance[both] - exact.distance[both])
        differ[both] = apart > SURE
        same = both[apart <= SURE]
        distance[same] = exact.distance[same]
        ask = both[~named & (apart <= EDGE)]
        if len(ask):
            there = self._exact.meets(origins[ask], directions[ask], ours.select(ask))
            right = np.abs(there - ours.distance[ask]) <= SURE
            differ[ask], distance[ask[right]] = ~right, there[right]
        return differ, distance

    def _at_an_edge(
        self, origins: np.ndarray, directions: np.ndarray, ours: Hits, far: np.ndarray
    ) -> np.ndarray:
        """(R,) bool: whether a ray that is moved aside a little finds, in float64, what the engine found."""
        if not len(origins):
            return np.zeros(0, dtype=bool)
        ways = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        across = np.cross(ways, np.eye(3)[np.abs(ways).argmin(axis=1)])
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        beside = np.cross(ways, across)
        aside = np.cos(TURNS)[:, None, None] * across + np.sin(TURNS)[:, None, None] * beside
        count = len(TURNS)
        moved = self._exact.cast(
            (origins + EDGE * aside).reshape(-1, 3), np.tile(ways, (count, 1)), np.tile(far, count)
        )
        ours = Hits(*(np.tile(value, count) for value in vars(ours).values()))
        found: np.ndarray = _alike(moved, ours).reshape(count, -1).any(axis=0)
        return found


def _alike(one: Hits, other: Hits) -> np.ndarray:
    """(R,) bool: both miss, or meet something at about the same distance."""
    with np.errstate(invalid="ignore"):
        near = np.abs(one.distance - other.distance) < SAME
    alike: np.ndarray = near | (~one.found & ~other.found)
    return alike
