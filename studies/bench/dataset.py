"""A data factory from end to end: scenes an hour, points a second, where the time goes, what a worker keeps.

Scenes are made as a dataset's are, in processes of their own; those of ``lidar-plots`` at shipped size from
thin trials, as a dry run does. Seconds are CPU time unless they are said to be others. Scaling is wall time
and needs two cores that nobody else uses.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from ..inside import (
    PLANS,
    Cluster,
    Plan,
    Say,
    SceneJob,
    SceneOutcome,
    Worker,
    estimate,
    make_all,
    read_plan,
    recipes,
    remove_scene,
    scenes_done,
    tell_estimate,
)
from ..tables import table

TITLE = "dataset: a factory of labelled forests"
SMALL = (  # lidar-plots, reduced, for what needs many scenes
    *("scene.forest.size=[11.0,11.0]", "scene.sensors[tls].angle_step_deg=1.0"),
    *("place[tls].count=1", "scene.sensors[uav].pulse_rate=6000.0"),
    *("scene.sensors[mls].pulse_rate=3000.0", "scene.sensors[als].pulse_rate=10000.0"),
    *("mix.variants=1", "mix.kinds=[1,2]"),
)
LEAST = (  # the same with as little in it as shows what a worker keeps
    *(*SMALL, "scene.forest.size=[8.0,8.0]", "scene.sensors[tls].angle_step_deg=3.0"),
    *("scene.sensors[uav].pulse_rate=1000.0", "scene.sensors[mls].pulse_rate=1000.0"),
    *("scene.sensors[als].pulse_rate=2000.0", "mix.scale=[0.6,0.8]"),
)
MADE = (  # what, plan, overrides, scenes
    ("lidar-plots, as shipped", "lidar-plots", (), 2),
    ("lidar-plots, 11 m", "lidar-plots", SMALL, 4),
    ("echoes", "echoes", (), 4),
)
SCALED = 10  # scenes
FROM, TO, NEAR = (
    20,
    200,
    10,
)  # scenes between which a worker's memory is compared, medians of so many


def run(say: Say, _: object) -> None:
    """Print costs by trial scenes, as ``headless dataset --dry-run`` tells them, then scaling and memory."""
    for what, name, changed, count in MADE:
        say(f"{what}, {count} trial scenes:\n")
        tell_estimate(estimate(read_plan(PLANS / f"{name}.toml", changed), say, count), say)
        say("")
    _scaling(say)
    say("")
    _memory(say)


def _scaling(say: Say) -> None:
    """Print the same plots by one thread, by two threads of a worker and by two workers of one."""
    plan = read_plan(PLANS / "lidar-plots.toml", [*SMALL, f"count={SCALED}"])
    rows, first = [], None
    for workers, threads in ((1, 1), (1, 2), (2, 1)):
        wall, cpu, digests = _making(plan, workers, threads)
        first = first or (wall, digests)
        row = [f"{workers}", f"{threads}", f"{wall:.1f}", f"{first[0] / wall:.2f}", f"{cpu:.1f}"]
        rows.append([*row, "equal" if digests == first[1] else "other"])
    head = [
        "workers",
        "threads of each",
        "wall, s",
        "times as fast",
        "CPU s of the scenes",
        "bytes",
    ]
    table(say, head, rows)
    say(
        f"\n{SCALED} small plots, start of the processes and of Blender within; load "
        f"{os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."
    )


def _making(plan: Plan, workers: int, threads: int) -> tuple[float, float, list[str]]:
    """Wall seconds, CPU seconds of the scenes and their digests."""
    with tempfile.TemporaryDirectory() as folder:
        root, told = Path(folder), list[SceneOutcome]()
        memory = plan.running.memory_gb * 1e9 or float("inf")
        jobs = [SceneJob(root, one, plan.running, memory, threads) for one in recipes(plan)]
        start = time.monotonic()
        make_all(jobs, Cluster(workers), told.append)
        wall = time.monotonic() - start
        digests = [str(one.record["digest"]) for one in scenes_done(root)]
        return wall, sum(sum(one.seconds.values()) for one in told), digests


def _memory(say: Say) -> None:
    held = memory_by_scene(read_plan(PLANS / "lidar-plots.toml", [*LEAST, f"count={TO}"]))
    before, after = (statistics.median(held[last - NEAR : last]) for last in (FROM, TO))
    say(
        f"A worker holds {before / 1e6:.0f} MB after scene {FROM}, {after / 1e6:.0f} MB after scene {TO}: "
        f"{after / before - 1:+.1%} (medians of {NEAR} scenes; from {min(held) / 1e6:.0f} to "
        f"{max(held) / 1e6:.0f} MB)."
    )


def memory_by_scene(plan: Plan) -> Sequence[float]:
    """Bytes that one process holds after each scene of a plan."""
    worker, held = Worker(), []
    with tempfile.TemporaryDirectory() as folder:
        try:
            for recipe in recipes(plan):
                held.append(
                    worker.once(
                        SceneJob(Path(folder), recipe, plan.running, float("inf"), 1)
                    ).memory
                )
                remove_scene(Path(folder), recipe.number)
        finally:
            worker.end()
    return held
