"""Surveys of others by our scanner, for ``lidar --survey`` and ``lidar --like``.

A survey of HELIOS++ is run, every active leg into a file, its counts beside a reference's. From a real
cloud a scene is written that is flown as it was: its lines, heights, patterns and rates, read from the
LAS file.
"""

from __future__ import annotations

import json
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from forest_addon.base.trimesh import GROUND, LEAF, OTHER, TriMesh
from forest_addon.formats.crs import in_metres, metres_of, short
from forest_addon.formats.helios.survey import Leg, Survey, read_survey
from forest_addon.formats.las import read_las, units_of
from forest_addon.formats.raster_file import read_raster
from forest_addon.formats.table import write_csv
from forest_addon.formats.toml_file import read_scanner, structure, write_settings
from forest_addon.formats.tree_map import NUMBERS, read_tree_map
from forest_addon.results.coordinates import NO_OFFSET, Offset
from forest_addon.results.scan_file import write_scan
from forest_addon.sensing.lidar.cloud import Cloud
from forest_addon.sensing.lidar.surveys.digitised import Haze, SurveyScan, rings
from forest_addon.sensing.lidar.surveys.leg import SurveyLeg, step_count
from forest_addon.sensing.lidar.surveys.like import (
    FlightLine,
    FlownPattern,
    lines_of,
    pattern_like,
    scanner_like,
    split_lines,
)
from forest_addon.sensing.lidar.surveys.stepped import SteppedPath
from forest_addon.sensing.lidar.surveys.trajectories import read_trajectory
from forest_addon.sensing.moving import MovingScene
from forest_addon.sensing.rays.caster import RayCaster
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.rays.paths import SceneMotion
from forest_addon.spec import (
    Beam,
    Forest as Field,
    Mobile,
    Noise,
    Planting,
    Rays,
    Scene,
    SpecError,
    Terrain,
    Terrestrial,
)

from .command import species_of_map
from .progress import Stages, hushed

ECHOES = ("survey", "waveform")
FARTHEST = 1e5  # metres that a scanner may see
MOST_RETURNS = 15  # that a point file numbers


@dataclass(frozen=True)
class LegCounts:
    """Counts of a leg: points, pulses that came back, pulses with one return, the mean of its points (3,),
    CPU seconds."""

    name: str
    points: int
    pulses: int
    single: int
    mean: np.ndarray
    seconds: float


class CountedScan(SurveyScan):
    """A scan that counts its pulses that come back and those with one return, and sums its points."""

    def chunks(self, first: int = 0, at_once: int | None = None) -> Iterator[tuple[int, Cloud]]:
        """See ``Scan.chunks``."""
        self.came, self.total = np.zeros(2, dtype=np.int64), np.zeros(3)
        for stop, cloud in super().chunks(first, at_once):
            self.came += (cloud.number == 1).sum(), (cloud.count == 1).sum()
            self.total += cloud.position.sum(axis=0)
            yield stop, cloud


