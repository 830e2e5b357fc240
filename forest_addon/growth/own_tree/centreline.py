"""Centrelines of tube-like pieces: where a branch runs, how thick it is, where it ends.

An STL tells no rings, so the line is found from the surface. The two ends of a piece are the vertices
farthest apart along its edges (two sweeps of Dijkstra), and the distance from one of them is a first
coordinate along it, which bends and hairpins do not confuse. Then, as for a principal curve (Hastie &
Stuetzle 1989), the surface is averaged over stretches a few radii long, every place on it is moved to
the nearest one on the line through these averages, and so on, three times. On a tube the averages settle
on the axis; a ribbon or a lone facet gets a line too.

Wood is then tubes about its centrelines, to be asked for what is nearest to places. Tubes are cones from knot
to knot, filled with balls in groups by radius; the balls nearest to a place say which cones are measured
exactly. Lines go in, and for each place come out the piece, the gap to its surface, and where along it that
is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from ...base.rows import lengths
from ...base.runs import Runs, along_lines, bounds, numbered, sums
from ...base.vectors import unit
from .pieces import Pieces

STRETCH = 4.0  # mean radii from knot to knot
MOST_STRETCHES = 48
ROUNDS = 3
SAMPLE = 4.0  # mean radii at most between samples of a long edge
MOST_SAMPLES = 64  # of one edge
NEAR = 2.0  # radii of a piece's end that tell where its middle is, and how thick it is
SLAB = 0.5  # radii of it that are the end itself
OFF = 0.42  # radii that their middle may be off the way inwards
HOOK = 2.0  # radii that it is elsewhere than where it was taken to be, at most
SURE = 3.0  # mean radii of it at least, as samples are no denser
FAR = 2.5  # times that, from where on they tell which way it goes
REGION = 4.0  # times that, which are looked at
CANDIDATES = 8  # stretches of wood looked at closely for each point
BATCH = 1 << 15  # points looked at closely at a time
LIKE, GROUPS = 4.0, 6  # balls whose radii differ by less than this factor are searched together


@dataclass(frozen=True)
class Centrelines:
    """One polyline for each of C pieces; that of piece c are the knots first[c] .. first[c + 1] - 1.

    knot : (K, 3) places on the axis; the ends are where the surface ends.
    radius : (K,) mean distance of the surface from the axis there.
    along : (K,) distance from the piece's first knot, along the line.
    first : (C + 1,) int64.
    end_radius : (C, 2) radius near the first and near the last knot, leaving caps aside.
    outward : (V, 3) from the axis to each vertex of the pieces.
    """

    knot: np.ndarray
    radius: np.ndarray
    along: np.ndarray
    first: np.ndarray
    end_radius: np.ndarray
    outward: np.ndarray

    def ends(self) -> np.ndarray:
        """(C, 2, 3) first and last knot of each piece."""
        return np.stack([self.knot[self.first[:-1]], self.knot[self.first[1:] - 1]], axis=1)

    def length(self) -> np.ndarray:
        """(C,) length of each piece along its line."""
        return np.asarray(self.along[self.first[1:] - 1])


@dataclass(frozen=True)
class _Samples:
    """Places on the surface: all vertices, then places along edges that are long for their piece."""

    of_vertices: scipy.sparse.csr_matrix  # (M, V) how much of each vertex a place is
    piece: np.ndarray  # (M,)
    weight: np.ndarray  # (M,) length of edge that each place stands for


def find_centrelines(pieces: Pieces) -> Centrelines:
    """The centreline of every piece."""
    count, owner = pieces.count, pieces.piece_of_vertex
    along, length = _along_edges(pieces)
    area = np.bincount(pieces.piece, pieces.area, count)
    radius = area / (2 * np.pi * length)  # mean radius of a tube of that area and length
    samples = _sample(pieces, radius)
    stretches = np.clip(np.ceil(length / (STRETCH * radius)), 1, MOST_STRETCHES).astype(np.int64)
    first = bounds(stretches + 1)

    share = _share(along, owner, count)
    for _ in range(ROUNDS):
        knot = _average(samples, pieces.vertices, share, first)
        along, outward = _project(knot, first, pieces.vertices, owner, share)
        share = _share(along, owner, count)

    knot_radius = _average(samples, lengths(outward)[:, None], share, first)[:, 0]
    knot = _close_ends(knot, first, knot_radius, pieces, samples, along)
    along, outward = _project(knot, first, pieces.vertices, owner, share)
    share = _share(along, owner, count)
    knot_radius = _average(samples, lengths(outward)[:, None], share, first)[:, 0]
    end_radius = _end_radii(first, knot_radius, pieces, along, outward)
    return Centrelines(knot, knot_radius, along_lines(knot, first), first, end_radius, outward)


def _along_edges(pieces: Pieces) -> tuple[np.ndarray, np.ndarray]:
    """(V,) distance along edges from one end of each vertex's piece; (C,) length of the pieces."""
    distance = lengths(pieces.vertices - pieces.middles()[pieces.piece_of_vertex])
    for _ in range(2):  # from the vertex farthest from the middle to one end, then to the other
        distance = distance_from(pieces, pieces.largest(distance))
    return distance, distance[pieces.largest(distance)]


