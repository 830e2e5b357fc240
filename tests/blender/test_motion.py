"""A sonar that follows something in Blender: keyframes, parents, curves."""

from __future__ import annotations

import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.blender.sensors.motion import follow
from forest_addon.spec import Sonar, SpecError


@pytest.fixture
def bat(empty_blender):
    """An empty that flies 4 m along Y in frames 1 to 25, turning by 90°; 24 frames a second."""
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end, scene.render.fps = 1, 25, 24
    thing = bpy.data.objects.new("Bat", None)
    scene.collection.objects.link(thing)
    for frame, y, turn in ((1, 0.0, 0.0), (25, 4.0, math.pi / 2)):
        thing.location, thing.rotation_euler = (1, y, 2), (0, 0, turn)
        thing.keyframe_insert("location", frame=frame)
        thing.keyframe_insert("rotation_euler", frame=frame)
    for curve in curves_of(thing):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
        curve.extrapolation = "LINEAR"
    return thing


def curves_of(thing):
    action = thing.animation_data.action
    if hasattr(action, "fcurves"):
        return action.fcurves
    return action.layers[0].strips[0].channelbags[0].fcurves


def test_an_animated_object_over_the_frames(bat):
    bpy.context.scene.frame_set(7)
    poses = follow(bpy.context.scene, Sonar(follow="Bat", poses=5))
    np.testing.assert_allclose(
        [p.position for p in poses], [[1, y, 2] for y in range(5)], atol=1e-5
    )
    for number, pose in enumerate(poses):
        angle = math.radians(22.5 * number)
        np.testing.assert_allclose(pose.frame[0], [math.cos(angle), math.sin(angle), 0], atol=1e-6)
        np.testing.assert_allclose(pose.frame @ pose.frame.T, np.eye(3), atol=1e-6)
        np.testing.assert_allclose(pose.velocity, [0, 4, 0], atol=1e-3)  # 4 m in 24 frames
    assert bpy.context.scene.frame_current == 7


def test_a_child_moves_with_its_parent(bat):
    child = bpy.data.objects.new("Nose", None)
    bpy.context.scene.collection.objects.link(child)
    child.parent, child.location = bat, (0.5, 0, 0)
    poses = follow(bpy.context.scene, Sonar(follow="Nose", poses=2))
    np.testing.assert_allclose(poses[0].position, [1.5, 0, 2], atol=1e-6)
    np.testing.assert_allclose(poses[1].position, [1.0, 4.5, 2], atol=1e-5)


def test_along_a_curve(empty_blender):
    data = bpy.data.curves.new("Way", "CURVE")
    data.dimensions = "3D"
    spline = data.splines.new("POLY")
    spline.points.add(2)
    for point, place in zip(spline.points, ((0, 0, 0), (3, 0, 0), (3, 3, 0)), strict=True):
        point.co = (*place, 1)
    thing = bpy.data.objects.new("Way", data)
    thing.location = (0, 0, 5)
    bpy.context.scene.collection.objects.link(thing)
    bpy.context.view_layer.update()
    poses = follow(bpy.context.scene, Sonar(follow="Way", poses=5, speed=2.0))
    expected = [[0, 0, 5], [1.5, 0, 5], [3, 0, 5], [3, 1.5, 5], [3, 3, 5]]
    np.testing.assert_allclose([p.position for p in poses], expected, atol=1e-5)
    np.testing.assert_allclose(poses[1].frame[0], [1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(poses[4].velocity, [0, 2, 0], atol=1e-6)
    aside = follow(bpy.context.scene, Sonar(follow="Way", poses=3, azimuth_deg=90.0))
    np.testing.assert_allclose(aside[0].frame[0], [0, 1, 0], atol=1e-6)


def test_what_cannot_be_followed(empty_blender):
    with pytest.raises(SpecError, match="no object"):
        follow(bpy.context.scene, Sonar(follow="Nobody"))
    thing = bpy.data.objects.new("Dot", bpy.data.curves.new("Dot", "CURVE"))
    bpy.context.scene.collection.objects.link(thing)
    with pytest.raises(SpecError, match="no length"):
        follow(bpy.context.scene, Sonar(follow="Dot"))
