"""Node trees written as formulas, and the node groups that put a tree on every point and end the ground.

A formula adds a node to a tree and gives back its output. A value is a number, a vector or colour of three,
or an output of another node. A group of geometry nodes declares what a user can set, and is laid out from
left to right. It is made once a file and then left alone, so whatever is changed in it by hand stays.

The group of trees says which variant stands on a point, how turned and how large. A modifier hands it the
points and the collection of variants; its objects count in the order of their names. *Scale* and
*Rotation* are of all trees alike, and sensors see them so. With *Light View* a view shows stand-ins of
the trees from a second collection, with *Dots* a dot for each tree, with *Show Share* some of the trees;
renders show all of them in full, and whoever measures reads within ``in_full``.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import bpy

from ... import spec
from .layout import GROUND_NAME, SHARE, find_part, is_local, is_ours

if TYPE_CHECKING:
    from ...stand.intensity.surface import GroundSurface

Colour = tuple[float, float, float]
Value = Any  # a number, a vector, a colour, or bpy.types.NodeSocket
KINDS = {  # how Blender's names of nodes begin
    "SHADER": ("ShaderNode", ""),
    "GEOMETRY": ("GeometryNode", "FunctionNode", "ShaderNode", ""),
}
APART = (-220, -240)  # of the places of nodes in a tree that is laid out


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
            node.location = APART[0] * at, APART[1] * rows[at]
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
        """A smooth step from 0 at ``low`` to 1 at ``high``; ``low`` may be the larger."""
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


INSTANCER = "Forest Sensing Forest"
# A group with other sockets than these gets another number. Of version 1 were no size and turn of all, of
# version 2 no dots, of version 3 no distance within which trees are whole.
LAYOUT_KEY, LAYOUT, KNOWN = "forest_layout", 4, (1, 2, 3, 4)
FIRST = "Forest Instancer"  # what version 1 was called
POINTS, VARIANTS, OUTLINES, LIGHT, TREES = "Points", "Variants", "Outlines", "Light View", "Trees"
DOTS, NEAR = "Dots", "Whole Within"
DOT = 0.35  # metres, radius of a dot, of a tree of size 1
ALL_SCALE, ALL_ROTATION = "Scale", "Rotation"
VIEW_KEY = "forest_view"  # of a group that changes what views show and nothing else
LIGHT_KEY = "forest_light"  # on an object: what *Light View* was set to when it was built last
LEVEL_KEY = "forest_level"  # on the same object: triangles at most of a stand-in
VARIANT, ROTATION, SCALE = "variant", "rotation", "scale"  # attributes of the points
SIZES = {"default_value": 1.0, "min_value": 0.001, "max_value": 1000.0}
TURNS = {"subtype": "ANGLE", "min_value": -1e4, "max_value": 1e4}
METRES = {"subtype": "DISTANCE", "default_value": 10.0, "min_value": 0.0}
SHARES = {"subtype": "FACTOR", "default_value": 1.0, "min_value": 0.0, "max_value": 1.0}


def give_instancer(
    obj: bpy.types.Object,
    variants: bpy.types.Collection,
    outlines: bpy.types.Collection,
    light: bool,
) -> None:
    """Give an object the modifier that puts trees on its points; what was chosen in an old one stays.

    light : show outlines in views.
    """
    named = (INSTANCER, FIRST)  # one whose node group was deleted is known by its name
    by_nodes = ((m, m.node_group) for m in obj.modifiers if m.type == "NODES")
    instancers = (
        m for m, group in by_nodes if _is_instancer(group) or (not group and m.name in named)
    )
    modifier = next(instancers, None)
    chosen = modifier is not None and is_light(modifier) != obj.get(LIGHT_KEY, False)
    if modifier is None:
        modifier = obj.modifiers.new(INSTANCER, "NODES")
    if modifier.node_group is None:
        modifier.node_group, chosen = instancer_group(), False
    sockets = _sockets(modifier)
    for name, library in ((VARIANTS, variants), (OUTLINES, outlines)):
        known = _input(modifier, name)[0] if name in sockets else None
        if name in sockets and (known is None or is_ours(known)):
            set_input(modifier, name, library)
    if LIGHT in sockets and not chosen:
        set_input(modifier, LIGHT, light)
    obj[LIGHT_KEY] = light


@contextmanager
def in_full(depsgraph: bpy.types.Depsgraph) -> Iterator[None]:
    """Evaluate every tree, and all the ground, in this block, whatever views show; the depsgraph is
    updated.
    """
    by_nodes = [
        modifier
        for obj in depsgraph.scene.objects
        for modifier in obj.original.modifiers
        if modifier.type == "NODES" and modifier.node_group is not None
    ]
    less = [
        (modifier, name, value, full)
        for modifier in by_nodes
        if _is_instancer(modifier.node_group)
        for name, full in ((LIGHT, False), (DOTS, False), (SHARE, 1.0))
        if name in _sockets(modifier) and (value := _input(modifier, name)[0]) != full
    ]
    switches = [
        (modifier, where)
        for modifier in by_nodes
        if VIEW_KEY in modifier.node_group
        for where in ("show_viewport", "show_render")
        if getattr(modifier, where)
    ]
    for modifier, name, _, full in less:
        set_input(modifier, name, full)
    for modifier, where in switches:
        setattr(modifier, where, False)
    try:
        if less or switches:
            depsgraph.update()
        yield
    finally:
        for modifier, name, value, _ in less:
            set_input(modifier, name, value)
        for modifier, where in switches:
            setattr(modifier, where, True)
        if less or switches:
            depsgraph.update()


def is_light(modifier: bpy.types.Modifier) -> bool:
    """Return whether views show stand-ins of an instancer's trees."""
    return LIGHT in _sockets(modifier) and bool(_input(modifier, LIGHT)[0])


