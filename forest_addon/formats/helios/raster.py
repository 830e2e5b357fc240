"""Ground from a GeoTIFF, and voxels from a cloud of points or of AMAPVox, as HELIOS++ loads them."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...base.rng import daughter_keys, keyed_uniform
from ...spec import SpecError
from ..foreign import guarded
from ..raster_file import read_heights
from .material import Material
from .obj import PartMesh, VoxelGrid

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
    SpecError : it holds no square of four heights.
    """
    height, corner, size = read_heights(path)
    there = np.isfinite(height)
    rows, columns = height.shape
    y, x = np.mgrid[:rows, :columns] + 0.5
    vertices = np.stack([corner[0] + x * size[0], corner[1] - y * size[1], height], axis=2)
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.concatenate([np.stack(f, axis=2).reshape(-1, 3) for f in ((a, b, d), (b, c, d))])
    faces = faces[there.ravel()[faces].all(axis=1)]
    if not len(faces):
        raise SpecError(str(path), "has no square of four heights")
    used, faces = np.unique(faces, return_inverse=True)
    if not np.isfinite(vertices.reshape(-1, 3)[used]).all():
        raise SpecError(str(path), "does not say where it lies in numbers")
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
    told = [
        row for row, text in zip(rows, lines, strict=True) if text.strip() and text[:1] not in "#/"
    ]
    try:
        points = np.array(told, dtype=np.float64).reshape(-1, 3)
    except ValueError:
        raise SpecError(str(path), "has a line that is not x, y, z") from None
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


@dataclass(frozen=True)
class VoxelMode:
    """Boxes, "fixed" or "scaled", or a haze, "transmittive", that voxels of AMAPVox become; the power of the
    density by which boxes shrink, and whether they are shifted at random within their cells."""

    name: str
    power: float = 0.5
    shifted: bool = False


@guarded("voxels of AMAPVox")
def read_voxels(path: Path, mode: VoxelMode, material: Material) -> PartMesh:
    """Boxes of the voxels of an AMAPVox file that do not let all light pass.

    A fixed box fills its cell; the edge of a scaled one is the cell's times (density/largest density)^power,
    densities of plant area (PadBVTotal), as in HELIOS++ (Weiser et al. 2021, Remote Sens. 13, 4). Of a
    transmittive file the grid of densities is kept.

    Raises
    ------
    SpecError : the file does not say where it lies, or lacks a column; no voxel stops light.
    """
    lines = [text.strip() for text in path.read_text("utf-8", errors="replace").splitlines()]
    notes = "\n".join(text for text in lines if text[:1] == "#")
    said = dict(re.findall(r"#\s*(\w+)\s*:\s*([^#]*)", notes))
    rows = [text.split() for text in lines if text and text[:1] != "#"]
    head = rows[1] if len(rows) > 1 else []
    for key in ("min_corner", "res", *(["max_pad"] if mode.name == "scaled" else [])):
        if key not in said:
            raise SpecError(str(path), f"is no file of voxels: it does not say #{key}")
    hazy = mode.name == "transmittive"
    for name in ("PadBVTotal", *(() if hazy else ("transmittance",))):
        if name not in head:
            raise SpecError(str(path), f"is no file of voxels: it has no column {name}")
    table = np.array(rows[2:], dtype=np.float64).reshape(-1, len(head))
    density = table[:, head.index("PadBVTotal")]
    passing = np.zeros(len(table)) if hazy else table[:, head.index("transmittance")]
    low, size = np.array(said["min_corner"].split(), dtype=np.float64), float(said["res"])
    there = np.isfinite(passing) & (passing != 1)
    edge = np.full(len(table), size)
    if mode.name != "fixed":
        there &= density > 0
    if mode.name == "scaled":
        edge = size * (np.maximum(density, 0) / float(said["max_pad"])) ** mode.power
    if not there.any():
        raise SpecError(str(path), "has no voxel that stops light")
    middle = low + size * (table[:, :3] + 0.5)
    if mode.shifted:
        keys = daughter_keys(np.zeros(len(table), dtype=np.uint64), np.arange(len(table)))
        chance = np.stack([keyed_uniform(keys, axis) for axis in "xyz"], axis=1)
        middle += (2 * chance - 1) * np.maximum(size - edge, 0)[:, None] / 2
    boxes = _boxes(middle[there], edge[there], material)
    if not hazy:
        return boxes
    return replace(boxes, hazes=(_grid(path, table[there, :3], density[there], low, size),))


def _grid(
    path: Path, cell: np.ndarray, density: np.ndarray, low: np.ndarray, size: float
) -> VoxelGrid:
    """The grid of cells (B, 3) of densities (B,); it starts at ``low``."""
    first = cell.min(axis=0)
    place = (cell - first).astype(np.int64)
    if size <= 0 or np.prod(place.max(axis=0) + 1.0) > MOST_VOXELS:
        raise SpecError(str(path), f"has more than {MOST_VOXELS:,} cells, or cells of no size")
    grid = np.zeros(place.max(axis=0) + 1)
    grid[tuple(place.T)] = density
    return VoxelGrid(low + size * first, size, grid)


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
