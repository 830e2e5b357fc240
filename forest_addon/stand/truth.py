"""The truth of a forest that its sensors are held against: every tree, every branch, all area by cell.

Tables are in world coordinates. A tree's breast height is 1.3 m above the ground at its foot; its crown's
base has a fiftieth of the leaf area below it, and the crown's width is the mean of its extents from all sides
(``growth.likeness``).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ..base.trimesh import LEAF, is_wood
from ..base.vectors import azimuth_of
from ..growth.likeness import crown_base, crown_width
from ..growth.measured.allometry import BREAST, stem_profile
from ..growth.mesh.cells import CellAreas, areas_by_cell, join_areas, triangle_areas
from ..growth.mesh.leaves import Leaves
from ..growth.skeleton import Skeleton, diameter_at, find_axes
from ..growth.tree import Tree
from .forest import GrownForest, stacked, tree_table

PARTS = ("leaf", "wood")  # columns of the areas by cell


def inventory(forest: GrownForest) -> dict[str, list[object]]:
    """One row a tree: what ``tree_table`` says, and what a forester measures on it, metres."""
    table = tree_table(forest)
    base = {key: crown_base(tree) for key, tree in forest.variants.items()}
    width = {key: crown_width(tree) for key, tree in forest.variants.items()}
    stand, keys = forest.stand, forest.keys
    rows = list(zip(keys, stand.sink.tolist(), stand.scale.tolist(), strict=True))
    more: dict[str, list[object]] = {
        "dbh_m": [
            diameter_at(forest.variants[key].skeleton, (BREAST + deep) / size) * size
            for key, deep, size in rows
        ],
        "crown_base_m": [base[key] * size - deep for key, deep, size in rows],
        "crown_width_m": [width[key] * size for key, _, size in rows],
        "all_branches": [int(not forest.variants[key].grafted) for key in keys],
    }
    height = [
        forest.variants[key].height * size - deep for key, deep, size in rows
    ]  # above the ground
    return table | {"height_m": height} | more


def cylinder_table(forest: GrownForest) -> dict[str, np.ndarray]:
    """One row a branch segment of every tree, columns as aRchi and rTwig name those of a TreeQSM model.

    Cylinders are counted from 1 within their tree; a parent or an extension of 0 is none. Of trees that are
    grafted from templates, trunk and first-level branches only (``all_branches`` of the inventory is 0).
    """
    tables = []
    tied = {key: _tied(tree.skeleton) for key, tree in forest.variants.items()}
    stand = forest.stand
    for number, (key, matrix) in enumerate(zip(forest.keys, forest.transforms(), strict=True)):
        wood, size = forest.variants[key].skeleton, float(stand.scale[number])
        start, end = (ends @ matrix[:, :3].T + matrix[:, 3] for ends in (wood.start, wood.end))
        length, radius = wood.length * size, wood.equal_radius * size
        tables.append(
            cylinder_columns(
                *(int(stand.id[number]), tied[key], (start, end)),
                *(wood.radius * size, radius, length),
            )
        )
    return stacked(tables)


def areas_of_trees(forest: GrownForest, edge: float) -> Iterator[CellAreas]:
    """For tree after tree, its areas of leaf (one side) and wood in the cells of a grid, m²."""
    variants = {key: _faces(tree) for key, tree in forest.variants.items()}
    sizes = forest.stand.scale.tolist()
    for key, matrix, size in zip(forest.keys, forest.transforms(), sizes, strict=True):
        columns, triangles, wood, area = variants[key]
        place = matrix[:, :3] @ columns
        place += matrix[:, 3:]
        yield areas_by_cell(place.T, triangles, wood, len(PARTS), edge, area * size**2)


def _faces(tree: Tree) -> tuple[np.ndarray, ...]:
    """Vertices (3, V), and of triangles of leaves and wood: corners, which of ``PARTS``, m² in the tree's own
    size.
    """
    triangles, part = tree.mesh.triangles, tree.mesh.part
    ours = (part == LEAF) | is_wood(part)
    if not ours.all():
        triangles, part = triangles[ours], part[ours]
    area = triangle_areas(tree.mesh.vertices, triangles)
    columns = np.ascontiguousarray(tree.mesh.vertices.T)
    return columns, np.asfortranarray(triangles), is_wood(part).astype(np.int64), area


def voxel_arrays(forest: GrownForest, edge: float) -> dict[str, np.ndarray]:
    """Densities of leaf and wood area in cubic cells, m²/m³, and which trees are in each.

    ``cell`` (K, 3) int32 times ``edge`` is a cell's lowest corner. ``tree_cell`` and ``tree`` (M,) are
    pairs: in which of the K cells is which tree.
    """
    of_trees = list(areas_of_trees(forest, edge))
    whole = join_areas(of_trees, len(PARTS))
    low = whole.cell.min(axis=0, initial=0)
    size = tuple((whole.cell.max(axis=0, initial=0) - low + 1).tolist())

    def key(cell: np.ndarray) -> np.ndarray:
        return np.asarray(np.ravel_multi_index(tuple((cell - low).T), size))

    order, keys = np.argsort(key(whole.cell)), np.sort(key(whole.cell))
    cells = [order[np.searchsorted(keys, key(one.cell))] for one in of_trees]
    trees = [np.full(len(c), t, np.int32) for c, t in zip(cells, forest.stand.id, strict=True)]
    none = np.empty(0, np.int32)
    return {
        "edge": np.array(edge),
        "cell": whole.cell.astype(np.int32),
        **{f"{name}_area_density": whole.area[:, k] / edge**3 for k, name in enumerate(PARTS)},
        "tree_cell": np.concatenate([*cells, none]).astype(np.int32),
        "tree": np.concatenate([*trees, none]),
    }


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
        own, world = _tied(grown.skeleton), placed_skeleton(grown, matrix)
        r1, r2 = world["radius"].T
        radius = np.sqrt((r1**2 + r1 * r2 + r2**2) / 3)
        length = np.linalg.norm(world["end"] - world["start"], axis=1)
        ends = world["start"], world["end"]
        tables.append(
            cylinder_columns(int(trees.tree[row]), own, ends, world["radius"], radius, length)
        )
    return stacked(tables)


def _tied(skeleton: Skeleton) -> dict[str, np.ndarray]:
    """Columns (S,) that say how the cylinders of a tree hang together, counted from 1; 0 is none."""
    axes = find_axes(skeleton)
    return {
        "cyl_ID": np.arange(1, len(skeleton) + 1),
        "parent_ID": skeleton.parent + 1,
        "extension_ID": axes.onward + 1,
        "axis_ID": axes.of_segment + 1,
        "branching_order": skeleton.order,
    }


def cylinder_columns(
    tree: int,
    own: dict[str, np.ndarray],
    ends: tuple[np.ndarray, np.ndarray],
    radii: np.ndarray,
    radius: np.ndarray,
    length: np.ndarray,
) -> dict[str, np.ndarray]:
    """Columns (S,) of the cylinders of a tree in the world, by the names of ``stand.truth.cylinder_table``.

    own : as ``_tied`` tells. ends : (S, 3) each, m. radii : (S, 2) at both ends, and radius (S,) of equal
    volume, m. length : (S,) m.
    """
    return {
        "tree": np.full(len(length), tree),
        **own,
        **{f"start{axis}": ends[0][:, k] for k, axis in enumerate("XYZ")},
        **{f"end{axis}": ends[1][:, k] for k, axis in enumerate("XYZ")},
        "radius_cyl": radius,
        "radius_start": radii[:, 0],
        "radius_end": radii[:, 1],
        "length": length,
        "volume": np.pi * radius**2 * length,
    }
