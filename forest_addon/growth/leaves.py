"""Leaves and their truth: where each one is, how it faces, how large it is.

Leaf triangles go in; for every leaf come out its centre, normal, axis, length, width and the radius of
the disc of equal area, which is what a foliage echo is computed from (T20).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from .trimesh import TriMesh

ALIKE = 0.95  # second moments whose ratio is above this are alike


@dataclass(frozen=True)
class Leaves:
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

    def __len__(self) -> int:
        return len(self.radius)


def measure_leaves(mesh: TriMesh, branch: np.ndarray | None = None) -> Leaves:
    """Measure every leaf of a mesh.

    mesh : leaves are its triangles with ``leaf >= 0``, numbered 0 .. L-1 without gaps.
    branch : (L,) the branch that bears each leaf, or None.

    A leaf of zero area keeps its centre and size, radius 0, and an arbitrary unit normal.
    """
    is_leaf = mesh.leaf >= 0
    leaf = mesh.leaf[is_leaf]
    count = int(leaf.max(initial=-1)) + 1
    corners = mesh.vertices[mesh.triangles[is_leaf]]  # (F, 3, 3)
    vector = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(vector, axis=1)
    leaf_area = np.bincount(leaf, area, count).astype(np.float64)

    weight = np.where(leaf_area[leaf] > 0, area, 1.0)  # zero-area leaves: plain mean of corners
    centre = _sum_by_leaf(corners.mean(axis=1) * weight[:, None], leaf, count)
    centre /= np.maximum(np.bincount(leaf, weight, count), np.finfo(float).tiny)[:, None]

    # Facets of one leaf may be wound either way: turn each to agree with the leaf's first.
    first = np.zeros((count, 3))
    order = np.argsort(-area, kind="stable")[::-1]
    first[leaf[order]] = vector[order]  # the largest facet is written last and stays
    sign = np.where(np.einsum("fi,fi->f", vector, first[leaf]) < 0, -1.0, 1.0)
    normal = _unit(_sum_by_leaf(vector * sign[:, None], leaf, count), fallback=(0.0, 0.0, 1.0))

    axis, length, width = _extents(corners, leaf, centre, normal, count)
    return Leaves(
        centre=centre,
        normal=normal,
        axis=axis,
        length=length,
        width=width,
        radius=np.sqrt(leaf_area / np.pi),
        branch=np.full(count, -1, np.int32) if branch is None else np.asarray(branch, np.int32),
    )


def separate_leaves(mesh: TriMesh) -> TriMesh:
    """Give leaves that share a number but do not hang together numbers of their own.

    An Array modifier, say, copies leaf numbers with the triangles. The first piece of each leaf keeps
    its number; further pieces are numbered on from the largest.
    """
    is_leaf = np.flatnonzero(mesh.leaf >= 0)
    if not len(is_leaf):
        return mesh
    used, corner = np.unique(mesh.triangles[is_leaf], return_inverse=True)
    corner = corner.reshape(-1, 3)
    links = coo_matrix(
        (np.ones(2 * len(corner)), (corner[:, [0, 0]].ravel(), corner[:, [1, 2]].ravel())),
        shape=(len(used), len(used)),
    )
    piece = connected_components(links, directed=False)[1][corner[:, 0]]
    pairs, pair = np.unique(np.stack([mesh.leaf[is_leaf], piece], 1), axis=0, return_inverse=True)
    pair = pair.ravel()
    first = np.concatenate([[True], pairs[1:, 0] != pairs[:-1, 0]])
    if first.all():
        return mesh
    number = pairs[:, 0].copy()
    number[~first] = pairs[:, 0].max() + 1 + np.arange(int((~first).sum()))
    leaf = mesh.leaf.copy()
    leaf[is_leaf] = number[pair]
    return replace(mesh, leaf=leaf)


def join_leaves(parts: Sequence[Leaves]) -> Leaves:
    """One table out of several, in order."""
    if not parts:
        parts = [no_leaves()]
    columns = {
        f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Leaves)
    }
    return Leaves(**columns)


def no_leaves() -> Leaves:
    """An empty table."""
    vectors, scalars = np.empty((0, 3)), np.empty(0)
    return Leaves(vectors, vectors, vectors, scalars, scalars, scalars, np.empty(0, np.int32))


def _extents(
    corners: np.ndarray, leaf: np.ndarray, centre: np.ndarray, normal: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Axis of the longest extent in the leaf's plane, and the extents along and across it."""
    offset = corners - centre[leaf][:, None]  # (F, 3, 3)
    along_normal = np.einsum("fci,fi->fc", offset, normal[leaf])
    offset -= along_normal[:, :, None] * normal[leaf][:, None]
    # Second moments of area: A/12·(Σ v vᵀ + Σv Σvᵀ) for a triangle with corners v.
    area = np.linalg.norm(
        np.cross(offset[:, 1] - offset[:, 0], offset[:, 2] - offset[:, 0]), axis=1
    )
    whole = offset.sum(axis=1)
    moment = np.einsum("fci,fcj->fij", offset, offset) + whole[:, :, None] * whole[:, None, :]
    scatter = np.zeros((count, 3, 3))
    np.add.at(scatter, leaf, np.maximum(area, 1e-300)[:, None, None] * moment)
    spread, directions = np.linalg.eigh(scatter)
    axis = directions[:, :, 2]  # of the largest spread
    owner, offset = np.repeat(leaf, 3), offset.reshape(-1, 3)
    farthest = np.zeros((count, 3))
    order = np.argsort(np.linalg.norm(offset, axis=1), kind="stable")
    farthest[owner[order]] = offset[order]  # the farthest corner is written last and stays
    as_wide = spread[:, 1] > ALIKE * spread[:, 2]  # a square has no longest side: take its diagonal
    axis = np.where(as_wide[:, None], farthest, axis)
    axis = _unit(
        axis - np.einsum("li,li->l", axis, normal)[:, None] * normal, fallback=(1.0, 0.0, 0.0)
    )
    across = np.cross(normal, axis)
    spans = []
    for direction in (axis, across):
        along = np.einsum("pi,pi->p", offset, direction[owner])
        low, high = np.full(count, np.inf), np.full(count, -np.inf)
        np.minimum.at(low, owner, along)
        np.maximum.at(high, owner, along)
        spans.append(np.where(high >= low, high - low, 0.0))
    return axis, spans[0], spans[1]


def _sum_by_leaf(values: np.ndarray, leaf: np.ndarray, count: int) -> np.ndarray:
    return np.stack(
        [np.bincount(leaf, values[:, k], count).astype(np.float64) for k in range(3)], axis=1
    )


def _unit(vectors: np.ndarray, fallback: tuple[float, float, float]) -> np.ndarray:
    norm = np.linalg.norm(vectors, axis=1, keepdims=True)
    safe = np.where(norm > 0, norm, 1.0)
    return np.where(norm > 0, vectors / safe, np.asarray(fallback))
