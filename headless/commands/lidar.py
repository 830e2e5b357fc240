"""``python -m headless lidar FILE.blend``: scan any Blender scene with a real instrument, into a file.

Nothing of a forest of ours need be in the scene. The scan is written chunk by chunk; one that was
interrupted, or killed, goes on with ``--resume``.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from forest_addon.formats.crs import can_tell_crs, wkt_of
from forest_addon.formats.helios.parts import lost_materials
from forest_addon.formats.toml_file import (
    merged,
    parse_tables,
    read_scanner,
    scanner_names,
    structure,
)
from forest_addon.results import POINT_FORMATS
from forest_addon.results.coordinates import Offset
from forest_addon.results.scan_file import write_scan
from forest_addon.sensing.kind import why_nothing
from forest_addon.sensing.kinds import kind_of
from forest_addon.sensing.lidar.pattern import pattern_of
from forest_addon.sensing.lidar.scan import Scan
from forest_addon.spec import SENSORS, Rays, Scanner, Scene, SpecError

from ..command import numbers
from ..progress import Stages, hushed
from ..surveys import scan_survey, write_like

# Options that go with --like and --survey alone, and those that do not go with these.
OF_LIKE, OF_SURVEY = ("trajectory", "trees", "species"), ("assets", "reference", "echoes")
OWN = ("blend", "at", "along", "azimuth", "set", "resume", "chunk")

UP = {".obj": "Y", ".glb": "Y", ".gltf": "Y", ".ply": "Z", ".stl": "Z"}  # as importers take it
TALLEST, SMALLEST = 150.0, 0.3  # metres, of a tree or a plot of trees


def run(chosen: argparse.Namespace) -> None:
    """Scan a .blend file or run a survey, or write the scene of a cloud, or list the scanners.

    Raises
    ------
    SpecError : words that do not go together, or what cannot be scanned.
    """
    if chosen.list:
        print(f"{'scanner':<20}{'instrument':<44}{'on':<22}{'range, m':>10}{'mrad':>12}{'kHz':>7}")
        for name in scanner_names():
            file = read_scanner(name)
            kind, table = next(iter(file.tables.items()))
            sensor = structure(table, SENSORS[kind])
            spread = " x ".join(f"{a:g}" for a in dict.fromkeys(sensor.beam.divergence_mrad))
            print(
                f"{name:<20}{file.title:<44}{', '.join(file.tables):<22}"
                f"{sensor.max_range:>10g}{spread:>12}{sensor.pulse_rate / 1e3:>7.0f}"
            )
        return
    if chosen.like:
        _refuse(chosen, (*OWN, "survey", "format"), "does not go with --like, which writes a scene")
        if chosen.out.suffix != ".toml":
            raise SpecError(f"--out {chosen.out}", "must end in .toml: --like writes a scene")
        write_like(
            *(chosen.like, chosen.out, chosen.scanner, chosen.trajectory, chosen.crs),
            trees=chosen.trees,
            species=chosen.species,
        )
        return
    _refuse(chosen, OF_LIKE, "belongs to --like REAL.laz")
    if chosen.survey:
        beside = "does not go with --survey, which says all that itself"
        _refuse(chosen, (*OWN, "scanner"), beside)
    else:
        _refuse(chosen, OF_SURVEY, "belongs to --survey FILE.xml")
        if chosen.blend is None:
            raise SpecError("lidar", "needs a .blend file; --list prints the scanners")
        sensor = sensor_of(chosen.scanner, chosen.at, chosen.along, chosen.azimuth, chosen.set)
    offset = _offset(chosen)
    if chosen.out.suffix.lower().lstrip(".") not in POINT_FORMATS:
        raise SpecError(f"--out {chosen.out}", f"must end in one of .{', .'.join(POINT_FORMATS)}")
    how = {"seed": chosen.seed, "offset": offset, "engine": chosen.engine, "quiet": chosen.quiet}
    if chosen.survey:
        scan_survey(
            chosen.survey,
            chosen.out,
            assets=chosen.assets,
            reference=chosen.reference,
            echoes=chosen.echoes or "survey",
            **how,
        )
    else:
        scan_blend(
            chosen.blend, sensor, chosen.out, resume=chosen.resume, at_once=chosen.chunk, **how
        )


def _refuse(chosen: argparse.Namespace, words: Sequence[str], why: str) -> None:
    """Refuse the first of these options that was given."""
    for word in words:
        if getattr(chosen, word):
            raise SpecError("FILE.blend" if word == "blend" else f"--{word}", why)


def _offset(chosen: argparse.Namespace) -> Offset:
    """Offset that is added to coordinates, and their system.

    Raises
    ------
    SpecError : not three numbers; a system that PROJ does not know, or cannot be told without it.
    """

    if chosen.crs and not can_tell_crs():
        raise SpecError("--crs", "needs pyproj; install it by pip install pyproj")
    wkt_of(chosen.crs)
    metres = numbers("--offset", chosen.offset, 3) if chosen.offset else (0.0, 0.0, 0.0)
    return Offset(metres, chosen.crs)


def sensor_of(
    scanner: str | None,
    at: str | None,
    along: str | None,
    azimuth: str | None,
    changes: Sequence[str] = (),
) -> Scanner:
    """The sensor of a preset at a place "x,y,z" or along an object, with changes "key=value".

    Raises
    ------
    SpecError : what is missing or cannot be used.
    """

    if not scanner:
        raise SpecError("--scanner", "is missing; --list prints the scanners")
    tables = read_scanner(scanner).tables
    if not (at or along):
        raise SpecError("--at", "is missing; say where the scanner stands: --at x,y,z")
    # What it follows makes it mobile, a place a tripod or an aircraft.
    able = ("mobile",) if along else ("terrestrial", "airborne")
    kind = next((k for k in able if k in tables), None)
    if kind is None:
        needed = "--at" if along else "--along OBJECT"
        raise SpecError(
            "--scanner",
            f'"{scanner}" is no {" or ".join(able)} scanner; use {needed}, or one of '
            + ", ".join(n for n in scanner_names() if set(able) & set(read_scanner(n).tables)),
        )
    table: dict[str, Any] = {"name": "scan", "scanner": scanner}
    if at:
        table["position"] = numbers("--at", at, 3)
    if along:
        table["follow"] = along
    if azimuth and hasattr(SENSORS[kind], "azimuth_deg"):  # a window, on a tripod
        table["azimuth_deg"] = numbers("--azimuth", azimuth, 2)
    elif azimuth:
        table["heading_deg"] = numbers("--azimuth", azimuth, 1)[0]
    for word in changes:
        table = merged(table, _setting(word))
    return structure(merged(tables[kind], table), SENSORS[kind])


def _setting(word: str) -> dict[str, Any]:

    key, equals, value = word.partition("=")
    lines = (f"{key} = {value}", f'{key} = "{value}"')  # a text needs no quotes here
    for line in lines if equals else ():
        try:
            return parse_tables(line, "--set")
        except SpecError:
            continue
    raise SpecError("--set", f'"{word}" is not KEY=VALUE, as in beam.subrays=19')


def scan_blend(
    blend: Path,
    sensor: Scanner,
    target: Path,
    *,
    seed: int = 0,
    offset: Offset,
    engine: str = "auto",
    resume: bool = False,
    at_once: int | None = None,
    quiet: bool = False,
) -> None:
    """Scan a .blend file into a file of points.

    resume : go on with a scan that was not finished. at_once : pulses between two savings.

    Raises
    ------
    SpecError : a scene that cannot be used.
    OSError : a file that cannot be read or written; what was scanned is kept.
    """

    stages = Stages(quiet)
    with hushed():
        import bpy

        from forest_addon.blender.files.export import empty_file, open_file
        from forest_addon.blender.sensors.observe import Observer
    try:
        with stages.stage(f"open {blend.name}"), hushed(errors=True):
            metres = open_file(blend)
        for lost in lost_materials(blend):
            stages.warn(lost)
        with stages.stage("read evaluated scene"):
            observer = Observer(bpy.context.evaluated_depsgraph_get(), Rays(engine=engine))
            if not len(observer.geometry):
                raise SpecError(
                    str(blend), "has nothing to scan: no visible object of its scene has faces"
                )
            caster = observer.caster
        if blend.suffix.lower() != ".blend":
            low, high = observer.geometry.bounds()
            size, doubt = size_of(blend, metres, np.fmin.reduce(low), np.fmax.reduce(high))
            stages.say(f"  {size}")
            if doubt:
                stages.warn(doubt)
        if observer.warning:
            stages.warn(observer.warning)
        way = observer.way(sensor)
        cost = kind_of(sensor).cost(sensor, way, caster.engine)
        stages.say(f"  {replace(cost, memory=0)}")  # points go to the disk as they come
        scan = Scan.of(observer.job(sensor, Scene(seed=seed), way=way))
        started = time.perf_counter()
        with stages.stage(f"scan {scan.pulses:,} pulses") as progress:
            done = write_scan(
                target,
                scan,
                seed,
                offset=offset,
                resume=resume,
                at_once=at_once,
                progress=progress,
            )
        took = time.perf_counter() - started
        if not done.points:
            some = np.linspace(0, scan.pulses - 1, 50).astype(np.int64)
            where = pattern_of(sensor, way).pulses(some).origin
            nothing = why_nothing("0 points", where, sensor.max_range, observer.geometry)
            stages.warn(nothing)
        stages.say(
            f"{done.path}: {done.points:,} points of {done.pulses:,} pulses by {caster.engine}, "
            f"{(done.pulses - done.resumed_at) / took:,.0f} pulses/s"
        )
        if done.unfollowed:
            stages.say(
                f"  {done.unfollowed:,} turned rays met a second mirror, glass or water, and end there"
            )
        for lost in done.lost:
            text = f"Not measured, by a fault of this program that is worth a report: {lost}"
            print(
                text, file=sys.stderr, flush=True
            )  # whoever wants no words but errors wants this one
    finally:
        with hushed():  # with an evaluated scene at hand, bpy 4.5 never ends
            empty_file()


def size_of(path: Path, metres: float, low: np.ndarray, high: np.ndarray) -> tuple[str, str]:
    """Say how a file of meshes was read and how large it is, and what of that is doubtful: else "".

    metres : of a unit of the file. low, high : (3,) m, corners of all that it shows.
    """
    east, north, height = high - low
    up = UP.get(path.suffix.lower(), "")
    told = [f"{length:,.0f}" if length >= 100 else f"{length:.3g}" for length in high - low]
    size = "{} by {} m, {} m high".format(*told)
    said = (
        f"{path.name}: read in {'metres' if metres == 1 else f'units of {metres:g} m'}, "
        f"{f'{up} up' if up else 'up as it says'}: {size}"
    )
    steep = height > max(east, north) / 4
    if max(high - low) < SMALLEST or (height > TALLEST and steep):
        doubt = "no size of a tree or a plot: if its unit is another, scale it"
    elif up and low[2] < -height / 4 and steep:
        other = "Z" if up == "Y" else "Y"
        doubt = f"{-low[2]:.3g} m of it lie below 0: if it has {other} up, turn it"
    else:
        return said, ""
    return said, (
        f"{path.name}: {size}, {doubt} in Blender (Import has Scale and Up), save a .blend and scan that"
    )