def distance_from(pieces: Pieces, roots: np.ndarray) -> np.ndarray:
    """(V,) distance along edges from the nearest of the root vertices."""
    one, other = pieces.edges.T
    length = np.maximum(lengths(pieces.vertices[one] - pieces.vertices[other]), 1e-300)
    graph = scipy.sparse.csr_matrix((length, (one, other)), shape=(len(pieces.vertices),) * 2)
    return np.asarray(
        scipy.sparse.csgraph.dijkstra(graph, directed=False, indices=roots, min_only=True)
    )


def _sample(pieces: Pieces, radius: np.ndarray) -> _Samples:
    one, other = pieces.edges.T
    length = lengths(pieces.vertices[other] - pieces.vertices[one])
    owner = pieces.piece_of_vertex
    wanted = np.ceil(length / (SAMPLE * radius[owner[one]]))
    steps = np.clip(wanted, 1, MOST_SAMPLES).astype(np.int64)
    each = length / steps
    weight = np.bincount(one, each / 2, len(owner)) + np.bincount(other, each / 2, len(owner))

    inner = steps - 1
    edge, number = numbered(inner)
    part, many = (number + 1) / steps[edge], len(owner)
    places = scipy.sparse.csr_matrix(
        (
            np.concatenate([np.ones(many), np.stack([1 - part, part], axis=1).ravel()]),
            np.concatenate([np.arange(many, dtype=np.int32), pieces.edges[edge].ravel()]),
            np.concatenate([np.arange(many), many + 2 * np.arange(len(edge) + 1)]),
        ),
        shape=(many + len(edge), many),
    )
    return _Samples(
        of_vertices=places,
        piece=np.concatenate([owner, owner[one[edge]]]),
        weight=np.concatenate([weight, each[edge]]),
    )


def _share(along: np.ndarray, piece: np.ndarray, count: int) -> np.ndarray:
    """(V,) a coordinate along the pieces as a share, 0 at the first end and 1 at the last."""
    begins = Runs.of(piece, count).first
    low, high = np.minimum.reduceat(along, begins), np.maximum.reduceat(along, begins)
    span = np.maximum(high - low, np.finfo(float).tiny)
    return np.asarray(np.clip((along - low[piece]) / span[piece], 0.0, 1.0))