def instancer_of(obj: bpy.types.Object | None) -> bpy.types.Modifier | None:
    """The modifier that puts trees on an object's points, None where it has none."""
    modifiers = obj.modifiers if obj is not None else ()
    return next((m for m in modifiers if m.type == "NODES" and _is_instancer(m.node_group)), None)


def shown_of(modifier: bpy.types.Modifier) -> str:
    """Detail in which views show an instancer's trees: "FULL", "LIGHT" (stand-ins) or "DOTS"."""
    if DOTS in _sockets(modifier) and _input(modifier, DOTS)[0]:
        return "DOTS"
    return "LIGHT" if is_light(modifier) else "FULL"


def show_as(modifier: bpy.types.Modifier, what: str) -> None:
    """Have views show an instancer's trees so; what one of an older file has no input for is left out."""
    after = [
        m for m in modifier.id_data.modifiers if m.type == "NODES" and m.node_group is not None
    ]
    for one in (modifier, *(m for m in after if VIEW_KEY in m.node_group)):  # wind too
        for name, on in ((LIGHT, what == "LIGHT"), (DOTS, what == "DOTS")):
            if name in _sockets(one):
                set_input(one, name, on)


def marked(key: str, value: object) -> bpy.types.NodeTree | None:
    """The file's own node group with a custom property of this value, as it is; None where there is none."""
    return next((g for g in bpy.data.node_groups if g.get(key) == value and is_local(g)), None)


def instancer_group() -> bpy.types.NodeTree:
    """The file's node group that puts trees on points, made where there is none."""
    return marked(LAYOUT_KEY, LAYOUT) or _make_instancer()


def has_input(modifier: bpy.types.Modifier, socket: str) -> bool:
    """Return whether it is a geometry-nodes modifier with an input of this name."""
    return modifier.type == "NODES" and socket in _sockets(modifier)


def drawn_inputs(modifier: bpy.types.Modifier) -> dict[str, tuple[Any, str]]:
    """Property that a layout draws of each input, by its name: its owner and its name; none of other
    modifiers than geometry nodes."""
    if modifier.type != "NODES":
        return {}
    known = _sockets(modifier)
    if not hasattr(modifier, "properties"):
        return {name: (modifier, f'["{key}"]') for name, key in known.items()}
    inputs = modifier.properties.inputs
    holders = {name: getattr(inputs, key, None) for name, key in known.items()}
    return {name: (holder, "value") for name, holder in holders.items() if holder is not None}


