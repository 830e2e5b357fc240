"""Data that node groups of wind read: pieces of trees as meshes, how modes move each, amplitudes in time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import bpy
import numpy as np

from ...base.progress import Progress
from ...base.trimesh import TriMesh
from ...sensing.rays.pieces import parted
from ..scene.meshes import to_mesh
from ..scene.ours import make_object
from .wind_nodes import COLUMNS, MODES, amplitude_name, basis_name

if TYPE_CHECKING:
    from ...growth.sway.shape import (
        SwayRig,  # brings in scipy, and panels are drawn with this module
    )


class SwayingTrees(Protocol):
    """The sway of a stand, as ``stand.wind.sway`` has it."""

    @property
    def number(self) -> dict[int, int]: ...

    def rig(self, tree: int) -> SwayRig | None: ...

    def amplitudes(self, tree: int, knot: np.ndarray) -> np.ndarray: ...

    def rest(self, tree: int) -> TriMesh: ...

    def variant(self, tree: int) -> tuple[int, int]: ...

    def pieces(self, tree: int, mesh: TriMesh) -> np.ndarray: ...


@dataclass(frozen=True)
class WindShown:
    """Numbers of what was made: trees that sway, trees that stand still, pieces of all, seconds of wind."""

    trees: int
    still: int
    pieces: int
    seconds: float


@dataclass(frozen=True)
class WindClock:
    """Frames in which wind is shown: the first one, knots of amplitudes in a frame, knots of the table, and
    the amplitudes there (``amplitudes_of``)."""

    first: int
    knots: float
    count: int
    amplitudes: Mapping[int, np.ndarray]


def amplitudes_of(
    sway: SwayingTrees, count: int, tell: Progress | None = None
) -> dict[int, np.ndarray]:
    """Compute the amplitudes (count, M) of each tree that sways at that many knots, by its row; touches no
    Blender."""
    rows, knot, found = sorted(sway.number.values()), np.arange(count), {}
    for done, row in enumerate(rows):
        if tell:
            tell(done, len(rows))
        if sway.rig(row) is not None:
            found[row] = sway.amplitudes(row, knot).astype(np.float32)
    return found


def table_of(
    amplitudes: Mapping[int, np.ndarray], rows: Sequence[int], count: int
) -> bpy.types.Mesh:
    """Amplitudes of every tree at every knot: a vertex for each, trees one after another."""
    data = bpy.data.meshes.new("Wind Table")
    data.vertices.add(len(rows) * count)
    values = np.zeros((len(rows), count, MODES), np.float32)
    for place, row in enumerate(rows):
        own = amplitudes[row]
        values[place, :, : own.shape[1]] = own
    for first in range(0, MODES, 3):
        made = data.attributes.new(amplitude_name(first), "FLOAT_VECTOR", "POINT")
        made.data.foreach_set(
            "vector", np.ascontiguousarray(values[..., first : first + 3]).ravel()
        )
    return data


def pieces_of(
    sway: SwayingTrees,
    row: int,
    mesh: TriMesh,
    coats: Sequence[bpy.types.Material | None],
    home: bpy.types.Collection,
) -> np.ndarray:
    """Cut a mesh of a tree's variant, its own or a stand-in, into objects of a collection, in the order of
    their names; returns how modes move each, (P, MODES, 3, 4)."""
    rig = sway.rig(row)
    assert rig is not None
    parts = parted(mesh, sway.pieces(row, mesh))
    before = len(home.objects)
    for place, (_, part) in enumerate(parts, before):
        shape = to_mesh(f"{home.name} {place:06d}", part)
        for coat in coats:
            shape.materials.append(coat)
        make_object(shape.name, shape, home)
    own = np.array([piece for piece, _ in parts], np.int64)
    maps = np.zeros((len(own), MODES, 3, COLUMNS), np.float32)
    maps[:, : rig.maps.shape[1]] = rig.maps[own]
    return maps


def pieces_mesh(maps: np.ndarray, numbers: Mapping[str, np.ndarray]) -> bpy.types.Mesh:
    """A point for every piece: how modes move it, (P, MODES, 3, 4), and whole numbers (P,) by name."""
    data = bpy.data.meshes.new("Wind Pieces")
    data.vertices.add(len(maps))
    for name, values in numbers.items():
        give_numbers(data, name, values)
    for mode in range(MODES):
        for column in range(COLUMNS):
            made = data.attributes.new(basis_name(mode, column), "FLOAT_VECTOR", "POINT")
            values = np.ascontiguousarray(maps[:, mode, :, column], dtype=np.float32)
            made.data.foreach_set("vector", values.ravel())
    return data


def give_numbers(data: bpy.types.Mesh, name: str, values: np.ndarray) -> None:
    """Give each point of a mesh a whole number."""
    made = data.attributes.get(name) or data.attributes.new(name, "INT", "POINT")
    made.data.foreach_set("value", np.ascontiguousarray(values, dtype=np.int32))
