"""Facets into pieces: weld corners to vertices, then part the mesh where no edge joins it.

An STL is a bag of facets. Corners closer than a millionth of the mesh's extent become one vertex;
facets that collapse, or that repeat another whichever way round (a leaf drawn from both sides), are
dropped. A piece is what hangs together along edges: two leaves or branches that only touch at a point
stay two, and two that share an edge are one. Facets of no area, such as the needles that close cracks
between unequal rings, join pieces but are dropped afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

WELD = 1e-6  # share of the extent: nearer vertices are one, lower facets have no area
CELLS = 2**21 - 1  # along the extent, in which vertices are first gathered: 21 bits an axis


@dataclass(frozen=True)
class Pieces:
    """A welded mesh of C pieces, numbered in the order in which the file first shows them.

    vertices : (V, 3) float64, sorted by piece; no vertex belongs to two pieces.
    triangles : (T, 3) int32, all with an area, in the file's order.
    piece : (T,) int32, piece of each triangle.
    piece_of_vertex : (V,) int32.
    edges : (E, 2) int32, each once; those of needles too, so that every piece hangs together.
    drawn : how many of the triangles, the first ones, are the file's; what follows closes pieces where
        they were cut from one another.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    piece: np.ndarray
    piece_of_vertex: np.ndarray
    edges: np.ndarray
    drawn: int

    @property
    def count(self) -> int:
        """C, the number of pieces."""
        return int(self.piece_of_vertex[-1]) + 1 if len(self.piece_of_vertex) else 0

    def area_vectors(self) -> np.ndarray:
        """(T, 3) half cross products of the triangles' edges."""
        a = self.vertices[self.triangles[:, 0]]
        bx, by, bz = (self.vertices[self.triangles[:, 1]] - a).T
        cx, cy, cz = (self.vertices[self.triangles[:, 2]] - a).T
        return 0.5 * np.stack([by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx], axis=1)


def part(facets: np.ndarray) -> Pieces:
    """Weld facets (T, 3, 3) and part them into pieces; no pieces if no facet has an area."""
    vertices, triangles = weld(np.asarray(facets, dtype=np.float64))
    triangles = _distinct(triangles)
    piece = _join_along_edges(triangles, len(vertices))
    has_area = ~_is_needle(vertices, triangles)

    kept = np.isin(piece, piece[has_area])  # needles alone are no piece
    triangles, has_area = triangles[kept], has_area[kept]
    piece = np.unique(piece[kept], return_inverse=True)[1].astype(np.int64)

    return assemble(vertices, triangles, piece, has_area)


def assemble(
    vertices: np.ndarray,
    triangles: np.ndarray,
    piece: np.ndarray,
    has_area: np.ndarray | None = None,
    drawn: int | None = None,
) -> Pieces:
    """Pieces of triangles (T, 3) whose piece (T,) is known: each gets vertices of its own.

    has_area : (T,) where not, a triangle lends its edges only. drawn : see ``Pieces``.
    """
    has_area = np.ones(len(triangles), dtype=bool) if has_area is None else has_area
    # a vertex is a pair (piece, welded vertex)
    pairs, inverse = np.unique(piece[:, None] * len(vertices) + triangles, return_inverse=True)
    triangles = inverse.reshape(-1, 3)
    owner, welded = np.divmod(pairs, max(len(vertices), 1))
    keys = np.sort(_edge_keys(triangles, len(pairs)))
    keys = keys[np.diff(keys, prepend=-1) > 0]
    edges = np.stack(np.divmod(keys, max(len(pairs), 1)), axis=1)
    return Pieces(
        vertices=vertices[welded],
        triangles=triangles[has_area].astype(np.int32),
        piece=piece[has_area].astype(np.int32),
        piece_of_vertex=owner.astype(np.int32),
        edges=edges[edges[:, 0] != edges[:, 1]].astype(np.int32),
        drawn=int(np.count_nonzero(has_area[:drawn])),
    )


def select(pieces: Pieces, chosen: np.ndarray) -> Pieces:
    """Some pieces (C,) alone, in their order."""
    number = np.cumsum(chosen) - 1
    vertex = chosen[pieces.piece_of_vertex]
    renumbered = (np.cumsum(vertex) - 1).astype(np.int32)
    triangle = chosen[pieces.piece]
    edge = vertex[pieces.edges[:, 0]]
    return Pieces(
        vertices=pieces.vertices[vertex],
        triangles=renumbered[pieces.triangles[triangle]],
        piece=number[pieces.piece[triangle]].astype(np.int32),
        piece_of_vertex=number[pieces.piece_of_vertex[vertex]].astype(np.int32),
        edges=renumbered[pieces.edges[edge]],
        drawn=int(np.count_nonzero(triangle[: pieces.drawn])),
    )


