"""The command line: what is asked for, and how it ends.

The parser is a loop over ``commands.COMMANDS``; nothing here knows one of them by name.
Exit codes: 0 done; 1 something failed while running (a full disk); 2 bad input, one sentence says what,
where and what to do; 3 an audit found an error beyond what was allowed, or --strict and a warning, results
are kept; 4 some of many scenes could not be made; 5 siblings of a tree are too unlike it to be planted; 130
interrupted, finished files are kept; 141 nobody reads the output any more.
"""

from __future__ import annotations

import argparse
import errno
import os
import re
import sys
from collections.abc import Sequence
from contextlib import nullcontext, redirect_stdout
from pathlib import Path

from forest_addon.base.places import NO_BLENDER, version
from forest_addon.formats.ownership import Keeper, keeping
from forest_addon.spec import SpecError, unknown

from .command import (
    PROGRAM,
    Command,
    DoubtfulError,
    EndedError,
    UnlikeError,
    declare,
    fault_of,
    is_told,
    scene_file,
    sound_file,
    typed,
)
from .commands import COMMANDS
from .interrupt import interruptible
from .lock import only_one
from .progress import PlainStream, plain

DESCRIPTION = """\
Grow L-system forests from STL branch templates and run LiDAR, biosonar and
forest reverb in them, on Blender's evaluated scene."""

EPILOG = """\
examples:
  python -m headless demo                         the demo forest, into out/demo
  python -m headless run my.toml --out out/my     a scene of your own
  python -m headless template wood.stl leaves.stl --name elm   a species from your tree
  python -m headless run my.toml --seed 8 --out out/my-8
  python -m headless estimate trees.csv --out site.toml   a scene like a site you mapped
  python -m headless stand my.toml --out points.csv   where the trees stand, and a map
  python -m headless derive apple --generations 2   the string of an L-system
  python -m headless lidar my.blend --scanner riegl-vz-400i --at 0,0,1.6
  python -m headless convolve out/demo/clap.wav call
  python -m headless dataset tiny --out out/tiny   labelled scenes by the thousand
  blender -b --python headless/in_blender.py -- my.toml --out out/my

A scene file is TOML; assets/scenes/demo.toml is one with every table explained.
Start with out/.../report.html: pictures, counts, timings."""

# How each shell completes the name of a file, as shtab.FILE has it.
FILES = {
    "bash": "_shtab_compgen_files",
    "zsh": "_files",
    "fish": "(__fish_complete_path (commandline -ct))",
    "tcsh": "f",
    "powershell": "_shtab_powershell_compgen_files",
}
TODO = {
    errno.EEXIST: ", and it is no folder; choose another --out",
    errno.ENOTDIR: "; choose another --out",
    errno.EACCES: "; choose another --out, or change its permissions",
    errno.EROFS: "; choose another --out",
    errno.ENAMETOOLONG: "; choose a shorter --out",
}
STUDIES = ("validate", "bench", "study", "simlidar", "reverb-figures", "flight")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit code."""
    words = sys.argv[1:] if arguments is None else arguments
    if words and words[0] in STUDIES:
        return _fail(f"{words[0]} is a study of the repository: python -m studies {words[0]}", 2)
    try:
        _refuse_unknown(words)
        chosen, rest = _parser().parse_known_args(_values_joined(words))
        if rest and rest[0].startswith("--"):
            raise unknown("option", rest[0].split("=")[0], chosen.known)
        if rest:
            raise SpecError(rest[0], f"is a word too many; see {PROGRAM} {chosen.COMMAND} --help")
        command: Command = chosen.command
        if "out" in chosen:
            chosen.out = command.output(chosen)
    except ValueError as problem:
        return _fail(problem, 2)
    except ModuleNotFoundError as problem:
        return _fail(f"this needs {problem.name}: pip install {problem.name}", 2)
    kept = command.left(chosen)
    shown = sys.stdout or open(os.devnull, "w")  # noqa: SIM115 closed, as by >&-
    with interruptible(kept), redirect_stdout(PlainStream(shown)):  # names are shown by many
        try:
            lock = command.lock_file(chosen)
            with nullcontext() if lock is None else only_one(lock.parent, lock.name):
                _run(command, chosen)
        except ModuleNotFoundError as problem:
            return _fail(_missing(problem, command.name), 2)
        except MemoryError as problem:
            sys.unraisablehook = _say_nothing
            asked = re.search(r"allocate ([\d.]+ \w+)", str(problem))  # numpy's words
            said = f" for {asked[1]} more" if asked else ""
            return _fail(f"there is not enough memory{said}; take less at once, {kept}", 1)
        except BrokenPipeError:  # who read it has seen enough
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            return 141
        except OSError as problem:
            sys.unraisablehook = _say_nothing  # files that fail again when they are dropped
            return _fail(_in_words(problem), 1)
        except ValueError as problem:  # SpecError is one
            told = is_told(problem)
            return _fail(problem if told else fault_of(problem), 2 if told else 1)
        except EndedError as problem:
            return _fail(problem, problem.code)
        except KeyboardInterrupt:
            sys.unraisablehook = _say_nothing
            print(f"\ninterrupted; {kept}", file=sys.stderr)
            return 130
        except Exception as problem:
            return _fail(fault_of(problem), 1)
    return 0


def _run(command: Command, chosen: argparse.Namespace) -> None:
    """Run a command that writes over nothing but what it, or another here, wrote."""
    out = getattr(chosen, "out", None)
    keeper = Keeper(
        out if command.is_folder else None,
        command.maker or command.name,
        force=getattr(chosen, "force", False),
        say=lambda text: print(plain(text), file=sys.stderr),
    )
    for key, value in vars(chosen).items():
        for word in value if isinstance(value, list) else [value]:
            named = isinstance(word, Path) or (isinstance(word, str) and os.path.isfile(word))
            if named and key not in command.outputs:  # a folder may have the name of a species
                keeper.reads(word)
    doubt = None
    with keeping(keeper):
        if out is not None:
            keeper.refuse_read(out)
        try:
            command.run(chosen)
        except (DoubtfulError, UnlikeError) as problem:  # all is written
            doubt = problem
        if command.is_whole(chosen):
            for name in keeper.remove_others():
                print(f"Removed {plain(name)}, of an earlier run", file=sys.stderr)
    if doubt is not None:
        raise doubt


def _refuse_unknown(words: Sequence[str]) -> None:
    """Refuse a first word that is neither a command nor an option, with the nearest."""
    first = words[0].split("=")[0] if words else "-"
    names, options = [command.name for command in COMMANDS], ("--help", "--version", "--completion")
    if first.startswith("--") and not any(option.startswith(first) for option in options):
        raise unknown("option", first, options)
    if not first.startswith("-") and first not in names:
        raise unknown("command", first, names)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=PROGRAM,
        description=DESCRIPTION,
        epilog=typed(EPILOG),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show versions and exit")
    parser.add_argument(
        "--completion",
        action=_Completion,
        choices=("bash", "zsh", "fish", "tcsh", "powershell"),
        help="print what makes a shell complete the words of forest-sensing, and exit",
    )
    commands = parser.add_subparsers(required=True, dest="COMMAND", metavar="COMMAND")
    for command in COMMANDS:
        of_this = commands.add_parser(
            command.name,
            help=command.help,
            description=command.description,
            epilog=typed(command.epilog),
            formatter_class=argparse.RawDescriptionHelpFormatter
            if command.epilog
            else argparse.HelpFormatter,
        )
        of_this.register("type", Path, _path)
        declare(of_this, command.options)
        if command.outputs:
            of_this.add_argument(
                "--force",
                action="store_true",
                help="replace files there that Forest Sensing did not write, and say which",
            )
        options = [name for name in of_this._option_string_actions if name.startswith("--")]
        of_this.set_defaults(command=command, known=options, **command.fixed)
        for action in of_this._actions:
            if action.type in (Path, scene_file, sound_file):
                action.complete = FILES
    return parser


class _Version(argparse.Action):
    """Versions in one line; what they are asked of is loaded only then."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from forest_addon import kernels

        print(f"Forest Sensing {version()}, kernels: {kernels.engine()}")
        parser.exit()


