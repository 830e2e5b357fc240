"""A joined mesh is cut at its forks, as if trunk and branches had been drawn as separate parts.

``levels`` slices the mesh, ``axes`` says which slices are one branch. A branch leaves its mother where
the surface leaves her tube: what a level line, which runs askew around a fork, has left to the mother is
taken back from there. Then the mother's hole is closed, and the branch goes on inwards to where its axis
meets hers, so that pieces are as whole as those that others draw apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .axes import Axes, find_axes
from .centreline import Centrelines
from .hierarchy import Known
from .levels import Slices, band_width, distance_from, slice_up
from .pieces import Pieces, assemble, join_along, join_pieces, select

FAR = 3.0  # radii of a tube of that area and length, beyond which a piece may fork
FEWEST = 12  # triangles of a piece that forks
COARSE = 3.0  # width of bands for the first look, from the wrong end
STOUT = 0.7  # share of the thickest end's radius that the root's is at least
OUTSIDE = 1.15  # radii of the mother from her axis where a daughter's bark begins
BESIDE = 2.0  # radii of the daughter from her axis within which it is hers
WINDOW = 3.0  # radii over which an axis is smoothed
ROUNDS = 100  # of taking bark back, an edge at a time
WITHIN = 0.8  # radius of the mother within which the foot of a daughter is made to fit
DEEPEST = 4.0  # radii of the mother that it goes inwards at most


@dataclass(frozen=True)
class Severed:
    """Pieces after the cut, and what the cut tells of them.

    known : from which piece each was cut, and where.
    grown_together : (N, 3) places where branches hang together that do not fork there.
    """

    pieces: Pieces
    known: Known
    grown_together: np.ndarray


@dataclass(frozen=True)
class _Course:
    """Axes without the bulges of their forks, at the slices that are on them."""

    centre: np.ndarray  # (S, 3)
    heading: np.ndarray  # (S, 3) unit
    radius: np.ndarray  # (S,)


def sever(pieces: Pieces, forked: np.ndarray) -> Severed:
    """Cut pieces at their forks, those (C,) that may have some; the others come first, as they are."""
    rest = select(pieces, ~forked)
    cut = _cut(select(pieces, forked))
    known, count = cut.known, rest.count
    return Severed(
        join_pieces(rest, cut.pieces),
        Known(
            np.concatenate(
                [np.full(count, -1), np.where(known.mother < 0, -1, known.mother + count)]
            ),
            np.concatenate([np.zeros((count, 3)), known.foot]),
            np.concatenate([np.zeros(count), known.radius]),
        ),
        cut.grown_together,
    )


def may_fork(pieces: Pieces, lines: Centrelines) -> np.ndarray:
    """(C,) whether some of a piece is farther from its line than a tube's surface is."""
    area = np.bincount(pieces.piece, np.linalg.norm(pieces.area_vectors(), axis=1), pieces.count)
    radius = area / (2 * np.pi * np.maximum(lines.length(), 1e-300))
    away = np.zeros(pieces.count)
    np.maximum.at(away, pieces.piece_of_vertex, np.linalg.norm(lines.outward, axis=1))
    enough = np.bincount(pieces.piece, minlength=pieces.count) >= FEWEST
    return np.asarray((away > FAR * radius) & enough)


def _cut(pieces: Pieces) -> Severed:
    roots = _find_roots(pieces)
    slices = slice_up(pieces, distance_from(pieces, roots), band_width(pieces))
    axes = find_axes(slices)
    course = _smooth(slices, axes)
    owner = _take_back(pieces, slices, axes, course)
    halves, keys = _neighbours(pieces.triangles, len(pieces.vertices))
    label = _whole(pieces, _of_triangles(owner, pieces.triangles), halves)
    together = slices.centre[slices.loops].mean(axis=1)
    loose = _loose_edges(pieces, keys)
    return _close(pieces, label, slices, axes, course, together, halves, loose)


