"""``python -m headless derive``: the string that a species' L-system makes."""

from __future__ import annotations

import argparse

from ..command import Command, refuse_negative


class DeriveCommand(Command):
    name = "derive"
    help = "print the string of a species' L-system"
    outputs = ()
    description = "Print the string that the L-system of a species makes."

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument(
            "species", metavar="PRESET", help="a species of assets/species, or a .toml"
        )
        parser.add_argument(
            "--generations",
            type=int,
            metavar="N",
            help="how often it is rewritten (default: as in the file)",
        )
        parser.add_argument("--seed", type=int, default=0, help="seed of the chances (default 0)")
        parser.add_argument(
            "--count", action="store_true", help="print the numbers of symbols and branches"
        )

    def run(self, chosen: argparse.Namespace) -> None:
        refuse_negative(chosen.seed)
        from .work.derive import derive_species

        derive_species(chosen.species, chosen.generations, chosen.seed, chosen.count)
