"""Legs of a HELIOS++ survey: where a platform goes, and what its scanner is set to on the way."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from ...spec import SpecError
from .device import WAVEFORM, Device, Digitiser, digitiser_of
from .document import OLD_NAMES, number, place_of, yes
from .driven import DrivenLeg, drive
from .scene import Part, ground_height
from .track import SETTINGS, SurveyTrack, read_tracks

TURNS = {"stopAndTurn", "smoothTurn", "slowdownEnabled", "yawAtDeparture_deg"}
DRIVEN = ("multicopter", "groundvehicle")
MOVING = ("linearpath", *DRIVEN)
LEG_KEYS = {
    "platformSettings": {
        *("id", "template", "x", "y", "z", "onGround", "movePerSec_m", "stripId"),
        *TURNS,
    },
    "scannerSettings": {
        *("id", "template", "active", "pulseFreq_hz", "scanAngle_deg", "scanFreq_hz"),
        *("verticalAngleMin_deg", "verticalAngleMax_deg", "trajectoryTimeInterval_s"),
        *("headRotatePerSec_deg", "headRotateStart_deg", "headRotateStop_deg"),
        *("verticalResolution_deg", "horizontalResolution_deg", "beamDivergence_rad"),
    },
}


@dataclass(frozen=True)
class Leg:
    """A leg from ``start`` to ``stop``, metres, at a speed in m/s (0: it stands), with a scanner's settings.

    track : the way it goes instead, and ``seconds`` from when to when. field_deg : angles of the mirror that
    leave the device, above the first and up to the second.
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
    divergence: float
    digitiser: Digitiser
    track: SurveyTrack | None = None
    seconds: tuple[float, float] = (0.0, 0.0)

    def shifted(self, by: np.ndarray) -> Leg:
        """The leg moved by (3,) metres."""
        track = None if self.track is None else self.track.shifted(by)
        return replace(self, start=self.start + by, stop=self.stop + by, track=track)


@dataclass(frozen=True)
class Source:
    """Documents of a survey: its file, root and survey element, the platform, and where files are."""

    path: Path
    root: Element
    survey: Element
    carrier: Element
    assets: Path | None

    @property
    def platform(self) -> str:
        """The platform's type."""
        return self.carrier.get("type", "static")


def first_pulse_rate(source: Source, otherwise: float) -> float:
    """Pulses a second of the first leg, Hz."""
    leg = source.survey.find("leg")
    settings = Element("scannerSettings") if leg is None else _settings(leg, source)[1]
    return number(settings, "pulseFreq_hz", source.path, otherwise)


def read_legs(
    source: Source, device: Device, parts: tuple[Part, ...]
) -> tuple[tuple[Leg, ...], list[str]]:
    """The legs in order, and sentences on ways that end beside their waypoints; a platform that moves has
    none from its last waypoint on.

    Raises
    ------
    SpecError : there is none, or a setting that is not supported.
    """
    path = source.path
    elements = source.survey.findall("leg")
    given = [_settings(leg, source) for leg in elements]
    moves = source.platform in MOVING
    if len(given) < 1 + moves:
        raise SpecError(
            str(path), "has no leg" if not given else "moves, but has only one waypoint"
        )
    if source.platform == "interpolated":
        tracks = read_tracks([pair[0] for pair in given], source.survey, path, source.assets)
        return tuple(
            _leg(pair[1], device, path, (track.place[0], track.place[-1]), (0.0, np.inf), found)
            for pair, found in zip(given, tracks, strict=True)
            for track in found[:1]
        ), []
    places = [_waypoint(pair[0], parts, path) for pair in given]
    driven, notes = _driven(source, device, given, places)
    legs = []
    for index, (platform, scanner) in enumerate(given[: len(given) - moves]):
        speed = number(platform, "movePerSec_m", path, 70.0) if moves else 0.0
        stop = places[index + 1] if moves else places[index]
        longest = number(elements[index], "maxDuration_s", path, np.inf)
        way = places[index], stop
        track = driven[index] if driven else None
        legs.append(_leg(scanner, device, path, way, (speed, longest), track))
    return tuple(legs), notes


def _driven(
    source: Source,
    device: Device,
    given: list[tuple[Element, Element]],
    places: list[np.ndarray],
) -> tuple[list[tuple[SurveyTrack, float, float]], list[str]]:
    """Ways of a platform that forces drive, and sentences on them; empty of any other."""
    if source.platform not in DRIVEN:
        return [], []
    after = [*places[2:], None]
    legs = [
        DrivenLeg(a, b, c, pair[0], number(pair[1], "pulseFreq_hz", source.path, device.pulse_rate))
        for a, b, c, pair in zip(places, places[1:], after, given[:-1], strict=False)
    ]
    tracks, notes = drive(source.carrier, legs, source.path)
    return [(track, 0.0, float(track.time[-1])) for track in tracks], notes


def _settings(leg: Element, source: Source) -> tuple[Element, Element]:
    """Settings of platform and scanner of a leg, over those of the templates that they name."""
    templates = {
        (child.tag, child.get("id", "")): child for child in source.root if child.tag in LEG_KEYS
    }
    known = set(SETTINGS) if source.platform == "interpolated" else set()
    platform = _merged(leg, "platformSettings", templates, source.path, known)
    return platform, _merged(leg, "scannerSettings", templates, source.path, set())


def _merged(
    leg: Element,
    tag: str,
    templates: dict[tuple[str, str], Element],
    path: Path,
    known: set[str],
) -> Element:
    """Settings of a leg over those of the template that they name.

    Raises
    ------
    SpecError : a template that is not there, or a setting that is not supported.
    """
    every = leg.findall(tag)
    total = Element(tag)
    if len(every) > 1:
        raise SpecError(str(path), f"a leg holds {tag} {len(every)} times; one is supported")
    if not every:
        return total
    own = every[0]
    if "template" in own.attrib:
        base = templates.get((tag, own.attrib["template"]))
        if base is None:
            raise SpecError(
                str(path), f'template "{own.attrib["template"]}" is not in the document'
            )
        total.attrib.update(base.attrib)
        total.extend(base.findall(WAVEFORM))
    total.attrib.update(own.attrib)
    if own.find(WAVEFORM) is not None:
        total[:] = own.findall(WAVEFORM)
    for key in sorted(total.attrib.keys() - LEG_KEYS[tag] - known - OLD_NAMES):
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
    track: tuple[SurveyTrack, float, float] | None = None,
) -> Leg:
    """A leg of a scanner's settings. limits : speed, m/s, and the longest time, s."""

    def value(key: str, otherwise: float) -> float:
        return number(settings, key, path, otherwise)

    rate = value("pulseFreq_hz", device.pulse_rate)
    scan_hz = value("scanFreq_hz", 0.0)
    head_speed = value("headRotatePerSec_deg", 0.0)
    if settings.get("verticalResolution_deg") and device.scan_angle_deg:
        scan_hz = rate * value("verticalResolution_deg", 0.0) / (2 * device.scan_angle_deg)
    if settings.get("horizontalResolution_deg"):
        head_speed = value("horizontalResolution_deg", 0.0) * scan_hz
    angle = value("scanAngle_deg", 0.0) or device.scan_angle_deg
    if device.optics != "oscillating" and device.scan_angle_deg:
        angle = min(angle, device.scan_angle_deg)  # a device does not look beyond its widest angle
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
        divergence=value("beamDivergence_rad", device.divergence),
        digitiser=digitiser_of((settings,), device.digitiser, device.pulse_ns, path),
        track=None if track is None else track[0],
        seconds=(0.0, 0.0) if track is None else track[1:],
    )
