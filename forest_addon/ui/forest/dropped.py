"""Trees of the forest that are dragged from the Asset Browser: planted where they are dropped.

Blender sets such a copy down as an object, by an operator of its own that no class of ours stands behind.
What that operator has just set down is seen here, and planted as *Plant Copies* does, with *Grow at Once*;
without, it stays an object until that button is pressed.
"""

from __future__ import annotations

import bpy
from bpy_extras.view3d_utils import (
    location_3d_to_region_2d,
    region_2d_to_origin_3d,
    region_2d_to_vector_3d,
)
from mathutils import Vector

from ..shell.running import obstacle
from ..shell.views import region_of
from .hand_edits import copy_of
from .planting import ground_below

DROPS = ("OBJECT_OT_add_named",)  # what Blender does when an asset of this file is dropped
SOON = 0.01  # s: not within the update that tells of it

_known = 0  # the session_uid of the tree that was dropped last


def register() -> None:
    """Hear of what is dropped, where there is a window."""
    if not bpy.app.background:
        bpy.app.handlers.depsgraph_update_post.append(hear)


def unregister() -> None:
    """Hear no longer."""
    if hear in bpy.app.handlers.depsgraph_update_post:
        bpy.app.handlers.depsgraph_update_post.remove(hear)


@bpy.app.handlers.persistent
def hear(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Have a tree planted if it is what Blender did last."""
    global _known
    done = bpy.context.window_manager.operators
    thing = depsgraph.view_layer.objects.active
    if not len(done) or done[-1].bl_idname not in DROPS or thing is None:
        return
    if (
        thing.session_uid == _known
        or not scene.forest_sensing.plant_grows
        or copy_of(thing) is None
    ):
        return
    _known = thing.session_uid
    bpy.app.timers.register(plant, first_interval=SOON)


def plant() -> None:
    """Plant the tree that was dropped last, and grow the forest."""
    for window in bpy.context.window_manager.windows:
        thing = window.view_layer.objects.active
        if thing is None or thing.session_uid != _known or copy_of(thing) is None:
            continue
        area = next((a for a in window.screen.areas if a.type == "VIEW_3D"), None)
        region = None if area is None else region_of(area, "WINDOW")
        with bpy.context.temp_override(
            window=window, area=area, region=region, selected_objects=[thing]
        ):
            if not obstacle(bpy.context):
                if area is not None:
                    _stand_below(bpy.context, thing)
                    window.view_layer.update()
                bpy.ops.forest.adopt_trees()
        return


def _stand_below(context: bpy.types.Context, thing: bpy.types.Object) -> None:
    """Stand a tree upright where the mouse pointed at the ground.

    Blender sets the middle of the box's bottom on the first face below the mouse, which may be of a crown.
    """
    low, high = thing.bound_box[0], thing.bound_box[6]
    bottom = Vector(((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]))
    region, view = context.region, context.area.spaces.active.region_3d
    mouse = location_3d_to_region_2d(region, view, thing.matrix_world @ bottom)
    if mouse is None:
        return
    begin = region_2d_to_origin_3d(region, view, mouse)
    place = ground_below(context, begin, region_2d_to_vector_3d(region, view, mouse))
    if place is not None:
        thing.rotation_euler[:2] = 0.0, 0.0
        thing.location = place
