"""A recognised tree taken apart so that it can be put together again, as it was or otherwise.

Every piece of wood is a course (``courses``) that leaves its mother at a seat: a place on her line, an
azimuth, an angle and a roll in her frame there, and how far off her axis its foot is. Every vertex is
held by the two stretches of its piece nearest to it, and every leaf by the stretch it sits on, so the
mesh follows wherever the lines are laid. Laid where they were, they give the tree itself.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from scipy.spatial import cKDTree

from ..mesh.leaves import Leaves, measure_leaves
from ..mesh.trimesh import LEAF, WOOD, TriMesh
from .copies import Stock
from .courses import STEEP, angles_in, foot_frames, rolled, unbend, upper_frames, walk
from .cut import BARK_SLOT, LEAF_SLOT, turned_outwards
from .recognise import Recognition
from .runs import Runs, bounds

STRAIGHT = np.deg2rad(12.0)  # of bend that one stretch stands for
OFF_AXIS = 0.1  # radii that a chord may be off its line
FEWEST = 4  # stretches of a branch
GROUND = np.eye(3)  # the frame that a trunk stands in


@dataclass(frozen=True)
class Lines:
    """C polylines from foot to tip; ``first`` (C + 1,) counts stretches, of which there are S.

    A line has one knot more than stretches, so that stretch s of line c runs from knot s + c on.
    """

    first: np.ndarray
    knot: np.ndarray  # (S + C, 3)
    radius: np.ndarray  # (S + C,)
    length: np.ndarray  # (S,)
    frame: np.ndarray  # (S, 3, 3)

    @property
    def line(self) -> np.ndarray:
        """(S,) line of each stretch."""
        size = np.diff(self.first)
        return np.repeat(np.arange(len(size)), size)

    def reach(self) -> np.ndarray:
        """(C,) length of each line."""
        return np.add.reduceat(self.length, self.first[:-1])


@dataclass(frozen=True)
class Seats:
    """Where N things sit on a line.

    stretch : (N,) of their line, from 0. part : (N,) how far along it, 0 .. 1.
    away : (N,) how far off the axis. aside : (N,) radians about T, from N, where that is.
    along : (N,) beyond the end of the line, along T.
    """

    stretch: np.ndarray
    part: np.ndarray
    away: np.ndarray
    aside: np.ndarray
    along: np.ndarray

    def take(self, rows: np.ndarray) -> Seats:
        """Those of some rows."""
        return Seats(**{f.name: getattr(self, f.name)[rows] for f in fields(Seats)})


@dataclass(frozen=True, eq=False)
class Wood:
    """The mesh of all pieces.

    bone : (V,) the first of the two stretches that hold a vertex, within its piece.
    weight : (V,) how much the next one holds it.
    """

    stock: Stock
    bone: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True, eq=False)
class Foliage:
    """L leaves, sorted by the piece that bears them.

    stock : their mesh, each leaf seen from where it hangs.
    foot : (L, 3) where it hangs. of_piece : the leaves of each piece. truth : their measures.
    """

    stock: Stock
    foot: np.ndarray
    bearer: np.ndarray
    seat: Seats
    of_piece: Runs
    truth: Leaves


@dataclass(frozen=True, eq=False)  # one tree is another only if it is the same object
class Anatomy:
    """C pieces of wood and L leaves of one tree, metres, the trunk's foot at the origin, z up.

    parent : (C,) the piece that each one hangs on, -1 for what stands on the ground.
    order : (C,) 0 for the trunk, 1 for first-level branches, ...
    lines, bend : courses of the pieces.
    seat : where each one's foot sits on its mother's line; ``aside`` is from its azimuth on.
    azimuth, angle, roll : (C,) how it leaves her. carried : (C,) see ``foot_frames``.
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
    wood: Wood
    foliage: Foliage

    @property
    def count(self) -> int:
        """C, the number of pieces."""
        return len(self.parent)

    def share(self) -> np.ndarray:
        """(C,) seat of each piece as a share of its mother's line; 0 on the ground."""
        return share_of(self.lines, self.parent, self.seat)

    def foot_radius(self) -> np.ndarray:
        """(C,) radius of each piece at its foot."""
        return self.lines.radius[self.lines.first[:-1] + np.arange(self.count)]


