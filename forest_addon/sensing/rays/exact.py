"""Rays against every triangle near them, in float64: what audits and benchmarks hold the engines against.

Triangles that follow each other in their mesh are most often neighbours: eight share a box, eight boxes a
larger one, and so on to the whole mesh. All rays go down these boxes together, and meet each triangle of the
groups whose boxes they meet (Möller & Trumbore 1997). It shares no code with the engines.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ...base.trimesh import TriMesh
from .caster import Hits, RayCaster, hit_normals
from .geometry import SceneGeometry, invert_transforms

GROUP = 8  # triangles of a box, and boxes of a larger one
PAIRS = 500_000  # rays by instances, and by boxes, at a time
EDGE = 1e-12  # barycentric slack: a ray at a shared edge meets at least one of its triangles

Level = tuple[np.ndarray, np.ndarray]  # smallest and largest corners (G, 3)


class ExactCaster(RayCaster):
    """The ``RayCaster`` protocol in float64."""

    engine = "float64"

    def __init__(self, scene: SceneGeometry) -> None:
        self.scene = scene
        self._low, self._high = scene.bounds()
        self._inverse = invert_transforms(scene.transform)[:, :, :3]

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: float | np.ndarray = np.inf,
        *,
        min_distance: float | np.ndarray = 0.0,
        leaving: Hits | None = None,
        time: float | np.ndarray = 0.0,
    ) -> Hits:
        """The closest hits of rays (R, 3), (R, 3)."""
        count = len(origins)
        ways = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        far = np.broadcast_to(np.asarray(max_distance, np.float64), count)
        near = np.broadcast_to(np.asarray(min_distance, np.float64), count)
        hits = Hits.misses(count)
        at_once = max(1, PAIRS // max(len(self.scene), 1))
        for first in range(0, count, at_once):
            rows = slice(first, first + at_once)
            left = None if leaving is None else leaving.select(rows)
            ray, met = self.through(origins[rows], ways[rows], near[rows], far[rows], left)
            put_nearest(hits, first + ray, met)
        return replace(hits, normal=hit_normals(self.scene, replace(hits, normal=None)))

    def meets(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        hits: Hits,
        time: float | np.ndarray = 0.0,
        edge: float = 0.0,
    ) -> np.ndarray:
        """(R,) metres along rays to the triangles that hits name; inf where one passes it by, more
        than ``edge``, m."""
        ways = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        distance = np.full(len(origins), np.inf)
        named = np.flatnonzero(hits.found)
        mesh_of = self.scene.mesh_index[hits.instance[named]]
        for index in np.unique(mesh_of).tolist():
            rows = named[mesh_of == index]
            start, way = self._local(origins[rows], ways[rows], hits.instance[rows])
            corners = _corners(self.scene.meshes[index], hits.triangle[rows])
            distance[rows] = meet(corners, start, way, edge)
        return distance

    def _local(
        self, origins: np.ndarray, ways: np.ndarray, instance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Rays in the space of their instances; distances stay those of the world."""
        inverse = self._inverse[instance]
        start = np.einsum("pij,pj->pi", inverse, origins - self.scene.transform[instance, :, 3])
        return start, np.einsum("pij,pj->pi", inverse, ways)

    def through(
        self,
        origins: np.ndarray,
        ways: np.ndarray,
        near: np.ndarray,
        far: np.ndarray,
        leaving: Hits | None = None,
    ) -> tuple[np.ndarray, Hits]:
        """Numbers (K,) of rays with unit ways (R, 3), and all they meet (K,) from ``near`` to ``far``."""
        met = _slabs(origins[:, None], ways[:, None], self._low, self._high, far[:, None])
        ray, instance = np.nonzero(met)
        mesh_of = self.scene.mesh_index[instance]
        rays, all_hits = [np.empty(0, np.int64)], [Hits.misses(0)]
        for index in np.unique(mesh_of).tolist():
            rows = np.flatnonzero(mesh_of == index)
            tested, here = ray[rows], instance[rows]
            start, way = self._local(origins[tested], ways[tested], here)
            mesh = self.scene.meshes[index]
            pair, triangle = candidates(_levels(mesh), start, way, far[tested])
            distance = meet(_corners(mesh, triangle), start[pair], way[pair])
            tested = tested[pair]
            hits = Hits(distance, here[pair], triangle, np.full((len(tested), 3), np.nan))
            left = None if leaving is None else leaving.select(tested)
            some = counting(hits, near[tested], far[tested], left)
            rays.append(tested[some])
            all_hits.append(hits.select(some))
        return np.concatenate(rays), Hits.joined(all_hits)


def counting(hits: Hits, near: np.ndarray, far: np.ndarray, left: Hits | None) -> np.ndarray:
    """Rows of hits that count, of rays with these limits and what they leave."""
    counts = (hits.distance >= near) & (hits.distance <= far) & np.isfinite(hits.distance)
    if left is not None:
        counts &= ~(left.found & (hits.distance <= near))
        counts &= ~((left.instance == hits.instance) & (left.triangle == hits.triangle))
    return np.flatnonzero(counts)


