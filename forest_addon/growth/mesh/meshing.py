"""A whole skeleton to triangles, all branches at once; and a single polyline with radii to a closed tube.

Every axis becomes a closed tube: a ring of n corners is widened by π/(n·sin(π/n)): its perimeter, and so its
mean silhouette, is then the circle's, where an inscribed 8-gon would be 2.6 % too thin. n is chosen so that
the polygon departs from the circle by at most a tolerance. Rings of equal n become vertices by one matrix
product and triangles by one sum. Where the radius steps, as between Méndez et al.'s internodes, a node has
two rings. Edges are known from how tubes are made; Blender can find them itself, but that takes longer than
everything else about a mesh.

Axes come sorted by the number of corners their rings get, so that rings of equal n lie together. Segments
without a length and axes without a radius are passed over. A branch starts on its parent's axis, so its
foot is inside the parent; where the parent ends in a fork, or is thinner than the branch, it starts one node
earlier, within the parent and along it: it bends out of the parent, and no wedge opens between them. Nodes
that the line passes within the tolerance anyway are left out.

From one segment to the next a frame takes the smallest turn that brings the direction over (parallel
transport), so nothing twists. At a bend the ring lies in the bisecting plane and is stretched there by 1/cos
of half the bend: that is where two cylinders really meet, and the tube keeps its thickness and its volume.

Bark in relief: ridges, plates and scales are functions of the way around the stem and of that along it, both
in metres, and run on without a seam. A cross-section is oval besides, and its long side turns slowly on the
way up. The foot of a stem runs out into roots. Every ring keeps its area: its radii r·f are divided by
√mean(f²), so that volumes and the DBH of a circle of the same area stay.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...base.rng import stream
from ...base.runs import along_lines, numbered
from ...base.trimesh import WOOD, Edges, TriMesh, join_edges
from ...base.vectors import cross_rows, unit
from ..draw import GOLDEN
from ..skeleton import TOUCH, Axes, Skeleton, find_axes

MITRE = 2.0  # a ring is stretched no further at a bend: 120°
TURNED_BACK = 0.1  # cosine of half a bend beyond which a line counts as turned back on itself
SIDES = np.array([3, 4, 5, 6, 7, 8, 10, 12, 14, 16, 20, 24, 32, 40, 48, 64])
SHORTEST = 1e-9  # metres; a shorter segment has no direction and is passed over
SNUG = 0.98  # of the parent's polygon: how wide a branch may start within it
TRIANGLE = 0.6  # inner radius over the circle's of a triangle of equal perimeter, π/(3·tan(π/3))


def ring_frames(line: Line) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) twice: what a ring's cosine and sine are multiplied by at each node, for radius 1."""
    first, count = line.first, len(line.point)
    if not count:
        return np.empty((0, 3)), np.empty((0, 3))
    last = first[1:] - 1
    ahead = np.empty((count, 3))  # direction of the segment that starts at a node
    ahead[:-1] = np.diff(line.point, axis=0)
    ahead[last] = ahead[last - 1]
    size = np.sqrt(np.einsum("ni,ni->n", ahead, ahead))[:, None]
    ahead /= np.maximum(size, SHORTEST)

    across = np.empty((count, 3))
    across[first[:-1]] = _start(ahead[first[:-1]])
    longest_first = np.argsort(-np.diff(first), kind="stable")
    nodes = np.diff(first)[longest_first]
    behind = ahead[np.maximum(np.arange(count) - 1, 0)]
    cosine = np.einsum("ni,ni->n", behind, ahead)
    between = behind + ahead
    with np.errstate(divide="ignore"):
        factor = np.where(cosine > -1 + 1e-9, 1 / (1 + cosine), 0.0)
    for ring in range(1, int(nodes.max())):  # by the smallest turn from one segment to the next
        active = int(np.searchsorted(-nodes, -ring, side="left"))
        at = first[longest_first[:active]] + ring
        kept = across[at - 1]
        share = np.einsum("ni,ni->n", kept, ahead[at]) * factor[at]
        across[at] = kept - share[:, None] * between[at]
    across -= np.einsum("ni,ni->n", across, ahead)[:, None] * ahead
    across /= np.sqrt(np.einsum("ni,ni->n", across, across))[:, None]
    beside = cross_rows(ahead, across)

    # Lay the rings of bends into the bisecting plane, along the segment ahead.
    inside = np.ones(count, dtype=bool)
    inside[first[:-1]] = inside[last] = False
    half = np.sqrt(np.maximum((1 + cosine) / 2, 0.0))
    bend = np.flatnonzero(inside & (cosine < 1 - 1e-12) & (half > TURNED_BACK))
    if len(bend):
        middle = between[bend] / (2 * half[bend])[:, None]
        way = ahead[bend]
        turn = way - behind[bend]
        turn /= np.sqrt(np.einsum("ni,ni->n", turn, turn))[:, None]
        squeeze = np.minimum(1.0, MITRE * half[bend]) - 1
        for ring_axis in (across, beside):
            laid = ring_axis[bend]
            slide = np.einsum("ni,ni->n", laid, middle) / half[bend]
            laid = laid - slide[:, None] * way
            excess = np.einsum("ni,ni->n", laid, turn) * squeeze
            ring_axis[bend] = laid + excess[:, None] * turn
    return across, beside


