"""Branches of trees as files of cylinders: one table of all, and a quantitative structure model a tree."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from ..formats.qsm import write_treeqsm
from ..formats.table import write_numbers
from .coordinates import on_the_map

DECIMALS = (
    dict.fromkeys(("startX", "startY", "startZ", "endX", "endY", "endZ", "length"), 5)
    | dict.fromkeys(("radius_cyl", "radius_start", "radius_end"), 6)
    | {"volume": 12}
)


def write_cylinders(
    path: Path, table: Mapping[str, np.ndarray], offset: Sequence[float] = (0.0, 0.0, 0.0)
) -> None:
    """Write a table of cylinders (``stand.truth.cylinder_table``) as CSV. offset : metres, added to places.

    Raises
    ------
    OSError : it cannot be written.
    """
    write_numbers(path, on_the_map(table, offset), DECIMALS)


def write_models(
    folder: Path, table: Mapping[str, np.ndarray], offset: Sequence[float] = (0.0, 0.0, 0.0)
) -> Iterator[Path]:
    """Write the cylinders of each tree as a file of TreeQSM into a folder; give each path.

    Raises
    ------
    OSError : one cannot be written.
    """
    rows = on_the_map(table, offset)
    folder.mkdir(exist_ok=True)
    trees, first = np.unique(rows["tree"], return_index=True)
    ends = [*first[1:], len(rows["tree"])]
    for tree, begin, end in zip(trees.tolist(), first, ends, strict=True):
        path = folder / f"tree-{tree:05d}.mat"
        write_treeqsm(path, {name: column[begin:end] for name, column in rows.items()})
        yield path
