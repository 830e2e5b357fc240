"""``python -m headless tiles SCENE.toml --sample 1%``: what a field in tiles costs, before it is scanned."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import Any

from ..command import read_scene
from ..progress import Stages, hushed


def run(chosen: argparse.Namespace) -> None:
    """Scan some tiles."""
    scene = read_scene(chosen.scene, chosen.seed)
    with hushed():
        from ..dataset.engine import Cluster
        from ..tiled import sample_tiles
    cluster = Cluster(chosen.workers or 0, chosen.scheduler, chosen.slurm)
    stages = Stages(chosen.quiet)
    folder = Path(chosen.scene).resolve().parent
    found = sample_tiles(scene, folder, chosen.sample, cluster, stages)
    print(json.dumps(found) if chosen.json else _said(found))


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
        f"{found['plan_cpu_seconds']:.0f} s to plan the field"
    )
