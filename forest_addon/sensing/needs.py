"""What of a forest the sensors of a scene can tell apart, where ``[accuracy] detail = "auto"``.

A forest goes in as it is set, and comes out with no more than its sensors need:

- Leaves, where no sensor meets or hears any: of a scene of reverbs whose model knows no leaves, and of
  variants that all stand beyond the range of every sensor. Nothing that is measured changes.
- Tubes of branches, where nothing but beams of some width look at them: within a tenth of the narrowest
  footprint w(R)² = d² + (θR)² that meets a tree of that variant, R the distance to the cylinder around the
  tree. A surface is off by that at most, along its normal, and its silhouette by a tenth of a beam.

What must be known exactly, as the phase of sound at wood, is left as it is set. Trunks that a response
does not hear are left out by the response itself (``reverb/weak``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from ..growth.tree import Tree, with_tolerance, without_leaves
from ..spec import (
    Airborne,
    Mobile,
    Reverb,
    Scanner,
    Scene,
    Sensor,
    Sonar,
    Species,
    Terrestrial,
    Tractor,
)
from ..stand.forest import Forest, grow_forest
from ..stand.inputs import Inputs
from .choice import Choice

SHARE = 0.1  # of a footprint that a tube may be off by
WORTH = 1.5  # times the tolerance that is set: less is not worth another mesh
FEWER = 0.9  # of the triangles: nor is one with more
STEP = 1.0  # m between points of a way

Planted = tuple[Species, Any]  # and its templates
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class _Reach:
    """Where a sensor is and how far it reaches: points (P, 3), None where that is not known before it runs;
    ``slack`` m between the points of a way at most; ``range`` m.
    """

    sensor: Sensor
    points: np.ndarray | None
    slack: float
    range: float

    def distance(self, low: np.ndarray, high: np.ndarray, radius: float) -> float:
        """Metres to the nearest of upright cylinders, whose feet are ``low`` (T, 3) and tops ``high``
        (T, 3): at least so far."""
        if self.points is None:
            return 0.0
        nearest = np.inf
        for place in self.points:
            beside = np.hypot(*(low[:, :2] - place[:2]).T) - radius
            above = np.maximum(low[:, 2] - place[2], place[2] - high[:, 2])
            away = np.hypot(np.maximum(beside, 0.0), np.maximum(above, 0.0))
            nearest = min(nearest, float(away.min(initial=np.inf)))
        return max(nearest - self.slack, 0.0)


def grow_needed(
    scene: Scene,
    planted: Sequence[Planted],
    progress: Progress | None = None,
    inputs: Inputs | None = None,
) -> tuple[Forest, tuple[Choice, ...]]:
    """``grow_forest``, with no more than the scene's sensors need where that is left to them."""
    wanted, first = planted_for(scene, planted)
    forest, then = forest_for(scene, grow_forest(scene, wanted, progress, inputs))
    return forest, first + then


def planted_for(
    scene: Scene, planted: Sequence[Planted]
) -> tuple[list[Planted], tuple[Choice, ...]]:
    """Species to grow, without leaves where no sensor of the scene takes notice of them."""
    if scene.accuracy.detail != "auto" or not scene.sensors:
        return list(planted), ()
    if any(_meets_leaves(sensor) for sensor in scene.sensors):
        return list(planted), ()
    bare = [
        (species.changed(detail=replace(species.detail, leaves=0.0)), *rest)
        for species, *rest in planted
    ]
    why = "of anything: no sensor of this scene meets or hears a leaf"
    return bare, (Choice("detail.leaves", 0.0, 0.0, why),)


def forest_for(scene: Scene, forest: Forest) -> tuple[Forest, tuple[Choice, ...]]:
    """A grown forest with no more than the scene's sensors need, and what was chosen."""
    if scene.accuracy.detail != "auto" or not scene.sensors:
        return forest, ()
    reaches = [_reach_of(sensor) for sensor in scene.sensors]
    variants, made = dict(forest.variants), {}
    unseen = {key for key, tree in variants.items() if _beyond(forest, key, tree, reaches)}
    bared = [key for key in unseen if len(variants[key].leaves)]
    for key in bared:
        variants[key] = without_leaves(variants[key])
    for key, tree in variants.items():
        tolerance = _tolerance(forest, key, tree, reaches)
        if tolerance is not None:
            coarse = with_tolerance(tree, tolerance)
            if len(coarse.mesh.triangles) <= FEWER * len(tree.mesh.triangles):
                variants[key], made[key] = coarse, tolerance
    choices = []
    if bared:
        trees = sum(int(_rows(forest, key).sum()) for key in bared)
        leaves = sum(len(forest.variants[key].leaves) for key in bared)
        why = (
            f"of anything: {trees:,} trees of {len(bared):,} variants stand beyond the range of every "
            f"sensor and bear no leaves ({leaves:,} a set of variants)"
        )
        choices.append(Choice("detail.leaves", 0.0, 0.0, why))
    species = list(forest.species)
    for planting, label in enumerate(forest.labels):
        mine = {key: t for key, t in made.items() if key[0] == planting}
        if not mine:
            continue
        coarsest = max(mine.values())
        detail = replace(species[planting].detail, tolerance=coarsest)
        species[planting] = species[planting].changed(detail=detail)
        before, after = (
            sum(len(of[key].mesh.triangles) for key in mine) for of in (forest.variants, variants)
        )
        why = (
            f"along the normal of {label}'s branches, a tenth of the narrowest beam that meets them; "
            f"{after:,} triangles in place of {before:,}"
        )
        choices.append(Choice("detail.tolerance", coarsest, coarsest, why, unit="m"))
    return replace(forest, variants=variants, species=tuple(species)), tuple(choices)


