"""``python -m studies``: benchmarks, validation, papers and experiments; they come with the repository alone.

Exit codes: 0 done; 1 something failed while running; 2 bad input, one sentence says what, where and what to
do; 130 interrupted, finished files are kept.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from forest_addon.api import SpecError
from forest_addon.formats.ownership import Keeper, keeping
from studies.bench.run import ON_REQUEST, SECTIONS
from studies.bench.run import run as run_bench

DATA = "FOREST_MEASURED"  # the environment's name for the folder of measurements
EXPERIMENTS = ("speed", "hedge", "plants", "senses", "learn")
STUDIES = ("sim-to-real", "ablations", "tree-tasks")


def main(words: Sequence[str] | None = None) -> int:
    """Run a study; returns the exit code."""
    given = sys.argv[1:] if words is None else words
    joined = "\0".join(given).replace("--origin\0", "--origin=")  # of which a value may be -1,2,3
    chosen = _parser().parse_args(joined.split("\0") if given else [])
    try:
        if getattr(chosen, "seed", 0) < 0:
            raise SpecError("--seed", f"{chosen.seed} is out of range; use at least 0")
        keeper = Keeper(getattr(chosen, "out", None), "studies", force=chosen.force)
        with keeping(keeper):
            chosen.run(chosen)
    except ModuleNotFoundError as problem:
        if (problem.name or "").split(".")[0] in ("forest_addon", "studies"):
            raise
        return _fail(f'{problem.name} is missing; pip install "forest-sensing[study]" has it', 2)
    except ValueError as problem:  # SpecError is one
        return _fail(problem, 2)
    except OSError as problem:
        return _fail(problem, 1)
    except KeyboardInterrupt:
        return _fail("interrupted; finished files are kept", 130)
    return 0


def _fail(problem: object, code: int) -> int:
    print(f"error: {problem}", file=sys.stderr)
    return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m studies", description="Benchmarks, validation, papers."
    )
    parser.add_argument(
        "--force", action="store_true", help="replace files that Forest Sensing did not write"
    )
    commands = parser.add_subparsers(required=True, metavar="STUDY")
    _add_validate(commands)
    _add_bench(commands)
    _add_study(commands)
    _add_papers(commands)
    _add_flight(commands)
    return parser


def _add_bench(commands: argparse._SubParsersAction) -> None:
    command = commands.add_parser(
        "bench",
        help="measure speed and error on this machine",
        description=f"Print time and error side by side. Sections: {', '.join(SECTIONS)}; "
        f"only when asked for: {', '.join(ON_REQUEST)}.",
    )
    add = command.add_argument
    add("sections", nargs="*", metavar="SECTION", help="which; default all")
    add("--docs", type=Path, help="write them into benchmarks.md of this folder too")
    command.set_defaults(
        run=lambda chosen: run_bench(chosen.sections, Path("out") / "bench", chosen.docs)
    )


def _add_validate(commands: argparse._SubParsersAction) -> None:
    command = commands.add_parser(
        "validate",
        help="hold the simulations to measurements: what agrees, what does not",
        description="Print and draw simulation beside measurement, with intervals, and say what agrees. "
        "Subjects: reverb, lidar, stand, leaves, trees, wind; none: all. With a FILE of yours: reverb "
        "RECORDING.wav --stand TREES.csv, lidar CLOUD.laz --scene MY.toml, or two clouds: lidar A.laz "
        "B.laz.",
    )
    add = command.add_argument
    add("subject", nargs="?", metavar="SUBJECT", help="which; default all")
    add("file", nargs="?", type=Path, metavar="FILE", help="a recording or cloud of your own")
    add("other", nargs="?", type=Path, metavar="OTHER.laz", help="a cloud to hold it to")
    add(
        "--origin",
        action="append",
        default=[],
        metavar="X,Y,Z",
        help="where the scanner of two clouds stood; twice: of each (default: as pulses say)",
    )
    _add_data(command)
    add(
        "--out",
        type=Path,
        default=Path("out/validate"),
        metavar="DIR",
        help="folder of results, one a subject (default out/validate)",
    )
    add("--stand", type=Path, metavar="TREES.csv", help="where the trees of your recording stand")
    add("--scene", type=Path, metavar="MY.toml", help="the scene that your cloud is of")
    add("--seed", type=int, default=1, help="seed of what is drawn (default 1)")
    add(
        "--docs",
        type=Path,
        metavar="DIR",
        help="also join all parts in --out to DIR/validation.md, pictures below it",
    )
    command.set_defaults(run=_validate)


def _add_data(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--data",
        type=Path,
        metavar="FOLDER",
        default=os.environ.get(DATA),
        help=f"the measurements (default ${DATA}, else measured)",
    )


def _validate(chosen: argparse.Namespace) -> None:
    if chosen.other:
        from studies.validation.cloud_pair import hold_pair

        hold_pair(chosen.subject, (chosen.file, chosen.other), chosen.origin, chosen)
        return
    if chosen.origin:
        raise SpecError("--origin", "belongs to two clouds: validate lidar A.laz B.laz")
    from studies.validation.run import run_sections

    run_sections([chosen.subject] if chosen.subject else [], chosen, chosen.out)


def _add_study(commands: argparse._SubParsersAction) -> None:
    command = commands.add_parser(
        "study",
        help="train on our forests, test on real clouds",
        description="sim-to-real: make plots, learn stems and wood from them, and tell them in real "
        "clouds, beside learning from real clouds and published rules. ablations: the same of plots made "
        "without one thing at a time (noise, sub-rays, dead branches, ...). tree-tasks: stem map, DBH and "
        "height by 3DFin, which stands in an environment of its own. The first two need "
        "forest-sensing[study].",
    )
    add = command.add_argument
    add("study", choices=STUDIES)
    _add_data(command)
    add(
        "--real",
        type=Path,
        metavar="FOLDER",
        help="LAS files of yours, with FOR-instance's fields: classification 4 is stem",
    )
    add("--plots", type=int, metavar="N", help="default 12; of the other studies 6")
    add("--seeds", type=int, default=3, metavar="N", help="default 3")
    add("--seed", type=int, default=1, help="seed of the plots (default 1)")
    add("--out", type=Path, metavar="DIR", help="of results, default out/STUDY")
    add(
        "--tool",
        default="3DFin",
        metavar="PROGRAM",
        help="of tree-tasks: 3DFin's program in its environment (default 3DFin)",
    )
    add("--docs", type=Path, metavar="DIR", help="also write its part of DIR/validation.md")
    command.set_defaults(run=_study)


def _study(chosen: argparse.Namespace) -> None:
    out = chosen.out or Path("out") / chosen.study
    plots = chosen.plots or (12 if chosen.study == "sim-to-real" else 6)
    for key, value in (("--plots", plots), ("--seeds", chosen.seeds)):
        if not 1 <= value <= 1000:
            raise SpecError(key, f"{value} is out of range; use 1 to 1000")
    data = None if chosen.data is None else Path(chosen.data)
    from studies.validation.run import keep_subject, tell_subject, write_page

    began = time.process_time()
    if chosen.study == "sim-to-real":
        from studies.sim_to_real.run import Request, run_study, subject_of

        request = Request(plots, chosen.seeds, chosen.seed, data, chosen.real)
        part = subject_of(run_study(request, out), out)
    elif chosen.study == "ablations":
        from studies.sim_to_real.ablations import ablation_subject, run_ablations

        if data is None:
            raise SpecError("--data", "is needed: the measurements, with wood/ in it")
        found = run_ablations(data, out, plots, chosen.seeds, chosen.seed)
        part = ablation_subject(found, out)
    else:
        from studies.sim_to_real.tasks import run_tasks, task_subject

        part = task_subject(run_tasks(chosen.tool, data, out, plots, chosen.seed), out)
    keep_subject(part, out / part.name)
    tell_subject(part, time.process_time() - began, print)
    if chosen.docs:
        print(f"\nWrote {write_page(out, chosen.docs)}.")


def _add_papers(commands: argparse._SubParsersAction) -> None:
    command = commands.add_parser(
        "simlidar",
        help="SIMLIDAR's 42 orchards: its table and regressions beside ours",
        description="Grow, build and scan the 42 orchards of Méndez et al. (SIMLIDAR); print their table "
        "and regressions beside ours. Finished orchards are kept, and not done again.",
    )
    add = command.add_argument
    add("--quick", action="store_true", help="only 4 and 5 iterations, every tenth scan")
    add("--out", type=Path, default=Path("out/simlidar"), help="folder for tables and picture")
    add("--seed", type=int, default=1, help="seed of the trees (default 1)")
    add("--engine", default="auto", choices=("auto", "bvhtree", "embree"), help="who casts rays")
    add("--quiet", action="store_true", help="no progress, only the report")
    command.set_defaults(run=_simlidar)
    command = commands.add_parser(
        "reverb-figures",
        help="the figures of the forest reverb paper, from our own responses",
        description="Draw figures 2 to 5 of Kaneko & Gamper (2021) and say whether their findings hold.",
    )
    add = command.add_argument
    add("--out", type=Path, default=Path("out/reverb-figures"), metavar="DIR", help="folder")
    add("--quick", action="store_true", help="a tenth of the trees, fewer places")
    command.set_defaults(run=_reverb_figures)


def _simlidar(chosen: argparse.Namespace) -> None:
    from studies.papers.simlidar import run_experiment

    run_experiment(
        chosen.out, quick=chosen.quick, seed=chosen.seed, engine=chosen.engine, quiet=chosen.quiet
    )


def _reverb_figures(chosen: argparse.Namespace) -> None:
    from studies.papers.reverb_figures import draw_figures

    draw_figures(chosen.out, chosen.quick)


def _add_flight(commands: argparse._SubParsersAction) -> None:
    command = commands.add_parser(
        "flight",
        help="experiments: critical speed, gaps in hedges, bat against LiDAR; train a policy",
        description="speed: flights of 500 m through Poisson forests beside the critical speed of Karaman "
        "& Frazzoli. hedge: gap or no gap from one echo, beside Wang & Müller. plants: which of two "
        "plants, beside Kuc. senses: two ears against LiDAR. learn: train a small policy by the "
        "cross-entropy method.",
    )
    add = command.add_argument
    add("experiment", choices=EXPERIMENTS)
    add("--size", type=float, default=1.0, metavar="FACTOR", help="of the samples (1: minutes)")
    add("--seed", type=int, default=1, help="default 1")
    add("--out", type=Path, metavar="DIR", help="default out/flight-EXPERIMENT")
    command.set_defaults(run=_flight)


def _flight(chosen: argparse.Namespace) -> None:
    if not 0 < chosen.size <= 100:
        raise SpecError("--size", f"{chosen.size:g} is out of range; use 0 to 100")
    out = chosen.out or Path("out") / f"flight-{chosen.experiment}"
    import_module(f".flight.{chosen.experiment}", __package__).run(out, chosen.size, chosen.seed)


if __name__ == "__main__":
    raise SystemExit(main())
