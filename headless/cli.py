"""The command line: what is asked for, and how it ends.

Exit codes: 0 done; 1 something failed while running (a full disk); 2 bad input, one sentence says what,
where and what to do; 130 interrupted, finished files are kept.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from forest_addon.formats.species_file import ASSETS
from forest_addon.formats.toml_file import read_settings
from forest_addon.spec import Scene, SpecError

from .bench import SECTIONS
from .bench import run as run_sections
from .commands.lidar import add_lidar, target_of, with_values_joined
from .papers.simlidar import add_simlidar

DEMO = ASSETS / "scenes" / "demo.toml"

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
  python -m headless convolve out/demo/reverb.wav assets/sounds/call.wav
  blender -b --python headless/in_blender.py -- my.toml --out out/my

A scene file is TOML; assets/scenes/demo.toml is one with every table explained.
Start with out/.../report.html: pictures, counts, timings."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit code."""
    words = sys.argv[1:] if arguments is None else arguments
    chosen = _parser().parse_args(with_values_joined(words))
    if chosen.command in ("run", "demo") and chosen.out is None:
        chosen.out = Path("out") / chosen.scene.stem
    if chosen.command == "template" and chosen.out is None:
        chosen.out = Path("out") / chosen.name
    if chosen.command == "stand" and chosen.out is None:
        chosen.out = Path("out") / chosen.scene.stem / "points.csv"
    if chosen.command == "estimate" and chosen.out is None:
        chosen.out = Path("out") / chosen.map.stem / "site.toml"
    from .interrupt import interruptible

    kept = f"finished files are kept in {chosen.out}" if "out" in chosen else "nothing was written"
    if chosen.command == "lidar":
        chosen.out = target_of(chosen)
        kept = f"what was scanned is kept beside {chosen.out}; --resume goes on with it"
    with interruptible(kept):
        try:
            return int(chosen.do(chosen))
        except SpecError as problem:
            return _fail(problem, 2)
        except OSError as problem:
            sys.unraisablehook = _say_nothing  # files that fail again when they are dropped
            return _fail(_in_words(problem), 1)
        except ValueError as problem:
            return _fail(problem, 2)
        except KeyboardInterrupt:
            sys.unraisablehook = _say_nothing
            print(f"\ninterrupted; {kept}", file=sys.stderr)
            return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m headless",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    run = commands.add_parser("run", help="run a scene file", description="Run a scene file.")
    run.add_argument("scene", type=Path, metavar="SCENE.toml", help="the scene file")
    run.set_defaults(do=_run)
    demo = commands.add_parser(
        "demo",
        help="run the demo forest",
        description=f"Run the demo forest, assets/scenes/{DEMO.name}.",
    )
    demo.set_defaults(do=_run, scene=DEMO, convolve=ASSETS / "sounds" / "call.wav")
    bench = commands.add_parser(
        "bench",
        help="measure speed and error on this machine",
        description=f"Print time and error side by side. Sections: {', '.join(SECTIONS)}.",
    )
    bench.add_argument("sections", nargs="*", metavar="SECTION", help="which; default all")
    bench.set_defaults(do=_bench)
    _add_derive(commands)
    _add_template(commands)
    _add_species(commands)
    _add_stand(commands)
    _add_estimate(commands)
    add_lidar(commands)
    add_simlidar(commands)
    _add_convolve(commands)
    _add_figures(commands)
    for command, folder in ((run, "out/SCENE"), (demo, "out/demo")):
        command.add_argument(
            "--out", type=Path, metavar="DIR", help=f"folder for the results (default {folder})"
        )
        command.add_argument("--seed", type=int, help="another seed than the scene file's")
        command.add_argument(
            "--convolve",
            type=Path,
            metavar="DRY.wav",
            help="also write what each reverb makes of this dry sound: NAME-DRY.wav",
        )
        command.add_argument("--quiet", action="store_true", help="say nothing but errors")
    return parser


def _add_derive(commands: argparse._SubParsersAction) -> None:
    derive = commands.add_parser(
        "derive",
        help="print the string of a species' L-system",
        description="Print the string that the L-system of a species makes.",
    )
    derive.add_argument("species", metavar="PRESET", help="a species of assets/species, or a .toml")
    derive.add_argument(
        "--generations",
        type=int,
        metavar="N",
        help="how often it is rewritten (default: as in the file)",
    )
    derive.add_argument("--seed", type=int, default=0, help="seed of the chances (default 0)")
    derive.add_argument(
        "--count", action="store_true", help="print the numbers of symbols and branches"
    )
    derive.set_defaults(do=_derive)


