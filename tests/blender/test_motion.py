"""Scans of a Blender scene that moves: each pulse meets animated objects where they are at its time."""

import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.scenes import curves_of, hide, keyed, link

from forest_addon import api as forest
from forest_addon.blender.sensors.moving import SceneFollower
from forest_addon.sensing.sonar.station import Equipment, Station
from forest_addon.sensing.sonar.summation import factors

SPEED, RATE, TILT = 3.0, 0.8, 0.4  # m/s, rad/s, m a metre and second
FAR = 12.0
SECONDS = 4
LAST = 1 + 24 * SECONDS
ENGINES = ("embree", "bvhtree")
FAN = forest.Terrestrial(
    position=(0, 0, 0),
    azimuth_deg=(-20, 20),
    elevation_deg=(-10, 10),
    angle_step_deg=0.5,
    pulse_rate=2000.0,
    motion=True,
)


def ways(cloud):
    """(N, 3) unit directions of the pulses of points."""
    level = np.cos(cloud.elevation)
    return np.column_stack(
        [level * np.cos(cloud.azimuth), level * np.sin(cloud.azimuth), np.sin(cloud.elevation)]
    )


def scan(engine="auto", sensor=FAN):
    return forest.current(forest.Scene(rays=forest.Rays(engine=engine))).scan(sensor)


def on_plate(result):
    names = np.array(forest.current().objects)
    return names[result.found.returns.instance] == "plate"


@pytest.fixture
def scene(empty_blender):
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start, scene.frame_end = 24, 1, 100
    bpy.ops.mesh.primitive_plane_add(size=60, location=(40, 0, 0), rotation=(0, math.pi / 2, 0))
    bpy.context.object.name = "wall"
    bpy.ops.mesh.primitive_plane_add(size=2, location=(FAR, 0, 0))
    plate = bpy.context.object
    plate.name, plate.rotation_euler = "plate", (0, math.pi / 2, 0)
    scene.frame_set(1)
    return scene


# How a plate moves. Each gives a closed form: the metres along rays to its plane at their times, where it has
# what they meet at rest, its normal there and its velocity.


def nearing(plate):
    """At x = FAR - SPEED t."""
    keyed(plate, "location", {1: (FAR, 0, 0), LAST: (FAR - 4 * SPEED, 0, 0)})

    def told(way, time):
        distance = (FAR - SPEED * time) / way[:, 0]
        along = np.tile([1.0, 0, 0], (len(way), 1))
        return (
            distance,
            distance[:, None] * way + SPEED * time[:, None] * along,
            along,
            -SPEED * along,
        )

    return told


def tilted(plate):
    """A shape key by which x = FAR + TILT t y; the plate's local z is the world's x, its y the world's."""
    plate.shape_key_add(name="Basis")
    key = plate.shape_key_add(name="tilted")
    for point in key.data:
        point.co.z += TILT * SECONDS * point.co.y
    keyed(key, "value", {1: 0.0, LAST: 1.0})

    def told(way, time):
        tilt = TILT * time
        distance = FAR / (way[:, 0] - tilt * way[:, 1])
        _, y, z = (distance[:, None] * way).T
        normal = np.column_stack([np.ones(len(y)), -tilt, 0 * y]) / np.hypot(1, tilt)[:, None]
        rest = np.column_stack([np.full(len(y), FAR), y, z])
        return distance, rest, normal, np.column_stack([TILT * y, 0 * y, 0 * y])

    return told


def turning(way, time):
    """Of a plate that turns about a vertical axis in its middle."""
    cos, sin = np.cos(RATE * time), np.sin(RATE * time)
    normal = np.column_stack([cos, sin, 0 * cos])
    distance = FAR * cos / (way * normal).sum(axis=1)
    arm = distance[:, None] * way - (FAR, 0, 0)
    rest = np.column_stack([np.full(len(arm), FAR), cos * arm[:, 1] - sin * arm[:, 0], arm[:, 2]])
    return distance, rest, normal, np.cross((0, 0, RATE), arm)