def input_of(modifier: bpy.types.Modifier, socket: str) -> Any:
    """The value of an input of a geometry-nodes modifier, by the name of its socket."""
    return _input(modifier, socket)[0]


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
    """Choice of a menu among the inputs of a geometry-nodes modifier; empty where that is
    unknown."""
    value, holder, key = _input(modifier, socket)
    if holder is not modifier:
        return str(value)
    return next((word for word, number in _menu(modifier, key) if number == value), "")


def _menu(modifier: bpy.types.Modifier, key: str) -> list[tuple[str, int]]:
    """Choices of a menu and their numbers, before Blender 5.2."""
    items = modifier.id_properties_ui(key).as_dict().get("items", ()) if key in modifier else ()
    return [(item[0], item[-1]) for item in items]


def _is_instancer(group: bpy.types.NodeTree | None) -> bool:
    return group is not None and group.get(LAYOUT_KEY) in KNOWN


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
    graph = Graph.group(
        INSTANCER,
        "Puts a tree on every point",
        (
            (POINTS, "Geometry", "A vertex or point for every tree"),
            (VARIANTS, "Collection", "Trees to choose from, counted by name"),
            (OUTLINES, "Collection", "Their stand-ins, in the same order"),
            (ALL_SCALE, "Float", "Size of all trees; sensors see them so", SIZES),
            (ALL_ROTATION, "Float", "Turn of all trees about the vertical", TURNS),
            (LIGHT, "Bool", "Stand-ins in views; renders and sensors see trees"),
            (NEAR, "Float", "Trees nearer to the scene's camera are no stand-ins", METRES),
            (DOTS, "Bool", "Dots in views; renders and sensors see trees"),
            (SHARE, "Float", "Of trees in views; renders and sensors see all", SHARES),
        ),
        (TREES, "An instance for every point, with its attributes"),
    )
    graph.tree[LAYOUT_KEY] = LAYOUT
    given, viewed = graph.given, graph.value("IsViewport", label="In a view")
    light = graph.both(viewed, given[LIGHT], label="Light, in a view")
    sampled = graph.value("RandomValue", given[SHARE], data_type="BOOLEAN", label="A share of all")
    shown = graph.switch("BOOLEAN", viewed, True, sampled, label="Some or all")
    turn = graph.math("ADD", graph.named(ROTATION), given[ALL_ROTATION], label="Turned")
    size = graph.named(SCALE)
    place = {
        "Points": given[POINTS],
        "Pick Instance": True,
        "Instance Index": graph.named(VARIANT, "INT"),
        "Rotation": graph.value("CombineXYZ", 0.0, 0.0, turn, label="About the vertical"),
        "Scale": graph.math("MULTIPLY", size, given[ALL_SCALE], label="Sized"),
    }

    def planted(library: Value, where: Value, told: str) -> Value:
        these = place | {"Selection": where, "Instance": library}
        return graph.add("InstanceOnPoints", these, label=told).outputs[0]

    camera = {"Object": graph.value("InputActiveCamera")}
    eye = graph.add("ObjectInfo", camera, transform_space="RELATIVE").outputs
    away = {0: graph.value("InputPosition"), 1: eye["Location"]}
    away = graph.add("VectorMath", away, operation="DISTANCE").outputs["Value"]
    there = graph.add("VectorMath", {0: eye["Scale"]}, operation="LENGTH").outputs["Value"]
    there = graph.math("GREATER_THAN", there, 0.0, label="There is a camera")  # of none all is 0
    within = graph.math("MULTIPLY", there, given[NEAR], label="Reach of whole trees")
    far = graph.math("GREATER_THAN", away, within, label="Far from the camera")
    whole, rough = graph.library(VARIANTS), graph.library(OUTLINES)
    near = graph.both(shown, far, "NIMPLY", label="Shown and near")
    trees = planted(whole, near, "Trees that are near")
    stand_ins = planted(rough, graph.both(shown, far, label="Shown and far"), "Far stand-ins")
    mixed = graph.add("JoinGeometry", {0: stand_ins}, label="Near and far")
    graph.put(mixed.inputs[0], trees)
    trees = planted(whole, shown, "A tree on every point")
    trees = graph.switch("GEOMETRY", light, trees, mixed.outputs[0], label="Trees or stand-ins")
    radius = graph.math("MULTIPLY", size, DOT, label="Size of a dot")
    dot = {"Mesh": given[POINTS], "Radius": radius}
    dots = graph.add("MeshToPoints", dot, label="A dot for every tree").outputs[0]
    dotted = graph.both(viewed, given[DOTS], label="Dots, in a view")
    return graph.finish(graph.switch("GEOMETRY", dotted, trees, dots, label="Dots or trees"))


