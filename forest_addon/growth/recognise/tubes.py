"""Wood as tubes about its centrelines, to be asked for what is nearest to places.

Tubes are cones from knot to knot, filled with balls in groups by radius; the balls nearest to a place say
which cones are measured exactly. Lines go in, and for each place come out the piece, the gap to its surface,
and where along it that is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from .centreline import Centrelines
from .pieces import lengths

CANDIDATES = 8  # stretches of wood looked at closely for each point
BATCH = 1 << 15  # points looked at closely at a time
LIKE, GROUPS = 4.0, 6  # balls whose radii differ by less than this factor are searched together


@dataclass(frozen=True)
class Contact:
    """The wood nearest to each of N points.

    piece : (N,) int64.
    gap : (N,) distance to its surface, taken as a tube; negative inside.
    along : (N,) place along its centreline.
    direction : (N, 3) unit, of the centreline there.
    radius : (N,) of the tube there.
    """

    piece: np.ndarray
    gap: np.ndarray
    along: np.ndarray
    direction: np.ndarray
    radius: np.ndarray


@dataclass(frozen=True)
class _Balls:
    """Balls of like radius within wood, to be asked for the nearest.

    Of balls with centres c and radii r the one with the smallest power distance |p - c|² - r² is an
    ordinary nearest neighbour in four dimensions, (c, √(R² - r²)) to (p, 0) with R the largest radius.
    That is quick where no r is much below R.
    """

    stretch: np.ndarray  # (B,) the cone that each is in
    radius: np.ndarray  # (B,)
    spacing: np.ndarray  # (B,) to the next in its cone
    centre: np.ndarray  # (B, 3)
    search: cKDTree

    @classmethod
    def of(
        cls, centre: np.ndarray, radius: np.ndarray, spacing: np.ndarray, stretch: np.ndarray
    ) -> _Balls:
        lifted = np.sqrt(np.maximum(radius.max() ** 2 - radius**2, 0.0))
        return cls(stretch, radius, spacing, centre, cKDTree(np.column_stack([centre, lifted])))

    def query(self, points: np.ndarray, count: int) -> np.ndarray:
        """(N, k) the nearest to each point."""
        lifted = np.column_stack([points, np.zeros(len(points))])
        nearest = np.arange(min(count, len(self.radius))) + 1
        return np.asarray(self.search.query(lifted, k=nearest, workers=-1)[1])


@dataclass(frozen=True)
class _Look:
    """Of N points, in each of G groups of balls, the nearest one.

    gap : (G, N) to its surface. doubt : (G, N) how much nearer a cone of the group may be.
    """

    gap: np.ndarray
    doubt: np.ndarray

    def of(self, rows: np.ndarray) -> _Look:
        """Return what was seen of some of the points."""
        return _Look(self.gap[:, rows], self.doubt[:, rows])


@dataclass(frozen=True)
class Tubes:
    """Wood as S cones between knots, filled with balls, in groups by radius.

    Cones that near balls are in are measured exactly.
    """

    start: np.ndarray  # (S, 3)
    vector: np.ndarray  # (S, 3) from there to the next knot
    length: np.ndarray  # (S,)
    radius: np.ndarray  # (S, 2)
    along: np.ndarray  # (S,) of the start, along its piece
    piece: np.ndarray  # (S,)
    groups: tuple[_Balls, ...]

    @classmethod
    def of(cls, lines: Centrelines, pieces: np.ndarray) -> Tubes:
        mine = np.zeros(len(lines.first) - 1, dtype=bool)
        mine[pieces] = True
        owner = np.repeat(np.arange(len(mine)), np.diff(lines.first))
        start = np.flatnonzero(mine[owner[:-1]] & (owner[:-1] == owner[1:]))
        vector = lines.knot[start + 1] - lines.knot[start]
        length = np.linalg.norm(vector, axis=1)
        ends = np.stack([lines.radius[start], lines.radius[start + 1]], axis=1)

        thick = np.maximum(ends.max(axis=1), length / 64)
        spacing = np.maximum(thick, max(float(lines.along.max()) / 1000, np.finfo(float).tiny))
        balls = np.maximum(np.ceil(length / spacing).astype(np.int64), 1)
        of = np.repeat(np.arange(len(start)), balls)
        part = (np.arange(len(of)) - np.repeat(np.cumsum(balls) - balls, balls) + 0.5) / balls[of]
        radius = ends[of, 0] * (1 - part) + ends[of, 1] * part
        centre = lines.knot[start[of]] + part[:, None] * vector[of]
        apart = length[of] / balls[of]
        relative = np.maximum(radius / max(radius.max(), np.finfo(float).tiny), LIKE**-GROUPS)
        group = np.floor(-np.log(relative) / np.log(LIKE)).astype(np.int64)
        groups = [
            _Balls.of(centre[own], radius[own], apart[own], of[own])
            for own in (np.flatnonzero(group == number) for number in np.unique(group))
        ]
        return cls(
            lines.knot[start], vector, length, ends, lines.along[start], owner[start], tuple(groups)
        )

    def look(self, points: np.ndarray, wanted: np.ndarray | None = None) -> _Look:
        """The nearest ball of each group; infinitely far where it is not ``wanted`` (G, N)."""
        gap = np.full((len(self.groups), len(points)), np.inf)
        doubt = np.zeros_like(gap)
        for number, balls in enumerate(self.groups):
            row = np.arange(len(points)) if wanted is None else np.flatnonzero(wanted[number])
            near = balls.query(points[row], 1)[:, 0]
            away = lengths(points[row] - balls.centre[near])
            free = np.maximum(away - balls.radius[near], 0.0)
            thickest = balls.radius.max()  # of power free·(free + 2r), at least as near as the next
            least = np.sqrt(thickest**2 + free * (free + 2 * balls.radius[near])) - thickest
            gap[number, row] = away - balls.radius[near]
            doubt[number, row] = free - least + balls.spacing[near]
        return _Look(gap, doubt)

    def contacts(self, points: np.ndarray, seen: _Look, *, thinnest: bool = False) -> Contact:
        """See ``find_contacts``; so many points at a time that memory is bounded."""
        batches = np.array_split(np.arange(len(points)), max(len(points) // BATCH, 1))
        parts = [self._contacts(points[rows], seen.of(rows), thinnest) for rows in batches]
        return Contact(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def _contacts(self, points: np.ndarray, seen: _Look, thinnest: bool) -> tuple[np.ndarray, ...]:
        least = np.maximum(seen.gap.min(axis=0, initial=np.inf), 0.0)
        best = np.full(len(points), np.inf)
        chosen = np.zeros(len(points), dtype=np.int64)
        measured = np.zeros((3, len(points)))  # gap, place in the cone, radius
        for balls, gap, doubt in zip(self.groups, seen.gap, seen.doubt, strict=True):
            row = np.flatnonzero(gap - doubt <= least)
            if not len(row):
                continue
            cone, rank, found = self._measure(points[row], balls, thinnest)
            nearer = rank < best[row]
            row = row[nearer]
            best[row], chosen[row] = rank[nearer], cone[nearer]
            measured[:, row] = found[:, nearer]
        length = self.length[chosen]
        return (
            self.piece[chosen],
            measured[0],
            self.along[chosen] + measured[1] * length,
            self.vector[chosen] / np.maximum(length, np.finfo(float).tiny)[:, None],
            measured[2],
        )

    def _measure(
        self, points: np.ndarray, balls: _Balls, thinnest: bool
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the cones around a group's balls the best: (N,), its rank, (3, N) what was measured."""
        cone = balls.stretch[balls.query(points, CANDIDATES)]  # (N, k)
        part, aside = self._off(points, cone)
        ends = self.radius[cone]
        radius = ends[..., 0] * (1 - part) + ends[..., 1] * part
        gap = aside - radius
        rank = np.where(gap < 0, radius - self.radius.max(), gap) if thinnest else gap
        row, best = np.arange(len(points)), np.argmin(rank, axis=1)
        return (
            cone[row, best],
            rank[row, best],
            np.stack([x[row, best] for x in (gap, part, radius)]),
        )

    def beside(self, points: np.ndarray, count: int) -> tuple[np.ndarray, ...]:
        """Of points (N, 3) and the cones that the ``count`` nearest balls of each group are in: the cone,
        how far the point is from its axis, how far along it that is, 0 .. 1, and the radius there, (N, k)."""
        cone = np.concatenate(
            [balls.stretch[balls.query(points, count)] for balls in self.groups], axis=1
        )
        part, aside = self._off(points, cone)
        ends = self.radius[cone]
        return cone, aside, part, ends[..., 0] * (1 - part) + ends[..., 1] * part

    def _off(self, points: np.ndarray, cone: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N, k) how far along the axes of cones (N, k) points are, 0 .. 1, and how far off them."""
        from_start = points[:, None] - self.start[cone]
        vector = self.vector[cone]
        squared = np.maximum(self.length[cone] ** 2, np.finfo(float).tiny)
        part = np.clip(np.einsum("nki,nki->nk", from_start, vector) / squared, 0.0, 1.0)
        aside = from_start - part[..., None] * vector
        return part, np.sqrt(np.einsum("nki,nki->nk", aside, aside))


def find_contacts(
    lines: Centrelines, pieces: np.ndarray, points: np.ndarray, *, thinnest: bool = False
) -> Contact:
    """The wood of some pieces that is nearest to points (N, 3).

    thinnest : for points inside several tubes, the thinnest of them, and not that whose surface is
        farthest away.
    """
    tubes = Tubes.of(lines, pieces)
    return tubes.contacts(points, tubes.look(points), thinnest=thinnest)
