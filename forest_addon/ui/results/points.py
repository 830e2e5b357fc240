"""Points of results, drawn over the 3D view in the colours that their menu *Colour By* gives.

A point of 15 mm is smaller than a pixel from where one sees a forest, and Solid shading knows one colour for
all. So points are drawn as small squares of so many pixels, in every shading, as long as overlays are shown;
those that are larger than the modifier's radius, as loud ones of an echo are, have as many times more.
What goes to the graphics card is kept until Blender says that a cloud has changed.
"""

from __future__ import annotations

from typing import Any

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix

from ...blender.scene.layout import CLOUD_KEY, RADIUS, RESULTS, find_part
from ...blender.scene.nodes import has_input, input_of

NEARER = 2e-4  # in depth, of the view's: points lie on surfaces, and would be half hidden by them
GAMMA = 1 / 2.2  # colours are linear, the screen's are not

SIZES = 6  # sizes that points of one cloud are drawn in

_batches: dict[int, list[tuple[float, Any]]] = {}  # of a cloud, by its session_uid: size, points


def forget(depsgraph: bpy.types.Depsgraph | None = None) -> None:
    """Make anew what has changed; without a depsgraph, all."""
    if depsgraph is None:
        _batches.clear()
        return
    for update in depsgraph.updates:
        if update.is_updated_geometry and isinstance(update.id, bpy.types.Object):
            _batches.pop(update.id.original.session_uid, None)


def draw(context: bpy.types.Context) -> None:
    """Draw the clouds that the view shows, where that is asked for."""
    if not context.scene.forest_sensing.show_points:
        return
    home = find_part(context.scene, RESULTS)
    clouds = [thing for thing in home.objects if CLOUD_KEY in thing] if home else ()
    shader = None
    for thing in clouds:
        if not thing.visible_get(viewport=context.space_data):
            continue
        shader = shader or gpu.shader.from_builtin("POINT_FLAT_COLOR")
        for size, batch in _batch(thing, shader, context):
            with gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
                gpu.matrix.load_projection_matrix(_nearer() @ gpu.matrix.get_projection_matrix())
                gpu.matrix.multiply_matrix(thing.matrix_world)
                gpu.state.point_size_set(size * context.scene.forest_sensing.point_size)
                batch.draw(shader)


def positions_and_colours(thing: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) places, of the object's own space, and (N, 4) colours for the screen, of an evaluated cloud."""
    geometry = thing.evaluated_geometry()  # its points are gone with it
    points = geometry.pointcloud
    known = points.attributes if points is not None else {}
    if "colour" not in known or "position" not in known:  # its modifier was removed or changed
        return np.empty((0, 3), np.float32), np.empty((0, 4), np.float32)
    count = len(points.points)
    position, colour = np.empty(3 * count, np.float32), np.empty(4 * count, np.float32)
    known["position"].data.foreach_get("vector", position)
    known["colour"].data.foreach_get("color", colour)
    colour = colour.reshape(-1, 4)
    colour[:, :3] **= GAMMA
    return position.reshape(-1, 3), colour


def sizes(thing: bpy.types.Object) -> np.ndarray:
    """(N,) sizes of an evaluated cloud's points, in those of its modifier's radius."""
    geometry = thing.evaluated_geometry()
    points = geometry.pointcloud
    if points is None or "radius" not in points.attributes:
        return np.empty(0, np.float32)
    radius = np.empty(len(points.points), np.float32)
    points.attributes["radius"].data.foreach_get("value", radius)
    modifier = next((m for m in thing.modifiers if has_input(m, RADIUS)), None)
    usual = float(input_of(modifier, RADIUS)) if modifier is not None else 0.0
    return radius / usual if usual > 0 else np.ones_like(radius)


def _batch(
    thing: bpy.types.Object, shader: gpu.types.GPUShader, context: Any
) -> list[tuple[float, Any]]:
    """Points to draw, by their size."""
    key = thing.session_uid
    if key not in _batches:
        evaluated = thing.evaluated_get(context.evaluated_depsgraph_get())
        position, colour = positions_and_colours(evaluated)
        size = sizes(evaluated)
        if len(size) != len(position):
            size = np.ones(len(position), np.float32)
        step = max(float(np.ptp(size)), 1e-3) / SIZES if len(size) else 1.0
        group = np.round(size / step)
        _batches[key] = [
            (
                float(size[group == number].mean()),
                batch_for_shader(
                    shader,
                    "POINTS",
                    {"pos": position[group == number], "color": colour[group == number]},
                ),
            )
            for number in np.unique(group)
        ]
    return _batches[key]


def _nearer() -> Matrix:
    """Return what brings everything a little nearer to the eye, after projection."""
    nearer = Matrix.Identity(4)
    nearer[2][3] = -NEARER
    return nearer