def scan_survey(
    path: Path,
    target: Path,
    *,
    assets: Path | None = None,
    reference: Path | None = None,
    offset: Offset = NO_OFFSET,
    seed: int = 0,
    engine: str = "auto",
    echoes: str = ECHOES[0],
    quiet: bool = False,
) -> list[LegCounts]:
    """Run a survey of HELIOS++, each active leg into a file: NAME-leg000.laz and so on.

    assets : where paths in the survey start. reference : counts of each leg to be held beside ours.
    seed : of noise and chances. engine : who casts the rays. echoes : of ``ECHOES``: as HELIOS++ finds them,
    by the survey's bins and window, or as our scanners do.

    Raises
    ------
    SpecError : a survey that asks for what is not supported, or a file that cannot be read.
    OSError : a file that cannot be written.
    """
    stages = Stages(quiet)
    with stages.stage(f"read {path.name}"):
        survey = read_survey(path, assets)
        beside = _reference(reference) if reference else {}
    for note in survey.notes:
        stages.warn(note)
    if survey.offset.any():
        stages.say(
            f"  computed {survey.offset} m nearer to the origin; files hold the map's coordinates"
        )
    offset = Offset(np.array(offset) + survey.offset, offset.crs)
    plays = survey.plays
    if len(plays) > 1:
        stages.say(f"  parts are swapped: the survey is played {len(plays)} times")
    target.parent.mkdir(parents=True, exist_ok=True)
    found = []
    for play, legs in enumerate(plays):
        prefix = f"play{play}-" if len(plays) > 1 else ""
        with stages.stage("make the scene"), hushed():
            caster_of = casters_of(legs, engine)
        for index, leg in enumerate(legs.legs):
            name = f"{prefix}leg{index:03d}"
            if not leg.active:
                stages.say(f"  {name}: the scanner is off")
                continue
            sensor, pattern = sensor_of_survey(legs, leg, name), SurveyLeg(legs, leg)
            scan = CountedScan(sensor, caster_of(index), seed, pattern=pattern)
            if echoes == "survey" and leg.digitiser.rings > 1:
                across = np.pi / 2 if legs.device.optics == "conic" else 0.0
                scan = scan.sampled(leg.digitiser, across)
            scan = scan.among(hazes_of(legs))
            file = target.with_name(f"{target.stem}-{name}{target.suffix}")
            started = time.process_time()
            with stages.stage(f"{name}, {scan.pulses:,} pulses") as progress:
                done = write_scan(file, scan, seed, offset=offset, progress=progress)
            took = time.process_time() - started
            if not done.points:
                near, far = scan.scanner.min_range, scan.scanner.max_range
                stages.warn(f"{name} has no point: nothing stands from {near:g} to {far:g} m away")
            mean = scan.total / max(done.points, 1)
            found.append(LegCounts(name, done.points, *scan.came.tolist(), mean, took))
            engine_of = scan.caster.engine
            stages.say(f"{file}: {done.points:,} points of {done.pulses:,} pulses by {engine_of}")
    if not quiet:
        print("\n".join(table_of(found, beside)))
    return found


def casters_of(survey: Survey, engine: str) -> Callable[[int], RayCaster]:
    """Casters of the rays of each leg, by its number: the same for all where nothing moves."""
    from forest_addon.blender.rays.casters import make_caster, make_moving_caster

    rays = Rays(engine=engine)
    scene = geometry_of(survey)
    moving = {i: part for i, part in enumerate(survey.parts) if part.motion}
    if not moving:
        still = make_caster(scene, rays)
        return lambda _leg: still
    sent = np.cumsum([0, *(step_count(survey, leg) for leg in survey.legs)]).tolist()

    def caster(index: int) -> RayCaster:
        leg = survey.legs[index]
        pulses = sent[index], sent[index + 1] - sent[index]
        paths = {
            i: SteppedPath(part.transform, part.middle, part.motion, leg.pulse_rate, pulses)
            for i, part in moving.items()
            if part.motion
        }
        return make_moving_caster(MovingScene(scene, SceneMotion(paths)), rays)

    return caster


def geometry_of(survey: Survey) -> SceneGeometry:
    """The parts of a scene as what rays meet; ground is labelled as such.

    Of voxels that light passes by chance a triangle without area stands for all: ``hazes_of`` has them.
    """
    meshes, parts = [], survey.parts
    for part in parts:
        if part.mesh.hazes:
            nowhere = np.repeat(part.mesh.vertices[:1], 3, axis=0)
            meshes.append(TriMesh.of_part(nowhere, np.array([[0, 1, 2]]), LEAF))
            continue
        mesh = TriMesh.of_part(part.mesh.vertices, part.mesh.triangles, OTHER)
        mesh.part[part.mesh.ground] = GROUND
        meshes.append(replace(mesh, material=part.mesh.slot))
    none = np.full(len(parts), -1, dtype=np.int64)
    return SceneGeometry(
        meshes=tuple(meshes),
        transform=np.array([part.transform for part in parts]),
        mesh_index=np.arange(len(parts)),
        object_name=tuple(part.name for part in parts),
        tree=none,
        species=none.copy(),
        slot_reflectance=survey.reflectance,
    )


def hazes_of(survey: Survey) -> tuple[Haze, ...]:
    """Voxels of a survey that light passes by chance."""
    return tuple(
        Haze(number, part.transform, grid.low, grid.size, grid.density)
        for number, part in enumerate(survey.parts)
        for grid in part.mesh.hazes
    )


