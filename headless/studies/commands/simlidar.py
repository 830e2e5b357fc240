"""``python -m headless simlidar``: Méndez et al.'s experiment with 42 orchards (``papers/simlidar``)."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...command import Command, refuse_negative


class SimlidarCommand(Command):
    name = "simlidar"
    help = "SIMLIDAR's 42 orchards: its table and regressions beside ours"
    description = (
        "Grow, build and scan the 42 orchards of Méndez et al. (SIMLIDAR); print their table "
        "and regressions beside ours. Finished orchards are kept, and not done again."
    )

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument(
            "--quick", action="store_true", help="only 4 and 5 iterations, every tenth scan"
        )
        parser.add_argument(
            "--out",
            type=Path,
            default=Path("out") / "simlidar",
            metavar="DIR",
            help="folder for tables and picture (default out/simlidar)",
        )
        parser.add_argument("--seed", type=int, default=1, help="seed of the trees (default 1)")
        parser.add_argument(
            "--engine", default="auto", choices=("auto", "bvhtree", "embree"), help="who casts rays"
        )
        parser.add_argument("--quiet", action="store_true", help="no progress, only the report")

    def run(self, chosen: argparse.Namespace) -> None:
        refuse_negative(chosen.seed)
        from ..papers.simlidar import run_experiment

        run_experiment(
            chosen.out,
            quick=chosen.quick,
            seed=chosen.seed,
            engine=chosen.engine,
            quiet=chosen.quiet,
        )
