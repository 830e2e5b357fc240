"""Trees that stand as somebody put them: turned, leaned and stretched at will, with their truth.

The trees are kept as they were grown, at the origin; an affine transform M with linear part A puts each into
the world. A leaf of normal n and area s has there the normal A⁻ᵀn (normalised) and the area s |det A| |A⁻ᵀn|;
its axis is A times its axis. A stem that is stretched by v along the vertical and by h = √(|det A|/v)
across it has its diameter at breast height where it was 1.3/v m up, times h. Lengths, areas and volumes of
wood grow with v and h, (det A)^(2/3) and det A: exact for trees that are turned and scaled alike on
all axes, and volumes always.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..base.vectors import azimuth_of
from ..growth.measured.allometry import BREAST, stem_profile
from ..growth.mesh.leaves import Leaves
from ..growth.skeleton import Cylinders, Skeleton, cylinders_of
from .forest import stacked


@dataclass(frozen=True)
class PlacedVariant:
    """A tree as it was grown, without its mesh.

    name : of the asset. truth : by name and unit, as ``growth.truth.tree_truth`` says it.
    grafted : whether its skeleton holds trunk and first-level branches only.
    """

    name: str
    species: str
    skeleton: Skeleton
    leaves: Leaves
    truth: Mapping[str, float]
    grafted: bool = False


@dataclass(frozen=True)
class PlacedTrees:
    """N trees in the world.

    grown : of each kind. index : (N,) which of them. transform : (N, 3, 4) local to world.
    tree, species : (N,) numbers that sensors report. object_name : (N) whom each belongs to.
    """

    grown: tuple[PlacedVariant, ...]
    index: np.ndarray
    transform: np.ndarray
    tree: np.ndarray
    species: np.ndarray
    object_name: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.index)

    def row_of(self, tree: int) -> int | None:
        """Return which row a tree of this number has."""
        rows = np.flatnonzero(self.tree == tree)
        return int(rows[0]) if len(rows) else None


NONE = PlacedTrees(
    *(
        (),
        np.empty(0, np.int64),
        np.empty((0, 3, 4)),
        np.empty(0, np.int64),
        np.empty(0, np.int64),
        (),
    )
)


def placed_table(trees: PlacedTrees) -> dict[str, list[object]]:
    """One row a tree, the columns of ``stand.forest.tree_table``; ``planting`` is the object's name."""
    linear = trees.transform[:, :, :3]
    volume = np.abs(np.linalg.det(linear)) if len(trees) else np.empty(0)
    along = np.linalg.norm(linear[:, :, 2], axis=1)
    across = np.sqrt(volume / np.maximum(along, 1e-300))
    rows = [trees.grown[k] for k in trees.index.tolist()]

    def told(name: str, factor: np.ndarray) -> list[object]:
        values = np.array([row.truth.get(name, np.nan) for row in rows], dtype=float)
        return list((values * factor).tolist())

    dbh = [_dbh(row.skeleton, v, h) for row, v, h in zip(rows, along, across, strict=True)]
    foot = np.array([float(row.skeleton.radius[:1, 0].sum()) for row in rows])
    area = [
        float(np.pi * (_leaves_in(row.leaves, m)["radius"] ** 2).sum())
        for row, m in zip(rows, trees.transform, strict=True)
    ]
    return {
        "tree": trees.tree.tolist(),
        "species": [row.species for row in rows],
        "planting": list(trees.object_name),
        "variant": trees.index.tolist(),
        **{f"{axis}_m": trees.transform[:, k, 3].tolist() for k, axis in enumerate("xyz")},
        "rotation_rad": azimuth_of(linear[:, :, 0]).tolist(),
        "scale": np.cbrt(volume).tolist(),
        "height_m": told("height_m", along),
        "dbh_m": dbh,
        "crown_width_m": told("crown_width_m", across),
        "crown_base_m": told("crown_base_m", along),
        "foot_radius_m": (foot * across).tolist(),
        "leaves": [len(row.leaves) for row in rows],
        "leaf_area_m2": area,
        "wood_volume_m3": told("wood_volume_m3", volume),
        "wood_area_m2": told("wood_area_m2", np.cbrt(volume) ** 2),
        "projected_wood_m2": told("projected_wood_m2", np.cbrt(volume) ** 2),
    }


def placed_leaves(trees: PlacedTrees) -> dict[str, np.ndarray]:
    """Every leaf in the world, the columns of ``stand.forest.leaf_table``."""
    tables = []
    for row, (index, matrix) in enumerate(zip(trees.index.tolist(), trees.transform, strict=True)):
        leaves = trees.grown[index].leaves
        count = len(leaves)
        own = {
            **_leaves_in(leaves, matrix),
            "branch": leaves.branch,
            "leaf": np.arange(count, dtype=np.int32),
            "tree": np.full(count, trees.tree[row], dtype=np.int32),
            "species": np.full(count, trees.species[row], dtype=np.int16),
        }
        tables.append(own)
    return stacked(tables)


