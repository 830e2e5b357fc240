"""The truth of a world's trees as tables: of those that were grown, then of those from asset libraries."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..spec import SpecError

if TYPE_CHECKING:
    from ..stand.forest import GrownForest
    from ..stand.placed import PlacedTrees

Table = dict[str, np.ndarray]


def trees(forest: GrownForest | None, placed: PlacedTrees) -> Table:
    """A row a tree."""
    from ..stand.forest import tree_table
    from ..stand.placed import placed_table

    table = _both(forest, placed, tree_table, placed_table)
    numbers = [name for name in table if name.startswith("target_") or name == "in_band"]
    return table | {name: _numbers(table[name]) for name in numbers}


def leaves(forest: GrownForest | None, placed: PlacedTrees) -> Table:
    """A row a leaf."""
    from ..stand.forest import leaf_table
    from ..stand.placed import placed_leaves

    return _both(forest, placed, leaf_table, placed_leaves)


def cylinders(forest: GrownForest | None, placed: PlacedTrees) -> Table:
    """A row a segment of a branch."""
    from ..stand.placed import placed_cylinders
    from ..stand.truth import cylinder_table

    return _both(forest, placed, cylinder_table, placed_cylinders)


def skeleton(forest: GrownForest | None, placed: PlacedTrees, tree: int) -> Table:
    """The segments of one tree in the world.

    Raises
    ------
    SpecError : there is no tree of this number.
    """
    from ..stand.placed import placed_skeleton

    rows = np.flatnonzero(forest.stand.id == tree) if forest is not None else ()
    if forest is None or not len(rows):
        row = placed.row_of(tree)
        if row is None:
            raise SpecError("tree", f"{tree} is no tree of this world; see trees['tree']")
        return placed_skeleton(placed.grown[placed.index[row]], placed.transform[row])
    row = int(rows[0])
    matrix, scale = forest.transforms()[row], float(forest.stand.scale[row])
    wood = forest.variant_of(row).skeleton
    return {
        "start": wood.start @ matrix[:, :3].T + matrix[:, 3],
        "end": wood.end @ matrix[:, :3].T + matrix[:, 3],
        "radius": wood.radius * scale,
        "parent": wood.parent,
        "order": wood.order,
        "generation": wood.generation,
        "dead": wood.is_dead,
    }


def _both(
    forest: GrownForest | None,
    placed: PlacedTrees,
    of_forest: Callable[[GrownForest], Mapping[str, Any]],
    of_placed: Callable[[PlacedTrees], Mapping[str, Any]],
) -> Table:
    """Tables one below the other; what only the grown trees have, as targets, is empty or NaN below."""
    if forest is None:
        return {name: np.array(column) for name, column in of_placed(placed).items()}
    first = {name: np.array(column) for name, column in of_forest(forest).items()}
    if not len(placed):
        return first
    second = {name: np.array(column) for name, column in of_placed(placed).items()}
    count = len(next(iter(second.values()), ()))
    return {
        name: np.concatenate([values, second.get(name, _nothing(values, count))])
        for name, values in first.items()
    }


def _numbers(column: np.ndarray) -> np.ndarray:
    """A column with gaps as float64, NaN in the gaps."""
    return np.array([np.nan if value == "" else float(value) for value in column.tolist()])


def _nothing(like: np.ndarray, count: int) -> np.ndarray:
    return np.full(count, np.nan if like.dtype.kind == "f" else "")