GROUP = "Forest Sensing Ground"
LOW, HIGH = "Shown From", "Shown To"
FAR = 100.0  # m of margin; a ground that reaches farther is there for a horizon
AROUND = 0.25  # of the field's longer side: what views show around it


def show_near(obj: bpy.types.Object, field: spec.Forest, terrain: GroundSurface) -> None:
    """Have views show a far, flat ground around the field alone.

    A modifier that the user has taken away does not come back.
    """
    modifier = next((m for m in obj.modifiers if _is_ours(m)), None)
    far = terrain.triangles() is None and field.margin > FAR
    if modifier is None and (not far or obj.get(VIEW_KEY)):
        return
    if not far:
        obj.modifiers.remove(modifier)
        del obj[VIEW_KEY]
        return
    if modifier is None:
        modifier = obj.modifiers.new(GROUP, "NODES")
        modifier.node_group = marked(VIEW_KEY, True) or _make()
        obj[VIEW_KEY] = True
    for name, way, extent in ((LOW, -1.0, (0.0, 0.0)), (HIGH, 1.0, field.size)):
        corner = [o + e + way * around(field) for o, e in zip(field.origin, extent, strict=True)]
        set_input(modifier, name, (*corner, 0.0))


def around(field: spec.Forest) -> float:
    """Metres of flat ground that views show around a field."""
    return min(field.margin, AROUND * max(field.size)) if field.margin > FAR else field.margin


def shown_corners(scene: bpy.types.Scene) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """The lower and upper corner, x and y, of the ground that views show; None where they show all."""
    home = find_part(scene, GROUND_NAME)
    for obj in home.objects if home is not None else ():
        modifier = next((m for m in obj.modifiers if m.type == "NODES" and _is_ours(m)), None)
        if modifier is not None and modifier.show_viewport:
            low, high = (tuple(input_of(modifier, name)[:2]) for name in (LOW, HIGH))
            return low, high
    return None


def _is_ours(modifier: bpy.types.Modifier) -> bool:
    group = modifier.node_group if modifier.type == "NODES" else None
    return group is not None and VIEW_KEY in group


def _make() -> bpy.types.NodeTree:
    graph = Graph.group(
        GROUP,
        "Shows the ground around the forest alone in views; renders show all of it",
        (
            ("Ground", "Geometry", "Flat, as far as the horizon"),
            (LOW, "Vector", "Corner of what views show, height aside", {"subtype": "TRANSLATION"}),
            (HIGH, "Vector", "The corner across", {"subtype": "TRANSLATION"}),
        ),
        ("Ground", "In views the part between these corners"),
    )
    graph.tree[VIEW_KEY] = True
    given, place = graph.given, graph.value("InputPosition", label="Where it is")
    low = graph.value("VectorMath", place, given[LOW], operation="MAXIMUM", label="Not before")
    within = graph.value("VectorMath", low, given[HIGH], operation="MINIMUM", label="Not behind")
    flat = graph.numbers(within)[:2]
    moved = graph.value("CombineXYZ", *flat, graph.axis(place, "Z"), label="At its height")
    viewed = graph.value("IsViewport", label="In a view")
    pulled = graph.value("SetPosition", given["Ground"], viewed, moved, label="Pulled to the edge")
    return graph.finish(pulled)