def sensor_of_survey(survey: Survey, leg: Leg, name: str) -> Terrestrial:
    """Settings of the light and the receiver; directions are the leg's own (``SurveyLeg``).

    A pulse is as many rays as the rings of HELIOS++'s beam sample quality have.
    """
    device = survey.device
    spread = leg.divergence * 1e3
    return Terrestrial(
        name=name,
        min_range=device.ranges[0],
        max_range=min(device.ranges[1], FARTHEST),
        pulse_rate=leg.pulse_rate,
        beam=Beam(
            wavelength_nm=device.wavelength_nm,
            divergence_mrad=(spread, spread),
            subrays=len(rings(leg.digitiser.rings)[1]),
            pulse_ns=device.pulse_ns,
            max_returns=min(device.max_returns or MOST_RETURNS, MOST_RETURNS),
        ),
        noise=Noise(range_sd=device.accuracy),
    )


def table_of(found: list[LegCounts], beside: Mapping[str, Any]) -> list[str]:
    """Lines of a table: points, pulses that came back and those with one return, ours and the reference's."""
    kinds = ("points", "pulses", "single")
    more, end = (f"{'ref.':>12}{'%':>8}", f"{'centre, m':>11}") if beside else ("", "")
    lines = [f"{'leg':<8}" + "".join(f"{kind:>12}{more}" for kind in kinds) + f"{end}{'CPU s':>8}"]
    for leg in found:
        line, other, away = f"{leg.name:<8}", beside.get(leg.name), ""
        theirs: tuple[int | None, ...] = (None,) * 3
        if other is not None:
            single = other["returns_per_pulse"].get("1", 0)
            theirs = int(other["points"]), int(other["pulses_with_returns"]), int(single)
            away = f"{float(np.linalg.norm(leg.mean - np.array(other['mean_xyz']))):>11.3f}"
        for mine, its in zip((leg.points, leg.pulses, leg.single), theirs, strict=True):
            line += f"{mine:>12,}"
            line += "" if its is None else f"{its:>12,}{100 * (mine / max(its, 1) - 1):>+8.2f}"
        lines.append(f"{line}{away}{leg.seconds:>8.1f}")
    return lines


def _reference(path: Path) -> Mapping[str, Any]:
    """The legs of a JSON file of counts.

    Raises
    ------
    SpecError : it cannot be read, or holds something else.
    """
    try:
        legs = json.loads(path.read_text("utf-8"))["legs"]
        for leg in legs.values():
            if not {"points", "pulses_with_returns", "returns_per_pulse", "mean_xyz"} <= leg.keys():
                raise KeyError("points")
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as problem:
        raise SpecError(str(path), f"holds no counts of legs: {problem}") from None
    return dict(legs)


WEEK, ADJUSTED = 604_800, 1e9  # s
SCAN_ANGLE = 0.006  # degrees a step of a LAS file's scan angle
RANGE = 1.3  # times the farthest return: the range of a scanner that nobody named


@dataclass(frozen=True)
class FlownCloud:
    """Returns of a real flight: place (N, 3) m, time (N,) s, number and count (N,) of returns, line (N,), the
    scan angle (N,) that its file says, degrees, and its coordinate system."""

    place: np.ndarray
    time: np.ndarray
    number: np.ndarray
    count: np.ndarray
    line: np.ndarray
    angle: np.ndarray
    crs: str


ENOUGH = 20  # variants of a species that a plot's trees are, each in the size of its own diameter


