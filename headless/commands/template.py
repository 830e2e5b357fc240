"""``python -m headless template``: a user's tree in files becomes a species that grows."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..command import Command


class Template(Command):
    name = "template"
    help = "make a species from your own tree (STL, PLY, OBJ, glTF)"
    description = (
        "Recognise trunk, branches and leaves in files of a tree, and write a species "
        "that grows from them, a picture of what was recognised, and a scene that plants it."
    )

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument(
            "wood",
            type=Path,
            metavar="WOOD",
            help="trunk and branches, and perhaps leaves: .stl, .ply, .obj, .gltf or .glb",
        )
        parser.add_argument(
            "leaves",
            type=Path,
            nargs="?",
            metavar="LEAVES",
            help="leaves, if in a file of their own",
        )
        parser.add_argument(
            "--unit",
            default="",
            help="metres, centimetres, millimetres, feet ...; left out: inferred",
        )
        parser.add_argument(
            "--up",
            default="",
            metavar="AXIS",
            help="the files' upright axis, z or y; else inferred",
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

        make_template(
            *(chosen.wood, chosen.leaves, chosen.name, chosen.height, chosen.out),
            unit=chosen.unit,
            up=chosen.up,
        )
