"""``python -m headless stand``: where the trees of a scene stand, without growing any."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..command import SCENE_HELP, Command, name_of, out_file, scene_file


class StandCommand(Command):
    name = "stand"
    help = "sample where the trees of a scene stand: a table, and a map"
    is_folder = False
    description = (
        "Sample the positions of a scene's trees, without growing them; write them as CSV or "
        "GeoJSON, and a map beside that."
    )

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("scene", type=scene_file, metavar="SCENE", help=SCENE_HELP)
        parser.add_argument(
            "--out",
            type=Path,
            metavar="FILE",
            help=".csv or .geojson (default out/SCENE/points.csv)",
        )
        parser.add_argument("--seed", type=int, help="another seed than the scene file's")

    def output(self, chosen: argparse.Namespace) -> Path:
        out = chosen.out or Path("out") / name_of(chosen.scene) / "points.csv"
        return out_file(out, ".csv", ".geojson", ".json")

    def run(self, chosen: argparse.Namespace) -> None:
        from .work.stand import sample_stand

        sample_stand(chosen.scene, chosen.out, chosen.seed)
