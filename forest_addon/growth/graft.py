"""Branch templates onto nodes: rotate, scale and move so that foot and direction match (T20).

A template lies along +X with its upper side towards +Z. At a node its axis is turned into the branch's
direction and its upper side as far up as that direction allows, so that leaves keep facing the light.
Wood is scaled with the branch; leaves move with it but keep their own size, because a longer branch
bears no larger leaves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..rng import truncated_normal
from .template import BranchTemplate
from .trimesh import LEAF, WOOD, TriMesh


@dataclass(frozen=True)
class Scion:
    """A branch template made ready to graft: wood and leaves apart, every leaf with its foot."""

    wood: TriMesh
    leaf_mesh: TriMesh
    leaf_foot: np.ndarray  # (L, 3) where each leaf hangs, canonical frame
    leaf_of_vertex: np.ndarray  # (V,) leaf of each vertex of leaf_mesh
    length: float  # metres in the template tree


@dataclass(frozen=True)
class Site:
    """Where a branch is grafted: its foot (3,), unit direction (3,) and length in metres."""

    foot: np.ndarray
    direction: np.ndarray
    length: float


def prepare(template: BranchTemplate) -> Scion:
    """Take a template apart; a leaf's foot is its vertex nearest to any wood."""
    mesh = template.mesh
    wood, leaf_mesh = mesh.select(mesh.part == WOOD), mesh.select(mesh.part == LEAF)
    count = len(template.leaves)
    leaf_of_vertex = np.zeros(len(leaf_mesh.vertices), dtype=np.int64)
    leaf_of_vertex[leaf_mesh.triangles] = leaf_mesh.leaf[:, None]
    foot = np.zeros((count, 3))
    if count:
        gap = cKDTree(wood.vertices).query(leaf_mesh.vertices)[0]
        farthest_first = np.argsort(-gap, kind="stable")
        foot[leaf_of_vertex[farthest_first]] = leaf_mesh.vertices[farthest_first]
    return Scion(wood, leaf_mesh, foot, leaf_of_vertex, template.length)


def graft(
    scion: Scion, site: Site, leaf_spread: float, roll: float, rng: np.random.Generator
) -> TriMesh:
    """The branch at its site, wood and leaves in one mesh with leaf numbers from 0.

    leaf_spread : relative standard deviation of leaf size.
    roll : radians that the branch is turned about its own axis.

    A branch shorter than its template bears fewer leaves, in proportion.
    """
    turn = _frame(site.direction) @ _roll(roll)  # columns: images of X, Y, Z
    wood = scion.wood
    wood_vertices = (wood.vertices * site.length) @ turn.T + site.foot

    count = len(scion.leaf_foot)
    kept = rng.random(count) < site.length / scion.length
    size = scion.length * (1 + leaf_spread * truncated_normal(rng, count))  # canonical length is 1
    blade = scion.leaf_mesh.vertices - scion.leaf_foot[scion.leaf_of_vertex]
    hung = (
        scion.leaf_foot[scion.leaf_of_vertex] * site.length
        + blade * size[scion.leaf_of_vertex][:, None]
    )
    leaves = TriMesh(
        vertices=hung @ turn.T + site.foot,
        triangles=scion.leaf_mesh.triangles,
        part=scion.leaf_mesh.part,
        leaf=(np.cumsum(kept) - 1)[scion.leaf_mesh.leaf].astype(np.int32)
        if count
        else scion.leaf_mesh.leaf,
        material=np.ones(len(scion.leaf_mesh.leaf), dtype=np.int32),
    )
    leaves = leaves.select(kept[scion.leaf_mesh.leaf] if count else np.zeros(0, dtype=bool))
    return TriMesh(
        vertices=np.concatenate([wood_vertices, leaves.vertices]),
        triangles=np.concatenate([wood.triangles, leaves.triangles + len(wood_vertices)]).astype(
            np.int32
        ),
        part=np.concatenate([wood.part, leaves.part]),
        leaf=np.concatenate([wood.leaf, leaves.leaf]),
        material=np.concatenate([wood.material, leaves.material]),
    )


def _frame(direction: np.ndarray) -> np.ndarray:
    """(3, 3) rotation that takes +X to ``direction`` and +Z as far up as possible."""
    up = np.array([0.0, 0.0, 1.0])
    side = np.cross(up, direction)
    norm = np.linalg.norm(side)
    side = side / norm if norm > 1e-9 else np.array([0.0, 1.0, 0.0])
    return np.stack([direction, side, np.cross(direction, side)], axis=1)


def _roll(angle: float) -> np.ndarray:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
