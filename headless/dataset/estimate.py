"""Cost of a dataset: scenes of the plan made for a trial, timed, weighed, and thrown away.

Which scenes are tried goes by what they are likely to cost, from their pulses, pings and trees: each in
proportion to that (systematic sampling with unequal probabilities, Hansen & Hurwitz 1943), so that the
heaviest are among them and the sum is unbiased however wrong the guess is. The interval is Student's of the
trials' shares.

Scenes of many million points are not made whole: with a 64th of their pulses first, then with as many as
give about ``ENOUGH`` points. Seconds of the stages that go with points, and bytes, are taken to be a fixed
part and a part for each point, which both trials tell; fewer pulses lie less near each other, for the rays
and in the files, so this errs to the costly side. Seconds are CPU time, so that a loaded machine tells nearly
the same.
"""

from __future__ import annotations

import contextlib
import copy
import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from forest_addon.sensing.kinds import KINDS, kind_of

from ..command import IncompleteError
from . import disk
from .engine import SceneJob, Worker, machine_memory
from .plan import Plan, Recipe, recipes
from .settings import Running

SAMPLES = 5
CONSIDERED = 400  # scenes of a plan, evenly spread, whose cost is guessed
SCENE, TREE, VARIANT = (
    2.0,
    0.02,
    0.5,
)  # guessed seconds of any scene, of a tree in it, of a tree that grows
SURE = 0.9  # of the interval
THIN = 64  # of every how many pulses a first trial has one
ENOUGH = 1_000_000  # points of the second
BOREAL = (1000, 35.3e9)  # plots and points of Boreal3D (2025)
BY_POINT = ("sensors", "write", "occlusion", "digest")


@dataclass(frozen=True)
class Trial:
    """One scene: CPU seconds of each stage, points, bytes, and bytes of memory at most."""

    seconds: dict[str, float]
    points: float
    size: float
    peak: float = 0.0

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
        size, peak = grown(self.size, other.size), grown(self.peak, other.peak)
        return Trial(seconds, points, size, peak)


@dataclass(frozen=True)
class Estimate:
    """Cost of a whole dataset: how many scenes, and whole scenes as trials tell them.

    stands_for : how many scenes each trial stands for; (): alike many.
    """

    count: int
    scenes: tuple[Trial, ...]
    stands_for: tuple[float, ...] = ()

    @property
    def weights(self) -> np.ndarray:
        """(S,) how many scenes each trial stands for."""
        alike = (self.count / max(len(self.scenes), 1),) * len(self.scenes)
        return np.array(self.stands_for or alike)

    @property
    def seconds(self) -> np.ndarray:
        """(S,) CPU seconds of each scene."""
        return np.array([sum(one.seconds.values()) for one in self.scenes])

    @property
    def stages(self) -> dict[str, float]:
        """Seconds of all scenes by stage, the longest first."""
        total: dict[str, float] = {}
        for weight, one in zip(self.weights.tolist(), self.scenes, strict=True):
            for name, value in one.seconds.items():
                total[name] = total.get(name, 0.0) + weight * value
        return dict(sorted(total.items(), key=lambda pair: -pair[1]))

    @property
    def points(self) -> float:
        """Mean points of a scene."""
        return float(self.weights @ [one.points for one in self.scenes]) / self.count

    @property
    def size(self) -> float:
        """Mean bytes of a scene."""
        return float(self.weights @ [one.size for one in self.scenes]) / self.count

    @property
    def peak(self) -> float:
        """Bytes of memory that a worker needs for the largest of the trials; 0 where that is not known."""
        return max((one.peak for one in self.scenes), default=0.0)

    @property
    def core_hours(self) -> float:
        """CPU time of all scenes."""
        return float(self.weights @ self.seconds / 3600)

    @property
    def interval(self) -> tuple[float, float] | None:
        """Core-hours that the whole lies between with 90 %; None of a single trial."""
        if 1 == len(self.scenes) < self.count:
            return None
        return self.whole(self.seconds / 3600, SURE)[1:]

    def whole(self, values: np.ndarray, sure: float = 0.95) -> tuple[float, float, float]:
        """Sum over all scenes of what the trials say (S,), and what it lies between with that confidence."""
        from scipy.stats import t

        shares = self.weights * values * len(self.scenes)
        half, many = 0.0, len(shares)
        if many < self.count:
            half = float(t.ppf((1 + sure) / 2, many - 1) * shares.std(ddof=1) / np.sqrt(many))
        total = float(shares.mean())
        return (
            total,
            max(total - half, float(values.sum())),
            total + half,
        )  # the trials are part of it

    @property
    def boreal_hours(self) -> float | None:
        """Core-hours of a thousand such plots with the points of Boreal3D; None without points."""
        if not self.points:
            return None
        plots, points = BOREAL
        by_point = float(self.weights @ [one.by_point for one in self.scenes])
        fixed = float(self.weights @ self.seconds - by_point) / self.count
        rate = by_point / float(self.weights @ [one.points for one in self.scenes])
        return (plots * fixed + points * rate) / 3600


