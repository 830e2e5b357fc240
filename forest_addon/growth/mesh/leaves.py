"""Leaves and their truth: where each one is, how it faces, how large it is.

Leaf triangles go in; for every leaf come out its centre, normal, axis, length, width and the radius of
the disc of equal area, which is what a foliage echo is computed from (Tanveer et al. 2020a).

Leaves incline as those of their species do: a leaf is turned about a level line through its foot. It keeps
its foot, its size and the azimuth to which it faces; of its normal only the angle θ to the vertical becomes
that which was drawn. With k the level unit vector at right angles to the normal, the turn is that by the
difference of the angles about k (Rodrigues). A leaf that lies flat has no azimuth: it tips towards the end of
its midrib.

Parts of a mesh, leaves or pieces of wood, may be copied any number of times. Triangles are kept wound both
ways, so that a copy can be mirrored; edges are copied with them, so that nobody has to look for them
afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy

from ...base.rows import RowTable
from ...base.runs import Runs
from ...base.trimesh import Edges, TriMesh
from ...base.vectors import column, cross_rows
from ..skeleton import LeafSites
from .meshing import repeated_edges

ALIKE = 0.025  # difference of second moments over their sum, below which they are alike
FLAT = 1e-9  # sine of an inclination below which a leaf faces no side


@dataclass(frozen=True)
class Leaves(RowTable):
    """The truth of L leaves.

    centre : (L, 3) area centroid, metres.
    normal : (L, 3) unit, of the summed area vector.
    axis : (L, 3) unit, along the longest extent, in the leaf's plane.
    length, width : (L,) extents along and across the axis, metres.
    radius : (L,) radius of the disc of equal area, metres.
    branch : (L,) int32, the branch that bears the leaf, -1 where unknown.
    """

    centre: np.ndarray
    normal: np.ndarray
    axis: np.ndarray
    length: np.ndarray
    width: np.ndarray
    radius: np.ndarray
    branch: np.ndarray

    @classmethod
    def none(cls) -> Leaves:
        """An empty set of leaves."""
        vectors, scalars = np.empty((0, 3)), np.empty(0)
        return cls(vectors, vectors, vectors, scalars, scalars, scalars, np.empty(0, np.int32))


def measure_leaves(mesh: TriMesh, branch: np.ndarray | None = None) -> Leaves:
    """Measure every leaf of a mesh.

    mesh : leaves are its triangles with ``leaf >= 0``, numbered 0 .. L-1 without gaps.
    branch : (L,) the branch that bears each leaf, or None.

    A leaf of zero area keeps its centre and size, radius 0, and an arbitrary unit normal.
    """
    triangle = np.flatnonzero(mesh.leaf >= 0)
    if (np.diff(mesh.leaf[triangle]) < 0).any():  # grown trees have them in order
        triangle = triangle[np.argsort(mesh.leaf[triangle], kind="stable")]
    leaf = mesh.leaf[triangle]
    count = int(leaf.max(initial=-1)) + 1
    bearer = np.full(count, -1, np.int32) if branch is None else np.asarray(branch, np.int32)
    if not count:
        return replace(Leaves.none(), branch=bearer)

    first = np.flatnonzero(np.diff(leaf, prepend=-1))  # (P,) where the run of each leaf starts
    run = np.repeat(np.arange(len(first)), np.diff(first, append=len(leaf)))  # (F,)
    corners = mesh.vertices[mesh.triangles[triangle]]  # (F, 3, 3)
    vector = 0.5 * cross_rows(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.sqrt(np.einsum("fi,fi->f", vector, vector))
    leaf_area = np.add.reduceat(area, first)

    weight = np.where(leaf_area[run] > 0, area, 1.0)  # zero-area leaves: plain mean of corners
    middle = (corners[:, 0] + corners[:, 1] + corners[:, 2]) * (weight / 3)[:, None]
    centre = np.add.reduceat(middle, first, axis=0)
    centre /= np.maximum(np.add.reduceat(weight, first), np.finfo(float).tiny)[:, None]

    # Facets of one leaf may be wound either way: turn each to agree with the leaf's largest.
    largest = np.flatnonzero(area == np.maximum.reduceat(area, first)[run])[::-1]
    facing = np.zeros((len(first), 3))
    facing[run[largest]] = vector[largest]  # of equally large ones the first is written last
    sign = np.where(np.einsum("fi,fi->f", vector, facing[run]) < 0, -1.0, 1.0)
    normal = _unit(np.add.reduceat(vector * sign[:, None], first, axis=0), fallback=(0.0, 0.0, 1.0))

    axis, length, width = _extents(corners, run, first, centre, normal)
    measured = Leaves(
        centre=centre,
        normal=normal,
        axis=axis,
        length=length,
        width=width,
        radius=np.sqrt(leaf_area / np.pi),
        branch=bearer,
    )
    return measured if len(first) == count else _with_gaps(measured, leaf[first], count)


def separate_leaves(mesh: TriMesh) -> TriMesh:
    """Give leaves that share a number but are several ones numbers of their own.

    An Array modifier, say, copies leaf numbers with the triangles. One leaf is what hangs together or is one
    run of triangles, as a shoot of needles is; of a mesh whose leaves all have one number, what hangs
    together. The first piece of each keeps its number; further pieces are numbered on from the largest.
    """
    is_leaf = np.flatnonzero(mesh.leaf >= 0)
    number = mesh.leaf[is_leaf]
    if not len(is_leaf):
        return mesh
    starts = np.concatenate([[True], number[1:] != number[:-1]])
    runs = number[starts]
    if len(runs) > 1 and len(np.unique(runs)) == len(runs):  # as we make them
        return mesh
    run = np.cumsum(starts) - 1 if len(runs) > 1 else None
    piece = pieces_of(number, mesh.triangles[is_leaf], run)
    if piece is None:
        return mesh
    pairs, pair = np.unique(np.stack([number, piece], 1), axis=0, return_inverse=True)
    pair = pair.ravel()
    first = np.concatenate([[True], pairs[1:, 0] != pairs[:-1, 0]])
    if first.all():
        return mesh
    new = pairs[:, 0].copy()
    new[~first] = pairs[:, 0].max() + 1 + np.arange(int((~first).sum()))
    leaf = mesh.leaf.copy()
    leaf[is_leaf] = new[pair]
    return replace(mesh, leaf=leaf)


def pieces_of(
    number: np.ndarray, triangles: np.ndarray, run: np.ndarray | None = None
) -> np.ndarray | None:
    """(F,) which piece each triangle (F, 3) is of; None where each leaf (F,) is plainly in one piece.

    Pieces hang together by vertices, or by being in the same run (F,) of triangles.
    """
    same = number[1:] == number[:-1]
    touches = (triangles[1:, :, None] == triangles[:-1, None, :]).any(axis=(1, 2))
    if run is not None:
        touches |= run[1:] == run[:-1]
    if touches[same].all() and len(np.unique(number)) == 1 + int((~same).sum()):
        return None
    used, corner = np.unique(triangles, return_inverse=True)
    corner = corner.reshape(-1, 3)
    one, other = corner[:, [0, 0]].ravel(), corner[:, [1, 2]].ravel()
    if run is not None:
        on = run[1:] == run[:-1]
        one, other = np.append(one, corner[:-1, 0][on]), np.append(other, corner[1:, 0][on])
    links = scipy.sparse.coo_matrix((np.ones(len(one)), (one, other)), shape=(len(used), len(used)))
    return np.asarray(
        scipy.sparse.csgraph.connected_components(links, directed=False)[1][corner[:, 0]]
    )


def _extents(
    corners: np.ndarray, run: np.ndarray, first: np.ndarray, centre: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Axis of the largest spread in the leaf's plane, and the extents along and across it.

    In coordinates (a, b) of that plane the axis stands at half the angle of (Maa − Mbb, 2Mab), second
    moments of area: A/12·(Σ v vᵀ + Σv Σvᵀ) for a triangle with corners v. A leaf as wide as long, a
    square say, has no longest side: its axis points to the farthest corner.
    """
    helper = np.zeros_like(normal)
    helper[np.arange(len(normal)), np.argmin(np.abs(normal), axis=1)] = 1.0
    u = _unit(cross_rows(normal, helper), fallback=(1.0, 0.0, 0.0))
    v = cross_rows(normal, u)
    offset = corners - centre[run][:, None]  # (F, 3, 3)
    a, b = np.einsum("fki,fi->fk", offset, u[run]), np.einsum("fki,fi->fk", offset, v[run])
    area = np.abs(
        (a[:, 1] - a[:, 0]) * (b[:, 2] - b[:, 0]) - (a[:, 2] - a[:, 0]) * (b[:, 1] - b[:, 0])
    )
    area = np.maximum(area, np.finfo(float).tiny)
    aa, bb, ab = (
        np.add.reduceat(area * (np.einsum("fk,fk->f", p, q) + p.sum(axis=1) * q.sum(axis=1)), first)
        for p, q in ((a, a), (b, b), (a, b))
    )
    angle = 0.5 * np.arctan2(2 * ab, aa - bb)
    alike = np.hypot(aa - bb, 2 * ab) < ALIKE * (aa + bb)
    if alike.any():
        order = np.argsort((a**2 + b**2).ravel(), kind="stable")
        corner = np.empty(len(first), dtype=np.int64)
        corner[np.repeat(run, 3)[order]] = order  # the farthest is written last and stays
        farthest = np.arctan2(b.ravel()[corner], a.ravel()[corner])
        angle = np.where(alike, farthest, angle)
    cos, sin = np.cos(angle), np.sin(angle)
    spans = []
    for x, y in ((cos, sin), (-sin, cos)):
        along = x[run, None] * a + y[run, None] * b
        high = np.maximum(np.maximum(along[:, 0], along[:, 1]), along[:, 2])
        low = np.minimum(np.minimum(along[:, 0], along[:, 1]), along[:, 2])
        spans.append(np.maximum.reduceat(high, first) - np.minimum.reduceat(low, first))
    return cos[:, None] * u + sin[:, None] * v, spans[0], spans[1]