class _Completion(argparse.Action):
    """A shell's script, on standard output."""

    def __call__(self, parser: argparse.ArgumentParser, _: object, shell: str, *__: object) -> None:
        import shtab

        parser.prog = "forest-sensing"  # what pip installs
        print(shtab.complete(parser, shell))
        parser.exit()


def _path(word: str) -> Path:
    """Path that a word names; an empty one is a variable that was not set, not this folder."""
    if not word.strip():
        raise argparse.ArgumentTypeError("is empty; name a file or folder, or . for this one")
    return Path(word)


def _values_joined(words: Sequence[str]) -> list[str]:
    """Words in which ``--at -1,2,3`` is one; argparse takes -1,2,3 for an option."""
    joined: list[str] = []
    for word in words:
        follows = joined and re.fullmatch(r"--[a-z][a-z-]*", joined[-1])
        if follows and re.match(r"-[\d.]", word) and not re.fullmatch(r"-\d+|-\d*\.\d+", word):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


def _fail(problem: object, code: int) -> int:
    print(f"error: {plain(' '.join(str(problem).splitlines()))}", file=sys.stderr)
    return code


def _missing(problem: ModuleNotFoundError, name: str) -> str:
    """Sentence on a package that is not installed, to a command of this name."""
    from .report import DRAWERS, without

    package = (problem.name or "").split(".")[0]
    if package in DRAWERS:
        return without(f"{name} cannot draw its pictures")
    if package == "bpy":
        return f"{name}: Blender as a module {NO_BLENDER}"
    return f"{name} needs {package}, which is not installed; {PROGRAM} doctor says how to get it"


def _say_nothing(_: object) -> None:
    """Say nothing, in place of a message that only repeats what was said."""


def _in_words(problem: OSError) -> str:
    """One sentence for what the system refused."""
    if (
        problem.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        or str(problem).endswith(" written")  # numpy's words
    ):
        what = f" while writing {Path(problem.filename).name}" if problem.filename else ""
        return f"the disk is full{what}; free some space and run again, finished files are kept"
    if problem.errno in (errno.EMFILE, errno.ENFILE):
        return "the system lets this process open no more files; raise its limit (ulimit -n 1024)"
    if problem.strerror and problem.filename:
        return f"{problem.filename}: {problem.strerror}{TODO.get(problem.errno or 0, '')}"
    return str(problem)
