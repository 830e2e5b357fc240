"""Scans of what changes its shape, comes and goes: closed forms through Blender."""

import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.animation import curves_of

from forest_addon import api as forest

from .test_motion import FAN, FAR, RATE, hide, keyed, scene, ways  # noqa: F401

TILT = 0.4  # m a metre and second
SECONDS = 4
LAST = 1 + 24 * SECONDS
ENGINES = ("embree", "bvhtree")


def scan(engine="auto", **changes):
    return forest.current(forest.Scene(rays=forest.Rays(engine=engine))).scan(
        FAN.changed(**changes)
    )


def on_plate(result):
    names = np.array(forest.current().objects)
    return names[result.found.returns.instance] == "plate"


def tilted():
    """The plate's shape key by which x = FAR + TILT t y; its local z is the world's x, its y the world's."""
    plate = bpy.data.objects["plate"]
    plate.shape_key_add(name="Basis")
    key = plate.shape_key_add(name="tilted")
    for point in key.data:
        point.co.z += TILT * SECONDS * point.co.y
    key.value = 0.0
    keyed_key(key)


def keyed_key(key):
    for frame, value in ((1, 0.0), (LAST, 1.0)):
        key.value = value
        key.keyframe_insert("value", frame=frame)
    curves = curves_of(key.id_data)
    for point in curves[0].keyframe_points:
        point.interpolation = "LINEAR"


@pytest.mark.medium
@pytest.mark.parametrize("engine", ENGINES)
def test_a_plate_that_a_shape_key_tilts_is_met_as_it_is(scene, engine):  # noqa: F811
    tilted()
    scene.frame_set(1)
    result = scan(engine)
    cloud, way, mine = result.found, ways(result.found), on_plate(result)
    expected = FAR / (way[:, 0] - TILT * cloud.time * way[:, 1])
    y = expected * way[:, 1]
    sure = (np.abs(np.abs(y) - 1) > 0.01) & (np.abs(np.abs(expected * way[:, 2]) - 1) > 0.01)
    inside = (np.abs(y) < 1) & (np.abs(expected * way[:, 2]) < 1)
    assert np.array_equal(mine[sure], inside[sure])
    assert mine.sum() > 300
    assert np.abs(cloud.true_range - expected)[mine & sure].max() < 2e-6  # single precision of keys
    tilt = TILT * cloud.time[mine]
    normal = np.column_stack([np.ones(len(tilt)), -tilt, 0 * tilt]) / np.hypot(1, tilt)[:, None]
    along = np.abs((cloud.returns.normal[mine] * normal).sum(axis=1))
    assert np.allclose(along, 1, atol=1e-6)
    speed = np.column_stack([TILT * y, 0 * y, 0 * y])[mine]
    assert np.allclose(result.motion["velocity"][mine], speed, rtol=1e-4, atol=1e-5)
    rest = np.column_stack([np.full(len(y), FAR), y, expected * way[:, 2]])[mine]
    assert np.allclose(result.motion["rest"][mine], rest, atol=1e-4)
    assert result.audit.kept
    assert result.audit.checked > 20
    assert not any("off between frames" in words for words in result.warnings)


@pytest.mark.medium
@pytest.mark.parametrize("engine", ENGINES)
def test_a_plate_that_a_bone_turns_is_met_as_it_turns(scene, engine):  # noqa: F811
    """Points go on circles, straight between samples: within a tenth of a millimetre."""
    plate = bpy.data.objects["plate"]
    plate.rotation_euler = (0, math.pi / 2, 0)
    bpy.ops.object.armature_add(location=(FAR, 0, 0))
    frame = bpy.context.object
    group = plate.vertex_groups.new(name="Bone")
    group.add(list(range(4)), 1.0, "REPLACE")
    plate.modifiers.new("Armature", "ARMATURE").object = frame
    bone = frame.pose.bones["Bone"]
    bone.rotation_mode = "XYZ"  # the bone's own Y is the world's Z
    for at, turn in ((1, 0.0), (LAST, RATE * SECONDS)):
        bone.rotation_euler = (0, turn, 0)
        bone.keyframe_insert("rotation_euler", frame=at)
    curves = curves_of(frame)
    for curve in curves:
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    scene.frame_set(1)
    result = scan(engine)
    cloud, way, mine = result.found, ways(result.found), on_plate(result)
    turn = RATE * cloud.time
    normal = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    expected = FAR * normal[:, 0] / (way * normal).sum(axis=1)
    assert mine.sum() > 100
    off = np.abs(cloud.true_range - expected)[mine]
    assert 1e-7 < off.max() < 3e-4  # along the ray, not across the plate
    arm = cloud.position[mine] - (FAR, 0, 0)
    spin = np.cross((0, 0, RATE), arm)
    assert np.allclose(result.motion["velocity"][mine], spin, rtol=0.02, atol=0.02)
    assert result.audit.kept


