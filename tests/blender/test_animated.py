"""Scans of animated scenes against every triangle as Blender evaluates it at the pulse's own frame."""

import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.animation import curves_of

from forest_addon import api as forest

from .test_motion import FAN, FAR, keyed, scene, ways  # noqa: F401

FEW = FAN.changed(angle_step_deg=2.0, pulse_rate=250.0)  # 231 pulses, 0.92 s, 22 frames
ENGINES = ["embree", "bvhtree"]


def scan(engine, sensor=FEW):
    return forest.current(forest.Scene(rays=forest.Rays(engine=engine))).scan(sensor)


def at_frame(frame, way):
    """Metres from (0, 0, 0) along a way to the nearest triangle at a frame (Möller & Trumbore)."""
    bpy.context.scene.frame_set(math.floor(frame), subframe=frame - math.floor(frame))
    nearest = math.inf
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        mesh = instance.object.data
        if instance.object.type != "MESH" or not instance.show_self or not len(mesh.polygons):
            continue
        mesh.calc_loop_triangles()
        corner = np.array([v.co for v in mesh.vertices], dtype=float)
        place = np.array(instance.matrix_world, dtype=float)
        corner = corner @ place[:3, :3].T + place[:3, 3]
        a, b, c = corner[[t.vertices[:] for t in mesh.loop_triangles]].swapaxes(0, 1)
        across = np.cross(way, c - a)
        size = ((b - a) * across).sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = (-a * across).sum(axis=1) / size
            up = np.cross(-a, b - a)
            v, far = up @ way / size, ((c - a) * up).sum(axis=1) / size
            met = (u >= 0) & (v >= 0) & (u + v <= 1) & (far > 0.1)
        nearest = min(nearest, far[met].min(initial=math.inf))
    return nearest


