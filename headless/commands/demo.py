"""``python -m headless demo``: the demo forest, and what a call sounds like in it."""

from __future__ import annotations

import argparse
from pathlib import Path

from forest_addon.base.places import ASSETS

from ..command import LOCK, Command
from .run import add_run_options, is_whole_run, run_file

DEMO = ASSETS / "scenes" / "demo.toml"


class DemoCommand(Command):
    name = "demo"
    help = "run the demo forest"
    description = f"Run the demo forest, assets/scenes/{DEMO.name}."

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        add_run_options(parser, "out/demo")
        parser.set_defaults(convolve=ASSETS / "sounds" / "call.wav")

    def output(self, chosen: argparse.Namespace) -> Path:
        return chosen.out or Path("out") / DEMO.stem

    def lock(self, chosen: argparse.Namespace) -> Path:
        return chosen.out / LOCK

    def is_whole(self, chosen: argparse.Namespace) -> bool:
        return is_whole_run(chosen)

    @property
    def maker(self) -> str:
        return "run"

    def run(self, chosen: argparse.Namespace) -> None:
        run_file(DEMO, chosen)
