"""Materials that look like bark, leaves and forest floor: a few procedural nodes each.

Bark and leaves note the colour that they were made from, so that ``recolour`` can tell a species whose look
was changed from a material that was edited by hand.
"""

from __future__ import annotations

import math

import bpy

from ... import spec
from .bark import covered, surface_of
from .graph import Colour, Graph, Value

LOOK_KEY, STYLE_KEY = "forest_look", "forest_bark"
PLAIN_BARK = spec.Bark()
HUB, PALM = 0.25, (0.0, 0.65, 1.42)  # of a palmate blade: where its ribs part, and their angles
BARK_TONES, LEAF_TONES = "Bark Tones", "Leaf Tones"  # names of nodes
VIEWPORT = 2.5  # Solid shading has no light between leaves: true colours are too dark to see there


def bark(
    name: str,
    colour: Colour,
    coat: spec.Bark = PLAIN_BARK,
    into: bpy.types.Material | None = None,
) -> bpy.types.Material:
    """Bark of a colour with the texture, the moss and the upper stem of ``coat``.

    into : a bark to make anew in place of another material.
    """
    material, shader = _principled(name, into)
    graph = Graph(material.node_tree)
    surface = surface_of(graph, coat)
    tones = _ramp(graph.tree, *_tones(BARK_TONES, colour), 0.05, 0.75)
    tones.name = BARK_TONES
    graph.put(tones.inputs["Fac"], surface.tone)
    graph.put(shader.inputs["Base Color"], covered(graph, coat, tones.outputs["Color"], surface))
    graph.put(shader.inputs["Normal"], graph.bump(surface.height, surface.metres, 0.85))
    shader.inputs["Roughness"].default_value = 0.9
    shader.inputs["Specular IOR Level"].default_value = 0.2
    material[STYLE_KEY] = style_of(coat)
    _note(material, colour)
    return material


def coats_of(species: spec.Species) -> tuple[bpy.types.Material, bpy.types.Material]:
    """New materials of a species: its bark and its leaves."""
    return (
        bark(f"{species.name} bark", species.look.bark, species.bark),
        leaf(f"{species.name} leaf", species.look.foliage(), veins_of(species)),
    )


def veins_of(species: spec.Species) -> str:
    """Name how the leaves of a species are veined, as ``leaf`` wants it."""
    if species.needles is not None:
        return "none"
    return "palm" if species.leaf.shape == "palmate" else "feather"


def style_of(coat: spec.Bark) -> str:
    """Name what tells barks apart, beside their colour."""
    return repr(coat)


def leaf(name: str, colour: Colour, veins: str = "feather") -> bpy.types.Material:
    """Leaves that let light through, with a paler underside; each leaf has its own shade.

    veins : "feather", a midrib and side veins, as texture coordinates along and across the blade give them;
        "palm", ribs that part at the end of the stalk; "none".
    """
    material, shader = _principled(name)
    graph = Graph(material.node_tree)
    number = graph.attribute("leaf")
    shade = graph.add("TexWhiteNoise", {"W": number}, noise_dimensions="1D").outputs["Value"]
    tones = _ramp(graph.tree, *_tones(LEAF_TONES, colour))
    tones.name = LEAF_TONES
    graph.put(tones.inputs["Fac"], shade)
    above = tones.outputs["Color"]
    if veins != "none":
        vein, between = _veins(graph, veins == "palm")
        above = graph.mix(graph.math("MULTIPLY", vein, 0.35), above, (1.5, 1.5, 1.2), "MULTIPLY")
        above = graph.mix(
            graph.math("MULTIPLY", between, 0.18), above, (0.6, 0.62, 0.5), "MULTIPLY"
        )
        lit = graph.mix(
            graph.math("MULTIPLY", vein, 0.6), tones.outputs["Color"], (0.45, 0.5, 0.3), "MULTIPLY"
        )
        graph.put(shader.inputs["Normal"], graph.bump(vein, 0.0006, 0.5))
    else:
        lit = above
    below = graph.mix(0.35, above, (0.20, 0.24, 0.15))
    side = graph.add("NewGeometry").outputs["Backfacing"]
    graph.put(shader.inputs["Base Color"], graph.mix(side, above, below))
    through = graph.mix(1.0, lit, (1.35, 1.45, 0.75), "MULTIPLY")
    glow = graph.add("BsdfTranslucent", {"Color": through}).outputs["BSDF"]
    both = graph.add("MixShader", {"Fac": 0.42, 1: shader.outputs["BSDF"], 2: glow})
    graph.put(_output(graph.tree).inputs["Surface"], both.outputs["Shader"])
    shader.inputs["Roughness"].default_value = 0.55
    shader.inputs["Specular IOR Level"].default_value = 0.22
    _note(material, colour)
    return material


