"""Species files and allometry files: TOML, the STL templates that a species may name, and tables of measured
trees.

Wherever a species is named, a name without an ending means a file of ``assets/species``; wherever an
allometry is named, one of ``assets/allometry``. A table is a CSV with columns ``species``, ``pft``,
``dbh_m``, ``height_m``, ``crown_width_m``, ``crown_base_m``, ``leaf_area_m2``, empty where nothing was
measured, and perhaps ``study``, who measured, and ``leaf_area_is``, how leaves were counted: "half" of their
surface, "all" of it, or the "outline" that a scanner sees.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from hashlib import blake2b
from pathlib import Path
from typing import Any

import numpy as np

from ...base.kept import LastAsked
from ...base.places import ASSETS, file_name
from ...formats.foreign import guarded
from ...formats.stl import StlError, read_stl
from ...formats.toml_file import read_settings
from ...spec import Allometry, SpecError, Species, quoted_with_hints, unknown
from ..lsystem.system import ExpressionError, GrammarError
from ..lsystem.turtle import check_rules
from ..measured.allometry import Kind, diameters, half_of_surface
from ..mesh.blades import Blade, BladeError, blade_from, leaf_blade
from ..own_tree.anatomy import dissect
from ..own_tree.habit import Habit, fit
from ..own_tree.recognise import TemplateError, recognise
from ..own_tree.template import TreeTemplate, dress, split_tree

FOLDER = ASSETS / "allometry"
COLUMNS = {
    "dbh": "dbh_m",
    "height": "height_m",
    "crown_width": "crown_width_m",
    "crown_base": "crown_base_m",
    "leaf_area": "leaf_area_m2",
}
MOST_OF_TREE, MOST_OF_LEAF = 3_000_000, 10_000  # facets of a file
KEPT = 16  # trees that stay recognised; as many as a process keeps ready to graft
_recognised: LastAsked[tuple[bytes, tuple[str, float]], TreeTemplate | Habit] = LastAsked(KEPT)


def allometry_names() -> list[str]:
    """Every preset of ``assets/allometry``."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def file_stem(name: str) -> str:
    """Name of the file of a kind: "Picea abies" becomes picea-abies."""
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


def find_species(name: str, folder: Path) -> Path:
    """The file of a species: a preset's, or a path relative to the folder of the scene file.

    Raises
    ------
    SpecError : there is no such preset; names those that are there.
    """
    if not name:
        raise SpecError("species", "is empty; choose a preset or a .toml file")
    if name.endswith(".toml"):
        return folder / name
    if name not in (names := species_names()):
        raise unknown("species", name, names, ", or a .toml file")
    return ASSETS / "species" / f"{name}.toml"


def check_known(names: Mapping[str, str], folder: Path) -> None:
    """Check that species are there, by what names each: presets by name, files by path from ``folder``.

    Raises
    ------
    SpecError : some are not; names all of them, each with the nearest preset.
    """
    known, wrong = species_names(), []
    for key, name in names.items():
        try:
            path = find_species(name, folder)
            if name.endswith(".toml") and not path.is_file():
                raise SpecError("species", f"{path}: there is no such file; check the path")
        except SpecError as problem:
            wrong.append(SpecError(key, problem.problem))
    if len(wrong) == 1:
        raise wrong[0]
    if wrong:
        where = ", ".join(problem.key for problem in wrong)
        said = quoted_with_hints((names[problem.key] for problem in wrong), known)
        raise SpecError(
            where, f"{said} are not there; use some of {', '.join(known)}, or .toml files"
        )


def species_names() -> list[str]:
    """Every preset of ``assets/species``."""
    return sorted(path.stem for path in (ASSETS / "species").glob("*.toml"))


@guarded("a species file", meant=(OSError,))
def load_species(path: Path) -> tuple[Species, TreeTemplate | Habit | Kind | Blade | None]:
    """Read a species and what it takes from files: templates, or allometry and leaf of one without.

    Raises
    ------
    SpecError : the file, its rules, or an STL file that it names, is missing or cannot be used.
    """
    return complete_species(read_settings(path, Species), path.parent, str(path))


def complete_species(
    species: Species, folder: Path, place: str
) -> tuple[Species, TreeTemplate | Habit | Kind | Blade | None]:
    """A species with what it takes from STL files, which start from ``folder``.

    Raises
    ------
    SpecError : its rules cannot be used, or an STL file is missing or bad; ``place`` names the species.
    """
    if species.rules is not None:
        try:
            check_rules(species.rules)
        except (GrammarError, ExpressionError) as problem:
            raise SpecError(place, f"rules: {problem}") from None
    template, leaf = species.template, species.leaf
    what = "leaf.mesh" if template is None else "template"
    try:
        blade = blade_from(read_stl(folder / leaf.mesh, MOST_OF_LEAF)) if leaf.mesh else None
        if template is None and species.targets is not None:
            named = species.targets.allometry
            return species, Kind(read_allometry(named, folder) if named else None, blade)
        if template is None:
            return species, blade
        wood = read_stl(folder / template.wood, MOST_OF_TREE)
        leaves = read_stl(folder / template.leaves, MOST_OF_TREE) if template.leaves else None
        if leaves is None and template.grow_leaves and leaf.on:
            unit = template.height / float(np.ptp(wood[:, :, 2])) if template.height else 1.0
            leaves = dress(wood, leaf, blade or leaf_blade(leaf, species.detail.tolerance), unit)
        if species.siblings is not None:
            tall = float(np.ptp(wood[:, :, 2])) if len(wood) else 0.0
            metres = template.height / tall if template.height and tall else 1.0
            return species, _once(
                ("fit", metres), wood, leaves, lambda: fit(dissect(recognise(wood, leaves), metres))
            )
        height = template.height
        return species, _once(
            ("split", height), wood, leaves, lambda: split_tree(wood, leaves, height=height)
        )
    except FileNotFoundError as problem:
        raise SpecError(
            place, f"{what}: there is no file {problem.filename}; check the path"
        ) from None
    except (StlError, TemplateError, BladeError) as problem:
        raise SpecError(place, f"{what}: {problem}") from None


def _once(
    what: tuple[str, float], wood: np.ndarray, leaves: np.ndarray | None, make: Callable[[], Any]
) -> Any:
    """Call ``make`` for facets, once; what it makes is kept of the trees that were last asked for.

    Every update of a forest, and every scene of a series, reads its species anew, and recognising one takes
    up to seconds. What is made of a template is kept by the object: the same one comes back.
    """
    content = blake2b(wood.tobytes())
    if leaves is not None:
        content.update(b"leaves" + leaves.tobytes())
    key = (content.digest(), what)
    return _recognised.once(key, make)
