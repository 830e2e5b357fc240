"""Flight: steps a second with few and many rays, one flyer and 64, pings a second, time of a reset.

Among a thousand birches of four variants (``assets/scenes/flight-poisson.toml``). A step is a whole one:
the body moves, what it touches is looked for, the rays are cast, and what is sensed is an observation.
Flights that end are set out again outside of what is timed. CPU time of one thread, the median of several
runs, warm; what is made once for a scene is told apart.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from forest_addon.api import Rays, read

from ..inside import (
    ASSETS,
    EarSense,
    Flyers,
    LidarSense,
    Say,
    Stock,
    empty_file,
    lidar_of,
    sonar_of,
    stream,
)
from ..tables import table

TITLE = "flight: steps, pings and resets"
SCENE = ASSETS / "scenes" / "flight-poisson.toml"
STEPS, RUNS, PINGS = 200, 5, 4
AIMS = {("64", "1"): 2000, ("1,024", "1"): 600, ("64", "64"): 10_000, ("1,024", "64"): None}


def run(say: Say) -> None:
    """Print the tables."""

    empty_file()
    begun = time.thread_time()
    stock = Stock(read(SCENE).changed(rays=Rays(threads=1)), SCENE.parent)
    grown = time.thread_time() - begun
    first = stock.surroundings(1)
    _ = first.caster
    made = time.thread_time() - begun - grown
    again = []
    for seed in range(2, 2 + RUNS):
        start = time.thread_time()
        around = stock.surroundings(seed)
        _ = around.caster
        again.append(time.thread_time() - start)
    trees = len(first.forest.stand) if first.forest else 0
    say(
        f"{trees:,} trees. Once a scene: grown and built {grown:.1f} s, rays' trees and cells {made:.1f} s."
    )
    say(f"Reset with a new forest: {np.median(again):.3f} s (aim 0.3 s).\n")

    settings = stock.settings
    base = lidar_of(settings)
    rows = []
    for (rays, flyers), aim in AIMS.items():
        lidar = LidarSense(base.changed(pulse_rate=base.line_rate * int(rays.replace(",", ""))))
        rate, parts = _steps(stock, first, lidar, int(flyers))
        rows.append(
            [
                rays,
                flyers,
                f"{rate:,.0f}",
                f"{aim:,}" if aim else "",
                f"{parts[0]:.0f}",
                f"{parts[1]:.0f}",
            ]
        )
    table(say, ["rays", "flyers", "flyer-steps/s", "aim", "moving, µs", "sensing, µs"], rows)

    say("\nPings of two ears, 40 to 80 kHz, as the scene has them:\n")
    rows = []
    sonar = sonar_of(settings)
    for what, wood in (("leaves", False), ("leaves and wood", True)):
        for model, aim in (("paper", 30), ("piston", 30), ("exact", 10)):
            ears = EarSense(sonar.changed(leaf_model=model, wood=wood), settings.air)
            rate, heard = _pings(stock, first, ears)
            rows.append([what, model, f"{heard:,.0f}", f"{rate:.1f}", f"{aim}"])
    table(say, ["what sounds", "leaf model", "heard, mean", "pings/s", "aim"], rows)


def _steps(stock: Any, around: Any, lidar: Any, count: int) -> tuple[float, tuple[float, float]]:
    """Flyer-steps a second, and µs a step of moving and of sensing."""

    flyers = Flyers(stock.settings.flight, count, lidar, None)
    flyers.enter(around)
    flyers.start(range(count), range(count))
    rng = stream(0, "bench", "flight")
    action = np.zeros((count, 3))
    rates, moving, sensing = [], [], []
    steps = max(20, STEPS // count)
    for _ in range(RUNS):
        moved = sensed = 0.0
        for _ in range(steps):
            action[:, 0] = rng.uniform(-0.3, 0.3, count)
            start = time.thread_time()
            out = flyers.step(action)
            middle = time.thread_time()
            flyers.sense()
            sensed += time.thread_time() - middle
            moved += middle - start
            over = np.flatnonzero(out.ended).tolist()
            if over:
                flyers.start(over, rng.integers(2**31, size=len(over)).tolist())
        rates.append(count * steps / (moved + sensed))
        moving.append(1e6 * moved / steps)
        sensing.append(1e6 * sensed / steps)
    return float(np.median(rates)), (float(np.median(moving)), float(np.median(sensing)))


def _pings(stock: Any, around: Any, ears: Any) -> tuple[float, float]:
    """Pings a second from places all over the forest, and scatterers that are in the sum."""

    flyers = Flyers(stock.settings.flight, PINGS + 1, None, ears)
    flyers.enter(around)
    flyers.start(range(PINGS + 1), range(PINGS + 1))
    ears.ping(around, flyers.state, PINGS)
    taken, heard = [], []
    for row in range(PINGS):
        start = time.thread_time()
        echo = ears.ping(around, flyers.state, row)
        taken.append(time.thread_time() - start)
        heard.append(len(echo.heard))
    return 1.0 / float(np.mean(taken)), float(np.mean(heard))
