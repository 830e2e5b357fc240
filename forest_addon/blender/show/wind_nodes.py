"""Node groups of wind in views (``wind``): one moves the pieces of all trees, one shows those of a tree."""

from __future__ import annotations

import bpy

from ..scene.nodes import VIEW_KEY

WIND_KEY = "forest_wind"  # of the group that moves pieces
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
    found = next((g for g in bpy.data.node_groups if g.get(VIEW_KEY) == key), None)
    return found or _Showing(key).group


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

    def geometry_of(self, name: str) -> bpy.types.NodeSocket:
        """The geometry of an object that the modifier names."""
        made = self.node("GeometryNodeObjectInfo", transform_space="ORIGINAL")
        self.put(self.start.outputs[name], made.inputs["Object"])
        return made.outputs["Geometry"]


class _Moving(_WindGroup):
    """The group that moves the pieces of all trees."""

    def __init__(self) -> None:
        super().__init__("Forest Sensing Wind", MOVING, "Says where the wind has each piece")
        self.group[WIND_KEY] = True
        amplitudes = self._amplitudes()
        matrix = self.node("FunctionNodeCombineMatrix")
        for number in range(COLUMNS):
            parts = self.node("ShaderNodeSeparateXYZ")
            self.put(self._column(number, amplitudes), parts.inputs[0])
            for line, value in enumerate(parts.outputs):
                self.put(value, matrix.inputs[4 * number + line])
        store = self.node("GeometryNodeStoreNamedAttribute", data_type="FLOAT4X4", domain="POINT")
        store.inputs["Name"].default_value = MAP
        self.put(self.start.outputs["Pieces"], store.inputs["Geometry"])
        self.put(matrix.outputs[0], store.inputs["Value"])
        self.finish(store.outputs["Geometry"])

    def _amplitudes(self) -> list[bpy.types.NodeSocket]:
        """Amplitude of each mode at the scene's frame, straight between knots."""
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
            name, both = self.named(amplitude_name(first)), []
            for row in rows:
                made = self.node(
                    "GeometryNodeSampleIndex", data_type="FLOAT_VECTOR", domain="POINT", clamp=True
                )
                self.put(table, made.inputs["Geometry"])
                self.put(name, made.inputs["Value"])
                self.put(row, made.inputs["Index"])
                both.append(made.outputs["Value"])
            mixed = self.node("ShaderNodeMix", data_type="VECTOR", clamp_factor=True)
            self.put(share, mixed.inputs["Factor"])
            sockets = [s for s in mixed.inputs if s.type == "VECTOR" and s.name in ("A", "B")]
            for value, socket in zip(both, sockets, strict=True):
                self.put(value, socket)
            parts = self.node("ShaderNodeSeparateXYZ")
            self.put(next(s for s in mixed.outputs if s.type == "VECTOR"), parts.inputs[0])
            found += list(parts.outputs)
        return found

    def _column(self, number: int, amplitudes: list[bpy.types.NodeSocket]) -> bpy.types.NodeSocket:
        """One column of the pieces' maps."""
        rest = [0.0, 0.0, 0.0]
        if number < 3:
            rest[number] = 1.0
        so_far: object = rest
        for mode, amplitude in enumerate(amplitudes):
            scaled = self.node("ShaderNodeVectorMath", operation="SCALE")
            self.put(self.named(basis_name(mode, number)), scaled.inputs[0])
            self.put(amplitude, scaled.inputs["Scale"])
            made = self.node("ShaderNodeVectorMath", operation="ADD")
            self.put(so_far, made.inputs[0])
            self.put(scaled.outputs[0], made.inputs[1])
            so_far = made.outputs[0]
        assert isinstance(so_far, bpy.types.NodeSocket)
        return so_far


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
        shapes = self.node("GeometryNodeCollectionInfo")
        shapes.inputs["Separate Children"].default_value = True
        shapes.inputs["Reset Children"].default_value = True
        self.put(self.start.outputs[SHAPES], shapes.inputs["Collection"])
        stand = self.node("GeometryNodeInstanceOnPoints")
        stand.inputs["Pick Instance"].default_value = True
        self.put(own.outputs["Selection"], stand.inputs["Points"])
        self.put(shapes.outputs["Instances"], stand.inputs["Instance"])
        self.put(self.named(PIECE, "INT"), stand.inputs["Instance Index"])
        moved = self.node("GeometryNodeSetInstanceTransform")
        self.put(stand.outputs["Instances"], moved.inputs["Instances"])
        self.put(self.named(MAP, "FLOAT4X4"), moved.inputs["Transform"])
        bare = self.node("GeometryNodeRemoveAttribute")  # files of other programs have none such
        bare.inputs["Name"].default_value = MAP
        self.put(moved.outputs["Instances"], bare.inputs["Geometry"])
        self.finish(bare.outputs["Geometry"])
