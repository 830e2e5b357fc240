"""Trees of the forest that are dragged from the Asset Browser: planted where they are dropped.

Blender sets such a copy down as an object, by an operator of its own that no class of ours stands behind.
What that operator has just set down is seen here, and planted as *Plant Copies* does, with *Grow at Once*;
without, it stays an object until that button is pressed. So does a tree of another file, unless it is the
same as one of this forest: the message says what to do.
"""

from __future__ import annotations

from typing import ClassVar

import bpy
from bpy_extras.view3d_utils import (
    location_3d_to_region_2d,
    region_2d_to_origin_3d,
    region_2d_to_vector_3d,
)
from mathutils import Vector

from ...blender.scene.layout import VARIANTS
from ...blender.scene.ours import ROLE_KEY, SHAPE_KEY, by_role
from ...blender.scene.standings import ASSET_KEY
from ..shell.running import obstacle
from ..shell.views import region_below
from ..shell.words import say
from .hand_edits import copy_of, variant_copied
from .planting import ground_below

LOCAL = "OBJECT_OT_add_named"  # what Blender does when an asset of this file is dropped
FOREIGN = ("OBJECT_OT_transform_to_mouse", "OBJECT_OT_collection_external_asset_drop")
SOON = 0.01  # s: not within the update that tells of it

_known = 0  # the session_uid of the tree that was dropped last


class FOREST_OT_plant_dropped(bpy.types.Operator):
    """Plant the tree that was dropped last, below the mouse

    Only an operator is told where the mouse is, by the event that it is invoked with.
    """

    bl_idname = "forest.plant_dropped"
    bl_label = "Plant Dropped Tree"
    bl_options: ClassVar[set[str]] = {"INTERNAL"}

    foreign: bpy.props.BoolProperty(
        name="Of Another File",
        description="The tree came from another file or library",
        options={"HIDDEN", "SKIP_SAVE"},
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        thing = context.view_layer.objects.active
        if thing is None or obstacle(context):
            return {"CANCELLED"}
        if self.foreign and not is_of_forest(thing, context.scene):
            told = say(
                "{name} is a tree of another file and stays an object, which sensors meet as it is; "
                "add its species to the forest to plant it",
                name=thing.name,
            )
            self.report({"INFO"}, told)
            return {"FINISHED"}
        area, region = region_below(context.window, event.mouse_x, event.mouse_y)
        with context.temp_override(area=area, region=region, selected_objects=[thing]):
            if region is not None:
                _stand_below(bpy.context, thing)
                context.view_layer.update()
            bpy.ops.forest.adopt_trees()
        return {"FINISHED"}


@bpy.app.handlers.persistent
def hear(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Have a tree planted if it is what Blender did last."""
    global _known
    done = bpy.context.window_manager.operators
    thing = depsgraph.view_layer.objects.active
    if not len(done) or thing is None or thing.session_uid == _known:
        return
    foreign = done[-1].bl_idname in FOREIGN
    if not foreign and done[-1].bl_idname != LOCAL:
        return
    is_tree = is_foreign_tree(thing) if foreign else copy_of(thing) is not None
    if not is_tree or not (foreign or scene.forest_sensing.plant_grows):
        return
    _known = thing.session_uid
    bpy.app.timers.register(plant, first_interval=SOON)


def plant() -> None:
    """Plant the tree that was dropped last, and grow the forest."""
    for window in bpy.context.window_manager.windows:
        thing = window.view_layer.objects.active
        if thing is None or thing.session_uid != _known:
            continue
        done = bpy.context.window_manager.operators
        foreign = bool(len(done)) and done[-1].bl_idname in FOREIGN
        with bpy.context.temp_override(window=window):
            bpy.ops.forest.plant_dropped("INVOKE_DEFAULT", foreign=foreign)
        return


def is_foreign_tree(thing: bpy.types.Object) -> bool:
    """Return whether an object from another file is a tree of ours: a variant of a forest, or of a library of
    species."""
    home = thing.instance_collection
    meshes = [t.data for t in home.objects] if home is not None else [thing.data]
    said = [*(mesh for mesh in meshes if mesh is not None), thing]
    return any(ASSET_KEY in block for block in said) or _role(thing).startswith(f"{VARIANTS}/")


def is_of_forest(thing: bpy.types.Object, scene: bpy.types.Scene) -> bool:
    """Return whether a tree from another file is the same as the variant of its name in this forest."""
    known = variant_copied(thing)
    mesh = by_role(bpy.data.meshes).get(_role(thing)) if known is not None else None
    own = scene.forest_sensing.plant_grows and thing.data is not None
    return bool(own and mesh and mesh.get(SHAPE_KEY, "") == thing.data.get(SHAPE_KEY))


def _role(thing: bpy.types.Object) -> str:
    return str(thing.get(ROLE_KEY, ""))


def _stand_below(context: bpy.types.Context, thing: bpy.types.Object) -> None:
    """Stand a tree upright where the mouse pointed at the ground.

    Blender sets the middle of the box's bottom on the first face below the mouse, which may be of a crown.
    """
    low, high = thing.bound_box[0], thing.bound_box[6]
    bottom = Vector(((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]))
    region, view = context.region, context.region.data
    mouse = location_3d_to_region_2d(region, view, thing.matrix_world @ bottom)
    if mouse is None:
        return
    begin = region_2d_to_origin_3d(region, view, mouse)
    place = ground_below(context, begin, region_2d_to_vector_3d(region, view, mouse))
    if place is not None:
        thing.rotation_euler[:2] = 0.0, 0.0
        thing.location = place


CLASSES = (FOREST_OT_plant_dropped,)
WINDOW_HANDLERS = (("depsgraph_update_post", hear),)