def _average(
    samples: _Samples, values: np.ndarray, share: np.ndarray, first: np.ndarray
) -> np.ndarray:
    """(K, n) mean around each knot of what vertices have (V, n); hat weights, gaps interpolated."""
    stretches = np.diff(first) - 1
    place = (samples.of_vertices @ share) * stretches[samples.piece]
    before = np.minimum(place.astype(np.int64), stretches[samples.piece] - 1)
    knot = first[samples.piece] + before
    after = (place - before) * samples.weight
    hats = scipy.sparse.csc_matrix(
        (
            np.stack([samples.weight - after, after], axis=1).ravel(),
            np.stack([knot, knot + 1], axis=1).ravel(),
            2 * np.arange(len(knot) + 1),
        ),
        shape=(first[-1], len(knot)),
    )
    weight = hats @ np.ones(len(knot))
    total = hats @ (samples.of_vertices @ values)
    piece = np.repeat(np.arange(len(stretches)), stretches + 1)
    filled = weight > 1e-9 * np.bincount(samples.piece, samples.weight)[piece]
    number = (
        2 * piece + (np.arange(first[-1]) - first[piece]) / stretches[piece]
    )  # rises throughout
    return np.stack(
        [np.interp(number, number[filled], column[filled] / weight[filled]) for column in total.T],
        axis=1,
    )


