"""Scans of a Blender scene that moves: each pulse meets animated objects where they are at its time."""

import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.animation import curves_of

from forest_addon import api as forest
from forest_addon.blender.sensors.moving import SceneFollower
from forest_addon.sensing.sonar.station import Equipment, Station
from forest_addon.sensing.sonar.summation import factors

SPEED, RATE = 3.0, 0.8  # m/s, rad/s
FAR = 12.0
FAN = forest.Terrestrial(
    position=(0, 0, 0),
    azimuth_deg=(-20, 20),
    elevation_deg=(-10, 10),
    angle_step_deg=0.5,
    pulse_rate=2000.0,
    motion=True,
)


def keyed(thing, path, rows, frames):
    """Linear keys of a property at frames."""
    for frame, row in zip(frames, rows, strict=True):
        setattr(thing, path, row)
        thing.keyframe_insert(path, frame=frame)
    curves = curves_of(thing)
    for curve in curves:
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
        curve.extrapolation = "LINEAR"


def hide(thing, frames):
    """Key whether an object is hidden, from frames on."""
    for frame, hidden in frames.items():
        thing.hide_viewport = thing.hide_render = hidden
        thing.keyframe_insert("hide_viewport", frame=frame)
        thing.keyframe_insert("hide_render", frame=frame)


def ways(cloud):
    """(N, 3) unit directions of the pulses of points."""
    level = np.cos(cloud.elevation)
    return np.column_stack(
        [level * np.cos(cloud.azimuth), level * np.sin(cloud.azimuth), np.sin(cloud.elevation)]
    )


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


@pytest.mark.medium
@pytest.mark.parametrize("engine", ["embree", "bvhtree"])
@pytest.mark.parametrize("subrays", [1, 7])
def test_a_plate_that_nears_is_met_where_it_is(scene, engine, subrays):
    """Against the closed form: a plate at x = FAR - SPEED t, before a wall that stands."""
    plate = bpy.data.objects["plate"]
    frames = (1, 1 + 24 * 4)
    keyed(plate, "location", [(FAR, 0, 0), (FAR - 4 * SPEED, 0, 0)], frames)
    world = forest.current(forest.Scene(rays=forest.Rays(engine=engine)))
    beam = forest.Beam(subrays=subrays, divergence_mrad=(0.1, 0.1))
    result = world.scan(FAN.changed(beam=beam))
    cloud = result.found
    way = np.column_stack(
        [
            np.cos(cloud.elevation) * np.cos(cloud.azimuth),
            np.cos(cloud.elevation) * np.sin(cloud.azimuth),
            np.sin(cloud.elevation),
        ]
    )
    assert len(cloud) == 81 * 41
    assert cloud.time.max() > 1.0
    place = FAR - SPEED * cloud.time
    at = place[:, None] / way[:, :1] * way
    aside = np.abs(at[:, 1:]).max(axis=1)
    ours = np.array([world.objects[n] == "plate" for n in result.labels["object"]])
    sure = np.abs(aside - 1) > 0.01  # beams over its edge have two echoes
    assert np.array_equal(ours[sure], (aside < 1)[sure])
    expected = np.where(ours, place, 40.0) / way[:, 0]
    off = np.abs(cloud.true_range - expected)[sure]
    assert off.max() < 1e-6 if subrays == 1 else off.max() < 1e-4
    assert np.allclose(result.motion["velocity"][ours], (-SPEED, 0, 0), rtol=1e-5)
    assert not result.motion["velocity"][~ours].any()
    assert np.allclose(result.motion["rest"][ours, 0], FAR, atol=1e-4)
    assert np.array_equal(result.motion["rest"][~ours], cloud.position[~ours]) or subrays > 1
    assert result.audit.kept
    assert result.audit.checked > 20
    assert "%" in result.summary()["pulses that met something moving"]
    assert bpy.context.scene.frame_current == 1


