"""Wavefront OBJ files of HELIOS++: triangles and their materials."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from ...spec import SpecError
from ..foreign import guarded
from .material import Material, read_materials


@dataclass(frozen=True)
class VoxelGrid:
    """Cubes of plant area: lowest corner (3,) and edge, metres, and m² a m³ of each cell (X, Y, Z)."""

    low: np.ndarray
    size: float
    density: np.ndarray


@dataclass(frozen=True)
class PartMesh:
    """Triangles and their materials.

    vertices : (V, 3) metres. triangles : (T, 3). slot : (T,) number of the material. materials : (S,).
    hazes : grids that light passes by chance; the triangles are then sides of their cells, which stop none.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    slot: np.ndarray
    materials: tuple[Material, ...]
    hazes: tuple[VoxelGrid, ...] = ()

    @property
    def ground(self) -> np.ndarray:
        """(T,) bool, which triangles are ground."""
        return np.array([material.ground for material in self.materials])[self.slot]


def together(surfaces: list[PartMesh]) -> PartMesh:
    """One surface of several."""
    vertex = np.cumsum([0, *(len(one.vertices) for one in surfaces)])
    slot = np.cumsum([0, *(len(one.materials) for one in surfaces)])
    return PartMesh(
        np.concatenate([one.vertices for one in surfaces]),
        np.concatenate([one.triangles + v for one, v in zip(surfaces, vertex, strict=False)]),
        np.concatenate([one.slot + s for one, s in zip(surfaces, slot, strict=False)]),
        tuple(material for one in surfaces for material in one.materials),
        tuple(grid for one in surfaces for grid in one.hazes),
    )


@guarded("a Wavefront OBJ file")
def read_obj(path: Path, up: str = "z") -> PartMesh:
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
    known: dict[str, Material] = {}
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
        elif word == "mtllib" and (path.parent / " ".join(rest)).is_file():
            known |= read_materials(path.parent / " ".join(rest))
    if not faces:
        raise SpecError(str(path), "has no face")
    vertices = np.array(places)
    if not np.isfinite(vertices).all():
        raise SpecError(str(path), "has corners that are no numbers")
    if up == "y":
        vertices = np.stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]], axis=1)
    return PartMesh(
        vertices,
        np.array(faces, dtype=np.int32),
        np.array(slots, dtype=np.int32),
        tuple(known.get(name, Material()) for name in names),
    )


def _corner(text: str, count: int) -> int:
    index = int(text.split("/")[0])
    return index - 1 if index > 0 else count + index if index else -1
