"""Maps of trees as CSV: a column of x, one of y, and perhaps others of species and measures.

The header may say x, easting or E (any case), and the same for y; species, kind or planting. A unit may end
a name, as in x_ft or DBH (cm); without one lengths are metres. Commas, semicolons and tabs separate; between
semicolons a number may have a decimal comma. Text is UTF-8, or UTF-16 with its mark. Lines without a value
or with # first do not count.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..spec import SpecError
from .foreign import guarded
from .table import unquoted

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
TEXTS = ("species", "ring")
LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254}
UNITS = {  # of columns that are no lengths
    "rotation": {"rad": 1.0, "deg": math.pi / 180},
    "leaf_area": {"m2": 1.0, "m²": 1.0},
    "scale": {"%": 0.01},
}
WITH_UNIT = re.compile(r"(?P<name>.+?)(?:[_ ]| ?[(\[]) ?(?P<unit>[^_()\[\]]+?) ?[)\]]?")
ABSENT = ("", "na", "nan", "n/a")  # what R and pandas write where nothing was measured


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
        position=np.array([[x, y] for _, x, y, *_ in rows], dtype=float).reshape(-1, 2),
        species=np.array([name for *_, (name,), _ in rows], dtype=np.str_),
        line=np.array([line for line, *_ in rows], dtype=np.int64),
    )


def read_rings(path: Path) -> list[np.ndarray]:
    """Read the corners of a polygon: its outline and, where a column ``ring`` changes, its holes.

    Raises
    ------
    SpecError : as for a map of trees.
    """
    rings: dict[str, list[tuple[float, float]]] = {}
    for _, x, y, (ring,), _ in read_rows(path, ("ring",)):
        rings.setdefault(ring, []).append((x, y))
    return [np.array(ring) for ring in rings.values()]


@guarded("a CSV file with columns x and y")
def read_rows(
    path: Path, texts: Sequence[str], numbers: Sequence[str] = ()
) -> list[tuple[int, float, float, tuple[str, ...], tuple[float, ...]]]:
    """Return line number, x and y of every row, and its other columns.

    These are texts, "" where there is none, and numbers in metres, radians or m², NaN where there is none.

    Raises
    ------
    SpecError : as for a map of trees; a unit that is not known; a row longer or shorter than the header.
    """
    told = [(k, text) for k, text in enumerate(_lines(path), 1) if text.strip() and text[0] != "#"]
    separator = ""
    if told and told[0][1].lower().startswith("sep="):  # Excel's own line
        separator = told.pop(0)[1][4:5]
    if not told:
        raise SpecError(str(path), "is empty; it needs a header with x and y, and a row a tree")
    separator = separator or max(",;\t", key=told[0][1].count)
    head = [name.strip().lower() for name in _split(told[0][1], separator)]
    place = {key: _column(path, head, key) for key in ("x", "y", *texts, *numbers)}
    for key in ("x", "y"):
        if place[key] is None:
            raise SpecError(
                str(path),
                f"has no column {key}; call one of its columns {' or '.join(NAMES[key])}",
            )
    rows = []
    for line, text in told[1:]:
        values = [value.strip() for value in _split(text, separator)]
        if not any(values):
            continue
        if len(values) < len(head):
            raise SpecError(
                str(path),
                f"row {line} has {len(values)} values, its header {len(head)}; complete the row",
            )
        if any(values[len(head) :]):
            raise SpecError(
                str(path),
                f"row {line} has {len(values)} values, its header {len(head)}; name every column, and put "
                "semicolons between columns whose numbers have decimal commas",
            )

        def number(key: str, line: int = line, values: list[str] = values) -> float:
            found = place[key]
            if found is None or (key in numbers and values[found[0]].lower() in ABSENT):
                return math.nan
            said = values[found[0]]
            if separator == ";" and "." not in said and said.count(",") == 1:
                said = said.replace(",", ".")
            return number_of(path, line, key, said) * found[1]

        words = tuple(
            "" if (found := place[key]) is None else unquoted(values[found[0]]) for key in texts
        )
        rows.append((line, number("x"), number("y"), words, tuple(map(number, numbers))))
    return rows


def _lines(path: Path) -> list[str]:
    found = path.read_bytes()
    wide = found.startswith((b"\xff\xfe", b"\xfe\xff"))  # byte order marks of UTF-16
    return found.decode("utf-16" if wide else "utf-8-sig").splitlines()


def _column(path: Path, head: list[str], key: str) -> tuple[int, float] | None:
    """Return where a column stands in the header, and its unit in ours; None where there is none.

    Raises
    ------
    SpecError : its unit in brackets is not known.
    """
    units = {} if key in TEXTS else UNITS.get(key, LENGTHS)
    unknown = ""
    for k, name in enumerate(head):
        if name.replace(" ", "_") in NAMES[key]:
            return k, 1.0
        parts = WITH_UNIT.fullmatch(name)
        if parts is None or parts["name"].replace(" ", "_") not in NAMES[key]:
            continue
        if parts["unit"] in units:
            return k, units[parts["unit"]]
        if units and name[-1] in ")]":
            unknown = unknown or name
    if unknown:
        raise SpecError(
            str(path), f'the unit of column "{unknown}" is not known; use one of {", ".join(units)}'
        )
    return None


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
