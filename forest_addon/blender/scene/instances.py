"""Many trees as one object: a vertex for every tree, on which geometry nodes put its variant.

The attributes of a vertex say which variant of the library stands there, how turned and how large, which
tree and which planting it is (``forest_tree``, ``forest_species``, the names of the custom properties that
trees have where each is an object). They go along to the evaluated instances, where ``read_points`` and
the sensors find them. A library is a collection of objects that counts them in the order of their names.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import numpy as np

from .nodes import ROTATION, SCALE, VARIANT
from .standings import SPECIES_KEY, TREE_KEY, has_nodes


@dataclass(frozen=True)
class InstancedTrees:
    """N trees as they are evaluated.

    source : objects that they are instances of. index : (N,) which of ``source``.
    transform : (N, 3, 4) local to world. tree, species : (N,) int64, -1 where a tree does not say.
    """

    source: tuple[bpy.types.Object, ...]
    index: np.ndarray
    transform: np.ndarray
    tree: np.ndarray
    species: np.ndarray

    def __len__(self) -> int:
        return len(self.index)


def points_mesh(
    name: str,
    count: int,
    position: np.ndarray,
    rotation: np.ndarray,
    scale: np.ndarray,
    variant: np.ndarray,
    tree: np.ndarray,
    species: np.ndarray,
) -> bpy.types.Mesh:
    """The points of N trees, for an object that ``give_instancer`` completes.

    count : how many variants there are. position : (N, 3) metres. rotation : (N,) radians about the
    vertical. scale : (N,) size factors. variant : (N,) number of an object in the library by the order of
    names. tree, species : (N,) numbers that sensors report.

    Raises
    ------
    ValueError : a size factor is not above 0, a place is not finite, a variant is not there.
    """
    _refuse(~(np.isfinite(scale) & (scale > 0)), scale, tree, "has the size factor", "above 0")
    _refuse(~np.isfinite(position).all(axis=1), position, tree, "stands at", "finite")
    _refuse(~np.isfinite(rotation), rotation, tree, "is turned by", "finite")
    _refuse((variant < 0) | (variant >= count), variant, tree, "is variant", f"0 to {count - 1}")
    data = bpy.data.meshes.new(name)
    data.vertices.add(len(position))
    _fill(data, "position", "FLOAT_VECTOR", position, np.float32, "vector")
    _fill(data, ROTATION, "FLOAT", rotation, np.float32)
    _fill(data, SCALE, "FLOAT", scale, np.float32)
    for key, values in ((VARIANT, variant), (TREE_KEY, tree), (SPECIES_KEY, species)):
        _fill(data, key, "INT", values, np.int32)
    data.update()
    return data


def ranks(names: Sequence[str], others: Sequence[str]) -> np.ndarray:
    """Return which place each of ours has in a library where ``others`` are too, as geometry nodes count
    them."""
    order = sorted([*names, *others], key=natural)
    return np.array([order.index(name) for name in names], dtype=np.int64)


def natural(name: str) -> list[str | int]:
    """A key to sort by as Blender does: numbers by their size, letters whatever their case."""
    pieces: list[str | int] = list(re.split(r"([0-9]+)", name.lower()))
    pieces[1::2] = [int(number) for number in pieces[1::2]]
    return pieces


def read_points(thing: bpy.types.Object) -> InstancedTrees:
    """The trees of an evaluated object; none where its modifiers put none."""
    geometry = thing.evaluated_geometry() if has_nodes(thing) else None
    points = geometry.instances_pointcloud() if geometry is not None else None
    if points is None or not len(points.points):  # 4.5 gives no columns where there is no row
        empty = np.empty(0, dtype=np.int64)
        return InstancedTrees((), empty, np.empty((0, 3, 4)), empty, empty)
    count = len(points.points)
    local = np.empty(16 * count, dtype=np.float32)
    points.attributes["instance_transform"].data.foreach_get("value", local)
    local = local.reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)  # Blender keeps columns
    world = np.array(thing.matrix_world, dtype=np.float64)
    return InstancedTrees(
        source=tuple(geometry.instance_references()),
        index=_numbers(points, ".reference_index", count),
        transform=(world @ local)[:, :3],
        tree=_numbers(points, TREE_KEY, count),
        species=_numbers(points, SPECIES_KEY, count),
    )


def _numbers(points: bpy.types.PointCloud, name: str, count: int) -> np.ndarray:
    """(N,) values of an integer attribute, -1 where it is missing or of another kind."""
    attribute = points.attributes.get(name)
    if attribute is None or attribute.data_type != "INT":
        return np.full(count, -1, dtype=np.int64)
    values = np.empty(count, dtype=np.int32)
    attribute.data.foreach_get("value", values)
    return values.astype(np.int64)


def _refuse(bad: np.ndarray, values: np.ndarray, tree: np.ndarray, what: str, must: str) -> None:
    if bad.any():
        first = int(np.argmax(bad))
        raise ValueError(f"tree {tree[first]} {what} {values[first]}; it must be {must}")


def _fill(
    data: bpy.types.Mesh, name: str, kind: str, values: np.ndarray, dtype: type, key: str = "value"
) -> None:
    attribute = data.attributes.get(name) or data.attributes.new(name, kind, "POINT")
    attribute.data.foreach_set(key, np.ascontiguousarray(values, dtype=dtype).ravel())
