"""Facets into pieces: weld corners to vertices, then part the mesh where no edge joins it.

An STL is a bag of facets. Corners closer than a millionth of the mesh's extent become one vertex;
facets that collapse, or that repeat another whichever way round (a leaf drawn from both sides), are
dropped. A piece is what hangs together along edges: two leaves or branches that only touch at a point
stay two, and two that share an edge are one. Facets of no area, such as the needles that close cracks
between unequal rings, join pieces but are dropped afterwards.

Parts of a tree in a file are told apart into wood and leaves, and set upright. Names of objects and materials
tell first ("leaf", "bark"); a mesh whose name does not tell is what most of its area looks like, and a file
without names is looked at piece by piece. A piece is a leaf where its facets face one way (|sum of area
vectors| above half of the area: a tube's cancel), where it is a card or crossed cards (most of its edges are
borders), or where it is one of very many small ones that are plain, as needles are, or have an edge that more
than two facets share, as tufts of needles have. The upright axis is that along which the tree stands on a
narrow, solid foot.

The unit in which a tree was drawn an STL does not say: metres, where the tree is then 0.3 to 120 m high.
Else, of the other units in which people draw and in which it is, the one that brings tree and leaves nearest
to usual sizes, on a logarithmic scale: trees are some 10 m high and leaves some 10 cm long, give or take a
factor of three.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from ...base.rows import lengths
from ...base.runs import sums
from ...base.trimesh import WOOD, TriMesh
from ...base.vectors import cross_rows

WELD = 1e-6  # share of the extent: nearer vertices are one, lower facets have no area
CELLS = 2**21 - 1  # along the extent, in which vertices are first gathered: 21 bits an axis
LEAFY = (
    "leaf",
    "leaves",
    "foliage",
    "needle",
    "frond",
    "blade",
    "petal",
    "flower",
    "fruit",
    "card",
)
WOODY = ("wood", "bark", "trunk", "branch", "stem", "twig", "log", "bole")
OTHER = ("ground", "terrain", "floor", "soil", "grass")
FACING = 0.5  # share of a piece's area that faces one way if it is a leaf
BORDER = 0.6  # share of its edges that have one facet only, if it is cards
SMALL = 0.01  # extents of the tree that a needle is long at most
PLAIN = 24  # facets of a needle at most
TUFT = 0.03  # extents that needles with a common edge are long together
MANY = 50  # needles of one make at least, and
OFTEN = 3  # times as many as there are other pieces of wood
FOOT = 0.02  # share of the extent, from the ground up, where the foot is looked for
FLAT, WIDE = 0.003, 0.3  # heights that ground is uneven by, extents that it is wide at least
NARROW = 0.03  # extents that any foot may be wide
CLEARLY = 3.0  # times as good a foot, that an axis other than z is taken for upright
UPRIGHT = {
    "z": np.eye(3),
    "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
}
UNITS = {
    "metres": 1.0,
    "decimetres": 0.1,
    "centimetres": 0.01,
    "millimetres": 0.001,
    "feet": 0.3048,
    "inches": 0.0254,
}
LOWEST, HIGHEST = 0.3, 120.0  # metres
USUAL_HEIGHT, HEIGHT_SPREAD = 10.0, math.log(3.0)
USUAL_LEAF, LEAF_SPREAD = 0.10, math.log(2.5)


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

    @cached_property
    def area(self) -> np.ndarray:
        """(T,) of the triangles."""
        return lengths(self.area_vectors())

    def area_vectors(self) -> np.ndarray:
        """(T, 3) half cross products of the triangles' edges."""
        return TriMesh.of_part(self.vertices, self.triangles, WOOD).area_vectors()

    def middles(self) -> np.ndarray:
        """(C, 3) mean of each piece's vertices."""
        size = np.bincount(self.piece_of_vertex, minlength=self.count)
        return sums(self.piece_of_vertex, self.vertices, self.count) / size[:, None]

    def largest(self, value: np.ndarray) -> np.ndarray:
        """(C,) vertex of each piece with the largest value (V,), the last of equal ones."""
        owner, most = self.piece_of_vertex, np.full(self.count, -np.inf)
        np.maximum.at(most, owner, value)
        row = np.flatnonzero(value == most[owner])  # ascending by owner
        return row[np.searchsorted(owner[row], np.arange(self.count), side="right") - 1]

    def boxes(self) -> tuple[np.ndarray, np.ndarray]:
        """(C, 3) lowest and highest coordinates of each piece."""
        low, high = np.full((self.count, 3), np.inf), np.full((self.count, 3), -np.inf)
        np.minimum.at(low, self.piece_of_vertex, self.vertices)
        np.maximum.at(high, self.piece_of_vertex, self.vertices)
        return low, high


