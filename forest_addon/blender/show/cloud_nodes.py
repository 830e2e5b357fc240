"""The node groups that show points: how large, which of them, coloured by what, on which scale of colours.

Mesh vertices go in, points of a point cloud come out, with what colours them stored as the attribute
``colour``. A menu chooses a value; numbers (trees, species, objects) get hues of their own, measures a place
on a scale from the smallest to the largest of *all* points, so that colours stay when some are hidden. Of
what a sonar heard, loud points are large. Views leave out what lies beyond the ground that they show. A
group is made once a file and then left alone, so whatever is changed in it by hand stays.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np

from ..scene.layout import COLOUR_BY, COLOUR_MAP, FAR_POINTS, RADIUS, SHARE, is_local
from ..scene.materials import coloured_points
from ..scene.nodes import HIGH, LOW

GROUP, HEARD_GROUP = "Forest Sensing Points", "Forest Sensing Echo Points"
# A group with other sockets than these gets another number. Of version 2 no points were left out in views.
GROUP_KEY, VERSION = "forest_points", 3
MATERIAL = "Forest points"
LOWEST, HIGHEST, COAT = "Lowest", "Highest", "Material"
FARTHEST = 10_000.0  # m above and below: all there is
NUMBERS = ("tree", "species", "leaf", "object", "return_number")
MEASURES = ("height", "distance", "intensity", "incidence", "width", "scan_angle", "time")
HEARD_NUMBERS, HEARD_MEASURES = ("tree",), ("delay", "distance", "height")
SCALE = ((0.09, 0.0, 0.16), (0.03, 0.20, 0.29), (0.02, 0.45, 0.25), (0.98, 0.80, 0.02))
# Scales of colours, linear, evenly apart, from the smallest value to the largest.
MAPS: dict[str, tuple[tuple[float, float, float], ...]] = {
    "Dusk to Day": SCALE,
    "Grey": ((0.02, 0.02, 0.02), (0.85, 0.85, 0.85)),
    "Heat": (
        (0.005, 0.002, 0.03),
        (0.09, 0.005, 0.15),
        (0.50, 0.04, 0.09),
        (0.94, 0.27, 0.003),
        (0.97, 0.98, 0.37),
    ),
    "Rainbow": (
        (0.03, 0.02, 0.20),
        (0.02, 0.50, 0.83),
        (0.37, 0.97, 0.05),
        (0.96, 0.21, 0.015),
        (0.19, 0.002, 0.002),
    ),
}
USUAL_MAP = next(iter(MAPS))
QUIET, SIZES = -60.0, (0.6, 2.0)  # dB below the loudest; a point's size there and of the loudest
GOLDEN = 0.6180339887498949  # numbers one after the other get hues far apart
VIVID, VALUE = 0.75, 0.6  # saturation and value of those hues

Colour = tuple[float, float, float]


def scan_group() -> bpy.types.NodeTree:
    """The nodes of scanners' clouds, as they are in the file."""
    return _found("scan") or _make("scan", GROUP, "Organ", NUMBERS, MEASURES)


def heard_group() -> bpy.types.NodeTree:
    """The nodes of what sonars heard."""
    return _found("heard") or _make("heard", HEARD_GROUP, "Loudness", HEARD_NUMBERS, HEARD_MEASURES)


def title_of(name: str) -> str:
    """Return what the menu calls an attribute."""
    return name.replace("_", " ").title()


@functools.cache
def is_measure(choice: str) -> bool:
    """Return whether a choice of the menu *Colour By* goes through a scale of colours."""
    return any(choice == title_of(name) for name in (*MEASURES, *HEARD_MEASURES))


def on_map(name: str, share: float) -> Colour:
    """The linear colour at a share, 0 to 1, of a scale of colours; of the usual one where it is unknown."""
    stops = np.array(MAPS.get(name, SCALE))
    place = np.linspace(0.0, 1.0, len(stops))
    red, green, blue = (float(np.interp(share, place, channel)) for channel in stops.T)
    return red, green, blue


def points_material() -> bpy.types.Material:
    """The material that shows the attribute ``colour``."""
    return bpy.data.materials.get(MATERIAL) or coloured_points(MATERIAL)


def _found(kind: str) -> bpy.types.NodeTree | None:
    wanted = f"{kind} {VERSION}"
    groups = (g for g in bpy.data.node_groups if g.get(GROUP_KEY) == wanted and is_local(g))
    return next(groups, None)