def on_a_hub(plate):
    """Children go along with their parent; Euler keys turn evenly about Z."""
    bpy.ops.object.empty_add(location=(FAR, 0, 0))
    plate.parent, plate.location = bpy.context.object, (0, 0, 0)
    keyed(plate.parent, "rotation_euler", {1: (0, 0, 0), LAST: (0, 0, RATE * SECONDS)})
    return turning


def on_a_bone(plate):
    """Points go on circles, straight between samples: within a tenth of a millimetre."""
    bpy.ops.object.armature_add(location=(FAR, 0, 0))
    frame = bpy.context.object
    plate.vertex_groups.new(name="Bone").add(list(range(4)), 1.0, "REPLACE")
    plate.modifiers.new("Armature", "ARMATURE").object = frame
    bone = frame.pose.bones["Bone"]
    bone.rotation_mode = "XYZ"  # the bone's own Y is the world's Z
    keyed(bone, "rotation_euler", {1: (0, 0, 0), LAST: (0, RATE * SECONDS, 0)})
    return turning


@pytest.mark.medium
@pytest.mark.parametrize(
    ("moves", "engine", "subrays", "most", "loose"),
    [
        *((nearing, engine, 1, 1e-6, 1e-5) for engine in ENGINES),
        *((nearing, engine, 7, 1e-4, 1e-5) for engine in ENGINES),
        *((tilted, engine, 1, 2e-6, 1e-4) for engine in ENGINES),  # single precision of keys
        (on_a_hub, "auto", 1, 2e-5, 1e-3),
        *((on_a_bone, engine, 1, 3e-4, 0.02) for engine in ENGINES),
    ],
)
def test_a_plate_that_moves_is_met_where_it_is(scene, moves, engine, subrays, most, loose):
    """Before a wall that stands. most : what ranges may be off. loose : share that speeds may be."""
    told = moves(bpy.data.objects["plate"])
    scene.frame_set(1)
    beam = forest.Beam(subrays=subrays, divergence_mrad=(0.1, 0.1))
    result = scan(engine, FAN.changed(beam=beam))
    cloud, way, mine = result.found, ways(result.found), on_plate(result)
    assert len(cloud) == 81 * 41
    assert cloud.time.max() > 1.0
    distance, rest, normal, velocity = told(way, cloud.time)
    aside = np.abs(rest[:, 1:]).max(axis=1)
    sure = np.abs(aside - 1) > 0.01  # beams over its edge have two echoes
    assert np.array_equal(mine[sure], (aside < 1)[sure])
    assert mine.sum() > 200
    expected = np.where(mine, distance, 40.0 / way[:, 0])
    assert np.abs(cloud.true_range - expected)[sure].max() < most
    facing = np.abs((cloud.returns.normal * normal).sum(axis=1))
    assert np.allclose(facing[mine], 1, atol=1e-3 * loose)
    motion = result.motion
    assert np.allclose(motion["velocity"][mine], velocity[mine], rtol=loose, atol=loose)
    assert not motion["velocity"][~mine].any()
    assert np.allclose(motion["rest"][mine & sure], rest[mine & sure], atol=max(1e-4, 2 * most))
    assert np.array_equal(motion["rest"][~mine], cloud.position[~mine]) or subrays > 1
    assert result.audit.kept
    assert result.audit.checked > 20
    assert "%" in result.summary()["pulses that met something moving"]
    assert not any("off between frames" in words for words in result.warnings)
    assert bpy.context.scene.frame_current == 1


@pytest.mark.parametrize("keyed", [False, True])
def test_a_scene_that_stands_still_is_scanned_as_before(scene, keyed):
    """Also with a shape key that is there and never used: evaluated anew at every frame, always the same."""
    if keyed:
        tilted(bpy.data.objects["plate"])
        shapes = bpy.data.objects["plate"].data.shape_keys
        shapes.animation_data_clear()
        shapes.key_blocks[1].value = 0.0
        scene.frame_set(1)
    still, moving = (forest.current().scan(FAN.changed(motion=m)) for m in (False, True))
    assert np.array_equal(still.points, moving.points)
    assert not moving.motion["velocity"].any()
    assert still.motion == {}