@pytest.mark.slow
def test_engines_meet_the_same_where_a_net_waves(scene):  # noqa: F811
    """A modifier that depends on time, on a body that flies and turns meanwhile."""
    bpy.data.objects.remove(bpy.data.objects["plate"])
    bpy.ops.mesh.primitive_grid_add(
        x_subdivisions=16, y_subdivisions=16, size=4, location=(FAR, 0, 0)
    )
    net = bpy.context.object
    net.rotation_euler = (0.2, math.pi / 2, 0)
    wave = net.modifiers.new("Wave", "WAVE")
    wave.height, wave.width, wave.narrowness, wave.speed = 0.3, 0.8, 1.5, 0.2
    keyed(net, "location", [(FAR, 0, 0), (FAR - 3, 1, 0.5)], (1, LAST))
    keyed(net, "rotation_euler", [(0.2, math.pi / 2, 0), (0.7, 1.2, 1)], (1, LAST))
    scene.frame_set(1)
    one, other = (scan(engine) for engine in ENGINES)
    assert np.linalg.norm(one.motion["velocity"], axis=1).max() > 0.5
    apart = np.abs(one.found.true_range - other.found.true_range)
    assert (apart > 1e-9).mean() < 0.002  # rays at edges
    assert one.audit.kept
    assert other.audit.kept


@pytest.mark.parametrize("engine", ENGINES)
def test_what_vanishes_and_comes_back_is_met_while_it_is_there(scene, engine):  # noqa: F811
    plate = bpy.data.objects["plate"]
    plate.scale = (8, 8, 8)
    hide(plate, {1: False, 13: True, 25: False})
    scene.frame_set(1)
    result = scan(engine)
    time = result.found.time
    there = (time < 0.5) | (time >= 1.0)
    assert np.array_equal(on_plate(result), there)
    assert not result.motion["velocity"].any()
    assert result.audit.kept


@pytest.mark.medium
@pytest.mark.parametrize("engine", ENGINES)
def test_other_triangles_are_met_from_their_frame_on(scene, engine):  # noqa: F811
    """An array modifier that makes two plates of one at frame 21, the second at half the distance."""
    plate = bpy.data.objects["plate"]
    array = plate.modifiers.new("Array", "ARRAY")
    array.use_relative_offset, array.use_constant_offset = False, True
    array.constant_offset_displace = (0, 0, -FAR / 2)  # the plate's z is the world's x
    for frame, count in ((1, 1), (21, 2)):
        array.count = count
        array.keyframe_insert("count", frame=frame)
    curves = curves_of(plate)
    for point in curves[0].keyframe_points:
        point.interpolation = "CONSTANT"
    scene.frame_set(1)
    result = scan(engine)
    cloud, way = result.found, ways(result.found)
    begins = 20 / 24
    place = np.where(cloud.time < begins, FAR, FAR / 2)
    at = place[:, None] / way[:, :1] * way
    sure = (np.abs(np.abs(at[:, 1:]) - 1) > 0.02).all(axis=1)
    far = FAR / way[:, :1] * way
    behind = (np.abs(far[:, 1:]) < 1.02).all(axis=1)
    inside = (np.abs(at[:, 1:]) < 1).all(axis=1)
    assert np.array_equal(on_plate(result)[sure & ~behind], inside[sure & ~behind])
    met = sure & inside
    assert met[cloud.time > begins].sum() > 100
    assert met[cloud.time < begins].sum() > 50
    assert np.abs(cloud.true_range - place / way[:, 0])[met].max() < 1e-5
    later = met & (cloud.time > begins)
    assert np.isnan(result.motion["rest"][later]).all()
    assert "blur" not in str(result.summary()) or "nan" not in str(result.summary())
    assert result.audit.kept


def test_what_waves_and_stands_at_rest_is_a_still_scene(scene):  # noqa: F811
    """A key that is there and never used: evaluated anew at every frame, and always the same."""
    tilted()
    key = bpy.data.objects["plate"].data.shape_keys
    key.animation_data_clear()
    key.key_blocks[1].value = 0.0
    scene.frame_set(1)
    still, moving = (forest.current().scan(FAN.changed(motion=m)) for m in (False, True))
    assert np.array_equal(still.points, moving.points)
    assert not moving.motion["velocity"].any()


def test_the_report_says_how_far_the_tops_of_trees_are_off_their_rest():
    from forest_addon.results.scanner import _of_tops

    tree, height = np.array([-1, 3, 3, 5, 5]), np.array([9.0, 1, 2, 4, 5])
    (figure,) = _of_tops(tree, height, np.array([9.0, 1, 0.02, 0.3, 0.04]))
    assert figure.text == "3 cm (median of 2 trees), at most 4 cm"
    assert _of_tops(tree[:1], height[:1], np.ones(1)) == []
