"""``python -m headless tiles SCENE.toml --sample 1%``: what a field in tiles costs, before it is scanned."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import Any

from ..command import (
    SCENE_HELP,
    Command,
    add_cluster_options,
    read_scene,
    refuse_beyond,
    scene_file,
)


class TilesCommand(Command):
    name = "tiles"
    help = "scan some tiles of a field, say what all will cost"
    outputs = ()
    description = (
        "Scan some tiles of a scene with [tiles], drawn by chance, and say what the whole will cost: CPU "
        "hours, bytes and points with their 95 % intervals, and memory of a worker. Nothing is kept."
    )

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("scene", type=scene_file, metavar="SCENE", help=SCENE_HELP)
        parser.add_argument(
            "--sample",
            type=per_cent,
            default=0.01,
            metavar="P%",
            help="share of all tiles that are scanned, at least two (default 1%%)",
        )
        parser.add_argument("--seed", type=int, help="another seed than the scene file's")
        parser.add_argument("--workers", type=int, metavar="N", help="here; default: one a core")
        add_cluster_options(parser)
        parser.add_argument("--quiet", action="store_true", help="say nothing but the result")
        parser.add_argument("--json", action="store_true", help="print the result as JSON")

    def run(self, chosen: argparse.Namespace) -> None:
        refuse_beyond("--workers", 1 if chosen.workers is None else chosen.workers, 1)
        scene = read_scene(chosen.scene, chosen.seed)
        from ..progress import Stages, hushed

        with hushed():
            from ..dataset.engine import Cluster
            from ..tiled import sample_tiles
        cluster = Cluster(chosen.workers or 0, chosen.scheduler, chosen.slurm)
        stages = Stages(chosen.quiet)
        folder = Path(chosen.scene).resolve().parent
        found = sample_tiles(scene, folder, chosen.sample, cluster, stages).record()
        print(json.dumps(found) if chosen.json else _said(found))


def per_cent(word: str) -> float:
    """Return the share that a word such as 1% or 0.01 means."""
    value = float(word.removesuffix("%")) / (100 if word.endswith("%") else 1)
    if not 0 < value <= 1:
        raise argparse.ArgumentTypeError(f"{word} is no share of the tiles; write such as 1%")
    return value


def _said(found: dict[str, Any]) -> str:
    hours, size, points = found["cpu_hours"], found["bytes"], found["points"]
    cores = os.cpu_count() or 1
    return (
        f"{found['scanned']:,} of {found['tiles']:,} tiles were scanned; all of them (with 95 %):\n"
        f"  {hours[0]:.2f} CPU hours ({hours[1]:.2f} to {hours[2]:.2f}), {hours[0] / cores:.2f} h on the "
        f"{cores} cores here\n"
        f"  {size[0] / 1e9:.2f} GB of LAZ ({size[1] / 1e9:.2f} to {size[2] / 1e9:.2f}), "
        f"{points[0]:,.0f} points ({points[1]:,.0f} to {points[2]:,.0f})\n"
        f"  {found['memory_bytes_a_worker'] / 1e9:.2f} GB of memory a worker, at most\n"
        f"  within these hours: {found['pulses_cpu_seconds']:.0f} s to deal the pulses to tiles, "
        f"{found['plan_cpu_seconds_a_worker']:.0f} s to plan the field, and again for each further worker"
    )
