"""Tables: CSV with a header and one row a thing, and NPZ with an array a column.

``write_csv`` writes every digit of a float and takes a microsecond a number; ``write_numbers`` writes as many
decimals as a column has, and a million numbers take a tenth of a second. Equal tables are equal files.
"""

from __future__ import annotations

import csv
import os
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from .atomic import replacing
from .ply import StoredRows

TEXT_AT_ONCE = 20_000  # rows
ROWS_AT_ONCE = 200_000
Columns = Mapping[str, Sequence[Any]]

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


def write_csv(path: str | os.PathLike[str], table: Columns | Iterable[Columns]) -> None:
    """Write columns of equal length, or parts of a table one below the other; floats keep every digit
    (``repr``), texts that would be formulas are quoted."""
    with replacing(path) as partial, open(partial, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        for number, part in enumerate([table] if isinstance(table, Mapping) else table):
            if not number:
                writer.writerow(map(quoted, part))
            writer.writerows(map(quoted, row) for row in zip(*part.values(), strict=True))


def write_npz(
    path: str | os.PathLike[str],
    arrays: Mapping[str, np.ndarray | StoredRows],
    units: Mapping[str, str],
    packed: bool = True,
) -> None:
    """Write arrays, also columns of stored rows; ``units`` says what each is measured in and becomes
    ``<name>_unit`` texts. packed : compress them."""
    texts = {f"{name}_unit": np.array(unit) for name, unit in units.items()}
    kind = zipfile.ZIP_DEFLATED if packed else zipfile.ZIP_STORED
    with replacing(path) as partial, zipfile.ZipFile(partial, "w", kind) as archive:
        for name, values in {**arrays, **texts}.items():
            entry = zipfile.ZipInfo(f"{name}.npy")
            entry.compress_type = kind
            with archive.open(entry, "w", force_zip64=packed or name not in texts) as file:
                if not isinstance(values, StoredRows):
                    np.lib.format.write_array(file, np.asanyarray(values), allow_pickle=False)
                    continue
                head = np.empty(0, values.dtype)
                told = np.lib.format.header_data_from_array_1_0(head) | {"shape": (len(values),)}
                np.lib.format.write_array_header_1_0(file, told)
                for first in range(0, len(values), ROWS_AT_ONCE):
                    file.write(values[first : first + ROWS_AT_ONCE].tobytes())


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
        for first in range(0, count, TEXT_AT_ONCE):
            rows = slice(first, first + TEXT_AT_ONCE)
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
