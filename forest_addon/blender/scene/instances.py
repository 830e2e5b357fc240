"""Instances of geometry nodes: trees as points of one object, and what Blender evaluates of them as
arrays.

The attributes of a point say which variant of the library stands there, how turned and how large, which
tree and which planting it is (``forest_tree``, ``forest_species``, also the names of the custom
properties of trees that are objects). They go along to the evaluated instances. A library is a
collection of objects that counts them in the order of their names.

``standings`` reads an evaluated object without a loop over instances: its meshes, each with all places
where it stands. Blender gives the instances of a geometry as a point cloud whose points have a transform
and the number of what stands there: an object, or a geometry with a mesh and instances of its own, and
so on down. ``evaluated_transforms`` gives the float32 matrices of points that stand in no scene of the
user's.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from .attributes import read, write
from .layout import ROLE_KEY, TREES, VARIANTS, find_part, objects_in
from .nodes import ROTATION, SCALE, VARIANT, give_instancer, instancer_group

TREE_KEY, SPECIES_KEY = "forest_tree", "forest_species"
IGNORED_KEY, REFLECTANCE_KEY = "forest_ignored", "forest_reflectance"
ASSET_KEY = "forest_asset"  # on the mesh of a tree from a library: which (``meshes.read_truth``)
SOLID_TYPES = {"MESH", "CURVE", "SURFACE", "META", "FONT"}  # objects that can have a surface


class NeedsIterator(Exception):
    """Something stands there that only the depsgraph's own iterator resolves: a collection, duplis."""


@dataclass(frozen=True)
class Standing:
    """One mesh and the N places where it stands.

    transform : (N, 4, 4) float64, from the mesh to the object that was asked about.
    tree, species : (N,) int64, -1 where no attribute says.
    source : the object that the mesh is of, None where geometry nodes made it.
    keeper : what must live as long as the mesh.
    """

    mesh: bpy.types.Mesh
    transform: np.ndarray
    tree: np.ndarray
    species: np.ndarray
    source: bpy.types.Object | None
    keeper: Any = None


def planted_names(scene: bpy.types.Scene, known: Sequence[str]) -> list[str]:
    """Name what the forest of a scene is planted with, by number: what is known, then the undergrowth."""
    found = dict(enumerate(known))
    for home in (find_part(scene, name) for name in (VARIANTS, TREES)):
        for thing in objects_in(home) if home is not None else ():
            number, role = thing.get(SPECIES_KEY, -1), thing.get(ROLE_KEY, "")
            if number >= 0 and "/" in role:
                found.setdefault(number, re.sub(r"[ .]\d+$", "", role.split("/", 1)[1]))
    return [found.get(number, "") for number in range(max(found, default=-1) + 1)]


def has_nodes(thing: bpy.types.Object) -> bool:
    """Return whether geometry nodes work on an object; those that are switched off everywhere do not."""
    nodes = (modifier for modifier in thing.modifiers if modifier.type == "NODES")
    return any(modifier.show_viewport or modifier.show_render for modifier in nodes)


def has_duplis(thing: bpy.types.Object) -> bool:
    """Return whether an object instances in one of the ways that are older than geometry nodes."""
    return thing.instance_type != "NONE" or len(thing.particle_systems) > 0


def may_be_met(thing: bpy.types.Object) -> bool:
    """Return whether an object may have a surface, or instance something that has."""
    waiting, known = [thing], set()
    while waiting:
        one = waiting.pop()
        if one.type in SOLID_TYPES or has_nodes(one):
            return True
        home = one.instance_collection if one.instance_type == "COLLECTION" else None
        if home is not None and home not in known:
            known.add(home)
            waiting.extend(objects_in(home))
    return False


def standings(thing: bpy.types.Object) -> list[Standing]:
    """The meshes of an evaluated object: its own and those that its geometry nodes instance.

    Raises
    ------
    NeedsIterator : the depsgraph's iterator must be asked instead.
    """
    if has_duplis(thing):
        raise NeedsIterator
    if thing.type == "MESH" and not has_nodes(thing):
        return [_alone(thing.data, thing, None)]
    return _of_geometry(thing.evaluated_geometry(), thing)


