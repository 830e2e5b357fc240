"""Closing of a joined mesh where it was cut: the parent's hole is closed, the child goes on to its axis.

A child's rim is a ring of edges beyond which her parent's triangles lie. A fan over it closes the
parent; the ring, moved along to where the two axes meet and made to fit within her, gives the child
her foot. Rings at which branches have grown together elsewhere stay open.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .axes import PieceAxes
from .course import Course, beginnings
from .hierarchy import Known
from .levels import Slices
from .pieces import Pieces, assemble, join_along

WITHIN = 0.8  # radius of the parent within which the foot of a child is made to fit
DEEPEST = 4.0  # radii of the parent that it goes inwards at most


@dataclass(frozen=True)
class Severed:
    """Pieces after the cut, and what the cut tells of them.

    known : from which piece each was cut, and where.
    grown_together : (N, 3) places where branches hang together that do not fork there.
    """

    pieces: Pieces
    known: Known
    grown_together: np.ndarray


def close(
    pieces: Pieces,
    label: np.ndarray,
    slices: Slices,
    axes: PieceAxes,
    course: Course,
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
    half, daughter, beyond = halves[rim, 0], daughter[rim], beyond[rim]
    a = triangles[half // 3, half % 3]
    b = triangles[half // 3, (half + 1) % 3]
    to_mother = beyond == axes.mother[daughter]
    begins = slices.centre[np.maximum(axes.fork, 0)]
    foot_rim = _nearest_rim(pieces.vertices, a, b, daughter, to_mother, begins)
    a, b, daughter = a[foot_rim], b[foot_rim], daughter[foot_rim]

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
    area = pieces.area
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
    loose = loose_edges_of(pieces, half_edges(pieces.triangles, len(pieces.vertices))[1])
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


def _nearest_rim(
    vertices: np.ndarray,
    a: np.ndarray,
    b: np.ndarray,
    daughter: np.ndarray,
    to_mother: np.ndarray,
    begins: np.ndarray,
) -> np.ndarray:
    """(N,) whether an edge from a to b is on the rim where its child begins; others are where she
    has grown together with somebody, and are left open.
    """
    base = len(vertices)
    keys, number = np.unique(
        np.concatenate([daughter * base + a, daughter * base + b]), return_inverse=True
    )
    one, other = number.reshape(2, -1)
    rim = join_along(np.stack([one, other], axis=1), len(keys))[one]
    count = int(rim.max(initial=-1)) + 1
    size = np.maximum(np.bincount(rim, minlength=count), 1)
    middle = np.stack([np.bincount(rim, x, count) for x in vertices[a].T], axis=1) / size[:, None]
    whose = np.zeros(count, dtype=np.int64)
    whose[rim] = daughter
    away = np.linalg.norm(middle - begins[whose], axis=1)
    hers = np.bincount(rim, to_mother, count) > 0
    order = np.lexsort((away, ~hers, whose))
    chosen = np.zeros(count, dtype=bool)
    chosen[order[np.diff(whose[order], prepend=-1) > 0]] = True
    return np.asarray(chosen[rim])


def loose_edges_of(pieces: Pieces, keys: np.ndarray) -> np.ndarray:
    """(N, 3) the edges that no triangle has, as triangles without area."""
    count = len(pieces.vertices)
    one, other = pieces.edges.T.astype(np.int64)
    mine = np.minimum(one, other) * count + np.maximum(one, other)
    key = np.sort(keys)
    at = np.minimum(np.searchsorted(key, mine), len(key) - 1)
    loose = key[at] != mine
    return np.stack([one[loose], other[loose], other[loose]], axis=1)


def _meetings(
    slices: Slices, axes: PieceAxes, course: Course, middle: np.ndarray, wide: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where the axes of children meet those of their parents (A, 3), the middle of the parent's
    bark there (A, 3), and her radius (A,)."""
    start, heading, _ = beginnings(slices, axes, course)
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


def half_edges(triangles: np.ndarray, vertices: int) -> tuple[np.ndarray, np.ndarray]:
    """(N, 2) half-edges 3·t + k, from corner k to the next, that lie on one another; half-edges' key."""
    one, other = triangles.astype(np.int64), np.roll(triangles, -1, axis=1).astype(np.int64)
    key = (np.minimum(one, other) * vertices + np.maximum(one, other)).ravel()
    order = np.argsort(key, kind="stable")
    same = key[order[1:]] == key[order[:-1]]
    return np.stack([order[:-1][same], order[1:][same]], axis=1), key
