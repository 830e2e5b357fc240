"""Surveys of HELIOS++: a scanner on a platform, and its legs, as settings in SI units and degrees.

What a document asks for beyond what is read here is refused with a sentence that names it, or told among the
survey's notes, not passed over.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from ...spec import SpecError
from .device import WAVEFORM, Device, Digitiser, digitiser_of, read_device
from .document import (
    NOISES,
    OLD_NAMES,
    SETTINGS,
    asset_of,
    check_children,
    number,
    place_of,
    read_document,
    rotation_of,
    strange_words,
    yes,
)
from .platforms import TRACK_SETTINGS, DrivenLeg, SurveyTrack, drive, read_tracks
from .scene import Part, ground_height, plays_of, read_scene

DRIVEN = ("multicopter", "groundvehicle")
MOVING = ("linearpath", *DRIVEN)
PLATFORMS = ("static", *MOVING)
FAR = 5000.0  # metres from the origin beyond which a scene is moved there
LEG_KEYS = {
    "platformSettings": {
        *("id", "template", "x", "y", "z", "onGround", "movePerSec_m", "stripId"),
        *("stopAndTurn", "smoothTurn", "slowdownEnabled", "yawAtDeparture_deg"),
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
class Survey:
    """A survey: scene, scanner, mount on its platform (metres, rotation), legs.

    offset : (3,) metres that the scene was moved by, to be added to what is written. notes : what was passed
    over. reflectance : for each part (S,) of its materials, at the scanner's wavelength. later : the survey
    as it is played again, where parts are swapped.
    """

    name: str
    parts: tuple[Part, ...]
    device: Device
    moves: bool
    mount: np.ndarray
    mount_turn: Rotation
    legs: tuple[Leg, ...]
    offset: np.ndarray
    notes: tuple[str, ...]
    reflectance: tuple[np.ndarray, ...]
    later: tuple[Survey, ...] = ()

    @property
    def plays(self) -> tuple[Survey, ...]:
        """The survey once for each time that it is played, with the parts that then stand."""
        return self, *self.later


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
    check_children(root, path)
    strange = strange_words(survey, path)
    for template in (child for child in root if child.tag in SETTINGS):
        strange += strange_words(template, path)
    scanner, scanner_file = asset_of(survey.get("scanner", ""), "scanner", path, assets)
    platform, platform_file = _platform(survey, path, assets)
    strange += strange_words(scanner, scanner_file) + strange_words(platform, platform_file)
    device = read_device(scanner, scanner_file, survey)
    kind = platform.get("type", "static")
    known = TRACK_SETTINGS if kind == "interpolated" else set()
    elements = survey.findall("leg")
    own, scans = (
        [_settings(leg, tag, root, path, more) for leg in elements]
        for tag, more in (("platformSettings", known), ("scannerSettings", set()))
    )
    rate = number(scans[0], "pulseFreq_hz", path, device.pulse_rate) if scans else device.pulse_rate
    parts, unread = read_scene(survey.get("scene", ""), path, assets, rate)
    if len(elements) < 1 + (kind in MOVING):
        raise SpecError(str(path), "moves, but has only one waypoint" if elements else "has no leg")
    if kind == "interpolated":
        tracks = read_tracks(own, survey, path, assets)
        legs = [_leg(s, device, path, *t) for s, t in zip(scans, tracks, strict=True)]
        missed: list[str] = []
    else:
        places = [_waypoint(settings, parts, path) for settings in own]
        legs, missed = _between(places, own, scans, elements, platform, device, path)
    mount = survey.find("scannerMount")
    mount = platform.find("scannerMount") if mount is None else mount
    notes = (*strange, *unread, *_notes(survey, platform), *device.notes, *missed)
    plays = [
        Survey(
            name=survey.get("name", path.stem),
            parts=play,
            device=device,
            moves=kind == "linearpath",
            mount=place_of(mount, platform_file),
            mount_turn=rotation_of(mount, platform_file),
            legs=tuple(legs),
            offset=np.zeros(3),
            notes=notes,
            reflectance=tuple(
                np.array(
                    [m.reflects(device.wavelength_nm, path, assets) for m in part.mesh.materials]
                )
                for part in play
            ),
        )
        for play in plays_of(parts)
    ]
    first, *later = _near_origin(plays)
    return replace(first, later=tuple(later))


def _platform(survey: Element, path: Path, assets: Path | None) -> tuple[Element, Path]:
    """The platform, and its file; of an interpolated one what its base platform carries.

    Raises
    ------
    SpecError : a platform of a type that is not supported.
    """
    name = survey.get("platform", "")
    interpolated = name == "interpolated"
    name = survey.get("basePlatform", "") if interpolated else name
    if interpolated and not name:
        return Element("platform", type="interpolated"), path
    platform, file = asset_of(name, "platform", path, assets)
    kind = "interpolated" if interpolated else platform.get("type", "static").lower()
    if kind not in (*PLATFORMS, "interpolated"):
        raise SpecError(
            str(file),
            f'platform type "{kind}" is not supported; {", ".join(PLATFORMS)} and interpolated are',
        )
    platform.set("type", kind)
    return platform, file


def _settings(leg: Element, tag: str, root: Element, path: Path, more: set[str]) -> Element:
    """Settings of a leg over those of the template that they name. more : names that are known besides.

    Raises
    ------
    SpecError : a template that is not there, or a setting that is not supported.
    """
    every = leg.findall(tag)
    total = Element(tag)
    if len(every) > 1:
        raise SpecError(str(path), f"a leg holds {tag} {len(every)} times; one is supported")
    for own in every:
        name = own.get("template")
        bases = [base for base in root.findall(tag) if base.get("id", "") == name]
        if name is not None and not bases:
            raise SpecError(str(path), f'template "{name}" is not in the document')
        for said in (*bases[-1:], own):
            total.attrib.update(said.attrib)
            total[:] = said.findall(WAVEFORM) or total[:]
    for key in sorted(total.attrib.keys() - LEG_KEYS[tag] - more - OLD_NAMES):
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


def _between(
    places: list[np.ndarray],
    own: list[Element],
    scans: list[Element],
    elements: list[Element],
    platform: Element,
    device: Device,
    path: Path,
) -> tuple[list[Leg], list[str]]:
    """Legs between waypoints, and sentences on ways that end beside these; a platform that moves has none
    from its last waypoint on."""
    kind = platform.get("type", "static")
    notes: list[str] = []
    tracks: list[SurveyTrack | None] = [None] * len(places)
    if kind in DRIVEN:
        rates = [number(one, "pulseFreq_hz", path, device.pulse_rate) for one in scans]
        ways = zip(places, places[1:], [*places[2:], None], own, rates, strict=False)
        tracks, notes = drive(platform, [DrivenLeg(*way) for way in ways], path)  # type: ignore[assignment]
    moves, legs = kind in MOVING, []
    for index in range(len(places) - moves):
        track, stop = tracks[index], places[index + moves]
        leg = _leg(scans[index], device, path, track)
        legs.append(
            replace(
                leg,
                start=places[index],
                stop=stop,
                speed=number(own[index], "movePerSec_m", path, 70.0) if moves else 0.0,
                most_seconds=number(elements[index], "maxDuration_s", path, np.inf),
            )
        )
    return legs, notes


def _leg(
    settings: Element,
    device: Device,
    path: Path,
    track: SurveyTrack | None,
    start: float = 0.0,
    stop: float | None = None,
) -> Leg:
    """A leg of a scanner's settings, along a track from a time to another, s."""

    def value(key: str, otherwise: float) -> float:
        return number(settings, key, path, otherwise)

    rate, scan_hz = value("pulseFreq_hz", device.pulse_rate), value("scanFreq_hz", 0.0)
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
    ends, last = (np.zeros((2, 3)), 0.0) if track is None else (track.place, float(track.time[-1]))
    return Leg(
        start=ends[0],
        stop=ends[-1],
        speed=0.0,
        active=yes(settings.get("active"), True),
        pulse_rate=rate,
        scan_hz=scan_hz,
        scan_angle_deg=angle,
        field_deg=(value("verticalAngleMin_deg", -widest), value("verticalAngleMax_deg", widest)),
        head_deg=(value("headRotateStart_deg", 0.0), value("headRotateStop_deg", 0.0)),
        head_speed=head_speed,
        most_seconds=np.inf,
        divergence=value("beamDivergence_rad", device.divergence),
        digitiser=digitiser_of((settings,), device.digitiser, device.pulse_ns, path),
        track=track,
        seconds=(start, last if stop is None else stop),
    )


