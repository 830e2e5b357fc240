"""Files that a sonar is given: measured beam patterns, routes, calls.

A pattern is a CSV with ``angle_deg`` and one column a frequency in Hz, levels in dB. A route is a CSV with
``x_m, y_m, z_m, azimuth_deg, elevation_deg`` and perhaps ``beam_width_deg``, one pose a row. A call is a
WAV file. Names are relative to the folder of the scene file, or else to ``assets/scenes``.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from ...base.places import ASSETS
from ...formats.foreign import guarded
from ...formats.wav import read_wav
from ...spec import Sonar, SpecError
from ..trajectory import Trajectory, looking
from .beam import BeamPattern, MeasuredBeam
from .calls import Call, resampled
from .station import Equipment

PLACES = ("x_m", "y_m", "z_m", "azimuth_deg", "elevation_deg")
WIDTH = "beam_width_deg"


def equip(sonar: Sonar, folder: Path) -> Equipment:
    """The equipment of a sonar, its files read.

    Raises
    ------
    SpecError : a file is missing, or is not what it should be; the sentence says where.
    """
    patterns: dict[str, BeamPattern | None] = {"beam": None, "hearing": None}
    for key in patterns:
        if getattr(sonar, key) == "file":
            patterns[key] = read_pattern(find(getattr(sonar, f"{key}_file"), folder, f"{key}_file"))
    call = None
    if sonar.call == "file":
        call = read_call(find(sonar.call_file, folder, "call_file"), sonar)
    return Equipment.of(sonar, patterns["beam"], patterns["hearing"], call)


def find(name: str, folder: Path, key: str) -> Path:
    """The file of this name beside the scene file or in assets/scenes.

    Raises
    ------
    SpecError : there is none.
    """
    for place in (folder / name, ASSETS / "scenes" / name):
        if place.is_file():
            return place
    raise SpecError(key, f'"{name}" is not in {folder}; check the name')


@guarded("a CSV of levels")
def read_pattern(path: Path) -> MeasuredBeam:
    """A measured beam pattern.

    Raises
    ------
    SpecError : a column that is no frequency, angles that do not rise from 0, a level that is no number.
    """
    head, rows = _numbers(path)
    if not head or head[0] != "angle_deg" or len(head) < 2:
        raise SpecError(
            str(path), 'needs the columns "angle_deg" and one or more frequencies in Hz'
        )
    try:
        frequency = np.array([float(name) for name in head[1:]])
    except ValueError:
        raise SpecError(
            str(path), "has a column that is no frequency; name them 60000, 70000"
        ) from None
    angle = np.deg2rad(rows[:, 0])
    if len(angle) < 2 or angle[0] != 0 or (np.diff(angle) <= 0).any():
        raise SpecError(str(path), "needs two or more angles that rise from 0")
    rising = np.isfinite(frequency).all() and (np.diff(frequency) > 0).all()
    if not rising or frequency[0] <= 0:
        raise SpecError(str(path), "needs frequencies in Hz that rise from left to right")
    return MeasuredBeam(angle, frequency, rows[:, 1:])


@guarded("a CSV of poses")
def read_route(path: Path, speed: float) -> Trajectory:
    """The trajectory of a route, flown at a speed in m/s.

    Raises
    ------
    SpecError : columns that are missing or not known, no rows, a width that is not positive.
    """
    head, rows = _numbers(path)
    allowed = (*PLACES, WIDTH)
    missing = [name for name in PLACES if name not in head]
    if missing or not set(head) <= set(allowed):
        raise SpecError(str(path), f"needs the columns {', '.join(PLACES)} and may have {WIDTH}")
    if not len(rows):
        raise SpecError(str(path), "has no poses; give one a row")
    column = {name: rows[:, number] for number, name in enumerate(head)}
    width = np.deg2rad(column[WIDTH]) if WIDTH in column else None
    if width is not None and not (width > 0).all():
        raise SpecError(str(path), f"{WIDTH} must be larger than 0")
    return looking(
        np.stack([column[name] for name in PLACES[:3]], axis=1),
        np.deg2rad(column["azimuth_deg"]),
        np.deg2rad(column["elevation_deg"]),
        width,
        speed,
    )


@guarded("a WAV file")
def read_call(path: Path, sonar: Sonar) -> Call:
    """The first channel of a WAV file as a call.

    Raises
    ------
    SpecError : it is no WAV file, or silent.
    """
    samples, rate = read_wav(path)
    try:
        return resampled(samples, rate, sonar)
    except SpecError:
        raise
    except ValueError as problem:
        raise SpecError(str(path), f"cannot be used as a call: {problem}") from None


def _numbers(path: Path) -> tuple[list[str], np.ndarray]:
    """Header and rows (R, C) of a CSV of numbers; lines that start with # are passed over."""
    with open(path, newline="", encoding="utf-8-sig") as file:
        lines = [row for row in csv.reader(line for line in file if line[:1] != "#") if row]
    head = [name.strip() for name in lines[0]] if lines else []
    for number, row in enumerate(lines[1:], start=2):
        if len(row) != len(head):
            raise SpecError(str(path), f"row {number} has {len(row)} values; give {len(head)}")
    try:
        rows = np.array([[float(value) for value in row] for row in lines[1:]], dtype=np.float64)
    except ValueError:
        raise SpecError(
            str(path), "has a cell that is no number; write numbers with a point"
        ) from None
    if not np.isfinite(rows).all():
        raise SpecError(str(path), "holds a number that is not finite")
    return head, rows.reshape(len(lines) - 1 if lines else 0, len(head))
