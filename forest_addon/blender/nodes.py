"""The node group that puts a tree on every point: which variant, how turned, how large, its points say.

It is made once a file and then left alone, so whatever is changed in it by hand stays. A modifier hands it
the points and the collection of variants; its objects count in the order of their names. With *Light View*
a view shows outlines of the trees from a second collection; renders show the trees, and whoever measures
reads within ``in_full``.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy

from .ours import is_ours

INSTANCER = "Forest Instancer"
LAYOUT_KEY, LAYOUT = "forest_layout", 1  # a group with other sockets than these gets another number
POINTS, VARIANTS, OUTLINES, LIGHT, TREES = "Points", "Variants", "Outlines", "Light View", "Trees"
LIGHT_KEY = "forest_light"  # on an object: what *Light View* was set to when it was built last
VARIANT, ROTATION, SCALE = "variant", "rotation", "scale"  # attributes of the points


def give_instancer(
    thing: bpy.types.Object,
    variants: bpy.types.Collection,
    outlines: bpy.types.Collection,
    light: bool,
) -> None:
    """Give an object the modifier that puts trees on its points; what was chosen in an old one stays.

    light : show outlines in views.
    """
    modifier = next((m for m in thing.modifiers if _is_instancer_modifier(m)), None)
    chosen = modifier is not None and is_light(modifier) != thing.get(LIGHT_KEY, False)
    if modifier is None:
        modifier = thing.modifiers.new(INSTANCER, "NODES")
    if modifier.node_group is None:
        modifier.node_group, chosen = instancer_group(), False
    sockets = _sockets(modifier)
    for name, library in ((VARIANTS, variants), (OUTLINES, outlines)):
        if name in sockets and _is_replaceable(_input(modifier, name)[0]):
            set_input(modifier, name, library)
    if LIGHT in sockets and not chosen:
        set_input(modifier, LIGHT, light)
    thing[LIGHT_KEY] = light


def _is_instancer_modifier(modifier: bpy.types.Modifier) -> bool:
    """Whether a modifier is an instancer, or was one before its node group was deleted."""
    if modifier.type != "NODES":
        return False
    group = modifier.node_group
    return _is_instancer(group) or (group is None and modifier.name == INSTANCER)


def _is_replaceable(library: bpy.types.Collection | None) -> bool:
    return library is None or is_ours(library)


@contextmanager
def in_full(depsgraph: bpy.types.Depsgraph) -> Iterator[None]:
    """Evaluate every tree in full in this block, whatever views show; the depsgraph is updated."""
    light = [
        modifier
        for thing in depsgraph.scene.objects
        for modifier in thing.original.modifiers
        if modifier.type == "NODES" and _is_instancer(modifier.node_group) and is_light(modifier)
    ]
    for modifier in light:
        set_input(modifier, LIGHT, False)
    try:
        if light:
            depsgraph.update()
        yield
    finally:
        for modifier in light:
            set_input(modifier, LIGHT, True)
        if light:
            depsgraph.update()


def is_light(modifier: bpy.types.Modifier) -> bool:
    """Whether views show outlines of an instancer's trees."""
    return LIGHT in _sockets(modifier) and bool(_input(modifier, LIGHT)[0])


def instancer_group() -> bpy.types.NodeTree:
    """The file's node group, as it is; made where there is none."""
    groups = (g for g in bpy.data.node_groups if _is_instancer(g) and g.library is None)
    return next(groups, None) or _make_instancer()


def has_input(modifier: bpy.types.Modifier, socket: str) -> bool:
    """Whether it is a geometry-nodes modifier with an input of this name."""
    return modifier.type == "NODES" and socket in _sockets(modifier)


def drawn_input(modifier: bpy.types.Modifier, socket: str) -> tuple[Any, str]:
    """What a layout draws of an input: whose property, and its name."""
    _, holder, key = _input(modifier, socket)
    return (holder, f'["{key}"]') if holder is modifier else (holder, "value")


def set_input(modifier: bpy.types.Modifier, socket: str, value: Any) -> None:
    """Set an input of a geometry-nodes modifier by the name of its socket."""
    _, holder, key = _input(modifier, socket)
    if holder is modifier:
        modifier[key] = value
    else:
        holder.value = value
    modifier.id_data.update_tag()