def _veins(graph: Graph, palmate: bool) -> tuple[Value, Value]:
    """Veins, and the blade between them, from 0 to 1."""
    uv = graph.place("UV")
    along = graph.axis(uv, "X")
    aside = graph.math("ABSOLUTE", graph.math("SUBTRACT", graph.axis(uv, "Y"), 0.5))
    wave = graph.math("SINE", graph.math("MULTIPLY", _slant(graph, along, aside, palmate), 30.0))
    side = graph.step(graph.math("ABSOLUTE", wave), 0.14, 0.03)
    veins = graph.math("MULTIPLY", side, 0.45 if palmate else 0.7)
    for angle in PALM if palmate else (0.0,):
        cos, sin = math.cos(angle), math.sin(angle)
        beyond = graph.math("SUBTRACT", along, HUB if angle else 0.0)
        way = graph.math("MULTIPLY_ADD", aside, sin, graph.math("MULTIPLY", beyond, cos))
        off = graph.math("MULTIPLY_ADD", aside, cos, graph.math("MULTIPLY", beyond, -sin))
        rib = graph.step(graph.math("ABSOLUTE", off), 0.018, 0.006)
        rib = graph.math("MULTIPLY", rib, graph.step(way, -0.01, 0.01))
        veins = graph.math("MAXIMUM", veins, rib)
    return veins, graph.step(graph.math("ABSOLUTE", wave), 0.3, 0.9)


def _slant(graph: Graph, along: Value, aside: Value, palmate: bool) -> Value:
    """Coordinates across the side veins: of a feather, or of the fingers of a palm."""
    if not palmate:
        return graph.math("MULTIPLY_ADD", aside, -0.75, along)
    far = graph.math("SUBTRACT", along, HUB)
    square = graph.math("MULTIPLY_ADD", aside, aside, graph.math("MULTIPLY", far, far))
    return graph.math("SQRT", square)


def recolour(material: bpy.types.Material, colour: Colour) -> None:
    """Give bark or leaves another colour, if it is not the one they were made from.

    Whatever else was edited in the material stays.
    """
    if tuple(material.get(LOOK_KEY, ())) == tuple(colour):
        return
    for name in (BARK_TONES, LEAF_TONES):
        ramp = getattr(material.node_tree.nodes.get(name), "color_ramp", None)
        if ramp is not None:
            dark, light = _tones(name, colour)
            ramp.elements[0].color, ramp.elements[-1].color = (*dark, 1.0), (*light, 1.0)
    _note(material, colour)


def ground(name: str) -> bpy.types.Material:
    """Forest floor: litter of leaves and needles, moss in patches, a bump of small things that lie about."""
    material, shader = _principled(name)
    tree = material.node_tree
    place = tree.nodes.new("ShaderNodeTexCoord")
    patches = _noise(tree, 0.3, 6.0, 0.72)
    moss = _ramp(tree, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.38, 0.60)
    pieces = tree.nodes.new("ShaderNodeTexVoronoi")  # needles and leaves that lie crosswise
    pieces.inputs["Scale"].default_value = 38.0
    litter = _ramp(tree, (0.030, 0.022, 0.012), (0.140, 0.098, 0.052), 0.05, 0.95)
    tufts = _noise(tree, 55.0, 2.0, 0.8)
    green = _ramp(tree, (0.030, 0.046, 0.010), (0.105, 0.140, 0.036), 0.30, 0.72)
    mixed = tree.nodes.new("ShaderNodeMix")
    mixed.data_type = "RGBA"
    coarse = _noise(tree, 9.0, 4.0, 0.8)
    shade = tree.nodes.new("ShaderNodeMix")
    shade.data_type, shade.blend_type = "RGBA", "OVERLAY"
    shade.inputs[0].default_value = 0.6
    heights = tree.nodes.new("ShaderNodeMath")
    heights.operation = "ADD"
    bump = tree.nodes.new("ShaderNodeBump")
    bump.inputs["Distance"].default_value = 0.05
    bump.inputs["Strength"].default_value = 0.8
    for made in (patches, pieces, tufts, coarse):
        tree.links.new(place.outputs["Object"], made.inputs["Vector"])
    tree.links.new(patches.outputs["Fac"], moss.inputs["Fac"])
    tree.links.new(pieces.outputs["Color"], litter.inputs["Fac"])
    tree.links.new(tufts.outputs["Fac"], green.inputs["Fac"])
    tree.links.new(moss.outputs["Color"], mixed.inputs[0])
    tree.links.new(litter.outputs["Color"], mixed.inputs[6])
    tree.links.new(green.outputs["Color"], mixed.inputs[7])
    tree.links.new(mixed.outputs[2], shade.inputs[6])
    tree.links.new(coarse.outputs["Fac"], shade.inputs[7])
    tree.links.new(shade.outputs[2], shader.inputs["Base Color"])
    tree.links.new(coarse.outputs["Fac"], heights.inputs[0])
    tree.links.new(pieces.outputs["Distance"], heights.inputs[1])
    tree.links.new(heights.outputs["Value"], bump.inputs["Height"])
    tree.links.new(bump.outputs["Normal"], shader.inputs["Normal"])
    shader.inputs["Roughness"].default_value = 1.0
    shader.inputs["Specular IOR Level"].default_value = 0.1
    material.diffuse_color = (0.22, 0.20, 0.13, 1.0)
    return material


