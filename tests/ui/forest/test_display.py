"""What views show of a large forest: full trees, stand-ins or dots; sensors see full trees all the same."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.blender.scene import forest as room
from forest_addon.blender.scene.layout import TREES, part
from forest_addon.blender.scene.nodes import shown_of
from forest_addon.growth.mesh.stand_in import LEVELS
from forest_addon.ui.forest.wind import forest_of_points

from ..pressing import press, run, trees


def drawn():
    """Triangles that a view draws of trees, how many instances, and how many dots."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    (thing,) = part(bpy.context.scene, TREES).objects
    geometry = thing.evaluated_get(depsgraph).evaluated_geometry()
    instances = geometry.instances_pointcloud()
    sources = [o.data for o in geometry.instance_references() if hasattr(o, "data")]
    dots = len(geometry.pointcloud.points) if geometry.pointcloud is not None else 0
    return sources, 0 if instances is None else len(instances.points), dots


@pytest.mark.medium
def test_display_says_and_sets_what_views_show(built):
    assert forest_of_points(bpy.context.scene) is None  # objects: nothing to choose
    assert built.display == "FULL"
    built.forest.instancing = "points"
    press("build")
    count = int(built.results["forest"].figures["Trees"].value)
    run("cloud")
    seen = len(bpy.data.objects[built.results["cloud"].shown].data.vertices)
    for display in ("LIGHT", "DOTS", "FULL"):
        built.display = display
        assert shown_of(forest_of_points(bpy.context.scene)) == built.display == display
        sources, instances, dots = drawn()
        assert (instances, dots) == ((0, count) if display == "DOTS" else (count, 0))
        if display == "LIGHT":
            assert all(0 < len(data.polygons) <= LEVELS[0].most for data in sources)
        run("cloud")  # sensors see full trees
        assert len(bpy.data.objects[built.results["cloud"].shown].data.vertices) == seen
    built.display = "DOTS"
    built.seed += 1
    press("build")
    assert built.display == "DOTS"  # what was chosen stays


@pytest.mark.medium
def test_many_triangles_become_points_shown_by_stand_ins(built, monkeypatch):
    assert len(trees()) == 3
    monkeypatch.setattr(room, "SHOWN_IN_FULL", 100)
    press("build")
    assert built.display == "LIGHT"
    assert trees() == []
    built.forest.instancing = "objects"  # asked for: the user's own choice
    press("build")
    assert len(trees()) == 3


def test_triangles_are_counted_as_they_are_drawn(built):
    from forest_addon.site import ForestSite
    from forest_addon.ui.settings import exchange

    forest = ForestSite.read(exchange.to_spec(bpy.context.scene)).grow()
    shown = [len(thing.data.polygons) for thing in trees()]
    assert room.triangles_of(forest) == np.sum(shown)