def estimate(plan: Plan, say: Callable[[str], None], samples: int = SAMPLES) -> Estimate:
    """Make some scenes of a plan, by what they are likely to cost, in a folder that is removed."""
    considered = min(CONSIDERED, plan.count)
    numbers = sorted({int((k + 0.5) * plan.count / considered) for k in range(considered)})
    every = recipes(plan, numbers)
    chosen, stands_for = by_cost(np.array([guess(recipe) for recipe in every]), samples)
    scenes, weights = [], []
    worker = Worker()
    try:
        for index, weight in zip(chosen.tolist(), stands_for.tolist(), strict=True):
            recipe = every[index]
            try:
                scenes.append(_trial(recipe, worker, plan.running, say))
                weights.append(weight * plan.count / len(every))
            except IncompleteError as problem:
                say(f"  scene {recipe.name}: {problem}")
    finally:
        worker.end()
    if 0 < len(scenes) < len(chosen):  # those that failed are taken to cost as the others do
        weights = [weight * plan.count / sum(weights) for weight in weights]
    return Estimate(plan.count, tuple(scenes), tuple(weights))


def guess(recipe: Recipe) -> float:
    """Seconds that a scene may take, from its settings alone; it only chooses the trials."""
    settings = recipe.settings()
    area = float(np.prod(settings.forest.size))
    seconds = SCENE
    for planting in settings.plantings:
        trees = (
            planting.expected if planting.expected is not None else (planting.density or 0) * area
        )
        seconds += TREE * trees + VARIANT * min(planting.variants, trees)
    places = {one.sensor: one.count for one in recipe.places}
    for sensor in settings.sensors:
        with contextlib.suppress(Exception):  # a trajectory that only the scene knows
            cost = kind_of(sensor).cost(sensor, None, "embree")
            seconds += cost.seconds * places.get(sensor.name, 1)
    return seconds


def by_cost(cost: np.ndarray, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows to try, chosen in proportion to their cost (N,), and how many rows each stands for.

    A row that alone is more than its share is tried for itself, and stands for itself.
    """
    rows = np.argsort(cost, kind="stable")
    if len(cost) <= samples:
        return np.sort(rows), np.ones(len(rows))
    heavy = np.empty(0, np.int64)
    while len(heavy) < samples and cost[rows[-1]] * (samples - len(heavy)) >= cost[rows].sum():
        rows, heavy = rows[:-1], np.append(heavy, rows[-1])
    left = samples - len(heavy)
    if not left:
        return heavy, np.full(len(heavy), len(cost) / len(heavy))
    total = np.cumsum(cost[rows])
    chosen = rows[np.searchsorted(total, (np.arange(left) + 0.5) / left * total[-1])]
    weight = total[-1] / (left * cost[chosen])
    return np.append(heavy, chosen), np.append(np.ones(len(heavy)), weight)


def _trial(recipe: Recipe, worker: Worker, running: Running, say: Callable[[str], None]) -> Trial:
    """Cost of a whole scene."""

    def make(thin: float) -> Trial:
        return _made(thinned(recipe, thin), worker, running)

    few, share, how = None, 1.0, ""
    if any(KINDS[one["kind"]].thinned for one in recipe.scene.get("sensors", [])):
        few = make(THIN)
        share = THIN * few.points / ENOUGH
    whole = make(share if share > 2.0 else 1.0)
    if few is not None and share > 2.0:
        how = f" (from {few.points + whole.points:,.0f})"
        whole = whole.at(few, share * whole.points)
    say(
        f"  scene {recipe.name}: {sum(whole.seconds.values()):.1f} s of CPU, {whole.points:,.0f} points"
        f"{how}, {whole.size / 1e6:.1f} MB"
    )
    return whole


def _made(recipe: Recipe, worker: Worker, running: Running) -> Trial:
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        outcome = worker.once(SceneJob(root, recipe, running, machine_memory(), 1))
        if outcome.kind != "done":
            raise IncompleteError(outcome.why)
        done = disk.read_scene(root / disk.SCENES / recipe.name)
        points = float(sum(done.record["points"].values()))
        return Trial(outcome.seconds, points, float(done.size), outcome.peak)


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
    cores = os.cpu_count() or 1
    interval = found.interval
    between = "" if interval is None else f" ({interval[0]:.2f} to {interval[1]:.2f} with 90 %)"
    say(
        f"{found.count:,} scenes: {found.core_hours:.2f} core-hours{between}, "
        f"{found.core_hours / cores:.2f} h on the {cores} cores here"
    )
    memory = f"; up to {found.peak / 1e9:.2f} GB of memory a worker" if found.peak else ""
    size, points = found.size * found.count / 1e9, found.points * found.count
    say(f"{size:.2f} GB on the disk{memory}; {points:,.0f} points")
    total = sum(found.stages.values())
    shares = (f"{name} {value / total:.0%}" for name, value in found.stages.items())
    say("time by stage: " + ", ".join(shares))
    hours = found.boreal_hours
    if hours is not None:
        say(
            f"as many points as Boreal3D (1,000 plots, 35.3 billion points) from such plots: {hours:.0f} "
            "core-hours"
        )