def _make(
    kind: str, name: str, first: str, numbers: Sequence[str], measures: Sequence[str]
) -> bpy.types.NodeTree:
    """A new group. first : what the menu calls the colours that the points bring along."""
    group = bpy.data.node_groups.new(name, "GeometryNodeTree")
    group[GROUP_KEY] = f"{kind} {VERSION}"
    group.is_modifier = True
    group.description = "Shows vertices as points, coloured by one of their attributes"
    menu, maps = _sockets(group)
    draw = _Drawing(group)
    colour, shown = draw.colour(first, numbers, measures), draw.shown()
    paint = draw.node("GeometryNodeStoreNamedAttribute", "Colour, for the material", 1400, 300)
    paint.data_type = "FLOAT_COLOR"
    paint.inputs["Name"].default_value = "colour"
    points = draw.node("GeometryNodeMeshToPoints", "A point a vertex", 1620, 300)
    coat = draw.node("GeometryNodeSetMaterial", "What they look like", 1840, 300)
    end = draw.node("NodeGroupOutput", "", 2060, 300)
    group.links.new(draw.start.outputs["Geometry"], paint.inputs["Geometry"])
    group.links.new(colour, paint.inputs["Value"])
    group.links.new(paint.outputs["Geometry"], points.inputs["Mesh"])
    group.links.new(shown, points.inputs["Selection"])
    radius = draw.start.outputs[RADIUS]
    group.links.new(draw.by_level(radius) if kind == "heard" else radius, points.inputs["Radius"])
    group.links.new(points.outputs["Points"], coat.inputs["Geometry"])
    group.links.new(draw.start.outputs[COAT], coat.inputs["Material"])
    group.links.new(coat.outputs["Geometry"], end.inputs["Geometry"])
    menu.default_value, maps.default_value = first, USUAL_MAP  # known only once they are linked
    return group


