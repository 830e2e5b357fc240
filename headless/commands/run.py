"""``python -m headless run SCENE.toml``: everything that a scene file asks for, into a folder; of a .blend
file, the sensors that live in it."""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

from forest_addon.spec import Scene, SpecError

from ..command import (
    LOCK,
    PROGRAM,
    SCENE_HELP,
    Command,
    DoubtfulError,
    add_cluster_options,
    read_scene,
    refuse_beyond,
    scene_file,
    sound_file,
)


class RunCommand(Command):
    name = "run"
    default = "{}"
    help = "run a scene file, or the sensors in a .blend file"
    description = "Run a scene file, or the sensors that the extension has put into a .blend file."

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument(
            "scene",
            type=scene_file,
            nargs="?",
            metavar="SCENE",
            help=f"{SCENE_HELP}, or a .blend file; in Blender by default the file that is open",
        )
        add_run_options(parser, "out/SCENE")
        parser.add_argument(
            "--workers",
            type=int,
            default=1,
            metavar="N",
            help="processes that scan the tiles of a scene with [tiles] (default 1)",
        )
        add_cluster_options(parser)
        parser.add_argument(
            "--share",
            type=_share,
            metavar="K/N",
            help="make every Nth piece from the Kth on, as one of N processes that see the same folder; "
            "--resume joins them",
        )
        parser.add_argument(
            "--store",
            metavar="URL",
            help="of a scene with [tiles]: s3://, gs:// or another of fsspec's, to which finished pieces and "
            "in the end all files are copied; with --resume pieces are taken from there",
        )

    def output(self, chosen: argparse.Namespace) -> Path:
        if chosen.scene is None:
            chosen.scene = open_blend()
        return super().output(chosen)

    def lock(self, chosen: argparse.Namespace) -> Path:
        share = "" if chosen.share is None else "-{}-of-{}".format(*chosen.share)
        return chosen.out / f"{LOCK}{share}"

    def is_whole(self, chosen: argparse.Namespace) -> bool:
        # none that goes on, or makes a share, makes all files of its folder
        return not chosen.resume and chosen.share is None

    def kept(self, chosen: argparse.Namespace) -> str:
        return f"{super().kept(chosen)}; --resume goes on with it"

    def run(self, chosen: argparse.Namespace) -> None:
        scene, workers = chosen.scene, chosen.workers
        refuse_beyond("--workers", workers, 1)
        is_blend = scene.suffix.lower() == ".blend"
        dry = chosen.convolve.stem if chosen.convolve else ""
        if is_blend and chosen.seed is not None:
            raise SpecError("--seed", "belongs to a scene file; what stands in a .blend has one")
        settings = Scene() if is_blend else read_scene(scene, chosen.seed, dry)
        from ..progress import hushed

        with hushed():  # Blender says where its colours come from
            from ..dataset.engine import Cluster
            from ..pipeline import claim_files, run_blend, run_scene
            from ..tiled import run_in_tiles
        if not is_blend:
            claim_files(settings, chosen.out, dry)

        if settings.tiles.size:
            if chosen.convolve:
                raise SpecError("--convolve", "needs a reverb, which cannot be run in tiles")
            from ..store import store_of

            cluster = Cluster(workers, chosen.scheduler, chosen.slurm)
            run_in_tiles(
                settings,
                scene.resolve().parent,
                chosen.out,
                quiet=chosen.quiet,
                resume=chosen.resume,
                share=chosen.share,
                cluster=cluster if cluster.is_elsewhere or workers > 1 else None,
                store=None if chosen.store is None else store_of(chosen.store),
                command=f"{PROGRAM} run {scene.name} --seed {settings.seed}",
                strict=chosen.strict,
            )
            _print_record(chosen)
            return
        asked = {
            "--workers": workers > 1,
            "--scheduler": chosen.scheduler,
            "--store": chosen.store,
            "--share": chosen.share,
            "--slurm": chosen.slurm is not None,
        }
        for key, is_asked in asked.items():
            if is_asked:
                why = "needs a scene with [tiles]; sensors of others use all cores by themselves"
                raise SpecError(key, why)
        run = (
            partial(run_blend, scene)
            if is_blend
            else partial(run_scene, settings, scene.resolve().parent)
        )
        try:
            run(
                chosen.out,
                quiet=chosen.quiet,
                verbose=chosen.verbose,
                dry=chosen.convolve,
                resume=chosen.resume,
                strict=chosen.strict,
            )
        except DoubtfulError:  # all is written
            _print_record(chosen)
            raise
        _print_record(chosen)


def _share(text: str) -> tuple[int, int]:
    """Number and count of the share of the work that "2/8" means."""
    part, _, parts = text.partition("/")
    if not (part.isdigit() and parts.isdigit() and 1 <= int(part) <= int(parts)):
        raise argparse.ArgumentTypeError(f'"{text}" is no share; write such as 2/8')
    return int(part), int(parts)


def _print_record(chosen: argparse.Namespace) -> None:
    if chosen.json:
        print((chosen.out / "run.json").read_text(encoding="utf-8"))


def open_blend() -> Path:
    """Return the .blend file that is open in the Blender that runs this.

    Raises
    ------
    SpecError : there is none.
    """
    bpy = sys.modules.get("bpy")
    if bpy is None or not bpy.data.filepath:
        raise SpecError("run", "needs a scene: name a .toml or .blend file")
    return Path(bpy.data.filepath)


def add_run_options(parser: argparse.ArgumentParser, folder: str) -> None:
    """Declare the options of any run of a scene."""
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help=f"folder for the results (default {folder})"
    )
    parser.add_argument("--seed", type=int, help="another seed than the scene file's")
    parser.add_argument(
        "--convolve",
        type=sound_file,
        metavar="DRY.wav",
        help="also write what each reverb makes of this dry sound: NAME-DRY.wav",
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="go on with a run that was ended: sensors that it had finished do not look again",
    )
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--quiet", action="store_true", help="say nothing but warnings and errors")
    how.add_argument(
        "--verbose", action="store_true", help="say what each audit looked at, and costs"
    )
    parser.add_argument(
        "--json", action="store_true", help="in the end, print run.json on standard output"
    )
    parser.add_argument(
        "--strict", action="store_true", help="end with exit code 3 where there was a warning"
    )
