"""The truth of a tree: its wood as exact cones, its leaves by area and angle.

A segment of length h with radii r₁ and r₂ is the frustum of a cone: V = πh(r₁² + r₁r₂ + r₂²)/3, lateral
area A_L = π(r₁ + r₂)√(h² + (r₁ − r₂)²), projected area A_PR = (r₁ + r₂)h. For cylinders of diameter d these
are V = Σπd²h/4, A_L = Σπdh and A_PR = Σdh of S (SIMLIDAR), who sums segments each for itself, so that what
overlaps at a joint counts twice. A tree's volume is that of the solid, joints counted once (``solid``):
1 to 12 % less. The mesh fills somewhat less than that, since its polygons have the circle's perimeter (a
hexagon 91 % of its area), and goes on below the ground, which does not count.

Of a tree that is grafted from templates the skeleton knows the trunk and the places of branches only; its
wood is measured on the triangles, with A_PR = A_L/π, which holds for a cylinder however it is turned.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..base.trimesh import TriMesh, is_wood
from .measured.measure import dbh_of, lowest_branch, width_of
from .mesh.leaves import Leaves
from .mesh.union import shared_once
from .skeleton import Skeleton
from .solid import volume_of
from .tree import Tree

ANGLE_BINS = 18  # of 5° from 0 to 90°
MEASURES = (  # what ``tree_truth`` tells
    *("height_m", "dbh_m", "crown_base_m", "crown_width_m"),
    *("wood_volume_m3", "wood_area_m2", "projected_wood_m2"),
    *("leaves", "leaf_area_m2", "mean_leaf_angle_deg"),
)


@dataclass(frozen=True)
class Wood:
    """The wood of one tree: volume m³, lateral area m², projected area m²."""

    volume: float
    area: float
    projected: float


def wood_of_tree(tree: Tree) -> Wood:
    """The wood of a grown tree, from its skeleton where that is all of it, else from its mesh.

    It is kept with the skeleton: many places ask, also of the same tree with fewer leaves.
    """
    kept: dict[str, Wood] = vars(tree.skeleton)
    if "_wood" not in kept:
        kept["_wood"] = _wood_of(tree)
    return kept["_wood"]


def _wood_of(tree: Tree) -> Wood:
    if tree.grafted:
        return wood_of_mesh(tree.mesh)
    return replace(wood_of_skeleton(tree.skeleton), volume=volume_of(tree.skeleton))


def segment_table(skeleton: Skeleton) -> dict[str, np.ndarray]:
    """Columns by segment: order, generation, length, diameter, volume, area and projected area."""
    length = np.linalg.norm(skeleton.end - skeleton.start, axis=1)
    r1, r2 = skeleton.radius.T
    return {
        "order": skeleton.order,
        "generation": skeleton.generation,
        "length_m": length,
        "diameter_m": r1 + r2,
        "volume_m3": np.pi * length * (r1**2 + r1 * r2 + r2**2) / 3,
        "area_m2": np.pi * (r1 + r2) * np.hypot(length, r1 - r2),
        "projected_m2": (r1 + r2) * length,
    }


def wood_of_skeleton(skeleton: Skeleton) -> Wood:
    """The sum over all segments, as S does."""
    table = segment_table(skeleton)
    return Wood(*(float(table[name].sum()) for name in ("volume_m3", "area_m2", "projected_m2")))


def wood_of_mesh(mesh: TriMesh) -> Wood:
    """The wood of a mesh of closed tubes, facing outwards, what they share counted once (``mesh/union``);
    pieces without caps make the volume a guess.
    """
    triangles = mesh.triangles[is_wood(mesh.part)]
    if not len(triangles):
        return Wood(0.0, 0.0, 0.0)
    a, b, c = (mesh.vertices[triangles[:, k]] - mesh.vertices[triangles[0, 0]] for k in range(3))
    once = shared_once(np.stack([a, b, c], axis=1))
    cross = np.cross(b - a, c - a)
    volume = float(np.einsum("ti,ti->", a, cross)) / 6
    area = float(np.linalg.norm(cross, axis=1).sum()) / 2
    return Wood(volume * once, area, area / np.pi)


def leaf_angles(leaves: Leaves, bins: int = ANGLE_BINS) -> tuple[np.ndarray, np.ndarray]:
    """The leaf-angle distribution: edges (bins + 1,) in radians and density (bins,) per radian.

    A leaf's angle is that between its normal, either way round, and the vertical: 0 lies flat, π/2
    stands. Leaves count by their area. The density integrates to 1; without leaves it is 0.
    """
    edges = np.linspace(0.0, np.pi / 2, bins + 1)
    angle = np.arccos(np.clip(np.abs(leaves.normal[:, 2]), 0.0, 1.0))
    area = np.bincount(
        np.minimum((angle / edges[1]).astype(np.int64), bins - 1), leaves.radius**2, bins
    )
    total = float(area.sum())
    return edges, area / (total * edges[1]) if total > 0 else np.zeros(bins)


def crown_base(tree: Tree) -> float:
    """Metres to where the lowest branch with leaves leaves the stem; of a grafted tree to its lowest leaf."""
    if tree.grafted or not len(tree.leaves):
        return float(tree.leaves.centre[:, 2].min(initial=np.inf)) if len(tree.leaves) else 0.0
    return lowest_branch(tree.skeleton, tree.leaves.branch)


def crown_width(tree: Tree) -> float:
    """Mean diameter of the crown seen from above, metres: of its leaves, or of its wood without leaves."""
    leaves = tree.leaves
    if not len(leaves):
        return width_of(tree.skeleton.end)
    reach = 0.5 * leaves.length[:, None] * leaves.axis
    return width_of(np.concatenate([leaves.centre - reach, leaves.centre + reach]))


def tree_truth(tree: Tree) -> dict[str, float]:
    """The truth of one tree by name and unit."""
    wood = wood_of_tree(tree)
    edges, density = leaf_angles(tree.leaves)
    middle = (edges[1:] + edges[:-1]) / 2
    told = (
        *(tree.height, dbh_of(tree.skeleton), crown_base(tree), crown_width(tree)),
        *(wood.volume, wood.area, wood.projected),
        *(float(len(tree.leaves)), float(np.pi * (tree.leaves.radius**2).sum())),
        float(np.rad2deg((density * middle).sum() * edges[1])),
    )
    return dict(zip(MEASURES, told, strict=True))
