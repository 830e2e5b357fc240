"""Two ears against LiDAR: success against the density of a forest, at the same rate of sensing.

The same bat flies in the same forests from the same starts, ten times a second either by 64 rays and the gap
policy, or by one ping of two ears and the echo policy; a third sees nothing and flies straight on.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib import rc_context

from forest_addon.api import Flight, Forest, Planting, Scene

from ..inside import (
    FAINT,
    LIDAR,
    LINES,
    SONAR,
    STYLE,
    EarSense,
    EchoPolicy,
    Flyers,
    Gap,
    LidarSense,
    Stock,
    Straight,
    Track,
    fly,
    hushed,
    interval,
    new_figure,
    save_figure,
)
from ..tables import write_rows

DENSITIES = (0.02, 0.05, 0.1)  # trees/m²
FLIGHTS = 12  # of a density and sense
FIELD = (50.0, 40.0)
FLIGHT = Flight(
    speed=3.0,
    slowest=0.5,
    acceleration=8.0,
    distance=20.0,
    step=0.1,
    steps=160,
    radius=0.15,
    height=1.5,
    start_low=(0.05, 0.3),
    start_high=(0.3, 0.7),
    aim="heading",
    thinnest=0.005,
)
HEARS = SONAR.changed(leaf_model="paper", wood=False, max_range=3.5, band=(60e3, 80e3))
NAMES = ("LiDAR, 64 rays", "two ears", "straight on")


def run(out: Path, size: float = 1.0, seed: int = 1, say: Callable[[str], None] = print) -> dict:
    """Fly, write ``senses.csv`` and ``senses.png``."""
    from ..inside import empty_file

    out.mkdir(parents=True, exist_ok=True)
    flights = max(2, round(FLIGHTS * size))
    scene = Scene(
        name="Two ears against LiDAR",
        seed=seed,
        flight=FLIGHT,
        forest=Forest(size=FIELD, margin=20.0),
        plantings=(Planting(species="whorl-8", variants=3, density=DENSITIES[0]),),
    )
    with hushed():
        empty_file()
        stock = Stock(scene)
    lidar, ears = LidarSense(LIDAR), EarSense(HEARS, scene.air)
    found: dict[str, list[list[Track]]] = {name: [] for name in NAMES}
    last: dict[str, list[Track]] = {}
    for density in DENSITIES:
        planting = scene.plantings[0].changed(density=density)
        stock.settings = scene.changed(
            plantings=(planting,), forest=scene.forest.changed(instancing="points")
        )
        world = stock.surroundings(seed)
        seeds = [seed + n for n in range(flights)]
        for name, sense in zip(NAMES, ((lidar, None), (None, ears), (None, None)), strict=True):
            flyers = Flyers(FLIGHT, flights, *sense)
            flyers.enter(world)
            policy = {
                NAMES[0]: Gap(FLIGHT, lidar),
                NAMES[1]: EchoPolicy(FLIGHT, ears),
                NAMES[2]: Straight(FLIGHT),
            }[name]
            tracks = fly(flyers, policy, seeds, seed)
            found[name].append(tracks)
            if density == DENSITIES[1]:
                last[name] = tracks
                there = world
        shares = ", ".join(
            f"{name} {arrived(tracks[-1]) / flights:.0%}" for name, tracks in found.items()
        )
        say(f"{density:g} trees/m²: {shares}")
    rows = [
        {"trees_per_m2": d, "sense": name, "flights": flights, "arrived": arrived(found[name][k])}
        for k, d in enumerate(DENSITIES)
        for name in NAMES
    ]
    write_rows(out / "senses.csv", rows)
    draw(out / "senses.png", found, last, there)
    say(f"Written to {out}: senses.csv, senses.png")
    return found


def arrived(tracks: list[Track]) -> int:
    """Number of flights that came through."""
    return sum(track.end == "arrived" for track in tracks)


def draw(path: Path, found: dict, last: dict, world: object) -> Path:
    """The flights in one forest, and success against density."""
    from matplotlib.collections import LineCollection

    from ..inside import TopView

    with rc_context(STYLE):
        figure, axes = new_figure(3, (13, 3.8))
        view = TopView(world)
        for ax, name, colour in zip(axes[:2], NAMES, LINES, strict=False):
            extent = (-5, FIELD[0] + 5, -5, FIELD[1] + 5)
            ax.imshow(view.picture, extent=extent)
            lines = [track.position[:, :2] for track in last[name]]
            ax.add_collection(LineCollection(lines, colors=colour, linewidths=1.1))
            ends = np.array([t.position[-1, :2] for t in last[name] if t.end == "crashed"]).reshape(
                -1, 2
            )
            ax.plot(*ends.T, "x", color="#c8442c", ms=5)
            ax.set(title=f"{name}, {DENSITIES[1]:g} trees/m²", xlabel="x, m", ylabel="y, m")
        for name, colour in zip(NAMES, LINES, strict=False):
            values = [arrived(tracks) / len(tracks) for tracks in found[name]]
            ends = np.array([interval(arrived(t), len(t)) for t in found[name]])
            error = np.maximum(np.stack([values - ends[:, 0], ends[:, 1] - values]), 0)
            axes[2].errorbar(
                DENSITIES, values, error, color=colour, marker="o", ms=4, capsize=2, label=name
            )
        axes[2].set(
            xlabel="trees/m²",
            ylabel="share that comes 20 m",
            ylim=(-0.03, 1.05),
            title="Ten times a second, 3 m/s",
        )
        axes[2].grid(color=FAINT, lw=0.4)
        axes[2].legend()
    return save_figure(figure, path)
