"""LiDAR: how many sub-rays a beam needs; too few see too little of its footprint.

Blocks of pulses, drawn evenly over the scan, are sent with each number of sub-rays and with many; the error
is the difference of the first return's range, metres, root mean square over pulses that both saw. The
tractor's beams are swept likewise. Rays themselves are exact to 1e-12 m with either engine.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from forest_addon.blender.observe import Observer
from forest_addon.rng import stream
from forest_addon.sensing.lidar.scan import Scan
from forest_addon.sensing.lidar.tractor import drive, fan, positions
from forest_addon.spec import Scanner, Scene, Tractor

from .sweep import Point, Sweep, mean_and_spread

SUBRAYS = (1, 3, 7, 19, 37, 61)
MANY = 397
SPLITS = (0, 1, 2, 4)
FINE = 12
BLOCKS, BLOCK = 24, 32  # pulses
LINES = 6  # scans of a tractor
RAYS = 1e-12  # m, of rays, as their audits say
JUMP = 0.1  # m, and more: another surface


def sweep_scanner(sensor: Scanner, observer: Observer, settings: Scene, way: object) -> Sweep:
    """Errors and seconds of a scanner by sub-rays."""
    today = sensor.beam.subrays
    wide = max(sensor.beam.divergence_mrad) > 0 or sensor.beam.exit_diameter > 0
    tried = sorted({today, *(SUBRAYS if wide else ())})
    starts = None
    first: dict[int, np.ndarray] = {}
    seconds: dict[int, float] = {}
    pulses = 0
    for subrays in (*tried, *((MANY,) if wide else ())):
        beam = replace(sensor.beam, subrays=subrays)
        scan = Scan(replace(sensor, beam=beam), observer.caster, settings.seed, way)
        pulses = scan.pulses
        if starts is None:
            rng = stream(settings.seed, "accuracy", sensor.name)
            starts = np.sort(rng.integers(0, max(pulses - BLOCK, 1), BLOCKS))
            scan.look(int(starts[0]), min(int(starts[0]) + BLOCK, pulses))  # build trees of boxes
        begin = time.process_time()
        first[subrays] = np.concatenate([_first_ranges(scan, int(start)) for start in starts])
        seconds[subrays] = (time.process_time() - begin) * pulses / len(first[subrays])

    def point(subrays: int) -> Point:
        error, spread = 0.0, 0.0
        if wide:
            apart = first[subrays] - first[MANY]
            error, spread = mean_and_spread(apart[np.isfinite(apart)])
        changes = {"beam": replace(sensor.beam, subrays=subrays)}
        label = f"{subrays} sub-ray{'s' * (subrays > 1)}"
        return Point(changes, label, error, spread, seconds[subrays])

    notes, terms = [], {"numerics": RAYS}
    if wide:
        terms["sampling"] = point(today).error
        notes.append(_jumps(first[today] - first[MANY]))
        lost = np.isfinite(first[MANY]) & ~np.isfinite(first[today])
        notes.append(
            f"{lost.mean():.1%} of pulses return only with more sub-rays than today's {today}"
        )
    else:
        notes.append("the beam has no width: one ray is all of it, exact to 1e-12 m")
    return Sweep(
        sensor,
        "range of the first return, sampling of the footprint",
        "m",
        point(today),
        tuple(point(subrays) for subrays in tried if subrays != today),
        notes=tuple(notes),
        terms=terms,
    )


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


def sweep_tractor(sensor: Tractor, observer: Observer, settings: Scene) -> Sweep:
    """Errors and seconds of a tractor by the splits of its beam."""
    tried = sorted({sensor.splits, *SPLITS})
    along, angles = positions(sensor), len(fan(sensor))
    rng = stream(settings.seed, "accuracy", sensor.name)
    chosen = along[np.sort(rng.integers(0, len(along), min(LINES, len(along))))]
    heading = np.deg2rad(sensor.heading_deg)
    forward = np.array([np.cos(heading), np.sin(heading), 0.0])

    def lines(splits: int) -> tuple[np.ndarray, float]:
        begin, found = time.process_time(), []
        for metres in chosen:
            place = tuple(float(v) for v in np.array(sensor.position) + metres * forward)
            one = replace(sensor, position=place, track=sensor.step / 2, splits=splits)
            found.append(drive(one, observer.caster).distance.ravel())
        spent = time.process_time() - begin
        return np.concatenate(found), spent * len(along) / len(chosen)

    lines(0)  # build trees of boxes
    many, _ = lines(FINE)

    def point(splits: int) -> Point:
        distance, seconds = lines(splits)
        with np.errstate(invalid="ignore"):
            apart = distance - many
        error, spread = mean_and_spread(apart[np.isfinite(apart)])
        rays = (splits + 1) ** 2
        label = f"{rays} ray{'s' * (rays > 1)} a beam"
        return Point({"splits": splits}, label, error, spread, seconds)

    today = point(sensor.splits)
    with np.errstate(invalid="ignore"):
        jumps = _jumps(lines(sensor.splits)[0] - many)
    note = f"{len(along) * angles:,} beams; S's beam is a solid sector whose nearest hit counts"
    return Sweep(
        sensor,
        "distance of a beam, sampling of its sector",
        "m",
        today,
        tuple(point(splits) for splits in tried if splits != sensor.splits),
        notes=(note, jumps),
        terms={"sampling": today.error, "numerics": RAYS},
    )