def _with_gaps(found: Leaves, number: np.ndarray, count: int) -> Leaves:
    """A table of ``count`` leaves of which only those with these numbers have triangles."""
    row = np.full(count, -1)
    row[number] = np.arange(len(number))
    whole, missing = replace(found, branch=found.branch[number]).select(row), row < 0
    for name in ("centre", "length", "width", "radius"):
        getattr(whole, name)[missing] = 0.0
    whole.normal[missing], whole.axis[missing] = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
    return replace(whole, branch=found.branch)


def _unit(vectors: np.ndarray, fallback: tuple[float, float, float]) -> np.ndarray:
    norm = np.sqrt(np.einsum("ni,ni->n", vectors, vectors))[:, None]
    safe = np.where(norm > 0, norm, 1.0)
    return np.where(norm > 0, vectors / safe, np.asarray(fallback))


def turns(normal: np.ndarray, axis: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """(L, 3, 3) what turns leaves of these unit normals and midribs to the wanted inclinations, radians."""
    up = np.where(normal[:, 2:] < 0, -normal, normal)
    level = np.hypot(up[:, 0], up[:, 1])
    side = np.where((level > FLAT)[:, None], up[:, :2], axis[:, :2])
    size = np.linalg.norm(side, axis=1, keepdims=True)
    side = np.where(size > FLAT, side / np.maximum(size, FLAT), [1.0, 0.0])
    by = wanted - np.arctan2(level, column(up, 2))
    cos, sin = np.cos(by), np.sin(by)
    x, y = -side[:, 1], side[:, 0]  # k, which turns +Z towards the side
    turn = np.empty((len(normal), 3, 3))
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 0, 2] = (
        cos + x * x * (1 - cos),
        x * y * (1 - cos),
        y * sin,
    )
    turn[:, 1, 0], turn[:, 1, 1], turn[:, 1, 2] = (
        x * y * (1 - cos),
        cos + y * y * (1 - cos),
        -x * sin,
    )
    turn[:, 2, 0], turn[:, 2, 1], turn[:, 2, 2] = -y * sin, x * sin, cos
    return turn


