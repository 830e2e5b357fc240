"""Scanners of ours as surveys of HELIOS++: the nearest that it can say, and in sentences what it cannot."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from scipy.spatial.transform import Rotation

from ....formats.helios.writing import rotated, words, write_document
from ....spec import Airborne, Scanner, Sensor, Surfaces, Terrestrial
from ...trajectory import Trajectory, strips
from ..scanner import directions

MOST_ROWS = 10_000  # beams one above the other, that a scanner is given as channels
SCENES, SURVEYS = "data/scenes", "data/surveys"
SCANNERS, PLATFORMS = "data/scanners-{name}.xml", "data/platforms-{name}.xml"


@dataclass(frozen=True)
class Exported:
    """Survey of a sensor, None where HELIOS++ has none like it, and what was not said, in sentences."""

    sensor: str
    survey: str | None
    unsaid: tuple[str, ...]


def write_survey(sensor: Sensor, folder: Path, scene: str, surfaces: Surfaces) -> Exported:
    """Write the survey of a sensor with its scanner and platform, if HELIOS++ has one like it.

    surfaces : that the materials were made of.
    """
    scanner_of_ours = scanner_of(sensor)
    if scanner_of_ours is None:
        return Exported(sensor.name, None, (f"HELIOS++ has no {sensor.kind}",))
    pattern = getattr(sensor, "pattern", "")
    if isinstance(sensor, Terrestrial):
        rows = len(directions(sensor)[1])
        if rows > MOST_ROWS:
            why = f"{rows:,} beams one above the other are more than {MOST_ROWS:,}"
            return Exported(sensor.name, None, (why,))
        scanner, platform, legs = _tripod(sensor)
        unsaid = ["the beams of a column leave at one time"]
    elif isinstance(sensor, Airborne) and pattern == "lines":
        scanner, platform, legs = _strips(sensor)
        unsaid = [
            "a strip begins in the middle of a line, and lines may have a pulse more at their end"
        ]
    else:
        what = f"a {sensor.kind} scanner with pattern {pattern} is not written as a survey"
        return Exported(sensor.name, None, (f"{what}; its way is in scene.json",))
    name = f"{scene}-{sensor.name}"
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
    survey.extend(legs)
    path = f"{SURVEYS}/{name}.xml"
    write_document(folder / path, root)
    return Exported(sensor.name, path, (*unsaid, *_unsaid(scanner_of_ours, surfaces)))


def scanner_of(sensor: Sensor) -> Scanner | None:
    """The sensor as a scanner with a beam, None where it is none."""
    return sensor if isinstance(sensor, Scanner) else None


def _unsaid(sensor: Scanner, surfaces: Surfaces) -> Iterator[str]:
    """Sentences on what HELIOS++ has no word for."""
    beam, noise, receiver = sensor.beam, sensor.noise, sensor.receiver
    if sensor.surfaces != surfaces:
        yield "its reflectances differ from those of the first scanner, which the materials have"
    if len(set(beam.divergence_mrad)) > 1:
        yield "its beam is told as round, as wide as the mean of both divergences"
    if beam.exit_diameter:
        yield "the width of the beam at its exit (exit_diameter) is left out"
    if beam.subrays > 1:
        yield f"its {beam.subrays} rays of equal energy are rings of {_rays(_rings(beam.subrays))}"
    if sensor.faintest:
        yield "the threshold of detection (faintest) is left out: HELIOS++ has watts of its own"
    if noise.range_ppm or noise.incidence_sd or noise.drop_out:
        yield "of its noise only range_sd is told"
    if receiver != type(receiver)():
        yield "settings of its receiver are left out"
    if beam.extinction:
        yield "extinction by the air is left out"
    if sensor.motion:
        yield "the scene stands as at the present frame"
    if sensor.bounces:
        yield "bounces are left out"


def _rings(subrays: int) -> int:
    """Rings of HELIOS++ that have at least so many rays: 1 + 3·q·(q - 1)."""
    return int(np.ceil((3 + np.sqrt(9 + 12 * (subrays - 1))) / 6 - 1e-9))


def _rays(rings: int) -> int:
    return 1 + 3 * rings * (rings - 1)


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


def _tripod(sensor: Terrestrial) -> tuple[Element, Element, list[Element]]:
    """Scanner, platform and legs of a tripod: a head that turns a column a pulse, with a channel a row."""
    azimuth, elevation = (np.rad2deg(angles) for angles in directions(sensor))
    columns = sensor.pulse_rate / len(elevation)
    step = sensor.angle_step_deg
    scanner = _device(sensor, columns, 180.0, 0.0)
    SubElement(scanner, "beamOrigin", x="0", y="0", z="0")
    channels = SubElement(scanner, "channels")
    for number, angle in enumerate(elevation.tolist()):
        channel = SubElement(channels, "channel", id=str(number))
        origin = SubElement(channel, "beamOrigin", x="0", y="0", z="0")
        SubElement(origin, "rot", axis="x", angle_deg=repr(angle))
    platform = Element("platform", id="platform", name="tripod", type="static")
    SubElement(platform, "scannerMount", x="0", y="0", z="0")
    leg = Element("leg")
    x, y, z = (float(value) for value in sensor.position)
    SubElement(leg, "platformSettings", words({"x": x, "y": y, "z": z}))
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
    SubElement(leg, "scannerSettings", words(values))
    return scanner, platform, [leg]


def _strips(sensor: Airborne) -> tuple[Element, Element, list[Element]]:
    """Scanner, platform and legs of an aircraft whose mirror sweeps parallel lines."""
    low, high = sensor.field_deg
    half, middle = (high - low) / 2, np.deg2rad((low + high) / 2)
    scanner = _device(sensor, sensor.pulse_rate, half, sensor.line_rate)
    SubElement(scanner, "beamOrigin", x="0", y="0", z="0")
    platform = Element("platform", id="platform", name="aircraft", type="linearpath")
    # Theirs: X right, Y ahead, the mirror swings from Y to Z. Ours: X ahead, Y left, from nadir to the right.
    ahead = np.array([np.sin(middle), 0.0, -np.cos(middle)])
    beside = np.array([np.cos(middle), 0.0, np.sin(middle)])
    swung = Rotation.from_matrix(np.stack([np.cross(ahead, beside), ahead, beside], axis=1))
    roll, pitch, yaw = np.deg2rad(sensor.mount_deg)
    ours = Rotation.from_euler("ZYX", [yaw, -pitch, roll])
    turn = Rotation.from_euler("z", np.pi / 2)  # from ours to theirs
    mount = SubElement(platform, "scannerMount", x="0", y="0", z="0")
    rotated(mount, turn * ours * turn.inv() * swung)
    legs = []
    for start, stop in strips(sensor).position.reshape(-1, 2, 3):
        for place, active in ((start, True), (stop, False)):
            leg = Element("leg")
            x, y, z = place.tolist()
            where = {"x": x, "y": y, "z": z, "movePerSec_m": sensor.speed}
            SubElement(leg, "platformSettings", words(where))
            values = {
                "active": active,
                "pulseFreq_hz": sensor.pulse_rate,
                "scanFreq_hz": sensor.line_rate,
                "scanAngle_deg": half,
            }
            SubElement(leg, "scannerSettings", words(values))
            legs.append(leg)
    return scanner, platform, legs


def flown(sensor: Sensor) -> Trajectory | None:
    """The way of an aircraft, None of other sensors."""
    return strips(sensor) if isinstance(sensor, Airborne) else None