def share_of(lines: Lines, line: np.ndarray, seat: Seats) -> np.ndarray:
    """(N,) seats as a share of the length of the lines (N,) that they are on; 0 where there is none."""
    on = np.maximum(line, 0)
    before = np.cumsum(lines.length) - lines.length
    stretch = lines.first[on] + seat.stretch
    place = before[stretch] - before[lines.first[on]] + seat.part * lines.length[stretch]
    return np.where(line < 0, 0.0, place / lines.reach()[on])


def dissect(found: Recognition, metres: float = 1.0) -> Anatomy:
    """Take a recognised tree apart.

    metres : in one unit of what was recognised.
    """
    origin = found.foot[found.trunk]
    parent = found.parent
    order = _orders(parent)
    lines, direction = _lines(found, origin, metres)
    feet = lines.knot[lines.first[:-1] + np.arange(len(parent))]

    frame = np.empty((len(lines.length), 3, 3))
    bend = np.zeros((len(lines.length), 2))
    seat = Seats(np.zeros(len(parent), np.int64), *np.zeros((4, len(parent))))
    azimuth, angle, roll = np.zeros((3, len(parent)))
    carried = np.ones(len(parent), dtype=bool)
    for level in range(int(order.max(initial=0)) + 1):
        here = np.flatnonzero(order == level)
        mother = parent[here]
        if level:
            found_seat = seats_on(lines, mother, feet[here], frame)
            for name in ("stretch", "part", "away", "aside", "along"):
                getattr(seat, name)[here] = getattr(found_seat, name)
            mothers = frame[lines.first[mother] + found_seat.stretch]
        else:  # trunks stand on the ground, off the origin where there are several
            mothers = np.tile(GROUND, (len(here), 1, 1))
            seat.away[here] = np.hypot(feet[here, 0], feet[here, 1])
            seat.aside[here] = np.arctan2(feet[here, 1], feet[here, 0])
            seat.along[here] = feet[here, 2]
        heading = direction[lines.first[here]]
        azimuth[here], angle[here] = angles_in(mothers, heading)
        seat.aside[here] -= azimuth[here]
        plain = foot_frames(mothers, azimuth[here], angle[here], np.zeros(len(here)), carried[here])
        if level:
            carried[here] = np.abs(heading[:, 2]) >= STEEP
            level_ones = np.flatnonzero(~carried[here])
            upper = plain.copy()
            upper[level_ones] = upper_frames(heading[level_ones])
            roll[here] = rolled(plain, upper)
        else:
            roll[here] = -azimuth[here]  # the least turn from upright
        start = foot_frames(mothers, azimuth[here], angle[here], roll[here], carried[here])
        rows, _, _ = Runs.at(lines.first).copy(here)
        laid, bent = unbend(direction[rows], bounds(np.diff(lines.first)[here]), start)
        frame[rows], bend[rows] = laid, bent
    lines = Lines(lines.first, lines.knot, lines.radius, lines.length, frame)
    lines = Lines(
        lines.first, walk(frame, lines.length, lines.first, feet), lines.radius, lines.length, frame
    )
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
        wood=_wood(found, lines, origin, metres),
        foliage=_foliage(found, lines, origin, metres),
    )


def seats_on(
    lines: Lines, line: np.ndarray, point: np.ndarray, frame: np.ndarray | None = None
) -> Seats:
    """The seats of points (N, 3) on the lines (N,) that they belong to.

    frame : (S, 3, 3) where those of ``lines`` are not known yet.
    """
    frame = lines.frame if frame is None else frame
    stretch, part = nearest(lines, line, point)
    part = np.clip(part, 0.0, 1.0)
    row = lines.first[line] + stretch
    start, end = lines.knot[row + line], lines.knot[row + line + 1]
    own = np.einsum("nij,ni->nj", frame[row], point - start - part[:, None] * (end - start))
    return Seats(
        stretch, part, np.hypot(own[:, 0], own[:, 1]), np.arctan2(own[:, 1], own[:, 0]), own[:, 2]
    )


