"""Scenes and surveys of HELIOS++ as documents, and the OBJ parts that they name.

Paths in the documents start at the folder that all is written to, as HELIOS++ wants of its assets: run it
there, or name the folder by ``--assets``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from scipy.spatial.transform import Rotation

from ..atomic import replacing

SIMILAR = 2e-6  # of the squared scale: Blender places instances in single precision
ROWS_AT_ONCE = 100_000


def is_similar(transform: np.ndarray) -> bool:
    """Return whether a transform (3, 4) only turns, scales evenly and moves, as HELIOS++ can say."""
    linear = transform[:, :3]
    square = linear.T @ linear
    scale = float(np.trace(square)) / 3
    even = scale > 0 and np.abs(square - scale * np.eye(3)).max() <= SIMILAR * scale
    return bool(even and np.linalg.det(linear) > 0)


def write_obj(
    path: Path,
    vertices: np.ndarray,
    triangles: np.ndarray,
    slot: np.ndarray,
    names: Sequence[str],
    materials: str,
) -> None:
    """Write vertices (V, 3) in metres and triangles (T, 3) as a Wavefront file, in their order.

    slot : (T,) which of ``names`` a triangle's material is. materials : name of the .mtl file beside.
    """
    changes = np.flatnonzero(np.diff(slot, prepend=-1)).tolist()
    with replacing(path) as partial, partial.open("w", encoding="ascii") as file:
        file.write(f"# Forest Sensing, metres, z up\nmtllib {materials}\n")
        for first in range(0, len(vertices), ROWS_AT_ONCE):
            part = vertices[first : first + ROWS_AT_ONCE].tolist()
            file.writelines(f"v {x!r} {y!r} {z!r}\n" for x, y, z in part)
        for first, stop in zip(changes, [*changes[1:], len(slot)], strict=True):
            file.write(f"usemtl {names[slot[first]]}\n")
            part = (triangles[first:stop] + 1).tolist()
            file.writelines(f"f {a} {b} {c}\n" for a, b, c in part)


def write_materials(path: Path, reflectance: Mapping[str, float], ground: Iterable[str]) -> None:
    """Write materials by name with their reflectance at the scanner's wavelength, and which are ground."""
    floors = set(ground)
    lines = ["# Forest Sensing"]
    for name, share in reflectance.items():
        said = "true" if name in floors else "false"
        lines += [f"newmtl {name}", f"Kd {share:g} {share:g} {share:g}"]
        lines += [f"helios_reflectance {share!r}", f"helios_isGround {said}", ""]
    with replacing(path) as partial:
        partial.write_text("\n".join(lines) + "\n", encoding="utf-8")


def scene_document(name: str, parts: Iterable[tuple[int, str, np.ndarray]]) -> Element:
    """The document of a scene: each part is loaded, scaled, turned and moved.

    parts : number, OBJ file as documents name it, and (3, 4) where it stands, local to world.

    Raises
    ------
    ValueError : a transform is none that ``is_similar`` allows.
    """
    root = Element("document")
    scene = SubElement(root, "scene", id=name, name=name)
    for number, file, transform in parts:
        if not is_similar(transform):
            raise ValueError(f"{number} is sheared, mirrored or scaled unevenly")
        linear = transform[:, :3]
        scale = float(np.cbrt(np.linalg.det(linear)))
        element = SubElement(scene, "part", id=str(number))
        _param(_filter(element, "objloader"), "string", "filepath", file)
        turn = Rotation.from_matrix(linear / scale)
        if turn.magnitude():
            step = _filter(element, "rotate")
            rotated(SubElement(step, "param", type="rotation", key="rotation"), turn)
        if scale != 1.0:
            _param(_filter(element, "scale"), "double", "scale", repr(scale))
        where = ";".join(repr(x) for x in transform[:, 3].tolist())
        _param(_filter(element, "translate"), "vec3", "offset", where)
    return root


def rotated(parent: Element, turn: Rotation) -> None:
    """Say a rotation in an element, as turns about the fixed axes."""
    for axis, angle in zip("xyz", turn.as_euler("xyz", degrees=True).tolist(), strict=True):
        SubElement(parent, "rot", axis=axis, angle_deg=repr(angle))


def words(values: Mapping[str, object]) -> dict[str, str]:
    """Attributes of an element: numbers with all their digits, truths as words."""
    said = {key: str(v).lower() if isinstance(v, bool) else v for key, v in values.items()}
    return {key: v if isinstance(v, str) else repr(v) for key, v in said.items()}


def write_document(path: Path, root: Element) -> None:
    """Write an XML document."""
    ElementTree.indent(root)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as partial:
        ElementTree.ElementTree(root).write(partial, encoding="utf-8", xml_declaration=True)


def _filter(part: Element, kind: str) -> Element:
    return SubElement(part, "filter", type=kind)


def _param(step: Element, kind: str, key: str, value: str) -> None:
    SubElement(step, "param", type=kind, key=key, value=value)
