"""Pieces that stand on one another: a trunk or a limb that was drawn as several tubes, end to end.

Where one piece ends, about as thick and on the same course another begins; these two are one axis. They
become one piece, joined by edges that no facet has, so that it gets one centreline.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from .centreline import Centrelines
from .closing import half_edges, loose_edges_of
from .pieces import Pieces, assemble, join_along

ALIKE = 1.35  # factor between the radii of the two ends, at most
STRAIGHT = np.cos(np.deg2rad(30.0))  # of the turn from one to the other
ASIDE = 0.4  # radii that the ends are off each other's course
GAP, OVERLAP = 1.0, 2.0  # radii that they are apart along it, or within each other
WITHIN = 1.5  # radii of an end whose corners are tied to the other's
CROWD, LIKE = (
    2.0,
    2.0,
)  # radii around two ends within which no third one is, thinner by less than this factor
TAPERED = 0.35  # of a piece's other end: one that is thinner is a tip
STOUT = 0.15  # of the thickest end: twigs that begin at one another's tips stay apart
SLENDER = 1.0  # radii that a piece is long at least


def join_stacked(pieces: Pieces, lines: Centrelines) -> Pieces:
    """The pieces, those that stand on one another as one."""
    pairs = _stacked_ends(lines)
    if not len(pairs) or len(pairs) == pieces.count - 1:  # all of it would be a pole
        return pieces
    triangles = pieces.triangles.astype(np.int64)
    loose = loose_edges_of(pieces, half_edges(pieces.triangles, len(pieces.vertices))[1])
    ties = np.concatenate([_ties(pieces, lines, *ends) for ends in pairs.tolist()])
    label = join_along(pairs // 2, pieces.count).astype(np.int64)
    everything = np.concatenate([triangles, loose, ties])
    of = label[pieces.piece_of_vertex[everything[:, 0]]]
    _, first, of = np.unique(of, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))  # in the order of the file
    has_area = np.arange(len(everything)) < len(triangles)
    return assemble(pieces.vertices, everything, rank[of.ravel()], has_area, drawn=pieces.drawn)


def _stacked_ends(lines: Centrelines) -> np.ndarray:
    """(N, 2) ends, 2·piece + 0 first or 1 last, that meet; each end is in one pair at most."""
    ends, radius = lines.ends().reshape(-1, 3), lines.end_radius.ravel()
    second = np.stack([lines.first[:-1] + 1, lines.first[1:] - 2], axis=1).ravel()
    out = ends - lines.knot[second]
    out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), np.finfo(float).tiny)
    far = lines.end_radius[:, ::-1].ravel()
    fit = np.repeat((lines.length() > SLENDER * lines.end_radius.max(axis=1)), 2) & (radius > 0)
    fit &= (radius >= TAPERED * far) & (radius >= STOUT * radius.max())
    row = np.flatnonzero(fit)
    if len(row) < 2:
        return np.empty((0, 2), np.int64)
    near = cKDTree(ends[row]).query(ends[row], k=min(8, len(row)))[1]
    one = np.repeat(row, near.shape[1])
    other = row[near].ravel()
    kept = one // 2 < other // 2
    pair = np.unique(np.stack([one[kept], other[kept]], axis=1), axis=0)
    one, other = pair.T
    way = ends[other] - ends[one]
    thin = np.minimum(radius[one], radius[other])
    thick = np.maximum(radius[one], radius[other])
    apart = np.einsum("ni,ni->n", way, out[one])
    course = out[one] - out[other]
    course /= np.maximum(np.linalg.norm(course, axis=1, keepdims=True), np.finfo(float).tiny)
    aside = way - np.einsum("ni,ni->n", way, course)[:, None] * course
    turn = -np.einsum("ni,ni->n", out[one], out[other])
    off = np.linalg.norm(aside, axis=1)
    meets = (thick <= ALIKE * thin) & (turn >= STRAIGHT) & (off <= ASIDE * thin)
    meets &= (apart <= GAP * thin) & (apart >= -OVERLAP * thin)
    middle, reach = (ends[one] + ends[other]) / 2, CROWD * thick + np.abs(apart)
    for k in np.flatnonzero(meets).tolist():  # more that are about as thick begin at a fork
        here = np.linalg.norm(ends - middle[k], axis=1) <= reach[k]
        meets[k] = np.count_nonzero(here & (radius * LIKE >= thick[k])) == 2
    rank = off / np.maximum(thin, np.finfo(float).tiny) + (1 - turn) + (thick / thin - 1)
    taken: set[int] = set()
    chosen = []
    for k in np.flatnonzero(meets)[np.argsort(rank[meets], kind="stable")].tolist():
        if not taken & set(pair[k].tolist()):
            taken |= set(pair[k].tolist())
            chosen.append(pair[k])
    return np.array(chosen, np.int64).reshape(-1, 2)


def _ties(pieces: Pieces, lines: Centrelines, one: int, other: int) -> np.ndarray:
    """(N, 3) edges between the corners of two ends, as triangles without area."""
    rows = []
    for end in (one, other):
        piece, last = divmod(end, 2)
        begin, after = np.searchsorted(pieces.piece_of_vertex, [piece, piece + 1])
        place = lines.ends()[piece, last]
        away = np.linalg.norm(pieces.vertices[begin:after] - place, axis=1)
        mine = begin + np.flatnonzero(away <= WITHIN * lines.end_radius[piece, last])
        rows.append(mine if len(mine) else begin + np.argsort(away)[:1])
    a, b = rows
    nearest = b[cKDTree(pieces.vertices[b]).query(pieces.vertices[a])[1]]
    return np.stack([a, nearest, nearest], axis=1)
