"""A joined mesh is cut at its forks, as if trunk and branches had been drawn as separate parts; tubes that
were drawn end to end are joined to one piece, by edges that no facet has.

The distance along the surface from a root is a function on the mesh (Verroust & Lazarus 2000); between two
neighbouring levels of it, a tube has one slice, and beyond a fork a tree has as many as it has branches there
(a Reeb graph, sampled). Along an edge the distance is taken as linear. Slices are the connected components of
what edges have within bands of equal width; every one but a root's has a slice below.

Axes say which slices follow one another as a trunk or a branch. At a fork the axis goes on as the child that
is thickest and straightest a few radii on, where slices are clean of the fork itself; the others begin axes
of their own. What ends before it is three times as long as thick, or within its parent's bark, is a bump. The
course of an axis is without the bulges of its forks.

A branch leaves its parent where the surface leaves the parent's tube: what a level line, which runs askew
around a fork, has left to the parent is taken back from there. The child's rim is then a ring of edges. A fan
over it closes the parent; the ring, moved along to where the two axes meet and made to fit within the parent,
gives the child its foot. Rings at which branches have grown together elsewhere stay open.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from ...base.rows import RowTable
from ...base.runs import Runs, firsts, numbered, sums
from ...base.vectors import unit
from ..skeleton import root_of
from .centreline import Centrelines, distance_from
from .pieces import Pieces, assemble, half_edges, join_along, join_pieces, loose_edges_of, select

FINEST = 3000  # bands at most along the largest piece's extent
NODES = 3.0  # places on edges at most, in vertices of the mesh
NEAR, FAR = 1.0, 4.0  # radii beyond a fork between which a child is judged
SLENDER = 3.0  # radii that a branch is long at least
CLEAR = 0.5  # radii of its parent that it reaches beyond the fork at least
SHORTEST = 4  # bands
MOST_STEPS = 200  # bands looked ahead
STRAIGHT = 1.0  # weight of straightness against thickness
WINDOW = 3.0  # radii over which an axis is smoothed


@dataclass(frozen=True)
class Slices:
    """S slices of C pieces, numbered so that a lower band comes first.

    of_vertex : (V,) slice of each vertex. piece : (S,). band : (S,) 0 at the root.
    below : (S,) the slice under it, -1 for a root.
    loops : (N, 2) slices that also hang together, where branches have grown into one another.
    centre : (S, 3) mean of what it has of edges. spread : (S, 3, 3) covariance of that.
    weight : (S,) length of that.
    width : length of a band.
    """

    of_vertex: np.ndarray
    piece: np.ndarray
    band: np.ndarray
    below: np.ndarray
    loops: np.ndarray
    centre: np.ndarray
    spread: np.ndarray
    weight: np.ndarray
    width: float


def band_width(pieces: Pieces) -> float:
    """Width of a band, as fine as memory and the mesh allow."""
    one, other = pieces.edges.T
    total = float(np.linalg.norm(pieces.vertices[one] - pieces.vertices[other], axis=1).sum())
    extent = float(np.ptp(pieces.vertices, axis=0).max())
    return max(extent / FINEST, total / (NODES * len(pieces.vertices) + 2e5))


def slice_up(pieces: Pieces, distance: np.ndarray, width: float) -> Slices:
    """Slices between levels ``width`` apart of a ``distance`` (V,) that has no minimum but the roots."""
    band = (distance / width).astype(np.int64)
    ends = pieces.edges.astype(np.int64)
    ends = np.take_along_axis(ends, np.argsort(band[ends], axis=1, kind="stable"), axis=1)
    one, other = np.ascontiguousarray(ends.T)
    inner = np.maximum(band[other] - band[one] - 1, 0)  # bands that an edge only passes through
    first = len(band) + np.cumsum(inner) - inner  # its node in the lowest of those
    nodes = len(band) + int(inner.sum())

    level, tall = ends[band[one] == band[other]], _across_triangles(pieces, band, one, other, first)
    node_slice = join_along(np.concatenate([level, tall]), nodes)

    edge, rank = numbered(inner)
    node_band = np.concatenate([band, band[one[edge]] + 1 + rank])
    shown = np.unique(node_slice, return_index=True)[1]  # a node of each slice
    order = np.argsort(node_band[shown], kind="stable")
    node_slice, shown = np.argsort(order)[node_slice], shown[order]

    below, loops = _stack(node_slice, one, other, inner, first, len(shown))
    owner = np.concatenate([pieces.piece_of_vertex, pieces.piece_of_vertex[one[edge]]])[shown]
    moments = _moments(pieces, distance, width, band, (one, other, edge, rank), node_slice)
    return Slices(node_slice[: len(band)], owner, node_band[shown], below, loops, *moments, width)


def _across_triangles(
    pieces: Pieces, band: np.ndarray, one: np.ndarray, other: np.ndarray, first: np.ndarray
) -> np.ndarray:
    """(N, 2) nodes of two edges of one triangle that lie in one band."""
    corner = pieces.triangles.astype(np.int64)
    corner = np.take_along_axis(corner, np.argsort(band[corner], axis=1, kind="stable"), axis=1)
    low, middle, high = band[corner].T
    tall = np.flatnonzero(high - low > 1)
    corner, low, middle, high = corner[tall], low[tall], middle[tall], high[tall]
    count = len(band)
    key = np.minimum(one, other) * count + np.maximum(one, other)
    order = np.argsort(key)

    def first_node(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        wanted = np.minimum(a, b) * count + np.maximum(a, b)
        return np.asarray(first[order[np.searchsorted(key, wanted, sorter=order)]])

    longest = first_node(corner[:, 0], corner[:, 2])
    lower, upper = first_node(corner[:, 0], corner[:, 1]), first_node(corner[:, 1], corner[:, 2])
    inner = high - low - 1
    row, rank = numbered(inner)
    at = low[row] + 1 + rank
    beside = np.where(at < middle[row], lower[row] + rank, upper[row] + at - middle[row] - 1)
    beside = np.where(at == middle[row], corner[row, 1], beside)
    return np.stack([longest[row] + rank, beside], axis=1)


def _stack(
    node_slice: np.ndarray,
    one: np.ndarray,
    other: np.ndarray,
    inner: np.ndarray,
    first: np.ndarray,
    count: int,
) -> tuple[np.ndarray, np.ndarray]:
    """(S,) the slice below each, that with which it shares most; and the pairs left over."""
    steps = np.where(node_slice[one] == node_slice[other], 0, inner + 1)
    edge, rank = numbered(steps)
    lower = np.where(rank == 0, one[edge], first[edge] + rank - 1)
    upper = np.where(rank == inner[edge], other[edge], first[edge] + rank)
    key = np.sort(node_slice[upper] * count + node_slice[lower])
    bounds = np.flatnonzero(np.diff(key, prepend=-1, append=-1))
    shared = np.diff(bounds)
    up, down = np.divmod(key[bounds[:-1]], count)
    order = np.lexsort((-shared, up))
    up, down = up[order], down[order]
    best = np.diff(up, prepend=-1) > 0
    below = np.full(count, -1)
    below[up[best]] = down[best]
    return below, np.stack([up[~best], down[~best]], axis=1)


def _moments(
    pieces: Pieces,
    distance: np.ndarray,
    width: float,
    band: np.ndarray,
    edges: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    node_slice: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(S, 3) middle of what slices hold of edges, (S, 3, 3) its covariance, (S,) its length."""
    one, other, edge, rank = edges
    start, end = pieces.vertices[one], pieces.vertices[other]
    length = np.linalg.norm(end - start, axis=1)
    rise = np.maximum(distance[other] - distance[one], 1e-300)
    inside = band[one] == band[other]
    # shares of an edge within the band of its lower and of its upper end
    lower = np.where(inside, 0.5, ((band[one] + 1) * width - distance[one]) / rise)
    upper = np.where(inside, 0.5, (distance[other] - band[other] * width) / rise)
    lower, upper = np.clip(lower, 1e-6, 1.0), np.clip(upper, 1e-6, 1.0)
    through = ((band[one[edge]] + 1.5 + rank) * width - distance[one[edge]]) / rise[edge]
    through = np.clip(through, 0.0, 1.0)[:, None]
    near, far = length * lower, length * upper  # what the two ends hold; gathered by vertex first
    held = np.bincount(one, near, len(band)) + np.bincount(other, far, len(band))
    drawn = (end - start).T * (np.stack([near * lower, far * upper])[:, None] / 2)
    offset = [np.bincount(one, x, len(band)) for x in drawn[0]]
    offset = [x - np.bincount(other, y, len(band)) for x, y in zip(offset, drawn[1], strict=True)]
    mean = pieces.vertices + np.stack(offset, axis=1) / np.maximum(held, 1e-300)[:, None]
    place = np.concatenate([mean, start[edge] * (1 - through) + end[edge] * through])
    weight = np.concatenate([held, length[edge] * np.clip(width / rise[edge], 0.0, 1.0)])
    of, count = node_slice, int(node_slice.max()) + 1
    total = np.maximum(np.bincount(of, weight, count), 1e-300)
    centre = sums(of, weight[:, None] * place, count) / total[:, None]
    place -= centre[of]
    spread = np.empty((count, 3, 3))
    for row in range(3):
        for column in range(row + 1):
            mean = np.bincount(of, weight * place[:, row] * place[:, column], count) / total
            spread[:, row, column] = spread[:, column, row] = mean
    return centre, spread, total