@pytest.mark.parametrize("engine", ENGINES)
def test_nothing_but_what_moves(scene, engine):
    bpy.data.objects.remove(bpy.data.objects["wall"])
    nearing(bpy.data.objects["plate"])
    cloud = scan(engine)
    assert 100 < len(cloud) < 81 * 41
    assert cloud.audit.kept


def test_what_appears_meanwhile_is_refused_in_words(scene):
    plate = bpy.data.objects["plate"]
    hide(plate, {1: True, 10: False})
    scene.frame_set(1)
    with pytest.raises(forest.SpecError, match='"plate" appear'):
        forest.current().scan(FAN)
    long = FAN.changed(pulse_rate=1.0)
    with pytest.raises(forest.SpecError, match="frames of the scene"):
        forest.current().scan(long)


def test_a_large_scan_goes_to_a_file_as_it_moves(scene, tmp_path):
    nearing(bpy.data.objects["plate"])
    world = forest.current()
    cloud = world.scan(FAN)
    done = world.scan_to(tmp_path / "moving.npz", FAN)
    assert np.array_equal(np.load(done.path)["x"], cloud.points[:, 0])


def test_places_never_fill_the_memory(scene, monkeypatch):
    """Two objects, 40 frames and more: halving ends early and is said, and too long a scan is refused."""
    plate = bpy.data.objects["plate"]
    keyed(plate, "rotation_euler", {1: (0, 0, 0), 97: (2.0, 3.0, 4.0)})
    bytes_a_frame = 2 * 12 * 8
    frames = 1 + math.ceil(24 * 81 * 41 / FAN.pulse_rate)
    module = "forest_addon.blender.sensors.moving.MOST_BYTES"
    monkeypatch.setattr(module, frames * bytes_a_frame)
    few = forest.current().scan(FAN)
    assert any("off between frames" in words for words in few.warnings)
    monkeypatch.setattr(module, frames * bytes_a_frame - 1)
    with pytest.raises(forest.SpecError, match="2 objects, more than are kept"):
        forest.current().scan(FAN)


def test_keys_that_were_changed_are_followed_anew(scene):
    """The frame that is shown is the same, so that nothing of the scene's shape changes."""
    plate, found = bpy.data.objects["plate"], []
    for end in (FAR, FAR - 4 * SPEED):
        keyed(plate, "location", {1: (FAR, 0, 0), 97: (end, 0, 0)})
        scene.frame_set(1)
        found.append(forest.current().scan(FAN).found.returns.distance.min())
    assert found[0] == pytest.approx(FAR, abs=0.1)
    assert found[1] < FAR - 0.5


PING = forest.Sonar(
    position=(0, 0, 0), beam="omni", call="fm", doppler=True, motion=True, tolerance=1e-8
)


def shifts(result, echo):
    """Doppler factors of an echo's paths, its largest group."""
    group = max(echo.groups, key=len)
    station = Station(result.sensor, forest.Air(), echo.pose, Equipment.of(result.sensor))
    return group, factors(group, station, 0)


@pytest.mark.medium
def test_a_ping_hears_a_plate_where_it_is_at_the_present_frame(scene):
    """Once it stays, the sonar pings at the present frame; Doppler by the closed form."""
    bpy.data.objects.remove(bpy.data.objects["wall"])
    hub = link("hub")
    plate = bpy.data.objects["plate"]
    plate.parent = hub
    keyed(hub, "location", {1: (0, 0, 0), 97: (-4 * SPEED, 0, 0)})
    scene.frame_set(49)
    result = forest.current().ping(PING)
    group, alpha = shifts(result, result.found)
    glint = int(np.argmin(group.paths.distance))
    place, c = FAR - 2 * SPEED, result.found.sound_speed
    assert result.found.pose.time == 2.0
    assert group.paths.distance[glint] == pytest.approx(place, rel=1e-6)
    assert alpha[glint] == pytest.approx((c + SPEED) / (c - SPEED), rel=1e-6)
    assert result.audit.kept
    assert scene.frame_current == 49
    still = forest.current().ping(PING.changed(motion=False))
    group, alpha = shifts(still, still.found)
    assert group.paths.distance.min() == pytest.approx(place, rel=1e-6)
    assert np.allclose(alpha, 1.0)


