"""The contact sheet shows leaves in the colour that their season gives them."""

import bpy
import pytest

from forest_addon.base.rng import stream
from forest_addon.blender.scene.materials import LOOK_KEY
from forest_addon.blender.show.preview import _hang
from forest_addon.growth.tree import grow
from forest_addon.spec import Grammar, Look, Species


@pytest.mark.medium
@pytest.mark.parametrize("autumn", [0.0, 0.5, 1.0])
def test_leaves_turn(empty_blender, autumn):
    look = Look(leaf=(0.1, 0.2, 0.0), autumn=autumn, autumn_leaf=(0.5, 0.3, 0.1))
    plain = Species(name="plain", grammar=Grammar(generations=2), look=look)
    tree = grow(plain, None, stream(1, "sheet"))
    _hang(bpy.context.scene, plain, tree, 0.0, 0.0, 1.0)
    leaf = bpy.context.scene.objects["plain"].data.materials[1]
    expected = (0.1 + 0.4 * autumn, 0.2 + 0.1 * autumn, 0.1 * autumn)
    assert tuple(leaf[LOOK_KEY]) == pytest.approx(expected)
