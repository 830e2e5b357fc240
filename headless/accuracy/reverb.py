"""Reverb: the tolerance of the sum over trunks, against the direct sum over every trunk and frequency.

The first part of the record is computed with each tolerance and exactly, as long as the direct sum can be
waited for; the error is that of the trunks' sound, L2, as a share of the exact one. Beside it stands what
single scattering itself leaves out among the trunks nearest to the pair.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from forest_addon.blender.observe import Observer
from forest_addon.sensing.reverb.ends import ends_of
from forest_addon.spec import Reverb, Scene

from .sweep import Point, Sweep, timed

TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
MOST = 5e7  # trunks by samples that are summed directly
NEAREST = 60  # trunks of the comparison with multiple scattering
SHORTEST = 0.05  # s


def sweep_reverb(sensor: Reverb, observer: Observer, settings: Scene, folder: Path) -> Sweep:
    """Errors and seconds of a reverb by its tolerance."""
    source, receiver = ends_of(sensor, observer.places).pairs[0]
    one = replace(
        sensor,
        source=tuple(float(v) for v in source),
        receiver=tuple(float(v) for v in receiver),
        sources=(),
        receivers=(),
        source_objects="",
        receiver_objects="",
        array=1,
        rescattering=0,
    )
    pairs = len(ends_of(sensor, observer.places).pairs)

    def hear(**changes: object) -> tuple[object, float]:
        changed = replace(one, **changes)
        return timed(lambda: observer.observe(changed, settings, None, folder))

    today, _ = hear()
    length = len(today.samples) / sensor.sample_rate
    part = length
    while part > SHORTEST and _work(today.trunks, part / length, part * sensor.sample_rate) > MOST:
        part /= 2
    exact, _ = hear(tolerance=0.0, duration=part)
    whole = float(np.linalg.norm(exact.trees))

    def point(tolerance: float) -> Point:
        whole_record, seconds = hear(tolerance=tolerance)
        found = whole_record
        if part < length:
            some = replace(one, tolerance=tolerance, duration=part)
            found = observer.observe(some, settings, None, folder)
        count = min(len(found.trees), len(exact.trees))
        apart = float(np.linalg.norm(found.trees[:count] - exact.trees[:count]))
        error = apart / whole if whole > 0 else 0.0
        label = f"tolerance {tolerance:g}"
        return Point({"tolerance": tolerance}, label, error, 0.0, seconds * pairs)

    near, _ = hear(rescattering=NEAREST, duration=part)
    model = None
    if near.model_error is not None and len(near.model_error.trunks):
        words = f"single against multiple scattering by {len(near.model_error.trunks)} trunks"
        model = (near.model_error.relative, words)
    notes = (f"exact: the direct sum over the first {part:.2f} s of {length:.2f} s",)
    others = tuple(point(tolerance) for tolerance in TOLERANCES if tolerance != sensor.tolerance)
    now = point(sensor.tolerance)
    terms = {"numerics": now.error}
    return Sweep(sensor, "sound of the trunks", "", now, others, model, notes, terms)


def _work(trunks: int, share: float, samples: float) -> float:
    """Trunks by samples; trunks within a time grow with its square."""
    return trunks * min(share**2, 1.0) * samples
