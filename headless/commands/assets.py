"""``python -m headless assets``: an asset library for Blender's Asset Browser."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..command import Command, refuse_negative


class AssetsCommand(Command):
    name = "assets"
    help = "grow an asset library: trees to drag from the Asset Browser"
    outputs = ("out", "sheet")
    description = (
        "Grow trees of each species into a .blend file of assets, with pictures, tags and catalogs. Added "
        "to Blender's asset libraries (Preferences, File Paths), they can be dragged into any scene; sensors "
        "know their leaves, branches and species there."
    )

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument(
            "names", nargs="*", metavar="SPECIES", help="which; default every preset"
        )
        parser.add_argument(
            "--out", type=Path, default=Path("out/assets"), metavar="FOLDER", help="of the library"
        )
        parser.add_argument(
            "--variants", type=int, default=4, metavar="N", help="trees of each species (default 4)"
        )
        parser.add_argument("--seed", type=int, default=1, help="seed of the trees (default 1)")
        parser.add_argument(
            "--sheet", type=Path, metavar="PNG", help="also put all pictures on one sheet"
        )

    def run(self, chosen: argparse.Namespace) -> None:
        refuse_negative(chosen.seed)
        from .work.assets import make_library

        make_library(chosen.names, chosen.out, chosen.variants, chosen.seed, sheet=chosen.sheet)