def write_like(
    cloud_file: Path,
    target: Path,
    scanner: str | None = None,
    trajectory: Path | None = None,
    crs: str = "",
    say: Callable[[str], object] = print,
    trees: Path | None = None,
    species: Sequence[str] = (),
) -> Scene:
    """Write a scene with one scanner for each flight line of a cloud, flown and swept like it; return it.

    scanner : an instrument whose light and receiver are taken. trajectory : CSV or SBET in the cloud's
    coordinates and clock, in place of the way that pulses tell. crs : the system of the cloud if it names
    none, which an SBET goes to. trees : a table of the trees that stand there, which are planted on the
    ground of the cloud; species : NAME=PRESET of its names.

    Raises
    ------
    SpecError : a file that cannot be read, or a cloud that does not tell a single line.
    """
    if trees is not None and metres_of(crs) != (1.0, 1.0):
        raise SpecError(
            "--crs",
            f'"{crs}" does not count in metres, and --trees are planted in metres: leave it out if the cloud '
            "names its system itself, else convert cloud and table to metres",
        )
    cloud = read_flown(cloud_file, crs)
    system = in_metres(cloud.crs, cloud.place[:, :2].mean(axis=0))
    if cloud.crs and not system:
        say(f"no system in metres is {short(cloud.crs)}: the scene is written without crs")
    flown = read_trajectory(trajectory, crs) if trajectory else None
    lines = lines_of(cloud.place, cloud.time, cloud.number, cloud.count, cloud.line)
    if flown is not None:
        flown = _on_one_clock(flown, cloud.time)
        lines = {}
        for number in np.unique(cloud.line).tolist():
            when = cloud.time[cloud.line == number]
            some = _during(flown, float(when.min()), float(when.max()))
            if len(some) > 1:
                lines[number] = FlightLine(number, some[:, 0], some[:, 1:4], len(when), 0.0)
        if not lines:
            raise SpecError(
                "--trajectory",
                f"goes from {flown[0, 0]:.3f} to {flown[-1, 0]:.3f} s, the cloud from "
                f"{cloud.time.min():.3f} to {cloud.time.max():.3f} s; give both the same clock",
            )
    low = np.floor(cloud.place.min(axis=0))
    sensors, report = [], []
    for number, line in lines.items():
        rows = (cloud.line == number) & (cloud.number == 1)
        try:
            pattern = pattern_like(line, cloud.place[rows], cloud.time[rows], cloud.angle[rows])
        except SpecError as problem:
            report.append(f"left out: {problem}")
            continue
        far = np.linalg.norm(cloud.place[rows] - line.at(cloud.time[rows]), axis=1)
        plain = _instrument(scanner, float(far.max()), int(cloud.count.max()))
        rows_of = None if flown is None else _during(flown, line.time[0], line.time[-1])
        sensors.append(scanner_like(plain, line, pattern, low, rows_of))
        report.append(_told(line, pattern, far, low, int(rows.sum())))
    if not sensors:
        raise SpecError(
            str(cloud_file),
            "tells no flight line: it needs GPS times and pulses of several returns 2 m and more apart"
            + (f" ({report[0]})" if report else ""),
        )
    side = np.maximum(np.ceil(np.ptp(cloud.place[:, :2], axis=0)), 1.0)
    scene = Scene(
        offset=tuple(low.tolist()),
        crs=system,
        forest=Field(origin=(0.0, 0.0), size=(float(side[0]), float(side[1]))),
        sensors=tuple(sensors),
    )
    target.parent.mkdir(parents=True, exist_ok=True)
    for words in report:
        say(words)
    then = "plant it with [[plantings]], or by --trees TABLE, then: run"
    if trees is not None:
        ground = Terrain(file=Path(os.path.relpath(cloud_file, target.parent)).as_posix())
        plantings = _planted(trees, species, target, system, say)
        say(f"making a grid of the ground of {cloud_file.name}, {len(cloud.place):,} returns")
        raster = read_raster(cloud_file)
        rows, columns = raster.pixels.shape
        ends = np.sort(raster.places(np.array([0, columns]), np.array([0, rows])), axis=0) - low[:2]
        corner = np.ceil(ends[0])
        side = np.floor(ends[1]) - corner
        field = Field(
            origin=(float(corner[0]), float(corner[1])),
            size=(float(side[0]), float(side[1])),
            terrain=ground,
        )
        scene = scene.changed(forest=field, plantings=plantings)
        then = "its trees on its ground; then: run"
    write_settings(target, scene)
    pulses = int((cloud.number == 1).sum())
    say(
        f"{target}: {len(sensors)} lines over {side[0]:.0f} x {side[1]:.0f} m, {pulses / side.prod():.3g} "
        f"pulses/m² in the cloud; {then}"
    )
    return scene


def _planted(
    table: Path, species: Sequence[str], target: Path, crs: str, say: Callable[[str], object]
) -> tuple[Planting, ...]:
    """Write the trees of a table beside a scene, in metres and by the names of our species; return their
    plantings."""
    trees = read_tree_map(table, crs)
    for line in trees.said:
        say(line)
    kinds = species_of_map(np.unique(trees.species).tolist(), species, target.parent)
    for name, kind in kinds.items():
        if name != kind:
            say(f'"{name}" is planted as {kind}')
    file = target.with_name(f"{target.stem}-trees.csv")
    planted = [kinds[str(name)] for name in trees.species]
    columns: dict[str, list[Any]] = dict(zip("xy", trees.position.T.tolist(), strict=True))
    columns["species"] = [Path(kind).stem for kind in planted]
    known = dict(zip(NUMBERS, trees.numbers.T, strict=True))
    write_csv(file, columns | {k: v.tolist() for k, v in known.items() if np.isfinite(v).any()})
    count = Counter(planted)
    return tuple(
        Planting(species=kind, layout="list", trees=file.name, variants=min(many, ENOUGH))
        for kind, many in count.items()
    )


