"""Likeness of siblings to their template, as a forester, a scanner and a bat see it: a table.

To the portrait of each tree (``growth.likeness``) come, with the sensors of this project, an airborne scan
straight down on a grid (heights of first returns; share of pulses within the crown's circle that reach the
ground) and the echo of its leaves, or bare wood, from all sides.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from forest_addon.base.progress import Say
from forest_addon.base.trimesh import GROUND, TriMesh
from forest_addon.blender.rays.casters import make_caster
from forest_addon.growth.likeness import BINS, Likeness, Portrait, compare, crown_width, portray
from forest_addon.growth.tree import Tree
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.sonar.ping import EchoTargets, ping
from forest_addon.spec import Air, Rays, Sonar

PULSES = 128  # along a side of the grid
SIDES = 12  # from which a sonar pings at each sibling
OF_TEMPLATE = 48  # and at the template, of which there is one only
AWAY = 6.0  # metres between the sonar and the crown's edge


def portray_with_sensors(tree: Tree, sides: int = SIDES) -> Portrait:
    """The portrait of a tree, with what a scanner and a sonar find.

    sides : from which the sonar pings. A few leaves that face it make a flash, so the mean of 12 sides
        is uncertain by more than a decibel.
    """
    portrait = portray(tree)
    scene = _alone(tree)
    gap, profile = _scan_from_above(tree, scene)
    levels = _echo_levels(tree, scene, sides)
    numbers = {
        **portrait.numbers,
        "gap fraction from above": gap,
        "echo level, dB": float(levels.mean()),
        "its spread over all sides, dB": float(levels.std(ddof=1)),
    }
    return replace(
        portrait, numbers=numbers, profiles={**portrait.profiles, "first returns": profile}
    )


def tell_likeness(found: Likeness, siblings: int, sensed: int, say: Say) -> None:
    """Print the table. sensed : how many of the siblings the sensors looked at."""
    say(f"\n{siblings} siblings against the tree, {sensed} of them with sensors:")
    say(f"  {'':<38}{'tree':>9}{'siblings':>10}{'differ':>9}{'spread':>8}{'away':>6}")
    for row in found.numbers:
        decibels = row.name.endswith("dB")
        apart = (
            f"{row.mean - row.template:+.1f} dB" if decibels else f"{100 * row.difference:+.1f} %"
        )
        spread = f"{row.spread:.1f} dB"
        if not decibels:
            spread = f"{100 * row.spread / abs(row.template):.0f} %" if row.template else "-"
        say(
            f"  {row.name:<38}{row.template:>9.4g}{row.mean:>10.4g}{apart:>9}{spread:>8}"
            f"{row.spreads:>6.1f}"
        )
    say(f"\n  {'distributions':<38}{'tree':>9}{'siblings':>10}{'KS':>9}{'earth mover':>14}")
    for sample in found.samples:
        say(
            f"  {sample.name:<38}{sample.template:>9.4g}{sample.mean:>10.4g}"
            f"{sample.kolmogorov:>9.2f}{sample.mover:>14.3g}"
        )
    say(f"\n  {'profiles over height':<38}{'overlap':>9}{'of one sibling':>19}")
    for profile in found.profiles:
        say(f"  {profile.name:<38}{profile.overlap:>9.2f}{profile.single:>19.2f}")
    missed = ", ".join(found.missed)
    goals = "means within 10 %, overlap at least 0.85, the tree within 2 spreads of its siblings"
    say(f"\n  Goals ({goals}): " + (f"missed by {missed}" if missed else "all met"))


def _alone(tree: Tree) -> SceneGeometry:
    """A tree on a wide ground."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 100.0
    ground = TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), GROUND)
    return SceneGeometry(
        meshes=(tree.mesh, ground),
        transform=np.tile(np.eye(3, 4), (2, 1, 1)),
        mesh_index=np.arange(2),
        object_name=("tree", "ground"),
        tree=np.array([0, -1]),
        species=np.array([0, -1]),
    )


def _scan_from_above(tree: Tree, scene: SceneGeometry) -> tuple[float, np.ndarray]:
    """Share of pulses in the crown's circle that reach the ground, and shares of first returns by height."""
    points = tree.leaves.centre if len(tree.leaves) else tree.skeleton.end
    middle, radius = np.median(points[:, :2], axis=0), crown_width(tree) / 2
    step = (np.arange(PULSES) + 0.5) / PULSES * 2 - 1
    x, y = (grid.ravel() for grid in np.meshgrid(step, step))
    inside = np.hypot(x, y) <= 1
    origins = np.column_stack([x[inside], y[inside], np.zeros(inside.sum())]) * radius
    origins[:, :2] += middle
    origins[:, 2] = tree.height + 1.0
    down = np.tile([0.0, 0.0, -1.0], (len(origins), 1))
    hits = make_caster(scene, Rays(threads=1)).cast(origins, down, tree.height + 2.0)
    met = hits.instance == 0
    height = origins[met, 2] - hits.distance[met]
    bins = np.clip((height / tree.height * BINS).astype(np.int64), 0, BINS - 1)
    counts = np.bincount(bins, minlength=BINS)
    return float(1 - met.mean()), counts / max(counts.sum(), 1)


def _echo_levels(tree: Tree, scene: SceneGeometry, sides: int) -> np.ndarray:
    """(sides,) dB of the mean power in the band, re the sent one at 1 m."""
    points = tree.leaves.centre if len(tree.leaves) else tree.skeleton.end
    middle = np.median(points, axis=0)
    away = crown_width(tree) / 2 + AWAY
    targets, levels = EchoTargets(scene), []
    for side in 2 * np.pi * np.arange(sides) / sides:
        place = middle - away * np.array([np.cos(side), np.sin(side), 0.0])
        sonar = Sonar(
            position=tuple(place.tolist()),
            azimuth_deg=float(np.rad2deg(side)),
            elevation_deg=0.0,
            beam_width_deg=(30.0, 30.0),
            wood=not len(tree.leaves),
            facets=False,
            leaf_model="piston",
            tolerance=1e-3,
            cull=0.01,
            shading="none",
        )
        echo = ping(targets, sonar, Air())
        levels.append(10 * np.log10(max(float((np.abs(echo.spectrum) ** 2).mean()), 1e-30)))
    return np.array(levels)


def add_sensors(found: Likeness, template: Tree, siblings: Iterable[Tree]) -> Likeness:
    """A comparison with what sensors find added; each sibling is let go before the next is grown."""
    itself = portray_with_sensors(template, OF_TEMPLATE)
    seen = compare(itself, [portray_with_sensors(tree) for tree in siblings])
    numbers, profiles = ({row.name for row in rows} for rows in (found.numbers, found.profiles))
    return Likeness(
        found.numbers + tuple(row for row in seen.numbers if row.name not in numbers),
        found.samples,
        found.profiles + tuple(row for row in seen.profiles if row.name not in profiles),
    )
