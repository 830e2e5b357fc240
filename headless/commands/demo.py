"""``python -m headless demo``: the demo forest, and what a call sounds like in it."""

from __future__ import annotations

import argparse

from forest_addon.base.places import ASSETS

from .run import RunCommand, add_run_options

DEMO = ASSETS / "scenes" / "demo.toml"


class DemoCommand(RunCommand):
    name = "demo"
    maker = "run"
    help = "run the demo forest"
    description = f"Run the demo forest, assets/scenes/{DEMO.name}."

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        add_run_options(parser, "out/demo")
        parser.set_defaults(
            scene=DEMO,
            convolve=ASSETS / "sounds" / "call.wav",
            workers=1,
            share=None,
            scheduler="",
            slurm=None,
            store=None,
        )
