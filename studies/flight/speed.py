"""Flights of 500 m through Poisson forests, beside how fast the theory lets a bird go at all.

Karaman & Frazzoli's bird (v ahead, at most w across) flies among upright trunks by the gap policy on a LiDAR
of 64 rays, as in ``ForestSensing/Poisson-v0``; the share that comes through is held against speed and
density. Beside it: the share of forests in which any way of that slope comes through,
whatever the policy, and the speed at which that is a half.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from scipy.ndimage import maximum_filter1d

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
    poisson_strip,
    save_figure,
    stream,
)
from ..tables import write_rows

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
    write_rows(
        out / "speed.csv",
        (
            {
                "speed_m_s": c.speed,
                "trees_per_m2": c.density,
                "flights": len(c.tracks),
                "arrived": through(c),
                "share_low": round(ends(c)[0], 3),
                "share_high": round(ends(c)[1], 3),
                "mean_way_m": round(float(np.mean([t.flown for t in c.tracks])), 1),
            }
            for c in cells
        ),
    )
    write_rows(
        out / "critical.csv",
        (
            {"trees_per_m2": d, "critical_speed_m_s": round(v, 2), "kappa": round(kappa[d], 3)}
            for d, v in critical.items()
        ),
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


# Critical speed of flight through a forest (Karaman & Frazzoli 2012).
#
# Their bird flies v ahead and at most w across, among discs of a Poisson process with density ρ; R is the
# radius of disc and bird together. Whether a way without collision exists is one of directed percolation:
# above a critical speed there is none that goes on for ever, whatever the bird knows, below it there is one.
# No closed form is known; as they do, the phase diagram is found by Monte Carlo. Here the reachable set is
# followed exactly but for a grid: from x to x + Δx it grows by wΔx/v to both sides, and discs are taken out.
#
# For fast birds discs are sticks of length 2R across the way, and scaling x by w/v leaves one number,
# ρR²v/w: so the critical speed goes as v_c = κ·w/(ρR²).

GRID = 0.04  # metres across


def passable(
    position: np.ndarray, reach: np.ndarray, slope: float, length: float, width: float
) -> float:
    """Metres, at most ``length``, that some way gets through discs (N, 2) of radii (N,) without touching.

    slope : w/v. The forest repeats itself across every ``width`` metres; ways start anywhere at x = 0.
    """
    count = max(16, round(width / GRID))
    cell = width / count
    grows = max(1, int(np.ceil(0.05 * slope / cell)))
    step = grows * cell / slope  # along x, in which the set grows by whole cells
    if step > 0.5 * float(reach.min(initial=1.0)):
        step = 0.5 * float(reach.min(initial=1.0))
    grown_by = slope * step / cell
    open_ = np.ones(count, dtype=np.uint8)
    order = np.argsort(position[:, 0])
    x, y, radius = position[order, 0], position[order, 1], reach[order]
    most = float(radius.max(initial=0.0))
    owed = 0.0
    rows = np.searchsorted(x, np.arange(0.0, length + 2 * step, step) - most - step)
    ends = np.searchsorted(x, np.arange(0.0, length + 2 * step, step) + most + step)
    for number in range(int(np.ceil(length / step))):
        at = number * step
        owed += grown_by
        whole = int(owed)
        owed -= whole
        if whole:
            open_ = maximum_filter1d(open_, 2 * whole + 1, mode="wrap")
        for k in range(rows[number], ends[number]):
            off = max(abs(at - x[k]) - step / 2, 0.0)
            if off >= radius[k]:
                continue
            half = np.sqrt(radius[k] ** 2 - off * off)
            first, last = int(np.ceil((y[k] - half) / cell)), int(np.floor((y[k] + half) / cell))
            open_[np.arange(first, last + 1) % count] = 0
        if not open_.any():
            return at
    return length


def chance_of_way(
    rng: np.random.Generator,
    density: float,
    reach: float,
    slope: float,
    length: float,
    forests: int,
    width: float = 40.0,
) -> tuple[int, int]:
    """Number of forests in which a way gets through, and of all that were tried."""
    through = 0
    for _ in range(forests):
        place = poisson_strip(rng, density, length, width)
        got = passable(place, np.full(len(place), reach), slope, length, width)
        through += got >= length
    return through, forests


def critical_slope(
    rng: np.random.Generator,
    density: float,
    reach: float,
    length: float,
    forests: int,
    width: float = 40.0,
) -> float:
    """w/v at which half of the forests have a way through, by bisection over the same forests."""
    places = [poisson_strip(rng, density, length, width) for _ in range(forests)]
    low, high = 1e-3, 4.0
    for _ in range(7):
        middle = np.sqrt(low * high)
        got = [passable(p, np.full(len(p), reach), middle, length, width) >= length for p in places]
        low, high = (low, middle) if np.mean(got) >= 0.5 else (middle, high)
    return float(np.sqrt(low * high))
