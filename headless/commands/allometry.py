"""``python -m headless allometry fit``: laws of size from a table of measured trees."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..command import Command


class Allometry(Command):
    name = "allometry"
    help = "fit height, crown and leaf area over DBH to a table of measured trees"
    description = (
        "Fit the laws that measured trees are grown by: height, crown width, crown base and leaf area "
        "over the stem's diameter, their spread and their correlation. Writes a file for each kind."
    )
    epilog = """A table has columns species, pft (EG, DG, EA, DA: evergreen or deciduous, gymnosperm or
angiosperm), dbh_m, height_m, crown_width_m, crown_base_m, leaf_area_m2."""

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("action", choices=("fit",), help="what to do")
        parser.add_argument("table", type=Path, metavar="TABLE.csv", help="a row for each tree")
        parser.add_argument(
            "--kind",
            action="append",
            default=[],
            metavar="NAME",
            help='a species, genus or functional type of the table, "Picea abies"; may be repeated '
            "(default: those that are shipped)",
        )
        parser.add_argument("--source", default="", help="where the trees were measured")
        parser.add_argument(
            "--out", type=Path, default=Path("out/allometry"), metavar="FOLDER", help="of the files"
        )

    def run(self, chosen: argparse.Namespace) -> None:
        from ..work.allometry import fit_table

        fit_table(chosen.table, chosen.kind, chosen.source, chosen.out)
