"""``python -m headless study``: what a network gains that learns from our forests."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING

from forest_addon.spec import SpecError

from ...command import LOCK, Command, refuse_negative

if TYPE_CHECKING:
    from ..validation.page import Subject


class StudyCommand(Command):
    name = "study"
    help = "train on our forests, test on real clouds"
    outputs = ("out", "docs")
    description = (
        "sim-to-real: make plots, learn stems and wood from them, and tell them in real clouds, beside "
        "learning from real clouds and published rules. ablations: the same of plots made without one "
        "thing at a time (noise, sub-rays, dead branches, ...). tree-tasks: stem map, DBH and height by "
        "3DFin, which stands in an environment of its own. The first two need forest-sensing[study]."
    )

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("study", choices=tuple(WORK))
        parser.add_argument(
            "--data",
            type=Path,
            metavar="FOLDER",
            help="the measurements, with wood/ in it (default $FOREST_MEASURED)",
        )
        parser.add_argument(
            "--real",
            type=Path,
            metavar="FOLDER",
            help="LAS files of yours, with FOR-instance's fields: classification 4 is stem",
        )
        parser.add_argument(
            "--plots", type=int, metavar="N", help="default 12; of the other studies 6"
        )
        parser.add_argument("--seeds", type=int, default=3, metavar="N", help="default 3")
        parser.add_argument("--seed", type=int, default=1, help="seed of the plots (default 1)")
        parser.add_argument("--out", type=Path, metavar="DIR", help="of results, default out/STUDY")
        parser.add_argument(
            "--tool",
            default="3DFin",
            metavar="PROGRAM",
            help="of tree-tasks: 3DFin's program in its environment (default 3DFin)",
        )
        parser.add_argument(
            "--docs", type=Path, metavar="DIR", help="also write its part of DIR/validation.md"
        )

    def output(self, chosen: argparse.Namespace) -> Path:
        return Path(chosen.out or f"out/{chosen.study}")

    def lock(self, chosen: argparse.Namespace) -> Path:
        return Path(chosen.out) / LOCK

    def run(self, chosen: argparse.Namespace) -> None:
        import os

        refuse_negative(chosen.seed)
        if chosen.plots is None:
            chosen.plots = 12 if chosen.study == "sim-to-real" else 6
        for key in ("plots", "seeds"):
            if not 1 <= getattr(chosen, key) <= 1000:
                raise SpecError(
                    f"--{key}", f"{getattr(chosen, key)} is out of range; use 1 to 1000"
                )
        from ..validation.run import VARIABLE, keep_subject, tell_subject, write_page

        said = chosen.data or (Path(os.environ[VARIABLE]) if VARIABLE in os.environ else None)
        part, seconds = WORK[chosen.study](chosen, said)
        keep_subject(part, chosen.out / part.name)
        tell_subject(part, seconds, print)
        if chosen.docs:
            print(f"\nWrote {write_page(chosen.out, chosen.docs)}.")


def _study(chosen: argparse.Namespace, data: Path | None) -> tuple[Subject, float]:
    from ..sim_to_real.page import subject_of
    from ..sim_to_real.run import Request, run_study

    found = run_study(
        Request(chosen.plots, chosen.seeds, chosen.seed, data, chosen.real), chosen.out
    )
    return subject_of(found, chosen.out), sum(found.seconds.values())


def _ablations(chosen: argparse.Namespace, data: Path | None) -> tuple[Subject, float]:
    from ..sim_to_real.ablation_page import ablation_subject
    from ..sim_to_real.ablations import run_ablations

    if data is None:
        raise SpecError("--data", "is needed: the measurements, with wood/ in it")
    began = time.process_time()
    found = run_ablations(data, chosen.out, chosen.plots, chosen.seeds, chosen.seed)
    return ablation_subject(found, chosen.out), time.process_time() - began


def _tasks(chosen: argparse.Namespace, data: Path | None) -> tuple[Subject, float]:
    from ..sim_to_real.task_page import task_subject
    from ..sim_to_real.tasks import run_tasks

    began = time.process_time()
    found = run_tasks(chosen.tool, data, chosen.out, chosen.plots, chosen.seed)
    return task_subject(found, chosen.out), time.process_time() - began


WORK = {"sim-to-real": _study, "ablations": _ablations, "tree-tasks": _tasks}
