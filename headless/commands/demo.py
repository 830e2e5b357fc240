"""``python -m headless demo``: the demo forest, and what a call sounds like in it."""

from __future__ import annotations

import argparse

from forest_addon.base.places import ASSETS

from .run import RunCommand, add_run_options

DEMO = ASSETS / "scenes" / "demo.toml"


class DemoCommand(RunCommand):
    name = "demo"
    help = "run the demo forest"
    description = f"Run the demo forest, assets/scenes/{DEMO.name}."

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        add_run_options(parser, "out/demo")
        dry = ASSETS / "sounds" / "call.wav"
        parser.set_defaults(scene=DEMO, convolve=dry, workers=1, share=None)
        parser.set_defaults(scheduler="", slurm=None, store=None)

    @property
    def maker(self) -> str:
        return "run"
