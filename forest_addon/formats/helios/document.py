"""XML documents of HELIOS++, without document types and entities: their words, and the files that they name.

An element that is not known is refused, an attribute told. Attributes of a leg's settings and of channels
are held to their own lists where they are read.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np
import scipy

from ...spec import SpecError
from ..foreign import guarded

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
REPEAT, NESTED = re.compile(r"[*+{]"), re.compile(r"\([^()]*[*+}][^()]*\)[*+{]")
SPLIT = re.compile(
    r"(?s)((?:.*(?:/|\\(?![.dwsbDWSB+*?()\[\]{}|^$\\])))?)(.*)"
)  # folder, expression
MOST_REPEATS = 4  # in an expression of a file's name
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
    sentences: dict[str, None] = {}
    for element in root.iter():
        tag = element.tag
        check_children(element, path)
        if tag in ATTRIBUTES:
            for name in sorted(element.attrib.keys() - ATTRIBUTES[tag]):
                sentences[f'{_named(element)} says "{name}", which is not read'] = None
        elif tag in SETTINGS:
            for name in sorted(element.attrib.keys() & OLD_NAMES):
                sentences[f'{tag} says "{name}", which is not read, nor by HELIOS++'] = None
        kind = element.get("type", "").lower()
        if tag != "filter" or kind not in PARAMETERS:
            continue
        keys = {param.get("key", "") for param in element.findall("param")}
        for key in sorted(keys - PARAMETERS[kind]):
            sentences[f'filter "{kind}" says "{key}", which is not read'] = None
    return list(sentences)


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


MOST_BYTES = 50_000_000
LIBRARY = Path("python", "pyhelios")  # where an installation of HELIOS++ keeps its own ``data``
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@guarded("an XML document", most=MOST_BYTES)
def read_document(path: Path) -> Element:
    """The root element of an XML file.

    Raises
    ------
    SpecError : it cannot be read, or declares a document type: entities are not expanded.
    """
    builder = TreeBuilder()
    parser = expat.ParserCreate()
    parser.buffer_text = True

    def refuse(*_given: object) -> None:
        raise SpecError(str(path), "declares a document type (DTD), which is not read; remove it")

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    parser.Parse(path.read_bytes(), True)
    return builder.close()


def find_file(name: str, near: Path, assets: Path | None = None) -> Path:
    """The file that a document names by a path, which starts at a folder above the document or at ``assets``.

    Raises
    ------
    SpecError : there is none.
    """
    file = next(filter(Path.is_file, _places(name, near, assets)), None)
    if file is None:
        problem = f'names "{name}", which is in no folder above it; say where with --assets FOLDER'
        raise SpecError(str(near), problem)
    return file


def find_files(pattern: str, near: Path, assets: Path | None = None) -> list[Path]:
    """The files whose names match an extended path: a folder, and a regular expression of a file's name.

    Raises
    ------
    SpecError : there is none, or the expression is broken.
    """
    folder, name = SPLIT.fullmatch(pattern).groups()  # type: ignore[union-attr]  # whatever it is
    if NESTED.search(name) or len(REPEAT.findall(name)) > MOST_REPEATS:
        raise SpecError(
            str(near),
            f'efilepath = "{pattern}" repeats what repeats, or more than {MOST_REPEATS} times, which may '
            "take for ever; name the files more plainly",
        )
    try:
        matches = re.compile(name).fullmatch
    except re.error as problem:
        raise SpecError(str(near), f'efilepath = "{pattern}" is broken: {problem}') from None
    for place in filter(Path.is_dir, _places(folder, near, assets)):
        files = [file for file in sorted(place.iterdir()) if matches(file.name)]
        if files:
            return files
    raise SpecError(str(near), f'efilepath = "{pattern}" matches no file in a folder above it')


def _places(name: str, near: Path, assets: Path | None) -> Iterator[Path]:
    """Places at which a path of a document may be; it may have been written on Windows."""
    name = name.replace("\\", "/")
    for top in [*([assets] if assets else []), *near.resolve().parents]:
        yield top / name
        yield top / LIBRARY / name


def asset_of(reference: str, tag: str, near: Path, assets: Path | None) -> tuple[Element, Path]:
    """The element that "FILE.xml#ID" names, and its file.

    Raises
    ------
    SpecError : there is no such file or element.
    """
    name, hash_mark, wanted = reference.partition("#")
    if not hash_mark:
        raise SpecError(str(near), f'{tag} = "{reference}" is not FILE.xml#ID')
    path = find_file(name, near, assets)
    for element in read_document(path).iter(tag):
        if element.get("id") == wanted:
            return element, path
    raise SpecError(str(path), f'has no {tag} with id "{wanted}"; check the name')


def number(element: Element, key: str, where: Path, otherwise: float | None = None) -> float:
    """A number of an attribute.

    Raises
    ------
    SpecError : it is missing and nothing stands for it, or it is no finite number.
    """
    text = element.get(key)
    if text is None and otherwise is not None:
        return otherwise
    numbers = _floats(text or "")
    if numbers.shape != (1,) or not np.isfinite(numbers[0]):
        raise SpecError(str(where), f'{element.tag} {key} = "{text or ""}" is not a number')
    return float(numbers[0])


def _floats(text: str) -> np.ndarray:
    """Numbers with semicolons between them; none of a text that is something else."""
    try:
        return np.array([float(part) for part in text.split(";")])
    except ValueError:
        return np.empty(0)


def yes(text: str | None, otherwise: bool) -> bool:
    """The truth that a word states."""
    return otherwise if text is None else text.strip().lower() in ("true", "1", "yes")


def vector(text: str, where: Path) -> np.ndarray:
    """(3,) numbers of "x;y;z".

    Raises
    ------
    SpecError : they are something else.
    """
    numbers = _floats(text)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise SpecError(str(where), f'"{text}" is not three numbers x;y;z')
    return numbers


def place_of(element: Element | None, where: Path) -> np.ndarray:
    """(3,) attributes x, y, z, metres; what is missing is 0."""
    given = Element("none") if element is None else element
    return np.array([number(given, axis, where, 0.0) for axis in "xyz"])


def rotation_of(element: Element | None, where: Path) -> scipy.spatial.transform.Rotation:
    """Turns of an element in their order, about the fixed axes; about the turned ones where it says "local".

    Raises
    ------
    SpecError : an axis that is not x, y or z.
    """
    total = scipy.spatial.transform.Rotation.identity()
    local = element is not None and element.get("rotations") == "local"
    for turn in [] if element is None else element.findall("rot"):
        axis = AXES.get(turn.get("axis", "").lower())
        if axis is None:
            raise SpecError(str(where), f'rot axis = "{turn.get("axis", "")}" is not x, y or z')
        angle = np.deg2rad(number(turn, "angle_deg", where))
        step = scipy.spatial.transform.Rotation.from_rotvec(angle * np.array(axis))
        total = total * step if local else step * total
    return total
