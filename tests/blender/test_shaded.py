"""The picture that is drawn by rays: what it must show of a scene that can be worked out by hand."""

import bpy
import numpy as np
import pytest
from PIL import Image

from forest_addon.blender.sensors.observe import Observer
from forest_addon.blender.show import shaded
from forest_addon.blender.show.preview import SUN, set_stage
from forest_addon.spec import Rays

WIDE, TALL = 160, 80
MIDDLE, REACH = np.array([0.0, 0.0]), 20.0


@pytest.fixture
def wall(empty_blender):
    """A red wall of 4 m by 4 m that faces the camera, on nothing; the sun stands behind the camera."""
    scene = bpy.context.scene
    set_stage(scene, (WIDE, TALL))
    data = bpy.data.meshes.new("wall")
    data.from_pydata([(-2, 0, 0), (2, 0, 0), (2, 0, 4), (-2, 0, 4)], [], [(0, 1, 2, 3)])
    paint = bpy.data.materials.new("red")
    paint.diffuse_color = (0.5, 0.02, 0.02, 1.0)
    data.materials.append(paint)
    scene.collection.objects.link(bpy.data.objects.new("wall", data))
    camera, sun = scene.camera, scene.objects[SUN]
    camera.location, camera.rotation_euler = (0, -10, 2), (np.pi / 2, 0, 0)
    sun.rotation_euler = (np.pi / 4, 0, 0)  # 45 degrees high, in the south
    bpy.context.view_layer.update()
    return scene


def drawn(scene, path, **eye):
    """The picture, its camera moved at the last moment, as a run moves it to where a walker stands."""
    caster = Observer(bpy.context.evaluated_depsgraph_get(), Rays()).caster
    for name, value in eye.items():
        setattr(scene.camera, name, value)
    shaded.draw_scene(scene, caster, path, MIDDLE, REACH, 0.0, lambda done, total: None)
    return np.asarray(Image.open(path), dtype=float)


def test_things_are_where_the_camera_sees_them_and_as_bright_as_the_sun_makes_them(wall, tmp_path):
    picture = drawn(wall, tmp_path / "p.png")
    assert picture.shape == (TALL, WIDE, 3)
    camera = wall.camera.data
    half = (
        2 / 10 * camera.lens / camera.sensor_width * WIDE
    )  # pixels from the middle to the wall's edge
    red = (picture[..., 0] > 1.5 * picture[..., 1]) & (picture[..., 0] > 1.5 * picture[..., 2])
    columns, rows = np.flatnonzero(red.any(axis=0)), np.flatnonzero(red.any(axis=1))
    assert columns.min() == pytest.approx(WIDE / 2 - half, abs=1.5)
    assert columns.max() + 1 == pytest.approx(WIDE / 2 + half, abs=1.5)
    assert rows.min() == pytest.approx(TALL / 2 - half, abs=1.5)
    sky = picture[2, 5]
    assert sky[2] > sky[0]
    lit = picture[TALL // 2, WIDE // 2]
    wall.objects[SUN].rotation_euler = (
        -np.pi / 4,
        0,
        0,
    )  # from behind: only the sky's light is left
    assert lit[0] > 1.5 * drawn(wall, tmp_path / "q.png")[TALL // 2, WIDE // 2, 0]


def test_what_stands_in_the_sun_casts_a_shadow_on_the_plain(wall, tmp_path):
    eye = {"location": (12, 6, 12), "rotation_euler": (np.radians(45), 0, np.pi / 2)}
    bright = drawn(wall, tmp_path / "p.png", **eye).mean(axis=2)
    wall.objects["wall"].location.z = -50.0
    bare = drawn(wall, tmp_path / "q.png", **eye).mean(axis=2)
    darker = bright < 0.75 * bare
    assert 20 < darker.sum() < 0.5 * darker.size


def test_a_picture_is_from_where_the_camera_was_moved_last_and_the_same_again(wall, tmp_path):
    eye = {"location": (6, -8, 3)}
    before, first, again = (
        drawn(wall, tmp_path / name, **at)
        for name, at in (("a.png", {}), ("b.png", eye), ("c.png", {}))
    )
    assert (first == again).all()
    assert (first != before).any()
