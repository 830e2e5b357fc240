"""A joined mesh is cut at its forks, as if trunk and branches had been drawn as separate parts.

``levels`` slices the mesh, ``axes`` says which slices are one branch. A branch leaves its parent where
the surface leaves her tube: what a level line, which runs askew around a fork, has left to the parent is
taken back from there. Then the parent's hole is closed, and the branch goes on inwards to where its axis
meets hers, so that pieces are as whole as those that others draw apart.
"""

from __future__ import annotations

import numpy as np

from .axes import PieceAxes, find_axes
from .centreline import Centrelines
from .closing import Severed, close, half_edges, loose_edges_of
from .course import Course, beginnings, smooth
from .hierarchy import Known
from .levels import Slices, band_width, distance_from, slice_up
from .pieces import Pieces, join_along, join_pieces, select

FAR = 3.0  # radii of a tube of that area and length, beyond which a piece may fork
FEWEST = 12  # triangles of a piece that forks
COARSE = 3.0  # width of bands for the first look, from the wrong end
STOUT = 0.7  # share of the thickest end's radius that the root's is at least
OUTSIDE = 1.15  # radii of the parent from her axis where a child's bark begins
BESIDE = 2.0  # radii of the child from her axis within which it is hers
ROUNDS = 100  # of taking bark back, an edge at a time


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
    area = np.bincount(pieces.piece, pieces.area, pieces.count)
    radius = area / (2 * np.pi * np.maximum(lines.length(), 1e-300))
    away = np.zeros(pieces.count)
    np.maximum.at(away, pieces.piece_of_vertex, np.linalg.norm(lines.outward, axis=1))
    enough = np.bincount(pieces.piece, minlength=pieces.count) >= FEWEST
    return np.asarray((away > FAR * radius) & enough)


def _cut(pieces: Pieces) -> Severed:
    roots = _find_roots(pieces)
    slices = slice_up(pieces, distance_from(pieces, roots), band_width(pieces))
    axes = find_axes(slices)
    course = smooth(slices, axes)
    owner = _take_back(pieces, slices, axes, course)
    halves, keys = half_edges(pieces.triangles, len(pieces.vertices))
    label = _whole(pieces, _of_triangles(owner, pieces.triangles), halves)
    together = slices.centre[slices.loops].mean(axis=1)
    loose = loose_edges_of(pieces, keys)
    return close(pieces, label, slices, axes, course, together, halves, loose)


def _find_roots(pieces: Pieces) -> np.ndarray:
    """Vertices around the thick, low end of each piece."""
    count, owner = pieces.count, pieces.piece_of_vertex
    size = np.bincount(owner, minlength=count)
    middle = np.stack([np.bincount(owner, x, count) for x in pieces.vertices.T], axis=1)
    away = np.linalg.norm(pieces.vertices - (middle / size[:, None])[owner], axis=1)
    start = np.lexsort((away, owner))[np.cumsum(size) - 1]
    slices = slice_up(pieces, distance_from(pieces, start), COARSE * band_width(pieces))
    axes = find_axes(slices)
    radius = smooth(slices, axes).radius

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


def _take_back(pieces: Pieces, slices: Slices, axes: PieceAxes, course: Course) -> np.ndarray:
    """(V,) axis of each vertex, children' bark beyond the parents' tubes given to the children."""
    owner = axes.of_slice[slices.of_vertex]
    start, heading, thick = beginnings(slices, axes, course)
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


def _outside(pieces: Pieces, slices: Slices, course: Course, place: np.ndarray) -> np.ndarray:
    """Return whether vertices lie beyond the tube of the axis whose slice they are in."""
    of = slices.of_vertex[place]
    offset = pieces.vertices[place] - course.centre[of]
    along = np.einsum("ni,ni->n", offset, course.heading[of])
    aside = np.linalg.norm(offset - along[:, None] * course.heading[of], axis=1)
    return np.asarray(aside > OUTSIDE * course.radius[of])


def _of_triangles(owner: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(T,) axis of most of a triangle's corners; of three, that which is most of a parent."""
    a, b, c = owner[triangles].T
    return np.where((a == b) | (a == c), a, np.where(b == c, b, np.minimum(np.minimum(a, b), c)))


def _whole(pieces: Pieces, label: np.ndarray, halves: np.ndarray) -> np.ndarray:
    """(T,) labels of triangles such that each hangs together: crumbs go to what is beside them."""
    area = pieces.area
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
