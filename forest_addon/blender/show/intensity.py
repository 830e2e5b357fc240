"""Intensity to be edited in the view: hills as Empties, and the mesh that weights are painted on.

An Empty lies where a hill is and reaches where that has fallen to 1/e: its place and scale along the
world's x and y are centre and widths of its hill, whatever moves it: a hand, keys, a parent. Height and
turn mean nothing and are locked. Weights are painted on a grid over the field, at the height of the
ground.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ... import spec
from ..scene.attributes import places_of, plain_mesh, write
from ..scene.instances import IGNORED_KEY

if TYPE_CHECKING:
    from ...stand.intensity.surface import GroundSurface

HANDLE_KEY = (
    "forest_handle"  # custom property of a handle: its own name; a copy still has the other's
)
FLAT = 1e-3  # scale along z of what is drawn as a circle with a cross
LEAST = 1e-3  # m, the narrowest hill that a handle makes


def new_handle(name: str, home: bpy.types.Collection, height: float) -> bpy.types.Object:
    """A new handle in a collection, at a height, not yet placed."""
    obj = bpy.data.objects.new(name, None)
    obj.empty_display_type = "SPHERE"  # seen from above; Blender's circle stands upright
    obj.empty_display_size = 1.0
    obj.show_in_front = obj.show_name = True
    obj.location.z, obj.scale.z = height, FLAT
    obj.lock_location[2] = obj.lock_scale[2] = True
    obj.lock_rotation = (True, True, True)
    home.objects.link(obj)
    sign(obj)
    return obj


def sign(obj: bpy.types.Object) -> None:
    """Note that this object is a handle, under the name it has now."""
    if obj.get(HANDLE_KEY) != obj.name:
        obj[HANDLE_KEY] = obj.name


def place(obj: bpy.types.Object, centre: tuple[float, ...], width: tuple[float, ...]) -> None:
    """Move and scale a handle to where a hill is, centre (2,) and width (2,) in metres."""
    if obj.parent is None:
        obj.location[:2], obj.scale[:2] = centre, width
        return
    was = obj.matrix_world
    where = Vector((*centre, was.translation.z))
    obj.matrix_world = Matrix.LocRotScale(where, None, Vector((*width, was.to_scale().z)))


def shape_of(matrix: Matrix) -> tuple[tuple[float, float], tuple[float, float]]:
    """Centre and width of the hill whose handle stands so in the world."""
    world = np.array(matrix, dtype=np.float64)
    x, y = world[:2, 3].tolist()
    wide, long = np.maximum(LEAST, np.hypot(world[:2, 0], world[:2, 1])).tolist()
    return (x, y), (wide, long)


CANVAS_KEY = "forest_canvas"  # custom property of a canvas
CELLS = 100  # along each side: a brush is many of them wide, and a stroke is light
LIFT = 0.02  # m above the ground, so that the two do not flicker


def new_canvas(name: str, home: bpy.types.Collection) -> bpy.types.Object:
    """A new canvas in a collection, not yet laid."""
    side = np.linspace(0.0, 1.0, CELLS + 1)
    x, y = (part.ravel() for part in np.meshgrid(side, side, indexing="ij"))
    corner = (np.arange(CELLS)[:, None] * (CELLS + 1) + np.arange(CELLS)).ravel()
    quads = np.stack([corner, corner + CELLS + 1, corner + CELLS + 2, corner + 1], axis=1)
    obj = bpy.data.objects.new(name, plain_mesh(name, np.column_stack([x, y, 0 * x]), quads))
    obj[CANVAS_KEY] = obj[IGNORED_KEY] = True
    obj.hide_render = True
    home.objects.link(obj)
    return obj


def lay(obj: bpy.types.Object, field: spec.Forest, terrain: GroundSurface) -> None:
    """Stretch a canvas over the field, at the terrain's height; where that has none, at its base."""
    obj.matrix_world = Matrix()
    flat = places_of(obj.data)[:, :2]
    low, high = flat.min(axis=0), flat.max(axis=0)
    places = np.array(field.origin) + (flat - low) / (high - low) * np.array(field.size)
    height = terrain.height(places)
    height = np.where(np.isfinite(height), height, field.terrain.base) + LIFT
    write(obj.data, "position", np.column_stack([places, height]), "FLOAT_VECTOR")
    obj.data.update()


def show_canvas(obj: bpy.types.Object, painted: bool) -> None:
    """Show a canvas before the trees that stand on it, or leave only its outline in sight."""
    obj.display_type, obj.show_in_front = "TEXTURED" if painted else "BOUNDS", painted


def layer_of(obj: bpy.types.Object, name: str) -> bpy.types.VertexGroup:
    """The layer of this name, made where it is missing, as the one that is painted."""
    group = obj.vertex_groups.get(name) or obj.vertex_groups.new(name=name)
    obj.vertex_groups.active = group
    return group
