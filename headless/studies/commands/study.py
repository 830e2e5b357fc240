"""``python -m headless study``: what a network gains that learns from our forests."""

from __future__ import annotations

import argparse
from pathlib import Path

from forest_addon.spec import SpecError

from ...command import LOCK, Command, refuse_negative

STUDIES = ("sim-to-real",)


class StudyCommand(Command):
    name = "study"
    help = "train on our forests, test on real clouds"
    description = (
        "sim-to-real: make plots, learn stems and wood from them, and tell them in real clouds, beside "
        "learning from real clouds and published rules. Needs forest-sensing[study]."
    )

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("study", choices=STUDIES)
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
        parser.add_argument("--plots", type=int, default=12, metavar="N", help="default 12")
        parser.add_argument("--seeds", type=int, default=3, metavar="N", help="default 3")
        parser.add_argument("--seed", type=int, default=1, help="seed of the plots (default 1)")
        parser.add_argument(
            "--out", type=Path, default=Path("out/sim-to-real"), metavar="DIR", help="of results"
        )
        parser.add_argument(
            "--docs", type=Path, metavar="DIR", help="also write its part of DIR/validation.md"
        )

    def lock(self, chosen: argparse.Namespace) -> Path:
        return Path(chosen.out) / LOCK

    def run(self, chosen: argparse.Namespace) -> None:
        import os

        refuse_negative(chosen.seed)
        for key in ("plots", "seeds"):
            if not 1 <= getattr(chosen, key) <= 1000:
                raise SpecError(
                    f"--{key}", f"{getattr(chosen, key)} is out of range; use 1 to 1000"
                )
        from ..sim_to_real.page import subject_of
        from ..sim_to_real.run import Request, run_study
        from ..validation.run import VARIABLE, keep_subject, tell_subject, write_page

        said = chosen.data or (Path(os.environ[VARIABLE]) if VARIABLE in os.environ else None)
        request = Request(chosen.plots, chosen.seeds, chosen.seed, said, chosen.real)
        found = run_study(request, chosen.out)
        part = subject_of(found, chosen.out)
        keep_subject(part, chosen.out / part.name)
        tell_subject(part, sum(found.seconds.values()), print)
        if chosen.docs:
            print(f"\nWrote {write_page(chosen.out, chosen.docs)}.")
