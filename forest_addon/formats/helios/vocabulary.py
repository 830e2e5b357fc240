"""Words that documents of HELIOS++ may hold: an element that is not known is refused, an attribute told.

Attributes of a leg's settings and of channels are held to their own lists where they are read.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element

from ...spec import SpecError

NOISES = {f"{what}{axis}Noise" for what in ("position", "attitude") for axis in "XYZ"}
SETTINGS = ("platformSettings", "scannerSettings")
PLACE = {"x", "y", "z"}
OPTICS_ERRORS = {"deflectionError", "headError", "rangeError"}  # refused where a device is read
OLD_NAMES = {
    "headRotatePerSecDegree"
}  # of a leg's settings, in HELIOS++'s own surveys: it reads none
CHILDREN = {
    "document": {"survey", "scene", "scanner", "platform", *SETTINGS},
    "survey": {"leg", "FWFSettings", "detectorSettings", "scannerMount", *NOISES},
    "leg": {*SETTINGS},
    "scannerSettings": {"FWFSettings"},
    "scannerMount": {"rot"},
    "scene": {"part"},
    "part": {"filter", "dmotion", "swap"},
    "swap": {"filter"},
    "filter": {"param"},
    "param": {"rot"},
    "dmotion": {"motion"},
    "platform": {"scannerMount", *NOISES},
    "scanner": {
        *("FWFSettings", "beamOrigin", "incidentBeam", "channels", "headRotateAxis"),
        *OPTICS_ERRORS,
    },
    "channels": {"channel"},
    "channel": {"FWFSettings", "beamOrigin", "incidentBeam"},
    "beamOrigin": {"rot"},
}
DRIVE = {
    *("engine_max_force", "drag", "slowdown_distance", "slowdown_magnitude", "speedup_magnitude"),
    *("base_pitch_deg", "pitch_offset_deg", "pitch_speed_deg", "roll_offset_deg"),
    *("roll_speed_deg", "yaw_speed_deg"),
}
ATTRIBUTES = {
    "survey": {
        *("name", "scene", "platform", "scanner", "basePlatform", "rotationSpec"),
        *("legRandomOffset", "numRuns"),
    },
    "leg": {"stripId", "maxDuration_s"},
    "FWFSettings": {
        *("beamSampleQuality", "binSize_ns", "winSize_ns", "maxFullwaveRange_ns", "snapToSurface"),
    },
    "detectorSettings": {"rangeMin_m", "rangeMax_m", "accuracy_m"},
    "scannerMount": {*PLACE, "rotations"},
    "rot": {"axis", "angle_deg"},
    "scene": {"id", "name", "dynStep", "dynTimeStep"},
    "part": {"id", "name", "dynStep", "dynTimeStep", "kdtDynStep"},
    "swap": {"swapStep", "swapIndices", "force_null"},
    "filter": {"type"},
    "param": {"type", "key", "value", "rotations"},
    "dmotion": {"id", "loop", "next"},
    "motion": {
        *("type", "vec", "axis", "angle", "center", "autoCRS", "selfMode"),
        *("glide", "ortho", "shift"),
    },
    "platform": {"id", "name", "type", *DRIVE},
    "scanner": {
        *("id", "name", "optics", "accuracy_m", "beamDivergence_rad", "pulseFreqs_Hz", "maxNOR"),
        *("pulseLength_ns", "rangeMin_m", "rangeMax_m", "wavelength_nm", "headRotatePerSecMax_deg"),
        *("scanAngleMax_deg", "scanAngleEffectiveMax_deg", "scanFreqMin_Hz", "scanFreqMax_Hz"),
        *("scanProduct", "numFibers", "refrIndex_air"),
        *(key for i in (1, 2, 3) for key in (f"angle{i}_deg", f"rotorFreq{i}_Hz")),
        *(f"refrIndex{i}" for i in (1, 2, 3)),
    },
    "beamOrigin": {*PLACE, "rotations"},
    "headRotateAxis": PLACE,
    "incidentBeam": PLACE,
}
MATERIAL = {"matfile", "matname"}
FILES = {"filepath", "efilepath"}
PARAMETERS = {
    "objloader": {*FILES, "up"},
    "geotiffloader": {*FILES, *MATERIAL},
    "xyzloader": {*FILES, *MATERIAL, "separator", "voxelSize", "estimateNormals", "defaultNormal"},
    "detailedvoxels": {
        *(*FILES, *MATERIAL, "intersectionMode", "intersectionArgument", "randomShift"),
    },
    "scale": {"scale"},
    "rotate": {"rotation"},
    "translate": {"offset", "onGround"},
}


def strange_words(root: Element, path: Path) -> list[str]:
    """Sentences on attributes and parameters that are not read, of an element and all that it holds.

    Raises
    ------
    SpecError : it holds an element that is not known.
    """
    found: dict[str, None] = {}
    for element in root.iter():
        tag = element.tag
        check_children(element, path)
        if tag in ATTRIBUTES:
            for name in sorted(element.attrib.keys() - ATTRIBUTES[tag]):
                found[f'{_named(element)} says "{name}", which is not read'] = None
        elif tag in SETTINGS:
            for name in sorted(element.attrib.keys() & OLD_NAMES):
                found[f'{tag} says "{name}", which is not read, nor by HELIOS++'] = None
        kind = element.get("type", "").lower()
        if tag != "filter" or kind not in PARAMETERS:
            continue
        keys = {param.get("key", "") for param in element.findall("param")}
        for key in sorted(keys - PARAMETERS[kind]):
            found[f'filter "{kind}" says "{key}", which is not read'] = None
    return list(found)


def check_children(element: Element, path: Path) -> None:
    """Check the elements that an element holds.

    Raises
    ------
    SpecError : one that is not known there.
    """
    for child in element:
        if child.tag not in CHILDREN.get(element.tag, ()) and element.tag not in NOISES:
            raise SpecError(
                str(path), f'{_named(element)} holds "{child.tag}", which is not supported'
            )


def _named(element: Element) -> str:
    name = element.get("id", element.get("name", ""))
    return f"{element.tag} {name}".rstrip()
