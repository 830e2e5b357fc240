"""Flight: steps a second with few and many rays, one flyer and 64, pings a second, time of a reset.

Among a thousand birches of four variants (``assets/scenes/flight-poisson.toml``). A step is a whole one:
the body moves, what it touches is looked for, the rays are cast, and what is sensed is an observation.
"""

from __future__ import annotations

from functools import partial
from itertools import count as counting
from typing import Any

import numpy as np

from forest_addon.api import Rays, read

from ..inside import (
    ASSETS,
    EarSense,
    EmbreeCaster,
    Flyers,
    LidarSense,
    Stock,
    empty_file,
    lidar_of,
    sonar_of,
)
from .lidar import against_brute_force, embree_alone
from .rows import BenchRow, Rows

TITLE = "flight: steps, pings and resets"
WORDS = """\
How many: steps of all flyers, or pings of two ears, 40 to 80 kHz, as the scene has them. Wanted are resets
of 300 ms; 2,000 steps a second of 64 rays, 600 of 1,024, 10,000 of 64 flyers; 30 pings a second, 10 of
exact discs. Errors of steps are those of rays from where the flyers are.
"""
SCENE = ASSETS / "scenes" / "flight-poisson.toml"
STEPS, PINGS, CHECKED = 40, 4, 64
FLOWN = ((64, 1), (1024, 1), (64, 64), (1024, 64))  # rays, flyers
MODELS = ("paper", "piston", "exact")


def _stock() -> Stock:
    empty_file()
    return Stock(read(SCENE).changed(rays=Rays(threads=1)), SCENE.parent)


def _reset() -> BenchRow:
    stock, seeds = _stock(), counting(2)
    return BenchRow(lambda: stock.surroundings(next(seeds)).caster)


def _flyers(count: int, lidar: Any, ears: Any, stock: Stock) -> Flyers:
    flyers = Flyers(stock.settings.flight, count, lidar, ears)
    flyers.enter(stock.surroundings(1))
    flyers.start(range(count), range(count))
    return flyers


def _rays_of(rays: int, count: int) -> tuple[Flyers, EmbreeCaster, tuple[np.ndarray, ...], float]:
    """Flyers, their caster, and their rays with their reach."""
    stock = _stock()
    base = lidar_of(stock.settings)
    scanner = base.changed(pulse_rate=base.line_rate * rays)
    sense = LidarSense(scanner)
    flyers = _flyers(count, sense, None, stock)
    ways = np.tile(sense.ways, (count, 1))
    at = np.repeat(flyers.state.position, rays, axis=0)
    return flyers, stock.surroundings(1).caster, (at, ways), scanner.max_range


def _steps(rays: int, count: int) -> BenchRow:
    flyers, caster, (at, ways), _ = _rays_of(rays, count)
    action = np.zeros((count, flyers.state.position.shape[1]))
    some = np.linspace(0, len(at) - 1, CHECKED).astype(np.int64)
    checked = against_brute_force(caster, at[some], ways[some])

    def work() -> None:
        for _ in range(STEPS):
            flyers.sense()
            over = np.flatnonzero(flyers.step(action).ended).tolist()
            if over:
                flyers.start(over, over)

    return BenchRow(work, checked, STEPS * count)


def _sensing(rays: int, count: int) -> BenchRow:
    flyers = _rays_of(rays, count)[0]
    return BenchRow(flyers.sense, many=count)


def _alone(rays: int, count: int) -> BenchRow:
    _, caster, sent, reach = _rays_of(rays, count)
    return embree_alone(caster, *sent, reach, many=count)


def _pings(model: str, wood: bool) -> BenchRow:
    stock = _stock()
    sonar = sonar_of(stock.settings).changed(leaf_model=model, wood=wood)
    ears = EarSense(sonar, stock.settings.air)
    flyers, around = _flyers(PINGS, None, ears, stock), stock.surroundings(1)
    number = counting()

    def work() -> Any:
        return ears.ping(around, flyers.state, next(number) // 2 % PINGS)  # alike of both ways

    return BenchRow(work, lambda echo: f"- ({len(echo.heard):,} heard)")


ROWS: Rows = {
    "reset with a new forest": _reset,
    **{f"steps, {f} flyers of {r} rays": partial(_steps, r, f) for r, f in FLOWN},
    **{f"sensing alone, {f} flyers of {r} rays": partial(_sensing, r, f) for r, f in FLOWN},
    **{f"Embree alone, {f} flyers of {r} rays": partial(_alone, r, f) for r, f in FLOWN[:3]},
    **{f"pings of leaves, {m}": partial(_pings, m, False) for m in MODELS},
    **{f"pings of leaves and wood, {m}": partial(_pings, m, True) for m in MODELS},
}
