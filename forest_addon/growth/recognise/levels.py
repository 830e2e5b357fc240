"""Slices of a mesh between levels of the distance from its root: a skeleton that knows forks.

The distance along the surface from a root is a function on the mesh (Verroust & Lazarus 2000); between
two neighbouring levels of it, a tube has one slice, and beyond a fork a tree has as many as it has
branches there (a Reeb graph, sampled). Along an edge the distance is taken as linear, so that a slice
may lie between two rings of vertices, however far they are apart. Slices are the connected components
of what edges have within bands of equal width; every one but a root's has a slice below.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from .pieces import Pieces, join_along

FINEST = 3000  # bands at most along the largest piece's extent
NODES = 3.0  # places on edges at most, in vertices of the mesh


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
    row = np.repeat(np.arange(len(tall)), inner)
    rank = np.arange(len(row)) - np.repeat(np.cumsum(inner) - inner, inner)
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
    edge = np.repeat(np.arange(len(one)), steps)
    rank = np.arange(len(edge)) - np.repeat(np.cumsum(steps) - steps, steps)
    lower = np.where(rank == 0, one[edge], first[edge] + rank - 1)
    upper = np.where(rank == inner[edge], other[edge], first[edge] + rank)
    key = node_slice[upper] * count + node_slice[lower]
    key = np.sort(key)
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
    centre = np.stack([np.bincount(of, weight * axis, count) for axis in place.T], axis=1)
    centre /= total[:, None]
    place -= centre[of]
    spread = np.empty((count, 3, 3))
    for row in range(3):
        for column in range(row + 1):
            mean = np.bincount(of, weight * place[:, row] * place[:, column], count) / total
            spread[:, row, column] = spread[:, column, row] = mean
    return centre, spread, total
