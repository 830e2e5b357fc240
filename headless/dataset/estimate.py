"""Cost of a dataset: scenes of the plan made for a trial, timed, weighed, and thrown away.

Scenes of many million points are not made whole: with a 64th of their pulses first, then with as many as
give about ``ENOUGH`` points. Seconds of the stages that go with points, and bytes, are taken to be a fixed
part and a part for each point, which both trials tell; fewer pulses lie less near each other, for the rays
and in the files, so this errs to the costly side. Seconds are CPU time, so that a loaded machine tells nearly
the same.
"""

from __future__ import annotations

import copy
import os
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from forest_addon.sensing.kinds import KINDS, kind_of

from . import disk
from .child import Child, Outcome
from .factory import _machine_memory
from .plan import Plan, Recipe, recipes

SAMPLES = 3
THIN = 64  # of every how many pulses a first trial has one
ENOUGH = 1_000_000  # points of the second
BOREAL = (1000, 35.3e9)  # plots and points of Boreal3D (2025)
BY_POINT = ("sensors", "write", "occlusion", "digest")


@dataclass(frozen=True)
class Trial:
    """One scene: CPU seconds of each stage, points, bytes."""

    seconds: dict[str, float]
    points: float
    size: float

    @property
    def by_point(self) -> float:
        """Seconds of the stages that go with points."""
        return sum(self.seconds.get(name, 0.0) for name in BY_POINT)

    def at(self, other: Trial, points: float) -> Trial:
        """The scene with so many points, as this trial and one with fewer tell."""
        more = self.points - other.points
        share = (points - self.points) / more if more > 0 else 0.0

        def grown(one: float, two: float) -> float:
            return one + share * max(one - two, 0.0)

        seconds = {
            name: grown(value, other.seconds.get(name, 0.0)) if name in BY_POINT else value
            for name, value in self.seconds.items()
        }
        return Trial(seconds, points, grown(self.size, other.size))


@dataclass(frozen=True)
class Estimate:
    """Of a whole dataset: how many scenes, whole scenes as trials tell them, and what could not be made."""

    count: int
    scenes: tuple[Trial, ...]
    failed: tuple[str, ...]

    @property
    def seconds(self) -> np.ndarray:
        """(S,) CPU seconds of each scene."""
        return np.array([sum(one.seconds.values()) for one in self.scenes])

    @property
    def stages(self) -> dict[str, float]:
        """Seconds of all scenes by stage, the longest first."""
        total: dict[str, float] = {}
        for one in self.scenes:
            for name, value in one.seconds.items():
                total[name] = total.get(name, 0.0) + value
        return dict(sorted(total.items(), key=lambda pair: -pair[1]))

    @property
    def points(self) -> float:
        """Mean points of a scene."""
        return float(np.mean([one.points for one in self.scenes]))

    @property
    def size(self) -> float:
        """Mean bytes of a scene."""
        return float(np.mean([one.size for one in self.scenes]))

    @property
    def core_hours(self) -> float:
        """CPU time of all scenes."""
        return float(self.seconds.mean() * self.count / 3600)

    @property
    def boreal_hours(self) -> float | None:
        """Core-hours of a thousand such plots with the points of Boreal3D; None without points."""
        if not self.points:
            return None
        plots, points = BOREAL
        by_point = sum(one.by_point for one in self.scenes)
        fixed = float(self.seconds.sum() - by_point) / len(self.scenes)
        rate = by_point / sum(one.points for one in self.scenes)
        return (plots * fixed + points * rate) / 3600


class _Failed(Exception):
    """A scene that could not be made; says why."""


def estimate(plan: Plan, say: Callable[[str], None], samples: int = SAMPLES) -> Estimate:
    """Make some scenes of a plan, spread over its numbers, in a folder that is removed."""
    count = min(samples, plan.count)
    numbers = sorted({int((k + 0.5) * plan.count / count) for k in range(count)})
    scenes, failed = [], []
    child = Child(1)
    try:
        for recipe in recipes(plan, numbers):
            try:
                scenes.append(_trial(recipe, child, plan.running.timeout, say))
            except _Failed as problem:
                failed.append(f"scene {recipe.name}: {problem}")
                say(f"  {failed[-1]}")
    finally:
        child.end()
    return Estimate(plan.count, tuple(scenes), tuple(failed))


def _trial(recipe: Recipe, child: Child, timeout: float, say: Callable[[str], None]) -> Trial:
    """Return what a whole scene takes."""

    def make(thin: float) -> Trial:
        return _made(thinned(recipe, thin), child, timeout)

    few = make(THIN) if _has_pulses(recipe) else None
    share = 1.0 if few is None else max(1.0, THIN * few.points / ENOUGH)
    found = make(share) if share > 2.0 else make(1.0)
    how = ""
    if few is not None and share > 2.0:
        how = f" (from {few.points + found.points:,.0f})"
        found = found.at(few, share * found.points)
    say(
        f"  scene {recipe.name}: {sum(found.seconds.values()):.1f} s of CPU, {found.points:,.0f} points"
        f"{how}, {found.size / 1e6:.1f} MB"
    )
    return found


def _made(recipe: Recipe, child: Child, timeout: float) -> Trial:
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        outcome: Outcome = child.make(root, asdict(recipe), timeout, _machine_memory())
        if outcome.kind != "done":
            raise _Failed(outcome.why)
        done = disk.read_scene(root / disk.SCENES / recipe.name)
        assert done is not None
        return Trial(outcome.seconds, float(sum(done.record["points"].values())), float(done.size))


def _has_pulses(recipe: Recipe) -> bool:
    return any(KINDS[one["kind"]].thinned for one in recipe.scene.get("sensors", []))


def thinned(recipe: Recipe, share: float) -> Recipe:
    """The scene with one of so many pulses of every scanner."""
    scene = copy.deepcopy(recipe.scene)
    settings = recipe.settings()
    for table, sensor in zip(scene.get("sensors", []), settings.sensors, strict=True):
        thin = kind_of(sensor).thinned
        table |= {} if thin is None else thin(sensor, share)
    return replace(recipe, scene=scene)


def tell(found: Estimate, say: Callable[[str], None]) -> None:
    """Say what a dataset will cost."""
    if not found.scenes:
        say("no trial scene could be made")
        return
    spread = float(found.seconds.std() / max(found.seconds.mean(), 1e-9))
    cores = os.cpu_count() or 1
    say(
        f"{found.count:,} scenes: {found.core_hours:.2f} core-hours (±{spread:.0%} from scene to scene), "
        f"{found.core_hours / cores:.2f} h on the {cores} cores here"
    )
    say(f"{found.size * found.count / 1e9:.2f} GB; {found.points * found.count:,.0f} points")
    total = sum(found.stages.values())
    shares = (f"{name} {value / total:.0%}" for name, value in found.stages.items())
    say("time by stage: " + ", ".join(shares))
    hours = found.boreal_hours
    if hours is not None:
        say(
            f"as many points as Boreal3D (1,000 plots, 35.3 billion points) from such plots: {hours:.0f} "
            "core-hours"
        )