def _notes(survey: Element, platform: Element) -> Iterator[str]:
    """Sentences for all that is passed over of documents."""
    noisy = [child.tag for owner in (survey, platform) for child in owner if child.tag in NOISES]
    if noisy:
        yield f"the platform is as steady as its way: {', '.join(noisy)} is passed over"
    if yes(survey.get("legRandomOffset"), False):
        yield "legs start where they say: legRandomOffset is passed over"
    if survey.get("numRuns", "1").strip() != "1":
        yield "the survey is run once: numRuns is passed over"
    if any(leg.get("stripId") for leg in survey.findall("leg")):
        yield "legs of a strip (stripId) go into files of their own"


def _near_origin(plays: list[Survey]) -> list[Survey]:
    """Plays moved by whole kilometres to the origin, where coordinates in single precision are fine.

    A scene with parts that move stays where it is.
    """
    every = [part for play in plays for part in play.parts]
    corners = [part.corners for part in every]
    low = np.min([each.min(axis=(0, 1)) for each in corners], axis=0)
    high = np.max([each.max(axis=(0, 1)) for each in corners], axis=0)
    middle = (low + high) / 2
    if any(part.motion for part in every) or np.abs(middle).max() < FAR:
        return plays
    offset = np.round(middle / 1000) * 1000
    return [
        replace(
            play,
            parts=tuple(part.shifted(-offset) for part in play.parts),
            legs=tuple(leg.shifted(-offset) for leg in play.legs),
            offset=offset,
        )
        for play in plays
    ]
