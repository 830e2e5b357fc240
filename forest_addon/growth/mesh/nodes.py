"""The nodes of a skeleton's axes, as a mesher wants them: sorted, with joints, none spare; and their rings.

Axes come sorted by the number of corners their rings get, so that rings of equal n lie together. Segments
without a length and axes without a radius are passed over. A branch starts on its parent's axis, so its
foot is inside the parent; where the parent ends in a fork, or is thinner than the branch, it starts one node
earlier, within the parent and along it: it bends out of the parent, and no wedge opens between them. Nodes
that the line passes within the tolerance anyway are left out.

From one segment to the next a frame takes the smallest turn that brings the direction over (parallel
transport), so nothing twists. At a bend the ring lies in the bisecting plane and is stretched there by 1/cos
of half the bend: that is where two cylinders really meet, and the tube keeps its thickness and its volume.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...base.vectors import cross_rows
from ..draw import GOLDEN
from ..skeleton import TOUCH, Skeleton, find_axes

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
    corners: Callable[[np.ndarray], np.ndarray] | None = None,
) -> Line:
    """Nodes of every axis that has a length and a radius, polygons of fewest corners first.

    corners : how many rings of radii (A,) have at least.
    """
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
    if corners is not None:
        sides = np.maximum(sides, corners(thick))
    size = np.bincount(axis, minlength=len(axes))
    rank = np.argsort(sides, kind="stable")
    rank = rank[size[rank] > 0]
    size, start = size[rank], (np.cumsum(size) - size)[rank]
    segment = segment[np.repeat(start - (np.cumsum(size) - size), size) + np.arange(size.sum())]
    sides, order = sides[rank], skeleton.order[axes.segment[axes.first[:-1]]][rank]

    foot = np.cumsum(size) - size
    inner, inner_point, inner_radius = _inner(
        skeleton, length, segment[foot], axes.segment, sunk, tolerance
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
    chain: np.ndarray,
    sunk: float,
    tolerance: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tell whether each axis (A,) starts a ring earlier, where, and how wide it may be there.

    foot : (A,) first segment of each axis. chain : (S,) all segments, axis by axis.
    """
    parent = np.maximum(skeleton.parent[foot], 0)
    root = skeleton.parent[foot] < 0
    way = skeleton.end[parent] - skeleton.start[parent]
    way = np.where(root[:, None], skeleton.end[foot] - skeleton.start[foot], way)
    long = np.where(root, length[foot], length[parent])

    at_end = np.abs(skeleton.start[foot] - skeleton.end[parent]).max(axis=1, initial=0.0) <= TOUCH
    order_after = np.full(len(chain), -1, dtype=np.int64)
    order_after[chain[:-1]] = chain[1:]
    onward = order_after[
        parent
    ]  # the next in the chain continues the parent if it is a child of it
    continued = (
        (onward >= 0)
        & (skeleton.parent[onward] == parent)
        & (skeleton.order[onward] == skeleton.order[parent])
        & (np.abs(skeleton.start[onward] - skeleton.end[parent]).max(axis=1, initial=0.0) <= TOUCH)
    )
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
