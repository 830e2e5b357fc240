"""Allometry files, and tables of measured trees that they are fitted to.

Wherever an allometry is named, a name without an ending means a file of ``assets/allometry``. A table is a
CSV with columns ``species``, ``pft``, ``dbh_m``, ``height_m``, ``crown_width_m``, ``crown_base_m``,
``leaf_area_m2``, empty where nothing was measured, and perhaps ``study``, who measured, and ``leaf_area_is``,
how leaves were counted: "half" of their surface, "all" of it, or the "outline" that a scanner sees.
"""

from __future__ import annotations

import csv
import math
from functools import lru_cache
from pathlib import Path

import numpy as np

from ...base.places import ASSETS, file_name
from ...formats.foreign import guarded
from ...formats.toml_file import read_settings
from ...spec import Allometry, SpecError, unknown
from ..measured.studies import diameters, half_of_surface

FOLDER = ASSETS / "allometry"
COLUMNS = {
    "dbh": "dbh_m",
    "height": "height_m",
    "crown_width": "crown_width_m",
    "crown_base": "crown_base_m",
    "leaf_area": "leaf_area_m2",
}


def allometry_names() -> list[str]:
    """Every preset of ``assets/allometry``."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def file_stem(name: str) -> str:
    """Return what the file of a kind is called: "Picea abies" becomes picea-abies."""
    return file_name(name.lower()).replace(" ", "-")


def read_allometry(name: str, folder: Path) -> Allometry:
    """A preset, or a file of that name relative to ``folder``.

    Raises
    ------
    SpecError : there is no such allometry, or its file cannot be used.
    """
    path = folder / name if name.endswith(".toml") else FOLDER / f"{name}.toml"
    if not path.is_file() or (not name.endswith(".toml") and name not in allometry_names()):
        raise unknown("allometry", name, allometry_names(), ", or a .toml file")
    return _read(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=64)
def _read(path: Path, _changed: int) -> Allometry:
    return read_settings(path, Allometry)


@guarded("a CSV file of measured trees")
def read_measured(path: Path) -> dict[str, np.ndarray]:
    """A table of measured trees: texts ``species``, ``pft`` and ``study``, and the numbers of ``COLUMNS``.

    Leaf areas are half of the surface of leaves, and what is known of BAAD's studies is put right.

    Raises
    ------
    SpecError : the file is missing, has no such columns, or a cell that is no number.
    """
    with open(path, newline="", encoding="utf-8-sig") as file:
        rows = list(csv.DictReader(file))
    needed = ("species", "pft", *COLUMNS.values())
    missing = [key for key in needed if not rows or key not in rows[0]]
    if missing:
        raise SpecError(str(path), f"has no column {missing[0]}; it needs {', '.join(needed)}")
    table = {key: np.array([row[key] or "" for row in rows]) for key in ("species", "pft")}
    table["study"] = np.array([row.get("study") or "" for row in rows])
    for key, column in COLUMNS.items():
        table[key] = np.array(
            [_number(path, line, column, row[column]) for line, row in enumerate(rows, 2)]
        )
    way = np.array([row.get("leaf_area_is") or "" for row in rows])
    table["dbh"] = diameters(table["dbh"], table["study"])
    table["leaf_area"] = half_of_surface(
        table["leaf_area"], table["species"], table["pft"], table["study"], way
    )
    return table


def _number(path: Path, line: int, column: str, text: str | None) -> float:
    if not text or text.strip() in ("", "NA"):
        return math.nan
    try:
        return float(text)
    except ValueError:
        raise SpecError(
            str(path),
            f'row {line}: {column} is "{text}", not a number; correct it or leave it empty',
        ) from None