def off(cloud, most=30):
    """(N,) metres by which some points of a cloud, most of them nearer than the wall, are off."""
    place = bpy.context.scene
    now = place.frame_current, place.frame_subframe
    near = np.flatnonzero(cloud.true_range < 30)
    rows = np.concatenate([near[:: max(1, len(near) // most)], np.arange(0, len(cloud), 40)])
    frames = place.frame_start + cloud.time * place.render.fps / place.render.fps_base
    way = ways(cloud)
    found = [at_frame(frames[row], way[row]) - cloud.true_range[row] for row in rows]
    place.frame_set(now[0], subframe=now[1])
    assert len(near) > 10
    return np.abs(found)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
def test_particles_that_are_born_meanwhile_have_their_own_shape(scene, engine):  # noqa: F811
    """Spheres before their emitter: those born after the present frame are spheres, too."""
    bpy.data.objects.remove(bpy.data.objects["plate"])
    bpy.ops.mesh.primitive_grid_add(
        x_subdivisions=6,
        y_subdivisions=6,
        size=4,
        location=(FAR, 0, 0),
        rotation=(0, math.pi / 2, 0),
    )
    emitter = bpy.context.object
    bpy.ops.mesh.primitive_uv_sphere_add(segments=8, ring_count=4, radius=0.5, location=(0, 0, -50))
    emitter.modifiers.new("Particles", "PARTICLE_SYSTEM")
    settings = emitter.particle_systems[0].settings
    settings.count, settings.frame_start, settings.frame_end = 12, 1, 20
    settings.render_type, settings.particle_size = "OBJECT", 1.0
    settings.instance_object = bpy.context.object
    settings.normal_factor = -3.0
    scene.frame_set(1)
    result = scan(engine)
    assert np.quantile(off(result.found), 0.9) < 1e-4
    assert any('"Grid" has more or fewer parts' in words for words in result.warnings)


@pytest.mark.medium
@pytest.mark.parametrize("engine", ENGINES)
def test_what_jumps_is_met_at_one_place_or_the_other(scene, engine):  # noqa: F811
    """Constant keys: nothing is met between the places, in no sixteenth of a frame."""
    plate = bpy.data.objects["plate"]
    plate.scale = (30, 30, 30)
    for frame, place in ((1, FAR), (8, FAR - 4), (15, FAR + 2)):
        plate.location.x = place
        plate.keyframe_insert("location", frame=frame)
    curves = curves_of(plate)
    for curve in curves:
        for point in curve.keyframe_points:
            point.interpolation = "CONSTANT"
    scene.frame_set(1)
    rate = 24 * 16 * 8.0  # eight pulses in a sixteenth of a frame
    dense = FAN.changed(angle_step_deg=0.5, pulse_rate=rate)
    result = scan(engine, dense)
    cloud = result.found
    frame = 1 + cloud.time * 24
    place = np.select([frame < 8, frame < 15], [FAR, FAR - 4], FAR + 2)
    assert frame.max() > 16
    assert np.abs(cloud.true_range * ways(cloud)[:, 0] - place).max() < 1e-6
    assert not result.motion["velocity"].any()
    assert not any("off between frames" in words for words in result.warnings)


@pytest.mark.medium
def test_mapped_time_is_that_of_the_scene_and_the_frame_stays(scene):  # noqa: F811
    scene.render.frame_map_old, scene.render.frame_map_new = 100, 150
    scene.render.fps, scene.render.fps_base = 30, 1.001
    plate = bpy.data.objects["plate"]
    plate.scale = (3, 3, 3)
    keyed(plate, "location", [(FAR, 0, 0), (FAR - 6, 0, 0)], (1, 31))
    scene.frame_set(7, subframe=0.25)
    result = scan("embree")
    assert (scene.frame_current, scene.frame_subframe) == (7, 0.25)
    assert off(result.found).max() < 1e-5
    bat = bpy.data.objects.new("bat", None)
    bpy.context.collection.objects.link(bat)
    forest.current().scan(forest.Mobile(follow="bat", pulse_rate=100.0, motion=True))
    assert (scene.frame_current, scene.frame_subframe) == (7, 0.25)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
def test_triangles_that_are_others_at_all_times_are_read_between_frames(scene, engine):  # noqa: F811
    """A block out of which a ball cuts a groove as it passes: 1/16 frame behind at most, and that is said."""
    bpy.data.objects.remove(bpy.data.objects["plate"])
    bpy.ops.mesh.primitive_cube_add(size=3, location=(FAR, 0, 0))
    block = bpy.context.object
    block.name = "block"
    bpy.ops.mesh.primitive_uv_sphere_add(segments=16, ring_count=8, radius=1.2)
    ball = bpy.context.object
    keyed(ball, "location", [(FAR - 1.5, -2, 0), (FAR - 1.5, 2, 0)], (1, 12))
    ball.hide_viewport = True
    cut = block.modifiers.new("Boolean", "BOOLEAN")
    cut.object, cut.operation = ball, "DIFFERENCE"
    scene.frame_set(1)
    result = scan(engine, FEW.changed(pulse_rate=1000.0))  # 6 frames
    assert np.quantile(off(result.found), 0.9) < 4 / 11 / 16  # what the ball goes in a sixteenth
    assert any(
        '"block" is made of other triangles' in words and "2.6 ms" in words
        for words in result.warnings
    )


@pytest.mark.medium
@pytest.mark.parametrize("turns", [1.0, 2.0, 2.03, 4.17])
def test_a_rotor_is_met_as_it_turns(scene, turns):  # noqa: F811
    """Whole turns a frame: at each frame it stands where it stood. More: at each half it is where a slow one
    would be, that turns the other way or less."""
    plate = bpy.data.objects["plate"]
    plate.scale, plate.rotation_euler = (1, 2, 1), (0, math.pi / 2, 0)
    keyed(plate, "delta_rotation_euler", [(0, 0, 0), (0, 0, 2 * math.pi * turns * 100)], (1, 101))
    scene.frame_set(1)
    result = scan("embree", FAN.changed(angle_step_deg=2.0, pulse_rate=2000.0))
    mine = np.array([forest.current().objects[k] == "plate" for k in result.found.returns.instance])
    speed = np.linalg.norm(result.motion["velocity"][mine], axis=1)
    arm = result.found.position[mine] - (FAR, 0, 0)
    rate = 2 * math.pi * turns * 24
    assert off(result.found).max() < 1e-3
    assert np.allclose(speed, rate * np.hypot(arm[:, 0], arm[:, 1]), rtol=0.02)
