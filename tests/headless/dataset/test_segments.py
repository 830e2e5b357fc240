"""Rays through the pixels of a camera, against Blender's own projection and its render."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
from mathutils import Vector

from forest_addon.blender.show.shaded import camera_rays
from headless.dataset.formats import segments_from


@pytest.mark.parametrize(("wide", "high"), [(64, 40), (40, 64), (33, 33)])
@pytest.mark.parametrize("kind", ["AUTO", "HORIZONTAL", "VERTICAL"])
def test_a_point_on_a_pixels_ray_is_projected_to_its_middle(empty_blender, wide, high, kind):
    from bpy_extras.object_utils import world_to_camera_view

    scene = bpy.context.scene
    data = bpy.data.cameras.new("Eye")
    data.lens, data.sensor_fit, data.shift_x, data.shift_y = 24.0, kind, 0.11, -0.07
    eye = bpy.data.objects.new("Eye", data)
    eye.location, eye.rotation_euler = (3.0, -2.0, 5.0), (1.1, 0.2, -0.7)
    scene.collection.objects.link(eye)
    scene.camera = eye
    scene.render.resolution_x, scene.render.resolution_y = wide, high
    scene.render.resolution_percentage = 100
    bpy.context.view_layer.update()
    pixels = np.array([(0, 0), (high - 1, wide - 1), (7, 20), (high // 2, wide // 2)])
    ways = camera_rays(scene, pixels[:, 1] + 0.5, pixels[:, 0] + 0.5)
    for (row, column), way in zip(pixels.tolist(), ways, strict=True):
        seen = world_to_camera_view(scene, eye, Vector(np.array(eye.location) + 9.0 * way))
        assert seen.z > 0
        assert seen.x * wide == pytest.approx(column + 0.5, abs=1e-3)
        assert (1 - seen.y) * high == pytest.approx(row + 0.5, abs=1e-3)


@pytest.mark.slow
def test_segments_are_where_the_render_shows_them(warm, tmp_path):
    """Sky is where Cycles shows it: brighter than anything that stands there."""
    from PIL import Image
    from references.dataset_runs import PLAN

    small = "scene.output={preview_size=[96,64],preview_samples=8}"
    flat = ("--set", "vary.terrain.relief=0.0", "--set", "scene.forest.size=[3.0,3.0]")
    more = ("--set", "count=1", "--set", "keep.preview=true", "--set", small, "--set", "seed=9")
    more += ("--set", "mix.density=0.6", "--set", 'mix.species=["honda-birch","apple-stochastic"]')
    warm.run(PLAN, *more, *flat, "--set", "mix.scale=[0.3,0.5]", "--out", tmp_path / "data")
    folder = tmp_path / "data" / "scenes" / "000000"
    numbers = segments_from((folder / "preview-segments.png").read_bytes())
    shown = np.asarray(Image.open(folder / "preview.png").convert("RGB"), dtype=float)
    sky = shown.min(axis=2) > 140
    void = numbers == 0
    assert 0.02 < void.mean() < 0.98
    assert (sky == void).mean() > 0.93  # edges are blended
    assert {4, 5} <= set((numbers % 8).ravel().tolist())