@pytest.mark.medium
def test_pings_along_what_is_followed_hear_the_scene_at_their_times(scene):
    speed = SPEED / 2
    bpy.data.objects.remove(bpy.data.objects["wall"])
    keyed(bpy.data.objects["plate"], "location", {1: (FAR, 0, 0), 97: (FAR - 4 * speed, 0, 0)})
    bat = link("bat")
    keyed(bat, "location", {1: (0, 0, 0), 97: (4, 0, 0)})  # 1 m/s towards the plate
    scene.frame_end = 97
    scene.frame_set(1)
    result = forest.current().ping(PING.changed(follow="bat", poses=5))
    for number, echo in enumerate(result.found.echoes):
        group, alpha = shifts(result, echo)
        glint, c = int(np.argmin(group.paths.distance)), echo.sound_speed
        assert echo.pose.time == pytest.approx(number)
        place = FAR - (speed + 1) * number
        assert group.paths.distance[glint] == pytest.approx(place, abs=2e-6)
        both = (c + 1) / (c - 1) * (c + speed) / (c - speed)
        assert alpha[glint] == pytest.approx(both, rel=1e-5)
    assert result.audit.kept


def eased(curve, frame):
    """Metres a frame of a Bezier key's curve at a frame, in closed form."""
    ends = curve.keyframe_points
    knots = [ends[0].co, ends[0].handle_right, ends[1].handle_left, ends[1].co]
    p = np.array([tuple(knot) for knot in knots])
    terms = [
        p[3] - 3 * p[2] + 3 * p[1] - p[0],
        3 * (p[2] - 2 * p[1] + p[0]),
        3 * (p[1] - p[0]),
        p[0],
    ]
    time, value = np.array(terms).T
    roots = np.roots(time - [0, 0, 0, frame])
    u = next(r.real for r in roots if abs(r.imag) < 1e-9 and -1e-9 <= r.real <= 1 + 1e-9)
    return np.polyval(np.polyder(value), u) / np.polyval(np.polyder(time), u)


@pytest.mark.slow
def test_what_eases_in_and_out_has_the_speed_of_the_time(scene):
    """Bezier keys: heard and flown at the speed of the ping's time, within what Blender's float32 tells."""
    plate = bpy.data.objects["plate"]
    keyed(plate, "location", {1: (FAR, 0, 0), 49: (FAR / 2, 0, 0)}, "BEZIER")
    curves = curves_of(plate)
    curve = next(c for c in curves if c.data_path == "location" and c.array_index == 0)
    for frame in (5, 33):
        scene.frame_set(frame)
        speed = forest.current().ping(PING).motion["velocity"][:, 0]
        moving = speed[speed != 0]
        assert len(moving)
        np.testing.assert_allclose(moving, 24 * eased(curve, frame), rtol=6e-4)
    scene.frame_start, scene.frame_end = 1, 49
    flown = SceneFollower(scene).motion("plate", 7).velocity[:, 0]
    expected = [24 * eased(curve, frame) for frame in np.linspace(1, 49, 7)]
    np.testing.assert_allclose(flown[1:-1], expected[1:-1], rtol=5e-5)


@pytest.mark.medium
def test_what_bends_is_heard_at_its_own_speed(scene):
    plate = bpy.data.objects["plate"]
    plate.shape_key_add(name="rest")
    key = plate.shape_key_add(name="out")
    for point in key.data:
        point.co.z += 1.0
    keyed(key, "value", {1: 0.0, 49: 1.0}, "BEZIER")
    now, after = [], []
    for frame, places in ((24, now), (26, after)):
        scene.frame_set(frame)
        places.append(key.value)
    scene.frame_set(25)
    result = forest.current().ping(PING)
    assert not any("bends" in words for words in result.warnings)
    speed = np.linalg.norm(result.motion["velocity"], axis=1).max()
    rate = (after[0] - now[0]) * scene.render.fps / 2
    assert rate > 0.5
    assert speed == pytest.approx(rate, rel=0.02)
    away = np.linalg.norm(result.motion["position"] - result.motion["rest"], axis=1)
    assert away.max() < 1e-4  # the scene stands still as at this frame


