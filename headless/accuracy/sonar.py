"""Sonar: the tolerance of the sum, what is culled and the rays that look for leaves in the way, against the
direct sum over everything in range with many such rays.

A few poses are heard with each setting and exactly; the error is that of the spectrum at all ears, L2,
as a share of the exact one. What the model leaves out is compared too, and is often the larger error: the
exact disc for another leaf, and leaves that stand in the way.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from forest_addon.blender.sensors.observe import Observer
from forest_addon.sensing.sonar.ping import Echo
from forest_addon.sensing.trajectory import Trajectory, looking
from forest_addon.spec import Scene, Sonar

from .sweep import AccuracySweep, Point, mean_and_spread, timed

TRIED = (
    *({"tolerance": t, "cull": t} for t in (1e-2, 1e-3, 1e-4)),
    {"tolerance": 1e-6, "cull": 0.0},
)
POSES = 2
RAYS, MANY_RAYS = (2, 8), 16  # along each side of a cell
MOST = 6e7  # scatterers by bins, ears and pings summed directly; beyond, a tolerance of 1e-9 does


def sweep_sonar(
    sensor: Sonar, observer: Observer, settings: Scene, way: Trajectory | None, folder: Path
) -> AccuracySweep:
    """Errors and seconds of a sonar by tolerance and cull."""
    given = where_it_stands(sensor) if way is None else way
    some = given.take(np.unique(np.linspace(0, len(given) - 1, POSES).astype(int)))

    # a record without what is culled would be shorter, its bins others; the spectrum knows no Doppler
    fixed: dict[str, object] = {"doppler": False}

    known: dict[Sonar, tuple[list[Echo], float]] = {}

    def listen(changes: dict[str, object]) -> tuple[list[Echo], float]:
        one = replace(sensor, **changes, **fixed)
        if one not in known:
            found, seconds = timed(lambda: observer.observe(one, settings, None, folder, some))
            known[one] = list(found.echoes), seconds * len(given) / len(some)
        return known[one]

    def once(changes: dict[str, object]) -> list[Echo]:
        return listen(changes)[0]

    shaded = "extinction" in sensor.shading
    exact: dict[str, object] = {"cull": 0.0, "tolerance": 1e-9}
    exact |= {"shading_rays": MANY_RAYS} if shaded else {}
    # coarse: it counts, finds the record, and makes what is made once
    everything = once({"cull": 0.0, "tolerance": 1e-2})
    heard = sum(len(echo.heard) for echo in everything) / len(some)
    if not sensor.record:
        longest = max(len(echo.time) for echo in everything)
        fixed["record"] = min(longest / sensor.sample_rate, 60.0)
    note = "exact: everything in range, tolerance 1e-9"
    bins = sum(echo.spectra.size for echo in everything)
    if heard * bins <= MOST:
        exact["tolerance"] = 0.0
        note = "exact: the direct sum over everything in range"
    everything = once(exact)
    if shaded:
        note += f", {MANY_RAYS}² rays a cell for leaves in the way"

    def off(echoes: list[Echo], truth: list[Echo]) -> tuple[float, float]:
        pairs = zip(echoes, truth, strict=True)
        return mean_and_spread([_apart(e.spectra, x.spectra) for e, x in pairs])

    def point(changes: dict[str, object], label: str) -> Point:
        echoes, seconds = listen(changes)
        return Point(changes, label, *off(echoes, everything), seconds)

    today = point({}, f"tolerance {sensor.tolerance:g}, cull {sensor.cull:g}")
    points = [point(c, f"tolerance {c['tolerance']:g}, cull {c['cull']:g}") for c in TRIED]
    ours = once({})
    alike = everything  # but with today's rays for leaves in the way
    terms = {}
    if shaded:
        points += [point({"shading_rays": n}, f"{n}² shading rays a cell") for n in RAYS]
        alike = once(exact | {"shading_rays": sensor.shading_rays})
        terms["shading rays"] = off(alike, everything)[0]
    terms["numerics"] = off(once({"cull": 0.0}), alike)[0]
    rest = off(ours, alike)[0] ** 2 - terms["numerics"] ** 2
    terms["culling"] = math.sqrt(max(rest, 0.0))
    models = [(off(ours, once(changes))[0], words) for changes, words in _models(sensor)]
    return AccuracySweep(
        sensor,
        "spectrum of the echo",
        "",
        today,
        tuple(points),
        max(models, default=None),
        (note, f"{heard:,.0f} scatterers in range of a ping"),
        terms,
    )


def where_it_stands(sonar: Sonar) -> Trajectory:
    """A trajectory of the one pose that the settings say."""
    turn, rise = np.radians([[sonar.azimuth_deg], [sonar.elevation_deg]])
    return looking(np.array([sonar.position], dtype=float), turn, rise, speed=sonar.speed)


def _models(sensor: Sonar) -> list[tuple[dict[str, object], str]]:
    """Return what the model leaves out, as settings that have it: an exact disc, leaves in the way."""
    other: list[tuple[dict[str, object], str]] = []
    if sensor.leaves and sensor.leaf_model != "exact":
        words = f'the "{sensor.leaf_model}" leaf against the exact disc'
        other.append(({"leaf_model": "exact"}, words))
    if sensor.leaves and "extinction" not in sensor.shading:
        with_wood = "trunks+" * ("trunks" in sensor.shading)
        words = "leaves hide nothing behind them"
        other.append(({"shading": f"{with_wood}extinction"}, words))
    return other


def _apart(found: np.ndarray, exact: np.ndarray) -> float:
    whole = float(np.linalg.norm(exact))
    return float(np.linalg.norm(found - exact)) / whole if whole > 0 else 0.0
