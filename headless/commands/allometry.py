"""``python -m headless allometry``: laws of size from measured trees, and whether grown ones keep them."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..command import Command


class AllometryCommand(Command):
    name = "allometry"
    help = "fit height, crown and leaf area over DBH to measured trees, or check grown ones"
    description = (
        "fit: fit the laws that trees are grown to measure by, height, crown width, crown base and leaf "
        "area over the stem's diameter, their spread and correlation, to a table; writes a file a kind. "
        "check: grow trees of a species over the diameters that were measured, and count how many lie "
        "where 90 % of the measured ones do."
    )
    epilog = """A table has columns species, pft (EG, DG, EA, DA: evergreen or deciduous, gymnosperm or
angiosperm), dbh_m, height_m, crown_width_m, crown_base_m, leaf_area_m2, and perhaps study and
leaf_area_is (half, all or outline: how needles were counted)."""

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("action", choices=("fit", "check"), help="what to do")
        parser.add_argument(
            "what", metavar="TABLE.csv|SPECIES", help="of measured trees, or to grow"
        )
        parser.add_argument(
            "--kind",
            action="append",
            default=[],
            metavar="NAME",
            help='fit: a species, genus or functional type of the table, "Picea abies"; may be repeated '
            "(default: those that are shipped)",
        )
        parser.add_argument("--source", default="", help="fit: where the trees were measured")
        parser.add_argument(
            "--trees", type=int, default=1000, help="check: how many (default 1000)"
        )
        parser.add_argument(
            "--out",
            type=Path,
            default=Path("out/allometry"),
            metavar="FOLDER",
            help="of fitted files",
        )

    def run(self, chosen: argparse.Namespace) -> None:
        if chosen.action == "fit":
            from .work.allometry import fit_table

            fit_table(Path(chosen.what), chosen.kind, chosen.source, chosen.out)
        else:
            from .work.allometry import check_species

            check_species(chosen.what, chosen.trees)