def test_turning_parented_and_constrained_things_are_followed(scene):
    """Between frames too: Euler keys turn evenly about Z, what hangs on it goes along."""
    plate = bpy.data.objects["plate"]
    plate.rotation_euler = (0, 0, 0)
    bpy.ops.object.empty_add(location=(FAR, 0, 0))
    hub = bpy.context.object
    plate.parent, plate.location, plate.rotation_euler = hub, (0, 0, 0), (0, math.pi / 2, 0)
    keyed(hub, "rotation_euler", [(0, 0, 0), (0, 0, 4 * RATE)], (1, 1 + 24 * 4))
    scene.frame_set(1)
    result = forest.current().scan(FAN)
    cloud = result.found
    tree = np.array(
        [n == "plate" for n in np.array(forest.current().objects)[cloud.returns.instance]]
    )
    turn = RATE * cloud.time
    normal = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    way = np.column_stack(
        [
            np.cos(cloud.elevation) * np.cos(cloud.azimuth),
            np.cos(cloud.elevation) * np.sin(cloud.azimuth),
            np.sin(cloud.elevation),
        ]
    )
    expected = FAR * normal[:, 0] / (way * normal).sum(axis=1)
    assert tree.sum() > 100
    assert np.abs(cloud.true_range - expected)[tree].max() < 2e-5
    assert np.allclose(np.abs((cloud.returns.normal * normal).sum(axis=1))[tree], 1, atol=1e-6)
    arm = cloud.position[tree] - (FAR, 0, 0)
    spin = np.cross((0, 0, RATE), arm)
    assert np.allclose(result.motion["velocity"][tree], spin, rtol=1e-3, atol=1e-4)
    assert result.audit.kept


def test_a_scene_that_stands_still_is_scanned_as_before(scene):
    still, moving = (forest.current().scan(FAN.changed(motion=m)) for m in (False, True))
    assert np.array_equal(still.points, moving.points)
    assert not moving.motion["velocity"].any()
    assert still.motion == {}


@pytest.mark.parametrize("engine", ["embree", "bvhtree"])
def test_nothing_but_what_moves(scene, engine):
    bpy.data.objects.remove(bpy.data.objects["wall"])
    plate = bpy.data.objects["plate"]
    keyed(plate, "location", [(FAR, 0, 0), (FAR - 4 * SPEED, 0, 0)], (1, 97))
    cloud = forest.current(forest.Scene(rays=forest.Rays(engine=engine))).scan(FAN)
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
    plate = bpy.data.objects["plate"]
    keyed(plate, "location", [(FAR, 0, 0), (FAR - 4 * SPEED, 0, 0)], (1, 97))
    world = forest.current()
    cloud = world.scan(FAN)
    done = world.scan_to(tmp_path / "moving.npz", FAN)
    assert np.array_equal(np.load(done.path)["x"], cloud.points[:, 0])


def test_places_never_fill_the_memory(scene, monkeypatch):
    """Two objects, 40 frames and more: halving ends early and is said, and too long a scan is refused."""
    plate = bpy.data.objects["plate"]
    keyed(plate, "rotation_euler", [(0, 0, 0), (2.0, 3.0, 4.0)], (1, 97))
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
        keyed(plate, "location", [(FAR, 0, 0), (end, 0, 0)], (1, 97))
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
    hub = bpy.data.objects.new("hub", None)
    bpy.context.collection.objects.link(hub)
    plate = bpy.data.objects["plate"]
    plate.parent = hub
    keyed(hub, "location", [(0, 0, 0), (-4 * SPEED, 0, 0)], (1, 97))
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
    keyed(bpy.data.objects["plate"], "location", [(FAR, 0, 0), (FAR - 4 * speed, 0, 0)], (1, 97))
    bat = bpy.data.objects.new("bat", None)
    bpy.context.collection.objects.link(bat)
    keyed(bat, "location", [(0, 0, 0), (4, 0, 0)], (1, 97))  # 1 m/s towards the plate
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
    for frame, place in ((1, FAR), (49, FAR / 2)):
        plate.location.x = place
        plate.keyframe_insert("location", frame=frame)
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
    key.value = 0.0
    key.keyframe_insert("value", frame=1)
    key.value = 1.0
    key.keyframe_insert("value", frame=49)
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
    keyed(bpy.context.object, "rotation_euler", [(0, 0, 0.3), (0, 0, 4.3)], (1, 25))
    scene.frame_set(5)
    result = forest.current().ping(PING)
    assert 1 < result.found.moments <= 9
    assert "path by path" in str(result.audit)
    assert result.audit.kept