def _of_geometry(geometry: Any, source: bpy.types.Object | None) -> list[Standing]:
    found = []
    if geometry.mesh is not None:
        found.append(_alone(geometry.mesh, source, geometry))
    cloud = geometry.instances_pointcloud()
    if cloud is None:
        return found
    transform, (number, tree, species) = _of_cloud(cloud)
    for index, reference in enumerate(geometry.instance_references()):
        rows = np.flatnonzero(number == index)
        if not len(rows):
            continue
        for inner in _of_reference(reference):
            copies = len(inner.transform)
            outer = np.repeat(rows, copies)
            found.append(
                Standing(
                    mesh=inner.mesh,
                    transform=(transform[rows, None] @ inner.transform).reshape(-1, 4, 4),
                    tree=_first_known(np.tile(inner.tree, len(rows)), tree[outer]),
                    species=_first_known(np.tile(inner.species, len(rows)), species[outer]),
                    source=inner.source,
                    keeper=(geometry, inner.keeper),
                )
            )
    return found


def _of_reference(reference: Any) -> list[Standing]:
    if isinstance(reference, bpy.types.Object):
        return standings(reference)
    if reference is None:
        return []
    if isinstance(reference, bpy.types.ID):
        raise NeedsIterator  # a collection: what of it is visible is Blender's to say
    return _of_geometry(reference, None)


def _alone(mesh: bpy.types.Mesh, source: bpy.types.Object | None, keeper: Any) -> Standing:
    nothing = np.full(1, -1, dtype=np.int64)
    return Standing(mesh, np.eye(4)[None], nothing, nothing, source, keeper)


def _of_cloud(cloud: bpy.types.PointCloud) -> tuple[np.ndarray, Iterator[np.ndarray]]:
    """Return where instances stand (N, 4, 4), and (N,) whose they are, their trees and their species; -1
    where they do not say."""
    columns = read(cloud, "instance_transform", "FLOAT4X4").reshape(-1, 4, 4)
    names = (".reference_index", TREE_KEY, SPECIES_KEY)
    numbers = (read(cloud, name, "INT", missing=-1).astype(np.int64) for name in names)
    return columns.transpose(0, 2, 1).astype(np.float64), numbers  # Blender keeps columns


def _first_known(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.where(first >= 0, first, second).astype(np.int64)


@dataclass(frozen=True)
class InstancedTrees:
    """N trees as they are evaluated.

    source : objects that they are instances of. transform : (N, 3, 4) local to world. index : (N,) which of
    ``source``. tree, species : (N,) int64, -1 where a tree does not say.
    """

    source: tuple[bpy.types.Object, ...]
    transform: np.ndarray
    index: np.ndarray
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
    write(data, "position", position, "FLOAT_VECTOR")
    write(data, ROTATION, rotation)
    write(data, SCALE, scale)
    for key, values in ((VARIANT, variant), (TREE_KEY, tree), (SPECIES_KEY, species)):
        write(data, key, values, "INT")
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
        return InstancedTrees((), np.empty((0, 3, 4)), empty, empty, empty)
    local, numbers = _of_cloud(points)
    world = np.array(thing.matrix_world, dtype=np.float64)
    return InstancedTrees(tuple(geometry.instance_references()), (world @ local)[:, :3], *numbers)


def _refuse(bad: np.ndarray, values: np.ndarray, tree: np.ndarray, what: str, must: str) -> None:
    if bad.any():
        first = int(np.argmax(bad))
        raise ValueError(f"tree {tree[first]} {what} {values[first]}; it must be {must}")


NAME = "Forest Sensing, for a moment"


def evaluated_transforms(
    position: np.ndarray, rotation: np.ndarray, scale: np.ndarray
) -> np.ndarray:
    """(N, 3, 4) float64 that hold Blender's float32: local to world of N trees.

    position : (N, 3) metres. rotation : (N,) radians about the vertical. scale : (N,) size factors.

    Raises
    ------
    ValueError : a size factor is not above 0, or a place is not finite.
    """
    count = len(position)
    if not count:
        return np.empty((0, 3, 4))
    had = {group.name for group in bpy.data.node_groups}
    number, zero = np.arange(count), np.zeros(count, dtype=np.int64)
    points = points_mesh(NAME, 1, position, rotation, scale, zero, number, zero)
    single = bpy.data.meshes.new(NAME)
    single.vertices.add(1)
    thing, tree = bpy.data.objects.new(NAME, points), bpy.data.objects.new(NAME, single)
    library, scene = bpy.data.collections.new(NAME), bpy.data.scenes.new(NAME)
    try:
        library.objects.link(tree)
        scene.collection.objects.link(thing)
        instancer_group()
        give_instancer(thing, library, library, light=False)
        layer = scene.view_layers[0]
        layer.update()
        placed = read_points(thing.evaluated_get(layer.depsgraph))
    finally:
        bpy.data.batch_remove([thing, tree, points, single, library])
        bpy.data.scenes.remove(scene)
        new = [g for g in bpy.data.node_groups if g.name not in had and not g.users]
        bpy.data.batch_remove(new)
    order = np.argsort(placed.tree)
    return placed.transform[order]
