"""A measured directivity as CSV: the first column is the angle from the axis, each further one a frequency.

    angle_deg, 250, 1000, 4000
    0,         0,   0,    0
    90,       -1,  -4,   -9
    180,      -3, -10,  -20

Levels are dB re the axis, or re anything else: they are used as they are. ``-inf`` is silence.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from ...formats.foreign import guarded
from ...spec import Reverb, SpecError
from .directivity import CARDIOID, OMNI, Directivity


def directivity_of(reverb: Reverb, folder: Path) -> Directivity:
    """Return how the sources of a reverb send; ``folder`` is where the name of its file starts from.

    Raises
    ------
    SpecError : the file cannot be used, with the reason.
    """
    if reverb.directivity == "measured":
        return read_directivity(folder / reverb.directivity_file)
    return CARDIOID if reverb.directivity == "cardioid" else OMNI


@guarded("a CSV of levels", key="directivity_file")
def read_directivity(path: Path) -> Directivity:
    """Read a CSV of levels by angle and frequency.

    Raises
    ------
    SpecError : it is missing, has a cell that is no number, or does not reach from 0 to 180°.
    """
    with open(path, newline="", encoding="utf-8-sig") as file:
        rows = [row for row in csv.reader(file) if any(cell.strip() for cell in row)]
    if len(rows) < 3 or len(rows[0]) < 2:
        raise _wrong(path, "needs a header with frequencies and at least two rows of angles")
    frequency = np.array([_number(path, 1, cell) for cell in rows[0][1:]])
    table = []
    for line, row in enumerate(rows[1:], 2):
        if len(row) != len(rows[0]):
            raise _wrong(path, f"line {line} has {len(row)} cells, the header {len(rows[0])}")
        table.append([_number(path, line, cell) for cell in row])
    levels = np.array(table)
    angle = levels[:, 0]
    if angle[0] != 0 or angle[-1] != 180 or (np.diff(angle) <= 0).any():
        raise _wrong(path, "its angles must rise from 0 to 180 degrees")
    if frequency[0] <= 0 or (np.diff(frequency) <= 0).any() or not np.isfinite(frequency).all():
        raise _wrong(path, "the frequencies of its header must rise, and be above 0 Hz")
    if not (levels[:, 1:] <= 200).all():
        raise _wrong(path, "its levels must be below 200 dB")
    return Directivity(np.deg2rad(angle), frequency, 10.0 ** (levels[:, 1:] / 20.0))


def _number(path: Path, line: int, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        raise _wrong(path, f'line {line}: "{cell.strip()}" is not a number') from None
    if math.isnan(value):
        raise _wrong(path, f"line {line}: NaN is not a number to use")
    return value


def _wrong(path: Path, problem: str) -> SpecError:
    return SpecError("directivity_file", f"{path.name}: {problem}")
