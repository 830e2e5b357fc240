"""``python -m headless reverb-figures``: the figures of K (``papers/reverb_figures``)."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...command import Command


class ReverbFiguresCommand(Command):
    name = "reverb-figures"
    help = "the figures of the forest reverb paper, from our own responses"
    description = (
        "Draw figures 2 to 5 of Kaneko & Gamper (2021) and say whether their findings hold."
    )

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument(
            "--out",
            type=Path,
            default=Path("out") / "reverb-figures",
            metavar="DIR",
            help="folder",
        )
        parser.add_argument(
            "--quick", action="store_true", help="a tenth of the trees, fewer places"
        )

    def run(self, chosen: argparse.Namespace) -> None:
        from ..papers.reverb_figures import draw_figures

        draw_figures(chosen.out, chosen.quick)
