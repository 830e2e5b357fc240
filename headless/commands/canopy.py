"""``python -m headless canopy``: leaf area index and gap fraction of a stand, seen from below."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..command import LOCK, SCENE_HELP, Command, name_of, scene_file


class CanopyCommand(Command):
    name = "canopy"
    help = "gap fraction and leaf area index of a stand, by hemispherical pictures"
    description = (
        "Grow the forest of a scene file and look up from points in it by rays: gap fraction by zenith "
        "angle, open sky, effective plant area index (Miller 1967), beside the true leaf and wood area "
        "indices; and hemispherical pictures."
    )

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("scene", type=scene_file, metavar="SCENE", help=SCENE_HELP)
        parser.add_argument(
            "--out", type=Path, metavar="FOLDER", help="for the files (default out/SCENE/canopy)"
        )
        parser.add_argument(
            "--at",
            action="append",
            metavar="X,Y[,Z]",
            help="a point, metres; may be given again (default a grid over the middle of the field)",
        )
        parser.add_argument(
            "--grid", type=int, default=5, metavar="N", help="points along a side of it (default 5)"
        )
        parser.add_argument(
            "--height", type=float, default=1.3, help="above the ground, metres (default 1.3)"
        )
        parser.add_argument("--seed", type=int, help="another seed than the scene file's")

    def output(self, chosen: argparse.Namespace) -> Path:
        return chosen.out or Path("out") / name_of(chosen.scene) / "canopy"

    def lock(self, chosen: argparse.Namespace) -> Path:
        return chosen.out / LOCK

    def is_whole(self, chosen: argparse.Namespace) -> bool:
        return True

    def run(self, chosen: argparse.Namespace) -> None:
        from .work.canopy import look_up_in

        look_up_in(
            chosen.scene, chosen.out, chosen.at or [], chosen.grid, chosen.height, chosen.seed
        )
