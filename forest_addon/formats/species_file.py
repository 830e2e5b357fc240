"""Species files: TOML, and the STL templates that it may name.

Wherever a species is named, a name without an ending means a file of ``assets/species``.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from ..growth.lsystem.expression import ExpressionError
from ..growth.lsystem.ruled import check_rules
from ..growth.lsystem.word import GrammarError
from ..growth.mesh.blades import SHAPES, Blade, BladeError, blade_from
from ..growth.template.cut import TemplateError, TreeTemplate, split_tree
from ..growth.template.dress import dress
from ..spec import SpecError, Species
from .foreign import guarded
from .stl import StlError, read_stl
from .toml_file import read_settings

MOST_TEMPLATES = 16  # that a process keeps; as many as it keeps ready to graft
ASSETS = Path(__file__).resolve().parents[2] / "assets"


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
    preset = ASSETS / "species" / f"{name}.toml"
    if not preset.is_file():
        known = ", ".join(sorted(p.stem for p in preset.parent.glob("*.toml")))
        raise SpecError("species", f'"{name}" is not known; use one of {known}, or a .toml file')
    return preset


@guarded("a species file", meant=(OSError,))
def load_species(path: Path) -> tuple[Species, TreeTemplate | Blade | None]:
    """Read a species and what it takes from STL files: templates, or the leaf of one without.

    Raises
    ------
    SpecError : the file, its rules, or an STL file that it names, is missing or cannot be used.
    """
    return complete_species(read_settings(path, Species), path.parent, str(path))


def complete_species(
    species: Species, folder: Path, place: str
) -> tuple[Species, TreeTemplate | Blade | None]:
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
        blade = blade_from(read_stl(folder / leaf.mesh)) if leaf.mesh else None
        if template is None:
            return species, blade
        wood = read_stl(folder / template.wood)
        leaves = read_stl(folder / template.leaves) if template.leaves else None
        if leaves is None and template.grow_leaves and leaf.on:
            unit = template.height / float(np.ptp(wood[:, :, 2])) if template.height else 1.0
            leaves = dress(wood, leaf, blade or SHAPES[leaf.shape](), unit)
        return species, _split(wood, leaves, template.height)
    except FileNotFoundError as problem:
        raise SpecError(
            place, f"{what}: there is no file {problem.filename}; check the path"
        ) from None
    except (StlError, TemplateError, BladeError) as problem:
        raise SpecError(place, f"{what}: {problem}") from None


_templates: dict[bytes, TreeTemplate] = {}  # by what their facets are, the latest last


def _split(wood: np.ndarray, leaves: np.ndarray | None, height: float) -> TreeTemplate:
    """The template of these facets: the same object each time, cut once, whatever file they come from.

    What is made of a template is kept by the object, so a series of scenes neither cuts nor keeps it again.
    """
    digest = hashlib.blake2b(repr((height, wood.shape, leaves is None)).encode(), digest_size=20)
    for facets in (wood, leaves):
        if facets is not None:
            digest.update(np.ascontiguousarray(facets).data)
    key = digest.digest()
    found = _templates.pop(key, None) or split_tree(wood, leaves, height=height)
    _templates[key] = found
    while len(_templates) > MOST_TEMPLATES:
        del _templates[next(iter(_templates))]
    return found
