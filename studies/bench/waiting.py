"""Large jobs that people wait for: a hectare of beeches by a tripod into a file, and the echo of a forest.

Beside the scan stand the rays of its beams, side by side and in any order, which Embree then takes one by
one, as a plain loop over rays gives them. The echo of ten million leaves is that of a sonar in the middle of
their forest; its error is what the audit finds.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from forest_addon.api import build, read

from ..inside import Hits, pattern_of, spread, stream
from .rows import BenchRow, Rows

TITLE = "waiting: large jobs, cold beside warm"
WORDS = """\
500 European beeches of 10 variants on a hectare, a VZ-400i at 0.2° and 19 rays a pulse, into LAZ; one echo of
a forest of maples, heard within 1 % of all amplitudes. How many: trees, pulses, rays.
"""
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
PIECES, PULSES = 12, 3400  # pieces of so many pulses over the scan, whose rays are cast


def _read(text: str) -> Any:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        path.write_text(text)
        return read(path)


def _built(text: str) -> BenchRow:
    scene = _read(text)
    return BenchRow(lambda: build(scene), many=scene.plantings[0].expected)


def _scan() -> BenchRow:
    scene, folder = _read(HECTARE), TemporaryDirectory()
    world, sensor = build(scene), scene.sensors[0]
    pulses = pattern_of(sensor).count

    def work() -> Any:
        return world.scan_to(Path(folder.name) / "scan.laz", sensor)

    return BenchRow(work, lambda written: f"- ({written.points:,} points)", pulses)


def _rays(mixed: bool) -> BenchRow:
    """Rays of some beams, as they are side by side, or in any order; what differs between both."""
    scene = _read(HECTARE)
    caster, sensor = build(scene).observer.caster, scene.sensors[0]
    pattern, pieces = pattern_of(sensor, None), []
    for first in np.linspace(0, pattern.count - PULSES, PIECES).astype(np.int64):
        number = np.arange(first, first + PULSES)
        rays = spread(pattern.pulses(number), sensor.beam, number.astype(np.uint64))
        order = stream(0, "bench", "order", int(first)).permutation(len(rays[1]))
        pieces.append((*rays, order))

    def cast(by_chance: bool) -> list[Hits]:
        found = []
        for origin, way, order in pieces:
            turn = order if by_chance else np.arange(len(way))
            hits = caster.cast(origin[turn], way[turn], sensor.max_range)
            found.append(hits.select(np.argsort(turn)))
        return found

    def error(found: list[Hits]) -> str:
        other, most = 0, 0.0
        for hits, again in zip(found, cast(not mixed), strict=True):
            other += int(np.count_nonzero(hits.triangle != again.triangle))
            there = hits.found & again.found
            apart = hits.distance[there] - again.distance[there]
            most = max(most, float(np.abs(apart).max(initial=0.0)))
        return f"{most:.0e} m, {other} of another face in the other order"

    return BenchRow(lambda: cast(mixed), error, sum(len(way) for _, way, _ in pieces))


def _echo() -> BenchRow:
    scene = _read(LEAVES)
    world, sensor = build(scene), scene.sensors[0]
    leaves = int(sum(world.trees["leaves"]))
    return BenchRow(lambda: world.ping(sensor), lambda echo: f"{echo.audit.error:.0e}", leaves)


ROWS: Rows = {
    "hectare of beeches, grown and built": partial(_built, HECTARE),
    "hectare of beeches, scanned into LAZ": _scan,
    "rays of its beams, side by side": partial(_rays, False),
    "the same rays in any order": partial(_rays, True),
    "forest of maples, grown and built": partial(_built, LEAVES),
    "echo of its leaves": _echo,
}
