"""``python -m headless run SCENE.toml``: everything that a scene file asks for, into a folder."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..command import LOCK, SCENE_HELP, Command, name_of, read_scene, scene_file


class RunCommand(Command):
    name = "run"
    help = "run a scene file"
    description = "Run a scene file."

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("scene", type=scene_file, metavar="SCENE", help=SCENE_HELP)
        add_run_options(parser, "out/SCENE")

    def output(self, chosen: argparse.Namespace) -> Path:
        return chosen.out or Path("out") / name_of(chosen.scene)

    def lock(self, chosen: argparse.Namespace) -> Path:
        return chosen.out / LOCK

    def kept(self, chosen: argparse.Namespace) -> str:
        return f"{super().kept(chosen)}; --resume goes on with it"

    def run(self, chosen: argparse.Namespace) -> None:
        run_file(chosen.scene, chosen)


def add_run_options(parser: argparse.ArgumentParser, folder: str) -> None:
    """Declare the options of any run of a scene."""
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help=f"folder for the results (default {folder})"
    )
    parser.add_argument("--seed", type=int, help="another seed than the scene file's")
    parser.add_argument(
        "--convolve",
        type=Path,
        metavar="DRY.wav",
        help="also write what each reverb makes of this dry sound: NAME-DRY.wav",
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="go on with a run that was ended: sensors that it had finished do not look again",
    )
    parser.add_argument("--quiet", action="store_true", help="say nothing but errors")


def run_file(scene: Path, chosen: argparse.Namespace) -> None:
    """Run a scene file as the options say."""
    settings = read_scene(scene, chosen.seed)
    from ..progress import hushed

    with hushed():  # Blender says where its colours come from
        from ..pipeline import run_scene

    run_scene(
        settings,
        scene.resolve().parent,
        chosen.out,
        quiet=chosen.quiet,
        dry=chosen.convolve,
        resume=chosen.resume,
    )
