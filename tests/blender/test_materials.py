"""Bark and leaves as nodes: every texture is whole, small, and made anew when the species' bark changes."""

import bpy
import pytest

from forest_addon import spec
from forest_addon.blender.scene import materials
from forest_addon.blender.scene.materials import TEXTURES

COLOUR = (0.2, 0.15, 0.1)


def reached(material):
    """Nodes that the surface depends on."""
    tree = material.node_tree
    ahead = [n for n in tree.nodes if n.type == "OUTPUT_MATERIAL"]
    seen = set()
    while ahead:
        node = ahead.pop()
        if node.name not in seen:
            seen.add(node.name)
            ahead += [link.from_node for socket in node.inputs for link in socket.links]
    return seen


def test_every_texture_of_the_settings_is_there():
    choices = spec.param_of(spec.Bark.__dataclass_fields__["texture"]).choices
    assert set(choices) == set(TEXTURES)


@pytest.mark.medium
@pytest.mark.parametrize("texture", TEXTURES)
def test_a_bark_is_nodes_alone_and_all_of_them_count(empty_blender, texture):
    coat = spec.Bark(texture=texture, upper_from=0.4, moss=0.3)
    bark = materials.bark("bark", COLOUR, coat)
    shader = bark.node_tree.nodes["Principled BSDF"]
    assert shader.inputs["Base Color"].is_linked
    assert shader.inputs["Normal"].is_linked
    assert not bpy.data.images
    assert all(link.is_valid for link in bark.node_tree.links)
    assert len(reached(bark)) > 0.9 * len(bark.node_tree.nodes)
    assert len(bark.node_tree.nodes) < 120
    ramp = bark.node_tree.nodes[materials.BARK_TONES].color_ramp.elements
    assert ramp[0].color[0] < COLOUR[0] < ramp[-1].color[0]


def test_needles_have_no_veins(empty_blender):
    broad, needle = (materials.leaf(veins, COLOUR, veins) for veins in ("feather", "none"))
    assert any(node.type == "BSDF_TRANSLUCENT" for node in needle.node_tree.nodes)
    assert len(reached(needle)) < len(reached(broad))


def test_a_bark_is_made_anew_in_place(empty_blender):
    bark = materials.bark("bark", COLOUR, spec.Bark(texture="smooth"))
    was = bark[materials.STYLE_KEY]
    again = materials.bark("bark", COLOUR, spec.Bark(texture="plated"), into=bark)
    fresh = materials.bark("fresh", COLOUR, spec.Bark(texture="plated"))
    assert again == bark
    assert bark[materials.STYLE_KEY] != was
    assert len(bark.node_tree.nodes) == len(fresh.node_tree.nodes)
    assert len(bark.node_tree.links) == len(fresh.node_tree.links)
