"""Commands of ``python -m headless``: what each is, how it ends, and what several of them read.

Nothing heavy is imported here, so that ``--help`` and a mistyped word are answered at once.
"""

from __future__ import annotations

import argparse
import importlib
import math
import os
import shlex
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

from forest_addon.base.places import ASSETS, shipped
from forest_addon.spec import Scene, SpecError
from forest_addon.spec.base import nearest

OURS = {"forest_addon", "headless", "studies"}  # folders of code
LONGEST = 300  # characters of words that are not ours
ONE_OF = "one of"
LOCK = ".lock"  # in a folder that one command at a time writes to


# What a user types before a command's name: an installed wheel has a script of its own.
PROGRAM = (
    "forest-sensing" if (__package__ or "").startswith("forest_addon") else "python -m headless"
)


def typed(text: str | None) -> str | None:
    """Return a help text with what a user types here in place of ``python -m headless``."""
    return None if text is None else text.replace("python -m headless", PROGRAM)


class EndedError(Exception):
    """An end that is no mistake of who asked, with an exit code of its own."""

    code: ClassVar[int]


class DoubtfulError(EndedError):
    """Results that were kept, but are not as exact as was asked for."""

    code = 3


class IncompleteError(EndedError):
    """Most was made, some of it could not be."""

    code = 4


class UnlikeError(EndedError):
    """Siblings too unlike their tree to be planted; files are kept, no scene is written."""

    code = 5


def _steps_of_ours(problem: BaseException) -> list[traceback.FrameSummary | None]:
    """The steps to an error, None for those in code of others."""
    steps = traceback.extract_tb(problem.__traceback__)
    return [step if OURS & {*Path(step.filename).parts} else None for step in steps]


def is_told(problem: ValueError) -> bool:
    """Return whether an error is in words of ours; numpy's and Python's own mean a fault of the program."""
    return _steps_of_ours(problem)[-1:] != [None]


def fault_of(problem: BaseException) -> str:
    """Sentence on what went wrong in the program itself, and where."""
    ours = [step for step in _steps_of_ours(problem) if step]
    place = f" ({Path(ours[-1].filename).name}:{ours[-1].lineno})" if ours else ""
    what = " ".join(str(problem).split())[:LONGEST]
    return (
        f"a fault of this program that is worth a report: {type(problem).__name__}: {what}{place}"
    )


@dataclass(frozen=True)
class Command:
    """A command: its words and options, where its results go, and by ``run`` of which module it is done.

    options : arguments of argparse by name; below ONE_OF those of which one at most is given. fixed : values
    of options that it does not have. least : smallest numbers of options. outputs : options that name what is
    written. is_folder : so is --out. default : what --out is by itself, in the folder out by the name of the
    scene, or a function of what was chosen. whole : its folder holds one run's results and nothing else.
    lock : the file that keeps other commands from writing to the same place, where that is no whole folder.
    kept : what an interrupted command says of the files that it leaves. by : the module, by default
    commands.NAME. maker : its name in the record of a folder; what makes the same has the same.
    """

    name: str
    help: str  # a line in the list of commands
    description: str
    options: Mapping[str, dict[str, Any]] = field(default_factory=dict)
    epilog: str | None = None
    fixed: dict[str, object] = field(default_factory=dict)
    least: Mapping[str, int] = field(default_factory=dict)
    outputs: tuple[str, ...] = ("out",)
    is_folder: bool = True
    default: str | Callable[[argparse.Namespace], Path] = ""
    whole: bool = False
    lock: Callable[[argparse.Namespace], Path | None] | None = None
    kept: str | Callable[[argparse.Namespace], str] = "finished files are kept in {}"
    by: str = ""
    maker: str = ""

    def output(self, chosen: argparse.Namespace) -> Path:
        """Folder of results, of a command that has ``--out``: what was asked for, or the default."""
        if callable(self.default):
            return self.default(chosen)
        return chosen.out or Path("out") / self.default.format(name_of(chosen.scene))

    def lock_file(self, chosen: argparse.Namespace) -> Path | None:
        """The file that is locked while it runs; None: none is."""
        if self.lock is not None:
            return self.lock(chosen)
        share = getattr(chosen, "share", None)
        number = "" if share is None else "-{}-of-{}".format(*share)
        return chosen.out / f"{LOCK}{number}" if self.whole else None

    def is_whole(self, chosen: argparse.Namespace) -> bool:
        """Return whether its folder holds nothing but this run's results afterwards: earlier ones go.

        None that goes on, or makes a share, makes all files of its folder.
        """
        goes_on = getattr(chosen, "resume", False) or getattr(chosen, "share", None) is not None
        return self.whole and not goes_on

    def left(self, chosen: argparse.Namespace) -> str:
        """Sentence of an interrupted command on the files that it leaves."""
        if "out" not in chosen:
            return "nothing was written"
        return (self.kept(chosen) if callable(self.kept) else self.kept).format(chosen.out)

    def run(self, chosen: argparse.Namespace) -> None:
        """Do it.

        Raises
        ------
        SpecError, ValueError : what was asked for cannot be; exit code 2.
        OSError : something failed while running; exit code 1.
        DoubtfulError : results are kept, and not as exact as was asked for; exit code 3.
        IncompleteError : a part of what was asked for could not be made; exit code 4.
        UnlikeError : siblings of a tree are too unlike it; exit code 5.
        """
        for option, least in self.least.items():
            value = getattr(chosen, option)
            refuse_beyond(f"--{option}", least if value is None else value, least)
        name = f"{__package__}.{self.by or f'commands.{self.name}'}"
        importlib.import_module(name).run(chosen)


