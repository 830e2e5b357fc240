"""``python -m headless species``: every preset in a table, and in pictures."""

from __future__ import annotations

import argparse
from pathlib import Path

from forest_addon.spec import SpecError

from ..command import Command, refuse_negative


class SpeciesCommand(Command):
    name = "species"
    help = "grow one tree of each preset: a table, and a contact sheet"
    outputs = ("sheet", "pictures", "close_ups")
    is_folder = False
    description = "Grow one tree of each species and print its size, leaves and wood."

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("names", nargs="*", metavar="NAME", help="which; default every preset")
        parser.add_argument("--sheet", type=Path, metavar="PNG", help="also render a contact sheet")
        parser.add_argument(
            "--pictures",
            type=Path,
            metavar="DIR",
            help="also render a small picture of each into a folder",
        )
        parser.add_argument(
            "--close-ups",
            type=Path,
            metavar="DIR",
            help="render a fork, bark at a metre and a twig of each NAME into a folder; without a NAME a "
            "fork of beech, bark of pine and a twig of maple",
        )
        parser.add_argument(
            "--pixels", type=int, default=800, help="width of a tree on the sheet (default 800)"
        )
        parser.add_argument("--seed", type=int, default=1, help="seed of the trees (default 1)")

    def run(self, chosen: argparse.Namespace) -> None:
        refuse_negative(chosen.seed)
        if not 50 <= chosen.pixels <= 4000:
            raise SpecError("--pixels", f"{chosen.pixels} is not from 50 to 4000")
        from .work.species import show_closeups, show_species

        if chosen.close_ups:
            show_closeups(chosen.names, chosen.close_ups, chosen.seed)
            if not (chosen.sheet or chosen.pictures):
                return
        show_species(
            *(chosen.names, chosen.sheet, chosen.seed),
            pictures=chosen.pictures,
            pixels=chosen.pixels,
        )