def _add_convolve(commands: argparse._SubParsersAction) -> None:
    convolve = commands.add_parser(
        "convolve",
        help="hear a dry sound in the forest",
        description="Convolve a dry sound with an impulse response that a reverb wrote. The wet sound has "
        "the response's rate and channels, as 32-bit float.",
    )
    convolve.add_argument("response", type=Path, metavar="IR.wav", help="the impulse response")
    convolve.add_argument("dry", type=Path, metavar="DRY.wav", help="the dry sound, at any rate")
    convolve.add_argument(
        "--out", type=Path, metavar="WET.wav", help="the wet sound (default IR-DRY.wav beside IR)"
    )
    convolve.add_argument(
        "--normalise",
        type=float,
        metavar="DB",
        help="bring the largest sample to so many dB re full scale; left out: levels stay",
    )
    convolve.set_defaults(do=_convolve)


def _convolve(chosen: argparse.Namespace) -> int:
    from .commands.convolve import convolve

    default = chosen.response.with_name(f"{chosen.response.stem}-{chosen.dry.stem}.wav")
    convolve(chosen.response, chosen.dry, chosen.out or default, chosen.normalise)
    return 0


def _add_figures(commands: argparse._SubParsersAction) -> None:
    figures = commands.add_parser(
        "reverb-figures",
        help="the figures of the forest reverb paper, from our own responses",
        description="Draw figures 2 to 5 of Kaneko & Gamper (2021) and say whether their findings hold.",
    )
    figures.add_argument(
        "--out", type=Path, default=Path("out") / "reverb-figures", metavar="DIR", help="folder"
    )
    figures.add_argument("--quick", action="store_true", help="a tenth of the trees, fewer places")
    figures.set_defaults(do=_figures)


def _figures(chosen: argparse.Namespace) -> int:
    from .papers.reverb_figures import draw_figures

    draw_figures(chosen.out, chosen.quick)
    return 0


def _derive(chosen: argparse.Namespace) -> int:
    from .commands.derive import derive_species

    derive_species(chosen.species, chosen.generations, chosen.seed, chosen.count)
    return 0


def _add_template(commands: argparse._SubParsersAction) -> None:
    template = commands.add_parser(
        "template",
        help="make a species from your own tree (STL)",
        description="Recognise trunk, branches and leaves in STL files of a tree, and write a species "
        "by which siblings of it grow, pictures of what was recognised and of some siblings, and a "
        "scene that plants them. A table says how close the siblings come to the tree.",
    )
    template.add_argument("wood", type=Path, metavar="WOOD.stl", help="trunk and branches, z up")
    template.add_argument(
        "leaves", type=Path, nargs="?", metavar="LEAVES.stl", help="leaves; left out: leafless"
    )
    template.add_argument("--name", required=True, help="name of the species")
    template.add_argument(
        "--height",
        type=float,
        default=0.0,
        metavar="M",
        help="height of the tree in metres; left out: inferred, and said",
    )
    template.add_argument(
        "--grammar",
        choices=("fitted", "t20"),
        default="fitted",
        help="siblings of the tree, or its branches on T20's grammar (default fitted)",
    )
    template.add_argument(
        "--siblings",
        type=int,
        default=50,
        metavar="N",
        help="how many to grow and compare with the tree (default 50; 0: none)",
    )
    template.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for the library (default out/NAME)"
    )
    template.set_defaults(do=_template)


def _add_species(commands: argparse._SubParsersAction) -> None:
    species = commands.add_parser(
        "species",
        help="grow one tree of each preset: a table, and a contact sheet",
        description="Grow one tree of each species and print its size, leaves and wood.",
    )
    species.add_argument("names", nargs="*", metavar="NAME", help="which; default every preset")
    species.add_argument("--sheet", type=Path, metavar="PNG", help="also render a contact sheet")
    species.add_argument(
        "--pictures",
        type=Path,
        metavar="DIR",
        help="also render a small picture of each into a folder",
    )
    species.add_argument("--seed", type=int, default=1, help="seed of the trees (default 1)")
    species.set_defaults(do=_species)