def join_pieces(one: Pieces, other: Pieces) -> Pieces:
    """Pieces of two meshes, those of ``one`` first; what was not drawn comes last."""
    vertices, count = np.int32(len(one.vertices)), np.int32(one.count)
    order = np.argsort(
        np.concatenate([np.arange(len(mesh.triangles)) >= mesh.drawn for mesh in (one, other)]),
        kind="stable",
    )
    return Pieces(
        vertices=np.concatenate([one.vertices, other.vertices]),
        triangles=np.concatenate([one.triangles, other.triangles + vertices])[order],
        piece=np.concatenate([one.piece, other.piece + count])[order],
        piece_of_vertex=np.concatenate([one.piece_of_vertex, other.piece_of_vertex + count]),
        edges=np.concatenate([one.edges, other.edges + vertices]),
        drawn=one.drawn + other.drawn,
    )


def weld(facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and triangles (T, 3) of facets (T, 3, 3); chains of near vertices are one.

    Vertices are gathered in cells, then cells whose vertices are near are joined, so that it does not
    matter where the borders of the cells lie.
    """
    corners = facets.reshape(-1, 3)
    if not len(corners):
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
    low = corners.min(axis=0)
    extent = float((corners.max(axis=0) - low).max()) or 1.0
    cell = ((corners - low) / extent * CELLS).astype(np.int64)
    key = (cell[:, 0] << 42) | (cell[:, 1] << 21) | cell[:, 2]
    _, first, index = np.unique(key, return_index=True, return_inverse=True)
    vertices = corners[first]

    near = cKDTree(vertices).query_pairs(WELD * extent, output_type="ndarray")
    label = join_along(near, len(vertices))
    chosen = np.zeros(int(label.max()) + 1, dtype=np.int64)
    chosen[label[::-1]] = np.arange(len(vertices))[::-1]  # the first of each chain
    return vertices[chosen], label[index.ravel()].reshape(-1, 3).astype(np.int64)


def _distinct(triangles: np.ndarray) -> np.ndarray:
    """Triangles of three different vertices, the first of each set of three, in order."""
    corners = np.sort(triangles, axis=1)
    whole = np.flatnonzero((corners[:, 0] < corners[:, 1]) & (corners[:, 1] < corners[:, 2]))
    corners = corners[whole]
    order = np.lexsort(corners.T)  # stable: of equal ones the first in the file comes first
    repeats = (np.diff(corners[order], axis=0) == 0).all(axis=1)
    first = np.concatenate([order[:1], order[1:][~repeats]])
    return np.asarray(triangles[whole[np.sort(first)]])


def _join_along_edges(triangles: np.ndarray, vertices: int) -> np.ndarray:
    """(T,) number of the piece of each triangle, in order of first appearance."""
    keys = _edge_keys(triangles, vertices)
    order = np.argsort(keys, kind="stable")
    shared = keys[order[1:]] == keys[order[:-1]]
    triangle = order % max(len(triangles), 1)
    pairs = np.stack([triangle[:-1][shared], triangle[1:][shared]], axis=1)
    return join_along(pairs, len(triangles))


def edge_uses(pieces: Pieces) -> tuple[np.ndarray, np.ndarray]:
    """Key of every edge of a triangle, lower vertex first, and how many triangles have it."""
    key = np.sort(_edge_keys(pieces.triangles.astype(np.int64), len(pieces.vertices)))
    bounds = np.flatnonzero(np.diff(key, prepend=-1, append=-1))
    return key[bounds[:-1]], np.diff(bounds)


def join_along(pairs: np.ndarray, nodes: int) -> np.ndarray:
    """(nodes,) which of them pairs (N, 2) join: one number for all that hang together."""
    graph = coo_matrix((np.ones(len(pairs), dtype=bool), pairs.T), shape=(nodes, nodes))
    return np.asarray(connected_components(graph, directed=False)[1])


def _edge_keys(triangles: np.ndarray, vertices: int) -> np.ndarray:
    """(3T,) one number for each edge of each triangle, whichever way it runs."""
    one = triangles.T.ravel()
    other = triangles[:, [1, 2, 0]].T.ravel()
    keys: np.ndarray = np.minimum(one, other) * vertices + np.maximum(one, other)
    return keys


def _is_needle(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(T,) whether a triangle's height over its longest edge is within the welding distance."""
    if not len(triangles):
        return np.zeros(0, dtype=bool)
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    twice_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.maximum.reduce([np.linalg.norm(side, axis=1) for side in (b - a, c - b, a - c)])
    extent = float(np.ptp(vertices, axis=0).max())
    needle: np.ndarray = twice_area <= WELD * extent * longest
    return needle
