"""Lists of trees to plant, as CSV: x and y, and any of species, scale, rotation (radians) and measures.

Measures are dbh, height, crown_width and crown_base in metres, and leaf_area in m²; they count where trees
are grown to measure. The same columns that ``stand`` and ``run`` write, so what they wrote can be planted
again. A cell that is left empty is drawn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..formats.foreign import guarded
from ..formats.tree_map import number_of, read_rows
from ..spec import SpecError
from .inputs import TreeList

MEASURES = ("dbh", "height", "crown_width", "crown_base", "leaf_area")
NUMBERS = ("scale", "rotation", *MEASURES)


@guarded("a CSV file with columns x and y")
def read_tree_list(path: Path, offset: Sequence[float] = (0.0, 0.0)) -> TreeList:
    """Read trees to plant; ``offset`` (x, y, ...) is taken from their coordinates.

    Raises
    ------
    SpecError : the file is missing or no CSV with x and y; a cell with what is not a finite number, or a
    scale or measure that is not above 0.
    """
    rows = read_rows(path, ("species", *NUMBERS))
    position = np.array([[x, y] for _, x, y, _ in rows], dtype=np.float64).reshape(-1, 2)
    numbers = np.full((len(rows), len(NUMBERS)), np.nan)
    for row, (line, _, _, (_, *texts)) in enumerate(rows):
        for column, (key, text) in enumerate(zip(NUMBERS, texts, strict=True)):
            numbers[row, column] = number_of(path, line, key, text) if text else math.nan
            if key != "rotation" and numbers[row, column] <= 0:
                raise SpecError(str(path), f"row {line}: {key} is {text}; give one above 0")
    species = tuple(texts[0] for *_, texts in rows)
    measures = numbers[:, 2:]
    return TreeList(
        position=position - np.array(offset[:2]),
        species=species if any(species) else None,
        scale=numbers[:, 0],
        rotation=numbers[:, 1],
        measures=measures if np.isfinite(measures).any() else None,
    )
