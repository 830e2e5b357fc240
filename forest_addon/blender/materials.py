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
    """Rough bark: two tones in noise stretched along the stem, with a bump."""
    material, shader = _principled(name)
    tree = material.node_tree
    place = tree.nodes.new("ShaderNodeTexCoord")
    stretch = tree.nodes.new("ShaderNodeMapping")
    stretch.inputs["Scale"].default_value = (14.0, 14.0, 3.0)
    noise = tree.nodes.new("ShaderNodeTexNoise")
    noise.inputs["Scale"].default_value = 1.0
    noise.inputs["Detail"].default_value = 6.0
    bump = tree.nodes.new("ShaderNodeBump")
    bump.inputs["Strength"].default_value = 0.6
    bump.inputs["Distance"].default_value = 0.02
    tones = _ramp(tree, *_tones(BARK_TONES, colour))
    tones.name = BARK_TONES
    tree.links.new(place.outputs["Object"], stretch.inputs["Vector"])
    tree.links.new(stretch.outputs["Vector"], noise.inputs["Vector"])
    tree.links.new(noise.outputs["Fac"], tones.inputs["Fac"])
    tree.links.new(noise.outputs["Fac"], bump.inputs["Height"])
    tree.links.new(bump.outputs["Normal"], shader.inputs["Normal"])
    tree.links.new(tones.outputs["Color"], shader.inputs["Base Color"])
    shader.inputs["Roughness"].default_value = 0.9
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
    """Grass and litter in patches."""
    material, shader = _principled(name)
    tree = material.node_tree
    place = tree.nodes.new("ShaderNodeTexCoord")
    patches = tree.nodes.new("ShaderNodeTexNoise")
    patches.inputs["Scale"].default_value = 0.25
    patches.inputs["Detail"].default_value = 12.0
    patches.inputs["Roughness"].default_value = 0.75
    tones = _ramp(tree, (0.115, 0.08, 0.04), (0.10, 0.125, 0.035), 0.36, 0.62)
    fine = tree.nodes.new("ShaderNodeTexNoise")
    fine.inputs["Scale"].default_value = 9.0
    fine.inputs["Detail"].default_value = 8.0
    fine.inputs["Roughness"].default_value = 0.8
    shade = tree.nodes.new("ShaderNodeMix")
    shade.data_type, shade.blend_type = "RGBA", "OVERLAY"
    shade.inputs[0].default_value = 0.75
    bump = tree.nodes.new("ShaderNodeBump")
    bump.inputs["Distance"].default_value = 0.15
    tree.links.new(place.outputs["Object"], patches.inputs["Vector"])
    tree.links.new(patches.outputs["Fac"], tones.inputs["Fac"])
    tree.links.new(place.outputs["Object"], fine.inputs["Vector"])
    tree.links.new(fine.outputs["Fac"], bump.inputs["Height"])
    tree.links.new(bump.outputs["Normal"], shader.inputs["Normal"])
    tree.links.new(tones.outputs["Color"], shade.inputs[6])
    tree.links.new(fine.outputs["Fac"], shade.inputs[7])
    tree.links.new(shade.outputs[2], shader.inputs["Base Color"])
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
