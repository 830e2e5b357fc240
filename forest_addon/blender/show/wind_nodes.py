"""Node groups of wind in views (``wind``): one moves the pieces of all trees, one shows those of a tree.

A third does both for trees that are points (``wind_points``).
"""

from __future__ import annotations

from collections.abc import Callable

import bpy

from ..scene.nodes import VIEW_KEY

WIND_KEY = "forest_wind"  # of the group that moves pieces
MANY_KEY = "forest_wind_many"  # of the group that shows trees that are points
MODES, COLUMNS = 12, 4
TREE, PIECE, KNOTS, MAP = "tree", "piece", "first knot", "map"  # attributes of pieces
TABLE, LAST, FIRST, KNOT = "Table", "Last Knot", "First Frame", "Knots"
MOVING = (
    ("Pieces", "NodeSocketGeometry", "A point for every piece of every tree"),
    (TABLE, "NodeSocketObject", "Amplitudes of modes, by tree and knot of time"),
    (LAST, "NodeSocketInt", "Knot of the table at which wind stands still"),
    (FIRST, "NodeSocketInt", "Frame of the table's first knot"),
    (KNOT, "NodeSocketFloat", "Knots of the table in a frame"),
)
PIECES, SHAPES, NUMBER = "Pieces", "Shapes", "Tree Number"
SHOWING = (
    ("Tree", "NodeSocketGeometry", "The tree at rest"),
    (PIECES, "NodeSocketObject", "Where the pieces of all trees are"),
    (SHAPES, "NodeSocketCollection", "Meshes of the tree's pieces"),
    (NUMBER, "NodeSocketInt", "Which of the pieces are the tree's"),
)
AMPLITUDES, STAND = "wind now", "wind stand"  # attributes of trees that are points, while nodes run
FULL, LIGHT, DOTS = "Full", "Light View", "Dots"
ROW = "wind row"  # of a tree that is a point: its place among those that sway, from 1 on; 0: it stands still
OF_FULL, OF_LIGHT = ("wind first", "wind pieces"), ("wind first light", "wind pieces light")
MANY = (
    ("Tree", "NodeSocketGeometry", "The trees at rest"),
    (LIGHT, "NodeSocketBool", "Stand-ins sway in views; renders show trees"),
    (DOTS, "NodeSocketBool", "Dots in views stand still"),
    (f"{PIECES} {FULL}", "NodeSocketObject", "How modes move each piece of each variant"),
    (f"{PIECES} {LIGHT}", "NodeSocketObject", "The same of pieces of stand-ins"),
    (f"{SHAPES} {FULL}", "NodeSocketCollection", "Meshes of the pieces"),
    (f"{SHAPES} {LIGHT}", "NodeSocketCollection", "Meshes of the pieces of stand-ins"),
    *MOVING[1:],
)


def amplitude_name(first: int) -> str:
    """The column of the table with the amplitudes of three modes from this one on."""
    return f"wind {first}"


def basis_name(mode: int, column: int) -> str:
    """The attribute of pieces with a column of what a mode adds to their map."""
    return f"mode {mode} {'xyz'[column] if column < 3 else 'shift'}"


def moving_group() -> bpy.types.NodeTree:
    """The file's group that moves pieces, made where there is none."""
    found = next((g for g in bpy.data.node_groups if WIND_KEY in g), None)
    return found or _Moving().group


def showing_group(key: str) -> bpy.types.NodeTree:
    """The file's group that shows a tree's pieces, made where there is none; key : its mark, as a view's."""
    groups = (g for g in bpy.data.node_groups if g.get(VIEW_KEY) == key and MANY_KEY not in g)
    return next(groups, None) or _Showing(key).group


def many_group(key: str) -> bpy.types.NodeTree:
    """The file's group that shows trees that are points, made where there is none; key : as a view's."""
    found = next((g for g in bpy.data.node_groups if g.get(MANY_KEY) == key), None)
    return found or _Many(key).group


