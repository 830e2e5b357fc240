"""Reverb: the tolerance of the sum over trunks, and how far the forest goes on.

The first part of the record is computed with each tolerance and exactly, as long as the direct sum can be
waited for; the error is that of the trunks' sound, L2, as a share of the exact one. Where the forest goes
on beyond its field, one that goes on twice as far is drawn, and cut off at several distances: what a nearer
end leaves out. The two errors add up as squares. Beside them stands what single scattering itself leaves
out among the trunks nearest to the pair.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from forest_addon.base.rng import stream
from forest_addon.blender.sensors.observe import Observer
from forest_addon.sensing.reverb.ends import ends_of
from forest_addon.sensing.reverb.forest.surroundings import canopy_of
from forest_addon.sensing.reverb.kind import trunks_between
from forest_addon.sensing.reverb.response import impulse_response
from forest_addon.sensing.reverb.trunks import continue_trunks
from forest_addon.spec import Reverb, Scene

from .sweep import AccuracySweep, Point, timed

TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
COARSE = 1e-3  # tolerance at which forests that end at different distances are compared
MOST = 5e7  # trunks by samples that are summed directly
FARTHER, FARTHEST = 2.0, 2000.0  # times as far, and metres, that the forest goes on at most
PARTS = (0.25, 0.5)  # of today's distance
MANY_TRUNKS = 40_000
NEAREST = 60  # trunks of the comparison with multiple scattering
SHORTEST = 0.05  # s


def sweep_reverb(
    sensor: Reverb, observer: Observer, settings: Scene, folder: Path
) -> AccuracySweep:
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

    extents = _extents(one, observer, settings, length)
    cut = next((e.error for e in extents if e.metres == one.continue_to), 0.0)

    def point(tolerance: float) -> Point:
        whole_record, seconds = hear(tolerance=tolerance)
        found = whole_record
        if part < length:
            some = replace(one, tolerance=tolerance, duration=part)
            found = observer.observe(some, settings, None, folder)
        count = min(len(found.trees), len(exact.trees))
        apart = float(np.linalg.norm(found.trees[:count] - exact.trees[:count]))
        error = math.hypot(apart / whole if whole > 0 else 0.0, cut)
        label = f"tolerance {tolerance:g}"
        return Point({"tolerance": tolerance}, label, error, 0.0, seconds * pairs)

    near, _ = hear(rescattering=NEAREST, duration=part)
    model = None
    if near.model_error is not None and len(near.model_error.trunks):
        words = f"single against multiple scattering by {len(near.model_error.trunks)} trunks"
        model = (near.model_error.relative, words)
    notes = (f"exact: the direct sum over the first {part:.2f} s of {length:.2f} s",)
    others = [point(tolerance) for tolerance in TOLERANCES if tolerance != sensor.tolerance]
    now = point(sensor.tolerance)
    terms = {"numerics": math.sqrt(max(now.error**2 - cut**2, 0.0))}
    if extents:
        terms["extent"] = cut
        reach = max(extent.farthest for extent in extents)
        notes += (
            f"extent: against a forest drawn as far as {reach:g} m: at least so much; of one drawing that is "
            "cut, and another continue_to draws other trunks beyond the field, whose sound differs by more",
        )
        rate = now.seconds / next(e.seconds for e in extents if e.metres == one.continue_to)
    for extent in extents:
        if extent.metres != one.continue_to:
            error = math.hypot(terms["numerics"], extent.error)
            seconds = extent.seconds * rate
            changes = {"continue_to": extent.metres}
            label = f"forest as far as {extent.metres:g} m"
            others.append(Point(changes, label, error, 0.0, seconds))
    return AccuracySweep(sensor, "sound of the trunks", "", now, tuple(others), model, notes, terms)


@dataclass(frozen=True)
class _Extent:
    """A forest that ends at so many metres; its error against the farthest, and CPU seconds of one pair."""

    metres: float
    error: float
    seconds: float
    farthest: float


def _extents(one: Reverb, observer: Observer, settings: Scene, length: float) -> list[_Extent]:
    """Return where the forest may end, each against the farthest; none where it does not go on."""
    ends = ends_of(one, observer.places)
    trunks = trunks_between(observer, one, settings, ends)(*ends.pairs[0])
    field = (settings.forest.origin, settings.forest.size)
    density = len(trunks) / float(np.prod(settings.forest.size))
    soon = math.sqrt(MANY_TRUNKS / (math.pi * density)) if density else FARTHEST
    farthest = min(FARTHER * one.continue_to, FARTHEST, max(soon, 1.2 * one.continue_to))
    if not one.continue_to or farthest <= one.continue_to:
        return []
    rng = stream(settings.seed, "accuracy", one.name, "continuation")
    centre = ends.on_ground.mean(axis=0)
    beyond = continue_trunks(trunks, field, centre, farthest, rng, clear=ends.on_ground)
    away = np.hypot(*(beyond.position - centre).T)
    coarse = max(one.tolerance, COARSE)
    ended = replace(one, continue_to=0.0, duration=length, tolerance=coarse)
    around = {"expansions": observer.expansions, "field": field}
    if one.model == "forest":
        area = float(np.prod(settings.forest.size))
        heights = float(one.source[2]), float(one.receiver[2])
        around["canopy"] = canopy_of(observer.geometry, heights, area, trunks.tree)

    def sound(metres: float) -> tuple[np.ndarray, float]:
        some = trunks.with_others(beyond.select(away <= metres))
        found, seconds = timed(lambda: impulse_response(some, ended, settings.air, **around))
        return found.trees, seconds

    truth, _ = sound(farthest)
    whole = float(np.linalg.norm(truth))
    found = []
    for metres in sorted({*(part * one.continue_to for part in PARTS), one.continue_to}):
        heard, seconds = sound(metres)
        apart = float(np.linalg.norm(heard - truth))
        found.append(_Extent(metres, apart / whole if whole > 0 else 0.0, seconds, farthest))
    return found


def _work(trunks: int, share: float, samples: float) -> float:
    """Trunks by samples; trunks within a time grow with its square."""
    return trunks * min(share**2, 1.0) * samples
