"""A recognised tree taken apart so that it can be put together again, as it was or otherwise.

Every piece of wood is a course that leaves its parent at a seat: a place on the parent's line, an azimuth, an
angle and a roll in its frame there, and how far off its axis the foot is. Every vertex is held by the two
stretches of its piece nearest to it, and every leaf by the stretch it sits on, so the mesh follows wherever
the lines are laid. Laid where they were, they give the tree itself.

A recognised centreline has many knots, evenly spaced. Kept are as many as it is bent, each moved to the
nearest place along the line where the piece has vertices. Between two rings of a tube there are none, so
its mesh runs straight there and so does the line; what hangs on the line then hangs on the mesh. A piece
with two rings is one stretch and stays straight.

The lowest ring of a limb's mesh is held against the mesh of what bears it. A place is inside its bearer
where it lies on the axis' side of the nearest place on the bearer's bark and behind the triangle there;
where the two do not agree, or beyond the axis' ends, the winding number tells.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from ...base.rows import RowTable, lengths
from ...base.runs import Runs, bounds, numbered
from ...base.trimesh import LEAF, WOOD, TriMesh
from ...base.vectors import (
    azimuth_of,
    column,
    cross_rows,
    nearest_on_triangles,
    unit,
    winding_number,
)
from ..mesh.leaves import CopyStock, Leaves, measure_leaves
from ..mesh.meshing import tube
from ..skeleton import depths
from .lines import (
    STEEP,
    Lines,
    Seats,
    foot_frames,
    nearest,
    seats_on,
    share_of,
    unbend,
    upper_frames,
    walk,
)
from .recognise import CLOSER, Recognition
from .template import BARK_SLOT, LEAF_SLOT, turned_outwards

STRAIGHT = np.deg2rad(12.0)  # of bend that one stretch stands for
OFF_AXIS = 0.1  # radii that a chord may be off its line
FEWEST = 4  # stretches of a branch
THINNEST = 1e-5  # metres, of what a coarse mesh leaves no thickness
SHORTEST = 0.02  # of a line's length; nearer knots are one
SIDES = 8  # of a tube that bridges a gap
OFF = 5e-3  # metres off its bearer's mesh from which a ring is moved or bridged
BORDER = 2.0  # radii from the foot within which a border is that of the foot
CLOSED = 0.1  # radii from the foot within which corners of a closed tube are its lowest ring
APART = 1e3  # metres from one bearer to the next, where samples are looked up
NEAREST = 8  # samples of triangles looked at, for each place
SLIM = 0.6  # of its bearer's radius, that such a tube is thick there at most


def find_bones(
    found: Recognition, place: np.ndarray, origin: np.ndarray, metres: float
) -> tuple[Lines, np.ndarray, np.ndarray, np.ndarray]:
    """Lines from foot to tip, without frames yet, and where vertices are along them.

    place : (V, 3) vertices of the wood, metres from the origin.

    Returns
    -------
    The lines; (S, 3) unit directions of their stretches; (V,) stretch of its line that each vertex is on;
    (V,) how far along it, 0 .. 1.
    """
    recognised, owner = found.lines, found.wood.piece_of_vertex.astype(np.int64)
    size = np.diff(recognised.first)
    piece, rank = numbered(size)
    backwards = found.foot_end[piece] == 1
    row = recognised.first[piece] + np.where(backwards, size[piece] - 1 - rank, rank)
    knot = (recognised.knot[row] - origin) * metres
    radius = np.maximum(recognised.radius[row] * metres, THINNEST)
    whole, _ = _through(knot, radius, recognised.first.astype(np.int64))  # each from its foot on
    stretch, part = nearest(whole, owner, place)
    along = _along(whole, owner, stretch, np.clip(part, 0.0, 1.0))
    line, share = _knots(whole, owner, along, trunk=found.parent < 0)
    size = np.bincount(line, minlength=len(whole.first) - 1)
    lines, direction = _through(*_at(whole, line, share), bounds(size))

    # Lines and vertices are laid one behind the other, so that one search does for all.
    spread = line + np.clip(share, 0.0, 0.999999)
    knot = np.searchsorted(spread, owner + np.clip(along, 0.0, 0.999999), side="right") - 1
    first = lines.first[owner] + owner
    knot = np.clip(knot, first, first + np.diff(lines.first)[owner] - 1)
    step = np.maximum(share[knot + 1] - share[knot], np.finfo(float).tiny)
    return lines, direction, knot - first, np.clip((along - share[knot]) / step, 0.0, 1.0)


def _through(knot: np.ndarray, radius: np.ndarray, first: np.ndarray) -> tuple[Lines, np.ndarray]:
    """Lines through knots, of which line c has first[c] .. first[c + 1] - 1; and (S, 3) directions."""
    size = np.diff(first)
    owner = np.repeat(np.arange(len(size)), size)
    inner = np.ones(len(knot), dtype=bool)
    inner[first[1:] - 1] = False
    way = (knot[1:] - knot[:-1])[inner[:-1]]
    length = np.linalg.norm(way, axis=1)
    direction = way / np.maximum(length, np.finfo(float).tiny)[:, None]
    broken = length < 1e-9  # no direction of its own: the line's
    whole = unit(knot[first[1:] - 1] - knot[first[:-1]])[owner[inner]]
    direction[broken] = whole[broken]
    direction[np.linalg.norm(direction, axis=1) < 0.5] = (0.0, 0.0, 1.0)
    return Lines(bounds(size - 1), knot, radius, length, np.empty((0, 3, 3))), direction


def _shares(lines: Lines) -> np.ndarray:
    """(S + C,) of every knot, how far along its line it is, 0 .. 1."""
    line = np.repeat(np.arange(len(lines.first) - 1), np.diff(lines.first) + 1)
    gone = np.zeros(len(line))
    gone[np.arange(len(lines.length)) + lines.line + 1] = lines.length
    total = np.cumsum(gone)
    begin = total[lines.first[:-1] + np.arange(len(lines.first) - 1)]
    reach = np.maximum(lines.reach(), np.finfo(float).tiny)
    return np.asarray(np.clip((total - begin[line]) / reach[line], 0.0, 1.0))


def _along(lines: Lines, line: np.ndarray, stretch: np.ndarray, part: np.ndarray) -> np.ndarray:
    """(N,) share of their line at which places are."""
    share = _shares(lines)
    knot = lines.first[line] + stretch + line
    return np.asarray(share[knot] + part * (share[knot + 1] - share[knot]))


def _at(lines: Lines, line: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Knots (N, 3) and radii (N,) at shares of lines, both ascending."""
    of_knot = np.repeat(np.arange(len(lines.first) - 1), np.diff(lines.first) + 1)
    place, wanted = 2.0 * of_knot + _shares(lines), 2.0 * line + share  # rises from line to line
    knot = np.stack([np.interp(wanted, place, axis) for axis in lines.knot.T], axis=1)
    return knot, np.interp(wanted, place, lines.radius)


