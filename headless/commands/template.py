"""``python -m headless template``: a user's tree as STL files becomes a species that grows."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..command import Command


class Template(Command):
    name = "template"
    help = "make a species from your own tree (STL)"
    description = (
        "Recognise trunk, branches and leaves in STL files of a tree, and write a species "
        "that grows from them, a picture of what was recognised, and a scene that plants it."
    )

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("wood", type=Path, metavar="WOOD.stl", help="trunk and branches, z up")
        parser.add_argument(
            "leaves", type=Path, nargs="?", metavar="LEAVES.stl", help="leaves; left out: leafless"
        )
        parser.add_argument("--name", required=True, help="name of the species")
        parser.add_argument(
            "--height",
            type=float,
            default=0.0,
            metavar="M",
            help="height of the tree in metres; left out: inferred, and said",
        )
        parser.add_argument(
            "--out", type=Path, metavar="DIR", help="folder for the library (default out/NAME)"
        )

    def output(self, chosen: argparse.Namespace) -> Path:
        return chosen.out or Path("out") / chosen.name

    def run(self, chosen: argparse.Namespace) -> None:
        from ..work.template import make_template

        make_template(chosen.wood, chosen.leaves, chosen.name, chosen.height, chosen.out)
