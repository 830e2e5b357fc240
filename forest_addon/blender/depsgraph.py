"""The evaluated scene to arrays: every instance of every object that evaluates to faces.

Modifiers, collection instances, geometry nodes, curves and text are all seen as Blender shows them.
Meshes that several instances share are read once. Tree and species numbers are custom properties of
the objects.
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
        tree.append(owner.get(TREE_KEY, thing.get(TREE_KEY, -1)))
        species.append(owner.get(SPECIES_KEY, thing.get(SPECIES_KEY, -1)))
    return SceneGeometry(
        meshes=tuple(meshes),
        transform=np.array(transform, dtype=np.float64).reshape(-1, 3, 4),
        mesh_index=np.array(index, dtype=np.int64),
        object_name=tuple(name),
        tree=np.array(tree, dtype=np.int64),
        species=np.array(species, dtype=np.int64),
    )


def _read_mesh(thing: bpy.types.Object) -> TriMesh:
    if thing.type == "MESH":
        return separate_leaves(from_mesh(thing.data))
    data = thing.to_mesh()
    try:
        return from_mesh(data) if data is not None else from_mesh(bpy.data.meshes.new("empty"))
    finally:
        thing.to_mesh_clear()