@pytest.mark.slow
def test_the_audit_follows_a_call_in_pieces(scene):
    """A block that spins so fast that its speed changes within the call."""
    for name in ("wall", "plate"):
        bpy.data.objects.remove(bpy.data.objects[name])
    bpy.ops.mesh.primitive_cube_add(size=2, location=(FAR, 0, 0))
    keyed(bpy.context.object, "rotation_euler", {1: (0, 0, 0.3), 25: (0, 0, 4.3)})
    scene.frame_set(5)
    result = forest.current().ping(PING)
    assert 1 < result.found.moments <= 9
    assert "path by path" in str(result.audit)
    assert result.audit.kept


# ------------------------------------------------------------------------------------------- bending
# Scans of what changes its shape, comes and goes: closed forms through Blender.


@pytest.mark.slow
def test_engines_meet_the_same_where_a_net_waves(scene):
    """A modifier that depends on time, on a body that flies and turns meanwhile."""
    bpy.data.objects.remove(bpy.data.objects["plate"])
    bpy.ops.mesh.primitive_grid_add(
        x_subdivisions=16, y_subdivisions=16, size=4, location=(FAR, 0, 0)
    )
    net = bpy.context.object
    net.rotation_euler = (0.2, math.pi / 2, 0)
    wave = net.modifiers.new("Wave", "WAVE")
    wave.height, wave.width, wave.narrowness, wave.speed = 0.3, 0.8, 1.5, 0.2
    keyed(net, "location", {1: (FAR, 0, 0), LAST: (FAR - 3, 1, 0.5)})
    keyed(net, "rotation_euler", {1: (0.2, math.pi / 2, 0), LAST: (0.7, 1.2, 1)})
    scene.frame_set(1)
    one, other = (scan(engine) for engine in ENGINES)
    assert np.linalg.norm(one.motion["velocity"], axis=1).max() > 0.5
    apart = np.abs(one.found.true_range - other.found.true_range)
    assert (apart > 1e-9).mean() < 0.002  # rays at edges
    assert one.audit.kept
    assert other.audit.kept


@pytest.mark.parametrize("engine", ENGINES)
def test_what_vanishes_and_comes_back_is_met_while_it_is_there(scene, engine):
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
def test_other_triangles_are_met_from_their_frame_on(scene, engine):
    """An array modifier that makes two plates of one at frame 21, the second at half the distance."""
    plate = bpy.data.objects["plate"]
    array = plate.modifiers.new("Array", "ARRAY")
    array.use_relative_offset, array.use_constant_offset = False, True
    array.constant_offset_displace = (0, 0, -FAR / 2)  # the plate's z is the world's x
    keyed(array, "count", {1: 1, 21: 2}, "CONSTANT")
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


def test_the_report_says_how_far_the_tops_of_trees_are_off_their_rest():
    from forest_addon.results.scanner import _of_tops

    tree, height = np.array([-1, 3, 3, 5, 5]), np.array([9.0, 1, 2, 4, 5])
    (figure,) = _of_tops(tree, height, np.array([9.0, 1, 0.02, 0.3, 0.04]))
    assert figure.text == "3 cm (median of 2 trees), at most 4 cm"
    assert _of_tops(tree[:1], height[:1], np.ones(1)) == []


# ------------------------------------------------------------------------------------------ animated
# Scans of animated scenes against every triangle as Blender evaluates it at the pulse's own frame.

FEW = FAN.changed(angle_step_deg=2.0, pulse_rate=250.0)  # 231 pulses, 0.92 s, 22 frames


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
def test_particles_that_are_born_meanwhile_have_their_own_shape(scene):
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
    result = scan(sensor=FEW)
    assert np.quantile(off(result.found), 0.9) < 1e-4
    assert any('"Grid" has more or fewer parts' in words for words in result.warnings)


