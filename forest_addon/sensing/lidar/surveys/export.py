"""Scanners of ours as surveys of HELIOS++: the nearest that it can say, and in sentences what it cannot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import count
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from scipy.spatial.transform import Rotation

from ....formats.helios.writing import rotated, words, write_document
from ....spec import (
    Airborne,
    Beam,
    Mobile,
    MovingScanner,
    Noise,
    Scanner,
    Sensor,
    Surfaces,
    Terrestrial,
    Tractor,
)
from ...trajectory import Trajectory, strips
from ..pattern import Pattern, directions, pattern_of
from ..tractor import fan, origins_of, positions
from .digitised import rings
from .trajectories import beam_poses, canonical, write_poses

LEAVE_TOGETHER = "the beams of a column leave at one time"
DIFFER = {  # where the pulses of a pattern go in HELIOS++
    "spinning": LEAVE_TOGETHER,
    "circles": "circles begin anew with each leg",
    "zigzag": "its mirror turns round as theirs do, in 50 pulses: as many pulses, in other places",
    "fans": "its three fans look at one time, each a third as fast, not by turns",
    "lines": "a strip begins in the middle of a line, and lines may have a pulse more at their end",
}
FANS = 3  # that look down, ahead and back
ROWS_A_SECOND, MOST_POSES = 100.0, 200_000  # of a trajectory
MOST_PULSES = 1_000_000  # that have a row each
FEWEST_SWING = 204  # pulses of a mirror's swing: theirs turns round in 50 at each end, twice
MOST_ROWS = 10_000  # beams one above the other, that a scanner is given as channels
THEIRS = Rotation.from_euler("z", np.pi / 2)  # from our axes to theirs
SCENES = "data/scenes"


class NoSurveyError(ValueError):
    """HELIOS++ has no scanner like a sensor."""


Written = tuple[Element, Element, list[Element]]  # scanner, platform, legs


def write_survey(
    sensor: Sensor, folder: Path, scene: str, surfaces: Surfaces, way: Trajectory | None = None
) -> tuple[str | None, list[str]]:
    """Write the survey of a sensor with its scanner and platform, if HELIOS++ has one like it.

    surfaces : that the materials were made of. way : of a mobile sensor.

    Returns
    -------
    the survey's path within the folder, None where HELIOS++ has none; what was not said, in sentences.
    """
    name = f"{scene}-{sensor.name}"
    way, file = way or flown(sensor), f"data/trajectories/{name}.trj"
    try:
        (scanner, platform, legs), unsaid = _told(sensor, way, folder, file)
    except NoSurveyError as why:
        return None, [str(why)]
    files = f"data/scanners-{name}.xml", f"data/platforms-{name}.xml"
    survey = Element(
        "survey",
        name=name,
        scene=f"{SCENES}/{scene}.xml#{scene}",
        platform=f"{files[1]}#platform",
        scanner=f"{files[0]}#scanner",
    )
    if platform.get("type") == "interpolated":
        survey.attrib |= {"basePlatform": f"{files[1]}#platform", "platform": "interpolated"}
        survey.set("rotationSpec", "CANONICAL")
        platform.set("type", "linearpath")
    survey.extend(legs)
    path = f"data/surveys/{name}.xml"
    for target, element in zip((*files, path), (scanner, platform, survey), strict=True):
        root = Element("document")
        root.append(element)
        write_document(folder / target, root)
    if isinstance(sensor, Scanner):  # what HELIOS++ has no word for
        beam, noise, receiver = sensor.beam, sensor.noise, sensor.receiver
        _, rays = _rings(beam.subrays)
        sentences = {
            "its reflectances differ from those of the first scanner, which the materials have": (
                sensor.surfaces != surfaces
            ),
            "its beam is told as round, as wide as the mean of both divergences": (
                len(set(beam.divergence_mrad)) > 1
            ),
            "the width of the beam at its exit (exit_diameter) is left out": beam.exit_diameter,
            f"its {beam.subrays} rays of equal energy are rings of {rays}": beam.subrays > 1,
            "the threshold of detection (faintest) is left out: HELIOS++ has watts of its own": (
                sensor.faintest
            ),
            "of its noise only range_sd is told": (
                noise.range_ppm
                or noise.incidence_sd
                or noise.drop_out
                or noise.registration_sd_or_deg
            ),
            "settings of its receiver are left out": receiver != type(receiver)(),
            "extinction by the air is left out": beam.extinction,
            "the scene stands as at the present frame": sensor.motion,
            "bounces are left out": sensor.bounces,
        }
        unsaid += [sentence for sentence, holds in sentences.items() if holds]
    return path, unsaid


def _told(
    sensor: Sensor, way: Trajectory | None, folder: Path, file: str
) -> tuple[Written, list[str]]:
    """Scanner, platform and legs like a sensor, and sentences on how they differ.

    Raises
    ------
    NoSurveyError : HELIOS++ has none like it; says why.
    """
    in_json = "its way is in scene.json"
    if isinstance(sensor, Tractor):
        _refuse_rows(len(fan(sensor)))
        unsaid = ["points, not a matrix of distances; intensities are those of the surfaces"]
        unsaid += ["a beam is one ray, its first: splits are left out"] if sensor.splits else []
        return _tractor(sensor), unsaid
    if isinstance(sensor, Terrestrial):
        _refuse_rows(len(directions(sensor)[1]))
        return _tripod(sensor), [LEAVE_TOGETHER]
    if not isinstance(sensor, Airborne | Mobile):
        raise NoSurveyError(f"HELIOS++ has no {sensor.kind}")
    if way is None:
        raise NoSurveyError(
            f"a {sensor.kind} scanner of no known way is not written as a survey; {in_json}"
        )
    if cannot := _cannot(sensor):
        pattern = pattern_of(sensor, way)
        if pattern.count > MOST_PULSES:
            rows = f"a row for each of {pattern.count:,} pulses are too many"
            raise NoSurveyError(f"{cannot}, and {rows}; {in_json}")
        unsaid = [f"{cannot}: its platform turns as the beam does, a row a pulse"]
        return _posed(sensor, pattern, folder / file, file), unsaid
    differs = [DIFFER[sensor.pattern]]
    if isinstance(sensor, Airborne):
        return _strips(sensor), differs
    return _along(sensor, way, folder / file, file), differs


def _refuse_rows(count: int) -> None:
    if count > MOST_ROWS:
        raise NoSurveyError(f"{count:,} beams one above the other are more than {MOST_ROWS:,}")


def _rings(subrays: int) -> tuple[int, int]:
    """Rings of HELIOS++ that have at least so many rays, and how many they have."""
    every = ((quality, len(rings(quality)[1])) for quality in count(1))
    return next(one for one in every if one[1] >= subrays)


def _device(sensor: Scanner, pulse_rate: float, widest_deg: float, scan_hz: float) -> Element:
    """The scanner with its light and ranges."""
    beam = sensor.beam
    values: dict[str, object] = {
        "id": "scanner",
        "name": sensor.scanner or sensor.name,
        "optics": "rotating",
        "accuracy_m": sensor.noise.range_sd,
        "beamDivergence_rad": float(np.mean(beam.divergence_mrad)) * 1e-3,
        "pulseFreqs_Hz": pulse_rate,
        "pulseLength_ns": beam.pulse_ns,
        "wavelength_nm": beam.wavelength_nm,
        "rangeMin_m": sensor.min_range,
        "rangeMax_m": sensor.max_range,
        "scanAngleMax_deg": widest_deg,
        "scanAngleEffectiveMax_deg": widest_deg,
        "scanFreqMin_Hz": 0.0,
        "scanFreqMax_Hz": scan_hz,
        "headRotatePerSecMax_deg": 1e9,
        "maxNOR": beam.max_returns,
    }
    scanner = Element("scanner", words(values))
    SubElement(scanner, "FWFSettings", beamSampleQuality=str(_rings(beam.subrays)[0]))
    SubElement(scanner, "headRotateAxis", x="0", y="0", z="1")
    SubElement(scanner, "beamOrigin", x="0", y="0", z="0")
    return scanner


def _channels(scanner: Element, angles: np.ndarray, axis: str = "x") -> None:
    """Give a scanner a channel for each angle, degrees about an axis."""
    channels = SubElement(scanner, "channels")
    for number, angle in enumerate(angles.tolist()):
        channel = SubElement(channels, "channel", id=str(number))
        origin = SubElement(channel, "beamOrigin", x="0", y="0", z="0")
        SubElement(origin, "rot", axis=axis, angle_deg=repr(angle))


def _platform(name: str, kind: str) -> tuple[Element, Element]:
    """Platform of a type, and its mount."""
    platform = Element("platform", id="platform", name=name, type=kind)
    return platform, SubElement(platform, "scannerMount", x="0", y="0", z="0")


def _leg(where: Mapping[str, object], said: Mapping[str, object]) -> Element:
    """Leg of a survey, by its settings of the platform and of the scanner."""
    leg = Element("leg")
    SubElement(leg, "platformSettings", words(where))
    SubElement(leg, "scannerSettings", words(said))
    return leg


def _at(place: Sequence[float] | np.ndarray) -> dict[str, object]:
    """Settings of a platform at a place."""
    return dict(zip("xyz", map(float, place), strict=True))


def _followed(trajectory: str) -> dict[str, object]:
    """Settings of a platform that follows a file."""
    return {"trajectory": trajectory, "trajectory_separator": ","}


def _tripod(sensor: Terrestrial) -> Written:
    """Scanner, platform and legs of a tripod: a head that turns a column a pulse, with a channel a row."""
    azimuth, elevation = (np.rad2deg(angles) for angles in directions(sensor))
    columns = sensor.pulse_rate / len(elevation)
    step = sensor.angle_step_deg
    scanner = _device(sensor, columns, 180.0, 0.0)
    _channels(scanner, elevation)
    start = float(azimuth[0]) - 90.0 - step  # the beam looks along +Y, and the first step is one on
    values = {
        "active": True,
        "pulseFreq_hz": columns,
        "scanFreq_hz": 0.0,
        "scanAngle_deg": 180.0,
        "headRotatePerSec_deg": step * columns,
        "headRotateStart_deg": start,
        "headRotateStop_deg": start + step * len(azimuth),
    }
    leg = _leg(_at(sensor.position), values)
    return scanner, _platform("tripod", "static")[0], [leg]


def _swept(sensor: MovingScanner, seconds: float) -> tuple[Element, Rotation, dict[str, float]]:
    """Scanner of a pattern, how it is turned on its platform, and settings of a leg of so many seconds.

    Theirs: X right, Y ahead, Z up; the mirror swings from Y to Z, the cone is about Y. Ours: X ahead, Y left.
    """
    low, high = sensor.field_deg
    said = {"pulseFreq_hz": sensor.pulse_rate, "scanFreq_hz": sensor.line_rate}
    if sensor.pattern == "spinning":
        columns = sensor.pulse_rate / sensor.channels
        scanner = _device(sensor, columns, 180.0, 0.0)
        rows = np.linspace(low, high, sensor.channels) if sensor.channels > 1 else np.array([low])
        _channels(scanner, rows)
        speed = -360.0 * sensor.line_rate
        said = {"pulseFreq_hz": columns, "scanFreq_hz": 0.0, "scanAngle_deg": 180.0}
        start = -speed / columns
        said |= {"headRotatePerSec_deg": speed, "headRotateStart_deg": start}
        said["headRotateStop_deg"] = start + speed * seconds
        return scanner, Rotation.identity(), said
    if sensor.pattern == "circles":
        scanner = _device(sensor, sensor.pulse_rate, high, sensor.line_rate)
        scanner.set("optics", "conic")
        first = Rotation.from_euler("y", -2 * np.pi * sensor.line_rate / sensor.pulse_rate)
        swung = Rotation.from_euler("x", -np.pi / 2) * first
    else:
        half, middle = (high - low) / 2, np.deg2rad((low + high) / 2)
        scanner = _device(sensor, sensor.pulse_rate, half, sensor.line_rate)
        ahead = np.array([np.sin(middle), 0.0, -np.cos(middle)])
        beside = np.array([np.cos(middle), 0.0, np.sin(middle)])
        swung = Rotation.from_matrix(np.stack([np.cross(ahead, beside), ahead, beside], axis=1))
        if sensor.pattern == "zigzag":
            scanner.set("optics", "oscillating")
            said["scanFreq_hz"] = sensor.line_rate / 2
        elif sensor.pattern == "fans":
            _channels(scanner, np.array([0.0, sensor.fan_deg, -sensor.fan_deg]), "z")
            said = {key: value / FANS for key, value in said.items()}
    return scanner, swung, said | {"scanAngle_deg": float(scanner.attrib["scanAngleMax_deg"])}


def _cannot(sensor: MovingScanner) -> str:
    """Sentence on why HELIOS++ has no optics of such a pattern; empty where it has."""
    low, high = sensor.field_deg
    if sensor.pattern not in DIFFER:
        return f"HELIOS++ has no {sensor.pattern}"
    if sensor.pattern == "fans" and abs(low + high) > 1e-9:
        return "HELIOS++ has no fans whose field is not the same to both sides"
    if sensor.pattern == "zigzag" and 2 * sensor.pulse_rate / sensor.line_rate < FEWEST_SWING:
        return f"HELIOS++ has no zigzag of less than {FEWEST_SWING} pulses to and fro"
    return ""


def _posed(sensor: MovingScanner, pattern: Pattern, path: Path, name: str) -> Written:
    """Scanner whose beam stands still, platform that turns as it should, and its leg."""
    scanner = _device(sensor, sensor.pulse_rate, 180.0, 0.0)
    write_poses(path, beam_poses(pattern, sensor.pulse_rate))
    values = {"active": True, "pulseFreq_hz": sensor.pulse_rate, "scanFreq_hz": 0.0}
    leg = _leg(_followed(name), {**values, "scanAngle_deg": 180.0})
    return scanner, _platform("platform", "interpolated")[0], [leg]


def _tractor(sensor: Tractor) -> Written:
    """Scanner, platform and legs of SIMLIDAR's tractor: a channel for each angle of its fan, all at one time,
    a pulse a scan; it goes a metre a second."""
    along = positions(sensor)
    step = sensor.step * (sensor.gap + 1)
    plain = Terrestrial(name=sensor.name, max_range=sensor.max_range, noise=Noise(), beam=Beam())
    scanner = _device(plain, 1 / step, 180.0, 0.0)
    scanner.set("rangeMin_m", "0.0")
    _channels(scanner, np.rad2deg(fan(sensor)))
    platform, mount = _platform("tractor", "linearpath")
    SubElement(mount, "rot", axis="z", angle_deg="-90" if sensor.side == "right" else "90")
    legs = []
    ends = origins_of(sensor, np.array([-step, along[-1]]))
    for place, active in zip(ends, (True, False), strict=True):
        where = _at(place) | {"movePerSec_m": 1.0}
        values = {"active": active, "pulseFreq_hz": 1 / step, "scanFreq_hz": 0.0}
        legs.append(_leg(where, {**values, "scanAngle_deg": 180.0}))
    return scanner, platform, legs


def _carrier(sensor: MovingScanner, kind: str, swung: Rotation) -> Element:
    """Platform of a type with the scanner on its mount."""
    platform, mount = _platform("platform", kind)
    roll, pitch, yaw = np.deg2rad(sensor.mount_deg)
    ours = Rotation.from_euler("ZYX", [yaw, -pitch, roll])
    rotated(mount, THEIRS * ours * THEIRS.inv() * swung)
    return platform


def _along(sensor: Mobile, way: Trajectory, path: Path, name: str) -> Written:
    """Scanner, platform and the leg of a way, whose poses go to a file of this name."""
    scanner, swung, said = _swept(sensor, way.duration)
    rows = min(int(way.duration * ROWS_A_SECOND) + 2, MOST_POSES)
    time = np.linspace(0.0, way.duration, rows)
    where, attitude = way.at(way.start + time)
    write_poses(path, (time, canonical(attitude * THEIRS.inv()), where))
    leg = _leg(_followed(name), {"active": True, **said})
    return scanner, _carrier(sensor, "interpolated", swung), [leg]


def _strips(sensor: Airborne) -> Written:
    """Scanner, platform and legs of an aircraft that flies strips."""
    scanner, swung, said = _swept(sensor, sensor.track / sensor.speed)
    legs = [
        _leg(_at(place) | {"movePerSec_m": sensor.speed}, {"active": active, **said})
        for ends in strips(sensor).position.reshape(-1, 2, 3)
        for place, active in zip(ends, (True, False), strict=True)
    ]
    return scanner, _carrier(sensor, "linearpath", swung), legs


def flown(sensor: Sensor) -> Trajectory | None:
    """The way of an aircraft, None of other sensors."""
    return strips(sensor) if isinstance(sensor, Airborne) else None
