"""Things so far away that Blender's coordinates are coarse: said, with the remedy."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.base.trimesh import OTHER, TriMesh
from forest_addon.blender.scene.meshes import to_mesh
from forest_addon.blender.sensors.observe import Observer


def look_at(place, corners=None):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    corners = np.array([[0, -1, 0], [0, 1, 0], [0, 1, 2.0]]) if corners is None else corners
    mesh = TriMesh.of_part(np.asarray(corners, float), np.array([[0, 1, 2]]), OTHER)
    thing = bpy.data.objects.new("hut", to_mesh("hut", mesh))
    thing.location = place
    bpy.context.scene.collection.objects.link(thing)
    return Observer(bpy.context.evaluated_depsgraph_get())


@pytest.mark.parametrize("place", [(0, 0, 0), (1000, -2000, 300), (-8000, 0, 0)])
def test_nothing_is_said_of_what_stands_near(place):
    assert look_at(place).warning == ""


@pytest.mark.parametrize(
    ("place", "off"), [((500_000.1, 0, 0), 0.016), ((500_000, 5_400_000.2, 0), 0.25)]
)
def test_what_stands_at_map_coordinates_is_said_to_be_off(place, off):
    seen = look_at(place)
    moved = np.abs(seen.geometry.transform[0, :, 3] - place).max()
    assert 0 < moved <= off * 1.01  # what is said bounds what happened
    assert '"hut"' in seen.warning
    assert f"off by up to {off:g} m" in seen.warning
    assert "offset" in seen.warning


def test_a_mesh_with_map_coordinates_in_it_is_said_too():
    corners = np.add([[0, -1, 0], [0, 1, 0], [0, 1, 2.0]], [500_000.0, 5_400_000.0, 0])
    assert "off by up to 0.25 m" in look_at((0, 0, 0), corners).warning


def test_an_empty_scene_has_nothing_to_say():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert Observer(bpy.context.evaluated_depsgraph_get()).warning == ""
