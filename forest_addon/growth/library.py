"""A user's tree in files becomes a species that grows: the folder of its library.

Written: the tree in metres (wood.stl, leaves.stl), a species file by which siblings of it grow (or trees
of Tanveer et al.'s grammar, fitted to its habit), and a scene that plants it (scene.toml).

Species files and allometry files: TOML, the STL templates that a species may name, and tables of measured
trees.

Wherever a species is named, a name without an ending means a file of ``assets/species``; wherever an
allometry is named, one of ``assets/allometry``. A table is a CSV with columns ``species``, ``pft``,
``dbh_m``, ``height_m``, ``crown_width_m``, ``crown_base_m``, ``leaf_area_m2``, empty where nothing was
measured, and perhaps ``study``, who measured, and ``leaf_area_is``, how leaves were counted: "half" of their
surface, "all" of it, or the "outline" that a scanner sees.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ..base.kept import LastAsked, digest
from ..base.places import ASSETS, file_name, version
from ..base.progress import Progress
from ..base.trimesh import LEAF, TriMesh
from ..formats.atomic import replacing
from ..formats.foreign import guarded
from ..formats.ownership import claim, remove
from ..formats.stl import StlError, read_stl, write_stl
from ..formats.table import read_columns
from ..formats.toml_file import VERSION_KEY, read_settings
from ..spec import Allometry, Siblings, SpecError, Species, quoted_with_hints, unknown
from .likeness import Verdict, judge
from .lsystem.system import ExpressionError, GrammarError
from .lsystem.turtle import check_rules
from .measured.allometry import DIAMETER_UNITS, Kind, half_of_surface
from .mesh.blades import Blade, BladeError, blade_from, leaf_blade
from .mesh.leaves import measure_leaves
from .own_tree.anatomy import dissect
from .own_tree.habit import Habit, allometry_of, fit
from .own_tree.pieces import (
    UNITS,
    UPRIGHT,
    Group,
    Sorted,
    Unit,
    infer_unit,
    likely_up,
    sort_out,
    stood,
)
from .own_tree.recognise import LeanError, Recognition, TemplateError, recognise
from .own_tree.template import TreeTemplate, dress, fit_grammar, split_tree

COLUMNS = {
    "dbh": "dbh_m",
    "height": "height_m",
    "crown_width": "crown_width_m",
    "crown_base": "crown_base_m",
    "leaf_area": "leaf_area_m2",
}
SIBLINGS = """
# Siblings of this tree; 0 is the tree itself. Without this table, Tanveer et al.'s grammar sets its branches.
[siblings]
variety = {variety}
allometry = "{allometry}"
"""
FITTED = (  # settings of a grammar that are fitted to a tree, in the order of its file
    *("generations", "copies", "length", "side_ratio", "centre_ratio", "angle_deg", "twist_deg"),
    *("radius", "radius_ratio"),
)
MOST_OF_TREE, MOST_OF_LEAF = 3_000_000, 10_000  # facets of a file
KEPT = 16  # trees that stay recognised; as many as a process keeps ready to graft
_recognised: LastAsked[tuple[str, tuple[str, float]], TreeTemplate | Habit] = LastAsked(KEPT)


def file_stem(name: str) -> str:
    """Name of the file of a kind: "Picea abies" becomes picea-abies."""
    return file_name(name.lower()).replace(" ", "-")


def read_allometry(name: str, folder: Path) -> Allometry:
    """A preset, or a file of that name relative to ``folder``.

    Raises
    ------
    SpecError : there is no such allometry, or its file cannot be used.
    """
    path = _preset("allometry", name, folder)
    if not path.is_file():
        raise unknown("allometry", name, presets("allometry"), ", or a .toml file")
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
    sheet = read_columns(path, "species", "pft", *COLUMNS.values())
    table = {key: np.array(sheet.texts(key), np.str_) for key in ("species", "pft", "study")}
    table |= {key: sheet.numbers(column) for key, column in COLUMNS.items()}
    way = np.array(sheet.texts("leaf_area_is"), np.str_)
    table["dbh"] *= np.array([DIAMETER_UNITS.get(str(name), 1.0) for name in table["study"]])
    table["leaf_area"] = half_of_surface(
        table["leaf_area"], table["species"], table["pft"], table["study"], way
    )
    return table


def find_species(name: str, folder: Path) -> Path:
    """The file of a species: a preset's, or a path relative to the folder of the scene file.

    Raises
    ------
    SpecError : there is no such preset; names those that are there.
    """
    if not name:
        raise SpecError("species", "is empty; choose a preset or a .toml file")
    return _preset("species", name, folder)


def _preset(kind: str, name: str, folder: Path) -> Path:
    """The file of a preset of ``assets``, or the one of that name relative to ``folder``."""
    if name.endswith(".toml"):
        return folder / name
    if name not in (names := presets(kind)):
        raise unknown(kind, name, names, ", or a .toml file")
    return ASSETS / kind / f"{name}.toml"


def presets(kind: str) -> list[str]:
    """Every preset of a folder of ``assets``."""
    return sorted(path.stem for path in (ASSETS / kind).glob("*.toml"))


def check_known(names: Mapping[str, str], folder: Path) -> None:
    """Check that species are there, by what names each: presets by name, files by path from ``folder``.

    Raises
    ------
    SpecError : some are not; names all of them, each with the nearest preset.
    """
    known, wrong = presets("species"), []
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
        tall = float(np.ptp(wood[:, :, 2])) if len(wood) else 0.0
        metres = template.height / tall if template.height and tall else 1.0
        if leaves is None and template.grow_leaves and leaf.on:
            leaves = dress(wood, leaf, blade or leaf_blade(leaf, species.detail.tolerance), metres)
        if species.siblings is not None:
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
    content = digest([wood] if leaves is None else [wood, b"leaves", leaves])
    return _recognised.once((content, what), make)


class NotUnderstoodError(SpecError):
    """Facets that are no tree, with the (T, 3, 3) facets themselves, z up, and (N, 3) places in them."""

    def __init__(self, problem: TemplateError, facets: np.ndarray) -> None:
        super().__init__("template", str(problem))
        self.facets = facets
        self.places = problem.places


@dataclass(frozen=True)
class Brought:
    """The files of a tree, and how they are to be read.

    wood, leaves : STL files; wood alone may hold leaves too.
    height : metres of the tree; 0: as the unit says.
    unit : in which they are drawn, of ``UNITS``. up : axis that points up, of ``UPRIGHT``. Both are
        inferred where empty.
    groups : what the files hold, where they are no STL.
    """

    wood: Path
    leaves: Path | None = None
    height: float = 0.0
    unit: str = ""
    up: str = ""
    groups: Sequence[Group] = ()

    def check(self) -> None:
        """Refuse a height, a unit or an axis that cannot be used.

        Raises
        ------
        SpecError : which, and what can be.
        """
        if not 0 <= self.height <= 200:
            raise SpecError("height", f"{self.height:g} m is out of range; use 0 to 200")
        if self.unit and self.unit not in UNITS:
            raise unknown("unit", self.unit, UNITS)
        if self.up and self.up not in UPRIGHT:
            raise unknown("up", self.up, UPRIGHT)


@dataclass(frozen=True)
class Library:
    """Library of a user's tree: as read and recognised, in file units, and as made.

    wood, leaves : (T, 3, 3) facets as read, z up. leaf : median length of a leaf, None without leaves.
    unit : what one unit of the files is taken to be. habit : the tree taken apart, in metres.
    species : the file written.
    told : in words, how wood and leaves were told apart within one file, if they were.
    up : the files' axis that points up. verdict : on its siblings, where these were judged.
    """

    wood: np.ndarray
    leaves: np.ndarray | None
    found: Recognition
    leaf: float | None
    unit: Unit
    habit: Habit
    species: Path
    told: str = ""
    up: str = "z"
    verdict: Verdict | None = None

    @property
    def height(self) -> float:
        """Height of the tree, metres."""
        return float(np.ptp(self.wood[:, :, 2])) * self.unit.metres

    @property
    def branches(self) -> int:
        """Number of its first-level branches."""
        return int(np.count_nonzero(self.habit.anatomy.order == 1))

    @property
    def leaf_count(self) -> int:
        """Number of its leaves."""
        return len(self.habit.anatomy.foliage.bearer)


def make_library(
    brought: Brought,
    name: str,
    out: Path,
    progress: Progress | None = None,
    grammar: str = "fitted",
    siblings: int = 0,
    accept: bool = False,
) -> Library:
    """Make a template library from files of a tree.

    grammar : "fitted" for siblings of the tree, "tanveer-2020a" for that grammar with its branches.
    siblings : how many to grow and judge; 0: none. Those that are too unlike the tree get no scene.
    accept : write the scene all the same.

    Raises
    ------
    SpecError : a name, a height or a file cannot be used, with the reason.
    OSError : the folder cannot be written.
    """
    check_name(name)
    brought.check()
    tell = progress or (lambda _done, _total: None)
    tell(0, 5)
    parts, recognition, up = _stand(_read_tree(brought), brought.up)
    timber, foliage = parts.wood, parts.leaves
    tell(1, 5)
    leaf, leaves = None, recognition.leaves
    if leaves.count:
        mesh = TriMesh.of_part(leaves.vertices, leaves.triangles, LEAF, leaves.piece)
        leaf = float(np.median(measure_leaves(mesh).length))
    tall = float(np.ptp(timber[:, :, 2]))
    scale = infer_unit(tall, None if recognition.fronds else leaf)  # a frond's tells no unit
    if brought.height:
        scale = Unit(brought.height / tall, "units of the height given")
    elif brought.unit:
        scale = Unit(UNITS[brought.unit], brought.unit)
    metres = scale.metres
    metric = (timber * metres, None if foliage is None else foliage * metres)
    settings, verdict = Siblings(allometry=allometry_of(name)), None
    try:
        habit = fit(dissect(recognition, metres))
        tell(2, 5)
        if grammar == "tanveer-2020a":
            fitted = fit_grammar(split_tree(*metric))
            how = "\n[grammar]\n" + "".join(f"{k} = {getattr(fitted, k)}\n" for k in FITTED)
        else:
            verdict = judge(habit, settings, siblings) if siblings else None
            variety = verdict.variety if verdict else 1.0
            how = SIBLINGS.format(variety=variety, allometry=settings.allometry)
    except TemplateError as problem:
        raise NotUnderstoodError(problem, timber) from None
    tell(4, 5)  # from here on it is not stopped

    names = ("wood.stl", "leaves.stl", f"{name}.toml", "scene.toml")
    claim(*(out / file for file in names))
    out.mkdir(parents=True, exist_ok=True)
    write_stl(out / "wood.stl", metric[0], f"{name}: wood, metres")
    if metric[1] is not None:
        write_stl(out / "leaves.stl", metric[1], f"{name}: leaves, metres")
    species = out / f"{name}.toml"
    origin = " and ".join(path.name for path in (brought.wood, brought.leaves) if path)
    _write(species, _species_text(name, origin, foliage is not None) + how)
    if verdict is None or verdict.stands or accept:
        _write(out / "scene.toml", _scene_text(name, tall * metres))
    else:
        remove(out / "scene.toml")
    tell(5, 5)
    return Library(
        timber, foliage, recognition, leaf, scale, habit, species, parts.said, up, verdict
    )


def check_name(name: str) -> None:
    """Refuse a name that would not do as one of a file.

    Raises
    ------
    SpecError : it has other characters than letters, digits, - and _.
    """
    if not re.fullmatch(r"[\w-]+", name):
        raise SpecError("name", f'"{name}" must be letters, digits, - and _ only')


def _read_tree(brought: Brought) -> Sorted:
    try:
        if brought.groups:
            count = sum(len(group.facets) for group in brought.groups)
            if count > 2 * MOST_OF_TREE:
                raise SpecError(
                    "template",
                    f"has {count:,} facets, more than {2 * MOST_OF_TREE:,}; make it coarser",
                )
            return sort_out(brought.groups)
        timber = read_stl(brought.wood, MOST_OF_TREE)
        if brought.leaves is None:
            return sort_out([Group("", "", timber)])
        return Sorted(timber, read_stl(brought.leaves, MOST_OF_TREE), "")
    except FileNotFoundError as problem:
        raise SpecError(
            "template", f"there is no file {problem.filename}; check the path"
        ) from None
    except StlError as problem:
        raise SpecError("template", str(problem)) from None


def _stand(parts: Sorted, up: str) -> tuple[Sorted, Recognition, str]:
    """Wood and leaves z up, what is recognised in them, and which axis was up."""
    likely = up or (likely_up(parts.wood) if len(parts.wood) else "z")
    first: LeanError | None = None
    lying = parts.wood
    for axis in (likely, *(() if up else (other for other in UPRIGHT if other != likely))):
        turned = stood(parts, axis)
        try:
            return turned, recognise(turned.wood, turned.leaves), axis
        except LeanError as problem:
            first = first or problem
            lying = turned.wood if first is problem else lying
        except TemplateError as problem:
            raise NotUnderstoodError(problem, turned.wood) from None
    assert first is not None
    raise NotUnderstoodError(first, lying) from None


def _species_text(name: str, origin: str, leafy: bool) -> str:
    return f"""\
{VERSION_KEY} = "{version()}"
name = "{name}"
source = "Template from {origin.replace('"', "'").replace(chr(92), "/")}."

[template]
wood = "wood.stl"
leaves = "{"leaves.stl" if leafy else ""}"
"""


def _scene_text(name: str, height: float) -> str:
    side = round(max(4.0, 2.5 * height), 1)
    return f"""\
{VERSION_KEY} = "{version()}"
name = "{name} forest"
seed = 1

[forest]
size = [{side}, {side}]
spacing = {round(0.3 * height, 2)}

[[plantings]]
species = "{name}.toml"
variants = 3
expected = 12
"""


def _write(path: Path, text: str) -> None:
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")