def nearest(lines: Lines, line: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) stretch of their line that is nearest to points (N, 3), and (N,) how far along it.

    The nearest middle of a stretch is looked up with the line as a fourth coordinate; it and the
    stretches beside it are then tried exactly. A line goes straight on beyond its ends.
    """
    if not len(point):
        return np.empty(0, np.int64), np.empty(0)
    start = lines.knot[np.arange(len(lines.length)) + lines.line]
    way = lines.knot[np.arange(len(lines.length)) + lines.line + 1] - start
    apart = 4.0 * float(np.ptp(lines.knot, axis=0).max() + np.ptp(point, axis=0).max())
    tree = cKDTree(np.column_stack([start + way / 2, apart * lines.line]))
    guess = tree.query(np.column_stack([point, apart * line]), workers=-1)[1]
    low, high = lines.first[line], lines.first[line + 1] - 1
    squared = np.maximum(np.einsum("si,si->s", way, way), np.finfo(float).tiny)
    best = np.full(len(point), np.inf)
    stretch, share = np.zeros(len(point), np.int64), np.zeros(len(point))
    for offset in (-1, 0, 1):
        row = np.clip(guess + offset, low, high)
        from_start = point - start[row]
        part = np.einsum("ni,ni->n", from_start, way[row]) / squared[row]
        held = np.clip(part, 0.0, 1.0)
        gap = from_start - held[:, None] * way[row]
        distance = np.einsum("ni,ni->n", gap, gap)
        nearer = distance < best
        best = np.where(nearer, distance, best)
        stretch, share = np.where(nearer, row - low, stretch), np.where(nearer, part, share)
    return stretch, share


def _orders(parent: np.ndarray) -> np.ndarray:
    order, above = np.zeros(len(parent), np.int64), parent.copy()
    while (above >= 0).any():
        order += above >= 0
        above = np.where(above >= 0, parent[np.maximum(above, 0)], -1)
    return order


def _lines(found: Recognition, origin: np.ndarray, metres: float) -> tuple[Lines, np.ndarray]:
    """Lines from foot to tip without frames yet, and (S, 3) unit directions of their stretches."""
    first = found.lines.first
    size = np.diff(first)
    owner = np.repeat(np.arange(len(size)), size)
    rank = np.arange(first[-1]) - first[owner]
    backwards = found.hierarchy.foot_end[owner] == 1
    row = first[owner] + np.where(backwards, size[owner] - 1 - rank, rank)
    knot, radius = (found.lines.knot[row] - origin) * metres, found.lines.radius[row] * metres
    kept, size = _enough(knot, radius, first, found.parent < 0)
    knot, radius, first = knot[kept], radius[kept], bounds(size)
    owner = np.repeat(np.arange(len(size)), size)
    inner = np.ones(len(knot), dtype=bool)
    inner[first[1:] - 1] = False
    way = (knot[1:] - knot[:-1])[inner[:-1]]
    length = np.linalg.norm(way, axis=1)
    stretches = bounds(size - 1)
    direction = way / np.maximum(length, np.finfo(float).tiny)[:, None]
    broken = length < 1e-9  # no direction of its own: the line's
    whole = (knot[first[1:] - 1] - knot[first[:-1]])[owner[inner]]
    whole /= np.maximum(np.linalg.norm(whole, axis=1, keepdims=True), np.finfo(float).tiny)
    direction[broken] = whole[broken]
    direction[np.linalg.norm(direction, axis=1) < 0.5] = (0.0, 0.0, 1.0)
    return Lines(stretches, knot, radius, length, np.empty((0, 3, 3))), direction


def _enough(
    knot: np.ndarray, radius: np.ndarray, first: np.ndarray, trunk: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Knots to keep, evenly along each line, and (C,) how many: all of trunks, else as it is bent.

    A line of length l that bends by b in all is off n chords by about l·b/(8n²).
    """
    size = np.diff(first)
    owner = np.repeat(np.arange(len(size)), size)
    way = np.diff(knot, axis=0)
    length = np.linalg.norm(way, axis=1)
    way /= np.maximum(length, np.finfo(float).tiny)[:, None]
    bent = np.arccos(np.clip(np.einsum("ni,ni->n", way[1:], way[:-1]), -1.0, 1.0))
    within = owner[2:] == owner[:-2]
    total = np.bincount(owner[1:-1][within], bent[within], len(size))
    same = owner[1:] == owner[:-1]
    reach = np.bincount(owner[1:][same], length[same], len(size))
    thin = np.add.reduceat(radius, first[:-1]) / size
    off = np.sqrt(total * reach / (8 * OFF_AXIS * np.maximum(thin, 1e-9)))
    wanted = np.ceil(np.maximum(np.maximum(total / STRAIGHT, off), FEWEST)).astype(np.int64) + 1
    wanted = np.where(trunk, size, np.minimum(wanted, size))
    at = bounds(wanted)
    of = np.repeat(np.arange(len(size)), wanted)
    part = (np.arange(at[-1]) - at[of]) / (wanted[of] - 1)
    return first[of] + np.rint(part * (size[of] - 1)).astype(np.int64), wanted


