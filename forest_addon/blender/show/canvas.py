"""The mesh that weights are painted on: a grid over the field, at the height of the ground.

It is stretched over the field anew whenever painting begins, so that what was painted goes with the field;
not by a scale, which would make the brush an ellipse. Sensors and renders do not see it.
"""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix

from ... import spec
from ...stand.intensity.terrain import GroundSurface
from ..scene.standings import IGNORED_KEY

CANVAS_KEY = "forest_canvas"  # custom property of a canvas
CELLS = 100  # along each side: a brush is many of them wide, and a stroke is light
LIFT = 0.02  # m above the ground, so that the two do not flicker


def find_canvas(home: bpy.types.Collection) -> bpy.types.Object | None:
    """The canvas in a collection, None where there is none."""
    return next((t for t in home.objects if CANVAS_KEY in t and t.type == "MESH"), None)


def new_canvas(name: str, home: bpy.types.Collection) -> bpy.types.Object:
    """A new canvas in a collection, not yet laid."""
    side = np.linspace(0.0, 1.0, CELLS + 1)
    x, y = (part.ravel() for part in np.meshgrid(side, side, indexing="ij"))
    corner = (np.arange(CELLS)[:, None] * (CELLS + 1) + np.arange(CELLS)).ravel()
    quads = np.stack([corner, corner + CELLS + 1, corner + CELLS + 2, corner + 1], axis=1)
    data = bpy.data.meshes.new(name)
    data.from_pydata(np.column_stack([x, y, 0 * x]).tolist(), [], quads.tolist())
    thing = bpy.data.objects.new(name, data)
    thing[CANVAS_KEY] = thing[IGNORED_KEY] = True
    thing.hide_render = True
    home.objects.link(thing)
    return thing


def lay(thing: bpy.types.Object, field: spec.Forest, terrain: GroundSurface) -> None:
    """Stretch a canvas over the field, at the terrain's height; where that has none, at its base."""
    thing.matrix_world = Matrix()
    position = thing.data.attributes["position"].data
    vertices = np.empty((len(position), 3), dtype=np.float32)
    position.foreach_get("vector", vertices.ravel())
    low, high = vertices[:, :2].min(axis=0), vertices[:, :2].max(axis=0)
    places = np.array(field.origin) + (vertices[:, :2] - low) / (high - low) * np.array(field.size)
    height = terrain.height(places)
    height = np.where(np.isfinite(height), height, field.terrain.base) + LIFT
    position.foreach_set("vector", np.column_stack([places, height]).astype(np.float32).ravel())
    thing.data.update()


def take_up(thing: bpy.types.Object) -> None:
    """Show a canvas before the trees that stand on it."""
    thing.display_type, thing.show_in_front = "TEXTURED", True


def put_away(thing: bpy.types.Object) -> None:
    """Leave of a canvas only its outline in sight."""
    thing.display_type, thing.show_in_front = "BOUNDS", False


def layer_of(thing: bpy.types.Object, name: str) -> bpy.types.VertexGroup:
    """The layer of this name, made where it is missing, as the one that is painted."""
    group = thing.vertex_groups.get(name) or thing.vertex_groups.new(name=name)
    thing.vertex_groups.active = group
    return group
