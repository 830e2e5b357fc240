"""Painting where trees stand: a button that lays a canvas over the field and gives the user the brush.

While it is painted the canvas is drawn before the trees, which views show through it. However the user leaves
Weight Paint mode, by the button or Blender's own ways, it is put away then.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ... import spec
from ...blender.scene.layout import INTENSITY, part
from ...blender.show import intensity
from ..settings import exchange
from ..shell.running import Button
from ..shell.views import chosen_planting, see_through, select
from ..shell.words import free_name, say

NAME = "Canvas"
PAINTING = "PAINT_WEIGHT"

_in_hand = ""  # the canvas that is being painted


@bpy.app.handlers.persistent
def _put_away(*_: object) -> None:
    """Put the canvas away when it is no longer painted."""
    global _in_hand
    if not _in_hand or bpy.context.mode == PAINTING:
        return
    thing = bpy.data.objects.get(_in_hand)
    _in_hand = ""
    see_through(False)
    if thing is not None and intensity.CANVAS_KEY in thing:  # in another file it may be anything
        intensity.show_canvas(thing, painted=False)


class FOREST_OT_paint(Button, bpy.types.Operator):
    """Paint where this species stands, on the ground; press again when it is done"""

    bl_idname = "forest.paint"
    bl_label = "Paint"

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        if context.mode not in ("OBJECT", PAINTING):
            return say("Leave this mode first: painting begins in Object Mode")
        reason = super().obstacle(context)
        if not reason and chosen_planting(context.scene.forest_sensing) is None:
            reason = say("There is no planting yet. Add one to the list")
        return reason

    def act(self, context: bpy.types.Context) -> str:
        global _in_hand
        if context.mode == PAINTING:
            bpy.ops.object.mode_set(mode="OBJECT")
            _put_away()
            return ""
        thing = self._canvas(context)
        planting = chosen_planting(context.scene.forest_sensing)
        layer = intensity.layer_of(thing, _layer_name(planting, thing))
        planting.painted = f"{thing.name}:{layer.name}"
        select(context, thing)
        bpy.ops.object.mode_set(mode="WEIGHT_PAINT")
        intensity.show_canvas(thing, painted=True)
        _in_hand = thing.name
        see_through(True)
        return say("Paint where trees stand; Done ends it, Grow Forest plants them")

    def _canvas(self, context: bpy.types.Context) -> bpy.types.Object:
        """The scene's canvas, laid over the field as it is now."""
        from ...blender.site import with_objects
        from ...site import ForestSite
        from ...stand.files import read_inputs

        props = context.scene.forest_sensing
        folder = Path(bpy.path.abspath(props.folder))
        settings = spec.Scene(
            forest=exchange.read(props.forest, spec.Forest, "forest"),
            offset=exchange.parsed("offset", props.offset) or (0.0, 0.0, 0.0),
            crs=props.crs,
        )
        site = ForestSite(settings, folder, inputs=read_inputs(settings, folder))
        site = with_objects(site, context.evaluated_depsgraph_get())
        home = part(context.scene, INTENSITY)
        known = (t for t in home.objects if intensity.CANVAS_KEY in t and t.type == "MESH")
        thing = next(known, None) or intensity.new_canvas(NAME, home)
        intensity.lay(thing, settings.forest, site.ground)
        return thing


def _layer_name(planting: Any, thing: bpy.types.Object) -> str:
    """The layer that the planting has on the canvas, or the name for one of its own."""
    if planting.painted_pointer == thing and planting.painted_layer in thing.vertex_groups:
        return str(planting.painted_layer)
    stem = Path(planting.species).stem or "trees"
    return free_name(stem, " ", "", thing.vertex_groups.__contains__)


HANDLERS = (("depsgraph_update_post", _put_away),)
