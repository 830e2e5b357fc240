"""A scene that is flown as a real cloud was: its lines, heights, patterns and rates, read from the LAS
file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from forest_addon.formats.las import read_las
from forest_addon.formats.toml_file import read_scanner, structure, write_settings
from forest_addon.sensing.lidar.surveys.like import (
    FlightLine,
    FlownPattern,
    lines_of,
    pattern_like,
    scanner_like,
    split_lines,
)
from forest_addon.sensing.lidar.surveys.trajectories import read_trajectory
from forest_addon.spec import Beam, Mobile, Pose, Scene, SpecError
from forest_addon.spec import Forest as Field

RANGE = 1.3  # times the farthest return: the range of a scanner that nobody named


@dataclass(frozen=True)
class FlownCloud:
    """Returns of a real flight: place (N, 3) m, time (N,) s, number and count (N,) of returns, line (N,)."""

    place: np.ndarray
    time: np.ndarray
    number: np.ndarray
    count: np.ndarray
    line: np.ndarray


def write_like(
    cloud_file: Path,
    target: Path,
    scanner: str | None = None,
    trajectory: Path | None = None,
    crs: str = "",
    say: object = print,
) -> Scene:
    """Write a scene with one scanner for each flight line of a cloud, flown and swept like it; return it.

    scanner : an instrument whose light and receiver are taken. trajectory : CSV or SBET in the cloud's
    coordinates and clock, in place of the way that pulses tell. crs : the system that an SBET goes to.

    Raises
    ------
    SpecError : a file that cannot be read, or a cloud that does not tell a single line.
    """
    cloud = read_flown(cloud_file)
    flown = read_trajectory(trajectory, crs) if trajectory else None
    lines = lines_of(cloud.place, cloud.time, cloud.number, cloud.count, cloud.line)
    if flown is not None:
        lines = _lines_by(flown, cloud)
    low = np.floor(cloud.place.min(axis=0))
    sensors, report = [], []
    for number, line in lines.items():
        rows = (cloud.line == number) & (cloud.number == 1)
        try:
            pattern = pattern_like(line, cloud.place[rows], cloud.time[rows])
        except SpecError as short:
            report.append(f"left out: {short}")
            continue
        far = np.linalg.norm(cloud.place[rows] - line.at(cloud.time[rows]), axis=1)
        plain = _instrument(scanner, float(far.max()), int(cloud.count.max()))
        made = scanner_like(plain, line, pattern, low, line.time[0])
        if flown is not None:
            made = made.changed(poses=_poses(flown, line, low))
        sensors.append(made)
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
        forest=Field(origin=(0.0, 0.0), size=(float(side[0]), float(side[1]))),
        sensors=tuple(sensors),
    )
    target.parent.mkdir(parents=True, exist_ok=True)
    write_settings(target, scene)
    for words in report:
        say(words)  # type: ignore[operator]
    pulses = int((cloud.number == 1).sum())
    say(  # type: ignore[operator]
        f"{target}: {len(sensors)} lines over {side[0]:.0f} x {side[1]:.0f} m, {pulses / side.prod():.3g} "
        "pulses/m² in the cloud; plant it with [[plantings]], then: run"
    )
    return scene


def read_flown(path: Path) -> FlownCloud:
    """The returns of a LAS file with their lines.

    Raises
    ------
    SpecError : it is no LAS file, is empty, or has no GPS times.
    """
    cloud = read_las(path)
    if "gps_time" not in set(cloud.point_format.dimension_names):
        raise SpecError(str(path), "has no GPS times; export it with them")
    time = np.asarray(cloud.gps_time)
    return FlownCloud(
        np.asarray(cloud.xyz),
        time,
        np.asarray(cloud.return_number),
        np.asarray(cloud.number_of_returns),
        split_lines(time, np.asarray(cloud.point_source_id)),
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


def _lines_by(flown: np.ndarray, cloud: FlownCloud) -> dict[int, FlightLine]:
    """Flight lines on a given trajectory (K, 7): its poses while each line was flown."""
    found = {}
    for number in np.unique(cloud.line).tolist():
        when = cloud.time[cloud.line == number]
        some = _during(flown, float(when.min()), float(when.max()))
        if len(some) > 1:
            found[number] = FlightLine(number, some[:, 0], some[:, 1:4], len(when), 0.0)
    if not found:
        raise SpecError(
            "--trajectory",
            f"goes from {flown[0, 0]:.3f} to {flown[-1, 0]:.3f} s, the cloud from {cloud.time.min():.3f} to "
            f"{cloud.time.max():.3f} s; give both the same clock",
        )
    return found


def _during(flown: np.ndarray, start: float, stop: float) -> np.ndarray:
    """The poses from the last one before to the first one after; none where times do not meet."""
    first = max(int(np.searchsorted(flown[:, 0], start, "right")) - 1, 0)
    last = int(np.searchsorted(flown[:, 0], stop)) + 1
    met = flown[0, 0] <= stop and flown[-1, 0] >= start
    return flown[first:last] if met else flown[:0]


def _poses(flown: np.ndarray, line: FlightLine, low: np.ndarray) -> tuple[Pose, ...]:
    rows = _during(flown, float(line.time[0]), float(line.time[-1]))
    return tuple(
        Pose(
            time=round(float(row[0] - line.time[0]), 6),
            position=tuple(float(v) for v in np.round(row[1:4] - low, 3)),
            heading_deg=float(row[4]),
            pitch_deg=float(row[5]),
            roll_deg=float(row[6]),
        )
        for row in rows
    )


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
