"""``python -m headless canopy``: leaf area index and gap fraction of a stand, seen from below."""

from __future__ import annotations

import argparse
import math

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap

from forest_addon.api import Site, World
from forest_addon.base.progress import Say
from forest_addon.drawing.figures import blank_figure, save_figure
from forest_addon.drawing.palette import BARK, LEAF_GREEN, SKY, SOIL
from forest_addon.formats.ownership import claim
from forest_addon.formats.table import write_csv, write_npz
from forest_addon.sensing.canopy import Canopy
from forest_addon.spec import Scene, SpecError

from ..command import numbers, read_scene, refuse_beyond

MOST = 100  # points along a side of the grid
SHOWN = 9  # pictures
INNER = 0.6  # of the field's width and depth, in its middle: what is seen at 75° is in the field, mostly


def run(chosen: argparse.Namespace, say: Say = print) -> Canopy:
    """Grow a scene's forest, look up from points, print and write what is seen.

    Raises
    ------
    SpecError : the scene, a point or the grid cannot be used.
    OSError : a file could not be written.
    """
    settings, out = read_scene(chosen.scene, chosen.seed), chosen.out
    refuse_beyond("--grid", chosen.grid, 1, MOST)
    claim(*(out / file for file in ("gaps.csv", "hemispheres.npz", "hemispheres.png")))
    places = [numbers("--at", text, 2, 3) for text in chosen.at or ()]
    places = places or _grid(settings, chosen.grid)
    site = Site.of(settings, chosen.scene.resolve().parent)
    # (N, 3) places, those without a height so high above the ground
    flat = np.array([place[:2] for place in places])
    ground = site.ground.height(flat)
    if not np.isfinite(ground).all():
        x, y = flat[int(np.argmin(np.isfinite(ground)))]
        raise SpecError("--at", f"there is no ground at ({x:g}, {y:g}) m; choose another point")
    own = [
        place[2] if len(place) == 3 else z + chosen.height
        for place, z in zip(places, ground, strict=True)
    ]
    points = np.column_stack([flat, own])
    world = site.build(site.grow())
    seen = world.canopy(points)
    out.mkdir(parents=True, exist_ok=True)
    for line in lines(world, seen):
        say(line)
    write_csv(
        out / "gaps.csv",
        {"zenith_deg": np.rad2deg(seen.zenith).tolist(), "gap_fraction": seen.gap.tolist()},
    )
    pictures = [world.hemisphere(point) for point in points[:SHOWN]]
    write_npz(
        out / "hemispheres.npz",
        {"point": points[:SHOWN], "picture": np.array(pictures)},
        {"point": "m"},
    )
    count = len(pictures) + 1
    columns = math.ceil(math.sqrt(count))
    rows = math.ceil(count / columns)
    figure = blank_figure((3.4 * columns, 3.5 * rows))
    colours = ListedColormap(["#ffffff", SKY, "#8d8d99", BARK, LEAF_GREEN, SOIL])
    norm = BoundaryNorm(np.arange(-2.5, 4), 6)
    for number, (picture, point) in enumerate(zip(pictures, points, strict=False)):
        axes = figure.add_subplot(rows, columns, number + 1)
        axes.imshow(picture, cmap=colours, norm=norm, interpolation="nearest")
        axes.set_axis_off()
        axes.set_title(f"({point[0]:.1f}, {point[1]:.1f}, {point[2]:.1f}) m")
    axes = figure.add_subplot(rows, columns, count)
    axes.plot(np.rad2deg(seen.zenith), seen.gap, "o-", color=LEAF_GREEN, markersize=3)
    axes.set_xlabel("zenith angle, °")
    axes.set_ylabel("gap fraction")
    axes.set_ylim(0, 1)
    save_figure(figure, out / "hemispheres.png")
    say(f"Done: gaps.csv, hemispheres.npz and hemispheres.png in {out}")
    return seen


def lines(world: World, seen: Canopy) -> list[str]:
    """Labels that were seen, and those that are true."""
    leaf, wood = world.leaf_area_index, world.wood_area_index
    told = [
        f"{seen.points} points, {seen.rays:,} rays to zenith angles of 75°",
        f"  open sky                   {seen.open:8.1%}",
        f"  effective plant area index {seen.effective:8.3f}",
        f"  true leaf area index       {leaf:8.3f}",
        f"  true wood area index       {wood:8.3f}  (half its surface)",
    ]
    if leaf + wood > 0:
        told.append(f"  clumping, effective / true {seen.effective / (leaf + wood):8.3f}")
    return told


def _grid(settings: Scene, side: int) -> list[tuple[float, ...]]:
    """Points over the middle of the field."""
    low, size = np.array(settings.forest.origin), np.array(settings.forest.size)
    share = 0.5 + INNER * ((np.arange(side) + 0.5) / side - 0.5)
    return [tuple((low + size * (x, y)).tolist()) for y in share for x in share]