def incline_sites(sites: LeafSites, wanted: np.ndarray, normal: np.ndarray) -> LeafSites:
    """Leaf sites whose leaves incline so (L,), radians. normal : (L, 3) as the leaves face now."""
    turn = turns(normal, sites.direction, wanted)
    direction, up = (np.einsum("lij,lj->li", turn, v) for v in (sites.direction, sites.up))
    return replace(sites, direction=direction, up=up)


def incline_leaves(
    mesh: TriMesh, leaves: Leaves, foot: np.ndarray, wanted: np.ndarray
) -> tuple[TriMesh, Leaves]:
    """A tree's mesh and the truth of its leaves, with these inclinations (L,), radians.

    foot : (L, 3) where each leaf hangs. No two leaves share a vertex, and none with the wood.
    """
    turn = turns(leaves.normal, leaves.axis, wanted)
    of_vertex = corner_leaves(mesh)
    moved = np.flatnonzero(of_vertex >= 0)
    leaf = of_vertex[moved]
    vertices = mesh.vertices.copy()
    vertices[moved] = foot[leaf] + _turned(turn[leaf], vertices[moved] - foot[leaf])
    truth = replace(
        leaves,
        centre=foot + _turned(turn, leaves.centre - foot),
        normal=_turned(turn, leaves.normal),
        axis=_turned(turn, leaves.axis),
    )
    return replace(mesh, vertices=vertices), truth


