"""Surveys of HELIOS++: a scanner on a platform, and its legs, as settings in SI units and degrees.

What a document asks for beyond what is read here is refused with a sentence that names it, or told among the
survey's notes, not passed over.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from ...spec import SpecError
from .device import Device, read_device
from .document import (
    NOISES,
    SETTINGS,
    asset_of,
    check_children,
    place_of,
    read_document,
    rotation_of,
    strange_words,
    yes,
)
from .legs import MOVING, Leg, Source, first_pulse_rate, read_legs
from .scene import Part, plays_of, read_scene

PLATFORMS = ("static", *MOVING)
FAR = 5000.0  # metres from the origin beyond which a scene is moved there


@dataclass(frozen=True)
class Survey:
    """A survey: scene, scanner, mount on its platform (metres, rotation), legs.

    offset : (3,) metres that the scene was moved by, to be added to what is written. notes : what was passed
    over. reflectance : for each part (S,) of its materials, at the scanner's wavelength. later : parts and
    their reflectances when the survey is played again, where parts are swapped.
    """

    name: str
    scene: str
    parts: tuple[Part, ...]
    device: Device
    moves: bool
    mount: np.ndarray
    mount_turn: Rotation
    legs: tuple[Leg, ...]
    offset: np.ndarray
    notes: tuple[str, ...]
    reflectance: tuple[np.ndarray, ...]
    later: tuple[tuple[tuple[Part, ...], tuple[np.ndarray, ...]], ...] = ()

    @property
    def plays(self) -> list[Survey]:
        """The survey once for each time that it is played, with the parts that then stand."""
        again = [replace(self, parts=parts, reflectance=light) for parts, light in self.later]
        return [replace(one, later=()) for one in (self, *again)]


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
    source = Source(path, root, survey, platform, assets)
    rate = first_pulse_rate(source, device.pulse_rate)
    parts, unread = read_scene(survey.get("scene", ""), path, assets, rate)
    mount = survey.find("scannerMount")
    mount = platform.find("scannerMount") if mount is None else mount
    legs, missed = read_legs(source, device, parts)
    lights = [
        tuple(
            np.array([m.reflects(device.wavelength_nm, path, assets) for m in part.mesh.materials])
            for part in play
        )
        for play in plays_of(parts)
    ]
    found = Survey(
        name=survey.get("name", path.stem),
        scene=survey.get("scene", ""),
        parts=parts,
        device=device,
        moves=source.platform == "linearpath",
        mount=place_of(mount, platform_file),
        mount_turn=rotation_of(mount, platform_file),
        legs=legs,
        offset=np.zeros(3),
        notes=(*strange, *unread, *_notes(survey, platform), *device.notes, *missed),
        reflectance=lights[0],
        later=tuple(zip(plays_of(parts)[1:], lights[1:], strict=True)),
    )
    return _near_origin(found)


def _platform(survey: Element, path: Path, assets: Path | None) -> tuple[Element, Path]:
    """The platform, and its file; of an interpolated one what its base platform carries.

    Raises
    ------
    SpecError : a platform of a type that is not supported.
    """
    name = survey.get("platform", "")
    if name != "interpolated":
        platform, file = asset_of(name, "platform", path, assets)
        kind = platform.get("type", "static").lower()
        if kind not in PLATFORMS:
            raise SpecError(
                str(file),
                f'platform type "{kind}" is not supported; {", ".join(PLATFORMS)} and interpolated are',
            )
        platform.set("type", kind)
        return platform, file
    base = survey.get("basePlatform", "")
    if not base:
        return Element("platform", type="interpolated"), path
    platform, file = asset_of(base, "platform", path, assets)
    platform.set("type", "interpolated")
    return platform, file


def _notes(survey: Element, platform: Element) -> list[str]:
    """Sentences for all that is passed over of documents."""
    found = []
    noisy = [child.tag for owner in (survey, platform) for child in owner if child.tag in NOISES]
    if noisy:
        found.append(f"the platform is as steady as its way: {', '.join(noisy)} is passed over")
    if yes(survey.get("legRandomOffset"), False):
        found.append("legs start where they say: legRandomOffset is passed over")
    if survey.get("numRuns", "1").strip() != "1":
        found.append("the survey is run once: numRuns is passed over")
    if any(leg.get("stripId") for leg in survey.findall("leg")):
        found.append("legs of a strip (stripId) go into files of their own")
    return found


def _near_origin(survey: Survey) -> Survey:
    """The survey moved by whole kilometres to the origin, where coordinates in single precision are fine.

    A scene with parts that move stays where it is.
    """
    if any(part.motion for part in survey.parts):
        return survey
    every = [part for play in survey.plays for part in play.parts]
    low = np.min([part.corners.min(axis=(0, 1)) for part in every], axis=0)
    high = np.max([part.corners.max(axis=(0, 1)) for part in every], axis=0)
    middle = (low + high) / 2
    if np.abs(middle).max() < FAR:
        return survey
    offset = np.round(middle / 1000) * 1000
    return replace(
        survey,
        parts=tuple(part.shifted(-offset) for part in survey.parts),
        later=tuple(
            (tuple(part.shifted(-offset) for part in parts), light) for parts, light in survey.later
        ),
        legs=tuple(leg.shifted(-offset) for leg in survey.legs),
        offset=offset,
    )
