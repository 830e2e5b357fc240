"""A point cloud as a Blender object: vertices with named attributes, shown as points by a modifier.

Every value and label of a return is an attribute. The modifier has a menu *Colour By*: organs in the
colours of nature, numbers (trees, leaves, objects) in colours of their own, measures on a scale from
their smallest to their largest value. It stores what was chosen as the attribute ``colour``, which the
material shows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import bpy
import numpy as np

from ..growth.mesh.trimesh import GROUND, LEAF, WOOD
from ..sensing.lidar.cloud import Cloud
from ..sensing.sonar.ping import Contributions
from .layout import CLOUD_KEY, COLOUR_BY, FRAME_KEY, RADIUS
from .materials import coloured_points
from .nodes import choose_input
from .ours import is_ours, make_object, own

COLOUR_OF_ORGAN = {
    WOOD: (0.30, 0.17, 0.08, 1.0),
    LEAF: (0.08, 0.42, 0.06, 1.0),
    GROUND: (0.45, 0.40, 0.30, 1.0),
}
NUMBERS = ("tree", "species", "leaf", "object", "return_number")
MEASURES = ("height", "distance", "intensity", "incidence", "width", "scan_angle", "time")
SCALE = ((0.09, 0.0, 0.16), (0.03, 0.20, 0.29), (0.02, 0.45, 0.25), (0.98, 0.80, 0.02))
GOLDEN = 0.6180339887498949  # numbers one after the other get hues far apart
VIVID, VALUE = 0.75, 0.6  # saturation and value of those hues
OTHER = (0.5, 0.5, 0.5, 1.0)  # organs that have no colour of nature
QUIETEST = 1e-3  # amplitude, of the loudest, that is shown faintest
FAINT, LOUD = np.array([0.25, 0.02, 0.0, 1.0]), np.array([1.0, 0.35, 0.05, 1.0])
GROUP, HEARD_GROUP = "Forest points", "Forest echo points"


def show_cloud(home: bpy.types.Collection, name: str, cloud: Cloud) -> bpy.types.Object:
    """Put a sensor's cloud into a collection, in place of that sensor's last one.

    Where nothing is of a tree or of the ground it is first coloured by object.
    """
    data = bpy.data.meshes.new(name)
    data.vertices.add(len(cloud))
    _fill(data, "position", "FLOAT_VECTOR", cloud.position, "vector")
    _fill(data, "surface_normal", "FLOAT_VECTOR", cloud.returns.normal, "vector")
    for measure, values in {
        "distance": cloud.returns.distance,
        "true_range": cloud.true_range,
        "intensity": cloud.intensity,
        "width": cloud.width,
        "incidence": np.arccos(np.minimum(cloud.returns.cos_incidence, 1.0)),
        "scan_angle": cloud.scan_angle,
        "time": cloud.time,
    }.items():
        _fill(data, measure, "FLOAT", values)
    for label in ("tree", "species", "organ", "leaf"):
        _fill(data, label, "INT", getattr(cloud.returns, label))
    _fill(data, "object", "INT", cloud.returns.instance)
    _fill(data, "pulse", "INT", cloud.pulse)
    _fill(data, "return_number", "INT", cloud.number)
    _fill(data, "number_of_returns", "INT", cloud.count)
    colour = np.tile(OTHER, (128, 1))
    for organ, shade in COLOUR_OF_ORGAN.items():
        colour[organ] = shade
    _fill(data, "organ_colour", "FLOAT_COLOR", colour[cloud.returns.organ], "color")
    foreign = not np.isin(cloud.returns.organ, list(COLOUR_OF_ORGAN)).any()
    return _show(home, name, data, _scan_group, "Object" if foreign and len(cloud) else "")


def show_heard(home: bpy.types.Collection, name: str, heard: Contributions) -> bpy.types.Object:
    """Put what a sonar heard into a collection as points, brighter where it is louder."""
    data = bpy.data.meshes.new(name)
    data.vertices.add(len(heard))
    _fill(data, "position", "FLOAT_VECTOR", heard.position, "vector")
    loudest = float(heard.amplitude.max(initial=0.0)) or 1.0
    level = 20.0 * np.log10(np.maximum(heard.amplitude / loudest, QUIETEST))
    share = (1.0 - level / (20.0 * np.log10(QUIETEST)))[:, None]
    _fill(data, "level", "FLOAT", level)
    _fill(data, "distance", "FLOAT", heard.distance)
    _fill(data, "delay", "FLOAT", heard.delay)
    for label in ("tree", "instance", "number"):
        _fill(data, label, "INT", getattr(heard, label))
    _fill(data, "organ_colour", "FLOAT_COLOR", FAINT + share * (LOUD - FAINT), "color")
    return _show(home, name, data, _heard_group)


def _show(
    home: bpy.types.Collection,
    name: str,
    data: bpy.types.Mesh,
    group: Callable[[], bpy.types.NodeTree],
    colour_by: str = "",
) -> bpy.types.Object:
    """An object of these points: the one of before, with all that was done to it, or a new one.

    group : the nodes of a new one. colour_by : what its menu says at first, if not the group's default.
    """
    data.update()
    thing = _standing(home, name)
    if thing is not None:
        _hand_over(thing, data)
        return thing
    thing = make_object(f"{name} points", data, home)
    thing[CLOUD_KEY] = name
    data.materials.append(bpy.data.materials.get(GROUP) or coloured_points(GROUP))
    modifier = thing.modifiers.new("Points", "NODES")
    modifier.node_group = group()
    if colour_by:
        choose_input(modifier, COLOUR_BY, colour_by)
    thing.hide_render = True
    return thing


def _standing(home: bpy.types.Collection, name: str) -> bpy.types.Object | None:
    """The object that shows this sensor's points: in its collection, or where the user has put it in the
    scene. One that was copied or renamed belongs to the user.
    """
    scenes = {
        s for s in bpy.data.scenes if home in (s.collection, *s.collection.children_recursive)
    }
    elsewhere = (thing for thing in bpy.data.objects if scenes & set(thing.users_scene))
    ours = (t for t in (*home.objects, *elsewhere) if t.get(CLOUD_KEY) == name)
    return next((t for t in ours if is_ours(t) and t.type == "MESH" and t.mode == "OBJECT"), None)


def _hand_over(thing: bpy.types.Object, data: bpy.types.Mesh) -> None:
    """Give an object other points: the mesh takes the place of its old one everywhere, in its clothes.

    One that is kept for its frame is not replaced: only this object shows other points.
    """
    old = thing.data
    for material in old.materials:
        data.materials.append(material)
    for key, value in old.items():
        if key != FRAME_KEY:
            data[key] = value
    if FRAME_KEY in old:
        thing.data = own(data)
        return
    name = old.name
    old.user_remap(data)
    if not old.users:
        bpy.data.meshes.remove(old)
        data.name = name
    own(data)


def _scan_group() -> bpy.types.NodeTree:
    """The nodes of scanners' clouds, as they are in the file."""
    return bpy.data.node_groups.get(GROUP) or _points_group(GROUP, "Organ", NUMBERS, MEASURES)


