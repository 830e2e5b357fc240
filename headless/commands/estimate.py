"""``python -m headless estimate``: a map of trees becomes a scene whose forests are like the site."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..command import Command, out_file


class EstimateCommand(Command):
    name = "estimate"
    help = "make a scene like a site from a map of its trees (CSV)"
    is_folder = False
    description = (
        "Estimate where trees stand on a site from a CSV of x, y (metres) and perhaps species, "
        "and write a scene that plants forests like it, and a picture."
    )

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("map", type=Path, metavar="TREES.csv", help="columns x, y, species")
        parser.add_argument(
            "--out", type=Path, metavar="SITE.toml", help="the scene (default out/TREES/site.toml)"
        )
        parser.add_argument(
            "--method",
            choices=("mixture", "kernel"),
            default="mixture",
            help="Gaussian hills of maximum likelihood, or a kernel estimate (default mixture)",
        )
        parser.add_argument(
            "--law",
            choices=("auto", "poisson", "thomas", "matern", "strauss"),
            default="auto",
            help="how trees stand about that intensity: by chance, in groups, apart; auto takes the "
            "first that the map's own tests accept (default auto)",
        )
        parser.add_argument(
            "--window",
            nargs="+",
            default=(),
            metavar="W",
            help="where trees were mapped: X0 Y0 X1 Y1, or a CSV of corners x, y, ring "
            "(default: around the trees)",
        )
        parser.add_argument(
            "--species",
            action="append",
            default=[],
            metavar="NAME=PRESET",
            help="what to plant for a name of the map, or PRESET alone for all; may be repeated",
        )

    def output(self, chosen: argparse.Namespace) -> Path:
        return out_file(chosen.out or Path("out") / chosen.map.stem / "site.toml", ".toml")

    def run(self, chosen: argparse.Namespace) -> None:
        from .work.estimate import estimate_site

        estimate_site(
            chosen.map,
            self.output(chosen),
            chosen.method,
            chosen.window,
            chosen.species,
            law=chosen.law,
        )