def part(facets: np.ndarray) -> Pieces:
    """Weld facets (T, 3, 3) and part them into pieces; no pieces if no facet has an area."""
    vertices, triangles = weld(np.asarray(facets, dtype=np.float64))
    corners = np.sort(triangles, axis=1)  # of three different vertices, the first of each three
    whole = np.flatnonzero((np.diff(corners, axis=1) > 0).all(axis=1))
    order = np.lexsort(corners[whole].T)  # stable: of equal ones the first in the file comes first
    repeats = (np.diff(corners[whole[order]], axis=0) == 0).all(axis=1)
    triangles = triangles[np.delete(whole, order[1:][repeats])]
    halves = half_edges(triangles, len(vertices))
    piece = join_along(halves // 3, len(triangles))  # in order of first appearance
    has_area = ~_is_needle(vertices, triangles)

    solid = np.zeros(int(piece.max(initial=-1)) + 1, dtype=bool)
    solid[piece[has_area]] = True
    if not solid.all():  # needles alone are no piece
        kept = solid[piece]
        triangles, has_area, piece = triangles[kept], has_area[kept], piece[kept]
    piece = (np.cumsum(solid) - 1)[piece]

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
    corner = piece.astype(np.int64)[:, None] * len(vertices) + triangles
    pairs, number = np.unique(corner, return_inverse=True)
    owner, welded = np.divmod(pairs, max(len(vertices), 1))
    triangles = number.reshape(triangles.shape)
    keys = np.unique(edge_keys(triangles, len(pairs)))
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
    """The chosen pieces (C,) alone, in their order."""
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
    search = scipy.spatial.cKDTree(vertices, balanced_tree=False, compact_nodes=False)
    near = search.query_pairs(WELD * extent, output_type="ndarray")
    label = join_along(near, len(vertices))
    _, chosen = np.unique(label, return_index=True)  # the first of each chain
    return vertices[chosen], label[index].reshape(-1, 3).astype(np.int64)


def join_along(pairs: np.ndarray, nodes: int) -> np.ndarray:
    """(nodes,) which of them pairs (N, 2) join: one number for all that hang together."""
    graph = scipy.sparse.coo_matrix(
        (np.ones(len(pairs), dtype=bool), pairs.T), shape=(nodes, nodes)
    )
    return np.asarray(scipy.sparse.csgraph.connected_components(graph, directed=False)[1])


def edge_keys(triangles: np.ndarray, vertices: int) -> np.ndarray:
    """(3T,) numbers of edges, either way alike; that in row 3·t + k goes from corner k of triangle t on."""
    one, other = triangles.astype(np.int64), np.roll(triangles, -1, axis=1).astype(np.int64)
    return np.asarray((np.minimum(one, other) * vertices + np.maximum(one, other)).ravel())


def half_edges(triangles: np.ndarray, vertices: int) -> np.ndarray:
    """(N, 2) half-edges that lie on one another."""
    key = edge_keys(triangles, vertices)
    order = np.argsort(key, kind="stable")
    same = key[order[1:]] == key[order[:-1]]
    return np.stack([order[:-1][same], order[1:][same]], axis=1)


def loose_edges_of(pieces: Pieces) -> np.ndarray:
    """(N, 3) the edges that no triangle has, as triangles without area."""
    count = len(pieces.vertices)
    one, other = pieces.edges.T.astype(np.int64)
    own = np.minimum(one, other) * count + np.maximum(one, other)
    loose = ~np.isin(own, edge_keys(pieces.triangles, count))
    return np.stack([one[loose], other[loose], other[loose]], axis=1)


def _is_needle(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(T,) whether a triangle's height over its longest edge is within the welding distance."""
    if not len(triangles):
        return np.zeros(0, dtype=bool)
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    twice_area = lengths(cross_rows(b - a, c - a))
    longest = np.maximum(np.maximum(lengths(b - a), lengths(c - b)), lengths(a - c))
    extent = float(np.ptp(vertices, axis=0).max())
    return np.asarray(twice_area <= WELD * extent * longest)


@dataclass(frozen=True)
class Group:
    """Facets (T, 3, 3) of one object and material of a file."""

    name: str
    material: str
    facets: np.ndarray


@dataclass(frozen=True)
class Sorted:
    """Wood, leaves or None, as facets, and in words how they were told apart."""

    wood: np.ndarray
    leaves: np.ndarray | None
    said: str


def sort_out(groups: Sequence[Group]) -> Sorted:
    """Tell wood from leaves; the ground that they stand on is left out."""
    trees = _without_ground([group for group in groups if _kind_by_name(group) != "other"])
    if trees:
        sorted_trees = sort_out(trees)
        words = f"{sorted_trees.said}; " if sorted_trees.said else ""
        return replace(
            sorted_trees, said=f"{words}a flat piece at the foot is the ground and left out"
        )
    kinds = [_kind_by_name(group) for group in groups]
    named = {kind for kind in kinds if kind in ("wood", "leaves")}
    if named == {"wood", "leaves"} and all(kinds):
        return _gather(groups, kinds, "by name")
    left = [k for k in range(len(groups)) if kinds[k] != "other"]
    facets = np.concatenate([groups[k].facets for k in left] or [np.empty((0, 3, 3))])
    pieces = part(facets) if len(facets) else None
    if pieces is None or not len(pieces.triangles):  # all without area
        return Sorted(facets[:0], None, "")
    leaf = looks_like_leaves(pieces)
    if len(left) > 1:
        owner = np.repeat(np.arange(len(left)), [len(groups[k].facets) for k in left])
        middle = pieces.vertices[pieces.triangles].mean(axis=1)
        source = owner[
            scipy.spatial.cKDTree(facets.mean(axis=1)).query(middle)[1]
        ]  # the facet with the same middle
        area = pieces.area
        total = np.bincount(source, area, len(left))
        leafy = np.bincount(source, area * leaf[pieces.piece], len(left))
        for number, k in enumerate(left):
            if not kinds[k]:
                kinds[k] = "leaves" if leafy[number] > total[number] / 2 else "wood"
        return _gather(groups, kinds, "by name and shape" if named else "by shape")
    if kinds[left[0]]:
        return _gather(groups, kinds, "by name")
    if not leaf.any() or leaf.all():
        return Sorted(facets, None, "")
    shown = pieces.vertices[pieces.triangles]
    is_leaf = leaf[pieces.piece]
    return Sorted(shown[~is_leaf], shown[is_leaf], "by shape")


def _without_ground(groups: Sequence[Group]) -> list[Group]:
    """The groups without facets that lie flat at the foot and fill most of a wide area; none without such."""
    facets = np.concatenate([group.facets for group in groups] or [np.empty((0, 3, 3))])
    if not len(facets):
        return []
    low, size = facets.min(axis=(0, 1)), np.ptp(facets, axis=(0, 1))
    for up in (2, 1):
        foot = low[up] + FLAT * size[up]
        bed = facets[facets[:, :, up].max(axis=1) <= foot]
        if not 0 < len(bed) < len(facets):
            continue
        wide = np.delete(np.ptp(bed, axis=(0, 1)), up)
        area = (
            np.linalg.norm(np.cross(bed[:, 1] - bed[:, 0], bed[:, 2] - bed[:, 0]), axis=1).sum() / 2
        )
        if wide.min() > WIDE * size.max() and area > wide.prod() / 2:
            kept = [
                replace(g, facets=g.facets[g.facets[:, :, up].max(axis=1) > foot]) for g in groups
            ]
            return [group for group in kept if len(group.facets)]
    return []


def looks_like_leaves(pieces: Pieces) -> np.ndarray:
    """(C,) whether a piece has the shape of a leaf, a card or a needle."""
    count = pieces.count
    vectors = pieces.area_vectors()
    area = np.bincount(pieces.piece, pieces.area, count)
    facing = np.linalg.norm(sums(pieces.piece, vectors, count), axis=1) / np.maximum(area, 1e-300)
    triangles = np.bincount(pieces.piece, minlength=count)
    keys = edge_keys(pieces.triangles, len(pieces.vertices))
    key, times = np.unique(keys, return_counts=True)
    of_edge = pieces.piece_of_vertex[key // len(pieces.vertices)] if len(key) else key
    edges = np.bincount(of_edge, minlength=count)
    border = np.bincount(of_edge[times == 1], minlength=count) / np.maximum(edges, 1)
    leaf = (facing > FACING) | (border > BORDER)

    low, high = pieces.boxes()
    length = np.linalg.norm(high - low, axis=1)
    extent = float(np.ptp(pieces.vertices, axis=0).max())
    small = (triangles <= PLAIN) & (length < SMALL * extent)
    tuft = np.zeros(count, dtype=bool)  # tubes have no edge that three facets share
    tuft[of_edge[times > 2]] = True
    small = ~leaf & (small | (tuft & (length < TUFT * extent)))
    others = int(np.count_nonzero(~leaf & ~small))
    if others and int(np.count_nonzero(small)) >= max(MANY, OFTEN * others):
        leaf |= small
    return np.asarray(leaf)


def likely_up(wood: np.ndarray) -> str:
    """The axis, "z" or "y", along which wood (T, 3, 3) stands on a narrow foot."""
    middle = wood.mean(axis=1)
    area = np.linalg.norm(np.cross(wood[:, 1] - wood[:, 0], wood[:, 2] - wood[:, 0]), axis=1)
    extent = max(float(np.ptp(middle, axis=0).max()), 1e-300)

    def foot(axis: str) -> float:
        place = middle @ UPRIGHT[axis].T
        low = place[:, 2] <= place[:, 2].min() + FOOT * extent
        weight = area[low] / max(float(area[low].sum()), 1e-300)
        mean = weight @ place[low, :2]
        spread = float(np.sqrt(weight @ ((place[low, :2] - mean) ** 2).sum(axis=1))) / extent
        return float(area[low].sum() / area.sum()) / (spread + NARROW) ** 2

    return "y" if foot("y") > CLEARLY * foot("z") else "z"


def stood(parts: Sorted, up: str) -> Sorted:
    """Wood and leaves turned so that this axis points up."""
    if up == "z":
        return parts
    leaves = None if parts.leaves is None else parts.leaves @ UPRIGHT[up].T
    return Sorted(parts.wood @ UPRIGHT[up].T, leaves, parts.said)


def _kind_by_name(group: Group) -> str:
    """Kind that the material's name says, or else the object's; empty where neither says."""
    for name in (group.material.lower(), group.name.lower()):
        kinds = [
            kind
            for kind, words in (("leaves", LEAFY), ("wood", WOODY), ("other", OTHER))
            if any(word in name for word in words)
        ]
        if kinds:
            return kinds[0] if len(kinds) == 1 else ""
    return ""


def _gather(groups: Sequence[Group], kinds: Sequence[str], said: str) -> Sorted:
    def of(kind: str) -> np.ndarray:
        chosen = [g.facets for g, k in zip(groups, kinds, strict=True) if k == kind]
        return np.concatenate(chosen or [np.empty((0, 3, 3))])

    leaves = of("leaves")
    return Sorted(of("wood"), leaves if len(leaves) else None, said)


@dataclass(frozen=True)
class Unit:
    """Metres in one unit of a file, and what it is called."""

    metres: float
    name: str


def infer_unit(height: float, leaf: float | None = None) -> Unit:
    """Metres where a tree of this height, in file units, is then as high as trees are, else the likeliest
    unit in which it is.

    leaf : median length of a leaf, in file units.
    """

    def odds(name: str) -> float:
        metres = UNITS[name]
        far = (math.log(height * metres / USUAL_HEIGHT) / HEIGHT_SPREAD) ** 2
        if leaf:
            far += (math.log(leaf * metres / USUAL_LEAF) / LEAF_SPREAD) ** 2
        return far

    possible = [name for name in UNITS if LOWEST <= height * UNITS[name] <= HIGHEST]
    name = "metres" if "metres" in possible else min(possible or ["metres"], key=odds)
    return Unit(UNITS[name], name)
