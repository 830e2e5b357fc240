"""The truth of a forest that its sensors are held against: every tree, every branch, all area by cell.

Tables are in world coordinates. A tree's breast height is 1.3 m above the ground at its foot; its crown's
base has a fiftieth of the leaf area below it, and the crown's width is the mean of its extents from all sides
(``growth.likeness``).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..base.trimesh import LEAF, is_wood
from ..growth.likeness import crown_base, crown_width
from ..growth.mesh.cells import CellAreas, areas_by_cell, join_areas, triangle_areas
from ..growth.own_tree.habit import BREAST
from ..growth.skeleton import Cylinders, cylinders_of, diameter_at
from ..growth.tree import Tree
from .forest import GrownForest, stacked, tree_table
from .placed import cylinder_columns

PARTS = ("leaf", "wood")  # columns of the areas by cell


def inventory(forest: GrownForest) -> dict[str, list[object]]:
    """One row a tree: what ``tree_table`` says, and what a forester measures on it, metres."""
    table = tree_table(forest)
    base = {key: crown_base(tree) for key, tree in forest.variants.items()}
    width = {key: crown_width(tree) for key, tree in forest.variants.items()}
    stand = forest.stand
    keys = list(zip(stand.species.tolist(), stand.variant.tolist(), strict=True))
    sunk, scale = stand.sink.tolist(), stand.scale.tolist()
    rows = list(zip(keys, sunk, scale, strict=True))
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
    variants = {key: cylinders_of(tree.skeleton) for key, tree in forest.variants.items()}
    stand = forest.stand
    keys = zip(stand.species.tolist(), stand.variant.tolist(), strict=True)
    for number, (key, matrix) in enumerate(zip(keys, forest.transforms(), strict=True)):
        own: Cylinders = variants[key]
        size = float(stand.scale[number])
        start, end = (ends @ matrix[:, :3].T + matrix[:, 3] for ends in (own.start, own.end))
        length, radius = own.length * size, own.equal_radius * size
        tables.append(
            cylinder_columns(
                int(stand.id[number]), own, (start, end), own.radius * size, radius, length
            )
        )
    return stacked(tables)


def areas_of_trees(forest: GrownForest, edge: float) -> Iterator[CellAreas]:
    """For tree after tree, its areas of leaf (one side) and wood in the cells of a grid, m²."""
    variants = {key: _faces(tree) for key, tree in forest.variants.items()}
    stand = forest.stand
    keys = zip(stand.species.tolist(), stand.variant.tolist(), strict=True)
    for key, matrix, size in zip(keys, forest.transforms(), stand.scale.tolist(), strict=True):
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
    number_of = _Numbers(whole.cell)
    cells = [number_of(one.cell) for one in of_trees]
    trees = [np.full(len(c), t, np.int32) for c, t in zip(cells, forest.stand.id, strict=True)]
    none = np.empty(0, np.int32)
    return {
        "edge": np.array(edge),
        "cell": whole.cell.astype(np.int32),
        **{f"{name}_area_density": whole.area[:, k] / edge**3 for k, name in enumerate(PARTS)},
        "tree_cell": np.concatenate([*cells, none]).astype(np.int32),
        "tree": np.concatenate([*trees, none]),
    }


class _Numbers:
    """Row numbers of cells within a table of different cells (K, 3)."""

    def __init__(self, cell: np.ndarray) -> None:
        self.low = cell.min(axis=0, initial=0)
        self.size = tuple((cell.max(axis=0, initial=0) - self.low + 1).tolist())
        key = self._key(cell)
        self.order = np.argsort(key)
        self.key = key[self.order]

    def _key(self, cell: np.ndarray) -> np.ndarray:
        return np.asarray(np.ravel_multi_index(tuple((cell - self.low).T), self.size))

    def __call__(self, cell: np.ndarray) -> np.ndarray:
        return np.asarray(self.order[np.searchsorted(self.key, self._key(cell))])