def declare(parser: argparse._ActionsContainer, options: Mapping[str, dict[str, Any]]) -> None:
    """Declare options to a parser."""
    for option, said in options.items():
        if option == ONE_OF:
            declare(parser.add_mutually_exclusive_group(), said)
        else:
            parser.add_argument(option, **said)


def scene_file(words: str) -> Path:
    """Return the scene file that a word of the command line means: a file, or one of ``assets/scenes``
    by its name alone, such as hedge-bat."""
    return shipped(words, "scenes", ".toml")


def sound_file(words: str) -> Path:
    """Return the WAV file that a word of the command line means, or one of ``assets/sounds`` by its name."""
    return shipped(words, "sounds", ".wav")


def name_of(scene: Path) -> str:
    """Name of a scene file's results: its own; of one that many have, with its
    folder's."""
    if scene.stem in ("scene", "site"):
        return f"{scene.resolve().parent.name}-{scene.stem}"
    return scene.stem


def read_scene(path: Path, seed: int | None, dry: str = "") -> Scene:
    """The settings of a scene file, with another seed if one is given.

    dry : name of the sound that every reverb is also heard with.

    Raises
    ------
    SpecError : the file, or ``--seed``, cannot be used; two of its results would have one name.
    """
    from forest_addon.formats.toml_file import read_settings, refuse_unknown_scene
    from forest_addon.results.kinds import files_of
    from forest_addon.sensing import kinds  # noqa: F401  whose words a scene file may name

    refuse_unknown_scene(path)
    settings = read_settings(path, Scene)
    try:
        files_of(settings, dry)
    except SpecError as problem:
        raise SpecError(str(path), str(problem)) from None
    if seed is None:
        return settings
    try:
        return replace(settings, seed=seed)
    except SpecError as problem:
        raise SpecError("--seed", problem.problem) from None


def species_of_map(names: Sequence[str], words: Sequence[str], folder: Path) -> dict[str, str]:
    """Species to plant for each name of a map of trees, "" where it says none.

    words : NAME=PRESET, or PRESET alone for all. folder : of the scene, which paths of files start from.

    Raises
    ------
    SpecError : a name that nothing is planted for.
    """
    presets = sorted(p.stem for p in (ASSETS / "species").glob("*.toml"))
    told = dict(word.split("=", 1) for word in words if "=" in word)
    for_all = next((word for word in words if "=" not in word), None)
    for name in told:
        if name not in names:
            known = ", ".join(f'"{n}"' for n in names if n) or "none at all"
            raise SpecError("--species", f'no tree of the map is "{name}"; it has {known}')
    kinds = {}
    for name in names:
        kind = told.get(name, for_all or name)
        if not name and name not in told and for_all is None:
            raise SpecError(
                "--species",
                "some trees have no species; say what grows there, for example --species maple",
            )
        if kind.endswith(".toml"):
            if not Path(kind).is_file():
                raise SpecError("--species", f"there is no file {kind}; check the path")
            kind = Path(os.path.relpath(kind, folder)).as_posix()
        kinds[name] = kind
    lost = {
        name: kind for name, kind in kinds.items() if kind not in presets and kind[-5:] != ".toml"
    }
    if lost:
        are, place = ("is no preset", "its") if len(lost) == 1 else ("are no presets", "their")
        asked = " ".join(
            shlex.join(["--species", f"{name or kind}={(nearest(kind, presets) or ['PRESET'])[0]}"])
            for name, kind in lost.items()
        )
        said = ", ".join(dict.fromkeys(f'"{kind}"' for kind in lost.values()))
        raise SpecError(
            "--species",
            f"{said} {are}; say what grows in {place} place, "
            f"as {asked}. Presets: {', '.join(presets)}, or a .toml file",
        )
    return kinds


def installed(name: str) -> str:
    """Return the version of a package, empty where it is not installed."""
    from importlib import metadata

    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ""


def out_file(out: Path, *endings: str) -> Path:
    """The file that ``--out`` names, if it has one of these endings, as ".csv".

    Raises
    ------
    SpecError : it has another; nothing of that name is written.
    """
    if out.suffix.lower() not in endings:
        raise SpecError(f"--out {out}", f"must end in {' or '.join(endings)}")
    return out


def numbers(option: str, text: str, *counts: int) -> tuple[float, ...]:
    """Read numbers with commas between them, as many as one of ``counts``; () as many as there are.

    Raises
    ------
    SpecError : it is something else.
    """
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = (math.nan,)
    if not all(map(math.isfinite, values)) or len(values) not in (counts or (len(values),)):
        many = " or ".join(map(str, counts)) + " " * bool(counts)
        shown = ",".join(("1.5", "0", "2")[: max(counts, default=3)])
        raise SpecError(option, f'"{text}" is not {many}numbers with commas, as in {shown}')
    return values


def finite(word: str) -> float:
    """Return the finite number that a word of the command line means."""
    value = float(word)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{word} is no finite number")
    return value


def refuse_beyond(option: str, value: float, low: float, high: float = math.inf) -> None:
    """Say that a number cannot be what it is.

    Raises
    ------
    SpecError : it is below ``low`` or above ``high``.
    """
    if not low <= value <= high:
        span = f"at least {low}" if math.isinf(high) else f"{low} to {high}"
        raise SpecError(option, f"{value} is out of range; use {span}")
