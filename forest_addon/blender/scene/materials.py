"""Materials that look like bark, leaves and forest floor: a few procedural nodes each.

Bark and leaves note the colour that they were made from, so that ``recolour`` can tell a species whose look
was changed from a material that was edited by hand.
"""

from __future__ import annotations

import bpy

Colour = tuple[float, float, float]
LOOK_KEY = "forest_look"
BARK_TONES, LEAF_TONES = "Bark Tones", "Leaf Tones"  # names of nodes
VIEWPORT = 2.5  # Solid shading has no light between leaves: true colours are too dark to see there


def bark(name: str, colour: Colour) -> bpy.types.Material:
    """Bark in plates: furrows between long cells, finer cracks and two tones in them, with a bump."""
    material, shader = _principled(name)
    tree = material.node_tree
    place = tree.nodes.new("ShaderNodeTexCoord")
    warp = _noise(tree, 6.0, 3.0)
    bent = tree.nodes.new("ShaderNodeMix")  # furrows wander
    bent.data_type, bent.blend_type = "RGBA", "LINEAR_LIGHT"
    bent.inputs[0].default_value = 0.06
    stretch = tree.nodes.new("ShaderNodeMapping")
    stretch.inputs["Scale"].default_value = (27.0, 27.0, 8.0)
    plates = tree.nodes.new("ShaderNodeTexVoronoi")
    plates.feature = "DISTANCE_TO_EDGE"
    plates.inputs["Scale"].default_value = 1.0
    furrows = _ramp(tree, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.02, 0.28)
    fine = _noise(tree, 3.0, 8.0)
    height = tree.nodes.new("ShaderNodeMath")
    height.operation = "MULTIPLY_ADD"
    height.inputs[1].default_value = 0.45
    bump = tree.nodes.new("ShaderNodeBump")
    bump.inputs["Strength"].default_value = 0.6
    bump.inputs["Distance"].default_value = 0.012
    tone = tree.nodes.new("ShaderNodeMath")
    tone.operation = "MULTIPLY"
    tones = _ramp(tree, *_tones(BARK_TONES, colour), 0.05, 0.75)
    tones.name = BARK_TONES
    for made in (warp, fine):
        tree.links.new(place.outputs["Object"], made.inputs["Vector"])
    tree.links.new(place.outputs["Object"], bent.inputs[6])
    tree.links.new(warp.outputs["Color"], bent.inputs[7])
    tree.links.new(bent.outputs[2], stretch.inputs["Vector"])
    tree.links.new(stretch.outputs["Vector"], plates.inputs["Vector"])
    tree.links.new(stretch.outputs["Vector"], fine.inputs["Vector"])
    tree.links.new(plates.outputs["Distance"], furrows.inputs["Fac"])
    tree.links.new(fine.outputs["Fac"], height.inputs[0])
    tree.links.new(furrows.outputs["Color"], height.inputs[2])
    tree.links.new(height.outputs["Value"], bump.inputs["Height"])
    tree.links.new(height.outputs["Value"], tone.inputs[0])
    tone.inputs[1].default_value = 0.62
    tree.links.new(tone.outputs["Value"], tones.inputs["Fac"])
    tree.links.new(bump.outputs["Normal"], shader.inputs["Normal"])
    tree.links.new(tones.outputs["Color"], shader.inputs["Base Color"])
    shader.inputs["Roughness"].default_value = 0.95
    shader.inputs["Specular IOR Level"].default_value = 0.2
    _note(material, colour)
    return material


def leaf(name: str, colour: Colour) -> bpy.types.Material:
    """Leaves that let light through; each leaf and each tree has its own shade of green."""
    material, shader = _principled(name)
    tree = material.node_tree
    number = tree.nodes.new("ShaderNodeAttribute")
    number.attribute_name = "leaf"
    shade = tree.nodes.new("ShaderNodeTexWhiteNoise")
    shade.noise_dimensions = "1D"
    tones = _ramp(tree, *_tones(LEAF_TONES, colour))
    tones.name = LEAF_TONES
    through = tree.nodes.new("ShaderNodeBsdfTranslucent")
    mix = tree.nodes.new("ShaderNodeMixShader")
    mix.inputs["Fac"].default_value = 0.4
    tree.links.new(number.outputs["Fac"], shade.inputs["W"])
    tree.links.new(shade.outputs["Value"], tones.inputs["Fac"])
    tree.links.new(tones.outputs["Color"], shader.inputs["Base Color"])
    tree.links.new(tones.outputs["Color"], through.inputs["Color"])
    tree.links.new(shader.outputs["BSDF"], mix.inputs[1])
    tree.links.new(through.outputs["BSDF"], mix.inputs[2])
    tree.links.new(mix.outputs["Shader"], _output(tree).inputs["Surface"])
    shader.inputs["Roughness"].default_value = 0.55
    _note(material, colour)
    return material


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


def _principled(name: str) -> tuple[bpy.types.Material, bpy.types.Node]:
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # Blender 5 makes it with the material
        material.use_nodes = True
    nodes = material.node_tree.nodes
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
