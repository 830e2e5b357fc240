"""Leaves as discs: what a foliage echo is computed from, measured on the evaluated scene.

A ``SceneGeometry`` goes in; for every leaf of every instance come out centre, normal and the radius of
the disc of equal area, in world coordinates. A mesh is measured once, in its local space. Rotation and
uniform scale move what was measured; under any other transform each facet's area vector goes through
the cofactor matrix (n·dA maps to cof(M)·n·dA), so that squeezed and sheared instances are exact too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...base.trimesh import TriMesh
from ...growth.mesh.leaves import pieces_of
from ..rays.geometry import SceneGeometry, apply_transform

SIMILAR = 1e-6  # a rotation with a scale, but for the float32 that Blender keeps it in


@dataclass(frozen=True)
class LeafDiscs:
    """L leaves as discs in world coordinates.

    centre : (L, 3) area centroid, metres. normal : (L, 3) unit, of the summed area; of no sense where
    the radius is 0. radius : (L,) metres, of the disc of equal area.
    instance : (L,) int64. leaf : (L,) int64, number in the instance's mesh. tree : (L,) int64, or -1.
    """

    centre: np.ndarray
    normal: np.ndarray
    radius: np.ndarray
    instance: np.ndarray
    leaf: np.ndarray
    tree: np.ndarray

    def __len__(self) -> int:
        return len(self.radius)


def leaf_discs(scene: SceneGeometry) -> LeafDiscs:
    """Every leaf of a scene: the triangles with ``leaf >= 0``, by instance and number."""
    meshes = {index: FoliageDiscs(scene.meshes[index]) for index in np.unique(scene.mesh_index)}
    counts = np.array([len(meshes[index].leaf) for index in scene.mesh_index], dtype=np.int64)
    ends = np.cumsum(counts)
    total = int(ends[-1]) if len(ends) else 0
    centre, normal, radius = np.empty((total, 3)), np.empty((total, 3)), np.empty(total)
    leaf = np.empty(total, dtype=np.int64)
    for instance, index in enumerate(scene.mesh_index):
        rows = slice(ends[instance] - counts[instance], ends[instance])
        foliage = meshes[index]
        centre[rows], normal[rows], radius[rows] = foliage.moved(scene.transform[instance])
        leaf[rows] = foliage.leaf
    instance_of = np.repeat(np.arange(len(scene)), counts)
    return LeafDiscs(centre, normal, radius, instance_of, leaf, scene.tree[instance_of])


Measured = tuple[np.ndarray, np.ndarray, np.ndarray]  # centre (L, 3), normal (L, 3), radius (L,)


class FoliageDiscs:
    """The leaves of one mesh: F facets, leaf by leaf, and what they measure in local space.

    What is in pieces, as a shoot of needles, is a disc for each of them: no wave knows that they grow on one.
    leaf : (L,) their numbers, the same for pieces of one. local : centre, normal and radius of each.
    """

    def __init__(self, mesh: TriMesh) -> None:
        facets = np.flatnonzero(mesh.leaf >= 0)
        facets = facets[np.argsort(mesh.leaf[facets], kind="stable")]
        owner, self.leaf = own_pieces(mesh.leaf[facets], mesh.triangles[facets])
        order = np.argsort(owner, kind="stable")
        facets, owner = facets[order], owner[order]
        self._first = np.searchsorted(owner, np.arange(len(self.leaf) + 1))
        corners = mesh.vertices[mesh.triangles[facets]]
        self._middle = corners.mean(axis=1)
        vector = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._vector = _turned_alike(vector, owner, len(self.leaf))
        self.local = _measure(self._middle, self._vector, owner, len(self.leaf))

    @classmethod
    def of_discs(cls, discs: LeafDiscs) -> FoliageDiscs:
        """Discs that are measured already, in the world; only similarities may move them."""
        made = cls.__new__(cls)
        made.leaf, made.local = discs.leaf, (discs.centre, discs.normal, discs.radius)
        return made

    def moved(self, transform: np.ndarray, rows: np.ndarray | None = None) -> Measured:
        """The leaves, or those of some rows, through one (3, 4) transform."""
        linear = transform[:, :3]
        centre, normal, radius = self.local if rows is None else [v[rows] for v in self.local]
        scale = similarity(linear)
        if not len(radius):
            return centre, normal, radius
        if scale is not None:
            turned = normal @ linear.T / (scale or 1.0)
            return apply_transform(transform, centre), turned, scale * radius
        rows = np.arange(len(self.leaf)) if rows is None else rows
        size = self._first[rows + 1] - self._first[rows]
        owner = np.repeat(np.arange(len(rows)), size)
        facet = np.arange(len(owner)) + np.repeat(self._first[rows] - np.cumsum(size) + size, size)
        middle = apply_transform(transform, self._middle[facet])
        return _measure(middle, self._vector[facet] @ cofactor(linear).T, owner, len(rows))


def own_pieces(number: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which piece of which leaf each triangle (F, 3) is: pieces counted on (F,), and their leaves
    (L,).

    number : (F,) of the leaf, sorted.
    """
    leaf, owner = np.unique(number, return_inverse=True)
    piece = pieces_of(number, triangles) if len(number) else None
    if piece is None:
        return owner, leaf
    pairs, owner = np.unique(np.stack([number, piece], axis=1), axis=0, return_inverse=True)
    return owner.ravel(), pairs[:, 0].astype(leaf.dtype)


def similarity(linear: np.ndarray) -> float | None:
    """The scale of a (3, 3) matrix that turns, mirrors and scales evenly; None of any other."""
    gram = linear.T @ linear
    scale = math.sqrt(max(gram[0, 0], 0.0))
    if np.abs(gram - scale**2 * np.eye(3)).max() <= SIMILAR * scale**2:
        return scale
    return None


def cofactor(linear: np.ndarray) -> np.ndarray:
    """(3, 3) what area vectors go through when points go through ``linear``."""
    x, y, z = linear.T
    return np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1)


def _measure(middle: np.ndarray, vector: np.ndarray, owner: np.ndarray, count: int) -> Measured:
    """Centre, normal and radius of ``count`` leaves from facets (F, 3), (F, 3) and their owners."""
    area = np.linalg.norm(vector, axis=1)
    whole = np.bincount(owner, area, count)
    weight = np.where(whole[owner] > 0, area, 1.0)  # no area: the mean of the facets
    centre = _sum(middle * weight[:, None], owner, count)
    centre /= np.bincount(owner, weight, count)[:, None]
    normal = _sum(vector, owner, count)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, length, out=np.tile([0.0, 0.0, 1.0], (count, 1)), where=length > 0)
    return centre, normal, np.sqrt(whole / math.pi)


def _turned_alike(vector: np.ndarray, owner: np.ndarray, count: int) -> np.ndarray:
    """Area vectors (F, 3), each turned to agree with its leaf's largest facet: windings may differ."""
    order = np.argsort(np.linalg.norm(vector, axis=1), kind="stable")
    largest = np.zeros((count, 3))
    largest[owner[order]] = vector[order]  # the last one written stays
    against = np.einsum("fi,fi->f", vector, largest[owner]) < 0
    return np.where(against[:, None], -vector, vector)


def _sum(values: np.ndarray, owner: np.ndarray, count: int) -> np.ndarray:
    """(count, 3) sums of (F, 3) values by owner."""
    sums = [np.bincount(owner, values[:, axis], count) for axis in range(3)]
    return np.stack(sums, axis=1).astype(np.float64)  # of nothing, bincount counts whole numbers
