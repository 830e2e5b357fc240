"""Flights of 500 m through Poisson forests, beside how fast the theory lets a bird go at all.

Karaman & Frazzoli's bird (v ahead, at most w across) flies among upright trunks by the gap policy on a LiDAR
of 64 rays; the share that comes through is held against speed and density. Beside it: the share of forests in
which any way of that slope comes through 500 m (``theory``), which no policy can beat, and the speed
at which that is a half.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import rc_context

from forest_addon.api import Flight

from ..inside import (
    FAINT,
    INK,
    LIDAR,
    LINES,
    STYLE,
    Flyers,
    Gap,
    LidarSense,
    Track,
    fly,
    interval,
    new_figure,
    save_figure,
    stream,
    write_csv,
)
from .stems import StemWorld
from .theory import chance_of_way, critical_slope, poisson_strip

LENGTH, WIDTH = 500.0, 60.0  # metres
TRUNK, BODY = 0.20, 0.15  # metres, radii
SIDEWAYS = 2.0  # m/s, w
SPEEDS = (2.0, 4.0, 6.0, 9.0, 13.0)
DENSITIES = (0.05, 0.1, 0.15, 0.25)  # trees/m²
FLIGHTS, FOREST = 24, 12  # of a cell, of a forest
STRIPS = 16  # forests of the theory
EXISTS = np.array([4.0, 8.0, 16.0, 24.0, 32.0, 48.0, 64.0])  # m/s


@dataclass(frozen=True)
class SpeedCell:
    """Flights of one speed, m/s, and density, trees/m²."""

    speed: float
    density: float
    tracks: list[Track]


def run(
    out: Path, size: float = 1.0, seed: int = 1, say: Callable[[str], None] = print
) -> list[SpeedCell]:
    """Fly, compute, write ``speed.csv``, ``critical.csv`` and ``speed.png``."""
    out.mkdir(parents=True, exist_ok=True)
    flights = max(2, round(FLIGHTS * size))
    strips = max(2, round(STRIPS * size))
    cells, exist, critical = [], {}, {}
    for density in DENSITIES:
        for speed in SPEEDS:
            cells.append(SpeedCell(speed, density, flown(speed, density, flights, seed)))
        rng = stream(seed, "flight", "theory", str(density))
        reach = TRUNK + BODY
        exist[density] = [
            chance_of_way(rng, density, reach, SIDEWAYS / v, LENGTH, strips) for v in EXISTS
        ]
        critical[density] = SIDEWAYS / critical_slope(rng, density, reach, LENGTH, strips)
        mine = [c for c in cells if c.density == density]
        shares = ", ".join(f"{c.speed:g} m/s {arrived(c):.0%}" for c in mine)
        say(f"{density:g} trees/m²: {shares}; critical {critical[density]:.1f} m/s")
    reach = TRUNK + BODY
    kappa = {d: v * d * reach**2 / SIDEWAYS for d, v in critical.items()}
    say("v_c·ρR²/w: " + ", ".join(f"{k:.2f} at {d:g}" for d, k in kappa.items()))
    write_csv(
        out / "speed.csv",
        {
            "speed_m_s": [c.speed for c in cells],
            "trees_per_m2": [c.density for c in cells],
            "flights": [len(c.tracks) for c in cells],
            "arrived": [sum(t.end == "arrived" for t in c.tracks) for c in cells],
            "mean_way_m": [round(float(np.mean([t.flown for t in c.tracks])), 1) for c in cells],
        },
    )
    write_csv(
        out / "critical.csv",
        {
            "trees_per_m2": list(critical),
            "critical_speed_m_s": [round(v, 2) for v in critical.values()],
            "kappa": [round(v, 3) for v in kappa.values()],
        },
    )
    draw(out / "speed.png", cells, exist, critical)
    say(f"Written to {out}: speed.csv, critical.csv, speed.png")
    return cells


def arrived(cell: SpeedCell) -> float:
    """Share of its flights that come through."""
    return sum(t.end == "arrived" for t in cell.tracks) / len(cell.tracks)


def flown(speed: float, density: float, flights: int, seed: int) -> list[Track]:
    """Flights of one speed through forests of one density."""
    flight = Flight(
        body="bird",
        speed=speed,
        sideways=SIDEWAYS,
        radius=BODY,
        aim="heading",
        distance=LENGTH,
        step=0.1,
        steps=10_000,
        start_low=(0.0, 0.25),
        start_high=(0.0, 0.75),
        clearance=1.0,
    )
    lidar = LidarSense(LIDAR)
    tracks: list[Track] = []
    for first in range(0, flights, FOREST):
        some = list(range(first, min(first + FOREST, flights)))
        rng = stream(seed, "flight", "strip", str(density), first)
        place = poisson_strip(rng, density, LENGTH + 40.0, WIDTH)
        world = StemWorld(place, np.full(len(place), TRUNK), np.zeros(2), np.array([LENGTH, WIDTH]))
        flyers = Flyers(flight, len(some), lidar, None)
        flyers.enter(world)
        tracks += fly(flyers, Gap(flight, lidar), [seed + n for n in some], first)
    return tracks


def draw(path: Path, cells: list[SpeedCell], exist: dict, critical: dict) -> Path:
    """Shares against speed by density, flown and possible; and the critical speed against density."""
    with rc_context(STYLE):
        figure, (left, right) = new_figure(2, (11, 4.4), width_ratios=(3, 2))
        for colour, density in zip(LINES, DENSITIES, strict=False):
            mine = [c for c in cells if c.density == density]
            share = np.array([arrived(c) for c in mine])
            ends = np.array(
                [
                    interval(round(s * len(c.tracks)), len(c.tracks))
                    for s, c in zip(share, mine, strict=True)
                ]
            )
            error = np.maximum(np.stack([share - ends[:, 0], ends[:, 1] - share]), 0)
            speed = [c.speed for c in mine]
            left.errorbar(
                speed,
                share,
                error,
                color=colour,
                marker="o",
                ms=4,
                lw=1.4,
                capsize=2,
                label=f"{density:g} trees/m²",
            )
            possible = [a / b for a, b in exist[density]]
            left.plot(EXISTS, possible, "--", color=colour, lw=1.0)
        left.plot([], [], "--", color=INK, lw=1.0, label="a way exists (any flyer)")
        left.set(
            xlabel="speed ahead, m/s",
            ylabel="share that comes 500 m",
            ylim=(-0.03, 1.05),
            xscale="log",
            title=f"Gap policy on 64 rays, w = {SIDEWAYS:g} m/s",
        )
        ticks = [3, 5, 10, 20, 40]
        left.set_xticks(ticks, [str(t) for t in ticks])
        left.minorticks_off()
        left.grid(color=FAINT, lw=0.4)
        left.legend(fontsize=8)
        density = np.array(list(critical))
        right.loglog(
            density,
            list(critical.values()),
            "k^-",
            lw=1.2,
            ms=5,
            label="critical: half of the forests",
        )
        half = [
            np.interp(
                -0.5,
                [-arrived(c) for c in cells if c.density == d],
                SPEEDS,
                left=np.nan,
                right=np.nan,
            )
            for d in DENSITIES
        ]
        right.loglog(
            DENSITIES, half, "o-", color=LINES[0], lw=1.2, ms=4, label="gap policy: half arrive"
        )
        right.set(
            xlabel="trees/m²",
            ylabel="speed, m/s",
            title="Critical speed, Karaman & Frazzoli (2012)",
        )
        right.grid(color=FAINT, lw=0.4, which="both")
        right.legend(fontsize=8)
    return save_figure(figure, path)