def _project(
    knot: np.ndarray, first: np.ndarray, point: np.ndarray, piece: np.ndarray, share: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(M,) place along the line nearest to each point, and (M, 3) from there to the point.

    share : where each point is now; its stretch and the two beside it are tried. A line goes straight
    on beyond its ends.
    """
    gone = along_lines(knot, first)
    stretches = (np.diff(first) - 1)[piece]
    now = np.minimum((share * stretches).astype(np.int64), stretches - 1)
    direction = np.diff(knot, axis=0)
    squared = np.einsum("ki,ki->k", direction, direction)
    length = np.sqrt(squared)
    low, high = np.zeros(len(squared)), np.ones(len(squared))
    low[first[:-1]], high[first[1:] - 2] = -np.inf, np.inf
    inverse = 1 / np.maximum(squared, np.finfo(float).tiny)
    best, along, outward = np.full(len(point), np.inf), np.empty(len(point)), np.empty(point.shape)
    for offset, row in (
        (0, np.arange(len(point))),
        (-1, np.flatnonzero(now > 0)),
        (1, np.flatnonzero(now < stretches - 1)),
    ):
        start = first[piece[row]] + now[row] + offset
        from_start, way = point[row] - knot[start], direction[start]
        part = np.einsum("mi,mi->m", from_start, way) * inverse[start]
        part = np.minimum(np.maximum(part, low[start]), high[start])
        aside = from_start - part[:, None] * way
        distance = np.einsum("mi,mi->m", aside, aside)
        nearer = distance < best[row]
        to = row[nearer]
        best[to], outward[to] = distance[nearer], aside[nearer]
        along[to] = (gone[start] + part * length[start])[nearer]
    return along, outward


def _close_ends(
    knot: np.ndarray,
    first: np.ndarray,
    radius: np.ndarray,
    pieces: Pieces,
    samples: _Samples,
    along: np.ndarray,
) -> np.ndarray:
    """(K, 3) knots of lines that reach to where the surface ends, in its middle there."""
    gone, knot = along_lines(knot, first), knot.copy()
    owner, number = np.repeat(np.arange(pieces.count), np.diff(first)), np.arange(len(knot))
    ends = first[:-1], first[1:] - 1
    for end, (at, other) in enumerate((ends, ends[::-1])):
        next_one = at + 1 - 2 * end
        thick = np.maximum(radius[at], radius[next_one])
        second = np.where(np.diff(first) > 2, at + 2 - 4 * end, next_one)
        way = knot[second] - knot[np.where(second == next_one, at, next_one)]
        foot, inwards, near = _find_end(pieces, samples, along if end == 0 else -along, thick, way)
        # a piece without extent tells no end: it keeps its own
        sure = np.isfinite(foot).all(axis=1) & np.isfinite(inwards).all(axis=1) & np.isfinite(near)
        foot = np.where(sure[:, None], foot, knot[at])
        inwards, near = np.where(sure[:, None], inwards, 0.0), np.where(sure, near, 0.0)
        # knots nearer to the end than its surface is sure of stand on the straight way to it
        place = np.einsum("ki,ki->k", knot - foot[owner], inwards[owner])
        from_end = np.abs(gone - gone[at][owner])
        close = (place < near[owner]) & (from_end < REGION * near[owner]) & (number != other[owner])
        close[at] = True
        place[at] = 0.0
        knot[close] = (foot[owner] + np.maximum(place, 0.0)[:, None] * inwards[owner])[close]
    return knot


def _end_radii(
    first: np.ndarray, radius: np.ndarray, pieces: Pieces, along: np.ndarray, outward: np.ndarray
) -> np.ndarray:
    """(C, 2) radius near both ends, leaving caps aside: the upper quartile there."""
    owner, thickness = pieces.piece_of_vertex, lengths(outward)
    radii = np.empty((pieces.count, 2))
    for end, at in enumerate((first[:-1], first[1:] - 1)):
        depth = along if end == 0 else -along
        depth = depth - np.minimum.reduceat(depth, Runs.of(owner, pieces.count).first)[owner]
        collar = np.flatnonzero(depth <= NEAR * radius[at][owner])
        runs = Runs.of(owner[collar], pieces.count)
        order = collar[np.lexsort((thickness[collar], owner[collar]))]
        # no vertex near the end: a piece without extent, whose radius is not known
        radii[:, end], known = np.nan_to_num(radius[at]), runs.size > 0
        radii[known, end] = thickness[order[(runs.first + 3 * runs.size // 4)[known]]]
    return radii


def _find_end(
    pieces: Pieces, samples: _Samples, depth: np.ndarray, thick: np.ndarray, way: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """One end of every piece: its middle (C, 3), the way inwards (C, 3), and how far that is straight (C,).

    depth : (V,) how far vertices are from the end, as far as is known. thick : (C,) the radius and
    way : (C, 3) the direction inwards, likewise.

    The surface's middles a radius or two from the end and farther in tell the way; seen along it, the end's
    own depth is found, and with it the middles anew. So it does not matter which corner of a base was taken
    for the end, nor how few corners that has.
    """
    owner, count = pieces.piece_of_vertex, pieces.count
    begins = Runs.of(owner, count).first
    depth = depth - np.minimum.reduceat(depth, begins)[owner]
    length = np.maximum(np.maximum.reduceat(depth, begins), np.finfo(float).tiny)
    mean = np.bincount(pieces.piece, pieces.area, count) / (2 * np.pi * length)
    near = np.minimum(np.maximum(NEAR * thick, SURE * mean), length / 3)
    row = np.flatnonzero(samples.of_vertices @ depth <= (REGION * near)[samples.piece])
    piece, weight = samples.piece[row], samples.weight[row]
    place = np.stack([samples.of_vertices[row] @ axis for axis in pieces.vertices.T], axis=1)
    near_end = np.flatnonzero(depth <= (REGION * near)[owner])
    corner, of_corner = pieces.vertices[near_end], owner[near_end]
    inwards = unit(way)
    for _ in range(ROUNDS + 1):
        along = np.einsum("vi,vi->v", corner, inwards[of_corner])
        least = np.full(count, np.inf)
        np.minimum.at(least, of_corner, along)
        seen = np.einsum("mi,mi->m", place, inwards[piece]) - least[piece]
        here = _weighted(place, np.where(seen <= near[piece], weight, 0.0), piece, count)
        inner = np.where(seen > near[piece], weight, 0.0)
        there = _weighted(place, inner * (seen <= FAR * near[piece]), piece, count)
        there = np.where(np.isfinite(there), there, _weighted(place, inner, piece, count))
        inwards = unit(there - here)
        inwards = np.where(np.isfinite(inwards), inwards, 0.0)
    along = np.einsum("vi,vi->v", corner - here[of_corner], inwards[of_corner])
    least = np.full(count, np.inf)
    np.minimum.at(least, of_corner, along)
    foot = here + least[:, None] * inwards
    # the middle of the end's own corners is nearer still, where all of them were found
    flat = (along - least[of_corner] <= SLAB * thick[of_corner]).astype(float)
    middle = _weighted(corner, flat, of_corner, count) - foot
    middle -= np.einsum("ci,ci->c", middle, inwards)[:, None] * inwards
    whole = np.linalg.norm(middle, axis=1) <= OFF * thick
    foot[whole] += middle[whole]
    # a hook is not seen from farther in: there the corners that are known to be the end's tell
    known = _weighted(
        corner, (depth[near_end] <= SLAB * thick[of_corner]).astype(float), of_corner, count
    )
    hook = np.linalg.norm(foot - known, axis=1) > HOOK * thick
    foot[hook], near = known[hook], np.where(hook, 0.0, near)
    return foot, unit(there - foot), near


def _weighted(place: np.ndarray, weight: np.ndarray, piece: np.ndarray, count: int) -> np.ndarray:
    """(C, 3) weighted mean of places (M, 3); NaN where none has weight."""
    total = np.bincount(piece, weight, count)
    mean = sums(piece, weight[:, None] * place, count)
    return np.asarray(mean / np.where(total > 0, total, np.nan)[:, None])


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
    search: scipy.spatial.cKDTree

    def query(self, points: np.ndarray, count: int) -> np.ndarray:
        """(N, k) the nearest to each point."""
        lifted = np.column_stack([points, np.zeros(len(points))])
        nearest = np.arange(min(count, len(self.radius))) + 1
        return np.asarray(self.search.query(lifted, k=nearest, workers=-1)[1])


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
        chosen = np.zeros(len(lines.first) - 1, dtype=bool)
        chosen[pieces] = True
        owner = np.repeat(np.arange(len(chosen)), np.diff(lines.first))
        start = np.flatnonzero(chosen[owner[:-1]] & (owner[:-1] == owner[1:]))
        vector = lines.knot[start + 1] - lines.knot[start]
        length = np.linalg.norm(vector, axis=1)
        ends = np.stack([lines.radius[start], lines.radius[start + 1]], axis=1)

        thick = np.maximum(ends.max(axis=1), length / 64)
        spacing = np.maximum(thick, max(float(lines.along.max()) / 1000, np.finfo(float).tiny))
        balls = np.maximum(np.ceil(length / spacing).astype(np.int64), 1)
        of, number = numbered(balls)
        part = (number + 0.5) / balls[of]
        radius = ends[of, 0] * (1 - part) + ends[of, 1] * part
        centre = lines.knot[start[of]] + part[:, None] * vector[of]
        apart = length[of] / balls[of]
        relative = np.maximum(radius / max(radius.max(), np.finfo(float).tiny), LIKE**-GROUPS)
        group = np.floor(-np.log(relative) / np.log(LIKE)).astype(np.int64)
        groups = []
        for own in (np.flatnonzero(group == number) for number in np.unique(group)):
            lifted = np.sqrt(np.maximum(radius[own].max() ** 2 - radius[own] ** 2, 0.0))
            search = scipy.spatial.cKDTree(np.column_stack([centre[own], lifted]))
            groups.append(_Balls(of[own], radius[own], apart[own], centre[own], search))
        return cls(
            lines.knot[start], vector, length, ends, lines.along[start], owner[start], tuple(groups)
        )

    def look(self, points: np.ndarray, wanted: np.ndarray | None = None) -> np.ndarray:
        """(2, G, N) gap to the nearest ball of each group, and the least to any cone of the group; infinite
        where it is not ``wanted`` (G, N)."""
        seen = np.full((2, len(self.groups), len(points)), np.inf)
        for number, balls in enumerate(self.groups):
            row = np.arange(len(points)) if wanted is None else np.flatnonzero(wanted[number])
            near = balls.query(points[row], 1)[:, 0]
            away = lengths(points[row] - balls.centre[near])
            free = np.maximum(away - balls.radius[near], 0.0)
            thickest = balls.radius.max()  # of power free·(free + 2r), at least as near as the next
            least = np.sqrt(thickest**2 + free * (free + 2 * balls.radius[near])) - thickest
            gap = away - balls.radius[near]
            seen[:, number, row] = gap, gap - (free - least + balls.spacing[near])
        return seen

    def contacts(self, points: np.ndarray, seen: np.ndarray, *, thinnest: bool = False) -> Contact:
        """See ``find_contacts``; so many points at a time that memory is bounded.

        seen : as ``look`` finds. thinnest : for points inside several tubes, the thinnest of them, and not
            that whose surface is farthest away.
        """
        batches = np.array_split(np.arange(len(points)), max(len(points) // BATCH, 1))
        parts = [
            self._contacts(points[rows], *seen[:, :, rows], thinnest=thinnest) for rows in batches
        ]
        return Contact(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def _contacts(
        self, points: np.ndarray, nearest: np.ndarray, away: np.ndarray, *, thinnest: bool
    ) -> tuple[np.ndarray, ...]:
        most = np.maximum(nearest.min(axis=0, initial=np.inf), 0.0)
        best = np.full(len(points), np.inf)
        chosen = np.zeros(len(points), dtype=np.int64)
        measured = np.zeros((3, len(points)))  # gap, place in the cone, radius
        for balls, least in zip(self.groups, away, strict=True):
            row = np.flatnonzero(least <= most)
            if not len(row):
                continue
            cone, aside, part, radius = self.beside(points[row], CANDIDATES, (balls,))
            gap = aside - radius
            rank = np.where(gap < 0, radius - self.radius.max(), gap) if thinnest else gap
            pick = np.arange(len(row)), np.argmin(rank, axis=1)
            nearer = rank[pick] < best[row]
            row = row[nearer]
            best[row], chosen[row] = rank[pick][nearer], cone[pick][nearer]
            measured[:, row] = np.stack([x[pick] for x in (gap, part, radius)])[:, nearer]
        length = self.length[chosen]
        return (
            self.piece[chosen],
            measured[0],
            self.along[chosen] + measured[1] * length,
            self.vector[chosen] / np.maximum(length, np.finfo(float).tiny)[:, None],
            measured[2],
        )

    def beside(
        self, points: np.ndarray, count: int, groups: tuple[_Balls, ...] = ()
    ) -> tuple[np.ndarray, ...]:
        """The cones with the ``count`` balls nearest to points (N, 3) of each group, or of these: the cone,
        how far the point is from its axis, how far along it that is, 0 .. 1, and the radius there, (N, k).
        """
        near = [balls.stretch[balls.query(points, count)] for balls in groups or self.groups]
        cone = np.concatenate(near, axis=1)
        from_start, vector = points[:, None] - self.start[cone], self.vector[cone]
        squared = np.maximum(self.length[cone] ** 2, np.finfo(float).tiny)
        part = np.clip(np.einsum("nki,nki->nk", from_start, vector) / squared, 0.0, 1.0)
        aside = from_start - part[..., None] * vector
        ends = self.radius[cone]
        radius = ends[..., 0] * (1 - part) + ends[..., 1] * part
        return cone, np.sqrt(np.einsum("nki,nki->nk", aside, aside)), part, radius


def find_contacts(lines: Centrelines, pieces: np.ndarray, points: np.ndarray) -> Contact:
    """The wood of some pieces that is nearest to points (N, 3)."""
    tubes = Tubes.of(lines, pieces)
    return tubes.contacts(points, tubes.look(points))
