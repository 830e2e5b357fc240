"""Maps of trees as CSV: a column of x, one of y, in metres, and perhaps one of species.

The header may say x, x_m, easting or E (any case), and the same for y; species, kind or planting. Commas,
semicolons and tabs separate. Lines that are empty or begin with # do not count.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..spec import SpecError
from .foreign import guarded

NAMES = {
    "x": ("x", "x_m", "easting", "east", "e"),
    "y": ("y", "y_m", "northing", "north", "n"),
    "species": ("species", "kind", "planting"),
    "ring": ("ring", "part"),
    "scale": ("scale", "size"),
    "rotation": ("rotation", "rotation_rad", "turn"),
    "dbh": ("dbh", "dbh_m"),
    "height": ("height", "height_m", "h"),
    "crown_width": ("crown_width", "crown_width_m"),
    "crown_base": ("crown_base", "crown_base_m"),
    "leaf_area": ("leaf_area", "leaf_area_m2"),
}


@dataclass(frozen=True)
class TreeMap:
    """position : (N, 2) metres. species : (N,) names, "" without such a column. line : (N,) in the file."""

    position: np.ndarray
    species: np.ndarray
    line: np.ndarray

    def __len__(self) -> int:
        return len(self.position)


def read_tree_map(path: Path) -> TreeMap:
    """Read where trees stand.

    Raises
    ------
    SpecError : the file is missing or no CSV with x and y; a row with what is not a finite number.
    """
    rows = read_rows(path, ("species",))
    return TreeMap(
        position=np.array([[x, y] for _, x, y, _ in rows], dtype=float).reshape(-1, 2),
        species=np.array([name for *_, (name,) in rows], dtype=np.str_),
        line=np.array([line for line, *_ in rows], dtype=np.int64),
    )


def read_rings(path: Path) -> list[np.ndarray]:
    """Read the corners of a polygon: its outline and, where a column ``ring`` changes, its holes.

    Raises
    ------
    SpecError : as for a map of trees.
    """
    rings: dict[str, list[tuple[float, float]]] = {}
    for _, x, y, (ring,) in read_rows(path, ("ring",)):
        rings.setdefault(ring, []).append((x, y))
    return [np.array(ring) for ring in rings.values()]


@guarded("a CSV file with columns x and y")
def read_rows(path: Path, extra: Sequence[str]) -> list[tuple[int, float, float, tuple[str, ...]]]:
    """Line number, x, y and the texts of other columns, "" where there is none, of every row.

    Raises
    ------
    SpecError : as for a map of trees.
    """
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    told = [(k, text) for k, text in enumerate(lines, 1) if text.strip() and text[0] != "#"]
    if not told:
        raise SpecError(str(path), "is empty; it needs a header with x and y, and a row a tree")
    separator = max(",;\t", key=told[0][1].count)
    head = [name.strip().lower() for name in _split(told[0][1], separator)]
    place = {
        key: next((k for k, name in enumerate(head) if name in NAMES[key]), None)
        for key in ("x", "y", *extra)
    }
    for key in ("x", "y"):
        if place[key] is None:
            raise SpecError(
                str(path),
                f"has no column {key}; call one of its columns {' or '.join(NAMES[key])}",
            )
    rows = []
    for line, text in told[1:]:
        values = [value.strip() for value in _split(text, separator)]
        if len(values) < len(head):
            raise SpecError(
                str(path),
                f"row {line} has {len(values)} values, its header {len(head)}; complete the row",
            )
        x, y = (number_of(path, line, key, values[place[key] or 0]) for key in ("x", "y"))
        found = (place[key] for key in extra)
        rows.append((line, x, y, tuple("" if k is None else values[k] for k in found)))
    return rows


def _split(text: str, separator: str) -> list[str]:
    return next(csv.reader(io.StringIO(text), delimiter=separator))


def number_of(path: Path, line: int, key: str, value: str) -> float:
    """The finite number that a text in a row says.

    Raises
    ------
    SpecError : it says none.
    """
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise SpecError(
            str(path),
            f'row {line}: {key} is "{value}", not a finite number; use metres with a decimal point',
        )
    return number
