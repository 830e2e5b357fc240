"""Parts of a HELIOS++ scene: triangles of OBJ files, GeoTIFF and voxels, and their materials.

**Materials** are what a Wavefront material file says of ground and reflectance, and spectra. A spectrum is
a text file of 26 lines about the sample, then wavelength in µm and reflectance in percent (ASTER spectral
library: Baldridge et al. 2009, Remote Sens. Environ. 113, 711). What is not said is half the light, as in
HELIOS++.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from ...base.rng import child_keys, keyed_uniform
from ...spec import SpecError
from ..foreign import guarded, numbers, refuse_coarse
from ..raster_file import read_raster
from .document import find_file, yes

HEADER = 26  # lines of a spectrum
UNKNOWN = 0.5
SPECTRA = "data/spectra"
WORDS = {"v": 1, "f": 2, "usemtl": 3, "mtllib": 4}  # of lines of a Wavefront file that are read


@dataclass(frozen=True)
class Material:
    """Material of a surface: is it ground, its reflectance (NaN: not said), the name of its spectrum."""

    ground: bool = False
    reflectance: float = float("nan")
    spectrum: str = ""

    def reflects(self, wavelength_nm: float, near: Path, assets: Path | None = None) -> float:
        """The reflectance at a wavelength, 0 to 1; a number that the material says comes before its spectrum.

        near : a document; spectra are looked for as the files that it names.
        """
        if np.isfinite(self.reflectance):
            return self.reflectance
        if not self.spectrum or "/" in self.spectrum or "\\" in self.spectrum:
            return UNKNOWN
        try:
            file = find_file(f"{SPECTRA}/{self.spectrum}.txt", near, assets)
        except SpecError:
            return UNKNOWN
        return float(min(max(np.interp(wavelength_nm, *_spectrum(file)), 0.0), 1.0))


@guarded("a Wavefront material file")
def read_materials(path: Path) -> dict[str, Material]:
    """Materials of a .mtl file by name.

    Raises
    ------
    SpecError : no material, or a reflectance that is no number from 0 to 1.
    """
    materials: dict[str, Material] = {}
    text = path.read_text("utf-8", "replace")
    for block in re.split(r"(?m)^[ \t]*newmtl[ \t]+(?=\S)", text)[1:]:
        name, *lines = block.splitlines()
        said = dict(re.findall(r"^[ \t]*helios_(\w+)[ \t]+(\S+)", "\n".join(lines), re.MULTILINE))
        reflectance = float(numbers(said.get("reflectance", "nan"), path, "a reflectance"))
        if reflectance < 0 or reflectance > 1:
            raise SpecError(
                str(path),
                f"helios_reflectance {reflectance:g} is no share from 0 to 1 of the light; write 45 % as "
                "0.45",
            )
        ground = yes(said.get("isGround"), False)
        materials[" ".join(name.split())] = Material(ground, reflectance, said.get("spectra", ""))
    if not materials:
        raise SpecError(str(path), "holds no material (newmtl)")
    return materials


@cache
@guarded("a spectrum of the ASTER library")
def _spectrum(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths in nm, ascending, and reflectances from 0 to 1."""
    lines = path.read_text("latin-1").splitlines()[HEADER:]
    pairs = [line.split()[:2] for line in lines if line.strip()]
    rows = numbers(pairs, path, "wavelength and reflectance")
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    return rows[:, 0] * 1e3, rows[:, 1] / 100.0


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
    notes : sentences on what was not found.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    slot: np.ndarray
    materials: tuple[Material, ...]
    hazes: tuple[VoxelGrid, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def ground(self) -> np.ndarray:
        """(T,) bool, which triangles are ground."""
        return np.array([material.ground for material in self.materials])[self.slot]


def together(surfaces: list[PartMesh]) -> PartMesh:
    """One surface of several."""
    if len(surfaces) == 1:
        return surfaces[0]
    vertex = np.cumsum([0, *(len(one.vertices) for one in surfaces)])
    slot = np.cumsum([0, *(len(one.materials) for one in surfaces)])
    return PartMesh(
        np.concatenate([one.vertices for one in surfaces]),
        np.concatenate([one.triangles + v for one, v in zip(surfaces, vertex, strict=False)]),
        np.concatenate([one.slot + s for one, s in zip(surfaces, slot, strict=False)]),
        tuple(material for one in surfaces for material in one.materials),
        tuple(grid for one in surfaces for grid in one.hazes),
        tuple(note for one in surfaces for note in one.notes),
    )


def _lines_of(path: Path) -> list[str]:
    """Lines of a Wavefront file, their words a space apart from the first; one that goes on after a backslash
    stands where it ends."""
    text = re.sub("#.*", "", path.read_text("utf-8", errors="replace")).replace("\t", " ")
    if "\\\n" in text:
        text = re.sub(
            r"(?m)^(?:.*\\\n)+.*",
            lambda lines: "\n" * lines[0].count("\n") + lines[0].replace("\\\n", " "),
            text,
        )
    return [line.strip() for line in text.splitlines()]


def _material_files(path: Path, lines: list[str]) -> list[Path]:
    """The files that lines ``mtllib`` of an OBJ name, one or several in a line; they may not be there."""
    said = [line.split()[1:] for line in lines if line.startswith("mtllib ")]
    named = [[one] if (path.parent / (one := " ".join(each))).is_file() else each for each in said]
    return [path.parent / name for names in named for name in names]


def lost_materials(path: Path, lines: list[str] | None = None) -> tuple[str, ...]:
    """Sentences on the material files that an OBJ names and that are not there; none of other files."""
    if path.suffix.lower() != ".obj":
        return ()
    return tuple(
        f"{path.name}: its material file {file.name} is not there, what it says of surfaces is not known"
        for file in _material_files(path, _lines_of(path) if lines is None else lines)
        if not file.is_file()
    )


@guarded("a Wavefront OBJ file")
def read_obj(path: Path, up: str = "z") -> PartMesh:
    """The triangles of a Wavefront file; polygons are cut into fans, lines go on after a backslash.

    up : the axis that points up in the file, "z" or "y".

    Raises
    ------
    SpecError : a corner that is not there, no face at all, or a shape that was lost at map coordinates.
    """
    lines = _lines_of(path)
    word = np.array([WORDS.get(line.partition(" ")[0], 0) for line in lines], dtype=np.int8)
    at_vertex, at_face, at_name, at_file = (
        np.flatnonzero(word == number) for number in WORDS.values()
    )
    if not len(at_face):
        raise SpecError(str(path), "has no face")
    places = (" ".join(lines[line].split(None, 4)[1:4]) for line in at_vertex.tolist())
    vertices = np.fromstring(" ".join(places), sep=" ").reshape(len(at_vertex), 3)
    of_faces = [lines[line][1:] for line in at_face.tolist()]
    corners = np.array([len(line.split()) for line in of_faces])
    said = re.sub(r"/\S*", "", "\n".join(of_faces))
    before = np.searchsorted(at_vertex, at_face)  # vertices that stand above a face
    index, known = np.fromstring(said, np.int64, sep=" "), np.repeat(before, corners)
    index += np.where(index > 0, -1, np.where(index < 0, known, -1))
    wrong = corners < 3
    face = np.repeat(np.arange(len(corners)), corners)
    wrong[face[(index < 0) | (index >= known)]] = True
    if wrong.any():
        line = 1 + at_face[np.argmax(wrong)]
        raise SpecError(str(path), f"line {line}: a face has a corner that is not there")
    fan = np.repeat(np.arange(len(corners)), corners - 2)
    second = np.arange(len(fan)) + 2 * fan + 1  # two corners more than triangles a face
    first = (np.cumsum(corners) - corners)[fan]
    faces = index[np.stack([first, second, second + 1], axis=1)].astype(np.int32)
    names = {"": 0}
    slots = [
        0,
        *(names.setdefault(" ".join(lines[line].split()[1:]), len(names)) for line in at_name),
    ]
    slot = np.array(slots, dtype=np.int32)[np.searchsorted(at_name, at_face)][fan]
    refuse_coarse(path, vertices, exact=True)
    material_of: dict[str, Material] = {}
    naming = [lines[line] for line in at_file.tolist()]
    for file in filter(Path.is_file, _material_files(path, naming)):
        if re.sub("#.*", "", file.read_text("utf-8", "replace")).strip():  # else Blender's, of none
            material_of |= read_materials(file)
    if up == "y":
        vertices = np.stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]], axis=1)
    materials = tuple(material_of.get(name, Material()) for name in names)
    return PartMesh(vertices, faces, slot, materials, notes=lost_materials(path, naming))