def _turned(turn: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return np.asarray(np.einsum("lij,lj->li", turn, vectors))


def about_vertical(vectors: np.ndarray, cos: np.ndarray, sin: np.ndarray) -> np.ndarray:
    """Vectors (N, 3), each turned about +Z by the angle with this cosine and sine (N,)."""
    x, y, _ = vectors.T
    turned = vectors.copy()
    turned[:, 0], turned[:, 1] = cos * x - sin * y, sin * x + cos * y
    return turned


@dataclass(frozen=True, eq=False)
class CopyStock:
    """The parts of N owners; vertices, triangles and edges stand together by owner.

    place : (V, 3). corners, of_corner : (2T, 3) int32, vertices and edges of all triangles, then of the
    same inside out. ends : (E, 2) int32. part, material : what all triangles are.
    """

    place: np.ndarray
    corners: np.ndarray
    of_corner: np.ndarray
    ends: np.ndarray
    vertices: Runs
    triangles: Runs
    edges: Runs
    part: int
    material: int

    @classmethod
    def of(
        cls, place: np.ndarray, owner: np.ndarray, triangles: np.ndarray, part: int, material: int
    ) -> CopyStock:
        """A stock of places (V, 3) sorted by owner (V,), 0 .. N - 1, and triangles (T, 3) sorted likewise."""
        count = int(owner[-1]) + 1 if len(owner) else 0
        edges = repeated_edges(triangles, 0, 1)
        return cls(
            place=place,
            corners=np.concatenate([triangles, triangles[:, ::-1]]).astype(np.int32),
            of_corner=np.concatenate([edges.of_corner, edges.of_corner[:, [1, 0, 2]]]),
            ends=edges.ends,
            vertices=Runs.of(owner, count),
            triangles=Runs.of(owner[triangles[:, 0]], count),
            edges=Runs.of(owner[edges.ends[:, 0]], count),
            part=part,
            material=material,
        )

    def copy(
        self, wanted: np.ndarray, mirrored: np.ndarray
    ) -> tuple[TriMesh, np.ndarray, np.ndarray, np.ndarray]:
        """Copies of wanted owners (N,), inside out where mirrored (N,).

        Returns
        -------
        The mesh, its vertices not placed yet; (V,) the vertex of the stock that each one is; (V,) and
        (T,) which wanted one each vertex and triangle is of.
        """
        vertex, of_vertex, moved = self.vertices.copy(wanted)
        triangle, of_triangle, _ = self.triangles.copy(wanted)
        wound = triangle + (len(self.corners) // 2) * mirrored[of_triangle]
        # ``take`` along the rows is twice as fast as brackets, and so are numbers of half the size.
        corners, moved = self.corners.take(wound, axis=0), moved.astype(np.int32)
        corners += moved.take(of_triangle)[:, None]
        mesh = TriMesh.of_part(np.empty((0, 3)), corners, self.part, material=self.material)
        edges = partial(self._copied_edges, wanted, moved, wound, of_triangle)
        return replace(mesh, edges=edges), vertex, of_vertex, of_triangle

    def _copied_edges(
        self, wanted: np.ndarray, moved: np.ndarray, wound: np.ndarray, of_triangle: np.ndarray
    ) -> Edges:
        """The edges of copies, by how far their vertices have moved and which triangles they are of."""
        edge, of_edge, edge_moved = self.edges.copy(wanted)
        ends, of_corner = self.ends.take(edge, axis=0), self.of_corner.take(wound, axis=0)
        ends += moved.take(of_edge)[:, None]
        of_corner += edge_moved.astype(np.int32).take(of_triangle)[:, None]
        return Edges(ends, of_corner)


def corner_leaves(mesh: TriMesh) -> np.ndarray:
    """(V,) int32 the leaf that each vertex is of, -1 where it is of none."""
    leaf = np.full(len(mesh.vertices), -1, np.int32)
    rows = mesh.leaf >= 0
    leaf[mesh.triangles[rows]] = mesh.leaf[rows][:, None]
    return leaf


def leaves_apart(mesh: TriMesh) -> tuple[TriMesh, TriMesh, np.ndarray]:
    """Part a mesh into what is no leaf and the leaves, sorted by number; (V,) the leaf of each of their
    vertices.
    """
    is_leaf = mesh.leaf >= 0
    leaves = mesh.select(is_leaf)
    leaf_of_vertex = corner_leaves(leaves).astype(np.int64)
    by_leaf = np.argsort(leaf_of_vertex, kind="stable")
    number = np.empty_like(by_leaf)
    number[by_leaf] = np.arange(len(by_leaf))
    row = np.argsort(leaves.leaf, kind="stable")
    ordered = TriMesh(
        vertices=leaves.vertices[by_leaf],
        triangles=number[leaves.triangles[row]].astype(np.int32),
        part=leaves.part[row],
        leaf=leaves.leaf[row],
        material=leaves.material[row],
        uv=None if leaves.uv is None else leaves.uv[row],
        order=None if leaves.order is None else leaves.order[row],
    )
    return mesh.select(~is_leaf), ordered, leaf_of_vertex[by_leaf]
