"""Node groups of wind in views (``wind``): one moves the pieces of all trees, one shows those of a tree.

A third does both for trees that are points.
"""

from __future__ import annotations

from collections.abc import Callable

import bpy

from ..scene.graph import Graph, Value
from ..scene.nodes import VIEW_KEY

WIND_KEY = "forest_wind"  # of the group that moves pieces
MANY_KEY = "forest_wind_many"  # of the group that shows trees that are points
MODES, COLUMNS = 12, 4
OUT = "Tree", ""  # what comes out of a group
TREE, PIECE, KNOTS, MAP = "tree", "piece", "first knot", "map"  # attributes of pieces
TABLE, LAST, FIRST, KNOT = "Table", "Last Knot", "First Frame", "Knots"
MOVING = (
    ("Pieces", "Geometry", "A point for every piece of every tree"),
    (TABLE, "Object", "Amplitudes of modes, by tree and knot of time"),
    (LAST, "Int", "Knot of the table at which wind stands still"),
    (FIRST, "Int", "Frame of the table's first knot"),
    (KNOT, "Float", "Knots of the table in a frame"),
)
PIECES, SHAPES, NUMBER = "Pieces", "Shapes", "Tree Number"
SHOWING = (
    ("Tree", "Geometry", "The tree at rest"),
    (PIECES, "Object", "Where the pieces of all trees are"),
    (SHAPES, "Collection", "Meshes of the tree's pieces"),
    (NUMBER, "Int", "Which of the pieces are the tree's"),
)
AMPLITUDES, STAND = "wind now", "wind stand"  # attributes of trees that are points, while nodes run
FULL, LIGHT, DOTS = "Full", "Light View", "Dots"
ROW = "wind row"  # of a tree that is a point: its place among those that sway, from 1 on; 0: it stands still
OF_FULL, OF_LIGHT = ("wind first", "wind pieces"), ("wind first light", "wind pieces light")
MANY = (
    ("Tree", "Geometry", "The trees at rest"),
    (LIGHT, "Bool", "Stand-ins sway in views; renders show trees"),
    (DOTS, "Bool", "Dots in views stand still"),
    (f"{PIECES} {FULL}", "Object", "How modes move each piece of each variant"),
    (f"{PIECES} {LIGHT}", "Object", "The same of pieces of stand-ins"),
    (f"{SHAPES} {FULL}", "Collection", "Meshes of the pieces"),
    (f"{SHAPES} {LIGHT}", "Collection", "Meshes of the pieces of stand-ins"),
    *MOVING[1:],
)


def amplitude_name(first: int) -> str:
    """The column of the table with the amplitudes of three modes from this one on."""
    return f"wind {first}"


def basis_name(mode: int, column: int) -> str:
    """The attribute of pieces with a column of what a mode adds to their map."""
    return f"mode {mode} {'xyz'[column] if column < 3 else 'shift'}"


def moving_group() -> bpy.types.NodeTree:
    """The file's group that moves the pieces of all trees, made where there is none."""
    found = next((g for g in bpy.data.node_groups if WIND_KEY in g), None)
    return found or _moving()


def showing_group(key: str) -> bpy.types.NodeTree:
    """The file's group that shows a tree's pieces, made where there is none; key : its mark, as a view's."""
    groups = (g for g in bpy.data.node_groups if g.get(VIEW_KEY) == key and MANY_KEY not in g)
    return next(groups, None) or _showing(key)


def many_group(key: str) -> bpy.types.NodeTree:
    """The file's group that shows trees that are points, made where there is none; key : as a view's."""
    found = next((g for g in bpy.data.node_groups if g.get(MANY_KEY) == key), None)
    return found or _many(key)


def _moving() -> bpy.types.NodeTree:
    graph = Graph.group("Forest Sensing Wind", "Says where the wind has each piece", MOVING, OUT)
    graph.tree[WIND_KEY] = True
    where = _piece_map(
        graph,
        _amplitudes(graph),
        lambda mode, column: graph.named(basis_name(mode, column), "FLOAT_VECTOR"),
    )
    moved = graph.store(graph.given["Pieces"], MAP, "FLOAT4X4", where)
    return graph.finish(_without(graph, moved, "mode *"))  # each tree would copy them


def _showing(key: str) -> bpy.types.NodeTree:
    told = "Shows a tree's pieces where the wind has them; sensors do the same"
    graph = Graph.group("Forest Sensing Swaying Tree", told, SHOWING, OUT)
    graph.tree[VIEW_KEY] = key
    how = {"data_type": "INT", "operation": "EQUAL"}
    mine = graph.value("Compare", graph.named(TREE, "INT"), graph.given[NUMBER], **how)
    own = graph.value("SeparateGeometry", graph.geometry_of(PIECES), mine, domain="POINT")
    return graph.finish(_placed(graph, own, graph.library(SHAPES), (MAP,)))


def _many(key: str) -> bpy.types.NodeTree:
    told = "Shows the pieces of trees where the wind has them; sensors do the same"
    graph = Graph.group("Forest Sensing Swaying Forest", told, MANY, OUT)
    graph.tree[VIEW_KEY] = graph.tree[MANY_KEY] = key
    given, viewed = graph.given, graph.value("IsViewport")
    light, dots = (graph.both(viewed, given[name]) for name in (LIGHT, DOTS))
    sways = graph.math("GREATER_THAN", graph.named(ROW, "INT"), 0.5)
    parted = {"Geometry": given["Tree"], "Selection": sways}
    moving, still = graph.add("SeparateGeometry", parted, domain="INSTANCE").outputs
    pieces = _pieces(graph, _swaying_trees(graph, moving), light)
    joined = graph.add("JoinGeometry", {0: pieces})
    graph.put(joined.inputs[0], still)
    return graph.finish(graph.switch("GEOMETRY", dots, joined.outputs[0], given["Tree"]))