def _wood(found: Recognition, lines: Lines, origin: np.ndarray, metres: float) -> Wood:
    """The mesh of the pieces, each vertex held by two stretches."""
    order = np.argsort(found.wood.piece, kind="stable")
    triangles = turned_outwards(found)[order]
    place = (found.wood.vertices - origin) * metres
    owner = found.wood.piece_of_vertex.astype(np.int64)
    stretch, part = nearest(lines, owner, place)
    part = np.clip(part, 0.0, 1.0)
    last = np.diff(lines.first)[owner] - 1
    towards_next = (part >= 0.5) & (stretch < last)
    from_before = (part < 0.5) & (stretch > 0)
    return Wood(
        stock=Stock.of(place, owner, triangles, WOOD, BARK_SLOT),
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
    points = np.concatenate([place, place[ends].mean(axis=1)])
    owner = np.concatenate([leaf_of_vertex, leaf_of_vertex[ends[:, 0]]])
    foot = points[_nearest_of_each(lines, bearer[owner], points, owner)]
    hanging = mesh.vertices - foot[leaf_of_vertex]
    return Foliage(
        stock=Stock.of(hanging, leaf_of_vertex, mesh.triangles, LEAF, LEAF_SLOT),
        foot=foot,
        bearer=bearer,
        seat=seats_on(lines, bearer, foot),
        of_piece=Runs.of(bearer, len(found.parent)),
        truth=truth,
    )


def _nearest_of_each(
    lines: Lines, line: np.ndarray, point: np.ndarray, owner: np.ndarray
) -> np.ndarray:
    """(L,) of the points (N, 3) of each owner the one nearest to the surface of their line (N,)."""
    if not len(point):
        return np.empty(0, np.int64)
    stretch, part = nearest(lines, line, point)
    part = np.clip(part, 0.0, 1.0)
    knot = lines.first[line] + stretch + line
    start, way = lines.knot[knot], lines.knot[knot + 1] - lines.knot[knot]
    gap = np.linalg.norm(point - start - part[:, None] * way, axis=1)
    gap -= lines.radius[knot] + part * (lines.radius[knot + 1] - lines.radius[knot])
    ranked = np.lexsort((np.maximum(gap, 0.0), owner))
    size = np.bincount(owner)
    return np.asarray(ranked[np.cumsum(size) - size])
