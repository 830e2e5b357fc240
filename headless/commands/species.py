"""``python -m headless species``: every preset in a table, and in pictures."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..command import Command, refuse_negative


class SpeciesCommand(Command):
    name = "species"
    help = "grow one tree of each preset: a table, and a contact sheet"
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
        parser.add_argument("--seed", type=int, default=1, help="seed of the trees (default 1)")

    def run(self, chosen: argparse.Namespace) -> None:
        refuse_negative(chosen.seed)
        from .work.species import show_species

        show_species(chosen.names, chosen.sheet, chosen.seed, pictures=chosen.pictures)
