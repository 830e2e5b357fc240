"""``python -m headless accuracy``: how far off a scene's results are, and the cheapest settings."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..command import SCENE_HELP, Command, finite, scene_file


class AccuracyCommand(Command):
    name = "accuracy"
    default = "{}-accuracy"
    whole = True
    help = "error against seconds for each sensor of a scene, and what to set"
    description = (
        "Try settings of each sensor of a scene on a part of it, against the exact way; draw error "
        "against seconds, and write recommended.toml: the scene with the cheapest settings that keep "
        "the error asked for (metres for LiDAR, a share for sound), or the most exact that fit the time."
    )

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("scene", type=scene_file, metavar="SCENE", help=SCENE_HELP)
        parser.add_argument(
            "--out", type=Path, metavar="DIR", help="folder (default out/SCENE-accuracy)"
        )
        parser.add_argument(
            "--error", type=finite, default=1e-3, metavar="E", help="error wanted (default 1e-3)"
        )
        parser.add_argument(
            "--seconds",
            type=finite,
            default=60.0,
            metavar="S",
            help="CPU seconds that each sensor may take (default 60)",
        )

    def run(self, chosen: argparse.Namespace) -> None:
        from ..accuracy.run import sweep_scene

        sweep_scene(chosen.scene, chosen.out, chosen.error, chosen.seconds)