class _WindGroup:
    """A group while it is made."""

    def __init__(self, name: str, inputs: tuple[tuple[str, str, str], ...], told: str) -> None:
        self.group = group = bpy.data.node_groups.new(name, "GeometryNodeTree")
        group.is_modifier = True
        group.description = told
        for title, kind, words in inputs:
            group.interface.new_socket(title, description=words, in_out="INPUT", socket_type=kind)
        group.interface.new_socket("Tree", in_out="OUTPUT", socket_type="NodeSocketGeometry")
        self.start = self.node("NodeGroupInput")

    def finish(self, geometry: bpy.types.NodeSocket) -> None:
        """Give the result, and lay the nodes out."""
        self.put(geometry, self.node("NodeGroupOutput").inputs["Tree"])
        for number, node in enumerate(self.group.nodes):
            node.location = 200 * (number // 12), -160 * (number % 12)

    def node(self, kind: str, **settings: object) -> bpy.types.Node:
        """A new node with settings."""
        made = self.group.nodes.new(kind)
        for name, value in settings.items():
            setattr(made, name, value)
        return made

    def math(self, operation: str, *values: object) -> bpy.types.NodeSocket:
        """A node of arithmetic on numbers or outputs."""
        made = self.node("ShaderNodeMath", operation=operation)
        for socket, value in zip(made.inputs, values, strict=False):
            self.put(value, socket)
        return made.outputs[0]

    def put(self, value: object, socket: bpy.types.NodeSocket) -> None:
        """Link an output, or set a value."""
        if isinstance(value, bpy.types.NodeSocket):
            self.group.links.new(value, socket)
        else:
            socket.default_value = value

    def named(self, name: str, kind: str = "FLOAT_VECTOR") -> bpy.types.NodeSocket:
        """An attribute."""
        made = self.node("GeometryNodeInputNamedAttribute", data_type=kind)
        made.inputs["Name"].default_value = name
        return made.outputs["Attribute"]

    def without(self, geometry: bpy.types.NodeSocket, pattern: str) -> bpy.types.NodeSocket:
        """A geometry without the attributes of a name with a wildcard."""
        made = self.node("GeometryNodeRemoveAttribute")
        if hasattr(made, "pattern_mode"):  # before Blender 5
            made.pattern_mode = "WILDCARD"
        else:
            made.inputs["Pattern Mode"].default_value = "Wildcard"
        made.inputs["Name"].default_value = pattern
        self.put(geometry, made.inputs["Geometry"])
        return made.outputs["Geometry"]

    def library(self, name: str) -> bpy.types.NodeSocket:
        """The objects of a collection that the modifier names, to pick from by number."""
        made = self.node("GeometryNodeCollectionInfo")
        made.inputs["Separate Children"].default_value = True
        made.inputs["Reset Children"].default_value = True
        self.put(self.start.outputs[name], made.inputs["Collection"])
        return made.outputs["Instances"]

    def placed(
        self, points: bpy.types.NodeSocket, shapes: bpy.types.NodeSocket, spare: tuple[str, ...]
    ) -> bpy.types.NodeSocket:
        """Pieces where points say, by their attributes ``PIECE`` and ``MAP``; spare : attributes to drop.

        They are dropped from the points. Dropped from instances of objects, they would make these
        instances of bare meshes, which Blender's exporters write without a face.
        """
        keep = self.node("GeometryNodeCaptureAttribute", domain="POINT")
        keep.capture_items.new("MATRIX", MAP)
        self.put(points, keep.inputs["Geometry"])
        self.put(self.named(MAP, "FLOAT4X4"), keep.inputs[MAP])
        bare = keep.outputs["Geometry"]
        for pattern in spare:
            bare = self.without(bare, pattern)
        stand = self.node("GeometryNodeInstanceOnPoints")
        stand.inputs["Pick Instance"].default_value = True
        self.put(bare, stand.inputs["Points"])
        self.put(shapes, stand.inputs["Instance"])
        self.put(self.named(PIECE, "INT"), stand.inputs["Instance Index"])
        moved = self.node("GeometryNodeSetInstanceTransform")
        self.put(stand.outputs["Instances"], moved.inputs["Instances"])
        self.put(keep.outputs[MAP], moved.inputs["Transform"])
        return moved.outputs["Instances"]

    def geometry_of(self, name: str) -> bpy.types.NodeSocket:
        """The geometry of an object that the modifier names."""
        made = self.node("GeometryNodeObjectInfo", transform_space="ORIGINAL")
        self.put(self.start.outputs[name], made.inputs["Object"])
        return made.outputs["Geometry"]

    def store(
        self, name: str, kind: str, domain: str, geometry: object, value: object
    ) -> bpy.types.NodeSocket:
        """A geometry with an attribute more."""
        made = self.node("GeometryNodeStoreNamedAttribute", data_type=kind, domain=domain)
        made.inputs["Name"].default_value = name
        self.put(geometry, made.inputs["Geometry"])
        self.put(value, made.inputs["Value"])
        return made.outputs["Geometry"]

    def switch(self, kind: str, on: object, no: object, yes: object) -> bpy.types.NodeSocket:
        """One of two values or geometries."""
        made = self.node("GeometryNodeSwitch", input_type=kind)
        for name, value in (("Switch", on), ("False", no), ("True", yes)):
            self.put(value, made.inputs[name])
        return made.outputs["Output"]

    def sampled(
        self, geometry: object, value: bpy.types.NodeSocket, index: object
    ) -> bpy.types.NodeSocket:
        """A vector attribute of one point of a geometry."""
        made = self.node(
            "GeometryNodeSampleIndex", data_type="FLOAT_VECTOR", domain="POINT", clamp=True
        )
        for name, given in (("Geometry", geometry), ("Value", value), ("Index", index)):
            self.put(given, made.inputs[name])
        return made.outputs["Value"]

    def numbers(self, vector: bpy.types.NodeSocket) -> list[bpy.types.NodeSocket]:
        """The three numbers of a vector."""
        made = self.node("ShaderNodeSeparateXYZ")
        self.put(vector, made.inputs[0])
        return list(made.outputs)

    def amplitudes(self) -> list[bpy.types.NodeSocket]:
        """Amplitudes of three modes after three at the scene's frame, straight between knots."""
        frame = self.node("GeometryNodeInputSceneTime").outputs["Frame"]
        past = self.math("SUBTRACT", frame, self.start.outputs[FIRST])
        knot = self.math("MAXIMUM", self.math("MULTIPLY", past, self.start.outputs[KNOT]), 0.0)
        knot = self.math("MINIMUM", knot, self.start.outputs[LAST])
        below = self.math("FLOOR", knot)
        share = self.math("SUBTRACT", knot, below)
        rows = [self.math("ADD", below, self.named(KNOTS, "INT"))]
        rows.append(self.math("ADD", rows[0], 1.0))
        table, found = self.geometry_of(TABLE), []
        for first in range(0, MODES, 3):
            name = self.named(amplitude_name(first))
            both = [self.sampled(table, name, row) for row in rows]
            mixed = self.node("ShaderNodeMix", data_type="VECTOR", clamp_factor=True)
            self.put(share, mixed.inputs["Factor"])
            sockets = [s for s in mixed.inputs if s.type == "VECTOR" and s.name in ("A", "B")]
            for value, socket in zip(both, sockets, strict=True):
                self.put(value, socket)
            found.append(next(s for s in mixed.outputs if s.type == "VECTOR"))
        return found

    def piece_map(
        self,
        amplitudes: list[bpy.types.NodeSocket],
        basis: Callable[[int, int], bpy.types.NodeSocket],
    ) -> bpy.types.NodeSocket:
        """The map of a piece at amplitudes (``amplitudes``); basis : how a mode adds to a column of it."""
        matrix = self.node("FunctionNodeCombineMatrix")
        each = [number for three in amplitudes for number in self.numbers(three)]
        for number in range(COLUMNS):
            for line, value in enumerate(self.numbers(self._column(number, each, basis))):
                self.put(value, matrix.inputs[4 * number + line])
        return matrix.outputs[0]

    def _column(
        self,
        number: int,
        amplitudes: list[bpy.types.NodeSocket],
        basis: Callable[[int, int], bpy.types.NodeSocket],
    ) -> bpy.types.NodeSocket:
        """One column of the pieces' maps."""
        rest = [0.0, 0.0, 0.0]
        if number < 3:
            rest[number] = 1.0
        so_far: object = rest
        for mode, amplitude in enumerate(amplitudes):
            scaled = self.node("ShaderNodeVectorMath", operation="SCALE")
            self.put(basis(mode, number), scaled.inputs[0])
            self.put(amplitude, scaled.inputs["Scale"])
            made = self.node("ShaderNodeVectorMath", operation="ADD")
            self.put(so_far, made.inputs[0])
            self.put(scaled.outputs[0], made.inputs[1])
            so_far = made.outputs[0]
        assert isinstance(so_far, bpy.types.NodeSocket)
        return so_far


class _Moving(_WindGroup):
    """The group that moves the pieces of all trees."""

    def __init__(self) -> None:
        super().__init__("Forest Sensing Wind", MOVING, "Says where the wind has each piece")
        self.group[WIND_KEY] = True
        where = self.piece_map(
            self.amplitudes(), lambda mode, column: self.named(basis_name(mode, column))
        )
        moved = self.store(MAP, "FLOAT4X4", "POINT", self.start.outputs["Pieces"], where)
        self.finish(self.without(moved, "mode *"))  # each tree would copy them


class _Showing(_WindGroup):
    """The group that shows the pieces of one tree."""

    def __init__(self, key: str) -> None:
        told = "Shows a tree's pieces where the wind has them; sensors do the same"
        super().__init__("Forest Sensing Swaying Tree", SHOWING, told)
        self.group[VIEW_KEY] = key
        mine = self.node("FunctionNodeCompare", data_type="INT", operation="EQUAL")
        whole = [socket for socket in mine.inputs if socket.type == "INT"]
        self.put(self.named(TREE, "INT"), whole[0])
        self.put(self.start.outputs[NUMBER], whole[1])
        own = self.node("GeometryNodeSeparateGeometry", domain="POINT")
        self.put(self.geometry_of(PIECES), own.inputs["Geometry"])
        self.put(mine.outputs[0], own.inputs["Selection"])
        shapes = self.library(SHAPES)
        self.finish(self.placed(own.outputs["Selection"], shapes, (MAP,)))


class _Many(_WindGroup):
    """The group that shows the pieces of all trees that are points."""

    def __init__(self, key: str) -> None:
        told = "Shows the pieces of trees where the wind has them; sensors do the same"
        super().__init__("Forest Sensing Swaying Forest", MANY, told)
        self.group[VIEW_KEY] = self.group[MANY_KEY] = key
        given = self.start.outputs
        viewed = self.node("GeometryNodeIsViewport").outputs[0]
        light, dots = (self._both(viewed, given[name]) for name in (LIGHT, DOTS))
        sways = self.node("GeometryNodeSeparateGeometry", domain="INSTANCE")
        self.put(given["Tree"], sways.inputs["Geometry"])
        self.put(self.math("GREATER_THAN", self.named(ROW, "INT"), 0.5), sways.inputs["Selection"])
        pieces = self._pieces(self._trees(sways.outputs["Selection"]), light)
        joined = self.node("GeometryNodeJoinGeometry")
        for part in (pieces, sways.outputs["Inverted"]):
            self.put(part, joined.inputs[0])
        self.finish(self.switch("GEOMETRY", dots, joined.outputs[0], given["Tree"]))

    def _both(self, one: object, other: object) -> bpy.types.NodeSocket:
        made = self.node("FunctionNodeBooleanMath", operation="AND")
        for value, socket in zip((one, other), made.inputs, strict=False):
            self.put(value, socket)
        return made.outputs[0]

    def _trees(self, trees: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """A point for every tree that sways, which says how it stands and the amplitudes of its modes."""
        stand = self.node("GeometryNodeInstanceTransform").outputs[0]
        told = self.store(STAND, "FLOAT4X4", "INSTANCE", trees, stand)
        points = self.node("GeometryNodeInstancesToPoints")
        self.put(told, points.inputs["Instances"])
        told = points.outputs["Points"]
        for number, three in enumerate(self.amplitudes()):
            told = self.store(f"{AMPLITUDES} {number}", "FLOAT_VECTOR", "POINT", told, three)
        return told

    def _pieces(
        self, trees: bpy.types.NodeSocket, light: bpy.types.NodeSocket
    ) -> bpy.types.NodeSocket:
        """An instance for every piece of every tree; of stand-ins one mesh, which is drawn faster."""
        first, count = (
            self.switch("INT", light, self.named(no, "INT"), self.named(yes, "INT"))
            for no, yes in zip(OF_FULL, OF_LIGHT, strict=True)
        )
        each = self.node("GeometryNodeDuplicateElements", domain="POINT")
        self.put(trees, each.inputs["Geometry"])
        self.put(count, each.inputs["Amount"])
        own = self.math("ADD", first, each.outputs["Duplicate Index"])
        told = self.store(PIECE, "INT", "POINT", each.outputs["Geometry"], own)
        table = self.switch(
            "GEOMETRY", light, *(self.geometry_of(f"{PIECES} {what}") for what in (FULL, LIGHT))
        )
        piece = self.named(PIECE, "INT")
        now = [self.named(f"{AMPLITUDES} {number}") for number in range(MODES // 3)]
        where = self.piece_map(
            now, lambda mode, at: self.sampled(table, self.named(basis_name(mode, at)), piece)
        )
        placed = self.node("FunctionNodeMatrixMultiply")
        self.put(self.named(STAND, "FLOAT4X4"), placed.inputs[0])
        self.put(where, placed.inputs[1])
        told = self.store(MAP, "FLOAT4X4", "POINT", told, placed.outputs[0])
        shapes = (self.library(f"{SHAPES} {what}") for what in (FULL, LIGHT))
        each = self.placed(told, self.switch("GEOMETRY", light, *shapes), (MAP, "wind *"))
        whole = self.node("GeometryNodeRealizeInstances")
        self.put(each, whole.inputs["Geometry"])
        return self.switch("GEOMETRY", light, each, whole.outputs["Geometry"])