def read_flown(path: Path, crs: str = "") -> FlownCloud:
    """The returns of a LAS file with their lines. crs : its system, if it names none.

    Raises
    ------
    SpecError : it is no LAS file, is empty, or has no GPS times, or such as do not run.
    """
    cloud = read_las(path, crs)
    names = set(cloud.point_format.dimension_names)
    time = np.asarray(cloud.gps_time) if "gps_time" in names else np.zeros(1)
    if not np.isfinite(time).all() or not np.ptp(time) > 0:
        raise SpecError(
            str(path),
            f"has no GPS times, or GPS times that do not run ({time[0]:g} s); export them",
        )
    if (np.diff(time) < 0).mean() > 1e-3:  # sorted by place, as COPC, not line after line
        cloud.points = cloud.points[np.lexsort((cloud.return_number, time))]
    return FlownCloud(
        np.asarray(cloud.xyz),
        np.asarray(cloud.gps_time),
        np.asarray(cloud.return_number),
        np.asarray(cloud.number_of_returns),
        split_lines(np.asarray(cloud.gps_time), np.asarray(cloud.point_source_id)),
        np.asarray(
            cloud.scan_angle * SCAN_ANGLE
            if "scan_angle" in names
            else cloud.scan_angle_rank.astype(float)
        ),
        units_of(path, cloud.header, crs)[0],
    )


def _instrument(name: str | None, far: float, most: int) -> Mobile:
    """A mobile scanner of a preset, or one ray of everything within a third more than the farthest return."""
    if name is None:
        beam = Beam(max_returns=int(np.clip(most, 1, 15)))
        return Mobile(max_range=RANGE * far, min_range=1.0, beam=beam)
    tables = read_scanner(name).tables
    kind = next((k for k in ("mobile", "airborne") if k in tables), None)
    if kind is None:
        raise SpecError("--scanner", f'"{name}" does not fly; take one that is mobile or airborne')
    known = Mobile.__dataclass_fields__
    return structure(
        {k: v for k, v in tables[kind].items() if k in known and k != "position"}, Mobile
    )


def _on_one_clock(flown: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Poses (K, 7) on the clock of a cloud's times (N,): where one counts seconds of the week and the other
    GPS time less 1e9 s (LAS 1.4, adjusted standard), the week is the other's."""
    weekly = [bool(0 <= np.median(when) < 2 * WEEK) for when in (flown[:, 0], time)]
    if weekly[0] == weekly[1]:
        return flown
    sign, known = (1, time) if weekly[0] else (-1, flown[:, 0])
    week = np.floor((np.median(known) + ADJUSTED) / WEEK)
    for number in (week, week - 1):  # a flight over the turn of the week counts on
        moved = flown.copy()
        moved[:, 0] += sign * (number * WEEK - ADJUSTED)
        if moved[0, 0] <= time.max() and moved[-1, 0] >= time.min():
            return moved
    return flown


def _during(flown: np.ndarray, start: float, stop: float) -> np.ndarray:
    """The poses from the last one before to the first one after; none where times do not meet."""
    first = max(int(np.searchsorted(flown[:, 0], start, "right")) - 1, 0)
    last = int(np.searchsorted(flown[:, 0], stop)) + 1
    met = flown[0, 0] <= stop and flown[-1, 0] >= start
    return flown[first:last] if met else flown[:0]


def _told(
    line: FlightLine, pattern: FlownPattern, far: np.ndarray, low: np.ndarray, pulses: int
) -> str:
    """A line in words."""
    high = float(line.place[:, 2].mean() - low[2])
    return (
        f"line {line.number}: {pulses:,} pulses, {np.linalg.norm(line.velocity):.1f} m/s, {high:.0f} m "
        f"over the lowest point, ranges {far.min():.0f} to {far.max():.0f} m, "
        f"{pattern.field_deg[0]:.0f} to "
        f"{pattern.field_deg[1]:.0f}°, {pattern.line_rate:.1f} lines/s, {pattern.own_rate / 1e3:.0f} kHz"
        f"{', zigzag' if pattern.zigzag else ''}; beams miss the line by {1000 * line.miss:.0f} mm"
    )