def put_nearest(hits: Hits, ray: np.ndarray, met: Hits) -> None:
    """Write the nearest of what rays (M,) met."""
    order = nearest_of_rays(ray, met.distance)
    hits.put(ray[order], met.select(order))


def nearest_of_rays(ray: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Rows of the smallest of distances (M,) on each of rays (M,), ray by ray."""
    order = np.lexsort((distance, ray))
    return order[np.diff(ray[order], prepend=-1) != 0]


def candidates(
    groups: tuple[int, list[Level]], start: np.ndarray, way: np.ndarray, far: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rays (K,) by number and triangles (K,) whose boxes they meet before ``far``.

    groups : number of the triangles, and the boxes around them.
    """
    triangles, levels = groups
    if not levels:
        none = np.empty(0, np.int64)
        return none, none
    top = len(levels[-1][0])
    ray, box = np.repeat(np.arange(len(start)), top), np.tile(np.arange(top), len(start))
    for number, (low, high) in enumerate(reversed(levels)):
        kept = []
        for first in range(0, len(ray), PAIRS):
            part = slice(first, first + PAIRS)
            r, b = ray[part], box[part]
            kept.append(first + np.flatnonzero(_slabs(start[r], way[r], low[b], high[b], far[r])))
        some = np.concatenate(kept) if kept else np.empty(0, np.int64)
        below = triangles if number == len(levels) - 1 else len(levels[-2 - number][0])
        box = (box[some, None] * GROUP + np.arange(GROUP)).ravel()
        ray = np.repeat(ray[some], GROUP)
        inside = box < below
        ray, box = ray[inside], box[inside]
    return ray, box


def _levels(mesh: TriMesh) -> tuple[int, list[Level]]:
    """Boxes around groups of a mesh's triangles; kept with the mesh, which many scenes may share."""
    kept: list[Level] | None = vars(mesh).get("_groups")
    if kept is None:
        kept = []
        if len(mesh.triangles):
            corners = np.stack(_corners(mesh, slice(None)))
            kept = grouped(corners.min(axis=0), corners.max(axis=0))
        vars(mesh)["_groups"] = kept
    return len(mesh.triangles), kept


def grouped(low: np.ndarray, high: np.ndarray) -> list[Level]:
    """Boxes around groups of boxes (T, 3), (T, 3) that follow each other, and around groups of these, up to
    at most ``GROUP``.
    """
    levels: list[Level] = []
    low, high = low - 1e-9, high + 1e-9
    while not levels or len(low) > GROUP:
        first = np.arange(0, len(low), GROUP)
        low = np.fmin.reduceat(low, first)
        high = np.fmax.reduceat(high, first)
        levels.append((low, high))
    return levels


def _corners(mesh: TriMesh, triangle: np.ndarray | slice) -> tuple[np.ndarray, ...]:
    """Corners (K, 3), three of them, of triangles (K,)."""
    of_corner = (mesh.points[mesh.triangles[triangle, k]] for k in range(3))
    return tuple(corner.astype(np.float64, copy=False) for corner in of_corner)


def meet(
    corners: tuple[np.ndarray, ...], origin: np.ndarray, way: np.ndarray, edge: float = 0.0
) -> np.ndarray:
    """(K,) metres along rays (K, 3), (K, 3) to triangles of three corners (K, 3); inf for a miss by more than
    ``edge``, in metres across the ray."""
    a, b, c = corners
    u, v, s = b - a, c - a, origin - a
    with np.errstate(all="ignore"):
        p = np.cross(way, v)
        determinant = np.einsum("ki,ki->k", u, p)
        first = np.einsum("ki,ki->k", s, p) / determinant
        q = np.cross(s, u)
        second = np.einsum("ki,ki->k", q, way) / determinant
        t = np.einsum("ki,ki->k", v, q) / determinant
        slack = EDGE
        if edge:
            longest = np.linalg.norm([u, v, c - b], axis=2).max(axis=0)
            slack = EDGE + edge * (way**2).sum(axis=1) * longest / np.abs(determinant)
        inside = (first >= -slack) & (second >= -slack) & (first + second <= 1 + slack)
    return np.where(inside & (t >= 0), t, np.inf)


def _slabs(
    origin: np.ndarray, way: np.ndarray, low: np.ndarray, high: np.ndarray, far: np.ndarray
) -> np.ndarray:
    """Return whether rays (..., 3) meet boxes (..., 3) before ``far`` (...)."""
    entry, leave = np.zeros(1), far
    with np.errstate(divide="ignore", invalid="ignore"):
        for k in range(3):
            a = (low[..., k] - origin[..., k]) / way[..., k]
            b = (high[..., k] - origin[..., k]) / way[..., k]
            entry = np.fmax(entry, np.fmin(a, b))
            leave = np.fmin(leave, np.fmax(a, b))
    met: np.ndarray = entry <= leave * (1 + 1e-12)
    return met & ~np.isnan(low[..., 0])


# An engine's hits held against float64, ray by ray: which of the two is right.
#
# Engines search in float32 and refine what they find. Where they part from float64, the ray may pass an
# edge so closely that either is right: then a ray that is moved aside by ``ASIDE``, or ``STEPS`` of a
# float32 at the scene's size, finds what the engine found; beside an edge between faces of one surface, the
# very triangle. Two surfaces may lie so closely behind one another, as the front and the back beside an
# outer edge do, that single precision does not tell which is first: then the distance to the triangle that
# the engine named counts. And a chained ray may pass over what lies closely behind the surface that it
# leaves.


ASIDE = 2e-5  # m; engines search in float32, whose steps are so large 100 m away
STEPS = 2  # of a float32 at half the size of the scene, from whose middle engines count
SURE = 1e-10  # m; where an engine is off by more, it may have named another triangle
SAME = 1e-3  # m; nearer surfaces count as the same one when a ray is moved aside
BEHIND = 2e-4  # m behind a surface that is left, where an engine may be blind
TURNS = np.arange(8) * np.pi / 4


class Referee(RayCaster):
    """A ``RayCaster`` that asks an engine and float64: what the engine found where that is right, else what
    is there.

    exact : what asks float64, of the scene that is true (``moving_rays.exactly``); left out: rays at the
    engine's own as it stands. edge : metres within which single precision does not tell which of two surfaces
    is first.
    """

    engine = "float64"

    def __init__(self, caster: RayCaster, exact: Any | None = None) -> None:
        self._caster = caster
        self.exact: Any = ExactCaster(caster.scene) if exact is None else exact
        self.scene, self.moving = self.exact.scene, self.exact.moving
        low, high = self.scene.bounds()
        known = np.isfinite(low + high).all(axis=1)
        low, high = low[known].min(axis=0, initial=np.inf), high[known].max(axis=0, initial=-np.inf)
        half = float((high - low).max()) / 2  # of the scene; below 0 of an empty one
        self.edge = max(ASIDE, STEPS * float(np.spacing(np.float32(max(half, 0.0)))))

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: float | np.ndarray = np.inf,
        *,
        min_distance: float | np.ndarray = 0.0,
        leaving: Hits | None = None,
        time: float | np.ndarray = 0.0,
    ) -> Hits:
        """The closest hit of each ray."""
        origins, directions = np.asarray(origins), np.asarray(directions)
        near, far, when = (
            np.full(len(origins), given, np.float64) for given in (min_distance, max_distance, time)
        )
        ours = self._caster.cast(
            origins, directions, far, min_distance=near, leaving=leaving, time=when
        )
        nothing = ~np.isfinite(ours.distance)
        if (nothing & ours.found).any():
            ours = ours.select(np.arange(len(nothing)))
            ours.put(nothing, Hits.misses(int(nothing.sum())))
        limit = np.where(ours.found, np.minimum(ours.distance + SAME, far), far)
        exact = self.exact.cast(
            origins, directions, limit, min_distance=near, leaving=leaving, time=when
        )
        gone = np.flatnonzero(ours.found & ~exact.found)
        if len(gone):
            left = None if leaving is None else leaving.select(gone)
            again = self.exact.cast(
                origins[gone],
                directions[gone],
                far[gone],
                min_distance=near[gone],
                leaving=left,
                time=when[gone],
            )
            exact.put(gone, again)
        differ, distance = self._compare(origins, directions, ours, exact, when)
        wrong = np.flatnonzero(differ)
        named, there = ours.select(wrong), exact.select(wrong)
        alike = _alike(named, there)
        ask = ~alike | (named.instance != there.instance) | (named.triangle != there.triangle)
        rows = wrong[ask]
        rays = origins[rows], directions[rows], named.select(ask), far[rows], alike[ask]
        excused = self._at_an_edge(*rays, when[rows])
        wrong = np.delete(wrong, np.flatnonzero(ask)[excused])
        if leaving is not None and len(wrong):
            blind = self.exact.cast(
                origins[wrong],
                directions[wrong],
                far[wrong],
                min_distance=near[wrong] + BEHIND,
                time=when[wrong],
            )
            wrong = wrong[~_alike(blind, ours.select(wrong))]
        right = replace(ours.select(np.arange(len(distance))), distance=distance)
        right.put(wrong, exact.select(wrong))
        return right

    def _compare(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        ours: Hits,
        exact: Hits,
        when: np.ndarray,
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
        ask = both[~named & (apart <= ASIDE)]
        if len(ask):
            there = self.exact.meets(origins[ask], directions[ask], ours.select(ask), when[ask])
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
        when: np.ndarray,
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
        moved = self.exact.cast(
            (origins + self.edge * aside).reshape(-1, 3),
            np.tile(ways, (count, 1)),
            np.tile(far, count),
            time=np.tile(when, count),
        )
        ours = ours.select(np.tile(np.arange(len(origins)), count))
        alike = _alike(moved, ours)
        alike &= ~np.tile(by_name, count) | (
            (moved.instance == ours.instance) & (moved.triangle == ours.triangle)
        )
        return np.asarray(alike.reshape(count, -1).any(axis=0))


def _alike(one: Hits, other: Hits) -> np.ndarray:
    """(R,) bool: both miss, or meet something at about the same distance."""
    with np.errstate(invalid="ignore"):
        near = np.abs(one.distance - other.distance) < SAME
    return near | (~one.found & ~other.found)
