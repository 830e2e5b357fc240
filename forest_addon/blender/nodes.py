"""The node group that puts a tree on every point: which variant, how turned, how large, its points say.

It is made once a file and then left alone, so whatever is changed in it by hand stays. A modifier hands it
the points and the collection of variants; its objects count in the order of their names.
"""

from __future__ import annotations

from typing import Any

import bpy

INSTANCER = "Forest Instancer"
LAYOUT_KEY, LAYOUT = "forest_layout", 1  # a group with other sockets than these gets another number
POINTS, VARIANTS, TREES = "Points", "Variants", "Trees"
VARIANT, ROTATION, SCALE = "variant", "rotation", "scale"  # attributes of the points


def add_instancer(thing: bpy.types.Object, variants: bpy.types.Collection) -> bpy.types.Modifier:
    """Give an object the modifier that puts trees on its points."""
    modifier = thing.modifiers.new(INSTANCER, "NODES")
    modifier.node_group = instancer_group()
    set_input(modifier, VARIANTS, variants)
    return modifier


def instancer_group() -> bpy.types.NodeTree:
    """The file's node group, as it is; made where there is none."""
    for group in bpy.data.node_groups:
        if group.get(LAYOUT_KEY) == LAYOUT and group.library is None:
            return group
    return _make_instancer()


def set_input(modifier: bpy.types.Modifier, socket: str, value: Any) -> None:
    """Set an input of a geometry-nodes modifier by the name of its socket."""
    items = modifier.node_group.interface.items_tree
    (item,) = (i for i in items if i.name == socket and getattr(i, "in_out", "") == "INPUT")
    if hasattr(modifier, "properties"):  # from Blender 5.2 on
        getattr(modifier.properties.inputs, item.identifier).value = value
    else:
        modifier[item.identifier] = value


def _make_instancer() -> bpy.types.NodeTree:
    group = bpy.data.node_groups.new(INSTANCER, "GeometryNodeTree")
    group[LAYOUT_KEY] = LAYOUT
    group.is_modifier = True
    group.description = "Puts a tree on every point"
    for name, way, kind, told in (
        (POINTS, "INPUT", "NodeSocketGeometry", "A vertex or point for every tree"),
        (VARIANTS, "INPUT", "NodeSocketCollection", "Trees to choose from, counted by name"),
        (TREES, "OUTPUT", "NodeSocketGeometry", "An instance for every point, with its attributes"),
    ):
        group.interface.new_socket(name, description=told, in_out=way, socket_type=kind)

    def node(kind: str, label: str, x: float, y: float) -> bpy.types.Node:
        made = group.nodes.new(kind)
        made.label, made.location = label, (x, y)
        return made

    def attribute(name: str, kind: str, label: str, y: float) -> bpy.types.NodeSocket:
        made = node("GeometryNodeInputNamedAttribute", label, 0, y)
        made.data_type, made.parent = kind, frame
        made.inputs["Name"].default_value = name
        return made.outputs["Attribute"]

    frame = node("NodeFrame", "What each point says", 0, 0)
    start, end = node("NodeGroupInput", "", -240, 160), node("NodeGroupOutput", "", 740, 160)
    library = node("GeometryNodeCollectionInfo", "Variants by number", 0, 60)
    library.inputs["Separate Children"].default_value = True
    library.inputs["Reset Children"].default_value = True
    upright = node("ShaderNodeCombineXYZ", "About the vertical", 240, -280)
    place = node("GeometryNodeInstanceOnPoints", "A tree on every point", 500, 160)
    place.inputs["Pick Instance"].default_value = True

    link = group.links.new
    link(start.outputs[POINTS], place.inputs["Points"])
    link(start.outputs[VARIANTS], library.inputs["Collection"])
    link(library.outputs["Instances"], place.inputs["Instance"])
    link(attribute(VARIANT, "INT", "Variant", -120), place.inputs["Instance Index"])
    link(attribute(ROTATION, "FLOAT", "Turn, radians", -280), upright.inputs["Z"])
    link(upright.outputs["Vector"], place.inputs["Rotation"])
    link(attribute(SCALE, "FLOAT", "Size factor", -440), place.inputs["Scale"])
    link(place.outputs["Instances"], end.inputs[TREES])
    return group
