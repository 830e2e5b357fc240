"""``python -m headless convolve``: a dry sound, heard in the forest."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..command import Command, out_file


class ConvolveCommand(Command):
    name = "convolve"
    help = "hear a dry sound in the forest"
    is_folder = False
    description = (
        "Convolve a dry sound with an impulse response that a reverb wrote. The wet sound has "
        "the response's rate and channels, as 32-bit float."
    )

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("response", type=Path, metavar="IR.wav", help="the impulse response")
        parser.add_argument("dry", type=Path, metavar="DRY.wav", help="the dry sound, at any rate")
        parser.add_argument(
            "--out",
            type=Path,
            metavar="WET.wav",
            help="the wet sound (default IR-DRY.wav beside IR)",
        )
        parser.add_argument(
            "--normalise",
            type=float,
            metavar="DB",
            help="bring the largest sample to so many dB re full scale; left out: levels stay",
        )

    def output(self, chosen: argparse.Namespace) -> Path:
        beside = chosen.response.with_name(f"{chosen.response.stem}-{chosen.dry.stem}.wav")
        return out_file(chosen.out or beside, ".wav")

    def run(self, chosen: argparse.Namespace) -> None:
        from .work.convolve import convolve

        convolve(chosen.response, chosen.dry, chosen.out, chosen.normalise)
