"""``python -m headless bench``: speed and error on this machine, side by side."""

from __future__ import annotations

import argparse
from pathlib import Path

from forest_addon.spec import unknown

from ...command import Command
from ..bench.run import ON_REQUEST, SECTIONS
from ..bench.run import run as run_sections


class BenchCommand(Command):
    name = "bench"
    help = "measure speed and error on this machine"
    outputs = ("docs",)
    is_folder = False
    description = (
        f"Print time and error side by side. Sections: {', '.join(SECTIONS)}; "
        f"only when asked for: {', '.join(ON_REQUEST)}."
    )

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("sections", nargs="*", metavar="SECTION", help="which; default all")
        parser.add_argument(
            "--docs", type=Path, help="write them into benchmarks.md of this folder too"
        )

    def run(self, chosen: argparse.Namespace) -> None:
        known = SECTIONS + ON_REQUEST
        mistyped = [name for name in chosen.sections if name not in known]
        if mistyped:
            raise unknown("bench", mistyped[0], known)
        run_sections(chosen.sections, Path("out") / "bench", chosen.docs)
