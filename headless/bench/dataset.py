"""A data factory from end to end: scenes an hour, points a second, where the time goes, what a worker keeps.

Scenes of ``lidar-plots`` and ``echoes`` are made as a dataset is, in processes of their own; seconds are
CPU time unless they are said to be others. Scaling is wall time and needs cores that nobody else uses.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from ..dataset import disk
from ..dataset.child import Child
from ..dataset.engine import Cluster
from ..dataset.factory import Asked, make_dataset
from ..dataset.plan import PLANS, Plan, read_plan, recipes
from . import Say, table

TITLE = "dataset: a factory of labelled forests"
MADE = {"lidar-plots": 3, "echoes": 6}  # scenes of each
SMALL = (  # lidar-plots, reduced, for what needs many scenes
    *(
        "scene.forest.size=[11.0,11.0]",
        "scene.sensors[tls].angle_step_deg=1.0",
        "place[tls].count=1",
    ),
    *("scene.sensors[uav].pulse_rate=6000.0", "scene.sensors[mls].pulse_rate=3000.0"),
    *("scene.sensors[als].pulse_rate=10000.0", "mix.variants=1", "mix.kinds=[1,2]"),
)
FROM, TO = 20, 200  # scenes between which a worker's memory is compared
SCALED = 12  # scenes


def run(say: Say) -> None:
    """Print speed by plan and stage, scaling and memory."""
    rows, shares = [], []
    for name, count in MADE.items():
        row, share = _speed(name, read_plan(PLANS / f"{name}.toml", [f"count={count}"]))
        rows.append(row)
        shares.append(share)
    head = ["plan", "scenes", "CPU s a scene", "scenes/h/core", "points/s/core", "outside sensors"]
    table(say, head, rows)
    say("")
    table(say, ["plan", "share of time by stage"], shares)
    say("")
    _scaling(say)
    _memory(say)


def _speed(name: str, plan: Plan) -> tuple[list[str], list[str]]:
    stages: dict[str, float] = {}
    points = 0
    child = Child(1)
    with tempfile.TemporaryDirectory() as folder:
        try:
            for recipe in recipes(plan):
                outcome = child.make(Path(folder), asdict(recipe), 7200.0, float("inf"))
                for stage, seconds in outcome.seconds.items():
                    stages[stage] = stages.get(stage, 0.0) + seconds
                done = disk.read_scene(Path(folder) / disk.SCENES / recipe.name)
                points += 0 if done is None else sum(done.record["points"].values())
        finally:
            child.end()
    total = max(sum(stages.values()), 1e-9)
    outside = 1 - stages.get("sensors", 0.0) / total
    row = [name, str(plan.count), f"{total / plan.count:.1f}", f"{3600 * plan.count / total:.0f}"]
    row += [f"{points / total:,.0f}" if points else "-", f"{outside:.0%}"]
    ordered = sorted(stages.items(), key=lambda pair: -pair[1])
    return row, [name, ", ".join(f"{stage} {seconds / total:.1%}" for stage, seconds in ordered)]


def _scaling(say: Say) -> None:
    plan = read_plan(PLANS / "lidar-plots.toml", [*SMALL, f"count={SCALED}"])
    taken = []
    for workers in (1, 2):
        with tempfile.TemporaryDirectory() as folder:
            start = time.monotonic()
            make_dataset(plan, Path(folder) / "data", Asked(Cluster(workers), quiet=True))
            taken.append(time.monotonic() - start)
    say(
        f"{SCALED} small plots: {taken[0]:.0f} s with one worker, {taken[1]:.0f} s with two "
        f"({taken[0] / taken[1]:.2f} times as fast; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores)"
    )


def _memory(say: Say) -> None:
    held = memory_by_scene(read_plan(PLANS / "lidar-plots.toml", [*SMALL, f"count={TO}"]))
    say(
        f"a worker holds {held[FROM - 1] / 1e6:.0f} MB after scene {FROM}, {held[TO - 1] / 1e6:.0f} MB after "
        f"scene {TO}: {held[TO - 1] / held[FROM - 1] - 1:+.1%}"
    )


def memory_by_scene(plan: Plan) -> Sequence[float]:
    """Bytes that one process holds after each scene of a plan."""
    child, held = Child(1), []
    with tempfile.TemporaryDirectory() as folder:
        try:
            for recipe in recipes(plan):
                held.append(child.make(Path(folder), asdict(recipe), 7200.0, float("inf")).memory)
                disk.remove_scene(Path(folder), recipe.number)
        finally:
            child.end()
    return held
