"""Frame ranges that are kept in the file: the timeline shows each frame's points."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.animation import curves_of

from forest_addon.blender.scene.layout import CLOUD_KEY
from forest_addon.blender.scene.nodes import set_input

from ..pressing import add_cube, press, run


@pytest.fixture
def moving(props, sensor):
    """A scanner, and a cube that goes 1 m along X in every frame."""
    cube = add_cube()
    for frame in (1, 3):
        cube.location.x = frame
        cube.keyframe_insert("location", frame=frame)
    for curve in curves_of(cube):
        for key in curve.keyframe_points:
            key.interpolation = "LINEAR"
    sensor("terrestrial", name="cloud", position=(2, -5, 0.5), angle_step_deg=2)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 3
    scene.frame_set(1)
    return props


def cloud():
    return next(thing for thing in bpy.data.objects if CLOUD_KEY in thing)


def middle():
    """Of the points along X."""
    data = cloud().data
    place = np.empty(3 * len(data.vertices), np.float32)
    data.attributes["position"].data.foreach_get("vector", place)
    return float(np.median(place[::3]))


@pytest.mark.medium
def test_each_frame_shows_its_points(moving):
    assert run("cloud", frames="RANGE", keep=True) == {"FINISHED"}
    assert [each.frame for each in moving.results["cloud"].frames] == [1, 2, 3]
    found = {}
    for frame in (3, 1, 2, 1, 9, 0):
        bpy.context.scene.frame_set(frame)
        found[frame] = middle()
    assert [found[frame] - found[1] for frame in (2, 3)] == pytest.approx([1, 2], abs=0.35)
    assert (found[9], found[0]) == (found[3], found[1])
    assert len([thing for thing in bpy.data.objects if CLOUD_KEY in thing]) == 1


@pytest.mark.medium
def test_what_was_done_to_the_points_stays_over_frames(moving):
    run("cloud")
    thing = cloud()
    mine = bpy.data.materials.new("mine")
    thing.data.materials[0] = mine
    set_input(thing.modifiers[0], "Radius", 0.07)
    run("cloud", frames="RANGE", keep=True)
    for frame in (1, 2, 3):
        bpy.context.scene.frame_set(frame)
        assert cloud() == thing
        assert list(thing.data.materials) == [mine]


@pytest.mark.slow
def test_the_last_run_alone_is_kept(moving):
    run("cloud", frames="RANGE", keep=True)
    bpy.context.scene.frame_start = 2
    run("cloud", frames="RANGE", keep=True)
    assert [each.frame for each in moving.results["cloud"].frames] == [2, 3]
    assert len([mesh for mesh in bpy.data.meshes if "cube" not in mesh.name]) == 2
    run("cloud")
    assert not moving.results["cloud"].frames
    assert len([mesh for mesh in bpy.data.meshes if "cube" not in mesh.name]) == 1
    bpy.context.scene.frame_set(3)
    here = middle()
    bpy.context.scene.frame_set(1)
    assert middle() == here  # one run of one frame stands still


@pytest.mark.medium
def test_removing_a_result_removes_its_frames(moving):
    before = len(bpy.data.objects), len(bpy.data.meshes), len(bpy.data.images)
    run("cloud", frames="RANGE", keep=True)
    press("remove_result", result="cloud")
    assert (len(bpy.data.objects), len(bpy.data.meshes), len(bpy.data.images)) == before


@pytest.mark.medium
def test_a_kept_frame_costs_little_beside_its_points(moving):
    """The pixels of a picture, 3 MB, are in memory only while they are looked at."""
    run("cloud", frames="RANGE", keep=True)
    pictures = [each.picture for each in moving.results["cloud"].frames]
    assert len(set(pictures)) == 3
    assert not any(picture.has_data for picture in pictures)
    assert all(picture.packed_file.size < 1e5 for picture in pictures)
    pixels = np.array(pictures[0].pixels[:])
    assert 0.01 < pixels.mean() < 0.99
    assert len(pixels) == 4 * np.prod(pictures[0].size)
