"""Hills beyond a forest are seen in pictures, and by no sensor."""

import bpy
import numpy as np

from forest_addon.blender.read.depsgraph import read_scene
from forest_addon.blender.show.preview import HORIZON, RINGS, lay_horizon


def hills():
    return [thing for thing in bpy.context.scene.objects if thing.name.startswith(HORIZON)]


def test_hills_are_rendered_and_met_by_no_sensor(empty_blender):
    scene = bpy.context.scene
    for _ in range(2):  # laid again they stand in place of the first
        lay_horizon(scene, np.array([5.0, 7.0]), 20.0, 3.0)
    assert len(hills()) == len(RINGS) + 1  # and the plain
    for thing in hills():
        thing.hide_viewport = False  # else the depsgraph would not hold them anyway
        assert not thing.hide_render
    bpy.context.view_layer.update()
    assert len(read_scene(bpy.context.evaluated_depsgraph_get())) == 0
    plain, *rings = sorted(hills(), key=lambda thing: len(thing.data.vertices))
    assert max(corner.co.z for corner in plain.data.vertices) < 3.0
    for thing, (beyond, high, _) in zip(rings, RINGS, strict=True):
        place = np.array([corner.co for corner in thing.data.vertices])
        away = np.hypot(*(place[:, :2] - [5.0, 7.0]).T)
        np.testing.assert_allclose(away, 20.0 + beyond, rtol=1e-5)
        assert place[:, 2].min() < 3.0 < place[:, 2].max() < 3.0 + 2 * high


def test_farther_hills_are_paler(empty_blender):
    lay_horizon(bpy.context.scene, np.zeros(2), 10.0, 0.0)
    shades = []
    for thing in hills():
        if thing.name.endswith("plain"):
            continue
        nodes = thing.data.materials[0].node_tree.nodes
        glow = next(node for node in nodes if node.type == "EMISSION")
        shades.append(sum(glow.inputs["Color"].default_value[:3]))
    assert shades == sorted(shades)
    assert shades[0] < 0.8 * shades[-1]