def _species(chosen: argparse.Namespace) -> int:
    from .commands.species import show_species

    if chosen.seed < 0:
        raise SpecError("--seed", f"{chosen.seed} is out of range; use at least 0")
    show_species(chosen.names, chosen.sheet, chosen.seed, pictures=chosen.pictures)
    return 0


def _add_stand(commands: argparse._SubParsersAction) -> None:
    stand = commands.add_parser(
        "stand",
        help="sample where the trees of a scene stand: a table, and a map",
        description="Sample the positions of a scene's trees, without growing them; write them as CSV or "
        "GeoJSON, and a map beside that.",
    )
    stand.add_argument("scene", type=Path, metavar="SCENE.toml", help="the scene file")
    stand.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help=".csv or .geojson (default out/SCENE/points.csv)",
    )
    stand.add_argument("--seed", type=int, help="another seed than the scene file's")
    stand.set_defaults(do=_stand)


def _stand(chosen: argparse.Namespace) -> int:
    from .commands.stand import sample_stand

    sample_stand(chosen.scene, chosen.out, chosen.seed)
    return 0


def _add_estimate(commands: argparse._SubParsersAction) -> None:
    estimate = commands.add_parser(
        "estimate",
        help="make a scene like a site from a map of its trees (CSV)",
        description="Estimate where trees stand on a site from a CSV of x, y (metres) and perhaps species, "
        "and write a scene that plants forests like it, and a picture.",
    )
    estimate.add_argument("map", type=Path, metavar="TREES.csv", help="columns x, y, species")
    estimate.add_argument(
        "--out", type=Path, metavar="SITE.toml", help="the scene (default out/TREES/site.toml)"
    )
    estimate.add_argument(
        "--method",
        choices=("mixture", "kernel"),
        default="mixture",
        help="Gaussian hills of maximum likelihood, or a kernel estimate (default mixture)",
    )
    estimate.add_argument(
        "--window",
        nargs="+",
        default=(),
        metavar="W",
        help="where trees were mapped: X0 Y0 X1 Y1, or a CSV of corners x, y, ring "
        "(default: around the trees)",
    )
    estimate.add_argument(
        "--species",
        action="append",
        default=[],
        metavar="NAME=PRESET",
        help="what to plant for a name of the map, or PRESET alone for all; may be repeated",
    )
    estimate.set_defaults(do=_estimate)


def _estimate(chosen: argparse.Namespace) -> int:
    from .commands.estimate import estimate_site

    estimate_site(chosen.map, chosen.out, chosen.method, chosen.window, chosen.species)
    return 0


def _template(chosen: argparse.Namespace) -> int:
    from .commands.template import make_template

    make_template(
        chosen.wood,
        chosen.leaves,
        chosen.name,
        chosen.height,
        chosen.out,
        chosen.grammar,
        chosen.siblings,
    )
    return 0


def _run(chosen: argparse.Namespace) -> int:
    settings = read_settings(chosen.scene, Scene)
    if chosen.seed is not None:
        try:
            settings = replace(settings, seed=chosen.seed)
        except SpecError as problem:
            raise SpecError("--seed", problem.problem) from None
    from .progress import hushed

    with hushed():  # Blender says where its colours come from
        from .pipeline import run_scene

    run_scene(
        settings, chosen.scene.resolve().parent, chosen.out, quiet=chosen.quiet, dry=chosen.convolve
    )
    return 0


def _bench(chosen: argparse.Namespace) -> int:
    unknown = [name for name in chosen.sections if name not in SECTIONS]
    if unknown:
        raise SpecError("bench", f'"{unknown[0]}" is not known; use {", ".join(SECTIONS)}')
    run_sections(chosen.sections, Path("out") / "bench")
    return 0


def _fail(problem: object, code: int) -> int:
    print(f"error: {problem}", file=sys.stderr)
    return code


def _say_nothing(_: object) -> None:
    """In place of a message that only repeats what was said."""


def _in_words(problem: OSError) -> str:
    """One sentence for what the system refused."""
    import errno

    if problem.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        what = f" while writing {Path(problem.filename).name}" if problem.filename else ""
        return f"the disk is full{what}; free some space and run again, finished files are kept"
    if problem.strerror and problem.filename:
        return f"{problem.filename}: {problem.strerror}"
    return str(problem)
