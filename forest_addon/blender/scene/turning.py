"""Transforms that geometry nodes give the points of a forest, as Blender evaluates them, to the bit.

Places, turns and sizes go in, float32 matrices as sensors read them come out. A forest that is flown through
for one episode need not stand in the scene for that: the points are evaluated in a scene of their own, which
is gone afterwards, with one empty thing in place of all variants.
"""

from __future__ import annotations

import bpy
import numpy as np

from .instances import points_mesh, read_points
from .nodes import give_instancer, instancer_group

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