def _start(direction: np.ndarray) -> np.ndarray:
    """(A, 3) unit vectors across unit directions, each axis turned on by the golden angle."""
    helper = np.eye(3)[np.argmin(np.abs(direction), axis=1)]
    across = cross_rows(direction, helper)
    across /= np.sqrt(np.einsum("ni,ni->n", across, across))[:, None]
    turn = GOLDEN * np.arange(len(direction))
    beside = cross_rows(direction, across)
    return np.asarray(np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * beside)


@dataclass(frozen=True)
class Line:
    """The nodes of all axes, axis by axis: A axes, N nodes."""

    first: np.ndarray  # (A + 1,) first node of each axis
    point: np.ndarray  # (N, 3)
    below: np.ndarray  # (N,) radius on the side of the foot
    above: np.ndarray  # (N,) radius on the side of the tip
    order: np.ndarray  # (A,)
    sides: np.ndarray  # (A,) ascending


def lines_of(
    skeleton: Skeleton,
    tolerance: float,
    sunk: float,
    relief: Relief | None = None,
) -> Line:
    """Nodes of every axis that has a length and a radius, polygons of fewest corners first."""
    axes = find_axes(skeleton)
    span = skeleton.end - skeleton.start
    length = np.sqrt(np.einsum("si,si->s", span, span))
    axis = axes.of_row
    thick = np.zeros(len(axes))
    radius = np.maximum(skeleton.radius, 0.0)
    if len(axis):
        thick = np.maximum.reduceat(radius.max(axis=1)[axes.segment], axes.first[:-1])
    kept = (length[axes.segment] > SHORTEST) & (thick[axis] > 0)
    segment, axis = axes.segment[kept], axis[kept]

    sides = sides_of(thick, tolerance)
    if relief is not None:
        sides = np.maximum(sides, relief.corners(thick))
    size = np.bincount(axis, minlength=len(axes))
    rank = np.argsort(sides, kind="stable")
    rank = rank[size[rank] > 0]
    size, start = size[rank], (np.cumsum(size) - size)[rank]
    segment = segment[np.repeat(start - (np.cumsum(size) - size), size) + np.arange(size.sum())]
    sides, order = sides[rank], skeleton.order[axes.segment[axes.first[:-1]]][rank]

    foot = np.cumsum(size) - size
    inner, inner_point, inner_radius = _inner(
        skeleton, length, segment[foot], axes, sunk, tolerance
    )
    first = np.concatenate([[0], np.cumsum(size + 1 + inner)])
    head = first[:-1] + inner  # the node where the axis itself starts
    point = np.empty((first[-1], 3))
    below, above = np.empty(first[-1]), np.empty(first[-1])
    node = np.repeat(head - foot, size) + np.arange(len(segment))  # start node of each segment
    point[head], point[node + 1] = skeleton.start[segment[foot]], skeleton.end[segment]
    above[node], below[node + 1] = radius[segment, 0], radius[segment, 1]
    below[head], above[first[1:] - 1] = above[head], below[first[1:] - 1]
    front = first[:-1][inner]
    point[front] = inner_point[inner]
    below[front] = above[front] = np.minimum(above[head[inner]], inner_radius[inner])
    return Line(first, point, below, above, order, sides)


