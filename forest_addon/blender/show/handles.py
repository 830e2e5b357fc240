"""Hills of an intensity as objects: an Empty lies where a hill is and reaches where that has fallen to 1/e.

A handle's place and scale along the world's x and y are centre and widths of its hill, whatever moves it:
a hand, keys, a parent. Height and turn mean nothing and are locked.
"""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix, Vector

HANDLE_KEY = (
    "forest_handle"  # custom property of a handle: its own name; a copy still has the other's
)
FLAT = 1e-3  # scale along z of what is drawn as a circle with a cross
LEAST = 1e-3  # m, the narrowest hill that a handle makes


def new_handle(name: str, home: bpy.types.Collection, height: float) -> bpy.types.Object:
    """A new handle in a collection, at a height, not yet placed."""
    thing = bpy.data.objects.new(name, None)
    thing.empty_display_type = "SPHERE"  # seen from above; Blender's circle stands upright
    thing.empty_display_size = 1.0
    thing.show_in_front = thing.show_name = True
    thing.location.z, thing.scale.z = height, FLAT
    thing.lock_location[2] = thing.lock_scale[2] = True
    thing.lock_rotation = (True, True, True)
    home.objects.link(thing)
    sign(thing)
    return thing


def sign(thing: bpy.types.Object) -> None:
    """Note that this object is a handle, under the name it has now."""
    if thing.get(HANDLE_KEY) != thing.name:
        thing[HANDLE_KEY] = thing.name


def place(thing: bpy.types.Object, centre: tuple[float, ...], width: tuple[float, ...]) -> None:
    """Move and scale a handle to where a hill is, centre (2,) and width (2,) in metres."""
    if thing.parent is None:
        thing.location[:2], thing.scale[:2] = centre, width
        return
    was = thing.matrix_world
    where = Vector((*centre, was.translation.z))
    thing.matrix_world = Matrix.LocRotScale(where, None, Vector((*width, was.to_scale().z)))


def shape_of(matrix: Matrix) -> tuple[tuple[float, float], tuple[float, float]]:
    """Centre and width of the hill whose handle stands so in the world."""
    world = np.array(matrix, dtype=np.float64)
    x, y = world[:2, 3].tolist()
    wide, long = np.maximum(LEAST, np.hypot(world[:2, 0], world[:2, 1])).tolist()
    return (x, y), (wide, long)
