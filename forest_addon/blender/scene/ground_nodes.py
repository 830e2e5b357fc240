"""A ground to the horizon that views show around the forest alone, so that *View All* frames the forest.

The ground keeps its vertices. In views a node group pulls those of a flat one, which lie beyond the field,
to a little outside of it; renders show all of it, and whoever measures reads within ``nodes.in_full``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ... import spec
from .layout import GROUND_NAME, find_part, is_local
from .nodes import VIEW_KEY, input_of, set_input

if TYPE_CHECKING:
    from ...stand.intensity.terrain import GroundSurface

GROUP = "Forest Sensing Ground"
LOW, HIGH = "Shown From", "Shown To"
FAR = 100.0  # m of margin; a ground that reaches farther is there for a horizon
AROUND = 0.25  # of the field's longer side: what views show around it


def show_near(thing: bpy.types.Object, field: spec.Forest, terrain: GroundSurface) -> None:
    """Have views show a far, flat ground around the field alone.

    A modifier that the user has taken away does not come back.
    """
    modifier = next((m for m in thing.modifiers if _is_ours(m)), None)
    far = terrain.triangles() is None and field.margin > FAR
    if modifier is None and (not far or thing.get(VIEW_KEY)):
        return
    if not far:
        thing.modifiers.remove(modifier)
        del thing[VIEW_KEY]
        return
    if modifier is None:
        modifier = thing.modifiers.new(GROUP, "NODES")
        modifier.node_group = _group()
        thing[VIEW_KEY] = True
    for name, way, extent in ((LOW, -1.0, (0.0, 0.0)), (HIGH, 1.0, field.size)):
        corner = [o + e + way * around(field) for o, e in zip(field.origin, extent, strict=True)]
        set_input(modifier, name, (*corner, 0.0))


def around(field: spec.Forest) -> float:
    """Metres of flat ground that views show around a field."""
    return min(field.margin, AROUND * max(field.size)) if field.margin > FAR else field.margin


def shown_corners(scene: bpy.types.Scene) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """The lower and upper corner, x and y, of the ground that views show; None where they show all."""
    home = find_part(scene, GROUND_NAME)
    for thing in home.objects if home is not None else ():
        modifier = next((m for m in thing.modifiers if m.type == "NODES" and _is_ours(m)), None)
        if modifier is not None and modifier.show_viewport:
            low, high = (tuple(input_of(modifier, name)[:2]) for name in (LOW, HIGH))
            return low, high
    return None


def _is_ours(modifier: bpy.types.Modifier) -> bool:
    group = modifier.node_group if modifier.type == "NODES" else None
    return group is not None and VIEW_KEY in group


def _group() -> bpy.types.NodeTree:
    """The file's node group, as it is; made where there is none."""
    known = (g for g in bpy.data.node_groups if VIEW_KEY in g and is_local(g))
    return next(known, None) or _make()


def _make() -> bpy.types.NodeTree:
    group = bpy.data.node_groups.new(GROUP, "GeometryNodeTree")
    group[VIEW_KEY] = True
    group.is_modifier = True
    group.description = "Shows the ground around the forest alone in views; renders show all of it"
    for name, way, kind, told in (
        ("Ground", "INPUT", "NodeSocketGeometry", "Flat, as far as the horizon"),
        (LOW, "INPUT", "NodeSocketVector", "Corner of what views show, height aside"),
        (HIGH, "INPUT", "NodeSocketVector", "The corner across"),
        ("Ground", "OUTPUT", "NodeSocketGeometry", "In views the part between these corners"),
    ):
        made = group.interface.new_socket(name, description=told, in_out=way, socket_type=kind)
        if kind == "NodeSocketVector":
            made.subtype = "TRANSLATION"

    def node(kind: str, label: str, x: float, y: float) -> bpy.types.Node:
        made = group.nodes.new(kind)
        made.label, made.location = label, (x, y)
        return made

    link = group.links.new
    start, end = node("NodeGroupInput", "", -260, 160), node("NodeGroupOutput", "", 980, 160)
    place = node("GeometryNodeInputPosition", "Where it is", -260, -160)
    low = node("ShaderNodeVectorMath", "Not before", 0, 0)
    high = node("ShaderNodeVectorMath", "Not behind", 180, 0)
    low.operation, high.operation = "MAXIMUM", "MINIMUM"
    within = node("ShaderNodeSeparateXYZ", "Within", 360, 0)
    own = node("ShaderNodeSeparateXYZ", "Height", 360, -160)
    moved = node("ShaderNodeCombineXYZ", "At its height", 560, 0)
    viewed = node("GeometryNodeIsViewport", "In a view", 560, 320)
    put = node("GeometryNodeSetPosition", "Pulled to the edge", 760, 160)
    link(place.outputs[0], low.inputs[0])
    link(start.outputs[LOW], low.inputs[1])
    link(low.outputs[0], high.inputs[0])
    link(start.outputs[HIGH], high.inputs[1])
    link(high.outputs[0], within.inputs[0])
    link(place.outputs[0], own.inputs[0])
    link(within.outputs["X"], moved.inputs["X"])
    link(within.outputs["Y"], moved.inputs["Y"])
    link(own.outputs["Z"], moved.inputs["Z"])
    link(start.outputs["Ground"], put.inputs["Geometry"])
    link(viewed.outputs[0], put.inputs["Selection"])
    link(moved.outputs[0], put.inputs["Position"])
    link(put.outputs[0], end.inputs["Ground"])
    return group
