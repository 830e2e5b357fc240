"""Species files: TOML, and the STL templates that it may name.

Wherever a species is named, a name without an ending means a file of ``assets/species``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from hashlib import blake2b
from pathlib import Path
from typing import Any

import numpy as np

from ...base.places import ASSETS
from ...formats.foreign import guarded
from ...formats.stl import StlError, read_stl
from ...formats.toml_file import read_settings
from ...spec import SpecError, Species, quoted_with_hints, unknown
from ..graft.cut import TemplateError, TreeTemplate, split_tree
from ..graft.dress import dress
from ..lsystem.expression import ExpressionError
from ..lsystem.ruled import check_rules
from ..lsystem.word import GrammarError
from ..measured.wanted import Kind
from ..mesh.blades import SHAPES, Blade, BladeError, blade_from
from ..recognise.recognise import recognise
from ..regrow.anatomy import dissect
from ..regrow.fitted import Habit, fit
from .allometry_file import read_allometry

MOST_OF_TREE, MOST_OF_LEAF = 3_000_000, 10_000  # facets of a file
KEPT = 16  # trees that stay recognised; as many as a process keeps ready to graft
_recognised: dict[tuple[bytes, tuple[str, float]], TreeTemplate | Habit] = {}


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
            leaves = dress(wood, leaf, blade or SHAPES[leaf.shape](), unit)
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
    """Return what ``make`` makes of facets; of the trees that were last asked for it is kept.

    Every update of a forest, and every scene of a series, reads its species anew, and recognising one takes
    up to seconds. What is made of a template is kept by the object: the same one comes back.
    """
    content = blake2b(wood.tobytes())
    if leaves is not None:
        content.update(b"leaves" + leaves.tobytes())
    key = (content.digest(), what)
    found = _recognised.pop(key, None) or make()
    _recognised[key] = found  # the last again
    for old in list(_recognised)[:-KEPT]:
        _recognised.pop(old, None)
    return found