MOST_VOXELS = 20_000_000  # cells of the grid around a cloud
CORNERS = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)])
SIDES = np.array(
    [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
)


@guarded("a GeoTIFF of heights")
def read_terrain(path: Path, material: Material) -> PartMesh:
    """Ground between the middles of the pixels of a GeoTIFF, two triangles a square; pixels without a height
    are gaps.

    Raises
    ------
    SpecError : it holds no square of four heights, or does not say where it lies.
    """
    raster = read_raster(path)
    if raster.transform is None:
        raise SpecError(str(path), "does not say where it lies; save a GeoTIFF")
    height = raster.heights(path)
    there = np.isfinite(height)
    rows, columns = height.shape
    y, x = np.mgrid[:rows, :columns] + 0.5
    vertices = np.concatenate([raster.places(x, y), height[..., None]], axis=2)
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.concatenate([np.stack(f, axis=2).reshape(-1, 3) for f in ((a, b, d), (b, c, d))])
    faces = faces[there.ravel()[faces].all(axis=1)]
    if not len(faces):
        raise SpecError(str(path), "has no square of four heights")
    used, faces = np.unique(faces, return_inverse=True)
    return _of_one_material(vertices.reshape(-1, 3)[used], faces.reshape(-1, 3), material)


@guarded("a text of points x, y, z")
def read_points(
    path: Path, separator: str, size: float, material: Material, fewest: int = 1
) -> PartMesh:
    """Voxels of an edge ``size``, metres, in which points of a text file lie, as boxes.

    The grid starts at the smallest coordinates and has as many cells as cover the largest, as in HELIOS++.
    Voxels of less than ``fewest`` points are left out: HELIOS++ cannot estimate a normal of less than three.

    Raises
    ------
    SpecError : a size that is no length, no points, or a grid that is too fine.
    """
    if not size > 0:
        raise SpecError(str(path), f"voxelSize = {size:g} must be above 0")
    lines = path.read_text("utf-8", errors="replace").splitlines()
    rows = [text.split(separator if separator.strip() else None)[:3] for text in lines]
    told = [row for row, t in zip(rows, lines, strict=True) if t.strip() and t[:1] not in "#/"]
    points = numbers(told, path, "x, y, z").reshape(-1, 3)
    if not len(points) or not np.isfinite(points).all():
        raise SpecError(str(path), "holds no points, or values that are no numbers")
    low, extent = points.min(axis=0), np.ptp(points, axis=0)
    cells = np.maximum(np.ceil(extent / size), 1)
    if cells.prod() > MOST_VOXELS:
        raise SpecError(
            str(path), f"voxelSize = {size:g} m makes too fine a grid; take a larger one"
        )
    place = (points - low) * cells / np.where(extent > 0, extent, 1.0)
    place = np.clip(place, 0, cells - 1).astype(np.int64)
    place, many = np.unique(place, axis=0, return_counts=True)
    place = place[many >= fewest]
    if not len(place):
        raise SpecError(str(path), f"has no voxel of {fewest} points; take a larger voxelSize")
    low = np.where(extent > 0, low, -size / 2)
    return _boxes(low + size * (place + 0.5), np.full(len(place), size), material)


@guarded("voxels of AMAPVox")
def read_voxels(
    path: Path, material: Material, mode: str, power: float = 0.5, shifted: bool = False
) -> PartMesh:
    """Boxes of the voxels of an AMAPVox file that do not let all light pass.

    A fixed box fills its cell; the edge of a scaled one is the cell's times (density/largest density)^power,
    densities of plant area (PadBVTotal), as in HELIOS++ (Weiser et al. 2021, Remote Sens. 13, 4). Of a
    transmittive file the grid of densities is kept.

    mode : "fixed", "scaled" or "transmittive". shifted : boxes are shifted at random within their cells.

    Raises
    ------
    SpecError : the file does not say where it lies, or lacks a column; no voxel stops light.
    """
    lines = [text.strip() for text in path.read_text("utf-8", errors="replace").splitlines()]
    notes = "\n".join(text for text in lines if text[:1] == "#")
    said = dict(re.findall(r"#\s*(\w+)\s*:\s*([^#]*)", notes))
    rows = [text.split() for text in lines if text and text[:1] != "#"]
    head = rows[1] if len(rows) > 1 else []
    hazy, scaled = mode == "transmittive", mode == "scaled"
    for key in ("min_corner", "res", *(["max_pad"] if scaled else [])):
        if key not in said:
            raise SpecError(str(path), f"is no file of voxels: it does not say #{key}")
    for name in ("PadBVTotal", *(() if hazy else ("transmittance",))):
        if name not in head:
            raise SpecError(str(path), f"is no file of voxels: it has no column {name}")
    table = numbers(rows[2:], path, "numbers").reshape(-1, len(head))
    low, size = np.array(said["min_corner"].split(), dtype=np.float64), float(said["res"])
    passing = np.zeros(len(table)) if hazy else table[:, head.index("transmittance")]
    density = table[:, head.index("PadBVTotal")]
    there = np.isfinite(passing) & (passing != 1) & ((density > 0) | (mode == "fixed"))
    if not there.any():
        raise SpecError(str(path), "has no voxel that stops light")
    cell, density = table[there, :3], density[there]
    edge = np.full(len(cell), size)
    if scaled:
        edge = size * (density / float(said["max_pad"])) ** power
    middle = low + size * (cell + 0.5)
    if shifted:
        keys = child_keys(np.zeros(len(cell), dtype=np.uint64), np.flatnonzero(there))
        chance = np.stack([keyed_uniform(keys, axis) for axis in "xyz"], axis=1)
        middle += (2 * chance - 1) * np.maximum(size - edge, 0)[:, None] / 2
    boxes = _boxes(middle, edge, material)
    if not hazy:
        return boxes
    first = cell.min(axis=0)
    place = (cell - first).astype(np.int64)
    if size <= 0 or np.prod(place.max(axis=0) + 1.0) > MOST_VOXELS:
        raise SpecError(str(path), f"has more than {MOST_VOXELS:,} cells, or cells of no size")
    grid = np.zeros(place.max(axis=0) + 1)
    grid[tuple(place.T)] = density
    return replace(boxes, hazes=(VoxelGrid(low + size * first, size, grid),))


def _boxes(middle: np.ndarray, edge: np.ndarray, material: Material) -> PartMesh:
    """Cubes of middles (B, 3) and edges (B,), metres."""
    vertices = (middle[:, None] + edge[:, None, None] * (CORNERS - 0.5)).reshape(-1, 3)
    sides = np.concatenate([SIDES[:, [0, 1, 2]], SIDES[:, [0, 2, 3]]])
    faces = (8 * np.arange(len(middle))[:, None, None] + sides).reshape(-1, 3)
    return _of_one_material(vertices, faces, material)


def _of_one_material(vertices: np.ndarray, faces: np.ndarray, material: Material) -> PartMesh:
    return PartMesh(
        vertices, faces.astype(np.int32), np.zeros(len(faces), dtype=np.int32), (material,)
    )
