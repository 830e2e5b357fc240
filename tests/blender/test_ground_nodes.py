"""A ground to the horizon: views show what is around the forest, sensors all of it."""

from dataclasses import fields, replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import spec
from forest_addon.blender.scene.forest import build
from forest_addon.blender.scene.layout import GROUND_NAME, part
from forest_addon.blender.scene.nodes import GROUP
from forest_addon.blender.sensors.observe import Observer
from forest_addon.stand.forest import grow_forest

HORIZON = spec.Scene(forest=spec.Forest(size=(36.0, 20.0), origin=(5.0, -3.0), margin=1000.0))


def plant(settings=HORIZON):
    build(bpy.context.scene, settings, grow_forest(settings, []))
    return part(bpy.context.scene, GROUND_NAME).objects["Ground"]


def near(settings=HORIZON):
    return replace(settings, forest=replace(settings.forest, margin=20.0))


def box(thing):
    """Corners of what a view shows, which View All frames."""
    bpy.context.view_layer.update()
    corners = np.array(thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).bound_box)
    return corners.min(axis=0), corners.max(axis=0)


def read():
    """All that sensors are given of a scene."""
    found = Observer(bpy.context.evaluated_depsgraph_get()).geometry
    arrays = [getattr(found, f.name) for f in fields(found) if f.name != "meshes"]
    for mesh in found.meshes:
        arrays += [mesh.vertices, mesh.triangles, mesh.part]
    return [array.tobytes() if isinstance(array, np.ndarray) else repr(array) for array in arrays]


def rock():
    """What comes before the ground by its name, and so among instances."""
    data = bpy.data.meshes.new("a rock")
    data.from_pydata([(0, 0, 1), (1, 0, 1), (0, 1, 2)], [], [(0, 1, 2)])
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("a rock", data))


def test_views_show_a_quarter_of_the_field_around_it(empty_blender):
    low, high = box(plant())
    assert low == pytest.approx([5 - 9, -3 - 9, 0])
    assert high == pytest.approx([5 + 36 + 9, -3 + 20 + 9, 0])


def test_sensors_are_given_the_same_bytes_as_without_the_nodes(empty_blender):
    rock()
    ground = plant()
    with_nodes, shown = read(), box(ground)
    assert (box(ground)[1] == shown[1]).all()  # views are as they were
    assert ground.modifiers[0].show_viewport
    ground.modifiers.clear()
    assert with_nodes == read()
    assert box(ground)[1] == pytest.approx([1041, 1017, 0])


def test_a_near_ground_has_no_nodes_and_what_was_taken_away_stays_away(empty_blender):
    assert not plant(near()).modifiers
    assert [m.name for m in plant().modifiers] == [GROUP]
    assert [m.name for m in plant().modifiers] == [GROUP]
    assert not plant(near()).modifiers
    plant().modifiers.clear()
    assert not plant().modifiers