def choose_input(modifier: bpy.types.Modifier, socket: str, choice: str) -> None:
    """Set a menu among the inputs of a geometry-nodes modifier to the choice of this name."""
    value, holder, key = _input(modifier, socket)
    if holder is not modifier:
        set_input(modifier, socket, choice)
        return
    set_input(
        modifier, socket, next((n for word, n in _menu(modifier, key) if word == choice), value)
    )


def chosen_input(modifier: bpy.types.Modifier, socket: str) -> str:
    """What a menu among the inputs of a geometry-nodes modifier is set to; empty where that is unknown."""
    value, holder, key = _input(modifier, socket)
    if holder is not modifier:
        return str(value)
    return next((word for word, number in _menu(modifier, key) if number == value), "")


def _menu(modifier: bpy.types.Modifier, key: str) -> list[tuple[str, int]]:
    """Choices of a menu and their numbers, before Blender 5.2."""
    items = modifier.id_properties_ui(key).as_dict().get("items", ()) if key in modifier else ()
    return [(item[0], item[-1]) for item in items]


def _is_instancer(group: bpy.types.NodeTree | None) -> bool:
    return group is not None and group.get(LAYOUT_KEY) == LAYOUT


def _input(modifier: bpy.types.Modifier, socket: str) -> tuple[Any, Any, str]:
    """The value of an input, what holds it, and its key there."""
    key = _sockets(modifier)[socket]
    if hasattr(modifier, "properties"):  # from Blender 5.2 on
        holder = getattr(modifier.properties.inputs, key)
        return holder.value, holder, key
    return modifier.get(key), modifier, key


def _sockets(modifier: bpy.types.Modifier) -> dict[str, str]:
    """The keys of a modifier's inputs by their names; none where its node group is gone."""
    items = modifier.node_group.interface.items_tree if modifier.node_group else ()
    return {i.name: i.identifier for i in items if getattr(i, "in_out", "") == "INPUT"}


def _make_instancer() -> bpy.types.NodeTree:
    group = bpy.data.node_groups.new(INSTANCER, "GeometryNodeTree")
    group[LAYOUT_KEY] = LAYOUT
    group.is_modifier = True
    group.description = "Puts a tree on every point"
    for name, way, kind, told in (
        (POINTS, "INPUT", "NodeSocketGeometry", "A vertex or point for every tree"),
        (VARIANTS, "INPUT", "NodeSocketCollection", "Trees to choose from, counted by name"),
        (OUTLINES, "INPUT", "NodeSocketCollection", "Their outlines, in the same order"),
        (LIGHT, "INPUT", "NodeSocketBool", "Show outlines in views; renders and sensors see trees"),
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

    def library(socket: str, y: float) -> bpy.types.NodeSocket:
        made = node("GeometryNodeCollectionInfo", f"{socket} by number", 0, y)
        made.inputs["Separate Children"].default_value = True
        made.inputs["Reset Children"].default_value = True
        link(start.outputs[socket], made.inputs["Collection"])
        return made.outputs["Instances"]

    link = group.links.new
    frame = node("NodeFrame", "What each point says", 0, 0)
    start, end = node("NodeGroupInput", "", -260, 160), node("NodeGroupOutput", "", 780, 160)
    viewed = node("GeometryNodeIsViewport", "In a view", -260, 320)
    light = node("FunctionNodeBooleanMath", "Light, in a view", 0, 320)
    choice = node("GeometryNodeSwitch", "Outlines or trees", 260, 160)
    choice.input_type = "GEOMETRY"
    upright = node("ShaderNodeCombineXYZ", "About the vertical", 260, -480)
    place = node("GeometryNodeInstanceOnPoints", "A tree on every point", 520, 160)
    place.inputs["Pick Instance"].default_value = True

    link(viewed.outputs[0], light.inputs[0])
    link(start.outputs[LIGHT], light.inputs[1])
    link(light.outputs[0], choice.inputs["Switch"])
    link(library(VARIANTS, 160), choice.inputs["False"])
    link(library(OUTLINES, -20), choice.inputs["True"])
    link(choice.outputs["Output"], place.inputs["Instance"])
    link(start.outputs[POINTS], place.inputs["Points"])
    link(attribute(VARIANT, "INT", "Variant", -300), place.inputs["Instance Index"])
    link(attribute(ROTATION, "FLOAT", "Turn, radians", -460), upright.inputs["Z"])
    link(upright.outputs["Vector"], place.inputs["Rotation"])
    link(attribute(SCALE, "FLOAT", "Size factor", -620), place.inputs["Scale"])
    link(place.outputs["Instances"], end.inputs[TREES])
    return group
