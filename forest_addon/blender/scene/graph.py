"""Node trees written as formulas: every function adds a node to a tree and gives back its output.

A value is a number, a vector or colour of three, or an output of another node. A node group of geometry
nodes is a modifier's: it declares what a user can set, and its nodes are laid out from left to right.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from typing import Any

import bpy

Colour = tuple[float, float, float]
Value = Any  # a number, a vector, a colour, or bpy.types.NodeSocket
KINDS = {  # how Blender's names of nodes begin
    "SHADER": ("ShaderNode", ""),
    "GEOMETRY": ("GeometryNode", "FunctionNode", "ShaderNode", ""),
}
WIDE, HIGH = 220, 240  # of a node's place in a tree that is laid out


def tree_of(block: bpy.types.Material | bpy.types.World) -> bpy.types.NodeTree:
    """The node tree of a material or world, made where there is none."""
    if block.node_tree is None:  # Blender 5 makes it with the block
        block.use_nodes = True
    return block.node_tree


class Graph:
    """A node tree that formulas are added to.

    given : outputs of the group's inputs, by name. sockets : what a user can set, by name.
    """

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        self.tree = tree
        self.given: dict[str, Value] = {}
        self.sockets: dict[str, Any] = {}

    @classmethod
    def group(
        cls, name: str, told: str, inputs: Iterable[tuple[Any, ...]], output: tuple[str, str]
    ) -> Graph:
        """A new group of geometry nodes for modifiers.

        told : its description. inputs : name, kind of socket, description and, by name, settings of each.
        output : name and description of the geometry that comes out.
        """
        graph = cls(bpy.data.node_groups.new(name, "GeometryNodeTree"))
        graph.tree.is_modifier, graph.tree.description = True, told
        new = graph.tree.interface.new_socket
        for title, kind, words, *settings in inputs:
            made = new(title, description=words, in_out="INPUT", socket_type=f"NodeSocket{kind}")
            for key, value in settings[0].items() if settings else ():
                setattr(made, key, value)
            graph.sockets[title] = made
        new(output[0], description=output[1], in_out="OUTPUT", socket_type="NodeSocketGeometry")
        start = graph.add("NodeGroupInput")
        graph.given = {socket.name: socket for socket in start.outputs if socket.name}
        return graph

    def finish(self, geometry: Value) -> bpy.types.NodeTree:
        """Give the group's result, and lay its nodes out; returns the group."""
        self.put(self.add("NodeGroupOutput").inputs[0], geometry)
        after = defaultdict(set)
        for link in self.tree.links:
            after[link.from_node.name].add(link.to_node.name)
        column: dict[str, int] = {}
        rows: Counter[int] = Counter()
        for node in reversed(self.tree.nodes[:]):  # what a node needs was made before it
            at = column[node.name] = 1 + max((column[n] for n in after[node.name]), default=-1)
            node.location = -WIDE * at, -HIGH * rows[at]
            rows[at] += 1
        return self.tree

    def put(self, socket: bpy.types.NodeSocket, value: Value) -> None:
        """Link or set an input."""
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, socket)
        elif isinstance(value, tuple) and len(value) == 3 and socket.type == "RGBA":
            socket.default_value = (*value, 1.0)
        else:
            socket.default_value = value

    def add(self, kind: str, inputs: dict[str | int, Value] | None = None, **settings: Any) -> Any:
        """A node of a kind, such as "TexNoise", with settings and inputs."""
        names = (begin + kind for begin in KINDS[self.tree.type])
        whole = next(name for name in names if hasattr(bpy.types, name))
        node = self.tree.nodes.new(whole)
        node.label = node.bl_label
        for name, value in settings.items():
            setattr(node, name, value)
        for key, value in (inputs or {}).items():
            self.put(node.inputs[key], value)
        return node

    def value(self, kind: str, *values: Value, **settings: Any) -> Value:
        """The first output of a node of a kind, of values in the order of its inputs; None: as it is."""
        node = self.add(kind, **settings)
        usable = [socket for socket in node.inputs if socket.enabled]
        for socket, value in zip(usable, values, strict=False):
            if value is not None:
                self.put(socket, value)
        return next(socket for socket in node.outputs if socket.enabled)

    def math(self, operation: str, *values: Value, **settings: Any) -> Value:
        """A node of arithmetic."""
        return self.value("Math", *values, operation=operation, **settings)

    def axis(self, vector: Value, which: str) -> Value:
        """One coordinate, "X", "Y" or "Z"."""
        return self.add("SeparateXYZ", {0: vector}).outputs[which]

    def numbers(self, vector: Value) -> list[Value]:
        """The three numbers of a vector."""
        return list(self.add("SeparateXYZ", {0: vector}).outputs)

    def ramp(
        self,
        share: Value,
        colours: Sequence[Colour],
        low: float = 0.0,
        high: float = 1.0,
        **settings: Any,
    ) -> Value:
        """A colour on a scale of evenly spaced ones, the first at ``low``, the last at ``high``."""
        node = self.add("ValToRGB", {0: share}, **settings)
        elements = node.color_ramp.elements
        while len(elements) < len(colours):
            elements.new(0.5)
        for index, colour in enumerate(colours):
            elements[index].position = low + (high - low) * index / (len(colours) - 1)
            elements[index].color = (*colour, 1.0)
        return node.outputs["Color"]

    # ------------------------------------------------------------------------------ of geometry nodes

    def both(self, one: Value, other: Value, how: str = "AND", **settings: Any) -> Value:
        """Two conditions together."""
        return self.value("BooleanMath", one, other, operation=how, **settings)

    def named(self, name: str, kind: str = "FLOAT") -> Value:
        """An attribute of the geometry."""
        title = name.replace("_", " ").title()
        return self.value("InputNamedAttribute", name, data_type=kind, label=title)

    def store(
        self, geometry: Value, name: str, kind: str, value: Value, domain: str = "POINT"
    ) -> Value:
        """A geometry with an attribute more."""
        how = {"data_type": kind, "domain": domain, "label": name}
        return self.value("StoreNamedAttribute", geometry, None, name, value, **how)

    def switch(self, kind: str, on: Value, no: Value, yes: Value, **settings: Any) -> Value:
        """One of two values or geometries."""
        return self.value("Switch", on, no, yes, input_type=kind, **settings)

    def library(self, name: str) -> Value:
        """The objects of a collection that the modifier names, to pick from by number."""
        return self.value("CollectionInfo", self.given[name], True, True, label=f"{name} by number")

    def geometry_of(self, name: str) -> Value:
        """The geometry of an object that the modifier names."""
        made = self.add("ObjectInfo", {"Object": self.given[name]}, transform_space="ORIGINAL")
        return made.outputs["Geometry"]

    # --------------------------------------------------------------------------------- of shader nodes

    def place(self, which: str = "Object") -> Value:
        """Coordinates: "Object" in metres, "Generated" from 0 to 1 of the bounding box, "UV"."""
        return self.add("TexCoord").outputs[which]

    def scaled(self, place: Value, size: tuple[float, float, float]) -> Value:
        """Coordinates divided by a size along each axis."""
        return self.value("VectorMath", place, tuple(1 / s for s in size), operation="MULTIPLY")

    def moved(self, place: Value, scale: float, far: float) -> Value:
        """Coordinates moved about by noise, by at most about ``far``."""
        noise = self.add("TexNoise", {"Vector": place, "Scale": scale, "Detail": 2.0})
        centred = self.value(
            "VectorMath", noise.outputs["Color"], (0.5, 0.5, 0.5), operation="SUBTRACT"
        )
        return self.value("VectorMath", centred, (2 * far,) * 3, place, operation="MULTIPLY_ADD")

    def noise(self, place: Value, scale: float, detail: float = 3.0, rough: float = 0.5) -> Value:
        """Noise from 0 to 1."""
        inputs = {"Vector": place, "Scale": scale, "Detail": detail, "Roughness": rough}
        return self.add("TexNoise", inputs).outputs[0]

    def cells(self, place: Value, scale: float = 1.0, spread: float = 1.0) -> tuple[Value, Value]:
        """Distance to the edge between cells, and a number from 0 to 1 of each cell."""
        inputs = {"Vector": place, "Scale": scale, "Randomness": spread}
        edge = self.add("TexVoronoi", inputs, feature="DISTANCE_TO_EDGE").outputs["Distance"]
        own = self.add("TexVoronoi", inputs, feature="F1").outputs["Color"]
        return edge, self.value("SeparateColor", own)

    def step(self, value: Value, low: float, high: float) -> Value:
        """From 0 at ``low`` to 1 at ``high``, smoothly; ``low`` may be the larger."""
        return self.value("MapRange", value, low, high, interpolation_type="SMOOTHSTEP")

    def mix(self, share: Value, one: Value, other: Value, how: str = "MIX") -> Value:
        """A colour between two."""
        return self.value("Mix", share, one, other, data_type="RGBA", blend_type=how)

    def attribute(self, name: str) -> Value:
        """A number that the mesh has of each face or vertex."""
        return self.add("Attribute", attribute_name=name).outputs["Fac"]

    def bump(self, height: Value, metres: float, strength: float = 1.0) -> Value:
        """A normal, from heights in units of so many metres."""
        inputs = {"Height": height, "Distance": metres, "Strength": strength}
        return self.add("Bump", inputs).outputs["Normal"]
