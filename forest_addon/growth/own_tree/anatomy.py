"""A recognised tree taken apart so that it can be put together again, as it was or otherwise.

Every piece of wood is a course (``lines``) that leaves its parent at a seat: a place on the parent's line, an
azimuth, an angle and a roll in its frame there, and how far off its axis the foot is. Every vertex is
held by the two stretches of its piece nearest to it, and every leaf by the stretch it sits on, so the
mesh follows wherever the lines are laid. Laid where they were, they give the tree itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...base.rows import lengths
from ...base.runs import Runs, bounds
from ...base.trimesh import LEAF, WOOD, TriMesh
from ..mesh.leaves import CopyStock, Leaves, measure_leaves
from ..skeleton import depths
from .lines import (
    STEEP,
    Lines,
    Seats,
    angles_in,
    find_bones,
    foot_frames,
    nearest,
    rolled,
    seats_on,
    share_of,
    unbend,
    upper_frames,
    walk,
)
from .recognise import CLOSER, Recognition
from .template import BARK_SLOT, LEAF_SLOT, turned_outwards

GROUND = np.eye(3)  # the frame that a trunk stands in


@dataclass(frozen=True, eq=False)
class TemplateWood:
    """The mesh of all pieces.

    stock : their mesh, each vertex seen from where it is on its line.
    stretch : (V,) of its line that it is on. part : (V,) how far along that.
    bone : (V,) the first of the two stretches that turn it, its own and the nearer next one.
    weight : (V,) how much the second turns it.
    """

    stock: CopyStock
    stretch: np.ndarray
    part: np.ndarray
    bone: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True, eq=False)
class Foliage:
    """L leaves, sorted by the piece that bears them.

    stock : their mesh, each leaf seen from where it hangs.
    foot : (L, 3) where it hangs. of_piece : the leaves of each piece. truth : their measures.
    """

    stock: CopyStock
    foot: np.ndarray
    bearer: np.ndarray
    seat: Seats
    of_piece: Runs
    truth: Leaves


@dataclass(frozen=True, eq=False)  # one tree is another only if it is the same object
class Anatomy:
    """C pieces of wood and L leaves of one tree, metres, the trunk standing at the origin, z up.

    parent : (C,) the piece that each one hangs on, -1 for what stands on the ground.
    order : (C,) 0 for the trunk, 1 for first-level branches, ...
    lines, bend : courses of the pieces.
    seat : where each one's foot sits on its parent's line; ``aside`` is from its azimuth on.
    azimuth, angle, roll : (C,) how it leaves the parent. carried : (C,) see ``foot_frames``.
    """

    parent: np.ndarray
    order: np.ndarray
    lines: Lines
    bend: np.ndarray
    seat: Seats
    azimuth: np.ndarray
    angle: np.ndarray
    roll: np.ndarray
    carried: np.ndarray
    wood: TemplateWood
    foliage: Foliage

    @property
    def count(self) -> int:
        """C, the number of pieces."""
        return len(self.parent)

    @property
    def trunks(self) -> np.ndarray:
        """Pieces that stand on the ground, the trunk first."""
        ones = np.flatnonzero(self.order == 0)
        return np.asarray(ones[np.argsort(self.seat.away[ones], kind="stable")])

    def share(self) -> np.ndarray:
        """(C,) seat of each piece as a share of its parent's line; 0 on the ground."""
        return share_of(self.lines, self.parent, self.seat)

    def foot_radius(self) -> np.ndarray:
        """(C,) radius of each piece at its foot."""
        return self.lines.radius[self.lines.first[:-1] + np.arange(self.count)]


def dissect(found: Recognition, metres: float = 1.0) -> Anatomy:
    """Take a recognised tree apart.

    metres : in one unit of what was recognised.
    """
    origin = found.origin
    parent = found.parent
    order = depths(parent)
    place = (found.wood.vertices - origin) * metres
    lines, direction, stretch, part = find_bones(found, place, origin, metres)
    feet = lines.knot[lines.first[:-1] + np.arange(len(parent))]

    frame = np.empty((len(lines.length), 3, 3))
    bend = np.zeros((len(lines.length), 2))
    seat = Seats(np.zeros(len(parent), np.int64), *np.zeros((4, len(parent))))
    azimuth, angle, roll = np.zeros((3, len(parent)))
    carried = np.ones(len(parent), dtype=bool)
    for level in range(int(order.max(initial=0)) + 1):
        here = np.flatnonzero(order == level)
        bearer = parent[here]
        if level:
            found_seat = seats_on(lines, bearer, feet[here], frame)
            for name in ("stretch", "part", "away", "aside", "along"):
                getattr(seat, name)[here] = getattr(found_seat, name)
            parents = frame[lines.first[bearer] + found_seat.stretch]
        else:  # trunks stand on the ground, off the origin where there are several
            parents = np.tile(GROUND, (len(here), 1, 1))
            seat.away[here] = np.hypot(feet[here, 0], feet[here, 1])
            seat.aside[here] = np.arctan2(feet[here, 1], feet[here, 0])
            seat.along[here] = feet[here, 2]
        heading = direction[lines.first[here]]
        azimuth[here], angle[here] = angles_in(parents, heading)
        seat.aside[here] -= azimuth[here]
        plain = foot_frames(parents, azimuth[here], angle[here], np.zeros(len(here)), carried[here])
        if level:
            carried[here] = np.abs(heading[:, 2]) >= STEEP
            level_ones = np.flatnonzero(~carried[here])
            upper = plain.copy()
            upper[level_ones] = upper_frames(heading[level_ones])
            roll[here] = rolled(plain, upper)
        else:
            roll[here] = -azimuth[here]  # the least turn from upright
        start = foot_frames(parents, azimuth[here], angle[here], roll[here], carried[here])
        rows, _, _ = Runs.at(lines.first).copy(here)
        laid, bent = unbend(direction[rows], bounds(np.diff(lines.first)[here]), start)
        frame[rows], bend[rows] = laid, bent
    lines = replace(lines, knot=walk(frame, lines.length, lines.first, feet), frame=frame)
    return Anatomy(
        parent=parent,
        order=order,
        lines=lines,
        bend=bend,
        seat=seat,
        azimuth=azimuth,
        angle=angle,
        roll=roll,
        carried=carried,
        wood=_wood(found, lines, place, stretch, part),
        foliage=_foliage(found, lines, origin, metres),
    )