@dataclass(frozen=True)
class PieceAxes:
    """A axes of sliced pieces; an axis comes after its parent.

    of_slice : (S,) axis of each slice. parent : (A,) axis it begins on, -1 for that of a root.
    fork : (A,) slice of the parent that it begins on, -1.
    chain : (S,) whether a slice is on its axis, and no bump beside it.
    centre, heading : (S, 3) of the axis, and radius : (S,) about it, without the bulges of forks at slices
        that are on axes.
    """

    of_slice: np.ndarray
    parent: np.ndarray
    fork: np.ndarray
    chain: np.ndarray
    centre: np.ndarray
    heading: np.ndarray
    radius: np.ndarray

    def chains(self) -> tuple[np.ndarray, Runs]:
        """The slices on their axes, axis by axis from the foot up, and the run of each axis."""
        chain = np.flatnonzero(self.chain)
        order = chain[np.argsort(self.of_slice[chain], kind="stable")]
        return order, Runs.of(self.of_slice[order], len(self.parent))


def find_axes(slices: Slices) -> PieceAxes:
    """Follow the slices of all pieces from their roots to the tips."""
    band, below, every = slices.band, slices.below, np.arange(len(slices.band))
    mass, top = slices.weight.copy(), band.copy()  # of each slice and all above it
    for level in reversed(np.split(every, np.flatnonzero(np.diff(band)) + 1)):
        upper = level[below[level] >= 0]
        np.add.at(mass, below[upper], mass[upper])
        np.maximum.at(top, below[upper], top[upper])
    onward = every.copy()  # the slice above that carries most, itself at a tip
    upper = np.flatnonzero(below >= 0)
    upper = upper[np.argsort(mass[upper], kind="stable")]
    onward[below[upper]] = upper  # the last one stays
    down = np.where(below < 0, every, below)
    radius = radii(slices, onward, down)
    kid = np.flatnonzero(
        (below >= 0) & (np.bincount(below[upper], minlength=len(every))[below] > 1)
    )
    fork = below[kid]
    reach = (top[kid] - band[fork]) * slices.width
    own = _walk(onward, kid, (top[kid] - band[kid]) // 2)
    real = (reach > SLENDER * radius[own]) & (reach > CLEAR * radius[fork])
    real &= top[kid] - band[fork] > SHORTEST
    real |= onward[fork] == kid
    kid, fork = kid[real], fork[real]

    score = _likeness(slices, onward, down, radius, kid, fork)
    leads = firsts(np.lexsort((-score, fork)), fork)
    onward[fork[leads]] = kid[leads]
    begins = below < 0
    begins[np.delete(kid, leads)] = True
    # What is neither led on to nor begins an axis is its parent's, a bump as what stands on it.
    of_slice = (np.cumsum(begins) - 1)[root_of(np.where(begins, -1, below))]
    led = begins | (onward[below] == every)
    chain = led[root_of(np.where(begins | ~led, -1, below))]
    fork = below[begins]
    parent = np.where(fork < 0, -1, of_slice[fork])
    radius = radii(slices, onward, down)
    axes = PieceAxes(
        of_slice, parent, fork, chain, slices.centre.copy(), np.zeros_like(slices.centre), radius
    )
    _smooth(slices, axes)
    return axes


def _walk(step: np.ndarray, start: np.ndarray, many: np.ndarray) -> np.ndarray:
    """Walk so many steps from each start."""
    at = start.copy()
    for taken in range(int(many.max(initial=0))):
        going = many > taken
        at[going] = step[at[going]]
    return at


def radii(slices: Slices, onward: np.ndarray, down: np.ndarray) -> np.ndarray:
    """(S,) root mean square distance of what slices hold from the axis through them."""
    rough = np.sqrt(np.trace(slices.spread, axis1=1, axis2=2))
    steps = np.clip(np.ceil(rough / slices.width), 1, MOST_STEPS).astype(np.int64)
    everything = np.arange(len(down))
    heading = slices.centre[_walk(onward, everything, steps)]
    heading = unit(heading - slices.centre[_walk(down, everything, steps)])
    along = np.einsum("si,sij,sj->s", heading, slices.spread, heading)
    return np.asarray(np.sqrt(np.maximum(rough**2 - along, 0.0)))


def _likeness(
    slices: Slices,
    onward: np.ndarray,
    down: np.ndarray,
    radius: np.ndarray,
    kid: np.ndarray,
    fork: np.ndarray,
) -> np.ndarray:
    """(K,) how much a child looks like the parent going on."""
    bands = radius[fork] / slices.width
    near = np.clip(np.ceil(NEAR * bands), 1, MOST_STEPS).astype(np.int64)
    far = np.clip(np.ceil(FAR * bands), 2, 2 * MOST_STEPS).astype(np.int64)
    a = _walk(onward, kid, near)
    b = _walk(onward, a, far - near)
    middle = _walk(onward, a, (far - near) // 2)
    ahead = slices.centre[b] - slices.centre[a]
    behind = slices.centre[_walk(down, fork, near)] - slices.centre[_walk(down, fork, far)]
    turn = np.einsum("ki,ki->k", ahead, behind)
    turn /= np.maximum(np.linalg.norm(ahead, axis=1) * np.linalg.norm(behind, axis=1), 1e-300)
    thick = np.median(radius[np.stack([a, middle, b])], axis=0)
    return np.asarray(thick * (1 + STRAIGHT * turn) + 1e-9 * radius[fork])


def _smooth(slices: Slices, axes: PieceAxes) -> None:
    """Set the course of every axis: medians of the radius, and centres where that is not exceeded."""
    from scipy.ndimage import median_filter, uniform_filter1d  # here: few runs need it

    order, runs = axes.chains()
    for own in np.split(order, runs.first[1:]):
        if len(own) < 3:
            step = slices.centre[own[-1]] - slices.centre[max(slices.below[own[0]], 0)]
            axes.heading[own] = step
            continue
        radius = axes.radius[own]
        window = WINDOW * float(np.median(radius)) / slices.width
        window = int(np.clip(2 * np.ceil(window) + 1, 3, 2 * (len(own) // 2) + 1))
        typical = median_filter(radius, window, mode="reflect")
        clean, place = radius <= 1.1 * typical, np.arange(len(own))
        middle = np.stack(
            [np.interp(place, place[clean], x) for x in slices.centre[own][clean].T], axis=1
        )
        short, span = max(window // 3, 1), min(max(window // 2, 1), len(own) - 1)
        axes.centre[own] = (
            uniform_filter1d(middle, short, axis=0, mode="nearest") if short > 1 else middle
        )
        axes.radius[own] = typical
        before, after = np.maximum(place - span, 0), np.minimum(place + span, len(own) - 1)
        axes.heading[own] = middle[after] - middle[before]
    axes.heading[:] = unit(axes.heading)


def beginnings(slices: Slices, axes: PieceAxes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(A, 3) a place on each axis clear of its fork, (A, 3) its heading there, (A,) its radius."""
    order, runs = axes.chains()
    middle = order[runs.first + runs.size // 2]
    ahead = np.ceil(2 * axes.radius[middle] / slices.width).astype(np.int64)
    clear = order[runs.first + np.minimum(ahead, (runs.size - 1) // 3)]
    return axes.centre[clear], axes.heading[clear], axes.radius[clear]


WITHIN = 0.8  # radius of the parent within which the foot of a child is made to fit
DEEPEST = 4.0  # radii of the parent that it goes inwards at most
SEVER_FAR = 3.0  # radii of a tube of that area and length, beyond which a piece may fork
FEWEST = 12  # triangles of a piece that forks
COARSE = 3.0  # width of bands for the first look, from the wrong end
STOUT_ROOT = 0.7  # share of the thickest end's radius that the root's is at least
OUTSIDE = 1.15  # radii of the parent from its axis where a child's bark begins
BESIDE = 2.0  # radii of the child from its axis within which bark is its own
ROUNDS = 100  # of taking bark back, an edge at a time
ALIKE = 1.35  # factor between the radii of the two ends, at most
SEVER_STRAIGHT = np.cos(np.deg2rad(30.0))  # of the turn from one to the other
ASIDE = 0.4  # radii that the ends are off each other's course
GAP, OVERLAP = 1.0, 2.0  # radii that they are apart along it, or within each other
TIED = 1.5  # radii of an end whose corners are tied to the other's
CROWD = 2.0  # radii around two ends within which no third one is,
LIKE = 2.0  # thinner by less than this factor
TAPERED = 0.35  # of a piece's other end: one that is thinner is a tip
NO_TWIG = 0.15  # of the thickest end: twigs that begin at one another's tips stay apart
SEVER_SLENDER = 1.0  # radii that a piece is long at least


@dataclass(frozen=True)
class Known(RowTable):
    """Knowledge of C pieces before they are hung, because they were cut from one another.

    parent : (C,) piece, -1 where it has to be found. foot : (C, 3) where it begins, on the parent's axis.
    radius : (C,) of the parent there.
    """

    parent: np.ndarray
    foot: np.ndarray
    radius: np.ndarray

    @classmethod
    def nothing(cls, count: int) -> Known:
        """Nothing is known of pieces that were drawn apart."""
        return cls(np.full(count, -1), np.zeros((count, 3)), np.zeros(count))


def close(
    pieces: Pieces,
    label: np.ndarray,
    slices: Slices,
    axes: PieceAxes,
    halves: np.ndarray,
) -> tuple[Pieces, Known]:
    """Pieces by label, holes closed and feet drawn inwards."""
    triangles = pieces.triangles.astype(np.int64)
    halves = halves[label[halves[:, 0] // 3] != label[halves[:, 1] // 3]]
    halves = np.concatenate([halves, halves[:, ::-1]])
    child, beyond = label[halves[:, 0] // 3], label[halves[:, 1] // 3]
    rim = (axes.parent[child] >= 0) & (axes.parent[beyond] != child)
    half, child, beyond = halves[rim, 0], child[rim], beyond[rim]
    a, b = triangles[half // 3, half % 3], triangles[half // 3, (half + 1) % 3]
    foot_rim = _nearest_rim(
        pieces.vertices,
        a,
        b,
        child,
        beyond == axes.parent[child],
        slices.centre[np.maximum(axes.fork, 0)],
    )
    a, b, child = a[foot_rim], b[foot_rim], child[foot_rim]

    count = len(axes.parent)
    size = np.maximum(np.bincount(child, minlength=count), 1)
    place = pieces.vertices[a]
    middle = sums(child, place, count) / size[:, None]
    wide = np.sqrt(np.bincount(child, ((place - middle[child]) ** 2).sum(axis=1), count) / size)
    foot, apex, thick = _meetings(slices, axes, middle, wide)
    shrink = np.minimum(1.0, WITHIN * thick / np.maximum(wide, 1e-300))

    base = len(pieces.vertices)
    keys, number = np.unique(
        np.concatenate([child * base + a, child * base + b]), return_inverse=True
    )
    whose, vertex = np.divmod(keys, base)
    inner = foot[whose] + (pieces.vertices[vertex] - middle[whose]) * shrink[whose, None]
    inner_a, inner_b = base + number.reshape(2, -1)
    tip = base + len(inner) + child
    vertices = np.concatenate([pieces.vertices, inner, apex])
    made = np.concatenate(
        [
            np.stack([a, b, tip], axis=1),
            np.stack([b, a, inner_a], axis=1),
            np.stack([b, inner_a, inner_b], axis=1),
        ]
    )
    loose = loose_edges_of(pieces)
    everything = np.concatenate([triangles, made, loose])
    whole = np.concatenate(
        [label, axes.parent[child], child, child, axes.of_slice[slices.of_vertex[loose[:, 0]]]]
    )
    present, first = np.unique(label, return_index=True)
    known = np.isin(whole, present)
    everything, whole = everything[known], whole[known]
    has_area = everything[:, 1] != everything[:, 2]
    number = np.zeros(count, dtype=np.int64)
    by_appearance = present[np.argsort(first)]
    number[by_appearance] = np.arange(len(by_appearance))
    cut = assemble(vertices, everything, number[whole], has_area, drawn=len(triangles))
    parents = axes.parent[by_appearance]
    parents = np.where(np.isin(parents, present), number[np.maximum(parents, 0)], -1)
    parents[np.bincount(child, minlength=count)[by_appearance] == 0] = -1
    return _hang_together(cut, Known(parents, foot[by_appearance], thick[by_appearance]))


def _hang_together(pieces: Pieces, known: Known) -> tuple[Pieces, Known]:
    """Parts of a piece that do not hang together become pieces; what only closed them is dropped."""
    part = join_along(pieces.edges, len(pieces.vertices))
    area = pieces.area
    drawn = np.arange(len(pieces.triangles)) < pieces.drawn
    of_triangle = part[pieces.triangles[:, 0]]
    total = np.bincount(of_triangle, np.where(drawn, area, 0.0), int(part.max()) + 1)
    if len(total) == pieces.count:
        return pieces, known
    of_part = np.zeros(len(total), dtype=np.int64)
    of_part[part] = pieces.piece_of_vertex
    order = np.lexsort((-total, of_part))
    main = firsts(order, of_part)
    others = np.setdiff1d(np.flatnonzero(total > 0), main)
    number = np.full(len(total), -1)
    number[main], number[others] = of_part[main], pieces.count + np.arange(len(others))
    kept = number[of_triangle] >= 0
    loose = loose_edges_of(pieces)
    loose = loose[number[part[loose[:, 0]]] >= 0]
    whole = assemble(
        pieces.vertices,
        np.concatenate([pieces.triangles[kept].astype(np.int64), loose]),
        np.concatenate([number[of_triangle[kept]], number[part[loose[:, 0]]]]),
        np.arange(int(kept.sum()) + len(loose)) < kept.sum(),
        drawn=pieces.drawn,
    )
    return whole, Known.joined([known, Known.nothing(len(others))])


def _nearest_rim(
    vertices: np.ndarray,
    a: np.ndarray,
    b: np.ndarray,
    child: np.ndarray,
    to_parent: np.ndarray,
    begins: np.ndarray,
) -> np.ndarray:
    """(N,) whether an edge from a to b is on the rim where its child begins; others are left open."""
    base = len(vertices)
    keys, number = np.unique(
        np.concatenate([child * base + a, child * base + b]), return_inverse=True
    )
    one, other = number.reshape(2, -1)
    rim = join_along(np.stack([one, other], axis=1), len(keys))[one]
    count = int(rim.max(initial=-1)) + 1
    size = np.maximum(np.bincount(rim, minlength=count), 1)
    middle = sums(rim, vertices[a], count) / size[:, None]
    whose = np.zeros(count, dtype=np.int64)
    whose[rim] = child
    away = np.linalg.norm(middle - begins[whose], axis=1)
    to_it = np.bincount(rim, to_parent, count) > 0
    order = np.lexsort((away, ~to_it, whose))
    chosen = np.zeros(count, dtype=bool)
    chosen[firsts(order, whose)] = True
    return np.asarray(chosen[rim])


def _meetings(
    slices: Slices, axes: PieceAxes, middle: np.ndarray, wide: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (A, 3) where axes meet their parents', the middle (A, 3) of the bark there, its radius (A,)."""
    start, heading, _ = beginnings(slices, axes)
    foot, apex, thick = middle.copy(), middle.copy(), np.ones(len(axes.parent))
    order, runs = axes.chains()
    first, many = runs.first, runs.size
    rank = np.zeros(len(slices.band), dtype=np.int64)
    rank[order] = np.arange(len(order)) - np.repeat(first, many)
    for axis in np.flatnonzero(axes.parent >= 0).tolist():
        parent = int(axes.parent[axis])
        fork = int(axes.fork[axis])
        while not axes.chain[fork]:
            fork = int(slices.below[fork])
        radius = float(axes.radius[fork])
        reach = int(np.ceil((DEEPEST * radius + 4 * wide[axis]) / slices.width)) + 1
        at = int(rank[fork])
        near = order[
            first[parent] + max(at - reach, 0) : first[parent] + min(at + reach, many[parent])
        ]
        places = axes.centre[near]
        beside = np.linalg.norm(places - middle[axis], axis=1)
        closest = int(near[np.argmin(beside)])
        back = (places - start[axis]) @ heading[axis]
        aside = np.linalg.norm(places - start[axis] - back[:, None] * heading[axis], axis=1)
        allowed = (back <= 0) & (beside <= DEEPEST * radius)
        meet = int(near[np.argmin(np.where(allowed, aside, np.inf))]) if allowed.any() else closest
        foot[axis], thick[axis] = axes.centre[meet], axes.radius[meet]
        out = middle[axis] - axes.centre[closest]
        far = float(np.linalg.norm(out))
        if far > 0:
            apex[axis] = axes.centre[closest] + out * min(1.0, axes.radius[closest] / far)
    return foot, apex, thick


def sever(pieces: Pieces, forked: np.ndarray) -> tuple[Pieces, Known, np.ndarray]:
    """Cut pieces at their forks, those (C,) that may have some; the others come first, as they are.

    Also told: from which piece each was cut, and where; and (N, 3) places where branches hang together that
    do not fork there.
    """
    rest, joined = select(pieces, ~forked), select(pieces, forked)
    roots = _find_roots(joined)
    slices = slice_up(joined, distance_from(joined, roots), band_width(joined))
    axes = find_axes(slices)
    a, b, c = _take_back(joined, slices, axes)[joined.triangles].T
    # The axis of most of a triangle's corners; of three, that which is most of a parent.
    most = np.where((a == b) | (a == c), a, np.where(b == c, b, np.minimum(np.minimum(a, b), c)))
    halves = half_edges(joined.triangles, len(joined.vertices))
    cut, known = close(joined, _whole(joined, most, halves), slices, axes, halves)
    parent = np.where(known.parent < 0, -1, known.parent + rest.count)
    known = Known.joined([Known.nothing(rest.count), replace(known, parent=parent)])
    return join_pieces(rest, cut), known, slices.centre[slices.loops].mean(axis=1)


def may_fork(pieces: Pieces, lines: Centrelines) -> np.ndarray:
    """(C,) whether some of a piece is farther from its line than a tube's surface is."""
    area = np.bincount(pieces.piece, pieces.area, pieces.count)
    radius = area / (2 * np.pi * np.maximum(lines.length(), 1e-300))
    away = np.zeros(pieces.count)
    np.maximum.at(away, pieces.piece_of_vertex, np.linalg.norm(lines.outward, axis=1))
    enough = np.bincount(pieces.piece, minlength=pieces.count) >= FEWEST
    return np.asarray((away > SEVER_FAR * radius) & enough)


def _find_roots(pieces: Pieces) -> np.ndarray:
    """Vertices around the thick, low end of each piece."""
    count, owner = pieces.count, pieces.piece_of_vertex
    away = np.linalg.norm(pieces.vertices - pieces.middles()[owner], axis=1)
    start = pieces.largest(away)
    slices = slice_up(pieces, distance_from(pieces, start), COARSE * band_width(pieces))
    axes = find_axes(slices)
    radius = axes.radius

    order, runs = axes.chains()
    last, first = order[runs.first + runs.size - 1], order[runs.first]
    ends = np.concatenate([last, first[axes.parent < 0]])
    piece = slices.piece[ends]
    thickest = np.zeros(count)
    np.maximum.at(thickest, piece, radius[ends])
    stout = radius[ends] >= STOUT_ROOT * thickest[piece]
    ranked = np.lexsort((slices.centre[ends, 2], ~stout, piece))
    root = np.zeros(len(slices.band), dtype=bool)
    root[ends[firsts(ranked, piece)]] = True
    is_root = root[slices.of_vertex]
    is_root[start[~np.isin(np.arange(count), owner[is_root])]] = True
    return np.flatnonzero(is_root)


def _take_back(pieces: Pieces, slices: Slices, axes: PieceAxes) -> np.ndarray:
    """(V,) axis of each vertex, children's bark beyond the parents' tubes given to the children."""
    owner = axes.of_slice[slices.of_vertex]
    start, heading, thick = beginnings(slices, axes)
    one, other = np.concatenate([pieces.edges, pieces.edges[:, ::-1]]).T
    front = np.flatnonzero(axes.parent[owner[one]] == owner[other])
    for _ in range(ROUNDS):
        child, place = owner[one[front]], other[front]
        of = slices.of_vertex[place]
        beside = _aside(pieces.vertices[place] - start[child], heading[child])
        out = _aside(pieces.vertices[place] - axes.centre[of], axes.heading[of])
        taken = (beside <= BESIDE * thick[child]) & (out > OUTSIDE * axes.radius[of])
        if not taken.any():
            break
        owner[place[taken]] = child[taken]
        moved = np.zeros(len(owner), dtype=bool)
        moved[place[taken]] = True
        front = np.flatnonzero(moved[one])
        front = front[axes.parent[owner[one[front]]] == owner[other[front]]]
    return owner


def _aside(offset: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """(N,) how far offsets (N, 3) reach across headings (N, 3)."""
    along = np.einsum("ni,ni->n", offset, heading)
    return np.asarray(np.linalg.norm(offset - along[:, None] * heading, axis=1))


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
        crumb[firsts(order, of_part)] = False
        rim = beside[~same]
        rim = np.concatenate([rim, rim[:, ::-1]])
        rim = rim[crumb[part[rim[:, 0]]] & ~crumb[part[rim[:, 1]]]]
        if not len(rim):
            break
        goes_to = of_part.copy()
        goes_to[part[rim[:, 0]]] = label[rim[:, 1]]
        label = goes_to[part]
    return label


def join_stacked(pieces: Pieces, lines: Centrelines) -> Pieces:
    """The pieces, those that stand on one another as one."""
    pairs = _stacked_ends(lines)
    if not len(pairs) or len(pairs) == pieces.count - 1:  # all of it would be a pole
        return pieces
    triangles = pieces.triangles.astype(np.int64)
    loose = loose_edges_of(pieces)
    ties = np.concatenate([_ties(pieces, lines, *ends) for ends in pairs.tolist()])
    label = join_along(pairs // 2, pieces.count).astype(np.int64)
    everything = np.concatenate([triangles, loose, ties])
    of = label[pieces.piece_of_vertex[everything[:, 0]]]
    _, first, of = np.unique(of, return_index=True, return_inverse=True)
    of = np.argsort(np.argsort(first))[of.ravel()]  # in the order of the file
    has_area = np.arange(len(everything)) < len(triangles)
    return assemble(pieces.vertices, everything, of, has_area, drawn=pieces.drawn)


def _stacked_ends(lines: Centrelines) -> np.ndarray:
    """(N, 2) ends, 2·piece + 0 first or 1 last, that meet; each end is in one pair at most."""
    ends, radius = lines.ends().reshape(-1, 3), lines.end_radius.ravel()
    second = np.stack([lines.first[:-1] + 1, lines.first[1:] - 2], axis=1).ravel()
    out = unit(ends - lines.knot[second])
    far = lines.end_radius[:, ::-1].ravel()
    fit = np.repeat((lines.length() > SEVER_SLENDER * lines.end_radius.max(axis=1)), 2) & (
        radius > 0
    )
    fit &= (radius >= TAPERED * far) & (radius >= NO_TWIG * radius.max())
    row = np.flatnonzero(fit)
    if len(row) < 2:
        return np.empty((0, 2), np.int64)
    near = scipy.spatial.cKDTree(ends[row]).query(ends[row], k=min(8, len(row)))[1]
    one = np.repeat(row, near.shape[1])
    other = row[near].ravel()
    kept = one // 2 < other // 2
    pair = np.unique(np.stack([one[kept], other[kept]], axis=1), axis=0)
    one, other = pair.T
    way = ends[other] - ends[one]
    thin = np.minimum(radius[one], radius[other])
    thick = np.maximum(radius[one], radius[other])
    apart = np.einsum("ni,ni->n", way, out[one])
    course = unit(out[one] - out[other])
    aside = way - np.einsum("ni,ni->n", way, course)[:, None] * course
    turn = -np.einsum("ni,ni->n", out[one], out[other])
    off = np.linalg.norm(aside, axis=1)
    meets = (thick <= ALIKE * thin) & (turn >= SEVER_STRAIGHT) & (off <= ASIDE * thin)
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
        corners = begin + np.flatnonzero(away <= TIED * lines.end_radius[piece, last])
        rows.append(corners if len(corners) else begin + np.argsort(away)[:1])
    a, b = rows
    nearest = b[scipy.spatial.cKDTree(pieces.vertices[b]).query(pieces.vertices[a])[1]]
    return np.stack([a, nearest, nearest], axis=1)
