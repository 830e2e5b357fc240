"""Scenes of HELIOS++: Wavefront OBJ parts with scale, rotation and translation, on the ground if they ask.

A part is scaled, then turned, then moved, in whichever order its filters stand. Of materials only
``helios_isGround`` is read, no spectra and no reflectance. Parts that move, and loaders of anything but OBJ,
are refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from ...spec import SpecError
from ..foreign import guarded
from .document import asset_of, find_file, number, rotation_of, vector, yes


@dataclass(frozen=True)
class Wavefront:
    """Triangles of an OBJ file.

    vertices : (V, 3) metres. triangles : (T, 3). material : (T,) slot. ground : (S,) bool of the slots.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    material: np.ndarray
    ground: np.ndarray


@dataclass(frozen=True)
class Part:
    """Part of a scene: a mesh, and where it stands: (3, 4) local to world."""

    name: str
    mesh: Wavefront
    transform: np.ndarray

    @property
    def corners(self) -> np.ndarray:
        """(T, 3, 3) corners of the triangles in the world, metres."""
        turned = self.mesh.vertices @ self.transform[:, :3].T + self.transform[:, 3]
        return np.asarray(turned[self.mesh.triangles])


@guarded("a Wavefront OBJ file")
def read_obj(path: Path, up: str = "z") -> Wavefront:
    """The triangles of a Wavefront file; polygons are cut into fans.

    up : the axis that points up in the file, "z" or "y".

    Raises
    ------
    SpecError : a corner that is not there, or no face at all.
    """
    places: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    slots: list[int] = []
    names = [""]
    grounds: set[str] = set()
    slot = 0
    for line, text in enumerate(path.read_text("utf-8", errors="replace").splitlines(), 1):
        word, *rest = text.split("#")[0].split() or [""]
        if word == "v":
            places.append([float(x) for x in rest[:3]])
        elif word == "f":
            corner = [_corner(one, len(places)) for one in rest]
            if len(corner) < 3 or min(corner) < 0 or max(corner) >= len(places):
                raise SpecError(str(path), f"line {line}: a face has a corner that is not there")
            faces += [(corner[0], b, c) for b, c in pairwise(corner[1:])]
            slots += [slot] * (len(corner) - 2)
        elif word == "usemtl":
            name = " ".join(rest)
            if name not in names:
                names.append(name)
            slot = names.index(name)
        elif word == "mtllib":
            grounds |= _grounds(path.parent / " ".join(rest))
    if not faces:
        raise SpecError(str(path), "has no face")
    vertices = np.array(places)
    if up == "y":
        vertices = np.stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]], axis=1)
    return Wavefront(
        vertices,
        np.array(faces, dtype=np.int32),
        np.array(slots, dtype=np.int32),
        np.array([name in grounds for name in names]),
    )


def _corner(text: str, count: int) -> int:
    index = int(text.split("/")[0])
    return index - 1 if index > 0 else count + index if index else -1


def _grounds(path: Path) -> set[str]:
    """Names of the materials that are ground; none where there is no such file."""
    found: set[str] = set()
    name = ""
    if not path.is_file():
        return found
    for text in path.read_text("utf-8", errors="replace").splitlines():
        word, *rest = text.split() or [""]
        if word == "newmtl":
            name = " ".join(rest)
        elif word == "helios_isGround" and rest and yes(rest[0], False):
            found.add(name)
    return found


def read_scene(reference: str, near: Path, assets: Path | None = None) -> tuple[Part, ...]:
    """The parts of the scene "FILE.xml#ID".

    Raises
    ------
    SpecError : it cannot be read, or holds what is not supported.
    """
    scene, path = asset_of(reference, "scene", near, assets)
    parts: list[Part] = []
    meshes: dict[tuple[Path, str], Wavefront] = {}
    for index, element in enumerate(scene.findall("part")):
        part, on_ground = _part(element, index, path, assets, meshes)
        if on_ground:
            part = _lowered(part, parts, path)
        parts.append(part)
    if not parts:
        raise SpecError(str(path), "the scene has no part")
    return tuple(parts)


def _part(
    element: Element,
    index: int,
    path: Path,
    assets: Path | None,
    meshes: dict[tuple[Path, str], Wavefront],
) -> tuple[Part, bool]:
    where = f"{path}, part {element.get('id', index)}"
    for child in element:
        if child.tag == "dmotion":
            raise SpecError(where, "moves (dmotion); parts that move are not supported")
        if child.tag != "filter":
            raise SpecError(where, f'holds "{child.tag}", which is not supported')
    mesh, scale, turn, shift, on_ground = None, 1.0, Rotation.identity(), np.zeros(3), False
    seen: set[str] = set()
    for step in element.findall("filter"):
        kind = step.get("type", "")
        if kind in seen:
            raise SpecError(where, f'has two filters "{kind}"; only one of a kind is supported')
        seen.add(kind)
        params = {p.get("key", ""): p for p in step.findall("param")}
        if kind == "objloader" and "filepath" in params:
            name = params["filepath"].get("value", "")
            up = params["up"].get("value", "z") if "up" in params else "z"
            if up not in ("y", "z"):
                raise SpecError(where, f'up = "{up}" is not y or z')
            file = find_file(name, path, assets)
            if (file, up) not in meshes:
                meshes[file, up] = read_obj(file, up)
            mesh = meshes[file, up]
        elif kind == "scale":
            scale = number(params["scale"], "value", path)
        elif kind == "rotate":
            turn = rotation_of(params["rotation"], path)
        elif kind == "translate":
            shift = vector(params["offset"].get("value", ""), path)
            on_ground = "onGround" in params and number(params["onGround"], "value", path) != 0
        else:
            raise SpecError(
                where,
                f'filter "{kind}" is not supported; objloader, scale, rotate and translate are',
            )
    if mesh is None:
        raise SpecError(where, "has no objloader with a filepath; other loaders are not supported")
    transform = np.column_stack([turn.as_matrix() * scale, shift])
    return Part(element.get("id", f"part{index}"), mesh, transform), on_ground


def _lowered(part: Part, before: list[Part], path: Path) -> Part:
    """The part with its lowest corner on the ground of the parts before it."""
    corners = part.corners.reshape(-1, 3)
    lowest = corners[np.argmin(corners[:, 2])]
    height = ground_height(before, lowest[0], lowest[1])
    if height is None:
        raise SpecError(str(path), f"{part.name} is to stand on the ground, but none is below it")
    transform = part.transform.copy()
    transform[2, 3] += height - lowest[2]
    return Part(part.name, part.mesh, transform)


def ground_height(parts: tuple[Part, ...] | list[Part], x: float, y: float) -> float | None:
    """Height of the highest ground (``helios_isGround``) at a place, metres; None where there is none."""
    best: float | None = None
    for part in parts:
        ground = part.mesh.ground[part.mesh.material]
        a, b, c = np.moveaxis(part.corners[ground], 1, 0)
        u, v, away = b - a, c - a, np.array([x, y]) - a[:, :2]
        area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            s = (away[:, 0] * v[:, 1] - away[:, 1] * v[:, 0]) / area
            t = (u[:, 0] * away[:, 1] - u[:, 1] * away[:, 0]) / area
        inside = (area != 0) & (s >= -1e-9) & (t >= -1e-9) & (s + t <= 1 + 1e-9)
        if inside.any():
            height = float((a[:, 2] + s * u[:, 2] + t * v[:, 2])[inside].max())
            best = height if best is None else max(best, height)
    return best