def _wood(
    found: Recognition, lines: Lines, place: np.ndarray, stretch: np.ndarray, part: np.ndarray
) -> TemplateWood:
    """The mesh of the pieces, each vertex turned by the stretch that it is on and by the nearer next."""
    order = np.argsort(found.wood.piece, kind="stable")
    owner = found.wood.piece_of_vertex.astype(np.int64)
    last = np.diff(lines.first)[owner] - 1
    towards_next = (part >= 0.5) & (stretch < last)
    from_before = (part < 0.5) & (stretch > 0)
    on_line, _ = lines.at(owner, stretch, part)
    return TemplateWood(
        stock=CopyStock.of(place - on_line, owner, turned_outwards(found)[order], WOOD, BARK_SLOT),
        stretch=stretch,
        part=part,
        bone=stretch - from_before,
        weight=np.where(towards_next, part - 0.5, np.where(from_before, part + 0.5, 0.0)),
    )


def _foliage(found: Recognition, lines: Lines, origin: np.ndarray, metres: float) -> Foliage:
    """The leaves by bearer; a leaf hangs by its corner or middle of an edge nearest to that."""
    count = found.leaves.count
    place = (found.leaves.vertices - origin) * metres
    by_bearer = np.argsort(found.bearer, kind="stable")
    number = np.empty(count, np.int64)
    number[by_bearer] = np.arange(count)
    bearer = found.bearer[by_bearer].astype(np.int64)

    leaf_of_vertex = number[found.leaves.piece_of_vertex] if count else np.empty(0, np.int64)
    leaf_of_triangle = number[found.leaves.piece] if count else np.empty(0, np.int64)
    vertex_order = np.argsort(leaf_of_vertex, kind="stable")
    renamed = np.empty(len(place), np.int64)
    renamed[vertex_order] = np.arange(len(place))
    triangle_order = np.argsort(leaf_of_triangle, kind="stable")
    triangles = renamed[found.leaves.triangles[triangle_order]]
    place, leaf_of_vertex = place[vertex_order], leaf_of_vertex[vertex_order]
    mesh = TriMesh.of_part(place, triangles, LEAF)
    mesh.leaf[:] = leaf_of_triangle[triangle_order]
    truth = measure_leaves(mesh, np.full(count, -1))

    ends = renamed[found.leaves.edges] if count else np.empty((0, 2), np.int64)
    foot = _feet(lines, bearer, place, leaf_of_vertex, ends)
    hanging = mesh.vertices - foot[leaf_of_vertex]
    return Foliage(
        stock=CopyStock.of(hanging, leaf_of_vertex, mesh.triangles, LEAF, LEAF_SLOT),
        foot=foot,
        bearer=bearer,
        seat=seats_on(lines, bearer, foot),
        of_piece=Runs.of(bearer, len(found.parent)),
        truth=truth,
    )


def _feet(
    lines: Lines, bearer: np.ndarray, place: np.ndarray, leaf: np.ndarray, ends: np.ndarray
) -> np.ndarray:
    """(L, 3) of the corners (V, 3) of each leaf and the middles of its edges (E, 2) the place nearest to
    the surface of its bearer's line.

    The middle of an edge is nearer than its far end by half its length at most, so most are out of the
    question.
    """
    if not len(place):
        return np.empty((0, 3))
    gap = _gaps(lines, bearer[leaf], place)
    least = np.minimum.reduceat(gap, np.flatnonzero(np.diff(leaf, prepend=-1)))
    one, other = ends.T
    half = lengths(place[one] - place[other]) / 2
    may = np.maximum(gap[one], gap[other]) - CLOSER * half <= least[leaf[one]]
    one, other = one[may], other[may]
    middle = (place[one] + place[other]) / 2
    points, owner = np.concatenate([place, middle]), np.concatenate([leaf, leaf[one]])
    gap = np.concatenate([gap, _gaps(lines, bearer[leaf[one]], middle)])
    ranked = np.lexsort((gap, owner))
    size = np.bincount(owner)
    return np.asarray(points[ranked[np.cumsum(size) - size]])


def _gaps(lines: Lines, line: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(N,) how far points (N, 3) are off the surface of their line, 0 within."""
    stretch, part = nearest(lines, line, point)
    part = np.clip(part, 0.0, 1.0)
    knot = lines.first[line] + stretch + line
    start, way = lines.knot[knot], lines.knot[knot + 1] - lines.knot[knot]
    radius = lines.radius[knot] + part * (lines.radius[knot + 1] - lines.radius[knot])
    return np.maximum(lengths(point - start - part[:, None] * way) - radius, 0.0)
