"""Slices of a mesh between levels of the distance from its root: a skeleton that knows forks.

The distance along the surface from a root is a function on the mesh (Verroust & Lazarus 2000); between
two neighbouring levels of it, a tube has one slice, and beyond a fork a tree has as many as it has
branches there (a Reeb graph, sampled). Along an edge the distance is taken as linear, so that a slice
may lie between two rings of vertices, however far they are apart. Slices are the connected components
of what edges have within bands of equal width; every one but a root's has a slice below.

Axes say which slices follow one another as a trunk or a branch. At a fork the axis goes on as the child that
is thickest and straightest a few radii on, where slices are clean of the fork itself; the others begin axes
of their own. What ends before it is three times as long as thick, or within its parent's bark, is a bump and
no branch. The course of an axis is without the bulges of its forks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from ...base.runs import Runs, firsts, numbered, sums
from .pieces import Pieces, join_along

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

    def __len__(self) -> int:
        return len(self.band)


def distance_from(pieces: Pieces, roots: np.ndarray) -> np.ndarray:
    """(V,) distance along edges from the nearest of the root vertices."""
    one, other = pieces.edges.T
    length = np.linalg.norm(pieces.vertices[one] - pieces.vertices[other], axis=1)
    count = len(pieces.vertices)
    graph = csr_matrix((np.maximum(length, 1e-300), (one, other)), shape=(count, count))
    return np.asarray(dijkstra(graph, directed=False, indices=roots, min_only=True))


def band_width(pieces: Pieces) -> float:
    """As fine as memory and the mesh bear."""
    one, other = pieces.edges.T
    total = float(np.linalg.norm(pieces.vertices[one] - pieces.vertices[other], axis=1).sum())
    extent = float(np.ptp(pieces.vertices, axis=0).max())
    return max(extent / FINEST, total / (NODES * len(pieces.vertices) + 2e5))


def slice_up(pieces: Pieces, distance: np.ndarray, width: float) -> Slices:
    """Slices between levels ``width`` apart of a ``distance`` (V,) that has no minimum but the roots."""
    band = (distance / width).astype(np.int64)
    one, other = pieces.edges.T.astype(np.int64)
    swap = band[one] > band[other]
    one, other = np.where(swap, other, one), np.where(swap, one, other)
    inner = np.maximum(band[other] - band[one] - 1, 0)  # bands that an edge only passes through
    first = len(band) + np.cumsum(inner) - inner  # its node in the lowest of those
    nodes = len(band) + int(inner.sum())

    level = band[one] == band[other]
    pairs = [np.stack([one[level], other[level]], axis=1)]
    pairs.append(_across_triangles(pieces, band, one, other, first))
    node_slice = join_along(np.concatenate(pairs), nodes)

    edge = np.repeat(np.arange(len(one)), inner)
    rank = np.arange(len(edge)) - np.repeat(first - len(band), inner)
    node_band = np.concatenate([band, band[one[edge]] + 1 + rank])
    count = int(node_slice.max()) + 1
    order_band = np.zeros(count, dtype=np.int64)
    order_band[node_slice] = node_band
    order = np.argsort(order_band, kind="stable")
    number = np.empty(count, dtype=np.int64)
    number[order] = np.arange(count)
    node_slice = number[node_slice]

    below, loops = _stack(node_slice, one, other, inner, first, count)
    owner = np.zeros(count, dtype=np.int64)
    owner[node_slice[: len(band)]] = pieces.piece_of_vertex
    owner[node_slice[len(band) :]] = pieces.piece_of_vertex[one[edge]]
    moments = _moments(pieces, distance, width, band, (one, other, edge, rank), node_slice)
    return Slices(node_slice[: len(band)], owner, order_band[order], below, loops, *moments, width)


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
    radius : (S,) root mean square distance of the surface from the axis.
    chain : (S,) whether a slice is on its axis, and no bump beside it.
    """

    of_slice: np.ndarray
    parent: np.ndarray
    fork: np.ndarray
    radius: np.ndarray
    chain: np.ndarray

    def __len__(self) -> int:
        return len(self.parent)

    def chains(self) -> tuple[np.ndarray, Runs]:
        """The slices on their axes, axis by axis from the foot up, and the run of each axis."""
        chain = np.flatnonzero(self.chain)
        order = chain[np.argsort(self.of_slice[chain], kind="stable")]
        return order, Runs.of(self.of_slice[order], len(self))


def find_axes(slices: Slices) -> PieceAxes:
    """Follow the slices of all pieces from their roots to the tips."""
    mass, top = _carried(slices)
    onward = np.arange(len(slices))  # the slice above that carries most, itself at a tip
    upper = np.flatnonzero(slices.below >= 0)
    upper = upper[np.argsort(mass[upper], kind="stable")]
    onward[slices.below[upper]] = upper  # the last one stays
    radius = radii(slices, onward)
    above = np.bincount(slices.below[slices.below >= 0], minlength=len(slices))
    kid = np.flatnonzero((slices.below >= 0) & (above[slices.below] > 1))  # above forks
    fork = slices.below[kid]
    reach = (top[kid] - slices.band[fork]) * slices.width
    own = _walk(onward, kid, (top[kid] - slices.band[kid]) // 2)
    first = onward[fork] == kid
    branch = (reach > SLENDER * radius[own]) & (reach > CLEAR * radius[fork])
    branch &= top[kid] - slices.band[fork] > SHORTEST
    real = branch | first
    kid, fork, first = kid[real], fork[real], first[real]

    score = _likeness(slices, onward, radius, kid, fork)
    order = np.lexsort((-score, fork))
    leads = np.zeros(len(kid), dtype=bool)
    leads[firsts(order, fork)] = True
    onward = onward.copy()
    onward[fork[leads]] = kid[leads]
    radius = radii(slices, onward)
    begins = np.isin(np.arange(len(slices)), kid[~leads])
    return _number(slices, onward, begins, radius)


def _carried(slices: Slices) -> tuple[np.ndarray, np.ndarray]:
    """(S,) what each slice and all above it hold, and (S,) the highest band above it."""
    mass, top = slices.weight.copy(), slices.band.copy()
    for low, high in reversed(_runs(slices.band)):
        below = slices.below[low:high]
        has = below >= 0
        np.add.at(mass, below[has], mass[low:high][has])
        np.maximum.at(top, below[has], top[low:high][has])
    return mass, top


def _runs(band: np.ndarray) -> list[tuple[int, int]]:
    """First and last of the slices of every band, from the lowest up."""
    bounds = np.flatnonzero(np.diff(band, prepend=-1, append=band[-1] + 1))
    return list(zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True))


