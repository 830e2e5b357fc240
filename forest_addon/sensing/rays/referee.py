"""An engine's hits held against float64, ray by ray: which of the two is right.

Engines search in float32 and refine what they find. Where they part from float64, the ray may pass an edge so
closely that either is right: then a ray that is moved aside by ``EDGE``, or ``STEPS`` of a float32 at the
scene's size, finds what the engine found; beside an edge between faces of one surface, the very triangle. Two
surfaces may lie so closely behind one another, as the front and the back beside an outer edge do, that
single precision does not tell which is first: then the distance to the triangle that the engine named counts.
And a chained ray may pass over what lies closely behind the surface that it leaves.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .caster import Hits, RayCaster
from .exact import ExactCaster
from .geometry import SceneGeometry

EDGE = 2e-5  # m; engines search in float32, whose steps are so large 100 m away
STEPS = 2  # of a float32 at half the size of the scene, from whose middle engines count
SURE = 1e-10  # m; where an engine is off by more, it may have named another triangle
SAME = 1e-3  # m; nearer surfaces count as the same one when a ray is moved aside
BEHIND = 2e-4  # m behind a surface that is left, where an engine may be blind
TURNS = np.arange(8) * np.pi / 4


class Referee(RayCaster):
    """A ``RayCaster`` that asks an engine and float64: what the engine found where that is right, else what
    is there.

    scene : that is true; left out: the engine's own. exact : what asks float64; left out: rays at the scene
    as it stands. Both are told the rays' times, where these have any.
    """

    engine = "float64"

    def __init__(
        self, caster: Any, scene: SceneGeometry | None = None, exact: Any | None = None
    ) -> None:
        self.scene = caster.scene if scene is None else scene
        self._caster = caster
        step = float(np.spacing(np.float32(_half_size(self.scene))))
        self._edge = max(EDGE, STEPS * step)
        self._exact: Any = ExactCaster(self.scene) if exact is None else exact

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: float | np.ndarray = np.inf,
        *,
        min_distance: float | np.ndarray = 0.0,
        leaving: Hits | None = None,
        time: np.ndarray | None = None,
    ) -> Hits:
        """The closest hit of each ray."""
        origins, directions = np.asarray(origins), np.asarray(directions)
        when = _Times(time)
        far = np.broadcast_to(np.asarray(max_distance, np.float64), len(origins))
        near = np.broadcast_to(np.asarray(min_distance, np.float64), len(origins))
        ours = self._caster.cast(
            origins,
            directions,
            max_distance,
            min_distance=min_distance,
            leaving=leaving,
            **when.of(),
        )
        ours = _without_nothing(ours)
        limit = np.where(ours.found, np.minimum(ours.distance + SAME, far), far)
        exact = self._exact.cast(
            origins, directions, limit, min_distance=near, leaving=leaving, **when.of()
        )
        gone = np.flatnonzero(ours.found & ~exact.found)
        if len(gone):
            left = None if leaving is None else leaving.select(gone)
            again = self._exact.cast(
                origins[gone],
                directions[gone],
                far[gone],
                min_distance=near[gone],
                leaving=left,
                **when.of(gone),
            )
            exact.put(gone, again)
        differ, distance = self._compare(origins, directions, ours, exact, when)
        wrong = np.flatnonzero(differ)
        named, there = ours.select(wrong), exact.select(wrong)
        alike = _alike(named, there)
        ask = ~alike | (named.instance != there.instance) | (named.triangle != there.triangle)
        rows = wrong[ask]
        rays = origins[rows], directions[rows], named.select(ask), far[rows], alike[ask]
        excused = self._at_an_edge(*rays, when.of(rows))
        wrong = np.delete(wrong, np.flatnonzero(ask)[excused])
        if leaving is not None and len(wrong):
            blind = self._exact.cast(
                origins[wrong],
                directions[wrong],
                far[wrong],
                min_distance=near[wrong] + BEHIND,
                **when.of(wrong),
            )
            wrong = wrong[~_alike(blind, ours.select(wrong))]
        right = Hits(distance, ours.instance.copy(), ours.triangle.copy())
        right.put(wrong, exact.select(wrong))
        return right

    def _compare(
        self, origins: np.ndarray, directions: np.ndarray, ours: Hits, exact: Hits, when: _Times
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
            there = self._exact.meets(
                origins[ask], directions[ask], ours.select(ask), **when.of(ask)
            )
            right = np.abs(there - ours.distance[ask]) <= SURE
            differ[ask], distance[ask[right]] = ~right, there[right]
        return differ, distance

    def _at_an_edge(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        ours: Hits,
        far: np.ndarray,
        by_name: np.ndarray,
        when: dict[str, np.ndarray],
    ) -> np.ndarray:
        """(R,) bool: whether a ray that is moved aside a little finds, in float64, what the engine found.

        by_name : (R,) bool, rays that must find the very triangle, as others lie where it does.
        """
        if not len(origins):
            return np.zeros(0, dtype=bool)
        ways = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        across = np.cross(ways, np.eye(3)[np.abs(ways).argmin(axis=1)])
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        beside = np.cross(ways, across)
        aside = np.cos(TURNS)[:, None, None] * across + np.sin(TURNS)[:, None, None] * beside
        count = len(TURNS)
        moved = self._exact.cast(
            (origins + self._edge * aside).reshape(-1, 3),
            np.tile(ways, (count, 1)),
            np.tile(far, count),
            **{name: np.tile(every, count) for name, every in when.items()},
        )
        ours = Hits(*(np.tile(value, count) for value in vars(ours).values()))
        found = _alike(moved, ours)
        found &= ~np.tile(by_name, count) | (
            (moved.instance == ours.instance) & (moved.triangle == ours.triangle)
        )
        return np.asarray(found.reshape(count, -1).any(axis=0))


def _half_size(scene: SceneGeometry) -> float:
    """Metres from the middle of a scene to its sides, at most."""
    low, high = scene.bounds()
    known = np.isfinite(low).all(axis=1) & np.isfinite(high).all(axis=1)
    if not known.any():
        return 0.0
    return float((high[known].max(axis=0) - low[known].min(axis=0)).max()) / 2


def _without_nothing(hits: Hits) -> Hits:
    """Hits, those at no finite distance taken away."""
    nothing = ~np.isfinite(hits.distance)
    if (nothing & hits.found).any():
        hits = Hits(hits.distance.copy(), hits.instance.copy(), hits.triangle.copy())
        hits.put(nothing, Hits.misses(int(nothing.sum())))
    return hits


class _Times:
    """Times of rays, where they have any, as what casters are given."""

    def __init__(self, time: np.ndarray | None) -> None:
        self._time = time

    def of(self, rows: np.ndarray | slice = slice(None)) -> dict[str, np.ndarray]:
        """Those of some rays."""
        return {} if self._time is None else {"time": self._time[rows]}


def _alike(one: Hits, other: Hits) -> np.ndarray:
    """(R,) bool: both miss, or meet something at about the same distance."""
    with np.errstate(invalid="ignore"):
        near = np.abs(one.distance - other.distance) < SAME
    alike: np.ndarray = near | (~one.found & ~other.found)
    return alike
