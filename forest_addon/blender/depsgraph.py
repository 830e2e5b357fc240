"""The evaluated scene to arrays: every instance of every object that evaluates to faces.

Modifiers, collection instances, geometry nodes, curves and text are all seen as Blender shows them.
Meshes that several instances share are read once. Tree and species numbers are custom properties of
the objects, or attributes of the points that geometry nodes put instances on.
"""

from __future__ import annotations

import bpy
import numpy as np

from ..growth.leaves import separate_leaves
from ..growth.trimesh import TriMesh
from ..sensing.geometry import SceneGeometry
from .meshes import from_mesh

TREE_KEY, SPECIES_KEY = "forest_tree", "forest_species"
SOLID_TYPES = {"MESH", "CURVE", "SURFACE", "META", "FONT"}


def read_scene(depsgraph: bpy.types.Depsgraph) -> SceneGeometry:
    """Read what an evaluated depsgraph holds; hidden objects are not in it."""
    number_of: dict[int, int] = {}
    meshes: list[TriMesh] = []
    index, transform, name, tree, species = [], [], [], [], []
    on_points: dict[int, dict[str, list[int]]] = {}
    for instance in depsgraph.object_instances:
        thing = instance.object
        if thing.type not in SOLID_TYPES or not instance.show_self:
            continue
        # Objects without modifiers share their evaluated mesh; a curve's own data is no mesh.
        source = thing.data if thing.type == "MESH" else thing
        key = source.as_pointer()
        if key not in number_of:
            number_of[key] = len(meshes)
            meshes.append(_read_mesh(thing))
        if not len(meshes[number_of[key]].triangles):
            continue
        owner = instance.parent if instance.is_instance and instance.parent else thing
        index.append(number_of[key])
        transform.append([row[:] for row in instance.matrix_world[:3]])
        name.append(owner.name)
        said: dict[str, list[int]] = {}
        if owner is not thing:
            if owner.as_pointer() not in on_points:
                on_points[owner.as_pointer()] = _numbers_on_points(owner)
            said = on_points[owner.as_pointer()]
        place = instance.persistent_id[0]  # of an instance among those of the same points
        for key, numbers in ((TREE_KEY, tree), (SPECIES_KEY, species)):
            if key in said:
                numbers.append(said[key][place])
            else:
                numbers.append(owner.get(key, thing.get(key, -1)))
    return SceneGeometry(
        meshes=tuple(meshes),
        transform=np.array(transform, dtype=np.float64).reshape(-1, 3, 4),
        mesh_index=np.array(index, dtype=np.int64),
        object_name=tuple(name),
        tree=np.array(tree, dtype=np.int64),
        species=np.array(species, dtype=np.int64),
    )


def has_nodes(thing: bpy.types.Object) -> bool:
    """Whether geometry nodes may make instances for an object; asking it costs Blender 4.5 a few bytes."""
    return any(modifier.type == "NODES" for modifier in thing.modifiers)


def _numbers_on_points(owner: bpy.types.Object) -> dict[str, list[int]]:
    """Tree and species numbers of the instances that an evaluated object's nodes make."""
    if not has_nodes(owner):
        return {}
    geometry = owner.evaluated_geometry()  # the points live as long as this does
    points = geometry.instances_pointcloud()
    found = {}
    for key in (TREE_KEY, SPECIES_KEY):
        attribute = points.attributes.get(key) if points is not None else None
        if attribute is not None and attribute.data_type == "INT":
            values = np.empty(len(points.points), dtype=np.int32)
            attribute.data.foreach_get("value", values)
            found[key] = values.tolist()
    return found


def _read_mesh(thing: bpy.types.Object) -> TriMesh:
    if thing.type == "MESH":
        return separate_leaves(from_mesh(thing.data))
    data = thing.to_mesh()
    try:
        return from_mesh(data) if data is not None else from_mesh(bpy.data.meshes.new("empty"))
    finally:
        thing.to_mesh_clear()
