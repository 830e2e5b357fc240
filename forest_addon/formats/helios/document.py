"""XML documents of HELIOS++, read without document types and entities, and the files that they name."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np
from scipy.spatial.transform import Rotation

from ...spec import SpecError
from ..foreign import guarded

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
    parser.EntityDeclHandler = refuse
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
    for place in _places(name, near, assets):
        if place.is_file():
            return place
    raise SpecError(
        str(near), f'names "{name}", which is in no folder above it; say where with --assets FOLDER'
    )


def find_files(pattern: str, near: Path, assets: Path | None = None) -> list[Path]:
    """The files whose names match an extended path: a folder, and a regular expression of a file's name.

    Raises
    ------
    SpecError : there is none, or the expression is broken.
    """
    folder, _, name = pattern.replace("\\", "/").rpartition("/")
    try:
        matches = re.compile(name).fullmatch
    except re.error as problem:
        raise SpecError(str(near), f'efilepath = "{pattern}" is broken: {problem}') from None
    for place in _places(folder, near, assets):
        if place.is_dir():
            found = [file for file in sorted(place.iterdir()) if matches(file.name)]
            if found:
                return found
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
    try:
        found = float(text or "")
    except ValueError:
        found = np.nan
    if not np.isfinite(found):
        raise SpecError(str(where), f'{element.tag} {key} = "{text or ""}" is not a number')
    return found


def yes(text: str | None, otherwise: bool) -> bool:
    """The truth that a word states."""
    return otherwise if text is None else text.strip().lower() in ("true", "1", "yes")


def vector(text: str, where: Path) -> np.ndarray:
    """(3,) numbers of "x;y;z".

    Raises
    ------
    SpecError : they are something else.
    """
    try:
        found = np.array([float(part) for part in text.split(";")])
    except ValueError:
        found = np.full(1, np.nan)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise SpecError(str(where), f'"{text}" is not three numbers x;y;z')
    return found


def place_of(element: Element | None, where: Path) -> np.ndarray:
    """(3,) attributes x, y, z, metres; what is missing is 0."""
    if element is None:
        return np.zeros(3)
    return np.array([number(element, axis, where, 0.0) for axis in "xyz"])


def rotation_of(element: Element | None, where: Path) -> Rotation:
    """Turns of an element in their order, about the fixed axes; about the turned ones where it says "local".

    Raises
    ------
    SpecError : an axis that is not x, y or z.
    """
    total = Rotation.identity()
    if element is None:
        return total
    for turn in element.findall("rot"):
        axis = AXES.get(turn.get("axis", "").lower())
        if axis is None:
            raise SpecError(str(where), f'rot axis = "{turn.get("axis", "")}" is not x, y or z')
        angle = np.deg2rad(number(turn, "angle_deg", where))
        step = Rotation.from_rotvec(angle * np.array(axis))
        total = total * step if element.get("rotations") == "local" else step * total
    return total
