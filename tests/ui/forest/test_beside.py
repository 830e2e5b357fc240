"""A forest beside the start cube is the same forest, with its sensors, moved."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.base.places import ASSETS
from forest_addon.formats.toml_file import read_settings
from forest_addon.site import ForestSite
from forest_addon.spec import Scene
from forest_addon.ui.forest import scene_file
from forest_addon.ui.forest.start import GALLERY

WAY = np.array((11.0, -18.0))


@pytest.mark.slow
@pytest.mark.parametrize("preset", [card.preset for card in GALLERY])
def test_trees_and_sensors_keep_their_places_among_each_other(preset):
    path = ASSETS / "scenes" / f"{preset}.toml"
    there = read_settings(path, Scene)
    assert not scene_file._is_bound(there)
    moved = scene_file.moved(there, tuple(WAY))
    stands = [ForestSite.read(s, path.parent).plan() for s in (there, moved)]
    assert len(stands[0]) == len(stands[1]) > 0
    np.testing.assert_allclose(
        stands[1].position[:, :2], stands[0].position[:, :2] + WAY, atol=1e-6
    )
    for before, after in zip(there.sensors, moved.sensors, strict=True):
        several = before.kind == "mobile"
        poses = zip(before.poses, after.poses, strict=True) if several else ()
        for one, other in ((before, after), *poses):
            for name in ("position", "source", "receiver"):
                if isinstance(getattr(one, name, None), tuple):
                    way = np.subtract(getattr(other, name), getattr(one, name))
                    np.testing.assert_allclose(way, (*WAY, 0.0), atol=1e-9)


def test_only_the_cube_of_a_new_file_in_a_window_moves_a_forest(empty_blender, monkeypatch):
    demo = read_settings(ASSETS / "scenes" / "demo.toml", Scene)
    scene = bpy.context.scene
    assert scene_file.beside_cube(scene, demo) == demo
    bpy.ops.mesh.primitive_cube_add()
    assert scene_file.beside_cube(scene, demo) == demo  # no window
    assert scene_file._is_start(scene)
    scene.objects["Cube"].location.x = 3.0
    assert not scene_file._is_start(scene)