def _heard_group() -> bpy.types.NodeTree:
    """The nodes of what sonars heard."""
    found = bpy.data.node_groups.get(HEARD_GROUP)
    return found or _points_group(
        HEARD_GROUP, "Loudness", ("tree",), ("delay", "distance", "height")
    )


def _points_group(
    name: str, first: str, numbers: Sequence[str], measures: Sequence[str]
) -> bpy.types.NodeTree:
    """Mesh vertices to points of 15 mm in the chosen colour; all of it can be edited by hand.

    first : what the menu calls the colours that the points bring along.
    """
    group = bpy.data.node_groups.new(name, "GeometryNodeTree")
    group.is_modifier = True
    group.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    radius = group.interface.new_socket(RADIUS, in_out="INPUT", socket_type="NodeSocketFloat")
    radius.subtype = "DISTANCE"
    radius.default_value = 0.015
    radius.min_value = 0.0
    menu = group.interface.new_socket(COLOUR_BY, in_out="INPUT", socket_type="NodeSocketMenu")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    start, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    points = group.nodes.new("GeometryNodeMeshToPoints")
    paint = group.nodes.new("GeometryNodeStoreNamedAttribute")
    paint.data_type = "FLOAT_COLOR"
    paint.inputs["Name"].default_value = "colour"
    coat = group.nodes.new("GeometryNodeSetMaterial")
    coat.inputs["Material"].default_value = bpy.data.materials[GROUP]
    chosen = _colour_menu(group, start.outputs["Geometry"], first, numbers, measures)
    group.links.new(start.outputs[COLOUR_BY], chosen.inputs["Menu"])
    menu.default_value = first
    for column, node in enumerate((start, chosen, paint, points, coat, end)):
        node.location = (220 * column - 220 * (column == 0), 0)
    group.links.new(start.outputs["Geometry"], paint.inputs["Geometry"])
    group.links.new(chosen.outputs["Output"], paint.inputs["Value"])
    group.links.new(paint.outputs["Geometry"], points.inputs["Mesh"])
    group.links.new(start.outputs["Radius"], points.inputs["Radius"])
    group.links.new(points.outputs["Points"], coat.inputs["Geometry"])
    group.links.new(coat.outputs["Geometry"], end.inputs["Geometry"])
    return group


