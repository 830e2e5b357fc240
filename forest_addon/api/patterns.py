"""Directivity of a sonar from arrays."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..formats.table import write_csv
from ..spec import SpecError
from .given import path_of


def save_pattern(
    path: str | Path,
    frequency: np.ndarray,
    level_db: np.ndarray,
    *,
    angle_deg: np.ndarray | None = None,
    azimuth_deg: np.ndarray | None = None,
    elevation_deg: np.ndarray | None = None,
) -> str:
    """Write a measured pattern as the file that a ``Sonar`` takes, and return the file's name for it.

    frequency : (F,) Hz, rising. level_db : (D, F) at directions, or (E, D, F) with one pattern an ear, the
    left one first. angle_deg : (D,) off the axis, from 0 on; or azimuth_deg : (D,), to the left, and
    elevation_deg : (D,), up, in any order and anywhere on the sphere.

    Raises
    ------
    SpecError : arrays that do not fit together; a number that is not finite.

    >>> import tempfile, numpy as np
    >>> from forest_addon import api as forest
    >>> file = tempfile.mkdtemp() + "/ears.csv"
    >>> level = [[0, 0], [-6, -9], [-30, -40]]
    >>> ears = forest.save_pattern(file, [30e3, 90e3], level, angle_deg=[0, 40, 180])
    >>> sonar = forest.Sonar(hearing="file", hearing_file=ears)
    """
    target = path_of("save_pattern", path)
    by = {"angle_deg": angle_deg, "azimuth_deg": azimuth_deg, "elevation_deg": elevation_deg}
    given = [name for name, values in by.items() if values is not None]
    if given not in (["angle_deg"], ["azimuth_deg", "elevation_deg"]):
        raise SpecError("save_pattern", "takes angle_deg, or azimuth_deg and elevation_deg")
    try:
        hertz = np.atleast_1d(np.asarray(frequency, np.float64))
        level = np.asarray(level_db, np.float64)
        angles = np.stack([np.asarray(by[name], np.float64) for name in given], axis=1)
    except (TypeError, ValueError):
        raise SpecError("save_pattern", "takes arrays of numbers, angles of one length") from None
    if level.shape[-2:] != (len(angles), len(hertz)) or level.ndim not in (2, 3):
        raise SpecError(
            "level_db",
            f"has the shape {level.shape}; give ({len(angles)}, {len(hertz)}), a row a direction and a "
            "column a frequency, or that for each ear",
        )
    if not all(np.isfinite(numbers).all() for numbers in (hertz, level, angles)):
        raise SpecError("save_pattern", "takes finite numbers")
    if level.ndim == 3 and given == ["angle_deg"]:
        raise SpecError("level_db", "of several ears needs azimuth_deg and elevation_deg")
    several = level.ndim == 3
    tables = (
        dict(zip(given, angles.T.tolist(), strict=True))
        | ({"ear": [ear] * len(angles)} if several else {})
        | dict(zip(map(repr, hertz.tolist()), table.T.tolist(), strict=True))
        for ear, table in enumerate(level if several else level[None])
    )
    write_csv(target, tables)
    return str(target.resolve())
