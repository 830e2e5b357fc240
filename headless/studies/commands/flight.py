"""``python -m headless flight``: the experiments with flyers, and the training of a policy."""

from __future__ import annotations

import argparse
from pathlib import Path

from forest_addon.spec import SpecError

from ...command import LOCK, Command, refuse_negative

EXPERIMENTS = ("speed", "hedge", "plants", "senses", "learn")


class FlightCommand(Command):
    name = "flight"
    help = "experiments: critical speed, gaps in hedges, bat against LiDAR; train a policy"
    description = (
        "speed: flights of 500 m through Poisson forests beside the critical speed of Karaman & Frazzoli. "
        "hedge: gap or no gap from one echo, beside Wang & Müller. plants: which of two plants, beside Kuc. "
        "senses: two ears against LiDAR. "
        "learn: train a small policy by the cross-entropy method."
    )

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("experiment", choices=EXPERIMENTS)
        parser.add_argument(
            "--size", type=float, default=1.0, metavar="FACTOR", help="of the samples (1: minutes)"
        )
        parser.add_argument("--seed", type=int, default=1, help="default 1")
        parser.add_argument("--out", type=Path, metavar="DIR", help="default out/flight-EXPERIMENT")

    def output(self, chosen: argparse.Namespace) -> Path:
        return chosen.out or Path("out") / f"flight-{chosen.experiment}"

    def lock(self, chosen: argparse.Namespace) -> Path:
        return chosen.out / LOCK

    def run(self, chosen: argparse.Namespace) -> None:
        refuse_negative(chosen.seed)
        if not 0 < chosen.size <= 100:
            raise SpecError("--size", f"{chosen.size:g} is out of range; use 0 to 100")
        from importlib import import_module

        work = import_module(f"..flight.{chosen.experiment}", __package__)
        work.run(chosen.out, chosen.size, chosen.seed)