def _find_roots(pieces: Pieces) -> np.ndarray:
    """Vertices around the thick, low end of each piece."""
    count, owner = pieces.count, pieces.piece_of_vertex
    size = np.bincount(owner, minlength=count)
    middle = np.stack([np.bincount(owner, x, count) for x in pieces.vertices.T], axis=1)
    away = np.linalg.norm(pieces.vertices - (middle / size[:, None])[owner], axis=1)
    start = np.lexsort((away, owner))[np.cumsum(size) - 1]
    slices = slice_up(pieces, distance_from(pieces, start), COARSE * band_width(pieces))
    axes = find_axes(slices)
    radius = _smooth(slices, axes).radius

    chain = np.flatnonzero(axes.chain)
    order = chain[np.argsort(axes.of_slice[chain], kind="stable")]
    many = np.bincount(axes.of_slice[order], minlength=len(axes))
    last, first = order[np.cumsum(many) - 1], order[np.cumsum(many) - many]
    ends = np.concatenate([last, first[axes.mother < 0]])
    piece = slices.piece[ends]
    thickest = np.zeros(count)
    np.maximum.at(thickest, piece, radius[ends])
    stout = radius[ends] >= STOUT * thickest[piece]
    chosen = np.lexsort((slices.centre[ends, 2], ~stout, piece))
    chosen = ends[chosen[np.diff(piece[chosen], prepend=-1) > 0]]
    root = np.zeros(len(slices), dtype=bool)
    root[chosen] = True
    found = root[slices.of_vertex]
    found[start[~np.isin(np.arange(count), owner[found])]] = True
    return np.flatnonzero(found)


