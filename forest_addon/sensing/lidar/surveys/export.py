"""Scanners of ours as surveys of HELIOS++: the nearest that it can say, and in sentences what it cannot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
from ..tractor import fan, positions
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
SCENES, SURVEYS = "data/scenes", "data/surveys"
TRAJECTORIES = "data/trajectories/{name}.trj"
SCANNERS, PLATFORMS = "data/scanners-{name}.xml", "data/platforms-{name}.xml"


@dataclass(frozen=True)
class Exported:
    """Survey of a sensor, None where HELIOS++ has none like it, and what was not said, in sentences."""

    sensor: str
    survey: str | None
    unsaid: tuple[str, ...]


def write_survey(
    sensor: Sensor, folder: Path, scene: str, surfaces: Surfaces, way: Trajectory | None = None
) -> Exported:
    """Write the survey of a sensor with its scanner and platform, if HELIOS++ has one like it.

    surfaces : that the materials were made of. way : of a mobile sensor.
    """
    scanner_of_ours = scanner_of(sensor)
    rows = _rows(sensor)
    if rows > MOST_ROWS:
        why = f"{rows:,} beams one above the other are more than {MOST_ROWS:,}"
        return Exported(sensor.name, None, (why,))
    file = TRAJECTORIES.format(name=f"{scene}-{sensor.name}")
    if scanner_of_ours is None and not isinstance(sensor, Tractor):
        return Exported(sensor.name, None, (f"HELIOS++ has no {sensor.kind}",))
    name = f"{scene}-{sensor.name}"
    if isinstance(sensor, Tractor):
        scanner, platform, legs = _tractor(sensor)
        unsaid = ["points, not a matrix of distances; intensities are those of the surfaces"]
        unsaid += ["a beam is one ray, its first: splits are left out"] if sensor.splits else []
    elif isinstance(sensor, Terrestrial):
        scanner, platform, legs = _tripod(sensor)
        unsaid = [LEAVE_TOGETHER]
    elif isinstance(sensor, Airborne | Mobile) and _cannot(sensor) and (way or flown(sensor)):
        pattern_of_ours = pattern_of(sensor, way)
        if pattern_of_ours.count > MOST_PULSES:
            why = f"{_cannot(sensor)}, and a row for each of {pattern_of_ours.count:,} pulses are too many"
            return Exported(sensor.name, None, (f"{why}; its way is in scene.json",))
        scanner, platform, legs = _posed(sensor, pattern_of_ours, folder / file, file)
        unsaid = [f"{_cannot(sensor)}: its platform turns as the beam does, a row a pulse"]
    elif isinstance(sensor, Airborne):
        scanner, platform, legs = _strips(sensor)
        unsaid = [DIFFER[sensor.pattern]]
    elif isinstance(sensor, Mobile) and way is not None:
        scanner, platform, legs = _along(sensor, way, folder / file, file)
        unsaid = [DIFFER[sensor.pattern]]
    else:
        what = f"a {sensor.kind} scanner of no known way is not written as a survey"
        return Exported(sensor.name, None, (f"{what}; its way is in scene.json",))
    files = SCANNERS.format(name=name), PLATFORMS.format(name=name)
    for file, element in zip(files, (scanner, platform), strict=True):
        root = Element("document")
        root.append(element)
        write_document(folder / file, root)
    root = Element("document")
    survey = SubElement(
        root,
        "survey",
        name=name,
        scene=f"{SCENES}/{scene}.xml#{scene}",
        platform=f"{files[1]}#platform",
        scanner=f"{files[0]}#scanner",
    )
    if platform.get("type") == "interpolated":
        survey.set("basePlatform", survey.attrib["platform"])
        survey.set("platform", "interpolated")
        survey.set("rotationSpec", "CANONICAL")
        platform.set("type", "linearpath")
    survey.extend(legs)
    path = f"{SURVEYS}/{name}.xml"
    write_document(folder / path, root)
    if scanner_of_ours is not None:
        unsaid += _unsaid(scanner_of_ours, surfaces)
    return Exported(sensor.name, path, tuple(unsaid))


def _rows(sensor: Sensor) -> int:
    """Beams one above the other that are channels of a head."""
    if isinstance(sensor, Tractor):
        return len(fan(sensor))
    return len(directions(sensor)[1]) if isinstance(sensor, Terrestrial) else 0


def scanner_of(sensor: Sensor) -> Scanner | None:
    """The sensor as a scanner with a beam, None where it is none."""
    return sensor if isinstance(sensor, Scanner) else None


def _unsaid(sensor: Scanner, surfaces: Surfaces) -> list[str]:
    """Sentences on what HELIOS++ has no word for."""
    beam, noise, receiver = sensor.beam, sensor.noise, sensor.receiver
    rays = _rays(_rings(beam.subrays))
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
            noise.range_ppm or noise.incidence_sd or noise.drop_out
        ),
        "settings of its receiver are left out": receiver != type(receiver)(),
        "extinction by the air is left out": beam.extinction,
        "the scene stands as at the present frame": sensor.motion,
        "bounces are left out": sensor.bounces,
    }
    return [sentence for sentence, holds in sentences.items() if holds]


def _rings(subrays: int) -> int:
    """Rings of HELIOS++ that have at least so many rays."""
    return next(quality for quality in count(1) if _rays(quality) >= subrays)


def _rays(quality: int) -> int:
    return len(rings(quality).share)


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
    SubElement(scanner, "FWFSettings", beamSampleQuality=str(_rings(beam.subrays)))
    SubElement(scanner, "headRotateAxis", x="0", y="0", z="1")
    return scanner


def _channels(scanner: Element, elevation: np.ndarray) -> None:
    """Give a scanner a channel for each elevation, degrees."""
    SubElement(scanner, "beamOrigin", x="0", y="0", z="0")
    channels = SubElement(scanner, "channels")
    for number, angle in enumerate(elevation.tolist()):
        channel = SubElement(channels, "channel", id=str(number))
        origin = SubElement(channel, "beamOrigin", x="0", y="0", z="0")
        SubElement(origin, "rot", axis="x", angle_deg=repr(angle))


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


def _tripod(sensor: Terrestrial) -> tuple[Element, Element, list[Element]]:
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


def _swept(sensor: MovingScanner) -> tuple[Element, Rotation, dict[str, object]]:
    """Scanner of a pattern, how it is turned on its platform, and settings of a leg.

    Theirs: X right, Y ahead, Z up; the mirror swings from Y to Z, the cone is about Y. Ours: X ahead, Y left.
    """
    low, high = sensor.field_deg
    said: dict[str, object] = {"pulseFreq_hz": sensor.pulse_rate, "scanFreq_hz": sensor.line_rate}
    if sensor.pattern == "spinning":
        columns = sensor.pulse_rate / sensor.channels
        scanner = _device(sensor, columns, 180.0, 0.0)
        rows = np.linspace(low, high, sensor.channels) if sensor.channels > 1 else np.array([low])
        _channels(scanner, rows)
        speed = -360.0 * sensor.line_rate
        said = {"pulseFreq_hz": columns, "scanFreq_hz": 0.0, "scanAngle_deg": 180.0}
        said |= {"headRotatePerSec_deg": speed, "headRotateStart_deg": -speed / columns}
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
        said |= _told_of(sensor, scanner)
    SubElement(scanner, "beamOrigin", x="0", y="0", z="0")
    return scanner, swung, said | {"scanAngle_deg": float(scanner.attrib["scanAngleMax_deg"])}


def _told_of(sensor: MovingScanner, scanner: Element) -> dict[str, object]:
    """Make a scanner of parallel lines one of three fans, or whose mirror swings; its rates."""
    if sensor.pattern == "zigzag":
        scanner.set("optics", "oscillating")
        return {"scanFreq_hz": sensor.line_rate / 2}
    if sensor.pattern != "fans":
        return {}
    channels = SubElement(scanner, "channels")
    for number, lean in enumerate((0.0, sensor.fan_deg, -sensor.fan_deg)):
        channel = SubElement(channels, "channel", id=str(number))
        origin = SubElement(channel, "beamOrigin", x="0", y="0", z="0")
        SubElement(origin, "rot", axis="z", angle_deg=repr(float(lean)))
    return {"pulseFreq_hz": sensor.pulse_rate / FANS, "scanFreq_hz": sensor.line_rate / FANS}


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


def _posed(
    sensor: MovingScanner, pattern: Pattern, path: Path, name: str
) -> tuple[Element, Element, list[Element]]:
    """Scanner whose beam stands still, platform that turns as it should, and its leg."""
    scanner = _device(sensor, sensor.pulse_rate, 180.0, 0.0)
    SubElement(scanner, "beamOrigin", x="0", y="0", z="0")
    write_poses(path, beam_poses(pattern, sensor.pulse_rate))
    values = {"active": True, "pulseFreq_hz": sensor.pulse_rate, "scanFreq_hz": 0.0}
    leg = _leg(_followed(name), {**values, "scanAngle_deg": 180.0})
    return scanner, _platform("platform", "interpolated")[0], [leg]


def _tractor(sensor: Tractor) -> tuple[Element, Element, list[Element]]:
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
    heading = np.deg2rad(sensor.heading_deg)
    ahead = np.array([np.cos(heading), np.sin(heading), 0.0])
    legs = []
    for gone, active in ((-step, True), (float(along[-1]), False)):
        where = _at(np.array(sensor.position) + gone * ahead) | {"movePerSec_m": 1.0}
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


def _along(
    sensor: Mobile, way: Trajectory, path: Path, name: str
) -> tuple[Element, Element, list[Element]]:
    """Scanner, platform and the leg of a way, whose poses go to a file of this name."""
    scanner, swung, said = _swept(sensor)
    time = np.linspace(0.0, way.duration, int(way.duration * ROWS_A_SECOND) + 2)
    time = np.linspace(0.0, way.duration, min(len(time), MOST_POSES))
    where, attitude = way.at(way.start + time)
    write_poses(path, (time, canonical(attitude * THEIRS.inv()), where))
    turned = float(str(said.get("headRotatePerSec_deg", 0.0))) * way.duration
    leg = _leg(_followed(name), _with_stop({"active": True, **said}, turned))
    return scanner, _carrier(sensor, "interpolated", swung), [leg]


def _with_stop(said: dict[str, object], turned: float) -> dict[str, object]:
    """Settings of a leg with where its head stops after so many degrees, if it turns."""
    start = said.get("headRotateStart_deg")
    return said if start is None else {**said, "headRotateStop_deg": float(str(start)) + turned}


def _strips(sensor: Airborne) -> tuple[Element, Element, list[Element]]:
    """Scanner, platform and legs of an aircraft that flies strips."""
    scanner, swung, said = _swept(sensor)
    platform = _carrier(sensor, "linearpath", swung)
    turned = float(str(said.get("headRotatePerSec_deg", 0.0))) * sensor.track / sensor.speed
    legs = []
    for start, stop in strips(sensor).position.reshape(-1, 2, 3):
        for place, active in ((start, True), (stop, False)):
            where = _at(place) | {"movePerSec_m": sensor.speed}
            legs.append(_leg(where, _with_stop({"active": active, **said}, turned)))
    return scanner, platform, legs


def flown(sensor: Sensor) -> Trajectory | None:
    """The way of an aircraft, None of other sensors."""
    return strips(sensor) if isinstance(sensor, Airborne) else None
