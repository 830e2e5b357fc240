"""Inputs of a stand from a Blender scene: the ground, painted weights, places of trees."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import bpy
import numpy as np

from ...base.vectors import azimuth_of
from ...spec import SpecError
from ...stand.compose import Painted, TreeList
from ...stand.intensity.surface import Triangulated
from ..scene.attributes import read, world_places_of
from ..scene.layout import LUMINANCE, objects_in
from .depsgraph import SOLID_TYPES

if TYPE_CHECKING:
    from ...site import ForestSite

S = TypeVar("S", bound="ForestSite")
WEIGHTS = ("FLOAT", "INT", "INT8", "BOOLEAN", "FLOAT_COLOR", "BYTE_COLOR")  # kinds of attributes


def with_objects(site: S, depsgraph: bpy.types.Depsgraph | None = None) -> S:
    """Add the ground, painted weights and places of trees that objects of the evaluated scene give to what a
    site has from files.

    Raises
    ------
    SpecError : there is no such object, layer or collection; says what there is.
    """
    depsgraph = depsgraph or bpy.context.evaluated_depsgraph_get()
    settings, inputs = site.scene, site.inputs
    painted, lists, terrain = dict(inputs.painted), dict(inputs.lists), inputs.terrain
    if settings.forest.terrain.object:
        terrain = read_terrain(settings.forest.terrain.object, depsgraph)
    for number, planting in enumerate(settings.plantings):
        if planting.painted:
            where = f"plantings[{number}].painted"
            painted[planting.painted] = read_painted(planting.painted, depsgraph, where)
        if planting.layout == "list" and planting.collection:
            where = f"plantings[{number}].collection"
            lists[planting.collection] = read_places(planting.collection, depsgraph, where)
    return replace(site, inputs=replace(inputs, painted=painted, lists=lists, terrain=terrain))


def read_terrain(
    name: str, depsgraph: bpy.types.Depsgraph, where: str = "forest.terrain.object"
) -> Triangulated:
    """The topmost surface of an evaluated object."""
    obj = _object(name, depsgraph, where)
    data = obj.to_mesh()
    try:
        return Triangulated(*_world(obj, data))
    except ValueError as problem:
        raise SpecError(where, f'"{name}": {problem}') from None
    finally:
        obj.to_mesh_clear()


def read_painted(
    name: str, depsgraph: bpy.types.Depsgraph, where: str = "plantings.painted"
) -> Painted:
    """The weights of a layer of an evaluated object, named OBJECT or OBJECT:LAYER.

    Without a layer the active vertex group counts, else the active colour attribute.
    """
    holder, _, layer = (name, "", "") if name in bpy.data.objects else name.rpartition(":")
    obj = _object(holder or name, depsgraph, where)
    data = obj.to_mesh()
    try:
        vertices, triangles = _world(obj, data)
        domain, values = _layer(obj, data, layer, where)
        if domain == "POINT":
            return Painted(vertices, triangles, values)
        loops = np.empty((len(triangles), 3), dtype=np.int32)
        data.loop_triangles.foreach_get("loops", loops.ravel())
        faces = np.empty(len(triangles), dtype=np.int32)
        data.loop_triangles.foreach_get("polygon_index", faces)
        corner = values[loops] if domain == "CORNER" else np.repeat(values[faces, None], 3, axis=1)
        apart = np.arange(3 * len(triangles)).reshape(
            -1, 3
        )  # a vertex may weigh differently a face
        return Painted(vertices[triangles].reshape(-1, 3), apart, corner.ravel())
    finally:
        obj.to_mesh_clear()


def read_places(
    name: str, depsgraph: bpy.types.Depsgraph, where: str = "plantings.collection"
) -> TreeList:
    """Poses of the objects of a collection, in the order of their names: place, turn, size.

    The size factor is the cube root of the volume that a unit cube has in the object.
    """
    collection = bpy.data.collections.get(name)
    if collection is None:
        known = ", ".join(sorted(c.name for c in bpy.data.collections)) or "none"
        raise SpecError(where, f'there is no collection "{name}" in the scene; there are: {known}')
    things = sorted(objects_in(collection), key=lambda obj: obj.name)
    matrix = np.array(
        [obj.evaluated_get(depsgraph).matrix_world for obj in things], dtype=np.float64
    ).reshape(-1, 4, 4)
    volume = np.linalg.det(matrix[:, :3, :3])
    if (volume <= 0).any():
        mirrored = things[int(np.argmax(volume <= 0))].name
        raise SpecError(
            where, f'"{mirrored}" is mirrored or flat; give it a scale above 0 on each axis'
        )
    return TreeList(
        position=matrix[:, :3, 3],
        scale=np.cbrt(volume),
        rotation=azimuth_of(matrix[:, :, 0]),
    )


def _object(name: str, depsgraph: bpy.types.Depsgraph, where: str) -> bpy.types.Object:
    obj = bpy.data.objects.get(name)
    if obj is None or obj.type not in SOLID_TYPES:
        solid = sorted(o.name for o in bpy.data.objects if o.type in SOLID_TYPES)
        few = ", ".join(solid[:10]) + (", ..." if len(solid) > 10 else "")
        problem = f'there is no object "{name}" with a surface in the scene'
        raise SpecError(where, f"{problem}; there are: {few or 'none'}")
    return obj.evaluated_get(depsgraph)


def _world(obj: bpy.types.Object, data: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) in the world and triangles (T, 3) of an evaluated mesh."""
    data.calc_loop_triangles()
    triangles = np.empty((len(data.loop_triangles), 3), dtype=np.int32)
    data.loop_triangles.foreach_get("vertices", triangles.ravel())
    return world_places_of(obj, data), triangles


def _layer(
    obj: bpy.types.Object, data: bpy.types.Mesh, layer: str, where: str
) -> tuple[str, np.ndarray]:
    """The domain of a layer and its values."""
    group = obj.vertex_groups.get(layer) if layer else obj.vertex_groups.active
    if group is not None:
        weights = np.zeros(len(data.vertices))
        for vertex in data.vertices:
            for membership in vertex.groups:
                if membership.group == group.index:
                    weights[vertex.index] = membership.weight
        return "POINT", weights
    attribute = data.attributes.get(layer) if layer else data.color_attributes.active_color
    usable = [
        a
        for a in data.attributes
        if a.data_type in WEIGHTS and a.domain != "EDGE" and a.name[0] != "."
    ]
    if attribute is None or attribute.name not in {a.name for a in usable}:
        known = [g.name for g in obj.vertex_groups] + [a.name for a in usable]
        what = f'no layer "{layer}" of weights' if layer else "no painted layer"
        there = ", ".join(known) or "none"
        raise SpecError(where, f'"{obj.name}" has {what}; its layers: {there}')
    values = read(data, attribute.name, attribute.data_type, attribute.domain).astype(np.float64)
    return attribute.domain, values[:, :3] @ LUMINANCE if values.ndim == 2 else values
