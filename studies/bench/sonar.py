"""Echoes end to end, and the sum over leaves alone, their errors; what the leaf models differ by."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from itertools import count as counting, product
from pathlib import Path
from typing import Any

import numpy as np

from forest_addon.api import Air, Echo, Scene, Sonar

from ..inside import (
    ASSETS,
    DelayedSum,
    DiscStrength,
    EchoTargets,
    Equipment,
    LeafDiscs,
    MeasuredSphere,
    Say,
    backscatter,
    equip,
    find,
    find_species,
    fly_pings as fly,
    grow,
    grow_forest,
    load_species,
    ping,
    posed,
    poses_of,
    read_route,
    read_settings,
    stream,
    sum_delayed,
)
from ..scenes import scene_of, scene_of_forest, turned
from ..tables import table
from .rows import BenchRow, Rows

TITLE = "sonar: pings among trees"
WORDS = """\
Pings turn from one to the next; cull 0.01 of all amplitudes, tolerance 1e-6, 60 to 80 kHz; their error is
against a ping of the tolerance 0, of the pressure (L2). Table 1 of Tanveer et al. 2020a: its scene files, the
paper's model, all positions; theirs took 0.73 and 3.03 s on 32 cores. Culling: what is promised of Σ|A|, what
is true, and of the energy. Levels: what leaves and wood add, dB re the call at 1 m. Doppler and measured
ears: two ears at 5 m/s, leaves of 8 to 30 mm, a sweep of 2 ms from 80 to 40 kHz. Sums: leaves of 2.5 cm of
any direction, 1,201 bins; spread at 1 to 10 m, or all at one place, so that all errors add up; errors
against the direct sum at every 40th bin.
"""
SPECIES, VARIANTS = "honda-birch", 5
POSE = {"position": (0.0, 0.0, 4.0), "elevation_deg": 10.0}
MODELS = ("paper", "piston", "exact")
PAPERS = ("tanveer-table-1-one", "tanveer-table-1-five")


def _forest(count: int) -> EchoTargets:
    """Birches at 0.1 trees/m², a few variants of them."""
    species = load_species(find_species(SPECIES, Path()))
    meshes = tuple(grow(*species, stream(1, "bench", n)).mesh for n in range(VARIANTS))
    rng = stream(7, "bench", "sonar", count)
    half = np.sqrt(count / 0.1) / 2
    turn = rng.uniform(0, 2 * np.pi, count)
    return EchoTargets(scene_of(meshes, turned(rng.uniform(-half, half, (count, 2)), turn)))


def _pings(count: int, width: float, **settings: Any) -> BenchRow:
    targets, number = _forest(count), counting()
    sonar = Sonar(beam_width_deg=(width, width), shading="none", cull=0.01, **POSE, **settings)

    def work() -> tuple[Sonar, Echo]:
        one = sonar.changed(azimuth_deg=45.0 * (next(number) // 2))  # alike of both ways
        return one, ping(targets, one, Air())

    def error(found: tuple[Sonar, Echo]) -> str:
        one, echo = found
        whole = ping(targets, one.changed(tolerance=0.0), Air()).impulse_response
        off = np.linalg.norm(echo.impulse_response - whole) / np.linalg.norm(whole)
        return f"{off:.0e}; {len(echo.heard):,} heard, cull's bound {echo.cull_bound:.0e}"

    return BenchRow(work, error)


def _table_1(name: str) -> BenchRow:
    settings = read_settings(ASSETS / "scenes" / f"{name}.toml", Scene)
    species = [load_species(find_species(p.species, Path())) for p in settings.plantings]
    targets = EchoTargets(scene_of_forest(grow_forest(settings, species)))
    (sonar,) = [sensor for sensor in settings.sensors if sensor.kind == "sonar"]
    poses = [posed(sonar)]
    if sonar.route:
        poses = poses_of(read_route(find(sonar.route, ASSETS / "scenes", "route"), sonar.speed))
    equipment = equip(sonar, ASSETS / "scenes")

    def work() -> None:
        fly(targets, sonar, settings.air, poses, equipment=equipment)

    return BenchRow(work, many=len(poses))


def _culling(cull: float) -> BenchRow:
    targets = _forest(5)
    sonar = Sonar(shading="none", wood=False, leaf_model="piston", **POSE)

    def error(part: Echo) -> str:
        whole = ping(targets, sonar.changed(cull=0.0), Air())
        size = min(len(part.impulse_response), len(whole.impulse_response))
        gap = whole.impulse_response[:size] - part.impulse_response[:size]
        energy = np.sum(gap**2) / np.sum(whole.impulse_response**2)
        more = whole.heard.amplitude.sum() / part.heard.amplitude.sum() - 1
        return f"{part.cull_bound:.1e} promised, {more:.1e} true, energy {energy:.1e}"

    return BenchRow(lambda: ping(targets, sonar.changed(cull=cull), Air()), error)


def _kind(**settings: Any) -> BenchRow:
    targets = _forest(5)
    sonar = Sonar(shading="none", beam_width_deg=(40.0, 40.0), cull=1e-3, **POSE, **settings)

    def told(echo: Echo) -> str:
        peak, mean = echo.envelope.max(), np.sqrt(np.mean(echo.envelope**2))
        return f"- ({20 * np.log10(peak):.1f} dB, rms {20 * np.log10(mean):.1f} dB)"

    return BenchRow(lambda: ping(targets, sonar, Air()), told)


# Pings of two ears with Doppler, plain and measured all round, beside those without.
#
# Leaves stand at random in a sphere of 1.5 m about a place 4 m ahead. Nothing is culled, so that every row
# sums the same leaves.


LEAVES, DIRECTIONS = 6936, 800
EARS = Sonar(
    position=(0.0, 0.0, 0.0), ears=2, ear_spacing=0.015, band=(40e3, 80e3), sample_rate=250e3,
    call="fm", speed=5.0, cull=0.0, tolerance=1e-3, facets=False, wood=False, shading="none",
    beam_width_deg=(60.0, 60.0), hearing="gaussian", max_range=10.0,
)  # fmt: skip


def _doppler(model: str, hearing: str, doppler: bool) -> BenchRow:
    targets = EchoTargets.of_discs(_leaves())
    sonar = EARS.changed(leaf_model=model, doppler=doppler)
    hears = (_ear(1.0), _ear(-1.0)) if hearing == "measured" else ()
    equipment = Equipment.of(sonar, hears=hears)
    return BenchRow(lambda: ping(targets, sonar, Air(), equipment=equipment), many=LEAVES)


def _leaves() -> LeafDiscs:
    rng = stream(5, "bench", "sonar", "doppler")
    away = rng.normal(size=(LEAVES, 3))
    away *= 1.5 * np.cbrt(rng.uniform(size=(LEAVES, 1))) / np.linalg.norm(away, axis=1)[:, None]
    normal = rng.normal(size=(LEAVES, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    number, one = np.arange(LEAVES), np.zeros(LEAVES, np.int64)
    radius = rng.uniform(0.008, 0.03, LEAVES)
    centre = away + np.array([4.0, 0.0, 0.0])
    return LeafDiscs(centre, normal, radius, one, number, one - 1)


def _ear(left: float) -> MeasuredSphere:
    """An ear that hears best aside and ahead, the more so the higher the frequency."""
    rng = stream(6, "bench", "sonar", "ears")
    towards = rng.normal(size=(DIRECTIONS, 3))
    towards /= np.linalg.norm(towards, axis=1)[:, None]
    frequency = np.linspace(30e3, 90e3, 7)
    level = 12.0 * (0.8 * towards[:, 0] + 0.6 * left * towards[:, 1] - 1.0)
    return MeasuredSphere.all_round(towards, frequency, level[:, None] * frequency / 60e3)


# The echo sum alone, by leaves and tolerance.


START, BAND, BINS, SPEED = 60e3, 20e3, 1201, 340.0
SPACING = BAND / (BINS - 1)
SHARE = 40  # every so many bins are summed directly, for the error
DIRECT = 5_000  # leaves of the direct sum that is timed
SUMS = (
    *product(("paper",), (1_000, 100_000), ("spread",), (1e-3, 1e-4, 1e-6, 1e-8)),
    *product(("paper",), (1_000_000,), ("spread",), (1e-3, 1e-6)),
    *product(("piston", "exact"), (100_000,), ("spread",), (1e-3, 1e-4, 1e-6)),
    *product(MODELS, (100,), ("spread",), (1e-6,)),
    *product(MODELS, (10_000,), ("at one place",), (1e-3, 1e-6)),
    *product(MODELS, (DIRECT,), ("spread",), (0.0,)),
)


@dataclass(frozen=True)
class _Leaves:
    """Random leaves, summed as a ping sums them: in the parts of their strength."""

    distance: np.ndarray
    strength: DiscStrength

    @classmethod
    def random(cls, model: str, count: int, where: str) -> _Leaves:
        rng = stream(5, "bench", "leaves", count)
        radius = np.clip(rng.normal(0.025, 0.005, count), 0.005, 0.05)
        distance, angle = rng.uniform(1, 10, count), np.arccos(rng.uniform(0, 1, count))
        if where == "at one place":
            radius, distance, angle = (np.full(count, v[0]) for v in (radius, distance, angle))
        return cls(distance, DiscStrength(radius, angle, np.ones(count), model))

    def sum(self, tolerance: float, every: int = 1) -> DelayedSum:
        """Sum over the parts, whose sizes add up to more than that of the leaves, at every so many bins."""
        low, high = (2.0 * math.pi * f / SPEED for f in (START, START + BAND))
        loud = self.strength.bound(low, high) / self.distance**2
        parts = self.strength.parts(low, high) if tolerance else self.strength.whole()
        away = self.distance[parts.rows]

        def amplitude(frequency: np.ndarray, rows: np.ndarray) -> np.ndarray:
            k = 2.0 * math.pi * frequency / SPEED
            return parts.strength.select(rows).amplitude(k) / away[rows] ** 2

        return sum_delayed(
            amplitude,
            (2.0 * away + parts.offset) / SPEED,
            START,
            every * SPACING,
            (BINS - 1) // every + 1,
            tolerance=tolerance,
            reach=parts.strength.reach(low) / SPEED,
            loudness=loud[parts.rows] * parts.share,
            second=parts.second,
            conjugate=parts.conjugate,
        )


def _sum(model: str, count: int, where: str, tolerance: float) -> BenchRow:
    leaves = _Leaves.random(model, count, where)

    def error(found: DelayedSum) -> str:
        exact = leaves.sum(0.0, SHARE)
        off = np.abs(found.spectrum[::SHARE] - exact.spectrum).max() / exact.size
        nodes = sum(nodes * some for nodes, some in found.nodes.items()) / count
        return f"{off:.0e} of Σ|A|, estimate {found.error:.0e}; {nodes:.1f} nodes"

    return BenchRow(partial(leaves.sum, tolerance), error, count)


def run(say: Say, _: object) -> None:
    """Print by how much the leaf models differ, by ka and incidence."""
    say(
        "\nLevel of the leaf models re the exact disc, dB: piston / paper. All: rms over directions.\n"
    )
    degrees = (0, 10, 20, 30, 45, 60, 75)
    every = np.arccos((np.arange(20_000) + 0.5) / 20_000)  # isotropic
    rows = []
    for ka in (0.5, 1, 2, 5, 10, 37, 100):
        cells = [f"{ka}"]
        for angle in (*np.radians(degrees), every):
            paper, piston, exact = (
                10.0 * np.log10(np.mean(backscatter(ka, angle, model) ** 2)) for model in MODELS
            )
            cells.append(f"{piston - exact:+.1f} / {paper - exact:+.1f}")
        rows.append(cells)
    table(say, ["ka", *(f"{angle}°" for angle in degrees), "all"], rows)


SOUNDS: dict[str, dict[str, Any]] = {
    "paper": {"wood": False, "leaf_model": "paper"},
    "piston": {"wood": False, "leaf_model": "piston"},
    "exact, wood": {},
}
ROWS: Rows = {
    **{
        f"ping of {count} trees, {width:g}°, {kinds}": partial(_pings, count, width, **settings)
        for count in (5, 1800)
        for width in (10.0, 30.0)
        for kinds, settings in SOUNDS.items()
    },
    **{f"Table 1, {name.rpartition('-')[2]}": partial(_table_1, name) for name in PAPERS},
    **{f"culling at {cull:g}": partial(_culling, cull) for cull in (0.05, 0.01, 1e-3, 1e-4)},
    **{f"level of leaves, {m}": partial(_kind, wood=False, leaf_model=m) for m in MODELS},
    "level of wood alone": partial(_kind, leaves=False),
    "level of leaves and wood": _kind,
    **{
        f"{'Doppler' if moves else 'no Doppler'}, {m}, {ears} ears": partial(
            _doppler, m, ears, moves
        )
        for m, ears, moves in product(MODELS, ("gaussian", "measured"), (False, True))
    },
    **{
        f"sum of {count:,} {where}, {m}, {f'{t:.0e}' if t else 'directly'}": partial(
            _sum, m, count, where, t
        )
        for m, count, where, t in SUMS
    },
}
