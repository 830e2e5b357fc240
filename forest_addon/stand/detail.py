"""How fine the leaves of each tree must be, by the sensors of a scene and how far it stands from them.

A tree whose leaves no sensor can tell apart is shown by a coarser variant of itself: a quarter of its leaves,
each twice as long (``thin_leaves``), or a shoot of fewer, wider blades. Gap fraction and projected area stay
within 2 %. A scanner cannot tell them where what it resolves, the larger of its beam's footprint and of the
distance between neighbouring pulses, is longer than a coarse leaf. A sonar cannot where so many coarse leaves
sound together, in the beam within half a pulse, that their sum is as random as before, and where the energy
that they send back is the same: of N leaves it varies by 1/N of its square more than of many. Trees beyond a
sensor's range do not concern it. What comes in are the full variants, what goes out is which trees are far.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np

from ..acoustics.disc import backscatter
from ..growth.tree import Tree, leaves_left
from ..spec import (
    Airborne,
    Mobile,
    Reverb,
    Scanner,
    Scene,
    Sonar,
    Species,
    Terrestrial,
    Tractor,
)
from .plan import Stand

COARSE = 1000  # added to a variant's number; a planting has at most as many
SHARE = 0.25  # of the leaves, and of a shoot's blades, that a coarse variant has
BOUND = 0.02  # on gap fraction and projected area of a coarse variant
TOGETHER = 50  # coarse leaves that must sound as one
LOUDNESS = 0.05  # the energy that coarse leaves may send back more or less, as a share
SOUND = 340.0  # m/s, rounded: N is a matter of factors
ORIENTATIONS = 500

Key = tuple[int, int]
Watcher = Tractor | Terrestrial | Mobile | Airborne | Sonar


@dataclass(frozen=True)
class Detail:
    """far : (N,) bool, trees shown by their coarse variants. notes : the decision in sentences."""

    far: np.ndarray
    notes: tuple[str, ...] = ()


def coarse_species(species: Species) -> Species | None:
    """The species with coarser leaves; None where it has none (its leaves come from a template)."""
    if species.template is not None or not species.leaf.on:
        return None
    return species.changed(detail=species.detail.changed(leaves=species.detail.leaves * SHARE))


def with_coarse(
    scene: Scene,
    species: Sequence[Species],
    stand: Stand,
    variants: dict[Key, Tree],
    grow: Callable[[int, int, Species], Tree],
) -> tuple[Stand, dict[Key, Tree], Detail]:
    """The stand with coarse variants where trees are far, those variants that then occur, and the decision.

    grow : a tree of a planting and variant, by numbers, of a species in place of the planting's own.
    """
    detail = decide(scene, species, stand, variants)
    stand = replace(stand, variant=np.where(detail.far, stand.variant + COARSE, stand.variant))
    occur = sorted({(int(s), int(v)) for s, v in zip(stand.species, stand.variant, strict=True)})
    grown: dict[Key, Tree] = {}
    for planting, variant in occur:
        coarse = coarse_species(species[planting]) if variant >= COARSE else None
        if coarse is None:
            grown[planting, variant] = variants[planting, variant]
        else:
            grown[planting, variant] = grow(planting, variant - COARSE, coarse)
    return stand, grown, detail


def decide(
    scene: Scene, species: Sequence[Species], stand: Stand, variants: dict[Key, Tree]
) -> Detail:
    """Return which trees are far from every sensor; none where no sensor looks, or where one may be
    anywhere."""
    trees = _trees(stand, variants, species)
    watched: list[Any] = [s for s in scene.sensors if not isinstance(s, Reverb)]
    far, notes = (trees.length > 0) & bool(watched), list[str]()
    for sensor in watched:
        path = path_of(sensor)
        if path is None:
            note = (
                f"{sensor.name} follows a way that is not known yet, so all trees have all leaves"
            )
            return Detail(np.zeros_like(far), (f"Level of detail: {note}.",))
        away = trees.distance(path)
        if isinstance(sensor, Sonar):
            blurred = _blurred(sensor, trees, away)
        else:
            blurred = resolved(sensor, away) >= trees.length
        far &= blurred | (away > reach_of(sensor))
    for sensor in watched:
        way = path_of(sensor)
        if way is not None and far.any():
            away = trees.distance(way)
            nearest = np.flatnonzero(far)[np.argmin(away[far])]
            notes.append(_note(sensor, trees, away, int(nearest)))
    made = f"{far.sum():,} of {len(far):,} trees have {SHARE:.0%} of their leaves or blades"
    bound = f"larger ones, with gap fraction and projected area within {BOUND:.0%} of all"
    return Detail(far, (f"Level of detail: {made}, {bound}.", *notes))


def _note(sensor: Watcher, trees: _Trees, away: np.ndarray, nearest: int) -> str:
    """Return how near the nearest of the far trees is to a sensor, and why that is far."""
    start = f"The nearest of them is {away[nearest]:.1f} m from {sensor.name}"
    if away[nearest] > reach_of(sensor):
        return f"{start}, beyond its range."
    if isinstance(sensor, Sonar):
        many = heard_together(sensor, trees, away)[nearest]
        louder = loudness(sensor.band, round(float(trees.radius[nearest]), 4))
        return f"{start}, where {many:.0f} sound as one, {10 * np.log10(louder):+.2f} dB."
    fine, long = 100 * resolved(sensor, away)[nearest], 100 * trees.length[nearest]
    return f"{start}, which tells {fine:.1f} cm apart there; leaves have up to {long:.1f} cm."


def reach_of(sensor: Watcher) -> float:
    """Metres beyond which a sensor finds nothing."""
    return float(getattr(sensor, "max_range", np.inf))


@dataclass(frozen=True)
class _Trees:
    """N trees as upright cylinders, and their coarse leaves."""

    place: np.ndarray  # (N, 2)
    reach: np.ndarray  # (N,) of the crown from the stem, m
    low: np.ndarray  # (N,) heights, m
    high: np.ndarray
    length: np.ndarray  # (N,) of the longest coarse leaf, m; 0: it has none
    radius: np.ndarray  # (N,) of the disc of a full leaf, m; 0 of needles
    density: np.ndarray  # (N,) coarse leaves in a cubic metre of the crown

    def distance(self, path: np.ndarray) -> np.ndarray:
        """(N,) from each tree to the nearest place of a path (P, 3), metres or less."""
        aside = np.full(len(self.place), np.inf)
        for a, b in pairwise(path if len(path) > 1 else path[[0, 0]]):
            way = b[:2] - a[:2]
            at = np.clip(((self.place - a[:2]) @ way) / max(float(way @ way), 1e-12), 0, 1)
            aside = np.minimum(aside, np.hypot(*(self.place - a[:2] - at[:, None] * way).T))
        aside = np.maximum(aside - self.reach, 0)
        lowest, highest = path[:, 2].min(), path[:, 2].max()
        over = np.maximum(np.maximum(lowest - self.high, self.low - highest), 0)
        return np.asarray(np.hypot(aside, over))


def _trees(stand: Stand, variants: dict[Key, Tree], species: Sequence[Species]) -> _Trees:
    rows = np.zeros(
        (len(stand), 5)
    )  # reach, height, length, radius, density of each tree's variant
    for (planting, variant), tree in variants.items():
        mine = (stand.species == planting) & (stand.variant == variant)
        leaves, kind = tree.leaves, coarse_species(species[planting])
        if kind is None or not len(leaves):
            continue
        wide = float(np.hypot(*tree.mesh.vertices[:, :2].T).max())
        less = leaves_left(kind) / leaves_left(species[planting])
        z = leaves.centre[:, 2]
        volume = np.pi * wide**2 * max(float(np.ptp(z)), wide)
        longest = float(leaves.length.max()) / np.sqrt(less)
        bare = 0.0 if kind.needles else float((leaves.radius**2).mean())
        rows[mine] = wide, tree.height, longest, np.sqrt(bare), less * len(leaves) / volume
    scale, z = stand.scale, stand.position[:, 2]
    reach, high, length, radius, density = rows.T
    return _Trees(
        stand.position[:, :2],
        reach * scale,
        z,
        z + high * scale,
        length * scale,
        radius * scale,
        density / scale**3,
    )


def path_of(sensor: Watcher) -> np.ndarray | None:
    """(P, 3) corners of the way of a sensor, metres; None where only Blender or a file knows it."""
    if isinstance(sensor, Mobile):
        at = np.array([pose.position for pose in sensor.poses], dtype=float)
        return None if sensor.follow or not len(at) else at
    if isinstance(sensor, Sonar) and (sensor.route or sensor.follow):
        return None
    start = np.array(sensor.position, dtype=float)
    if isinstance(sensor, Tractor | Airborne):
        heading = np.deg2rad(sensor.heading_deg)
        onward = np.array([np.cos(heading), np.sin(heading), 0.0]) * sensor.track
        right = np.array([np.sin(heading), -np.cos(heading), 0.0])
        many = sensor.strips if isinstance(sensor, Airborne) else 1
        aside = sensor.spacing if isinstance(sensor, Airborne) else 0.0
        starts = [start + k * aside * right for k in range(many)]
        return np.concatenate([[s, s + onward][:: 1 - 2 * (k % 2)] for k, s in enumerate(starts)])
    return start[None]


def resolved(sensor: Scanner | Tractor, away: np.ndarray) -> np.ndarray:
    """(N,) the smallest thing that a scanner tells apart at distances (N,), metres."""
    if isinstance(sensor, Tractor):
        return np.minimum(sensor.step * (1 + sensor.gap), np.deg2rad(sensor.angle_step_deg) * away)
    beam = sensor.beam
    wide = beam.exit_diameter**2 + (1e-3 * min(beam.divergence_mrad) * away) ** 2
    footprint = np.sqrt(wide) if beam.subrays > 1 else np.zeros(len(away))
    apart = np.zeros(len(away))
    if isinstance(sensor, Terrestrial):
        steepest = max(abs(angle) for angle in sensor.elevation_deg)
        across = np.deg2rad(sensor.angle_step_deg) * np.cos(np.deg2rad(min(steepest, 60.0)))
        apart = min(across, np.deg2rad(sensor.line_step_deg or sensor.angle_step_deg)) * away
    return np.asarray(np.maximum(footprint, apart))


def heard_together(sensor: Sonar, trees: _Trees, away: np.ndarray) -> np.ndarray:
    """(N,) coarse leaves in the beam within half a pulse, at the distances of trees (N,)."""
    low, high = sensor.band
    deep = SOUND / (2 * max(high - low, 1.0))
    wide = np.deg2rad(min(sensor.beam_width_deg)) if sensor.beam == "gaussian" else np.deg2rad(10.0)
    across = np.minimum(away * wide, 2 * trees.reach)
    return np.asarray(trees.density * np.pi / 4 * across**2 * np.minimum(deep, trees.reach))


def _blurred(sensor: Sonar, trees: _Trees, away: np.ndarray) -> np.ndarray:
    if not sensor.leaves:
        return np.ones(len(away), dtype=bool)
    many = heard_together(sensor, trees, away) >= TOGETHER
    sizes, which = np.unique(np.round(trees.radius, 4), return_inverse=True)
    louder = np.array([loudness(sensor.band, float(size)) for size in sizes])
    return many & (np.abs(louder - 1) <= LOUDNESS)[which] & (trees.radius > 0)


@cache
def loudness(band: tuple[float, float], radius: float) -> float:
    """Energy that coarse discs send back over that of full ones of this radius, metres, facing all ways."""
    t = (np.arange(ORIENTATIONS) + 0.5) / ORIENTATIONS
    angle = np.pi / 2 * t**2  # close together straight on, where a large disc glints
    weight = np.sin(angle) * t
    k = 2 * np.pi * np.linspace(*band, 15) / SOUND

    def energy(a: float) -> float:
        return float((weight * (backscatter((k * a)[:, None], angle) / k[:, None]) ** 2).sum())

    return SHARE * energy(radius / np.sqrt(SHARE)) / max(energy(radius), 1e-300)
