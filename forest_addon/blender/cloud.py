"""A point cloud as a Blender object: vertices with named attributes, shown as points by a modifier."""

from __future__ import annotations

import bpy
import numpy as np

from ..growth.trimesh import GROUND, LEAF, WOOD
from ..sensing.cloud import Cloud
from .materials import coloured_points

COLOUR_OF_ORGAN = {
    WOOD: (0.30, 0.17, 0.08, 1.0),
    LEAF: (0.08, 0.42, 0.06, 1.0),
    GROUND: (0.45, 0.40, 0.30, 1.0),
}
GROUP = "Forest points"
CLOUD_KEY = "forest_cloud"


def show_cloud(home: bpy.types.Collection, name: str, cloud: Cloud) -> bpy.types.Object:
    """Put a sensor's cloud into a collection, in place of that sensor's last one."""
    data = bpy.data.meshes.new(name)
    data.vertices.add(len(cloud.position))
    _fill(data, "position", "FLOAT_VECTOR", cloud.position.astype(np.float32), "vector")
    _fill(data, "distance", "FLOAT", cloud.returns.distance.astype(np.float32))
    _fill(data, "intensity", "FLOAT", cloud.intensity.astype(np.float32))
    for label in ("tree", "species", "organ", "leaf"):
        _fill(data, label, "INT", getattr(cloud.returns, label).astype(np.int32))
    colour = np.full((128, 4), 0.5, dtype=np.float32)
    for organ, shade in COLOUR_OF_ORGAN.items():
        colour[organ] = shade
    _fill(data, "colour", "FLOAT_COLOR", colour[cloud.returns.organ], "color")
    data.update()

    for old in [thing for thing in home.objects if thing.get(CLOUD_KEY) == name]:
        mesh = old.data
        bpy.data.objects.remove(old)
        if not mesh.users:
            bpy.data.meshes.remove(mesh)
    thing = bpy.data.objects.new(f"{name} points", data)
    thing[CLOUD_KEY] = name
    data.materials.append(bpy.data.materials.get(GROUP) or coloured_points(GROUP))
    modifier = thing.modifiers.new("Points", "NODES")
    modifier.node_group = bpy.data.node_groups.get(GROUP) or _points_group()
    thing.hide_render = True
    home.objects.link(thing)
    return thing


def _points_group() -> bpy.types.NodeTree:
    """Mesh vertices to points of 15 mm; the radius and the material can be edited by hand."""
    group = bpy.data.node_groups.new(GROUP, "GeometryNodeTree")
    group.is_modifier = True
    group.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    radius = group.interface.new_socket("Radius", in_out="INPUT", socket_type="NodeSocketFloat")
    radius.subtype = "DISTANCE"
    radius.default_value = 0.015
    radius.min_value = 0.0
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    start, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    points = group.nodes.new("GeometryNodeMeshToPoints")
    coat = group.nodes.new("GeometryNodeSetMaterial")
    coat.inputs["Material"].default_value = bpy.data.materials[GROUP]
    for column, node in enumerate((start, points, coat, end)):
        node.location = (200 * column, 0)
    group.links.new(start.outputs["Geometry"], points.inputs["Mesh"])
    group.links.new(start.outputs["Radius"], points.inputs["Radius"])
    group.links.new(points.outputs["Points"], coat.inputs["Geometry"])
    group.links.new(coat.outputs["Geometry"], end.inputs["Geometry"])
    return group


def _fill(
    data: bpy.types.Mesh, name: str, kind: str, values: np.ndarray, key: str = "value"
) -> None:
    attribute = data.attributes.get(name) or data.attributes.new(name, kind, "POINT")
    attribute.data.foreach_set(key, np.ascontiguousarray(values).ravel())
