"""LiDAR: sub-rays of a beam, tubes and leaves of the trees' meshes, and engines.

Blocks of pulses, drawn evenly over the scan, are sent with each number of sub-rays and with many, which
meet the finest tubes too where trees have tubes. The error is the difference of the first return's range,
metres, root mean square over pulses that both saw. The tractor's beams are swept likewise, by the splits of
its sector. Rays themselves are held against brute force in float64.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from forest_addon.base.rng import stream
from forest_addon.blender.sensors.observe import Observer
from forest_addon.sensing.audit import sample
from forest_addon.sensing.lidar.audit import ray_errors
from forest_addon.sensing.lidar.footprint import spread
from forest_addon.sensing.lidar.scan import Scan
from forest_addon.sensing.lidar.tractor import axes, drive, fan, positions
from forest_addon.sensing.rays.caster import RayCaster
from forest_addon.spec import Scanner, Scene, Tractor

from .meshes import ENGINES, Meshes
from .sweep import AccuracySweep, Point, mean_and_spread

SUBRAYS = (1, 3, 7, 19, 37, 61)
MANY = 397
SPLITS = (0, 1, 2, 4)
FINE = 12
BLOCKS, BLOCK = 24, 32  # pulses
LINES = 6  # scans of a tractor
JUMP = 0.1  # m, and more: another surface
TUBES = (0.25, 4.0, 16.0)  # times today's tolerance
FINEST = 1 / 16
LEAVES = (1 / 4, 1 / 16)  # of today's
EXACTLY = 1.5  # seconds of float64
BATCH = 64  # rays of it at a time

Draw = Callable[[np.random.Generator, int], tuple[np.ndarray, np.ndarray]]
Look = Callable[[RayCaster, int], tuple[np.ndarray, float]]  # ranges, seconds of the whole sensor


@dataclass(frozen=True)
class _Beams:
    """Base of the sweeps of all LiDARs.

    look : ranges (P,) of the same beams by a caster and a number of rays, NaN where there is none, and
    seconds. today : the number of rays; fine : one that is as good as all; tried : others. changes, label :
    of a number. exactly : metres (rms) that an engine is off, and seconds of the whole sensor in float64.
    """

    what: str
    look: Look
    today: int
    fine: int
    tried: tuple[int, ...]
    changes: Callable[[int], dict[str, Any]]
    label: Callable[[int], str]
    exactly: Callable[[RayCaster], tuple[float, float]]
    notes: tuple[str, ...] = ()


def sweep_scanner(
    sensor: Scanner, observer: Observer, settings: Scene, meshes: Meshes, way: object
) -> AccuracySweep:
    """Errors and seconds of a scanner."""
    wide = max(sensor.beam.divergence_mrad) > 0 or sensor.beam.exit_diameter > 0
    today = sensor.beam.subrays
    whole = Scan(sensor, observer.caster, settings.seed, way)
    key = settings.seed, "accuracy", sensor.name
    rng = stream(*key)
    starts = np.sort(rng.integers(0, max(whole.pulses - BLOCK, 1), BLOCKS))

    def look(caster: RayCaster, subrays: int) -> tuple[np.ndarray, float]:
        beam = replace(sensor.beam, subrays=subrays)
        scan = Scan(replace(sensor, beam=beam), caster, settings.seed, way)
        scan.look(int(starts[0]), min(int(starts[0]) + BLOCK, scan.pulses))  # build trees of boxes
        begin = time.process_time()
        found = np.concatenate([_first_ranges(scan, int(start)) for start in starts])
        return found, (time.process_time() - begin) * scan.pulses / len(found)

    def rays(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
        number, keys = (
            rng.integers(0, whole.pulses, count),
            rng.integers(0, 2**63, count, np.uint64),
        )
        origins, ways = spread(whole.pattern.pulses(number), sensor.beam, keys)
        one = np.arange(count) * today + rng.integers(0, today, count)
        return origins[one], ways[one]

    return _sweep(
        sensor,
        observer,
        meshes,
        _Beams(
            "range of the first return",
            look,
            today,
            MANY if wide else today,
            SUBRAYS if wide else (),
            lambda n: {"beam": replace(sensor.beam, subrays=n)},
            lambda n: f"{n} sub-ray{'s' * (n > 1)}",
            lambda c: _exactly(c, rays, sensor.max_range, whole.pulses * today, stream(*key)),
            () if wide else ("the beam has no width: one ray is all of it",),
        ),
    )


def sweep_tractor(
    sensor: Tractor, observer: Observer, settings: Scene, meshes: Meshes
) -> AccuracySweep:
    """Errors and seconds of a tractor."""
    along, angles = positions(sensor), len(fan(sensor))
    key = settings.seed, "accuracy", sensor.name
    rng = stream(*key)
    chosen = along[np.sort(rng.integers(0, len(along), min(LINES, len(along))))]
    heading = np.deg2rad(sensor.heading_deg)
    forward = np.array([np.cos(heading), np.sin(heading), 0.0])

    def look(caster: RayCaster, splits: int) -> tuple[np.ndarray, float]:
        found, spent = [], 0.0
        for metres in (chosen[0], *chosen):  # the first twice: trees of boxes are built
            place = tuple(float(v) for v in np.array(sensor.position) + metres * forward)
            one = replace(sensor, position=place, track=sensor.step / 2, splits=splits)
            begin = time.process_time()
            found.append(drive(one, caster).distance.ravel())
            spent += (time.process_time() - begin) * (len(found) > 1)
        distance = np.concatenate(found[1:])
        distance = np.where(np.isfinite(distance), distance, np.nan)
        return distance, spent * len(along) / len(chosen)

    def label(splits: int) -> str:
        many = (splits + 1) ** 2
        return f"{many} ray{'s' * (many > 1)} a beam"

    def rays(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
        return axes(sensor, rng.integers(0, len(along), count), rng.integers(0, angles, count))

    count = len(along) * angles * (sensor.splits + 1) ** 2
    note = f"{len(along) * angles:,} beams; Méndez et al.'s beam is a solid sector whose nearest hit counts"
    return _sweep(
        sensor,
        observer,
        meshes,
        _Beams(
            "distance of a beam",
            look,
            sensor.splits,
            FINE,
            SPLITS,
            lambda n: {"splits": n},
            label,
            lambda c: _exactly(c, rays, sensor.max_range, count, stream(*key)),
            (note,),
        ),
    )


def _exactly(
    caster: RayCaster, draw: Draw, reach: float, rays: int, rng: np.random.Generator
) -> tuple[float, float]:
    """Metres (rms) that an engine is off, and seconds of so many rays in float64."""

    def batches() -> Iterator[np.ndarray]:
        while True:
            yield ray_errors(caster, *draw(rng, BATCH), reach)

    found = sample(batches(), EXACTLY)
    return float(np.sqrt(np.mean(found.errors**2))), found.seconds_each * rays


def _sweep(
    sensor: Scanner | Tractor, observer: Observer, meshes: Meshes, beams: _Beams
) -> AccuracySweep:
    """Rays, meshes and engines, each against the finest of all."""
    tubes = meshes.tubes(FINEST) if meshes.tolerance else None
    many, _ = beams.look(observer.caster, beams.fine)
    truth = many if tubes is None else beams.look(tubes, beams.fine)[0]
    today_found = beams.look(observer.caster, beams.today)

    numerics, slowly = beams.exactly(observer.caster)

    def point(
        found: tuple[np.ndarray, float], label: str, numerics: float = numerics, **given: Any
    ) -> Point:
        error, spread = _rms(found[0] - truth)
        return Point({}, label, math.hypot(error, numerics), spread, found[1], **given)

    seen = today_found[0]
    today = point(today_found, beams.label(beams.today))
    others = []
    for number in beams.tried:
        if number != beams.today:
            tried = point(beams.look(observer.caster, number), beams.label(number))
            others.append(replace(tried, changes=beams.changes(number)))
    for name, title in ENGINES.items():
        caster = meshes.engine(name)
        if caster is not None:
            exact, _ = beams.exactly(caster)
            found = beams.look(caster, beams.today)
            others.append(point(found, f"rays by {title}", exact, engine=name))
    slow = seen, slowly
    others.append(point(slow, "float64 brute force", 0.0, elsewhere="as audits do"))
    terms = {"sampling": _rms(seen - many)[0], "numerics": numerics}
    if tubes is not None:
        terms["mesh"] = _rms(many - truth)[0]
        for times in TUBES:
            caster = meshes.tubes(times)
            if caster is not None:
                label = f"tubes within {1000 * times * meshes.tolerance:.2g} mm"
                found = beams.look(caster, beams.today)
                others.append(point(found, label, elsewhere="the species' detail.tolerance"))
        for share in LEAVES if meshes.leafy else ():
            label = f"{share:.2g} of the leaves, enlarged"
            found = beams.look(meshes.leaves(share), beams.today)
            others.append(point(found, label, elsewhere="the species' detail.leaves"))
    notes = [*beams.notes]
    if truth is not seen and (tubes is not None or beams.fine != beams.today):
        notes.append(_jumps(seen - truth))
    lost = np.isfinite(truth) & ~np.isfinite(seen)
    if lost.any():
        notes.append(f"{lost.mean():.1%} return only with the finest of all that was tried")
    if meshes.tolerance and tubes is None:
        notes.append("finer tubes would not fit into memory: the mesh's part is not known")
    if not meshes.tolerance:
        notes.append("trees are their templates' own meshes: nothing of them can be set")
    return AccuracySweep(
        sensor, beams.what, "m", today, tuple(others), notes=tuple(notes), terms=terms
    )


def _rms(apart: np.ndarray) -> tuple[float, float]:
    return mean_and_spread(apart[np.isfinite(apart)])


def _jumps(apart: np.ndarray) -> str:
    """That a few which meet another surface make nearly all of the error, in words."""
    apart = np.abs(apart[np.isfinite(apart)])
    if not len(apart):
        return "nothing is met"
    other = apart > JUMP
    rest = float(np.median(apart[~other])) if (~other).any() else 0.0
    return (
        f"today {other.mean():.1%} meet another surface than the whole beam does; "
        f"half of the others are within {rest:.0e} m"
    )


def _first_ranges(scan: Scan, start: int) -> np.ndarray:
    """(BLOCK,) metres of the first returns, NaN where there is none."""
    stop = min(start + BLOCK, scan.pulses)
    cloud = scan.look(start, stop)
    found = np.full(stop - start, np.nan)
    first = cloud.number == 1
    found[cloud.pulse[first] - start] = cloud.true_range[first]
    return found
