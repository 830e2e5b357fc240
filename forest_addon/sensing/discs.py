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

from ..growth.trimesh import TriMesh
from .geometry import SceneGeometry, apply_transform

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
    meshes = {index: _Foliage(scene.meshes[index]) for index in np.unique(scene.mesh_index)}
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


class _Foliage:
    """The leaves of one mesh: F facets, and what they measure in local space."""

    def __init__(self, mesh: TriMesh) -> None:
        facets = mesh.leaf >= 0
        self.leaf, self._owner = np.unique(mesh.leaf[facets], return_inverse=True)
        corners = mesh.vertices[mesh.triangles[facets]]
        self._middle = corners.mean(axis=1)
        vector = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._vector = _turned_alike(vector, self._owner, len(self.leaf))
        self._local = self._measure(self._middle, self._vector)

    def moved(self, transform: np.ndarray) -> Measured:
        """The leaves through one (3, 4) transform."""
        linear = transform[:, :3]
        if not len(self.leaf):
            return self._local
        gram = linear.T @ linear
        scale = math.sqrt(max(gram[0, 0], 0.0))
        if np.abs(gram - scale**2 * np.eye(3)).max() <= SIMILAR * scale**2:
            centre, normal, radius = self._local
            turned = normal @ linear.T / (scale or 1.0)
            return apply_transform(transform, centre), turned, scale * radius
        x, y, z = linear.T
        cofactor = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1)
        middle = apply_transform(transform, self._middle)
        return self._measure(middle, self._vector @ cofactor.T)

    def _measure(self, middle: np.ndarray, vector: np.ndarray) -> Measured:
        count = len(self.leaf)
        area = np.linalg.norm(vector, axis=1)
        whole = np.bincount(self._owner, area, count)
        weight = np.where(whole[self._owner] > 0, area, 1.0)  # no area: the mean of the facets
        centre = _sum(middle * weight[:, None], self._owner, count)
        centre /= np.bincount(self._owner, weight, count)[:, None]
        normal = _sum(vector, self._owner, count)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        normal = np.divide(
            normal, length, out=np.tile([0.0, 0.0, 1.0], (count, 1)), where=length > 0
        )
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