def _walk(step: np.ndarray, start: np.ndarray, many: np.ndarray) -> np.ndarray:
    """Walk so many steps from each start."""
    at = start.copy()
    for taken in range(int(many.max(initial=0))):
        going = many > taken
        at[going] = step[at[going]]
    return at


def radii(slices: Slices, onward: np.ndarray) -> np.ndarray:
    """(S,) root mean square distance of what slices hold from the axis through them."""
    down = np.where(slices.below < 0, np.arange(len(slices)), slices.below)
    rough = np.sqrt(np.trace(slices.spread, axis1=1, axis2=2))
    steps = np.clip(np.ceil(rough / slices.width), 1, MOST_STEPS).astype(np.int64)
    everything = np.arange(len(slices))
    heading = slices.centre[_walk(onward, everything, steps)]
    heading = heading - slices.centre[_walk(down, everything, steps)]
    heading /= np.maximum(np.linalg.norm(heading, axis=1, keepdims=True), 1e-300)
    along = np.einsum("si,sij,sj->s", heading, slices.spread, heading)
    return np.asarray(np.sqrt(np.maximum(rough**2 - along, 0.0)))


def _likeness(
    slices: Slices, onward: np.ndarray, radius: np.ndarray, kid: np.ndarray, fork: np.ndarray
) -> np.ndarray:
    """(K,) how much a child looks like the parent going on."""
    bands = radius[fork] / slices.width
    near = np.clip(np.ceil(NEAR * bands), 1, MOST_STEPS).astype(np.int64)
    far = np.clip(np.ceil(FAR * bands), 2, 2 * MOST_STEPS).astype(np.int64)
    down = np.where(slices.below < 0, np.arange(len(slices)), slices.below)
    a = _walk(onward, kid, near)
    b = _walk(onward, a, far - near)
    middle = _walk(onward, a, (far - near) // 2)
    before, earlier = _walk(down, fork, near), _walk(down, fork, far)
    ahead, behind = (
        slices.centre[b] - slices.centre[a],
        slices.centre[before] - slices.centre[earlier],
    )
    turn = np.einsum("ki,ki->k", ahead, behind)
    turn /= np.maximum(np.linalg.norm(ahead, axis=1) * np.linalg.norm(behind, axis=1), 1e-300)
    thick = np.median(radius[np.stack([a, middle, b])], axis=0)
    return np.asarray(thick * (1 + STRAIGHT * turn) + 1e-9 * radius[fork])


def _number(
    slices: Slices, onward: np.ndarray, begins: np.ndarray, radius: np.ndarray
) -> PieceAxes:
    """Axes from the roots up; what is neither led on to nor begins an axis is its parent's."""
    of_slice = np.full(len(slices), -1)
    parent: list[int] = []
    fork: list[int] = []
    begins = begins | (slices.below < 0)
    for low, high in _runs(slices.band):
        below = slices.below[low:high]
        new = np.flatnonzero(begins[low:high])
        of_slice[low:high] = of_slice[below]
        of_slice[low + new] = len(parent) + np.arange(len(new))
        parent += np.where(below[new] < 0, -1, of_slice[below[new]]).tolist()
        fork += below[new].tolist()
    chain = begins | (onward[slices.below] == np.arange(len(slices)))
    for low, high in _runs(slices.band):  # nor what stands on a bump
        chain[low:high] &= begins[low:high] | chain[slices.below[low:high]]
    return PieceAxes(of_slice, np.array(parent), np.array(fork), radius, chain)


@dataclass(frozen=True)
class Course:
    """Axes without the bulges of their forks, at the slices that are on them."""

    centre: np.ndarray  # (S, 3)
    heading: np.ndarray  # (S, 3) unit
    radius: np.ndarray  # (S,)


def smooth(slices: Slices, axes: PieceAxes) -> Course:
    """The course of every axis: medians of the radius, and centres where that is not exceeded."""
    from scipy.ndimage import median_filter, uniform_filter1d  # here: few runs need it

    centre, radius = slices.centre.copy(), axes.radius.copy()
    heading = np.zeros_like(centre)
    order, runs = axes.chains()
    for own in np.split(order, runs.first[1:]):
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
    return Course(centre, heading, radius)


def beginnings(
    slices: Slices, axes: PieceAxes, course: Course
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(A, 3) a place on each axis clear of its fork, (A, 3) its heading there, (A,) its radius."""
    order, runs = axes.chains()
    middle = order[runs.first + runs.size // 2]
    ahead = np.ceil(2 * course.radius[middle] / slices.width).astype(np.int64)
    clear = order[runs.first + np.minimum(ahead, (runs.size - 1) // 3)]
    return course.centre[clear], course.heading[clear], course.radius[clear]