def _knots(
    lines: Lines, owner: np.ndarray, along: np.ndarray, trunk: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Line and share of every knot that is kept, ascending."""
    count = len(lines.first) - 1
    # A line of length l that bends by b in all is off n chords by about l·b/(8n²); trunks keep all stretches.
    size, of = np.diff(lines.first), lines.line
    knot = np.arange(len(lines.length)) + of
    way = (lines.knot[knot + 1] - lines.knot[knot]) / np.maximum(lines.length, 1e-12)[:, None]
    bent = np.arccos(np.clip(np.einsum("ni,ni->n", way[1:], way[:-1]), -1.0, 1.0))
    within = of[1:] == of[:-1]
    total = np.bincount(of[1:][within], bent[within], count)
    thin = np.add.reduceat(lines.radius, lines.first[:-1] + np.arange(count)) / (size + 1)
    off = np.sqrt(total * lines.reach() / (8 * OFF_AXIS * np.maximum(thin, 1e-9)))
    wanted = np.ceil(np.maximum(np.maximum(total / STRAIGHT, off), FEWEST)).astype(np.int64)
    wanted = np.where(trunk, size, np.minimum(wanted, size))
    line = np.repeat(np.arange(count), wanted + 1)
    rank = np.arange(len(line)) - bounds(wanted + 1)[line]
    share = rank / wanted[line]
    # To the nearest place with vertices; 2 apart from line to line, and ends of lines are places too.
    ends = np.arange(count)
    places = np.sort(np.concatenate([2.0 * owner + along, 2.0 * ends, 2.0 * ends + 1.0]))
    aim = 2.0 * line + share
    after = np.clip(np.searchsorted(places, aim), 1, len(places) - 1)
    low, high = places[after - 1], places[after]
    snapped = np.where(aim - low <= high - aim, low, high) - 2.0 * line
    inside = (rank > 0) & (rank < wanted[line])
    share = np.where(inside, np.clip(snapped, 0.0, 1.0), share)
    apart = np.diff(share, prepend=-1.0) > SHORTEST
    kept = ~inside | (apart & (share < 1.0 - SHORTEST))
    return line[kept], share[kept]


GROUND = np.eye(3)  # the frame that a trunk stands in


@dataclass(frozen=True, eq=False)
class TemplateWood:
    """The mesh of all pieces.

    stock : their mesh, each vertex seen from where it is on its line.
    stretch : (V,) of its line that it is on. part : (V,) how far along that.
    bone : (V,) the first of the two stretches that turn it, its own and the nearer next one.
    weight : (V,) how much the second turns it.
    ring : (V,) whether it is of the lowest ring of its piece.
    """

    stock: CopyStock
    stretch: np.ndarray
    part: np.ndarray
    bone: np.ndarray
    weight: np.ndarray
    ring: np.ndarray


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
    bridged: np.ndarray

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
    by_piece = np.argsort(found.wood.piece, kind="stable")
    owner, triangles = found.wood.piece_of_vertex.astype(np.int64), turned_outwards(found)[by_piece]
    ring = _ring(lines, owner, triangles, stretch, part)
    mesh = _Mesh(place, owner, triangles, stretch, part, ring)
    lines, direction, mesh, bridged = _bridge(parent, found.trunk, lines, direction, mesh)
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
        own = np.einsum("nij,ni->nj", parents, heading)
        azimuth[here] = azimuth_of(own)
        angle[here] = np.arctan2(np.hypot(own[:, 0], own[:, 1]), column(own, 2))
        seat.aside[here] -= azimuth[here]
        plain = foot_frames(parents, azimuth[here], angle[here], np.zeros(len(here)), carried[here])
        if level:
            carried[here] = np.abs(heading[:, 2]) >= STEEP
            level_ones = np.flatnonzero(~carried[here])
            upper = plain.copy()
            upper[level_ones] = upper_frames(heading[level_ones])
            cosine, sine = (np.einsum("ni,ni->n", plain[:, :, k], upper[:, :, 0]) for k in range(2))
            roll[here] = np.arctan2(sine, cosine)  # about T, from the N of one to that of the other
        else:
            roll[here] = -azimuth[here]  # the least turn from upright
        start = foot_frames(parents, azimuth[here], angle[here], roll[here], carried[here])
        rows, _, _ = Runs.at(lines.first).copy(here)
        laid, bent = unbend(direction[rows], bounds(np.diff(lines.first)[here]), start)
        frame[rows], bend[rows] = laid, bent
    lines = replace(lines, knot=walk(frame, lines.length, lines.first, feet), frame=frame)
    # Each vertex is turned by the stretch that it is on and by the nearer next.
    owner, stretch, part = mesh.owner, mesh.stretch, mesh.part
    towards_next = (part >= 0.5) & (stretch < np.diff(lines.first)[owner] - 1)
    from_before = (part < 0.5) & (stretch > 0)
    on_line, _ = lines.at(owner, stretch, part)
    wood = TemplateWood(
        stock=CopyStock.of(mesh.place - on_line, owner, mesh.triangles, WOOD, BARK_SLOT),
        stretch=stretch,
        part=part,
        bone=stretch - from_before,
        weight=np.where(towards_next, part - 0.5, np.where(from_before, part + 0.5, 0.0)),
        ring=mesh.ring,
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
        wood=wood,
        foliage=_foliage(found, lines, origin, metres),
        bridged=bridged,
    )


@dataclass(frozen=True, eq=False)
class _Mesh(RowTable):
    """The mesh of the wood, sorted by piece: places, pieces, triangles, where vertices are on lines, and
    whether they are of their piece's lowest ring.
    """

    place: np.ndarray
    owner: np.ndarray
    triangles: np.ndarray
    stretch: np.ndarray
    part: np.ndarray
    ring: np.ndarray


def _ring(
    lines: Lines, owner: np.ndarray, triangles: np.ndarray, stretch: np.ndarray, part: np.ndarray
) -> np.ndarray:
    """(V,) whether a vertex is of the lowest ring of its piece: of the border at the foot of an open tube,
    else of the lowest corners.
    """
    along = _along(lines, owner, stretch, part) * lines.reach()[owner]
    edges = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2)).reshape(-1, 2)
    _, at, times = np.unique(
        edges[:, 0] * np.int64(len(owner)) + edges[:, 1], return_index=True, return_counts=True
    )
    border = np.zeros(len(owner), dtype=bool)
    border[edges[at[times == 1]]] = True
    thick = lines.radius[lines.first[:-1] + np.arange(len(lines.first) - 1)]
    low = np.full(len(thick), np.inf)
    np.minimum.at(low, owner, along)
    deep = along - low[owner]
    rim = border & (deep <= BORDER * thick[owner])
    is_open = np.bincount(owner[rim], minlength=len(thick)) > 0
    return np.where(is_open[owner], rim, deep <= CLOSED * thick[owner])


def hold(
    lines: Lines,
    bearer: np.ndarray,
    point: np.ndarray,
    vertices: np.ndarray,
    triangles: np.ndarray,
    owner: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Hold places (N, 3) against the meshes of the lines (N,) that bear them.

    vertices, triangles, owner : (V, 3), (T, 3), and (T,) whose triangles they are.

    Returns
    -------
    (N, 3) the nearest place on the bark of each; (N,) metres that it is off, 0 inside; and (N, 3) the place
    on the axis beside it.
    """
    stretch, part = nearest(lines, bearer, point)
    held = np.clip(part, 0.0, 1.0)
    axis, _ = lines.at(bearer, stretch, held)
    borne = np.zeros(int(max(owner.max(initial=-1), bearer.max(initial=-1))) + 1, dtype=bool)
    borne[bearer] = True
    candidates = np.flatnonzero(borne[owner])
    if not len(candidates):
        return point, np.zeros(len(point)), axis
    corners, owner = vertices[triangles[candidates]], owner[candidates]
    middles = (corners + np.roll(corners, 1, axis=1)) / 2
    samples = np.concatenate([corners, middles, corners.mean(axis=1)[:, None]], axis=1)
    many = samples.shape[1]
    samples = np.column_stack([samples.reshape(-1, 3), APART * np.repeat(owner, many)])
    tree = scipy.spatial.cKDTree(samples, balanced_tree=False, compact_nodes=False)
    _, nearest_triangles = tree.query(np.column_stack([point, APART * bearer]), NEAREST)
    nearest_triangles = np.minimum(nearest_triangles, many * len(owner) - 1) // many
    row = np.repeat(np.arange(len(point)), NEAREST)
    every = nearest_on_triangles(point[row], corners[nearest_triangles.ravel()])
    gap = lengths(every - point[row]).reshape(-1, NEAREST)
    gap[owner[nearest_triangles] != bearer[:, None]] = np.inf
    best = np.arange(len(point)), np.argmin(gap, axis=1)
    bark, gap, candidates = (
        every.reshape(-1, NEAREST, 3)[best],
        gap[best],
        corners[nearest_triangles[best]],
    )
    normal = cross_rows(candidates[:, 1] - candidates[:, 0], candidates[:, 2] - candidates[:, 0])
    inside = np.einsum("ni,ni->n", point - bark, axis - bark) > 0  # towards the axis
    behind = np.einsum("ni,ni->n", point - bark, normal) < 0
    for k in np.flatnonzero((behind != inside) | (part != held)):
        inside[k] = winding_number(point[k], corners[owner == bearer[k]]) > 0.5
    return bark, np.where(inside | np.isinf(gap), 0.0, gap), axis  # no mesh: nothing to be off


def _bridge(
    parent: np.ndarray, trunk: int, lines: Lines, direction: np.ndarray, mesh: _Mesh
) -> tuple[Lines, np.ndarray, _Mesh, np.ndarray]:
    """Lead pieces whose mesh begins off what bears them to its axis, stems to the ground, by a tube.

    direction : (S, 3) of the stretches of the lines.

    Returns
    -------
    The lines, their directions and the mesh with the tubes; and (C,) metres that were bridged, else 0.
    """
    owner, ring, count = mesh.owner, mesh.ring, len(parent)
    row = np.flatnonzero(ring & (parent[owner] >= 0))
    off = np.full(count, np.inf)
    of_triangle = owner[mesh.triangles[:, 0]]
    bearer, point = parent[owner[row]], mesh.place[row]
    _, gap, _ = hold(lines, bearer, point, mesh.place, mesh.triangles, of_triangle)
    np.minimum.at(off, owner[row], gap)
    stem = (parent < 0) & (np.arange(count) != trunk)
    np.minimum.at(off, owner[stem[owner]], mesh.place[stem[owner], 2])
    off = np.where(np.isfinite(off) & (off > OFF), off, 0.0)
    chosen = np.flatnonzero(off)
    if not len(chosen):
        return lines, direction, mesh, off

    number = np.bincount(owner[ring], minlength=count)[chosen]
    middle = np.stack([np.bincount(owner[ring], x[ring], count)[chosen] for x in mesh.place.T], 1)
    middle /= number[:, None]
    first = lines.first[chosen]
    knot = first + chosen
    thick, way = lines.radius[knot], direction[first]
    foot, most = middle * [1.0, 1.0, 0.0], thick.copy()
    borne = np.flatnonzero(parent[chosen] >= 0)
    bearer = parent[chosen[borne]]
    stretch, part = nearest(lines, bearer, middle[borne])
    share = _along(lines, bearer, stretch, np.clip(part, 0.0, 1.0))
    _, around = _at(lines, bearer, share)
    margin = np.minimum(around / np.maximum(lines.reach()[bearer], 1e-12), 0.5)
    foot[borne], around = _at(lines, bearer, np.clip(share, margin, 1.0 - margin))
    most[borne] = np.minimum(thick[borne], SLIM * around)
    inside = np.minimum(thick, lines.length[first] / 2)

    ahead = lines.knot[knot] - foot
    length = lengths(ahead)
    ahead = np.where(length[:, None] > 1e-9, ahead / np.maximum(length, 1e-12)[:, None], way)
    extended = Lines(
        lines.first + np.searchsorted(chosen, np.arange(count + 1)),
        np.insert(lines.knot, knot, foot, axis=0),
        np.insert(lines.radius, knot, most),
        np.insert(lines.length, first, length),
        lines.frame,
    )
    longer = (off > 0)[owner]
    parts = [replace(mesh, stretch=mesh.stretch + longer, ring=ring & ~longer)]
    base = len(owner)
    for k, piece in enumerate(chosen):
        path = np.stack([foot[k], middle[k], middle[k] + inside[k] * way[k]])
        place, triangles = tube(path, np.array([most[k], thick[k], 0.98 * thick[k]]), SIDES)
        rung = np.concatenate([np.repeat([0, 1, 2], SIDES), [0, 2]])
        onward = inside[k] / max(lines.length[first[k]], 1e-12)
        parts.append(
            _Mesh(
                place,
                np.full(len(place), piece),
                triangles + base,
                np.where(rung == 2, 1, 0),
                np.array([0.0, 1.0, onward])[rung],
                rung == 0,
            )
        )
        base += len(place)
    whole = _Mesh.joined(parts)
    order = np.argsort(whole.owner, kind="stable")
    renamed = np.argsort(order)
    by_piece = np.argsort(whole.owner[whole.triangles[:, 0]], kind="stable")
    triangles = renamed[whole.triangles[by_piece]]
    names = ("place", "owner", "stretch", "part", "ring")
    whole = _Mesh(**{name: getattr(whole, name)[order] for name in names}, triangles=triangles)
    return extended, np.insert(direction, first, ahead, axis=0), whole, off


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
    mesh = TriMesh.of_part(place, triangles, LEAF, leaf_of_triangle[triangle_order])
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
    place, radius = lines.at(line, stretch, np.clip(part, 0.0, 1.0))
    return np.maximum(lengths(point - place) - radius, 0.0)
