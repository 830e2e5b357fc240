"""Shader nodes written as formulas: every function adds a node to a tree and gives back its output.

A value is a number, a colour of three, or an output of another node.
"""

from __future__ import annotations

from typing import Any

import bpy

Colour = tuple[float, float, float]
Value = Any  # a number, a colour, or bpy.types.NodeSocket


class Graph:
    """A node tree that formulas are added to."""

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        self.tree = tree

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
        node = self.tree.nodes.new(f"ShaderNode{kind}")
        for name, value in settings.items():
            setattr(node, name, value)
        for key, value in (inputs or {}).items():
            self.put(node.inputs[key], value)
        return node

    def place(self, which: str = "Object") -> Value:
        """Coordinates: "Object" in metres, "Generated" from 0 to 1 of the bounding box, "UV"."""
        return self.add("TexCoord").outputs[which]

    def scaled(self, place: Value, size: tuple[float, float, float]) -> Value:
        """Coordinates divided by a size along each axis."""
        shares = tuple(1 / s for s in size)
        return self.add("VectorMath", {0: place, 1: shares}, operation="MULTIPLY").outputs["Vector"]

    def moved(self, place: Value, scale: float, far: float) -> Value:
        """Coordinates moved about by noise, by at most about ``far``."""
        noise = self.add("TexNoise", {"Vector": place, "Scale": scale, "Detail": 2.0})
        centred = self.add(
            "VectorMath", {0: noise.outputs["Color"], 1: (0.5, 0.5, 0.5)}, operation="SUBTRACT"
        )
        by = self.add(
            "VectorMath",
            {0: centred.outputs["Vector"], 1: (2 * far,) * 3, 2: place},
            operation="MULTIPLY_ADD",
        )
        return by.outputs["Vector"]

    def noise(self, place: Value, scale: float, detail: float = 3.0, rough: float = 0.5) -> Value:
        """Noise from 0 to 1."""
        inputs = {"Vector": place, "Scale": scale, "Detail": detail, "Roughness": rough}
        return self.add("TexNoise", inputs).outputs[0]

    def cells(self, place: Value, scale: float = 1.0, spread: float = 1.0) -> tuple[Value, Value]:
        """Distance to the edge between cells, and a number from 0 to 1 of each cell."""
        inputs = {"Vector": place, "Scale": scale, "Randomness": spread}
        edge = self.add("TexVoronoi", inputs, feature="DISTANCE_TO_EDGE").outputs["Distance"]
        own = self.add("TexVoronoi", inputs, feature="F1").outputs["Color"]
        return edge, self.add("SeparateColor", {0: own}).outputs[0]

    def math(self, operation: str, *values: Value) -> Value:
        """A node of arithmetic."""
        inputs: dict[str | int, Value] = dict(enumerate(values))
        return self.add("Math", inputs, operation=operation).outputs[0]

    def step(self, value: Value, low: float, high: float) -> Value:
        """From 0 at ``low`` to 1 at ``high``, smoothly; ``low`` may be the larger."""
        inputs = {"Value": value, "From Min": low, "From Max": high}
        return self.add("MapRange", inputs, interpolation_type="SMOOTHSTEP").outputs["Result"]

    def mix(self, share: Value, one: Value, other: Value, how: str = "MIX") -> Value:
        """A colour between two."""
        inputs: dict[str | int, Value] = {0: share, 6: one, 7: other}
        return self.add("Mix", inputs, data_type="RGBA", blend_type=how).outputs[2]

    def axis(self, place: Value, which: str) -> Value:
        """One coordinate, "X", "Y" or "Z"."""
        return self.add("SeparateXYZ", {0: place}).outputs[which]

    def attribute(self, name: str) -> Value:
        """A number that the mesh has of each face or vertex."""
        return self.add("Attribute", attribute_name=name).outputs["Fac"]

    def bump(self, height: Value, metres: float, strength: float = 1.0) -> Value:
        """A normal, from heights in units of so many metres."""
        inputs = {"Height": height, "Distance": metres, "Strength": strength}
        return self.add("Bump", inputs).outputs["Normal"]
