"""Files with the first node groups. data/first-nodes.blend was saved with them, in Blender 4.5.

Six trees as points of one object, a cloud that was coloured by distance with points of 70 mm, an echo.
"""

from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.blender.scene import nodes
from forest_addon.blender.scene.instances import read_points
from forest_addon.blender.scene.layout import CLOUD_KEY, COLOUR_BY, RADIUS, SHARE, TREES, find_part
from forest_addon.ui.overlay import seen_points

from .pressing import run
from .test_panels import drawn

FIRST = Path(__file__).with_name("data") / "first-nodes.blend"


@pytest.fixture
def first(registered):
    bpy.ops.wm.open_mainfile(filepath=str(FIRST))
    yield bpy.context.scene
    bpy.ops.wm.read_factory_settings(use_empty=True)


def placed(thing):
    depsgraph = bpy.context.evaluated_depsgraph_get()
    depsgraph.update()
    return read_points(thing.evaluated_get(depsgraph))


def trees(scene):
    (thing,) = find_part(scene, TREES).objects
    return thing


def cloud():
    return next(t for t in bpy.data.objects if t.get(CLOUD_KEY) == "cloud")


def test_its_trees_stand_as_they_stood_and_in_the_new_group_too(first):
    thing = trees(first)
    (modifier,) = thing.modifiers
    was = placed(thing)
    assert (modifier.node_group.name, len(was)) == ("Forest Instancer", 6)
    libraries = [nodes._input(modifier, name)[0] for name in (nodes.VARIANTS, nodes.OUTLINES)]
    thing.modifiers.remove(modifier)
    nodes.give_instancer(thing, *libraries, light=False)
    assert thing.modifiers[0].node_group.name == nodes.INSTANCER
    now = placed(thing)
    assert now.transform.tobytes() == was.transform.tobytes()
    assert [s.name for s in now.source] == [s.name for s in was.source]
    for column in ("index", "tree", "species"):
        assert (getattr(now, column) == getattr(was, column)).all()


def test_light_views_of_the_first_group_are_read_in_full(first):
    thing = trees(first)
    nodes.set_input(thing.modifiers[0], nodes.LIGHT, True)
    assert {source.name[-7:] for source in placed(thing).source} == {"outline"}
    depsgraph = bpy.context.evaluated_depsgraph_get()
    with nodes.in_full(depsgraph):
        inside = read_points(thing.evaluated_get(depsgraph))
        assert "outline" not in {source.name[-7:] for source in inside.source}
    assert nodes.is_light(thing.modifiers[0])


@pytest.mark.medium
def test_its_cloud_is_drawn_and_takes_new_points_as_it_is(first):
    thing = cloud()
    (modifier,) = thing.modifiers
    group = modifier.node_group
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    position, colour, _ = seen_points(thing.evaluated_get(depsgraph))
    assert len(position) == len(thing.data.vertices) > 400
    assert len(np.unique(colour.round(3), axis=0)) > 50  # by distance
    assert {"Distance", "Radius"} <= {nodes.chosen_input(modifier, COLOUR_BY), *drawn()}
    assert run("cloud") == {"FINISHED"}
    assert (cloud(), list(thing.modifiers)) == (thing, [modifier])
    assert modifier.node_group == group
    assert nodes.chosen_input(modifier, COLOUR_BY) == "Distance"
    assert nodes._input(modifier, RADIUS)[0] == pytest.approx(0.07)


@pytest.mark.medium
def test_a_new_cloud_in_such_a_file_has_the_new_inputs(first):
    bpy.data.objects.remove(cloud())
    assert run("cloud") == {"FINISHED"}
    assert nodes.has_input(cloud().modifiers[0], SHARE)
