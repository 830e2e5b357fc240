"""Flights of 500 m through Poisson forests, beside how fast the theory lets a bird go at all.

Karaman & Frazzoli's bird (v ahead, at most w across) flies among upright trunks by the gap policy on a LiDAR
of 64 rays, as in ``ForestSensing/Poisson-v0``; the share that comes through is held against speed and
density. Beside it: the share of forests in which any way of that slope comes through (``theory``),
whatever the policy, and the speed at which that is a half.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import rc_context

from ..inside import (
    BODY,
    FAINT,
    INK,
    LIDAR,
    LINES,
    SIDEWAYS,
    STYLE,
    TRUNK,
    Flyers,
    Gap,
    LidarSense,
    Track,
    fly,
    interval,
    new_figure,
    poisson_forests,
    save_figure,
    stream,
    write_csv,
)
from .theory import chance_of_way, critical_slope

LENGTH = 500.0  # metres
LANE = 60.0  # metres of a forest's width for each flight
SPEEDS = (2.0, 4.0, 6.0, 9.0, 13.0)
DENSITIES = (0.05, 0.1, 0.15, 0.25)  # trees/m²
FLIGHTS = 100  # of a cell
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
        shares = " | ".join(
            f"{through(c)} ({100 * ends(c)[0]:.0f} to {100 * ends(c)[1]:.0f} %)" for c in mine
        )
        say(f"| {density:g} | {shares} | {critical[density]:.0f} m/s |")
    reach = TRUNK + BODY
    kappa = {d: v * d * reach**2 / SIDEWAYS for d, v in critical.items()}
    say("v_c·ρR²/w: " + ", ".join(f"{k:.2f} at {d:g}" for d, k in kappa.items()))
    write_csv(
        out / "speed.csv",
        {
            "speed_m_s": [c.speed for c in cells],
            "trees_per_m2": [c.density for c in cells],
            "flights": [len(c.tracks) for c in cells],
            "arrived": [through(c) for c in cells],
            "share_low": [round(ends(c)[0], 3) for c in cells],
            "share_high": [round(ends(c)[1], 3) for c in cells],
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
    return through(cell) / len(cell.tracks)


def through(cell: SpeedCell) -> int:
    """Number that come through."""
    return sum(t.end == "arrived" for t in cell.tracks)


def ends(cell: SpeedCell) -> tuple[float, float]:
    """Interval of 95 % of the share."""
    return interval(through(cell), len(cell.tracks))


def flown(speed: float, density: float, flights: int, seed: int) -> list[Track]:
    """Flights of one speed through one forest of one density, so wide that few ever see the same trunks."""
    forests = poisson_forests(density, speed, LENGTH)
    forests.width = LANE * flights
    lidar = LidarSense(LIDAR)
    flyers = Flyers(forests.flight, flights, lidar, None)
    flyers.enter(forests.surroundings(seed))
    return fly(flyers, Gap(forests.flight, lidar), [seed + n for n in range(flights)], seed)


def draw(path: Path, cells: list[SpeedCell], exist: dict, critical: dict) -> Path:
    """Shares against speed by density, flown and possible; and the critical speed against density."""
    with rc_context(STYLE):
        figure, (left, right) = new_figure(2, (11, 4.4), width_ratios=(3, 2))
        for colour, density in zip(LINES, DENSITIES, strict=False):
            mine = [c for c in cells if c.density == density]
            share = np.array([arrived(c) for c in mine])
            low, high = np.array([ends(c) for c in mine]).T
            error = np.maximum([share - low, high - share], 0)
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
