"""Tables as CSV: a header with units, one row a thing.

``write_csv`` writes every digit of a float and takes a microsecond a number. With ``write_numbers`` a column
says how many decimals it has: digits by arithmetic, a million numbers in a tenth of a second.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TextIO

import numpy as np

from .atomic import replacing

ROWS_AT_ONCE = 20_000
FORMULA = ("=", "+", "@")  # a cell that begins so is a formula to a spreadsheet


def quoted(cell: Any) -> Any:
    """A cell that a spreadsheet takes for what it says: a formula begins with an apostrophe."""
    if not isinstance(cell, str) or not cell.lstrip("'").startswith(FORMULA) or _is_number(cell):
        return cell
    return f"'{cell}"


def unquoted(cell: str) -> str:
    """A cell as it was before ``quoted``."""
    return cell[1:] if cell.startswith("'") and cell.lstrip("'").startswith(FORMULA) else cell


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def write_rows(file: TextIO, rows: Iterable[Iterable[Any]]) -> None:
    """Write rows of cells, texts that would be formulas quoted."""
    writer = csv.writer(file, lineterminator="\n")
    writer.writerows(map(quoted, row) for row in rows)


def write_csv(path: str | os.PathLike[str], columns: Mapping[str, Sequence[Any]]) -> None:
    """Write columns of equal length; floats keep every digit (``repr``)."""
    with replacing(path) as partial, open(partial, "w", newline="", encoding="utf-8") as file:
        write_rows(file, [columns])
        write_rows(file, zip(*columns.values(), strict=True))


def write_numbers(
    path: str | os.PathLike[str], columns: Mapping[str, np.ndarray], decimals: Mapping[str, int]
) -> None:
    """Write columns of equal length; those of floats have ``decimals`` digits after the point.

    Raises
    ------
    OSError : it cannot be written.
    ValueError : a number that is not finite, or too large for its decimals (above 9e18 in its last digit).
    """
    count = len(next(iter(columns.values()))) if columns else 0
    with replacing(path) as partial, open(partial, "wb") as file:
        file.write((",".join(columns) + "\n").encode())
        for first in range(0, count, ROWS_AT_ONCE):
            rows = slice(first, first + ROWS_AT_ONCE)
            parts = []
            for number, (name, values) in enumerate(columns.items()):
                parts.append(_text(np.asarray(values[rows]), decimals.get(name, 0), name))
                end = b"\n" if number == len(columns) - 1 else b","
                parts.append(np.full((len(parts[-1]), 1), end[0], np.uint8))
            text = np.concatenate(parts, axis=1)
            file.write(text[text > 0].tobytes())


def _text(values: np.ndarray, decimals: int, name: str) -> np.ndarray:
    """(N, W) characters of numbers, right-aligned, 0 where there is none."""
    if values.dtype.kind == "f":
        large = np.rint(values * 10.0**decimals)
        if not (np.abs(large) < 9e18).all():
            raise ValueError(f"{name} has a number that is not finite, or too large to be written")
        whole = large.astype(np.int64)
    else:
        whole, decimals = values.astype(np.int64), 0
    rest = np.abs(whole).astype(np.uint64)
    wide = max(len(str(int(rest.max(initial=0)))), decimals + 1)
    text = np.zeros((len(values), wide + 1 + bool(decimals)), np.uint8)
    place = text.shape[1] - 1
    for digit in range(wide):
        if digit == decimals and decimals:
            text[:, place] = ord(".")
            place -= 1
        shown = slice(None) if digit <= decimals else rest > 0
        rest, last = np.divmod(rest, np.uint64(10))
        text[shown, place] = (last.astype(np.uint8) + ord("0"))[shown]
        place -= 1
    negative = np.flatnonzero(whole < 0)
    first = np.argmax(text[negative] > 0, axis=1)
    text[negative, first - 1] = ord("-")
    return text
