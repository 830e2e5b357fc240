"""Instances of geometry nodes as arrays: no loop over instances.

An evaluated object goes in; out come its meshes, each with all places where it stands. Blender gives the
instances of a geometry as a point cloud whose points have a transform and the number of what stands
there: an object, or a geometry with a mesh and instances of its own, and so on down. The point attributes
``forest_tree`` and ``forest_species`` say which tree a point is.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from .layout import ROLE_KEY, TREES, VARIANTS, find_part, objects_in

TREE_KEY, SPECIES_KEY = "forest_tree", "forest_species"
IGNORED_KEY, REFLECTANCE_KEY = "forest_ignored", "forest_reflectance"
ASSET_KEY = "forest_asset"  # on the mesh of a tree from a library: which (``asset_truth``)
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
    transform = _values(cloud, "instance_transform", np.float32, 16)
    # Each point's matrix comes column by column.
    transform = transform.reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)
    number = _values(cloud, ".reference_index", np.int32)
    tree, species = (_values(cloud, name, np.int32) for name in (TREE_KEY, SPECIES_KEY))
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


def _values(cloud: Any, name: str, dtype: type, width: int = 1) -> np.ndarray:
    """A point attribute; -1 where the cloud has none of this kind."""
    attribute = cloud.attributes.get(name)
    count = len(cloud.points)
    kind = "INT" if dtype is np.int32 else "FLOAT4X4"
    if attribute is None or attribute.data_type != kind or attribute.domain != "POINT":
        return np.full(count * width, -1, dtype=dtype)
    values = np.empty(count * width, dtype=dtype)
    attribute.data.foreach_get("value", values)
    return values


def _first_known(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.where(first >= 0, first, second).astype(np.int64)