def _sockets(group: bpy.types.NodeTree) -> tuple[Any, Any]:
    """Declare what a user can set; returns the two menus."""
    new = group.interface.new_socket
    new("Geometry", description="Vertices with attributes", in_out="INPUT",
        socket_type="NodeSocketGeometry")  # fmt: skip
    radius = new(RADIUS, description="Of a point in renders", in_out="INPUT",
                 socket_type="NodeSocketFloat")  # fmt: skip
    radius.subtype, radius.default_value, radius.min_value = "DISTANCE", 0.015, 0.0
    menu = new(COLOUR_BY, description="What colours the points", in_out="INPUT",
               socket_type="NodeSocketMenu")  # fmt: skip
    maps = new(COLOUR_MAP, description="Colours of a measure, from its smallest value to its largest",
               in_out="INPUT", socket_type="NodeSocketMenu")  # fmt: skip
    share = new(SHARE, description="Of all points that are shown; always the same ones",
                in_out="INPUT", socket_type="NodeSocketFloat")  # fmt: skip
    share.subtype, share.default_value, share.min_value, share.max_value = "FACTOR", 1.0, 0.0, 1.0
    for name, default, side in ((LOWEST, -FARTHEST, "below"), (HIGHEST, FARTHEST, "above")):
        limit = new(name, description=f"Points {side} this height are not shown", in_out="INPUT",
                    socket_type="NodeSocketFloat")  # fmt: skip
        limit.subtype, limit.default_value = "DISTANCE", default
    for name, way in ((LOW, -1.0), (HIGH, 1.0)):
        corner = new(name, description="Corner of the ground that views show", in_out="INPUT",
                     socket_type="NodeSocketVector")  # fmt: skip
        corner.subtype, corner.default_value = "TRANSLATION", (way * FARTHEST,) * 3
    new(FAR_POINTS, description="Show points beyond that ground in views, too", in_out="INPUT",
        socket_type="NodeSocketBool")  # fmt: skip
    coat = new(COAT, description="It shows the attribute 'colour'", in_out="INPUT",
               socket_type="NodeSocketMaterial")  # fmt: skip
    coat.default_value = points_material()
    new("Geometry", description="Points", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    return menu, maps


class _Drawing:
    """Nodes of a group, as they are drawn: from the inputs at the left to the output at the right."""

    def __init__(self, group: bpy.types.NodeTree) -> None:
        self._group, self._link = group, group.links.new
        self.start = self.node("NodeGroupInput", "", -220, 300)

    def node(self, kind: str, label: str, x: float, y: float) -> bpy.types.Node:
        made = self._group.nodes.new(kind)
        made.label, made.location = label, (x, y)
        return made

    def colour(
        self, first: str, numbers: Sequence[str], measures: Sequence[str]
    ) -> bpy.types.NodeSocket:
        """The colour of each point: what it brings along, a hue, or a place on a scale."""
        number, value = self._choice([first, *map(title_of, (*numbers, *measures))])
        for row, name in enumerate((*numbers, *measures), 1):
            source = self._measure(name, -160 * row)
            self._link(source, value.inputs[1 + row])
        is_number = self._compare("Has a hue", number, "LESS_THAN", len(numbers) + 0.5, 520, 500)
        is_other = self._compare("Is a value", number, "GREATER_THAN", 0.5, 740, 500)
        own = self._attribute("organ_colour", "FLOAT_COLOR", 740, 60)
        by_value = self._switch("Hue or scale", is_number, 960, 120)
        self._link(self._scale(value.outputs[0]), by_value.inputs["False"])
        self._link(self._hue(value.outputs[0]), by_value.inputs["True"])
        chosen = self._switch("Own colour or by value", is_other, 1180, 120)
        self._link(own, chosen.inputs["False"])
        self._link(by_value.outputs[0], chosen.inputs["True"])
        return chosen.outputs[0]

    def shown(self) -> bpy.types.NodeSocket:
        """Return which points are shown: a share of them, within a range of heights, over the ground."""
        chance = self.node("FunctionNodeRandomValue", "A share of all", 960, 700)
        chance.data_type = "BOOLEAN"
        self._link(self.start.outputs[SHARE], chance.inputs["Probability"])
        height = self._height(520, 900)
        low, high = self.start.outputs[LOWEST], self.start.outputs[HIGHEST]
        above = self._compare("Not below", height, "GREATER_EQUAL", low, 740, 900)
        below = self._compare("Not above", height, "LESS_EQUAL", high, 960, 900)
        within = self._both("In the range", above, below, 1180, 900)
        sampled = next(s for s in chance.outputs if s.type == "BOOLEAN")
        shown = self._both("Of the share", within, sampled, 1400, 700)
        return self._both("Is shown", shown, self._near(), 1600, 900)

    def by_level(self, radius: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """The size of points by how loud they were."""
        size = self.node("ShaderNodeMapRange", "Loud is large", 1180, -60)
        self._link(self._attribute("level", "FLOAT", 960, -60), size.inputs["Value"])
        for name, value in zip(("From Min", "From Max"), (QUIET, 0.0), strict=True):
            size.inputs[name].default_value = value
        for name, value in zip(("To Min", "To Max"), SIZES, strict=True):
            size.inputs[name].default_value = value
        scaled = self._maths("Size", "MULTIPLY", radius, 1.0, 1400, -60)
        self._link(size.outputs["Result"], scaled.node.inputs[1])
        return scaled

    def _near(self) -> bpy.types.NodeSocket:
        """Return which points views show: those over the ground that they show, or all."""
        place = self.node("GeometryNodeInputPosition", "Place", 520, 1280)
        low = self._corner("After the corner", place.outputs[0], "GREATER_EQUAL", LOW, 740, 1280)
        high = self._corner("Before the other", place.outputs[0], "LESS_EQUAL", HIGH, 740, 1100)
        near = self._both("Over the ground", low, high, 960, 1200)
        viewed = self.node("GeometryNodeIsViewport", "In a view", 960, 1380)
        all_round = self._both("Elsewhere all", viewed.outputs[0], near, 1180, 1280, "IMPLY")
        far = self.start.outputs[FAR_POINTS]
        return self._both("Or wherever", all_round, far, 1400, 1200, "OR")

    def _corner(
        self, label: str, place: bpy.types.NodeSocket, how: str, corner: str, x: float, y: float
    ) -> bpy.types.NodeSocket:
        made = self.node("FunctionNodeCompare", label, x, y)
        made.data_type, made.mode, made.operation = "VECTOR", "ELEMENT", how
        one, other = [s for s in made.inputs if s.type == "VECTOR"][:2]
        self._link(place, one)
        self._link(self.start.outputs[corner], other)
        return made.outputs[0]

    def _choice(self, words: Sequence[str]) -> tuple[bpy.types.NodeSocket, bpy.types.Node]:
        """The number of the menu's entry, and the value that it names, of which 0 is none."""
        menu = self.node("GeometryNodeMenuSwitch", "Number of the entry", 0, 300)
        menu.data_type = "INT"
        menu.enum_items.clear()
        value = self.node("GeometryNodeIndexSwitch", "Value of that name", 240, -260)
        value.data_type = "FLOAT"
        value.index_switch_items.clear()
        for number, word in enumerate(words):
            menu.enum_items.new(word)
            menu.inputs[word].default_value = number
            value.index_switch_items.new()
        self._link(self.start.outputs[COLOUR_BY], menu.inputs["Menu"])
        self._link(menu.outputs[0], value.inputs["Index"])
        return menu.outputs[0], value

    def _measure(self, name: str, y: float) -> bpy.types.NodeSocket:
        """Return what an attribute says; intensities by their logarithm."""
        if name == "height":
            return self._height(-220, y)
        value = self._attribute(name, "FLOAT", -220, y)
        if name != "intensity":
            return value
        least = self._maths("Not 0", "MAXIMUM", value, 1e-20, -20, y)
        return self._maths("In decades", "LOGARITHM", least, 10.0, 120, y)

    def _height(self, x: float, y: float) -> bpy.types.NodeSocket:
        place = self.node("GeometryNodeInputPosition", "Where it is", x - 200, y)
        split = self.node("ShaderNodeSeparateXYZ", "Height", x, y)
        self._link(place.outputs[0], split.inputs[0])
        return split.outputs["Z"]

    def _hue(self, number: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """A number as a hue of its own; -1, which is none, as grey."""
        turned = self._maths("Far apart", "MULTIPLY", number, GOLDEN, 480, -60)
        hue = self._maths("Hue", "FRACT", turned, 0.0, 620, -60)
        known = self._maths("Not -1", "GREATER_THAN", number, -0.5, 480, -240)
        vivid = self._maths("How vivid", "MULTIPLY", known, VIVID, 620, -240)
        colour = self.node("FunctionNodeCombineColor", "Hue as a colour", 740, -60)
        colour.mode = "HSV"
        self._link(hue, colour.inputs[0])
        self._link(vivid, colour.inputs[1])
        colour.inputs[2].default_value = VALUE
        return colour.outputs[0]

    def _scale(self, value: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """A measure on the scale that the second menu chooses, from its smallest to its largest value."""
        ends = self.node("GeometryNodeAttributeStatistic", "Smallest and largest", 480, -420)
        share = self.node("ShaderNodeMapRange", "From 0 to 1", 700, -420)
        self._link(self.start.outputs["Geometry"], ends.inputs["Geometry"])
        self._link(value, ends.inputs["Attribute"])
        self._link(value, share.inputs["Value"])
        self._link(ends.outputs["Min"], share.inputs["From Min"])
        self._link(ends.outputs["Max"], share.inputs["From Max"])
        chosen = self.node("GeometryNodeMenuSwitch", "Scale of colours", 1180, -420)
        chosen.data_type = "RGBA"
        chosen.enum_items.clear()
        for row, (name, colours) in enumerate(MAPS.items()):
            chosen.enum_items.new(name)
            ramp = self._ramp(name, colours, 920, -420 - 260 * row)
            self._link(share.outputs["Result"], ramp.inputs["Fac"])
            self._link(ramp.outputs["Color"], chosen.inputs[name])
        self._link(self.start.outputs[COLOUR_MAP], chosen.inputs["Menu"])
        return chosen.outputs[0]

    def _ramp(self, name: str, colours: Sequence[Colour], x: float, y: float) -> bpy.types.Node:
        ramp = self.node("ShaderNodeValToRGB", name, x, y)
        elements = ramp.color_ramp.elements
        while len(elements) < len(colours):
            elements.new(0.5)
        for index, colour in enumerate(colours):
            elements[index].position = index / (len(colours) - 1)
            elements[index].color = (*colour, 1.0)
        return ramp

    def _switch(
        self, label: str, condition: bpy.types.NodeSocket, x: float, y: float
    ) -> bpy.types.Node:
        made = self.node("GeometryNodeSwitch", label, x, y)
        made.input_type = "RGBA"
        self._link(condition, made.inputs["Switch"])
        return made

    def _both(
        self,
        label: str,
        one: bpy.types.NodeSocket,
        other: bpy.types.NodeSocket,
        x: float,
        y: float,
        how: str = "AND",
    ) -> bpy.types.NodeSocket:
        made = self.node("FunctionNodeBooleanMath", label, x, y)
        made.operation = how
        self._link(one, made.inputs[0])
        self._link(other, made.inputs[1])
        return made.outputs[0]

    def _compare(
        self,
        label: str,
        value: bpy.types.NodeSocket,
        how: str,
        other: bpy.types.NodeSocket | float,
        x: float,
        y: float,
    ) -> bpy.types.NodeSocket:
        made = self.node("FunctionNodeCompare", label, x, y)
        made.data_type, made.operation = "FLOAT", how
        self._link(value, made.inputs[0])
        if isinstance(other, float):
            made.inputs[1].default_value = other
        else:
            self._link(other, made.inputs[1])
        return made.outputs[0]

    def _attribute(self, name: str, kind: str, x: float, y: float) -> bpy.types.NodeSocket:
        made = self.node("GeometryNodeInputNamedAttribute", title_of(name), x, y)
        made.data_type = kind
        made.inputs["Name"].default_value = name
        return made.outputs["Attribute"]

    def _maths(
        self,
        label: str,
        what: str,
        value: bpy.types.NodeSocket,
        other: float,
        x: float,
        y: float,
    ) -> bpy.types.NodeSocket:
        made = self.node("ShaderNodeMath", label, x, y)
        made.operation = what
        made.inputs[1].default_value = other
        self._link(value, made.inputs[0])
        return made.outputs[0]