def meadow(name: str) -> bpy.types.Material:
    """Grassland far away: greens and dry tufts in patches."""
    material, shader = _principled(name)
    graph = Graph(material.node_tree)
    place = graph.place()
    broad = graph.step(graph.noise(place, 0.05, 5.0, 0.6), 0.35, 0.65)
    fine = graph.noise(graph.scaled(place, (0.6, 0.6, 0.6)), 1.0, 6.0, 0.75)
    green = graph.mix(broad, (0.075, 0.105, 0.022), (0.135, 0.150, 0.045))
    colour = graph.mix(
        graph.step(fine, 0.3, 0.75), graph.mix(0.5, green, (0.02, 0.03, 0.008)), green
    )
    graph.put(shader.inputs["Base Color"], colour)
    shader.inputs["Roughness"].default_value = 1.0
    shader.inputs["Specular IOR Level"].default_value = 0.1
    material.diffuse_color = (0.16, 0.2, 0.08, 1.0)
    return material


def coloured_points(name: str) -> bpy.types.Material:
    """Points in the colour that their attribute ``colour`` says."""
    material, shader = _principled(name)
    tree = material.node_tree
    colour = tree.nodes.new("ShaderNodeAttribute")
    colour.attribute_name = "colour"
    tree.links.new(colour.outputs["Color"], shader.inputs["Base Color"])
    shader.inputs["Roughness"].default_value = 1.0
    material.diffuse_color = (1.0, 0.75, 0.1, 1.0)  # Solid shading knows one colour for all points
    return material


def _note(material: bpy.types.Material, colour: Colour) -> None:
    material[LOOK_KEY] = colour
    material.diffuse_color = (*_scaled(colour, VIEWPORT), 1.0)


def _tones(name: str, colour: Colour) -> tuple[Colour, Colour]:
    """The dark and the light tone of bark or leaves."""
    if name == BARK_TONES:
        return _scaled(colour, 0.45), _scaled(colour, 1.6)
    return _scaled(colour, 0.55), _towards(_scaled(colour, 1.5), (0.30, 0.30, 0.02), 0.25)


def _noise(
    tree: bpy.types.NodeTree, scale: float, detail: float, roughness: float = 0.5
) -> bpy.types.Node:
    node = tree.nodes.new("ShaderNodeTexNoise")
    node.inputs["Scale"].default_value = scale
    node.inputs["Detail"].default_value = detail
    node.inputs["Roughness"].default_value = roughness
    return node


def _principled(
    name: str, into: bpy.types.Material | None = None
) -> tuple[bpy.types.Material, bpy.types.Node]:
    """A material with its shader: a new one, or an old one with nothing else in it."""
    material = into or bpy.data.materials.new(name)
    if material.node_tree is None:  # Blender 5 makes it with the material
        material.use_nodes = True
    nodes = material.node_tree.nodes
    for node in list(nodes) if into else ():
        if node.type not in ("BSDF_PRINCIPLED", "OUTPUT_MATERIAL"):
            nodes.remove(node)
    return material, next(n for n in nodes if n.type == "BSDF_PRINCIPLED")


def _output(tree: bpy.types.NodeTree) -> bpy.types.Node:
    return next(n for n in tree.nodes if n.type == "OUTPUT_MATERIAL")


def _ramp(
    tree: bpy.types.NodeTree, dark: Colour, light: Colour, low: float = 0.0, high: float = 1.0
) -> bpy.types.Node:
    node = tree.nodes.new("ShaderNodeValToRGB")
    first, last = node.color_ramp.elements
    first.position, last.position = low, high
    first.color, last.color = (*dark, 1.0), (*light, 1.0)
    return node


def _scaled(colour: Colour, factor: float) -> Colour:
    r, g, b = (min(1.0, channel * factor) for channel in colour)
    return r, g, b


def _towards(a: Colour, b: Colour, share: float) -> Colour:
    r, g, z = (x + share * (y - x) for x, y in zip(a, b, strict=True))
    return r, g, z