def _swaying_trees(graph: Graph, trees: Value) -> Value:
    """A point for every tree that sways, which says how it stands and the amplitudes of its modes."""
    stand = graph.value("InstanceTransform")
    told = graph.store(trees, STAND, "FLOAT4X4", stand, "INSTANCE")
    told = graph.value("InstancesToPoints", told)
    for number, three in enumerate(_amplitudes(graph)):
        told = graph.store(told, f"{AMPLITUDES} {number}", "FLOAT_VECTOR", three)
    return told


def _pieces(graph: Graph, trees: Value, light: Value) -> Value:
    """An instance for every piece of every tree; of stand-ins one mesh, which is drawn faster."""
    first, count = (
        graph.switch("INT", light, graph.named(no, "INT"), graph.named(yes, "INT"))
        for no, yes in zip(OF_FULL, OF_LIGHT, strict=True)
    )
    copies = {"Geometry": trees, "Amount": count}
    each, number = graph.add("DuplicateElements", copies, domain="POINT").outputs
    told = graph.store(each, PIECE, "INT", graph.math("ADD", first, number))
    tables = (graph.geometry_of(f"{PIECES} {what}") for what in (FULL, LIGHT))
    table, piece = graph.switch("GEOMETRY", light, *tables), graph.named(PIECE, "INT")
    now = [graph.named(f"{AMPLITUDES} {n}", "FLOAT_VECTOR") for n in range(MODES // 3)]
    where = _piece_map(
        graph, now, lambda mode, at: _sampled(graph, table, basis_name(mode, at), piece)
    )
    placed = graph.value("MatrixMultiply", graph.named(STAND, "FLOAT4X4"), where)
    told = graph.store(told, MAP, "FLOAT4X4", placed)
    shapes = (graph.library(f"{SHAPES} {what}") for what in (FULL, LIGHT))
    each = _placed(graph, told, graph.switch("GEOMETRY", light, *shapes), (MAP, "wind *"))
    return graph.switch("GEOMETRY", light, each, graph.value("RealizeInstances", each))


def _without(graph: Graph, geometry: Value, pattern: str) -> Value:
    """A geometry without the attributes of a name with a wildcard."""
    made = graph.add("RemoveAttribute", {"Geometry": geometry, "Name": pattern})
    if hasattr(made, "pattern_mode"):  # before Blender 5
        made.pattern_mode = "WILDCARD"
    else:
        graph.put(made.inputs["Pattern Mode"], "Wildcard")
    return made.outputs["Geometry"]


def _placed(graph: Graph, points: Value, shapes: Value, spare: tuple[str, ...]) -> Value:
    """Pieces where points say, by their attributes ``PIECE`` and ``MAP``; spare : attributes to drop.

    They are dropped from the points. Dropped from instances of objects, they would make these
    instances of bare meshes, which Blender's exporters write without a face.
    """
    where = graph.named(MAP, "FLOAT4X4")
    keep = graph.add("CaptureAttribute", {"Geometry": points}, domain="POINT")
    keep.capture_items.new("MATRIX", MAP)
    graph.put(keep.inputs[MAP], where)
    bare = keep.outputs["Geometry"]
    for pattern in spare:
        bare = _without(graph, bare, pattern)
    number = graph.named(PIECE, "INT")
    stand = {"Points": bare, "Instance": shapes, "Pick Instance": True, "Instance Index": number}
    stood = graph.add("InstanceOnPoints", stand).outputs["Instances"]
    moved = {"Instances": stood, "Transform": keep.outputs[MAP]}
    return graph.add("SetInstanceTransform", moved).outputs["Instances"]


def _sampled(graph: Graph, geometry: Value, name: str, index: Value) -> Value:
    """A vector attribute of one point of a geometry."""
    value = graph.named(name, "FLOAT_VECTOR")
    how = {"data_type": "FLOAT_VECTOR", "domain": "POINT", "clamp": True}
    return graph.value("SampleIndex", geometry, value, index, **how)


def _amplitudes(graph: Graph) -> list[Value]:
    """Amplitudes of three modes after three at the scene's frame, straight between knots."""
    given, frame = graph.given, graph.add("InputSceneTime").outputs["Frame"]
    past = graph.math("SUBTRACT", frame, given[FIRST])
    knot = graph.math("MAXIMUM", graph.math("MULTIPLY", past, given[KNOT]), 0.0)
    knot = graph.math("MINIMUM", knot, given[LAST])
    below = graph.math("FLOOR", knot)
    share = graph.math("SUBTRACT", knot, below)
    row = graph.math("ADD", below, graph.named(KNOTS, "INT"))
    rows, table = (row, graph.math("ADD", row, 1.0)), graph.geometry_of(TABLE)
    found = []
    for first in range(0, MODES, 3):
        ends = (_sampled(graph, table, amplitude_name(first), row) for row in rows)
        found.append(graph.value("Mix", share, *ends, data_type="VECTOR", clamp_factor=True))
    return found


def _piece_map(graph: Graph, amplitudes: list[Value], basis: Callable[[int, int], Value]) -> Value:
    """The map of a piece at amplitudes: that of rest, and what each mode adds to a column of it
    (``basis``)."""
    each = [number for three in amplitudes for number in graph.numbers(three)]
    entries: list[Value] = []
    for number in range(COLUMNS):
        column: Value = tuple(float(number == line) for line in range(3))
        for mode, amplitude in enumerate(each):
            added = graph.value("VectorMath", basis(mode, number), amplitude, operation="SCALE")
            column = graph.value("VectorMath", column, added, operation="ADD")
        entries += [*graph.numbers(column), None]  # the last line of a map stays as it is
    return graph.value("CombineMatrix", *entries)