def _smooth(slices: Slices, axes: Axes) -> _Course:
    """The course of every axis: medians of the radius, and centres where that is not exceeded."""
    from scipy.ndimage import median_filter, uniform_filter1d  # here: few runs need it

    centre, radius = slices.centre.copy(), axes.radius.copy()
    heading = np.zeros_like(centre)
    chain = np.flatnonzero(axes.chain)
    order = chain[np.argsort(axes.of_slice[chain], kind="stable")]
    bounds = np.flatnonzero(np.diff(axes.of_slice[order], prepend=-1, append=-2))
    for low, high in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        own = order[low:high]
        if len(own) < 3:
            step = slices.centre[own[-1]] - slices.centre[max(slices.below[own[0]], 0)]
            heading[own] = step
            continue
        window = WINDOW * float(np.median(radius[own])) / slices.width
        window = int(np.clip(2 * np.ceil(window) + 1, 3, 2 * (len(own) // 2) + 1))
        typical = median_filter(radius[own], window, mode="reflect")
        clean = radius[own] <= 1.1 * typical
        place = np.arange(len(own))
        middle = np.stack(
            [np.interp(place, place[clean], x) for x in slices.centre[own][clean].T], axis=1
        )
        short = max(window // 3, 1)
        centre[own] = (
            uniform_filter1d(middle, short, axis=0, mode="nearest") if short > 1 else middle
        )
        radius[own] = typical
        span = min(max(window // 2, 1), len(own) - 1)
        before, after = np.maximum(place - span, 0), np.minimum(place + span, len(own) - 1)
        heading[own] = middle[after] - middle[before]
    heading /= np.maximum(np.linalg.norm(heading, axis=1, keepdims=True), 1e-300)
    return _Course(centre, heading, radius)


def _take_back(pieces: Pieces, slices: Slices, axes: Axes, course: _Course) -> np.ndarray:
    """(V,) axis of each vertex, daughters' bark beyond the mothers' tubes given to the daughters."""
    owner = axes.of_slice[slices.of_vertex]
    start, heading, thick = _beginnings(slices, axes, course)
    one, other = np.concatenate([pieces.edges, pieces.edges[:, ::-1]]).T
    front = np.flatnonzero(axes.mother[owner[one]] == owner[other])
    for _ in range(ROUNDS):
        daughter, place = owner[one[front]], other[front]
        offset = pieces.vertices[place] - start[daughter]
        along = np.einsum("ni,ni->n", offset, heading[daughter])
        aside = np.linalg.norm(offset - along[:, None] * heading[daughter], axis=1)
        hers = (aside <= BESIDE * thick[daughter]) & _outside(pieces, slices, course, place)
        if not hers.any():
            break
        owner[place[hers]] = daughter[hers]
        moved = np.zeros(len(owner), dtype=bool)
        moved[place[hers]] = True
        front = np.flatnonzero(moved[one])
        front = front[axes.mother[owner[one[front]]] == owner[other[front]]]
    return owner


def _beginnings(
    slices: Slices, axes: Axes, course: _Course
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(A, 3) a place on each axis clear of its fork, (A, 3) its heading there, (A,) its radius."""
    chain = np.flatnonzero(axes.chain)
    order = chain[np.argsort(axes.of_slice[chain], kind="stable")]
    many = np.bincount(axes.of_slice[order], minlength=len(axes))
    first = np.cumsum(many) - many
    middle = order[first + many // 2]
    ahead = np.ceil(2 * course.radius[middle] / slices.width).astype(np.int64)
    clear = order[first + np.minimum(ahead, (many - 1) // 3)]
    return course.centre[clear], course.heading[clear], course.radius[clear]


def _outside(pieces: Pieces, slices: Slices, course: _Course, place: np.ndarray) -> np.ndarray:
    """Whether vertices lie beyond the tube of the axis whose slice they are in."""
    of = slices.of_vertex[place]
    offset = pieces.vertices[place] - course.centre[of]
    along = np.einsum("ni,ni->n", offset, course.heading[of])
    aside = np.linalg.norm(offset - along[:, None] * course.heading[of], axis=1)
    return np.asarray(aside > OUTSIDE * course.radius[of])


def _of_triangles(owner: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(T,) axis of most of a triangle's corners; of three, that which is most of a mother."""
    a, b, c = owner[triangles].T
    return np.where((a == b) | (a == c), a, np.where(b == c, b, np.minimum(np.minimum(a, b), c)))


def _neighbours(triangles: np.ndarray, vertices: int) -> tuple[np.ndarray, np.ndarray]:
    """(N, 2) half-edges 3·t + k, from corner k to the next, that lie on one another; half-edges' key."""
    one, other = triangles.astype(np.int64), np.roll(triangles, -1, axis=1).astype(np.int64)
    key = (np.minimum(one, other) * vertices + np.maximum(one, other)).ravel()
    order = np.argsort(key, kind="stable")
    same = key[order[1:]] == key[order[:-1]]
    return np.stack([order[:-1][same], order[1:][same]], axis=1), key


def _whole(pieces: Pieces, label: np.ndarray, halves: np.ndarray) -> np.ndarray:
    """(T,) labels of triangles such that each hangs together: crumbs go to what is beside them."""
    area = np.linalg.norm(pieces.area_vectors(), axis=1)
    beside = halves // 3
    count = len(label)
    for _ in range(4):
        same = label[beside[:, 0]] == label[beside[:, 1]]
        pairs = beside[same]
        part = join_along(pairs, count)
        total = np.bincount(part, area)
        of_part = np.zeros(len(total), dtype=np.int64)
        of_part[part] = label
        order = np.lexsort((-total, of_part))
        crumb = np.ones(len(total), dtype=bool)
        crumb[order[np.diff(of_part[order], prepend=-1) > 0]] = False
        rim = beside[~same]
        rim = np.concatenate([rim, rim[:, ::-1]])
        rim = rim[crumb[part[rim[:, 0]]] & ~crumb[part[rim[:, 1]]]]
        if not len(rim):
            break
        goes_to = of_part.copy()
        goes_to[part[rim[:, 0]]] = label[rim[:, 1]]
        label = goes_to[part]
    return label


def _close(
    pieces: Pieces,
    label: np.ndarray,
    slices: Slices,
    axes: Axes,
    course: _Course,
    together: np.ndarray,
    halves: np.ndarray,
    loose_edges: np.ndarray,
) -> Severed:
    """Pieces by label, holes closed and feet drawn inwards."""
    triangles = pieces.triangles.astype(np.int64)
    halves = halves[label[halves[:, 0] // 3] != label[halves[:, 1] // 3]]
    halves = np.concatenate([halves, halves[:, ::-1]])
    daughter, beyond = label[halves[:, 0] // 3], label[halves[:, 1] // 3]
    rim = (axes.mother[daughter] >= 0) & (axes.mother[beyond] != daughter)
    half, daughter = halves[rim, 0], daughter[rim]
    a = triangles[half // 3, half % 3]
    b = triangles[half // 3, (half + 1) % 3]

    count = len(axes)
    size = np.maximum(np.bincount(daughter, minlength=count), 1)
    place = pieces.vertices[a]
    middle = np.stack([np.bincount(daughter, x, count) for x in place.T], axis=1) / size[:, None]
    wide = np.sqrt(
        np.bincount(daughter, ((place - middle[daughter]) ** 2).sum(axis=1), count) / size
    )
    foot, apex, thick = _meetings(slices, axes, course, middle, wide)
    shrink = np.minimum(1.0, WITHIN * thick / np.maximum(wide, 1e-300))

    base = len(pieces.vertices)
    keys, number = np.unique(
        np.concatenate([daughter * base + a, daughter * base + b]), return_inverse=True
    )
    whose, vertex = np.divmod(keys, base)
    inner = foot[whose] + (pieces.vertices[vertex] - middle[whose]) * shrink[whose, None]
    inner_a, inner_b = base + number.reshape(2, -1)
    tip = base + len(inner) + daughter
    vertices = np.concatenate([pieces.vertices, inner, apex])
    mother = axes.mother[daughter]
    made = np.concatenate(
        [
            np.stack([a, b, tip], axis=1),
            np.stack([b, a, inner_a], axis=1),
            np.stack([b, inner_a, inner_b], axis=1),
        ]
    )
    everything = np.concatenate([triangles, made, loose_edges])
    loose = len(everything) - len(triangles) - len(made)
    loose_label = axes.of_slice[slices.of_vertex[everything[len(everything) - loose :, 0]]]
    whole = np.concatenate([label, mother, daughter, daughter, loose_label])
    present, first = np.unique(label, return_index=True)
    known = np.isin(whole, present)
    everything, whole = everything[known], whole[known]
    has_area = everything[:, 1] != everything[:, 2]
    number = np.zeros(count, dtype=np.int64)
    by_appearance = present[np.argsort(first)]
    number[by_appearance] = np.arange(len(by_appearance))
    cut = assemble(vertices, everything, number[whole], has_area, drawn=len(triangles))
    mothers = axes.mother[by_appearance]
    mothers = np.where(np.isin(mothers, present), number[np.maximum(mothers, 0)], -1)
    mothers[np.bincount(daughter, minlength=count)[by_appearance] == 0] = -1
    return _hang_together(cut, Known(mothers, foot[by_appearance], thick[by_appearance]), together)


def _hang_together(pieces: Pieces, known: Known, together: np.ndarray) -> Severed:
    """Parts of a piece that do not hang together become pieces; what only closed them is dropped."""
    part = join_along(pieces.edges, len(pieces.vertices))
    area = np.linalg.norm(pieces.area_vectors(), axis=1)
    drawn = np.arange(len(pieces.triangles)) < pieces.drawn
    of_triangle = part[pieces.triangles[:, 0]]
    total = np.bincount(of_triangle, np.where(drawn, area, 0.0), int(part.max()) + 1)
    if len(total) == pieces.count:
        return Severed(pieces, known, together)
    of_part = np.zeros(len(total), dtype=np.int64)
    of_part[part] = pieces.piece_of_vertex
    order = np.lexsort((-total, of_part))
    main = order[np.diff(of_part[order], prepend=-1) > 0]
    others = np.setdiff1d(np.flatnonzero(total > 0), main)
    number = np.full(len(total), -1)
    number[main], number[others] = of_part[main], pieces.count + np.arange(len(others))
    kept = number[of_triangle] >= 0
    loose = _loose_edges(pieces, _neighbours(pieces.triangles, len(pieces.vertices))[1])
    loose = loose[number[part[loose[:, 0]]] >= 0]
    whole = assemble(
        pieces.vertices,
        np.concatenate([pieces.triangles[kept].astype(np.int64), loose]),
        np.concatenate([number[of_triangle[kept]], number[part[loose[:, 0]]]]),
        np.arange(int(kept.sum()) + len(loose)) < kept.sum(),
        drawn=pieces.drawn,
    )
    more = Known.nothing(len(others))
    joined = Known(
        np.concatenate([known.mother, more.mother]),
        np.concatenate([known.foot, more.foot]),
        np.concatenate([known.radius, more.radius]),
    )
    return Severed(whole, joined, together)


def _loose_edges(pieces: Pieces, keys: np.ndarray) -> np.ndarray:
    """(N, 3) the edges that no triangle has, as triangles without area."""
    count = len(pieces.vertices)
    one, other = pieces.edges.T.astype(np.int64)
    mine = np.minimum(one, other) * count + np.maximum(one, other)
    key = np.sort(keys)
    at = np.minimum(np.searchsorted(key, mine), len(key) - 1)
    loose = key[at] != mine
    return np.stack([one[loose], other[loose], other[loose]], axis=1)


def _meetings(
    slices: Slices, axes: Axes, course: _Course, middle: np.ndarray, wide: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the axes of daughters meet those of their mothers (A, 3), the middle of the mother's bark
    there (A, 3), and her radius (A,).
    """
    start, heading, _ = _beginnings(slices, axes, course)
    foot, apex, thick = middle.copy(), middle.copy(), np.ones(len(axes))
    chain = np.flatnonzero(axes.chain)
    order = chain[np.argsort(axes.of_slice[chain], kind="stable")]
    many = np.bincount(axes.of_slice[order], minlength=len(axes))
    first = np.cumsum(many) - many
    rank = np.zeros(len(slices), dtype=np.int64)
    rank[order] = np.arange(len(order)) - np.repeat(first, many)
    for axis in np.flatnonzero(axes.mother >= 0).tolist():
        mother = int(axes.mother[axis])
        fork = int(axes.fork[axis])
        while not axes.chain[fork]:
            fork = int(slices.below[fork])
        radius = float(course.radius[fork])
        reach = int(np.ceil((DEEPEST * radius + 4 * wide[axis]) / slices.width)) + 1
        at = int(rank[fork])
        near = order[
            first[mother] + max(at - reach, 0) : first[mother] + min(at + reach, many[mother])
        ]
        places = course.centre[near]
        beside = np.linalg.norm(places - middle[axis], axis=1)
        closest = int(near[np.argmin(beside)])
        back = (places - start[axis]) @ heading[axis]
        aside = np.linalg.norm(places - start[axis] - back[:, None] * heading[axis], axis=1)
        allowed = (back <= 0) & (beside <= DEEPEST * radius)
        meet = int(near[np.argmin(np.where(allowed, aside, np.inf))]) if allowed.any() else closest
        foot[axis], thick[axis] = course.centre[meet], course.radius[meet]
        out = middle[axis] - course.centre[closest]
        far = float(np.linalg.norm(out))
        if far > 0:
            apex[axis] = course.centre[closest] + out * min(1.0, course.radius[closest] / far)
    return foot, apex, thick