def _meets_leaves(sensor: Sensor) -> bool:
    """Whether a leaf may change what a sensor finds."""
    if isinstance(sensor, Reverb):
        return sensor.model == "forest"
    if isinstance(sensor, Sonar):
        return sensor.leaves or "extinction" in sensor.shading
    return True


def _reach_of(sensor: Any) -> _Reach:
    if isinstance(sensor, Reverb):  # trunks are heard from any distance, leaves of the whole field
        return _Reach(sensor, None, 0.0, np.inf)
    if isinstance(sensor, Sonar):
        stays = not (sensor.route or sensor.follow)
        points = np.array([sensor.position]) if stays else None
        return _Reach(sensor, points, 0.0, sensor.max_range)
    if isinstance(sensor, Terrestrial):
        return _Reach(sensor, np.array([sensor.position]), 0.0, sensor.max_range)
    if isinstance(sensor, Mobile):
        if sensor.follow or not sensor.poses:
            return _Reach(sensor, None, 0.0, sensor.max_range)
        ways = np.array([pose.position for pose in sensor.poses])
        return _Reach(sensor, _along(ways), STEP / 2, sensor.max_range)
    heading = np.deg2rad(sensor.heading_deg)
    forward = np.array([np.cos(heading), np.sin(heading), 0.0])
    right = np.array([np.sin(heading), -np.cos(heading), 0.0])
    strips, apart = (sensor.strips, sensor.spacing) if isinstance(sensor, Airborne) else (1, 0.0)
    start = np.array(sensor.position) + apart * np.arange(strips)[:, None] * right
    points = np.concatenate([_along(np.stack([a, a + sensor.track * forward])) for a in start])
    wide = sensor.step if isinstance(sensor, Tractor) else 0.0  # a beam is as wide as a step
    return _Reach(sensor, points, STEP / 2 + wide, sensor.max_range)


def _along(way: np.ndarray) -> np.ndarray:
    """Points (P, 3) on a line through places (K, 3), no two neighbours more than STEP apart."""
    parts = [way[:1]]
    for a, b in pairwise(way):
        count = max(1, int(np.ceil(np.linalg.norm(b - a) / STEP)))
        parts.append(a + np.linspace(0, 1, count + 1)[1:, None] * (b - a))
    return np.concatenate(parts)


def _footprint(sensor: Sensor, distance: float) -> float:
    """Metres across the narrowest that a beam is at a distance or beyond; 0: a line."""
    if isinstance(sensor, Tractor):
        step, turn = sensor.step, np.deg2rad(sensor.angle_step_deg)
        return min(step, distance * float(turn)) if sensor.splits else 0.0
    if not isinstance(sensor, Scanner) or sensor.beam.subrays == 1:
        return 0.0
    spread = min(sensor.beam.divergence_mrad) * 1e-3 * max(distance, sensor.min_range)
    return float(np.hypot(sensor.beam.exit_diameter, spread))


def _tolerance(
    forest: Forest, key: tuple[int, int], tree: Tree, reaches: Sequence[_Reach]
) -> float | None:
    """Metres that a variant's tubes may be off by, None where they stay as they are."""
    today = forest.species[key[0]].detail.tolerance
    if tree.grafted or not len(tree.skeleton):
        return None  # its mesh is a template's
    widths = []
    for reach in reaches:
        if isinstance(reach.sensor, Reverb) or (
            isinstance(reach.sensor, Sonar)
            and (reach.sensor.wood or "trunks" in reach.sensor.shading)
        ):
            return None
        if not isinstance(reach.sensor, Sonar):
            away = reach.distance(*_cylinders(forest, key, tree))
            widths.append(_footprint(reach.sensor, away) if away <= reach.range else np.inf)
    finest = min(widths, default=0.0)
    if not np.isfinite(finest):  # no beam gets there
        return None
    scale = float(forest.stand.scale[_rows(forest, key)].max(initial=1.0))
    tolerance = SHARE * finest / scale
    return tolerance if tolerance > WORTH * today else None


def _beyond(forest: Forest, key: tuple[int, int], tree: Tree, reaches: Sequence[_Reach]) -> bool:
    """Whether no sensor that takes notice of leaves reaches any tree of a variant."""
    place = _cylinders(forest, key, tree)
    return all(
        not _meets_leaves(reach.sensor) or reach.distance(*place) > reach.range for reach in reaches
    )


def _rows(forest: Forest, key: tuple[int, int]) -> np.ndarray:
    """(N,) which trees are of a variant."""
    rows: np.ndarray = (forest.stand.species == key[0]) & (forest.stand.variant == key[1])
    return rows


def _cylinders(
    forest: Forest, key: tuple[int, int], tree: Tree
) -> tuple[np.ndarray, np.ndarray, float]:
    """Feet and tops (T, 3) of upright cylinders around the trees of a variant, and the widest radius."""
    rows = _rows(forest, key)
    scale = forest.stand.scale[rows]
    place = forest.transforms()[rows][:, :, 3]
    points = tree.mesh.vertices
    up = np.array([0.0, 0.0, 1.0])
    low = place + np.outer(scale * float(points[:, 2].min(initial=0.0)), up)
    high = place + np.outer(scale * float(points[:, 2].max(initial=0.0)), up)
    radius = float(np.hypot(points[:, 0], points[:, 1]).max(initial=0.0))
    return low, high, radius * float(scale.max(initial=0.0))