def placed_skeleton(grown: PlacedVariant, matrix: np.ndarray) -> dict[str, np.ndarray]:
    """The segments of a tree in the world, as ``api.World.skeleton`` gives them; radii grow with √(area)
    across each segment: (|det A| / |A u|)^½ for a segment along u.
    """
    wood, linear = grown.skeleton, matrix[:, :3]
    way = wood.end - wood.start
    length = np.maximum(np.linalg.norm(way, axis=1), 1e-300)
    stretch = np.linalg.norm(way @ linear.T, axis=1) / length
    wide = np.sqrt(abs(np.linalg.det(linear)) / np.maximum(stretch, 1e-300))
    return {
        "start": wood.start @ linear.T + matrix[:, 3],
        "end": wood.end @ linear.T + matrix[:, 3],
        "radius": wood.radius * wide[:, None],
        "parent": wood.parent,
        "order": wood.order,
        "generation": wood.generation,
        "dead": wood.is_dead,
    }


def _leaves_in(leaves: Leaves, matrix: np.ndarray) -> dict[str, np.ndarray]:
    """Place and size of leaves through a transform (3, 4)."""
    linear = matrix[:, :3]
    volume = float(np.linalg.det(linear))
    cofactor = volume * np.linalg.inv(linear).T if volume else np.zeros((3, 3))
    area = leaves.normal @ cofactor.T  # of a unit area of the leaf, as a vector
    grows = np.linalg.norm(area, axis=1)
    axis = leaves.axis @ linear.T
    long = np.linalg.norm(axis, axis=1)
    return {
        "centre": leaves.centre @ linear.T + matrix[:, 3],
        "normal": area / np.maximum(grows, 1e-300)[:, None] * (1.0 if volume >= 0 else -1.0),
        "axis": axis / np.maximum(long, 1e-300)[:, None],
        "length": leaves.length * long,
        "width": leaves.width * grows / np.maximum(long, 1e-300),
        "radius": leaves.radius * np.sqrt(grows),
    }


def _dbh(skeleton: Skeleton, along: float, across: float) -> float:
    """Diameter of a stem that is stretched along and across the vertical; 0 where it is lower than 1.3 m."""
    z, d = stem_profile(skeleton)
    height = BREAST / along if along else np.inf
    return across * float(np.interp(height, z, d)) if len(z) and height <= z[-1] else 0.0


def placed_cylinders(trees: PlacedTrees) -> dict[str, np.ndarray]:
    """One row a branch segment of every tree, the columns of ``stand.truth.cylinder_table``."""
    tables = []
    for row, (index, matrix) in enumerate(zip(trees.index.tolist(), trees.transform, strict=True)):
        grown = trees.grown[index]
        own, world = cylinders_of(grown.skeleton), placed_skeleton(grown, matrix)
        r1, r2 = world["radius"].T
        radius = np.sqrt((r1**2 + r1 * r2 + r2**2) / 3)
        length = np.linalg.norm(world["end"] - world["start"], axis=1)
        ends = world["start"], world["end"]
        tables.append(
            cylinder_columns(int(trees.tree[row]), own, ends, world["radius"], radius, length)
        )
    return stacked(tables)


def cylinder_columns(
    tree: int,
    own: Cylinders,
    ends: tuple[np.ndarray, np.ndarray],
    radii: np.ndarray,
    radius: np.ndarray,
    length: np.ndarray,
) -> dict[str, np.ndarray]:
    """Columns (S,) of the cylinders of a tree in the world, by the names of ``stand.truth.cylinder_table``.

    ends : (S, 3) each, m. radii : (S, 2) at both ends, and radius (S,) of equal volume, m. length : (S,) m.
    """
    return {
        "tree": np.full(len(own), tree),
        "cyl_ID": np.arange(1, len(own) + 1),
        "parent_ID": own.parent + 1,
        "extension_ID": own.extension + 1,
        "axis_ID": own.axis + 1,
        "branching_order": own.order,
        **{f"start{axis}": ends[0][:, k] for k, axis in enumerate("XYZ")},
        **{f"end{axis}": ends[1][:, k] for k, axis in enumerate("XYZ")},
        "radius_cyl": radius,
        "radius_start": radii[:, 0],
        "radius_end": radii[:, 1],
        "length": length,
        "volume": np.pi * radius**2 * length,
    }