@pytest.mark.medium
@pytest.mark.parametrize("engine", ENGINES)
def test_what_jumps_is_met_at_one_place_or_the_other(scene, engine):
    """Constant keys: nothing is met between the places, in no sixteenth of a frame."""
    plate = bpy.data.objects["plate"]
    plate.scale = (30, 30, 30)
    places = {1: (FAR, 0, 0), 8: (FAR - 4, 0, 0), 15: (FAR + 2, 0, 0)}
    keyed(plate, "location", places, "CONSTANT")
    scene.frame_set(1)
    result = scan(engine, FAN.changed(pulse_rate=24 * 16 * 8.0))  # eight in a sixteenth of a frame
    cloud = result.found
    frame = 1 + cloud.time * 24
    place = np.select([frame < 8, frame < 15], [FAR, FAR - 4], FAR + 2)
    assert frame.max() > 16
    assert np.abs(cloud.true_range * ways(cloud)[:, 0] - place).max() < 1e-6
    assert not result.motion["velocity"].any()
    assert not any("off between frames" in words for words in result.warnings)


@pytest.mark.medium
def test_mapped_time_is_that_of_the_scene_and_the_frame_stays(scene):
    scene.render.frame_map_old, scene.render.frame_map_new = 100, 150
    scene.render.fps, scene.render.fps_base = 30, 1.001
    plate = bpy.data.objects["plate"]
    plate.scale = (3, 3, 3)
    keyed(plate, "location", {1: (FAR, 0, 0), 31: (FAR - 6, 0, 0)})
    scene.frame_set(7, subframe=0.25)
    result = scan(sensor=FEW)
    assert (scene.frame_current, scene.frame_subframe) == (7, 0.25)
    assert off(result.found).max() < 1e-5
    link("bat")
    forest.current().scan(forest.Mobile(follow="bat", pulse_rate=100.0, motion=True))
    assert (scene.frame_current, scene.frame_subframe) == (7, 0.25)


@pytest.mark.slow
def test_triangles_that_are_others_at_all_times_are_read_between_frames(scene):
    """A block out of which a ball cuts a groove as it passes: 1/16 frame behind at most, and that is said."""
    bpy.data.objects.remove(bpy.data.objects["plate"])
    bpy.ops.mesh.primitive_cube_add(size=3, location=(FAR, 0, 0))
    block = bpy.context.object
    block.name = "block"
    bpy.ops.mesh.primitive_uv_sphere_add(segments=16, ring_count=8, radius=1.2)
    ball = bpy.context.object
    keyed(ball, "location", {1: (FAR - 1.5, -2, 0), 12: (FAR - 1.5, 2, 0)})
    ball.hide_viewport = True
    cut = block.modifiers.new("Boolean", "BOOLEAN")
    cut.object, cut.operation = ball, "DIFFERENCE"
    scene.frame_set(1)
    result = scan(sensor=FEW.changed(pulse_rate=1000.0))  # 6 frames
    assert np.quantile(off(result.found), 0.9) < 4 / 11 / 16  # what the ball goes in a sixteenth
    assert any(
        '"block" is made of other triangles' in words and "2.6 ms" in words
        for words in result.warnings
    )


@pytest.mark.medium
@pytest.mark.parametrize("turns", [1.0, 2.0, 2.03, 4.17])
def test_a_rotor_is_met_as_it_turns(scene, turns):
    """Whole turns a frame: at each frame it stands where it stood. More: at each half it is where a slow one
    would be, that turns the other way or less."""
    plate = bpy.data.objects["plate"]
    plate.scale, plate.rotation_euler = (1, 2, 1), (0, math.pi / 2, 0)
    keyed(plate, "delta_rotation_euler", {1: (0, 0, 0), 101: (0, 0, 2 * math.pi * turns * 100)})
    scene.frame_set(1)
    result = scan(sensor=FAN.changed(angle_step_deg=2.0, pulse_rate=2000.0))
    mine = on_plate(result)
    speed = np.linalg.norm(result.motion["velocity"][mine], axis=1)
    arm = result.found.position[mine] - (FAR, 0, 0)
    rate = 2 * math.pi * turns * 24
    assert off(result.found).max() < 1e-3
    assert np.allclose(speed, rate * np.hypot(arm[:, 0], arm[:, 1]), rtol=0.02)
