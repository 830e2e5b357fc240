"""``python -m studies``: benchmarks, validation, papers and experiments; they come with the repository alone.

Exit codes: 0 done; 1 something failed while running; 2 bad input, one sentence says what, where and what to
do; 130 interrupted, finished files are kept.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from forest_addon.api import SpecError

from .bench.run import ON_REQUEST, SECTIONS, run as run_bench
from .inside import Keeper, keeping, refuse_beyond

DATA = "FOREST_MEASURED"  # the environment's name for the folder of measurements


def main(words: Sequence[str] | None = None) -> int:
    """Run a study; returns the exit code."""
    given = sys.argv[1:] if words is None else words
    joined = "\0".join(given).replace("--origin\0", "--origin=")  # of which a value may be -1,2,3
    chosen = _parser().parse_args(joined.split("\0") if given else [])
    try:
        refuse_beyond("--seed", getattr(chosen, "seed", 0), 0)
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


def _bench(chosen: argparse.Namespace) -> None:
    run_bench(chosen.sections, Path("out") / "bench", chosen.docs)


def _validate(chosen: argparse.Namespace) -> None:
    if chosen.other:
        from .validation.cloud_pair import hold_pair

        hold_pair(chosen.subject, (chosen.file, chosen.other), chosen.origin, chosen)
        return
    if chosen.origin:
        raise SpecError("--origin", "belongs to two clouds: validate lidar A.laz B.laz")
    from .validation.run import run_sections

    run_sections([chosen.subject] if chosen.subject else [], chosen, chosen.out)


def _study(chosen: argparse.Namespace) -> None:
    out = chosen.out or Path("out") / chosen.study
    plots = chosen.plots or (12 if chosen.study == "sim-to-real" else 6)
    for key, value in (("--plots", plots), ("--seeds", chosen.seeds)):
        refuse_beyond(key, value, 1, 1000)
    data = None if chosen.data is None else Path(chosen.data)
    from .validation.run import keep_subject, tell_subject, write_page

    began = time.process_time()
    if chosen.study == "sim-to-real":
        from .sim_to_real.run import run_study, subject_of

        found = run_study(data, chosen.real, out, plots, chosen.seeds, chosen.seed)
        part = subject_of(*found, out)
    elif chosen.study == "ablations":
        from .sim_to_real.ablations import ablation_subject, run_ablations

        if data is None:
            raise SpecError("--data", "is needed: the measurements, with wood/ in it")
        scores = run_ablations(data, out, plots, chosen.seeds, chosen.seed)
        part = ablation_subject(scores, out)
    else:
        from .sim_to_real.tasks import run_tasks, task_subject

        part = task_subject(run_tasks(chosen.tool, data, out, plots, chosen.seed), out)
    keep_subject(part, out / part.name)
    tell_subject(part, time.process_time() - began, print)
    if chosen.docs:
        print(f"\nWrote {write_page(out, chosen.docs)}.")


def _simlidar(chosen: argparse.Namespace) -> None:
    from .papers.simlidar import run_experiment

    run_experiment(
        chosen.out, quick=chosen.quick, seed=chosen.seed, engine=chosen.engine, quiet=chosen.quiet
    )


def _reverb_figures(chosen: argparse.Namespace) -> None:
    from .papers.reverb_figures import draw_figures

    draw_figures(chosen.out, chosen.quick)


def _flight(chosen: argparse.Namespace) -> None:
    refuse_beyond("--size", chosen.size, 1e-6, 100)
    out = chosen.out or Path("out") / f"flight-{chosen.experiment}"
    import_module(f".flight.{chosen.experiment}", __package__).run(out, chosen.size, chosen.seed)


def _out(default: str) -> dict[str, Any]:
    return {"type": Path, "metavar": "DIR", "default": Path(default), "help": f"default {default}"}


SWITCH = {"action": "store_true"}
MEASUREMENTS = {
    "type": Path,
    "metavar": "FOLDER",
    "default": os.environ.get(DATA),
    "help": f"the measurements (default ${DATA}, else measured)",
}
SEED = {"type": int, "default": 1, "help": "of what is drawn (default 1)"}
COMMANDS: dict[str, tuple[Callable[[argparse.Namespace], None], str, str, dict[str, dict]]] = {
    "validate": (
        _validate,
        "hold the simulations to measurements: what agrees, what does not",
        "Print and draw simulation beside measurement, with intervals, and say what agrees. Subjects: "
        "reverb, sonar, lidar, instruments, stand, leaves, trees, wind; none: all. With a FILE of yours: "
        "reverb RECORDING.wav --stand TREES.csv, lidar CLOUD.laz --scene MY.toml, or two clouds: "
        "lidar A.laz B.laz.",
        {
            "subject": {"nargs": "?", "metavar": "SUBJECT", "help": "which; default all"},
            "file": {"nargs": "?", "type": Path, "help": "a recording or cloud of your own"},
            "other": {"nargs": "?", "type": Path, "help": "a cloud to hold it to"},
            "--origin": {
                "action": "append",
                "default": [],
                "metavar": "X,Y,Z",
                "help": "where the scanner of two clouds stood; twice: of each (default: as pulses say)",
            },
            "--data": MEASUREMENTS,
            "--out": _out("out/validate"),
            "--stand": {"type": Path, "help": "CSV of where the trees of your recording stand"},
            "--scene": {"type": Path, "help": "the scene file that your cloud is of"},
            "--seed": SEED,
            "--docs": {
                "type": Path,
                "metavar": "DIR",
                "help": "also join all parts in --out to DIR/validation.md, pictures below it",
            },
        },
    ),
    "bench": (
        _bench,
        "measure speed and error on this machine",
        f"Print time and error side by side. Sections: {', '.join(SECTIONS)}; "
        f"only when asked for: {', '.join(ON_REQUEST)}.",
        {
            "sections": {"nargs": "*", "metavar": "SECTION", "help": "which; default all"},
            "--docs": {"type": Path, "help": "write them into benchmarks.md of this folder too"},
        },
    ),
    "study": (
        _study,
        "train on our forests, test on real clouds",
        "sim-to-real: make plots, learn stems and wood from them, and tell them in real clouds, beside "
        "learning from real clouds and published rules. ablations: the same of plots made without one "
        "thing at a time (noise, sub-rays, dead branches, ...). tree-tasks: stem map, DBH and height by "
        "3DFin, which stands in an environment of its own. The first two need forest-sensing[study].",
        {
            "study": {"choices": ("sim-to-real", "ablations", "tree-tasks")},
            "--data": MEASUREMENTS,
            "--real": {
                "type": Path,
                "metavar": "FOLDER",
                "help": "LAS files of yours, with FOR-instance's fields: classification 4 is stem",
            },
            "--plots": {"type": int, "metavar": "N", "help": "default 12; of the others 6"},
            "--seeds": {"type": int, "default": 3, "metavar": "N", "help": "default 3"},
            "--seed": SEED,
            "--out": {"type": Path, "metavar": "DIR", "help": "of results, default out/STUDY"},
            "--tool": {
                "default": "3DFin",
                "metavar": "PROGRAM",
                "help": "of tree-tasks: 3DFin's program in its environment (default 3DFin)",
            },
            "--docs": {"type": Path, "help": "also write its part of DOCS/validation.md"},
        },
    ),
    "simlidar": (
        _simlidar,
        "SIMLIDAR's 42 orchards: its table and regressions beside ours",
        "Grow, build and scan the 42 orchards of Méndez et al. (SIMLIDAR); print their table and "
        "regressions beside ours. Finished orchards are kept, and not done again.",
        {
            "--quick": {**SWITCH, "help": "only 4 and 5 iterations, every tenth scan"},
            "--out": _out("out/simlidar"),
            "--seed": SEED,
            "--engine": {"default": "auto", "choices": ("auto", "bvhtree", "embree")},
            "--quiet": {**SWITCH, "help": "no progress, only the report"},
        },
    ),
    "reverb-figures": (
        _reverb_figures,
        "the figures of the forest reverb paper, from our own responses",
        "Draw figures 2 to 5 of Kaneko & Gamper (2021) and say whether their findings hold.",
        {
            "--out": _out("out/reverb-figures"),
            "--quick": {**SWITCH, "help": "a tenth of the trees, fewer places"},
        },
    ),
    "flight": (
        _flight,
        "experiments: critical speed, gaps in hedges, bat against LiDAR; train a policy",
        "speed: flights of 500 m through Poisson forests beside the critical speed of Karaman & Frazzoli. "
        "gaps: a gap in a hedge or a pole in leaves from one echo, by noise, beside Wang & Müller. plants: "
        "which of two plants, beside Kuc. senses: two ears against LiDAR. learn: train a small policy by the "
        "cross-entropy method. noise: train one by ear in noise, and fly it in more.",
        {
            "experiment": {"choices": ("speed", "gaps", "plants", "senses", "learn", "noise")},
            "--size": {"type": float, "default": 1.0, "help": "of the samples (1: minutes)"},
            "--seed": SEED,
            "--out": {"type": Path, "metavar": "DIR", "help": "default out/flight-EXPERIMENT"},
        },
    ),
}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m studies", description="Studies of the product."
    )
    parser.add_argument(
        "--force", action="store_true", help="replace files that Forest Sensing did not write"
    )
    commands = parser.add_subparsers(required=True, metavar="STUDY")
    for name, (run, words, description, options) in COMMANDS.items():
        command = commands.add_parser(name, help=words, description=description)
        command.set_defaults(run=run)
        for option, given in options.items():
            command.add_argument(option, **given)
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
