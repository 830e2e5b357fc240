"""Large jobs that people wait for, each in a fresh process: first and next call, error and peak memory.

A hectare of beeches by a tripod of 19 rays a pulse goes into a file; beside it the rays of its beams in any
order, which Embree then takes one by one, as a plain loop over rays gives them. The echo of ten million
leaves is that of a sonar in the middle of their forest; its error is what the audit finds.
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from forest_addon.api import build, read

from ..inside import Say, pattern_of, peak_memory_mb, spread, stream
from ..tables import fresh, table, timed

TITLE = "waiting: large jobs, cold beside warm"
HECTARE = """
[forest]
size = [100, 100]
[[plantings]]
species = "european-beech"
variants = 10
expected = 500
exact = true
[[sensors]]
kind = "terrestrial"
scanner = "riegl-vz-400i"
name = "tls"
position = [50, 50, 1.6]
angle_step_deg = 0.2
[rays]
threads = 1
"""
LEAVES = """
[forest]
size = [150, 150]
[[plantings]]
species = "maple"
variants = 20
expected = 1400
exact = true
[[sensors]]
kind = "sonar"
name = "wide"
position = [75, 75, 1.5]
elevation_deg = 20
beam_width_deg = [90, 90]
max_range = 120
cull = 0.01
tolerance = 1e-3
leaf_model = "paper"
shading = "none"
"""
SIDE_BY_SIDE = 12  # pieces of 3,400 pulses over the scan, whose rays are also cast in any order


def run(say: Say) -> None:
    """Print a table of each job."""
    say("500 European beeches of 10 variants on a hectare, a VZ-400i at 0.2°, into LAZ:\n")
    head = [
        "build, s",
        "first scan, s",
        "next, s",
        "points",
        "points/s, first and next",
        "peak, GB",
    ]
    table(say, head, [fresh(__name__, "hectare").split(";")])
    say("\nRays of its beams alone, side by side as they are and in any order, the same rays:\n")
    head = [
        "rays",
        "side by side, rays/s",
        "in any order",
        "times",
        "another face",
        "largest error, m",
    ]
    table(say, head, [fresh(__name__, "rays").split(";")])
    say("\nOne echo of a forest of maples, heard within 1 % of all amplitudes:\n")
    head = ["leaves", "build, s", "first ping, s", "next, s", "audit", "peak, GB"]
    table(say, head, [fresh(__name__, "leaves").split(";")])


def _built(text: str) -> tuple[Any, Any, float]:
    """A world, its first sensor, and the CPU seconds that it took."""

    with TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        path.write_text(text)
        scene = read(path)
        world, seconds = timed(lambda: build(scene))
        return world, scene.sensors[0], seconds


def hectare() -> str:
    """Build it, and scan it twice."""
    world, sensor, built = _built(HECTARE)
    took = []
    with TemporaryDirectory() as folder:
        for name in ("first.laz", "later.laz"):
            file = Path(folder) / name
            written, seconds = timed(lambda f=file: world.scan_to(f, sensor))
            took.append(seconds)
    rates = ", ".join(f"{written.points / each:,.0f}" for each in took)
    first, later = took
    return f"{built:.1f};{first:.1f};{later:.1f};{written.points:,};{rates};{_peak()}"


def rays() -> str:
    """Cast the rays of some beams in both orders."""

    world, sensor, _ = _built(HECTARE)
    caster, pattern = world.observer.caster, pattern_of(sensor, None)
    count, took, other, error = 0, [0.0, 0.0], 0, 0.0
    for first in np.linspace(0, pattern.count - 3400, SIDE_BY_SIDE).astype(np.int64):
        number = np.arange(first, first + 3400)
        origin, way = spread(pattern.pulses(number), sensor.beam, number.astype(np.uint64))
        order = stream(0, "bench", "order", int(first)).permutation(len(way))
        casts = [lambda: caster.cast(origin, way, sensor.max_range)]  # noqa: B023
        casts += [lambda: caster.cast(origin[order], way[order], sensor.max_range)]  # noqa: B023
        (beams, one), (mixed, other_order) = map(timed, casts)
        took = [took[0] + one, took[1] + other_order]
        beams, count = beams.select(order), count + len(way)
        other += int(np.count_nonzero(beams.triangle != mixed.triangle))
        there = beams.found & mixed.found
        apart = beams.distance[there] - mixed.distance[there]
        error = max(error, float(np.abs(apart).max(initial=0.0)))
    rates = [count / each for each in took]
    times = rates[0] / rates[1]
    return f"{count:,};{rates[0]:,.0f};{rates[1]:,.0f};{times:.1f};{other};{error:.0e}"


def leaves() -> str:
    """Build a forest, and hear it twice."""
    world, sensor, built = _built(LEAVES)
    found, first = timed(lambda: world.ping(sensor))
    later = timed(lambda: world.ping(sensor))[1]
    count = int(sum(world.trees["leaves"]))
    return f"{count:,};{built:.1f};{first:.1f};{later:.1f};{found.audit.error:.0e};{_peak()}"


def _peak() -> str:
    return f"{(peak_memory_mb() or 0.0) * 2**20 / 1e9:.2f}"


if __name__ == "__main__":
    print({"hectare": hectare, "rays": rays, "leaves": leaves}[sys.argv[1]]())
