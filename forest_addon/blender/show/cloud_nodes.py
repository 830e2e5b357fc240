"""The node groups that show points: how large, which of them, coloured by what, on which scale of colours.

Mesh vertices go in, points of a point cloud come out, with what colours them stored as the attribute
``colour``. A menu chooses a value; numbers (trees, species, objects) get hues of their own, measures a place
on a scale from the smallest to the largest of *all* points, so that colours stay when some are hidden. Of
what a sonar heard, loud points are large. Views leave out what lies beyond the ground that they show. A
group is made once a file and then left alone, so whatever is changed in it by hand stays.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence

import bpy
import numpy as np

from ...base.labels import LEVELS, MEASURES as SCALE
from ..scene.layout import COLOUR_BY, COLOUR_MAP, FAR_POINTS, RADIUS, SHARE
from ..scene.materials import coloured
from ..scene.nodes import HIGH as HIGH, LOW, Graph, Value, marked

GROUP, HEARD_GROUP = "Forest Sensing Points", "Forest Sensing Echo Points"
# A group with other sockets than these gets another number. Of version 2 no points were left out in views.
GROUP_KEY, VERSION = "forest_points", 3
MATERIAL = "Forest points"
LOWEST, HIGHEST, COAT = "Lowest", "Highest", "Material"
FARTHEST = 10_000.0  # m above and below: all there is
NUMBERS = ("tree", "species", "leaf", "object", "return_number")
MEASURES = ("height", "distance", "intensity", "incidence", "width", "scan_angle", "time")
HEARD_NUMBERS, HEARD_MEASURES = ("tree",), ("delay", "distance", "height")
# Scales of colours, linear, evenly apart, from the smallest value to the largest.
MAPS: dict[str, tuple[tuple[float, float, float], ...]] = {
    "Dusk to Day": SCALE,
    "Grey": ((0.02, 0.02, 0.02), (0.85, 0.85, 0.85)),
    "Heat": LEVELS,
    "Rainbow": (
        (0.03, 0.02, 0.20),
        (0.02, 0.50, 0.83),
        (0.37, 0.97, 0.05),
        (0.96, 0.21, 0.015),
        (0.19, 0.002, 0.002),
    ),
}
USUAL_MAP, LEVEL_MAP = "Dusk to Day", "Heat"
QUIET, SIZES = -60.0, (0.6, 2.0)  # dB below the loudest; a point's size there and of the loudest
GOLDEN = 0.6180339887498949  # numbers one after the other get hues far apart
VIVID, VALUE = 0.75, 0.6  # saturation and value of those hues


GROUPS = {  # of scanners' clouds and of what sonars heard: title, first choice of the menu, numbers, measures
    "scan": (GROUP, "Organ", NUMBERS, MEASURES),
    "heard": (HEARD_GROUP, "Loudness", HEARD_NUMBERS, HEARD_MEASURES),
}


def group_of(kind: str) -> bpy.types.NodeTree:
    """The nodes that show points of a kind, as they are in the file."""
    return marked(GROUP_KEY, f"{kind} {VERSION}") or _make(kind, *GROUPS[kind])


def title_of(name: str) -> str:
    """Name of an attribute in the menu."""
    return name.replace("_", " ").title()


@functools.cache
def is_measure(choice: str) -> bool:
    """Return whether a choice of the menu *Colour By* goes through a scale of colours."""
    return any(choice == title_of(name) for name in (*MEASURES, *HEARD_MEASURES))


def on_map(name: str, share: np.ndarray | float) -> np.ndarray:
    """(..., 3) linear colours at shares, 0 to 1, of a scale of colours; of the usual one where it is
    unknown."""
    stops = np.array(MAPS.get(name, SCALE))
    place = np.linspace(0.0, 1.0, len(stops))
    return np.stack([np.interp(share, place, channel) for channel in stops.T], axis=-1)


def points_material() -> bpy.types.Material:
    """The material that shows the attribute ``colour``."""
    made = bpy.data.materials.get(MATERIAL) or coloured(MATERIAL, "colour")
    made.diffuse_color = (1.0, 0.75, 0.1, 1.0)  # Solid shading knows one colour for all points
    return made


def _make(
    kind: str, name: str, first: str, numbers: Sequence[str], measures: Sequence[str]
) -> bpy.types.NodeTree:
    """A new group. first : what the menu calls the colours that the points bring along."""
    share = {"subtype": "FACTOR", "default_value": 1.0, "min_value": 0.0, "max_value": 1.0}
    size = {"subtype": "DISTANCE", "default_value": 0.015, "min_value": 0.0}
    low, high = ({"subtype": "DISTANCE", "default_value": way * FARTHEST} for way in (-1.0, 1.0))
    near, far = (
        {"subtype": "TRANSLATION", "default_value": (way * FARTHEST,) * 3} for way in (-1.0, 1.0)
    )
    graph = Graph.group(
        name,
        "Shows vertices as points, coloured by one of their attributes",
        (
            ("Geometry", "Geometry", "Vertices with attributes"),
            (RADIUS, "Float", "Of a point in renders", size),
            (COLOUR_BY, "Menu", "What colours the points"),
            (COLOUR_MAP, "Menu", "Colours of a measure, from its smallest value to its largest"),
            (SHARE, "Float", "Of all points that are shown; always the same ones", share),
            (LOWEST, "Float", "Points below this height are not shown", low),
            (HIGHEST, "Float", "Points above this height are not shown", high),
            (LOW, "Vector", "Corner of the ground that views show", near),
            (HIGH, "Vector", "Corner of the ground that views show", far),
            (FAR_POINTS, "Bool", "Show points beyond that ground in views, too"),
            (
                COAT,
                "Material",
                "It shows the attribute 'colour'",
                {"default_value": points_material()},
            ),
        ),
        ("Geometry", "Points"),
    )
    graph.tree[GROUP_KEY] = f"{kind} {VERSION}"
    given = graph.given
    names = (*numbers, *measures)
    number = _choice(graph, COLOUR_BY, "INT", dict(enumerate([first, *map(title_of, names)])))
    value = _picked(graph, number, [0.0, *(_measure(graph, name) for name in names)])
    how = {"data_type": "FLOAT", "operation": "LESS_THAN", "label": "Has a hue"}
    hued = graph.value("Compare", number, len(numbers) + 0.5, **how)
    hue = graph.math("FRACT", graph.math("MULTIPLY", value, GOLDEN, label="Far apart"))
    vivid = graph.math("MULTIPLY", graph.math("GREATER_THAN", value, -0.5), VIVID)  # -1: none, grey
    told = {"mode": "HSV", "label": "Hue as a colour"}
    own = graph.value("FunctionNodeCombineColor", hue, vivid, VALUE, **told)
    by_value = graph.switch("RGBA", hued, _on_scale(graph, value), own)
    how |= {"operation": "GREATER_THAN", "label": "Is a value"}
    other = graph.value("Compare", number, 0.5, **how)
    colour = graph.switch("RGBA", other, graph.named("organ_colour", "FLOAT_COLOR"), by_value)
    radius = given[RADIUS]
    if kind == "heard":
        level = graph.named("level")
        size = graph.value("MapRange", level, QUIET, 0.0, *SIZES, label="Loud is large")
        radius = graph.math("MULTIPLY", radius, size, label="Size")
    points = {
        "Mesh": graph.store(given["Geometry"], "colour", "FLOAT_COLOR", colour),
        "Selection": _shown(graph),
        "Radius": radius,
    }
    made = graph.add("MeshToPoints", points, label="A point a vertex").outputs[0]
    graph.finish(graph.value("SetMaterial", made, None, given[COAT], label="What they look like"))
    for menu, choice in ((COLOUR_BY, first), (COLOUR_MAP, USUAL_MAP)):  # known once they are linked
        graph.sockets[menu].default_value = choice
    return graph.tree


def _shown(graph: Graph) -> Value:
    """Points that are shown: a share of them, within a range of heights, over the ground."""
    given, place = graph.given, graph.value("InputPosition", label="Where it is")
    chance = graph.value("RandomValue", given[SHARE], data_type="BOOLEAN", label="A share of all")
    height = graph.axis(place, "Z")
    within, near = (
        graph.both(
            graph.value("Compare", value, given[least], operation="GREATER_EQUAL", **how),
            graph.value("Compare", value, given[most], operation="LESS_EQUAL", **how),
        )
        for value, least, most, how in (
            (height, LOWEST, HIGHEST, {"data_type": "FLOAT"}),
            (place, LOW, HIGH, {"data_type": "VECTOR", "mode": "ELEMENT"}),
        )
    )
    viewed = graph.value("IsViewport", label="In a view")
    near = graph.both(viewed, near, "IMPLY", label="Elsewhere all")
    near = graph.both(near, given[FAR_POINTS], "OR", label="Or wherever")
    return graph.both(graph.both(within, chance), near, label="Is shown")


def _choice(graph: Graph, menu: str, kind: str, choices: Mapping[Value, str]) -> Value:
    """The value that a menu chooses, of words by their values."""
    node = graph.add("MenuSwitch", data_type=kind, label=menu)
    node.enum_items.clear()
    for value, word in choices.items():
        node.enum_items.new(word)
        graph.put(node.inputs[word], value)
    graph.put(node.inputs["Menu"], graph.given[menu])
    return node.outputs[0]


def _picked(graph: Graph, number: Value, values: Sequence[Value]) -> Value:
    """The value of a number, of those in a list."""
    node = graph.add("IndexSwitch", data_type="FLOAT", label="Value of that name")
    node.index_switch_items.clear()
    for _ in values:
        node.index_switch_items.new()
    for socket, value in zip(node.inputs, [number, *values], strict=False):
        graph.put(socket, value)
    return node.outputs[0]


def _measure(graph: Graph, name: str) -> Value:
    """Values of an attribute; intensities by their logarithm."""
    if name == "height":
        return graph.axis(graph.value("InputPosition", label="Where it is"), "Z")
    value = graph.named(name)
    if name != "intensity":
        return value
    least = graph.math("MAXIMUM", value, 1e-20, label="Not 0")
    return graph.math("LOGARITHM", least, 10.0, label="In decades")


def _on_scale(graph: Graph, value: Value) -> Value:
    """A measure on the scale that the second menu chooses, from its smallest to its largest value."""
    every = {"Geometry": graph.given["Geometry"], "Attribute": value}
    ends = graph.add("AttributeStatistic", every, label="Smallest and largest").outputs
    share = graph.value("MapRange", value, ends["Min"], ends["Max"], label="From 0 to 1")
    scales = {graph.ramp(share, colours, label=name): name for name, colours in MAPS.items()}
    return _choice(graph, COLOUR_MAP, "RGBA", scales)