def _colour_menu(
    group: bpy.types.NodeTree,
    geometry: bpy.types.NodeSocket,
    first: str,
    numbers: Sequence[str],
    measures: Sequence[str],
) -> bpy.types.GeometryNode:
    """A menu switch with the colour of each attribute."""
    switch = group.nodes.new("GeometryNodeMenuSwitch")
    switch.data_type = "RGBA"
    switch.enum_items.clear()
    colours = {first: _attribute(group, "organ_colour", "FLOAT_COLOR", (0, -200))}
    for row, name in enumerate(numbers, 1):
        colours[name] = _hue(group, name, -200 - 160 * row)
    for row, name in enumerate(measures, 1 + len(numbers)):
        colours[name] = _on_scale(group, geometry, name, -200 - 160 * row)
    for name, colour in colours.items():
        label = name.replace("_", " ").title()
        switch.enum_items.new(label)
        group.links.new(colour, switch.inputs[label])
    return switch


def _hue(group: bpy.types.NodeTree, name: str, y: float) -> bpy.types.NodeSocket:
    """A number as a hue of its own; -1, which is none, as grey."""
    number = _attribute(group, name, "FLOAT", (-900, y))
    hue = _maths(group, "FRACT", _maths(group, "MULTIPLY", number, GOLDEN, y), 0.0, y)
    colour = group.nodes.new("FunctionNodeCombineColor")
    colour.mode = "HSV"
    colour.location = (-300, y)
    known = _maths(group, "GREATER_THAN", number, -0.5, y)
    group.links.new(hue, colour.inputs[0])
    group.links.new(_maths(group, "MULTIPLY", known, VIVID, y), colour.inputs[1])
    colour.inputs[2].default_value = VALUE
    return colour.outputs[0]


def _on_scale(
    group: bpy.types.NodeTree, geometry: bpy.types.NodeSocket, name: str, y: float
) -> bpy.types.NodeSocket:
    """A measure on a scale of colours; intensities by their logarithm."""
    if name == "height":
        place = group.nodes.new("GeometryNodeInputPosition")
        split = group.nodes.new("ShaderNodeSeparateXYZ")
        place.location, split.location = (-1200, y), (-1050, y)
        group.links.new(place.outputs[0], split.inputs[0])
        value = split.outputs["Z"]
    else:
        value = _attribute(group, name, "FLOAT", (-1050, y))
    if name == "intensity":
        value = _maths(group, "LOGARITHM", _maths(group, "MAXIMUM", value, 1e-20, y), 10.0, y)
    ends = group.nodes.new("GeometryNodeAttributeStatistic")
    share = group.nodes.new("ShaderNodeMapRange")
    ramp = group.nodes.new("ShaderNodeValToRGB")
    ends.location, share.location, ramp.location = (-750, y), (-550, y), (-300, y)
    elements = ramp.color_ramp.elements
    while len(elements) < len(SCALE):
        elements.new(0.5)
    for index, colour in enumerate(SCALE):
        elements[index].position = index / (len(SCALE) - 1)
        elements[index].color = (*colour, 1.0)
    group.links.new(geometry, ends.inputs["Geometry"])
    group.links.new(value, ends.inputs["Attribute"])
    group.links.new(value, share.inputs["Value"])
    group.links.new(ends.outputs["Min"], share.inputs["From Min"])
    group.links.new(ends.outputs["Max"], share.inputs["From Max"])
    group.links.new(share.outputs["Result"], ramp.inputs["Fac"])
    return ramp.outputs["Color"]


def _attribute(
    group: bpy.types.NodeTree, name: str, kind: str, place: tuple[float, float]
) -> bpy.types.NodeSocket:
    node = group.nodes.new("GeometryNodeInputNamedAttribute")
    node.data_type = kind
    node.inputs["Name"].default_value = name
    node.location = place
    return node.outputs["Attribute"]


def _maths(
    group: bpy.types.NodeTree, what: str, value: bpy.types.NodeSocket, other: float, y: float
) -> bpy.types.NodeSocket:
    node = group.nodes.new("ShaderNodeMath")
    node.operation = what
    node.inputs[1].default_value = other
    node.location = (-600, y)
    group.links.new(value, node.inputs[0])
    return node.outputs[0]


def _fill(
    data: bpy.types.Mesh, name: str, kind: str, values: np.ndarray, key: str = "value"
) -> None:
    attribute = data.attributes.get(name) or data.attributes.new(name, kind, "POINT")
    dtype = np.int32 if kind == "INT" else np.float32
    attribute.data.foreach_set(key, np.ascontiguousarray(values, dtype=dtype).ravel())
