"""``python -m headless validate``: simulations beside measurements of real forests."""

from __future__ import annotations

import argparse
from pathlib import Path

from forest_addon.spec import SpecError

from ...command import Command, refuse_negative


class ValidateCommand(Command):
    name = "validate"
    help = "hold the simulations to measurements: what agrees, what does not"
    outputs = ("out", "docs")
    description = (
        "Print and draw simulation beside measurement, with intervals, and say what agrees. Subjects: "
        "reverb, lidar, stand, leaves, trees, wind; none: all. With a FILE of yours: reverb RECORDING.wav "
        "--stand TREES.csv, lidar CLOUD.laz --scene MY.toml, or two clouds: lidar A.laz B.laz."
    )

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("subject", nargs="?", metavar="SUBJECT", help="which; default all")
        parser.add_argument(
            "file", nargs="?", type=Path, metavar="FILE", help="a recording or cloud of your own"
        )
        parser.add_argument(
            "other", nargs="?", type=Path, metavar="OTHER.laz", help="a cloud to hold it to"
        )
        parser.add_argument(
            "--origin",
            action="append",
            default=[],
            metavar="X,Y,Z",
            help="where the scanner of two clouds stood; twice: of each (default: as pulses say)",
        )
        parser.add_argument(
            "--data",
            type=Path,
            metavar="FOLDER",
            help="the measurements (default $FOREST_MEASURED, else measured)",
        )
        parser.add_argument(
            "--out",
            type=Path,
            default=Path("out/validate"),
            metavar="DIR",
            help="folder of results, one a subject (default out/validate)",
        )
        parser.add_argument(
            "--stand",
            type=Path,
            metavar="TREES.csv",
            help="where the trees of your recording stand",
        )
        parser.add_argument(
            "--scene", type=Path, metavar="MY.toml", help="the scene that your cloud is of"
        )
        parser.add_argument("--seed", type=int, default=1, help="seed of what is drawn (default 1)")
        parser.add_argument(
            "--docs",
            type=Path,
            metavar="DIR",
            help="also join all parts in --out to DIR/validation.md, pictures below it",
        )

    def run(self, chosen: argparse.Namespace) -> None:
        refuse_negative(chosen.seed)
        if chosen.other:
            from ..validation.clouds.pair import hold_pair

            hold_pair(chosen.subject, (chosen.file, chosen.other), chosen.origin, chosen)
            return
        if chosen.origin:
            raise SpecError("--origin", "belongs to two clouds: validate lidar A.laz B.laz")
        from ..validation.run import run_sections

        run_sections([chosen.subject] if chosen.subject else [], chosen, chosen.out)