def _inner(
    skeleton: Skeleton,
    length: np.ndarray,
    foot: np.ndarray,
    axes: Axes,
    sunk: float,
    tolerance: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tell whether each axis (A,) starts a ring earlier, where, and how wide it may be there.

    foot : (A,) first segment of each axis.
    """
    parent = np.maximum(skeleton.parent[foot], 0)
    root = skeleton.parent[foot] < 0
    way = skeleton.end[parent] - skeleton.start[parent]
    way = np.where(root[:, None], skeleton.end[foot] - skeleton.start[foot], way)
    long = np.where(root, length[foot], length[parent])

    at_end = np.abs(skeleton.start[foot] - skeleton.end[parent]).max(axis=1, initial=0.0) <= TOUCH
    continued = axes.onward[parent] >= 0
    there = skeleton.radius[parent, 1]
    own = skeleton.radius[foot, 0]
    forks = ~root & at_end & (long > SHORTEST) & (~continued | (own > 0.9 * there))
    back = np.where(root, sunk, np.minimum(0.5 * long, np.maximum(there, own)))
    forks &= (there > 0) & (back > TOUCH)
    step = back / np.maximum(long, SHORTEST)
    wide = there + (skeleton.radius[parent, 0] - there) * np.clip(step, 0, 1)
    limit = np.where(root, np.inf, SNUG * np.maximum(wide - tolerance, TRIANGLE * wide))
    point = skeleton.start[foot] - step[:, None] * way
    return forks | (root & (sunk > 0)), point, limit


def thin_nodes(line: Line, tolerance: float) -> Line:
    """Leave out nodes that the line passes within the tolerance anyway, in axis and in radius.

    Six rounds, each of which may drop every second node and use half of what is left of the tolerance:
    the sum of all shifts stays within it.
    """
    axis = np.repeat(np.arange(len(line.sides)), np.diff(line.first))
    point, below, above, first = line.point, line.below, line.above, line.first
    allowed = tolerance
    for _ in range(6):
        allowed *= 0.5
        place = np.arange(len(axis)) - first[axis]
        at = np.flatnonzero((place % 2 == 1) & (np.arange(len(axis)) < first[axis + 1] - 1))
        at = at[np.abs(below[at] - above[at]) <= 1e-3 * allowed]
        if not len(at):
            break
        chord = point[at + 1] - point[at - 1]
        offset = point[at] - point[at - 1]
        square = np.einsum("ni,ni->n", chord, chord)
        share = np.einsum("ni,ni->n", offset, chord) / np.maximum(square, SHORTEST**2)
        away = offset - share[:, None] * chord
        miss = np.einsum("ni,ni->n", away, away)
        thick = above[at - 1] + share * (below[at + 1] - above[at - 1])
        dropped = at[
            (share > 0)
            & (share < 1)
            & (miss <= allowed**2)
            & (np.abs(thick - above[at]) <= allowed)
        ]
        if not len(dropped):
            break
        kept = np.ones(len(axis), dtype=bool)
        kept[dropped] = False
        axis, point, below, above = axis[kept], point[kept], below[kept], above[kept]
        first = np.searchsorted(axis, np.arange(len(line.sides) + 1))
    return Line(first, point, below, above, line.order, line.sides)


def sides_of(radius: np.ndarray, tolerance: float) -> np.ndarray:
    """(A,) corners of rings that stay within the tolerance of circles of these radii (A,)."""
    share = np.minimum(tolerance / np.maximum(radius, np.finfo(float).tiny), 0.9)
    exact = np.ceil(np.pi / np.arccos(1 - share) - 1e-9)
    return np.asarray(SIDES[np.minimum(np.searchsorted(SIDES, exact), len(SIDES) - 1)])


FROM = 0.05  # metres of radius, below which an axis is smooth
FULL = 0.12  # metres of radius, from which furrows have all of their depth
AROUND = 5  # corners a ridge around the stem
ALONG = 3.0  # rings a ridge's width along it
RUNNING = 1.0  # the same of furrows, which run up the stem seven widths
MOST_CORNERS = 360
SMALLEST = 0.035  # metres: scales that are smaller are meshed as if they had this size
DEEPEST = 0.25  # of a ring's radius, that a furrow is deep at most
TURNS = 1.3  # radians a metre, by which the long side of an oval turns at most
ROOTS = (4, 7)  # that a stem runs out into, from and below
HIGHEST = 5.0  # radii of the foot, up to which roots are seen
SHARP = 22.0  # how narrow roots are, from above


@dataclass(frozen=True)
class Relief:
    """Bark in relief.

    texture : as ``spec.Bark`` has it. size, depth : of ridges, metres. ovality : relative.
    upper_from : share of an axis' length from which it is nearly smooth. seed : of all draws. roots : how far
    they stand out of a stem's foot, over its radius.
    """

    texture: str
    size: float
    depth: float
    ovality: float
    upper_from: float
    seed: int
    roots: float = 0.0

    @property
    def rings(self) -> float:
        """Rings a ridge's width along an axis: few where bark changes slowly on the way up."""
        return ALONG if self.texture in ("plated", "cracked") else RUNNING

    def most(self, radius: float) -> float:
        """Bound how far the surface of a stem of this radius, above roots, lies from its circle, metres."""
        return self.depth + 0.7 * self.ovality * radius if radius >= FROM else 0.0

    def highest(self, radius: float) -> float:
        """Bound how far above the ground roots make a stem of this radius no cone, metres."""
        return HIGHEST * radius if self.roots > 0 and radius >= FROM else 0.0

    def corners(self, radius: np.ndarray) -> np.ndarray:
        """(A,) corners that rings of these radii (A,) need; 0 of a smooth axis."""
        wanted = 8 * np.ceil(2 * np.pi * radius / self.size * AROUND / 8)
        return np.where(radius < FROM, 0, np.clip(wanted, 16, MOST_CORNERS)).astype(np.int64)

    def densified(self, line: Line) -> Line:
        """The axes with rings so close that ridges show; ``line`` is sorted by corners."""
        last = line.first[1:] - 1
        thick = np.maximum.reduceat(line.above, line.first[:-1]) if len(last) else np.empty(0)
        step = np.zeros(len(line.point))
        step[:-1] = np.linalg.norm(np.diff(line.point, axis=0), axis=1)
        axis = np.repeat(np.arange(len(last)), np.diff(line.first))
        rough = (thick >= FROM)[axis]
        rough[last] = False
        times = np.where(rough, np.ceil(step * self.rings / self.size), 1).astype(np.int64)
        times = np.maximum(times, 1)
        node, number = numbered(times)
        part = number / times[node]
        onward = np.minimum(node + 1, len(times) - 1)
        point = line.point[node] + part[:, None] * (line.point[onward] - line.point[node])
        between = line.above[node] + part * (line.below[onward] - line.above[node])
        below = np.where(part == 0, line.below[node], between)
        first = np.concatenate([[0], np.cumsum(times)[last]])
        return Line(first, point, below, between, line.order, line.sides)

    def factor(
        self, corners: int, radius: np.ndarray, metres: np.ndarray, axis: int, stem: bool
    ) -> np.ndarray:
        """(R, corners) radii over their means, of rings of one axis.

        radius, metres : (R,) of rings, and how far along the axis they are. stem : it stands on roots.
        """
        rng = stream(self.seed, "relief", axis)
        angle = 2 * np.pi * np.arange(corners) / corners
        f = 1 + self._oval(angle, metres, rng)
        depth = self.depth * np.minimum(radius / FULL, 1.0)
        share = metres / max(float(metres[-1]), 1e-9) - self.upper_from
        share = np.clip(share / 0.15, 0.0, 1.0)
        depth = depth * (1 - 0.85 * share)
        if self.depth > 0:
            ridges = self._ridges(angle, metres, float(radius.max()), rng)
            low = ridges - ridges.mean(axis=1, keepdims=True)
            f = f + low * np.minimum(depth / np.maximum(radius, 1e-9), DEEPEST)[:, None]
        if stem and self.highest(float(radius[0])):
            f = f + self._rooted(angle, metres / self.highest(float(radius[0])), axis)
        area = np.mean(f * np.roll(f, 1, axis=1), axis=1)
        return np.asarray(f / np.sqrt(area)[:, None])

    def _rooted(self, angle: np.ndarray, up: np.ndarray, axis: int) -> np.ndarray:
        """(R, N) relief of roots, over the radius, at shares (R,) of the height where the highest ends."""
        rng = stream(self.seed, "roots", axis)
        many = int(rng.integers(*ROOTS))
        way = 2 * np.pi * (np.arange(many) + 0.6 * rng.random(many)) / many
        total = np.zeros((len(up), len(angle)))
        for at, size, tall in zip(way, *rng.uniform(0.5, 1.0, (2, many)), strict=True):
            left = np.clip(1 - up / tall, 0.0, 1.0)[:, None] ** 3
            total += size * left * np.exp(SHARP * (np.cos(angle - at + 0.5 * up[:, None]) - 1))
        return self.roots * total

    def _oval(self, angle: np.ndarray, metres: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Oval cross-sections, and the weaker third and fourth harmonics that stems have."""
        total = np.zeros((len(metres), len(angle)))
        for order, share in ((2, 0.5), (3, 0.12), (4, 0.06)):
            phase, wander = rng.uniform(0, 2 * np.pi, 2)
            turn = phase + TURNS / 0.7 * np.sin(0.7 * metres + wander)
            total += self.ovality * share * np.cos(order * (angle - turn[:, None] / order))
        return total

    def _ridges(
        self, angle: np.ndarray, metres: np.ndarray, thick: float, rng: np.random.Generator
    ) -> np.ndarray:
        """(R, N) from 0 in furrows to 1 on ridges."""
        many = max(3, round(2 * np.pi * thick / self.size))
        if self.texture == "furrowed":
            return _lozenges(angle, metres, many, self.size, rng)
        if self.texture == "smooth":
            return _waves(angle, metres, self.size, rng)
        if self.texture == "peeling":
            foot = np.exp(-((metres / 1.2) ** 2))[:, None]
            cracked = _lozenges(angle, metres, many, self.size, rng)
            return np.asarray(foot * cracked + (1 - foot) * (0.4 * _waves(angle, metres, 0.1, rng)))
        tall = 2.0 if self.texture == "plated" else 1.4
        return _plates(angle, metres, many, self.size * tall, rng)


def _waves(
    angle: np.ndarray, metres: np.ndarray, size: float, rng: np.random.Generator
) -> np.ndarray:
    """(R, N) from 0 to 1: a few long waves."""
    total = np.zeros((len(metres), len(angle)))
    for order in range(2, 8):
        along = rng.uniform(-1, 1) / (4 * size)
        total += np.cos(order * angle + along * metres[:, None] + rng.uniform(0, 2 * np.pi)) / order
    return np.asarray(0.5 + total / 3)


def _lozenges(
    angle: np.ndarray, metres: np.ndarray, many: int, size: float, rng: np.random.Generator
) -> np.ndarray:
    """(R, N): furrows of two families that lean either way and wander, so that ridges part and meet."""
    families = []
    for lean in (1.0, -1.0):
        wander = np.zeros((len(metres), len(angle)))
        for order in (0, 1, 2, 3):
            along = rng.uniform(0.5, 1.5) / (3 * size)
            phase = order * angle + along * metres[:, None] + rng.uniform(0, 2 * np.pi)
            wander += 0.7 * np.sin(phase)
        half = 0.5 * many * angle if many % 2 == 0 else 0.5 * (many + 1) * angle
        families.append(np.abs(np.sin(half + lean * np.pi * metres[:, None] / (7 * size) + wander)))
    return np.asarray(np.minimum(*families) ** 0.6)


def _plates(
    angle: np.ndarray, metres: np.ndarray, many: int, tall: float, rng: np.random.Generator
) -> np.ndarray:
    """(R, N): plates around strewn points, furrows where two are equally near, each of its own height."""
    rows = int(np.ceil(float(metres.max(initial=0.0)) / tall)) + 3
    jitter = rng.uniform(-0.38, 0.38, (2, rows, many))
    high = rng.uniform(0.75, 1.0, (rows, many))
    x, y = angle / (2 * np.pi) * many, metres / tall + 1
    cell_x, cell_y = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    first = np.full((len(y), len(x)), np.inf)
    second, best = first.copy(), np.ones_like(first)
    for dy in (-1, 0, 1):
        row = np.clip(cell_y + dy, 0, rows - 1)
        for dx in (-1, 0, 1):
            column = (cell_x + dx) % many
            at = row[:, None], column[None]
            stagger = 0.5 * (row % 2)[:, None]
            away_x = cell_x[None] + dx + 0.5 + 0.6 * stagger + jitter[0][at] - x[None]
            away_y = (cell_y + dy)[:, None] + 0.5 + jitter[1][at] - y[:, None]
            far = np.hypot(away_x, away_y)
            nearer = far < first
            second = np.where(nearer, first, np.minimum(second, far))
            best = np.where(nearer, high[at], best)
            first = np.where(nearer, far, first)
    edge = np.clip((second - first) / 0.3, 0.0, 1.0)
    return np.asarray(best * edge * (2 - edge))


STEP = 1e-12  # metres between two radii of a node from which it has two rings
POINTED = 2e-5  # metres; a thinner tip is a point: float32 would flatten its ring


def tube_edges(n: int, wall: np.ndarray, feet: np.ndarray, tips: np.ndarray, rings: int) -> Edges:
    """Edges of a group of tubes with rings of n corners, their triangles in the order of ``meshing``.

    wall : (W,) rings with a wall above, counted within the group.
    feet, tips : (A,) first and last ring of each tube.

    Every ring has 3n edges: those around it, and the upright and the slanted ones of the wall above.
    Above a last ring there is no wall: there the spokes of the tip and of the foot take their place.
    """
    corner = np.arange(n, dtype=np.int32)
    following = (corner + 1) % n
    count = len(feet)
    around, upright, slanted = corner, n + corner, 2 * n + corner

    pattern = np.concatenate(
        [
            np.stack([corner, following], axis=1),
            np.stack([corner, n + corner], axis=1),
            np.stack([corner, n + following], axis=1),
        ]
    )  # (3n, 2)
    ends = pattern + (n * np.arange(rings, dtype=np.int32))[:, None, None]
    middle = (n * rings + np.arange(count, dtype=np.int32))[:, None]
    ends[tips, n : 2 * n, 1] = middle + count
    ends[tips, 2 * n :, 0] = middle
    ends[tips, 2 * n :, 1] = (n * feet.astype(np.int32))[:, None] + corner

    pattern = np.stack(
        [around, upright[following], slanted, slanted, 3 * n + around, upright], axis=1
    ).reshape(-1)  # (6n,)
    of_corner = np.empty((2 * n * (len(wall) + count), 3), dtype=np.int32)
    below = (3 * n * wall).astype(np.int32)
    np.add(below[:, None], pattern, out=of_corner[: 2 * n * len(wall)].reshape(-1, 6 * n))
    fans = of_corner[2 * n * len(wall) :].reshape(2, count, 3 * n)
    first = (3 * n * feet).astype(np.int32)[:, None]
    last = (3 * n * tips).astype(np.int32)[:, None]
    np.add(last, np.repeat(upright, 3), out=fans[1])
    fans[1, :, 1::3], fans[1, :, 2::3] = last + around, last + upright[following]
    np.add(last, np.repeat(slanted, 3), out=fans[0])
    fans[0, :, 0::3], fans[0, :, 1::3] = last + slanted[following], first + around
    return Edges(ends.reshape(-1, 2), of_corner)


def repeated_edges(
    triangles: np.ndarray,
    corners: int,
    times: int,
    first: Edges | Callable[[], Edges] | None = None,
    vertex: int = 0,
) -> Edges:
    """Edges of a shape (F, 3) with so many corners that is there so many times, one after the other.

    first : edges that come before them, of ``vertex`` vertices, or what makes those.
    """
    first = first() if callable(first) else first
    ahead = np.stack([triangles, triangles[:, [1, 2, 0]]], axis=2).reshape(-1, 2)  # (3F, 2)
    low, high = ahead.min(axis=1).astype(np.int64), ahead.max(axis=1)
    base = int(high.max(initial=0)) + 1
    keys, index = np.unique(low * base + high, return_inverse=True)  # quicker than unique rows
    ends = np.stack(np.divmod(keys, base), axis=1).reshape(-1).astype(np.int32)
    before = np.empty((0, 2), np.int32) if first is None else first.ends
    turns = np.empty((0, 3), np.int32) if first is None else first.of_corner
    index = index.reshape(-1).astype(np.int32)
    copy = np.arange(times, dtype=np.int32)[:, None]
    own_ends = (ends + (vertex + corners * copy)).reshape(-1, 2)
    own_turns = (index + (len(before) + len(keys) * copy)).reshape(-1, 3)
    return Edges(
        np.concatenate([before, own_ends], dtype=np.int32),
        np.concatenate([turns, own_turns], dtype=np.int32),
    )


def sides_for(radius: float, tolerance: float) -> int:
    """Corners of a ring that stays within ``tolerance`` metres of a circle of ``radius`` metres."""
    return int(np.clip(np.ceil(np.pi / np.arccos(1 - min(tolerance / radius, 0.9))), 3, 64))


def tube(points: np.ndarray, radius: np.ndarray, sides: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (P·sides + 2, 3) and triangles (T, 3) of a tube with closed ends, facing outwards.

    points : (P, 3) the axis, P >= 2, no two neighbours equal.
    radius : (P,) metres.
    """
    count = len(points)
    step = unit(np.diff(points, axis=0))
    between = step[:-1] + step[1:]
    sharp = np.linalg.norm(between, axis=1) < 1e-6  # the line turns back on itself: keep its way
    between[sharp] = step[:-1][sharp]
    tangent = unit(np.concatenate([step[:1], between, step[-1:]]))

    around = np.empty((count, 3))
    around[0] = _across(tangent[0])
    for ring in range(1, count):  # parallel transport: keep the last direction, made normal again
        kept = around[ring - 1] - around[ring - 1] @ tangent[ring] * tangent[ring]
        size = np.linalg.norm(kept)
        around[ring] = kept / size if size > 1e-9 else _across(tangent[ring])
    across = np.cross(tangent, around)

    angle = 2 * np.pi * np.arange(sides) / sides
    widened = radius * np.pi / (sides * np.sin(np.pi / sides))
    ring_points = points[:, None] + widened[:, None, None] * (
        np.cos(angle)[:, None] * around[:, None] + np.sin(angle)[:, None] * across[:, None]
    )
    vertices = np.concatenate([ring_points.reshape(-1, 3), points[:1], points[-1:]])

    triangles = np.empty((2 * sides * count, 3), dtype=np.int32)
    rings = np.arange(count)
    _triangulate(triangles, sides, 0, rings[:-1], rings[:1], rings[-1:], count * sides)
    return vertices, triangles


def _across(direction: np.ndarray) -> np.ndarray:
    """A unit vector at right angles to a unit direction."""
    normal = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    return np.asarray(normal / np.linalg.norm(normal))


def mesh_wood(
    skeleton: Skeleton,
    tolerance: float = 0.001,
    *,
    sunk: float = 0.0,
    relief: Relief | None = None,
) -> TriMesh:
    """The wood of a skeleton: closed tubes, facing outwards, in material slot 0.

    tolerance : metres between a ring and its circle, and between the tube and an axis whose nodes are
        so nearly in line that they are left out.
    sunk : metres that a root goes on below its start, so that no gap shows at the ground.
    relief : of the bark of thick axes; None: rings are round.

    Branches without a radius have no mesh. ``order`` of the result is that of each triangle's axis, and of
    texture coordinates u counts turns of about a metre around, v metres from the foot.
    """
    line = thin_nodes(lines_of(skeleton, tolerance, sunk, relief), tolerance)
    return _tubes(line if relief is None else relief.densified(line), relief)


@dataclass(frozen=True)
class _Rings:
    """R rings of A axes, axis by axis."""

    plane: np.ndarray  # (R, 9) centre, and what cosine and sine are multiplied by
    first: np.ndarray  # (A + 1,) first ring of each axis
    axis: np.ndarray  # (R,)
    wall: np.ndarray  # (R,) whether there is a wall above: not on the last ring of an axis
    metres: np.ndarray  # (R,) along the axis from its foot
    radius: np.ndarray  # (R,)


def _rings(line: Line) -> _Rings:
    """One ring around each node, two where the radius steps, none at a tip that is a point."""
    across, beside = ring_frames(line)
    last = line.first[1:] - 1
    times = 1 + (np.abs(line.below - line.above) > STEP)
    times[last] = line.below[last] > POINTED
    node = np.repeat(np.arange(len(times)), times)
    upper = np.diff(node, prepend=-1) == 0  # the second ring of its node
    radius = np.where(upper | (times[node] == 1), line.above[node], line.below[node])
    first = np.concatenate([[0], np.cumsum(times)[last]])
    axis = np.repeat(np.arange(len(line.sides)), np.diff(first))
    wall = np.ones(len(node), dtype=bool)
    wall[first[1:] - 1] = False
    around = line.sides[axis]
    widened = np.maximum(radius, POINTED) * (np.pi / (around * np.sin(np.pi / around)))
    plane = np.concatenate(
        [line.point[node], across[node] * widened[:, None], beside[node] * widened[:, None]], axis=1
    )
    metres = along_lines(line.point, line.first)[node]
    return _Rings(plane, first, axis, wall, metres, radius)


def _tubes(line: Line, relief: Relief | None) -> TriMesh:
    """Rings around nodes, walls between rings, a fan at each end."""
    sides, last = line.sides, line.first[1:] - 1
    rings = _rings(line)
    around = sides[rings.axis]
    vertices = np.empty((int(around.sum() + 2 * len(sides)), 3))
    count = int((2 * around[rings.wall]).sum() + 2 * sides.sum())
    triangles = np.empty((count, 3), dtype=np.int32)
    order = np.empty(count, dtype=np.int8)
    texture = np.empty((count, 3, 2), dtype=np.float32)
    thick = np.maximum.reduceat(line.above, line.first[:-1]) if len(sides) else np.empty(0)
    turns = np.maximum(np.rint(2 * np.pi * thick), 1.0)

    groups: list[tuple[Callable[[], Edges], int]] = []
    v = t = 0
    for n in np.unique(sides):
        a, b = np.searchsorted(sides, [n, n + 1])  # axes of this group, and their rings
        low, high = rings.first[a], rings.first[b]
        size, tubes = int(high - low), int(b - a)
        wall = np.flatnonzero(rings.wall[low:high])
        feet, tips = rings.first[a:b] - low, rings.first[a + 1 : b + 1] - 1 - low
        stop = t + 2 * n * (len(wall) + tubes)

        angle = 2 * np.pi * np.arange(n) / n
        circle = np.stack([np.ones(n), np.cos(angle), np.sin(angle)])  # (3, n)
        spread = np.einsum("pc,ij->picj", circle, np.eye(3)).reshape(9, 3 * n)
        middle = v + size * n
        np.matmul(rings.plane[low:high], spread, out=vertices[v:middle].reshape(size, 3 * n))
        if relief is not None:
            stem = line.order[a:b] == 0
            _roughen(vertices[v:middle].reshape(size, n, 3), rings, int(a), stem, relief)
        vertices[middle : middle + tubes] = line.point[line.first[a:b]]
        vertices[middle + tubes : middle + 2 * tubes] = line.point[last[a:b]]
        _triangulate(triangles[t:stop], n, v, wall, feet, tips, middle)
        groups.append((partial(tube_edges, n, wall, feet, tips, size), int(size * n + 2 * tubes)))

        own = line.order[a:b]
        order[t : t + 2 * n * len(wall)] = np.repeat(own[rings.axis[low:high][wall] - a], 2 * n)
        order[t + 2 * n * len(wall) : stop] = np.tile(np.repeat(own, n), 2)
        metres, turn = rings.metres[low:high], turns[rings.axis[low:high][wall]]
        above = np.minimum(wall + 1, size - 1)
        _texture(
            texture[t:stop],
            n,
            turn,
            metres[wall],
            metres[above],
            turns[a:b],
            metres[feet],
            metres[tips],
        )
        v, t = middle + 2 * tubes, stop

    return TriMesh(
        vertices=vertices,
        triangles=triangles,
        part=np.full(count, WOOD, dtype=np.int8),
        leaf=np.full(count, -1, dtype=np.int32),
        material=np.zeros(count, dtype=np.int32),
        uv=texture,
        order=order,
        edges=partial(join_edges, groups),  # only a Blender mesh needs them
    )


def _roughen(out: np.ndarray, rings: _Rings, first: int, stem: np.ndarray, relief: Relief) -> None:
    """Give rings (R, n, 3) of axes from ``first`` on, which have as many corners, the relief of their bark.

    stem : (A,) whether each axis is a stem.
    """
    low = rings.first[first]
    for axis, stands in enumerate(stem.tolist(), first):
        rows = slice(rings.first[axis] - low, rings.first[axis + 1] - low)
        mine = slice(rings.first[axis], rings.first[axis + 1])
        radius = rings.radius[mine]
        if not len(radius) or radius.max() < FROM:
            continue
        factor = relief.factor(out.shape[1], radius, rings.metres[mine], axis, stands)
        centre = rings.plane[mine, None, :3]
        out[rows] = centre + factor[:, :, None] * (out[rows] - centre)


def _triangulate(
    out: np.ndarray,
    n: int,
    vertex: int,
    wall: np.ndarray,
    feet: np.ndarray,
    tips: np.ndarray,
    middle: int,
) -> None:
    """Write a group's triangles into ``out``: walls, fans of feet, fans of tips.

    vertex : the group's first. middle : of its first foot; those of the tips follow on those of the feet.
    wall, feet, tips : rings, counted within the group.
    """
    corner = np.arange(n)
    following = (corner + 1) % n
    pattern = np.stack(
        [corner, following, n + following, corner, n + following, n + corner], axis=1
    ).reshape(-1)  # (6n,): two triangles a corner
    count = len(feet)
    walls, fans = out[: 2 * n * len(wall)], out[2 * n * len(wall) :].reshape(2, count, n, 3)
    np.add(
        (vertex + n * wall).astype(np.int32)[:, None],
        pattern.astype(np.int32),
        out=walls.reshape(-1, 6 * n),
    )
    ends = middle + np.arange(2 * count).reshape(2, count, 1)
    low, high = (vertex + n * feet)[:, None], (vertex + n * tips)[:, None]
    fans[..., 0] = ends
    fans[0, :, :, 1], fans[0, :, :, 2] = low + following, low + corner
    fans[1, :, :, 1], fans[1, :, :, 2] = high + corner, high + following


def _texture(
    out: np.ndarray,
    n: int,
    wall_turns: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    turns: np.ndarray,
    foot: np.ndarray,
    tip: np.ndarray,
) -> None:
    """Write texture coordinates of a group's walls, feet and tips into ``out`` (T, 3, 2)."""
    here = (np.arange(n) / n).astype(np.float32)
    there = here + np.float32(1 / n)
    walls = out[: len(low) * 2 * n].reshape(-1, n, 2, 3, 2)
    pattern = np.stack(
        [np.stack([here, there, there], 1), np.stack([here, there, here], 1)], axis=1
    )  # (n, 2, 3)
    np.multiply(wall_turns.astype(np.float32)[:, None, None, None], pattern, out=walls[..., 0])
    v = np.stack([low, low, high, low, high, high], axis=1).astype(np.float32)
    walls[..., 1] = v.reshape(-1, 1, 2, 3)
    ends = out[len(low) * 2 * n :].reshape(2, len(turns), n, 3, 2)
    middle = here + np.float32(0.5 / n)
    for end, fan, height in (
        (0, np.stack([middle, there, here], 1), foot),
        (1, np.stack([middle, here, there], 1), tip),
    ):
        ends[end, ..., 0] = turns[:, None, None] * fan
        ends[end, ..., 1] = height[:, None, None]
