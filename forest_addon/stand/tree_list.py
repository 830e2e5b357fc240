"""Lists of trees to plant, as CSV: x and y, and any of species, scale, rotation (radians) and measures.

Measures are dbh, height, crown_width and crown_base, in metres unless the header says another unit, as in
``dbh_cm`` or ``Height (ft)``, and leaf_area in m²; they count where trees are grown to measure. The same
columns that ``stand`` and ``run`` write, so what they wrote can be planted again. A cell that is left empty,
or says NA, is drawn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..formats.foreign import guarded
from ..formats.tree_map import read_rows
from ..spec import SpecError
from .inputs import TreeList

MEASURES = ("dbh", "height", "crown_width", "crown_base", "leaf_area")
NUMBERS = ("scale", "rotation", *MEASURES)
MOST = {"dbh": 5.0, "height": 150.0, "crown_width": 100.0, "crown_base": 150.0}  # metres


@guarded("a CSV file with columns x and y")
def read_tree_list(path: Path, offset: Sequence[float] = (0.0, 0.0)) -> TreeList:
    """Read trees to plant; ``offset`` (x, y, ...) is taken from their coordinates.

    Raises
    ------
    SpecError : the file is missing or no CSV with x and y; a cell with what is not a finite number, or a
    scale or measure that is not above 0 or that no tree has.
    """
    rows = read_rows(path, ("species",), NUMBERS)
    position = np.array([[x, y] for _, x, y, *_ in rows], dtype=np.float64).reshape(-1, 2)
    numbers = np.array([found for *_, found in rows], dtype=np.float64).reshape(-1, len(NUMBERS))
    for (line, *_), found in zip(rows, numbers.tolist(), strict=True):
        for key, number in zip(NUMBERS, found, strict=True):
            if key != "rotation" and number <= 0:
                raise SpecError(str(path), f"row {line}: {key} is {number:g}; give one above 0")
            if number > MOST.get(key, math.inf):
                raise SpecError(
                    str(path),
                    f"row {line}: {key} is {number:g} m, more than trees have ({MOST[key]:g} m); give "
                    f"metres, or say the unit in the header, as {key}_cm or {key}_ft",
                )
    species = tuple(name for *_, (name,), _ in rows)
    measures = numbers[:, 2:]
    return TreeList(
        position=position - np.array(offset[:2]),
        species=species if any(species) else None,
        scale=numbers[:, 0],
        rotation=numbers[:, 1],
        measures=measures if np.isfinite(measures).any() else None,
    )
