"""Places as CSV, with a header: microphones of an array, and where a source or a receiver goes.

    x, y, z             time, x, y, z
    0.05, 0, 0          0, 0, 10, 1.5
    -0.05, 0, 0         8, 20, 10, 1.5

Metres and seconds; other columns are not read. Between the times of a path it is straight.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from ...formats.foreign import guarded
from ...spec import SpecError

MOST_MICROPHONES = 256
MOST_MOMENTS = 2000  # of a path


@guarded("a CSV of microphones", key="array_file")
def read_microphones(path: Path) -> np.ndarray:
    """(K, 3) metres of a CSV with the columns x, y and z.

    Raises
    ------
    SpecError : it is missing, lacks a column, has a cell that is no number, or too many rows.
    """
    found = _columns("array_file", path, ("x", "y", "z"))
    if len(found) > MOST_MICROPHONES:
        raise SpecError("array_file", f"{path.name} has {len(found)} microphones; give at most 256")
    return found


@guarded("a CSV of a path")
def read_path(path: Path, key: str) -> tuple[np.ndarray, np.ndarray]:
    """(T,) s that rise and (T, 3) metres of a CSV with the columns time, x, y and z.

    Raises
    ------
    SpecError : as above; times do not rise; fewer than two rows; a place that is not above the ground.
    """
    found = _columns(key, path, ("time", "x", "y", "z"))
    if len(found) < 2 or (np.diff(found[:, 0]) <= 0).any():
        raise SpecError(key, f"{path.name} needs two rows or more, whose times rise")
    if (found[:, 3] <= 0).any():
        raise SpecError(key, f"{path.name}: z must be above the ground, z = 0; raise it")
    return found[:, 0], found[:, 1:]


def _columns(key: str, path: Path, names: tuple[str, ...]) -> np.ndarray:
    """(N, columns) numbers."""
    with open(path, newline="", encoding="utf-8-sig") as file:
        rows = [row for row in csv.reader(file) if any(cell.strip() for cell in row)]
    header = [cell.strip().lower() for cell in rows[0]] if rows else []
    missing = [name for name in names if name not in header]
    if missing or len(rows) < 2:
        raise SpecError(
            key, f"{path.name} needs a header with {', '.join(names)} and at least one row"
        )
    places = [header.index(name) for name in names]
    found = []
    for line, row in enumerate(rows[1:], 2):
        try:
            values = [float(row[place]) for place in places]
        except (ValueError, IndexError):
            values = [math.nan]
        if not all(map(math.isfinite, values)):
            raise SpecError(
                key, f"{path.name}: line {line} lacks a number; give {', '.join(names)}"
            )
        found.append(values)
    return np.array(found)
