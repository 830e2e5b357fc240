"""A user's tree in files becomes a species that grows: the folder of its library.

Written: the tree in metres (wood.stl, leaves.stl), a species file by which siblings of it grow (or trees
of Tanveer et al.'s grammar, fitted to its habit), and a scene that plants it (scene.toml).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...base.places import version
from ...base.progress import Progress
from ...base.trimesh import LEAF, TriMesh
from ...formats.atomic import replacing
from ...formats.ownership import claim, remove
from ...formats.stl import StlError, read_stl, write_stl
from ...formats.toml_file import VERSION_KEY
from ...spec import Grammar, Siblings, SpecError, unknown
from ..likeness import Verdict, judge
from ..mesh.leaves import measure_leaves
from ..own_tree.anatomy import dissect
from ..own_tree.habit import Habit, allometry_of, fit
from ..own_tree.pieces import (
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
from ..own_tree.recognise import LeanError, Recognition, TemplateError, recognise
from ..own_tree.template import fit_grammar, split_tree
from .species_file import MOST_OF_TREE


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
    tell = progress or _say_nothing
    tell(0, 5)
    parts, found, up = _stand(_read(brought), brought.up)
    timber, foliage = parts.wood, parts.leaves
    tell(1, 5)
    leaf = _leaf_length(found)
    tall = float(np.ptp(timber[:, :, 2]))
    scale = _scale(brought, tall, None if found.fronds else leaf)  # a frond's tells no unit
    metres = scale.metres
    metric = (timber * metres, None if foliage is None else foliage * metres)
    settings, verdict = Siblings(allometry=allometry_of(name)), None
    try:
        habit = fit(dissect(found, metres))
        tell(2, 5)
        if grammar == "tanveer-2020a":
            how = _grammar_text(fit_grammar(split_tree(*metric)))
        else:
            verdict = judge(habit, settings, siblings) if siblings else None
            how = _siblings_text(settings, verdict.variety if verdict else 1.0)
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
    return Library(timber, foliage, found, leaf, scale, habit, species, parts.said, up, verdict)


def _scale(brought: Brought, tall: float, leaf: float | None) -> Unit:
    """The unit of files in which the tree is so high and a leaf so long."""
    if brought.height:
        return Unit(brought.height / tall, "units of the height given")
    return Unit(UNITS[brought.unit], brought.unit) if brought.unit else infer_unit(tall, leaf)


def check_name(name: str) -> None:
    """Refuse a name that would not do as one of a file.

    Raises
    ------
    SpecError : it has other characters than letters, digits, - and _.
    """
    if not re.fullmatch(r"[\w-]+", name):
        raise SpecError("name", f'"{name}" must be letters, digits, - and _ only')


def _read(brought: Brought) -> Sorted:
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


def _leaf_length(found: Recognition) -> float | None:
    """Median length of the leaves in file units, None without leaves."""
    pieces = found.leaves
    if not pieces.count:
        return None
    mesh = TriMesh.of_part(pieces.vertices, pieces.triangles, LEAF)
    mesh.leaf[:] = pieces.piece
    return float(np.median(measure_leaves(mesh).length))


def _species_text(name: str, origin: str, leafy: bool) -> str:
    return f"""\
{VERSION_KEY} = "{version()}"
name = "{name}"
source = "Template from {origin.replace('"', "'").replace(chr(92), "/")}."

[template]
wood = "wood.stl"
leaves = "{"leaves.stl" if leafy else ""}"
"""


def _siblings_text(settings: Siblings, variety: float) -> str:
    return f"""
# Siblings of this tree; 0 is the tree itself. Without this table, Tanveer et al.'s grammar sets its branches.
[siblings]
variety = {variety}
allometry = "{settings.allometry}"
"""


def _grammar_text(grammar: Grammar) -> str:
    return f"""
[grammar]
generations = {grammar.generations}
copies = {grammar.copies}
length = {grammar.length}
side_ratio = {grammar.side_ratio}
centre_ratio = {grammar.centre_ratio}
angle_deg = {grammar.angle_deg}
twist_deg = {grammar.twist_deg}
radius = {grammar.radius}
radius_ratio = {grammar.radius_ratio}
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


def _say_nothing(_done: int, _total: int) -> None:
    """In place of a progress bar."""
