"""Tables as CSV: a header with units, one row a thing, numbers to the last digit."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TextIO

from .atomic import replacing

FORMULA = ("=", "+", "@")  # a cell that begins so is a formula to a spreadsheet


def quoted(cell: Any) -> Any:
    """A cell that a spreadsheet takes for what it says: a text that would be a formula begins with \"'\"."""
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
