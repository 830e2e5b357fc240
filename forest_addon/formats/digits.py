"""Tables of numbers as CSV at the speed of arrays: digits by arithmetic, a row a line.

``table.write_csv`` writes every digit of a float and takes a microsecond a number; here a column says how
many decimals it has, and a million numbers take a tenth of a second.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np

from .atomic import replacing

ROWS_AT_ONCE = 20_000


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
