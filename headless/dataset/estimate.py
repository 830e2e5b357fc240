"""What a dataset will cost: scenes of the plan made for a trial, timed, weighed, and thrown away.

What a scene costs is taken to be a fixed part and a part for each point of its clouds; both are known from
the stages of the trial scenes, as CPU seconds, so that a loaded machine tells the same.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from . import disk
from .child import Child
from .factory import _machine_memory
from .plan import Plan, recipes

SAMPLES = 3
BOREAL = (1000, 35.3e9)  # plots and points of Boreal3D (2025)
BY_POINT = ("sensors", "write", "occlusion")


@dataclass(frozen=True)
class Estimate:
    """Of a whole dataset; spreads are those of the trial scenes.

    seconds : (S,) CPU seconds a scene. size : (S,) bytes. points : (S,). by_point : (S,) those of the seconds
    that go with points. wall : (S,).
    """

    count: int
    seconds: np.ndarray
    size: np.ndarray
    points: np.ndarray
    by_point: np.ndarray
    stages: dict[str, float]
    failed: tuple[str, ...]

    @property
    def core_hours(self) -> float:
        """CPU time of all scenes."""
        return float(self.seconds.mean() * self.count / 3600)

    @property
    def boreal_hours(self) -> float | None:
        """Core-hours of a thousand such plots with the points of Boreal3D; None without points."""
        if not self.points.sum():
            return None
        plots, points = BOREAL
        fixed = float((self.seconds - self.by_point).mean())
        return float(plots * fixed + points * self.by_point.sum() / self.points.sum()) / 3600


def estimate(plan: Plan, say: Callable[[str], None], samples: int = SAMPLES) -> Estimate:
    """Make some scenes of a plan, spread over its numbers, in a folder that is removed."""
    count = min(samples, plan.count)
    numbers = sorted({int((k + 0.5) * plan.count / count) for k in range(count)})
    child = Child(1)
    seconds, size, points, by_point, stages, failed = [], [], [], [], dict[str, float](), []
    try:
        with tempfile.TemporaryDirectory() as folder:
            root = Path(folder)
            for recipe in recipes(plan, numbers):
                outcome = child.make(root, asdict(recipe), plan.running.timeout, _machine_memory())
                if outcome.kind != "done":
                    failed.append(f"scene {recipe.name}: {outcome.why}")
                    say(f"  {failed[-1]}")
                    continue
                done = disk.read_scene(root / disk.SCENES / recipe.name)
                assert done is not None
                taken = outcome.seconds
                seconds.append(sum(taken.values()))
                by_point.append(sum(taken.get(name, 0.0) for name in BY_POINT))
                size.append(done.size)
                points.append(sum(done.record["points"].values()))
                for name, value in taken.items():
                    stages[name] = stages.get(name, 0.0) + value
                say(
                    f"  scene {recipe.name}: {seconds[-1]:.1f} s of CPU, {points[-1]:,} points, "
                    f"{size[-1] / 1e6:.1f} MB"
                )
    finally:
        child.end()
    arrays = (np.array(values, dtype=float) for values in (seconds, size, points, by_point))
    return Estimate(plan.count, *arrays, stages, tuple(failed))


def tell(found: Estimate, say: Callable[[str], None]) -> None:
    """Say what a dataset will cost."""
    if not len(found.seconds):
        say("no trial scene could be made")
        return
    spread = float(found.seconds.std() / max(found.seconds.mean(), 1e-9))
    cores = os.cpu_count() or 1
    say(
        f"{found.count:,} scenes: {found.core_hours:.2f} core-hours (±{spread:.0%} from scene to scene), "
        f"{found.core_hours / cores:.2f} h on the {cores} cores here"
    )
    gigabytes = found.size.mean() * found.count / 1e9
    say(f"{gigabytes:.2f} GB; {found.points.mean() * found.count:,.0f} points")
    total = sum(found.stages.values())
    shares = sorted(found.stages.items(), key=lambda pair: -pair[1])
    say("time by stage: " + ", ".join(f"{name} {value / total:.0%}" for name, value in shares))
    hours = found.boreal_hours
    if hours is not None:
        say(
            f"as many points as Boreal3D (1,000 plots, 35.3 billion points) from such plots: {hours:.0f} "
            "core-hours"
        )
