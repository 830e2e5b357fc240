"""Surveys of HELIOS++: a scanner on a platform, and its legs, as settings in SI units and degrees.

What a document asks for beyond what is read here is refused with a sentence that names it, not passed over.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from ...spec import SpecError
from .document import asset_of, number, place_of, read_document, rotation_of, yes
from .scene import Part, ground_height, read_scene

OPTICS = ("rotating", "conic", "risley")
PLATFORMS = ("static", "linearpath")
LEG_KEYS = {
    "platformSettings": {"id", "template", "x", "y", "z", "onGround", "movePerSec_m", "stripId"},
    "scannerSettings": {
        *("id", "template", "active", "pulseFreq_hz", "scanAngle_deg", "scanFreq_hz"),
        *("verticalAngleMin_deg", "verticalAngleMax_deg", "trajectoryTimeInterval_s"),
        *("headRotatePerSec_deg", "headRotateStart_deg", "headRotateStop_deg"),
        *("verticalResolution_deg", "horizontalResolution_deg"),
    },
}
SURVEY_TAGS = {"leg", "FWFSettings"}


@dataclass(frozen=True)
class Prism:
    """A turning wedge: degrees, negative if its second face is tilted; turns a second; refractive index."""

    angle_deg: float
    turns_hz: float
    index: float


@dataclass(frozen=True)
class Device:
    """A scanner as HELIOS++ describes it.

    origin : (C, 3) metres of each channel's beam from the mount. turn : C rotations of it. incident : (C, 3)
    direction of the beam before the prisms. ranges : smallest and largest, m.
    """

    name: str
    optics: str
    origin: np.ndarray
    turn: tuple[Rotation, ...]
    incident: np.ndarray
    head_axis: np.ndarray
    scan_angle_deg: float
    effective_deg: float
    scan_hz: float
    prisms: tuple[Prism, ...]
    ranges: tuple[float, float]
    accuracy: float
    divergence: float
    pulse_ns: float
    wavelength_nm: float
    max_returns: int
    pulse_rate: float


@dataclass(frozen=True)
class Leg:
    """A leg from ``start`` to ``stop``, metres, at a speed in m/s (0: it stands), with a scanner's settings.

    field_deg : angles of the mirror that leave the device, above the first and up to the second.
    """

    start: np.ndarray
    stop: np.ndarray
    speed: float
    active: bool
    pulse_rate: float
    scan_hz: float
    scan_angle_deg: float
    field_deg: tuple[float, float]
    head_deg: tuple[float, float]
    head_speed: float
    most_seconds: float


@dataclass(frozen=True)
class Survey:
    """A survey: scene, scanner, mount on its platform (metres, rotation), rings of sub-rays, legs."""

    name: str
    scene: str
    parts: tuple[Part, ...]
    device: Device
    moves: bool
    mount: np.ndarray
    mount_turn: Rotation
    rings: int
    legs: tuple[Leg, ...]


def read_survey(path: Path, assets: Path | None = None) -> Survey:
    """A survey with all that it names.

    assets : folder at which paths in the documents start, beside the folders above the survey.

    Raises
    ------
    SpecError : a file is missing or broken, or asks for what is not supported.
    """
    root = read_document(path)
    survey = root.find("survey")
    if survey is None:
        raise SpecError(str(path), "has no survey")
    for child in survey:
        if child.tag not in SURVEY_TAGS:
            raise SpecError(str(path), f'the survey holds "{child.tag}", which is not supported')
    named = {key: survey.get(key, "") for key in ("scene", "platform", "scanner")}
    if named["platform"] == "interpolated":
        raise SpecError(
            str(path), "follows a trajectory file (interpolated), which is not supported"
        )
    scanner, scanner_file = asset_of(named["scanner"], "scanner", path, assets)
    platform, platform_file = asset_of(named["platform"], "platform", path, assets)
    if platform.get("type") not in PLATFORMS:
        raise SpecError(
            str(platform_file),
            f'platform type "{platform.get("type")}" is not supported; {" and ".join(PLATFORMS)} are',
        )
    mount = platform.find("scannerMount")
    parts = read_scene(named["scene"], path, assets)
    device = read_device(scanner, scanner_file)
    rings = survey.find("FWFSettings")
    rings = scanner.find("FWFSettings") if rings is None else rings
    quality = 3.0 if rings is None else number(rings, "beamSampleQuality", path, 3.0)
    moves = platform.get("type") == "linearpath"
    return Survey(
        name=survey.get("name", path.stem),
        scene=named["scene"],
        parts=parts,
        device=device,
        moves=moves,
        mount=place_of(mount, platform_file),
        mount_turn=rotation_of(mount, platform_file),
        rings=int(quality),
        legs=_legs(root, survey, path, device, parts, moves),
    )


def read_device(scanner: Element, path: Path) -> Device:
    """A scanner of a library.

    Raises
    ------
    SpecError : optics that are not supported, or a broken number.
    """
    name, optics = scanner.get("name", "scanner"), scanner.get("optics", "")
    if optics not in OPTICS:
        raise SpecError(str(path), f'optics "{optics}" is not supported; {", ".join(OPTICS)} are')

    def value(key: str, otherwise: float | None = None) -> float:
        return number(scanner, key, path, otherwise)

    def one_of(channel: Element | None, tag: str) -> Element | None:
        own = None if channel is None else channel.find(tag)
        return scanner.find(tag) if own is None else own

    channels: list[Element | None] = [*scanner.findall("channels/channel")] or [None]
    origins = [one_of(c, "beamOrigin") for c in channels]
    incident = [one_of(c, "incidentBeam") for c in channels]
    prisms = tuple(
        Prism(value(f"angle{i}_deg"), value(f"rotorFreq{i}_Hz"), value(f"refrIndex{i}"))
        for i in (1, 2, 3)
        if scanner.get(f"angle{i}_deg")
    )
    axis = scanner.find("headRotateAxis")
    widest = value("scanAngleMax_deg", 0.0)
    return Device(
        name=name,
        optics=optics,
        origin=np.array([place_of(o, path) for o in origins]),
        turn=tuple(rotation_of(o, path) for o in origins),
        incident=np.array([(0.0, 1.0, 0.0) if i is None else place_of(i, path) for i in incident]),
        head_axis=np.array([0.0, 0.0, 1.0]) if axis is None else place_of(axis, path),
        scan_angle_deg=widest,
        effective_deg=value("scanAngleEffectiveMax_deg", widest),
        scan_hz=value("scanFreqMax_Hz", 0.0),
        prisms=prisms,
        ranges=(value("rangeMin_m", 0.0), value("rangeMax_m", 1e4)),
        accuracy=value("accuracy_m", 0.0),
        divergence=value("beamDivergence_rad", 0.0003),
        pulse_ns=value("pulseLength_ns", 4.0),
        wavelength_nm=value("wavelength_nm", 1064.0),
        max_returns=int(value("maxNOR", 0.0)),
        pulse_rate=float(scanner.get("pulseFreqs_Hz", "100000").split(",")[0]),
    )


def _legs(
    root: Element,
    survey: Element,
    path: Path,
    device: Device,
    parts: tuple[Part, ...],
    moves: bool,
) -> tuple[Leg, ...]:
    """The legs in order; a platform that moves has none from its last waypoint on."""
    templates = {(child.tag, child.get("id", "")): child for child in root if child.tag in LEG_KEYS}
    given = [
        {tag: _merged(leg, tag, templates, path) for tag in LEG_KEYS}
        for leg in survey.findall("leg")
    ]
    if len(given) < 1 + moves:
        raise SpecError(
            str(path), "has no leg" if not given else "moves, but has only one waypoint"
        )
    places = [_waypoint(leg["platformSettings"], parts, path) for leg in given]
    legs = []
    for index, leg in enumerate(given[: len(given) - moves]):
        element = survey.findall("leg")[index]
        speed = number(leg["platformSettings"], "movePerSec_m", path, 70.0) if moves else 0.0
        stop = places[index + 1] if moves else places[index]
        longest = number(element, "maxDuration_s", path, np.inf) if element.attrib else np.inf
        legs.append(
            _leg(leg["scannerSettings"], device, path, (places[index], stop), (speed, longest))
        )
    return tuple(legs)


def _merged(
    leg: Element, tag: str, templates: dict[tuple[str, str], Element], path: Path
) -> Element:
    """Settings of a leg over those of the template that they name.

    Raises
    ------
    SpecError : a template that is not there, or a setting that is not supported.
    """
    own = leg.find(tag)
    total = Element(tag)
    if own is None:
        return total
    if "template" in own.attrib:
        base = templates.get((tag, own.attrib["template"]))
        if base is None:
            raise SpecError(
                str(path), f'template "{own.attrib["template"]}" is not in the document'
            )
        total.attrib.update(base.attrib)
    total.attrib.update(own.attrib)
    for key in sorted(total.attrib.keys() - LEG_KEYS[tag]):
        raise SpecError(str(path), f'{tag} has "{key}", which is not supported')
    return total


def _waypoint(settings: Element, parts: tuple[Part, ...], path: Path) -> np.ndarray:
    where = place_of(settings, path)
    if yes(settings.get("onGround"), False):
        height = ground_height(parts, where[0], where[1])
        if height is None:
            raise SpecError(str(path), f"no ground at x = {where[0]:g}, y = {where[1]:g}")
        where[2] = height
    return where


def _leg(
    settings: Element,
    device: Device,
    path: Path,
    way: tuple[np.ndarray, np.ndarray],
    limits: tuple[float, float],
) -> Leg:
    def value(key: str, otherwise: float) -> float:
        return number(settings, key, path, otherwise)

    rate = value("pulseFreq_hz", device.pulse_rate)
    scan_hz = value("scanFreq_hz", 0.0)
    head_speed = value("headRotatePerSec_deg", 0.0)
    if settings.get("verticalResolution_deg") and device.scan_angle_deg:
        scan_hz = rate * value("verticalResolution_deg", 0.0) / (2 * device.scan_angle_deg)
    if settings.get("horizontalResolution_deg"):
        head_speed = value("horizontalResolution_deg", 0.0) * scan_hz
    angle = value("scanAngle_deg", device.scan_angle_deg)
    widest = min(device.effective_deg, angle)
    if rate <= 0:
        raise SpecError(str(path), f"pulseFreq_hz = {rate:g} must be above 0")
    return Leg(
        start=way[0],
        stop=way[1],
        speed=limits[0],
        active=yes(settings.get("active"), True),
        pulse_rate=rate,
        scan_hz=scan_hz,
        scan_angle_deg=angle,
        field_deg=(value("verticalAngleMin_deg", -widest), value("verticalAngleMax_deg", widest)),
        head_deg=(value("headRotateStart_deg", 0.0), value("headRotateStop_deg", 0.0)),
        head_speed=head_speed,
        most_seconds=limits[1],
    )
