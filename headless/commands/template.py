"""``python -m headless template``: a user's tree in files becomes a species that grows."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..command import LOCK, Command


class TemplateCommand(Command):
    name = "template"
    help = "make a species from your own tree (STL, PLY, OBJ, glTF)"
    description = (
        "Recognise trunk, branches and leaves in files of a tree, and write a species "
        "by which siblings of it grow, pictures of what was recognised and of some siblings, and a "
        "scene that plants them. A table says how close the siblings come to the tree."
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
            "--grammar",
            choices=("fitted", "t20"),
            default="fitted",
            help="siblings of the tree, or its branches on Tanveer et al.'s grammar (default fitted)",
        )
        parser.add_argument(
            "--siblings",
            type=int,
            default=50,
            metavar="N",
            help="how many to grow and compare with the tree, 24 at least (default 50; 0: none)",
        )
        parser.add_argument(
            "--accept",
            action="store_true",
            help="write the scene even if siblings are too unlike the tree (exit code 5 without)",
        )
        parser.add_argument(
            "--out", type=Path, metavar="DIR", help="folder for the library (default out/NAME)"
        )

    def output(self, chosen: argparse.Namespace) -> Path:
        return chosen.out or Path("out") / chosen.name

    def lock(self, chosen: argparse.Namespace) -> Path:
        return chosen.out / LOCK

    def is_whole(self, chosen: argparse.Namespace) -> bool:
        return True

    def run(self, chosen: argparse.Namespace) -> None:
        from forest_addon.growth.library.template_library import Brought

        from .work.template import make_template

        brought = Brought(chosen.wood, chosen.leaves, chosen.height, chosen.unit, chosen.up)
        make_template(
            *(brought, chosen.name, chosen.out, chosen.grammar, chosen.siblings),
            accept=chosen.accept,
        )
