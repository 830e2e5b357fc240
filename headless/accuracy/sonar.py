"""Sonar: the tolerance of the sum and what is culled, against the direct sum over everything in range.

A few poses are heard with each setting and exactly; the error is that of the spectrum at all ears, L2,
as a share of the exact one. The leaf's model is compared too: it is often the larger error.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from forest_addon.blender.observe import Observer
from forest_addon.sensing.sonar.ping import Echo
from forest_addon.sensing.sonar.poses import Pose, posed
from forest_addon.spec import Scene, Sonar

from .sweep import Point, Sweep, mean_and_spread, timed

TRIED = (
    *({"tolerance": t, "cull": t} for t in (1e-2, 1e-3, 1e-4, 1e-6)),
    {"tolerance": 1e-6, "cull": 0.0},
)
POSES = 2
MOST_EXACTLY = (
    60_000  # scatterers that are summed one by one; beyond, a tolerance of 1e-9 is exact enough
)


def sweep_sonar(
    sensor: Sonar, observer: Observer, settings: Scene, poses: list[Pose] | None, folder: Path
) -> Sweep:
    """Errors and seconds of a sonar by tolerance and cull."""
    given = poses or [posed(sensor)]
    some = [given[k] for k in np.unique(np.linspace(0, len(given) - 1, POSES).astype(int))]

    fixed: dict[
        str, object
    ] = {}  # a record without what is culled would be shorter, its bins others

    def listen(changes: dict[str, object]) -> tuple[list[Echo], float]:
        one = replace(sensor, **changes, **fixed)
        found, seconds = timed(lambda: observer.observe(one, settings, None, folder, some))
        return list(found.echoes), seconds * len(given) / len(some)

    everything, _ = listen({"cull": 0.0, "tolerance": 1e-9})  # also makes what is made once
    if not sensor.record:
        longest = max(len(echo.time) for echo in everything)
        fixed["record"] = min(longest / sensor.sample_rate, 60.0)
        everything, _ = listen({"cull": 0.0, "tolerance": 1e-9})
    heard = sum(len(echo.heard) for echo in everything) / len(some)
    note = "exact: everything in range, tolerance 1e-9"
    if heard <= MOST_EXACTLY:
        everything, _ = listen({"cull": 0.0, "tolerance": 0.0})
        note = "exact: the direct sum over everything in range"

    def point(changes: dict[str, object], label: str) -> Point:
        echoes, seconds = listen(changes)
        error, spread = mean_and_spread(
            [_apart(e.spectra, x.spectra) for e, x in zip(echoes, everything, strict=True)]
        )
        return Point(changes, label, error, spread, seconds)

    today = point({}, f"tolerance {sensor.tolerance:g}, cull {sensor.cull:g}")
    points = [point(c, f"tolerance {c['tolerance']:g}, cull {c['cull']:g}") for c in TRIED]
    numerics = point({"cull": 0.0}, "").error
    culling = math.sqrt(max(today.error**2 - numerics**2, 0.0))
    model = None
    if sensor.leaf_model != "exact" and sensor.leaves:
        hard, _ = listen({"leaf_model": "exact"})
        ours, _ = listen({})
        apart = [_apart(e.spectra, x.spectra) for e, x in zip(ours, hard, strict=True)]
        words = f'the "{sensor.leaf_model}" leaf against the exact disc'
        model = (mean_and_spread(apart)[0], words)
    return Sweep(
        sensor,
        "spectrum of the echo",
        "",
        today,
        tuple(points),
        model,
        (note, f"{heard:,.0f} scatterers in range of a ping"),
        {"numerics": numerics, "culling": culling},
    )


def _apart(found: np.ndarray, exact: np.ndarray) -> float:
    whole = float(np.linalg.norm(exact))
    return float(np.linalg.norm(found - exact)) / whole if whole > 0 else 0.0
