"""Look through a scanner: the image has the scan's own pulses, follows the scanner, leaves nothing behind."""

import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.scenes import add_collection, add_mesh, link
from ui.pressing import add_cube, counts, press, trees

from forest_addon.blender.scene.layout import TREES, find_part, grove, part, root
from forest_addon.blender.sensors import objects as sensors
from forest_addon.blender.sensors.objects import PATH_KEY, kind_of
from forest_addon.blender.sensors.observe import Observer
from forest_addon.blender.show.cloud import glance_colours
from forest_addon.sensing.kinds import KINDS
from forest_addon.sensing.lidar import tractor
from forest_addon.sensing.lidar.glance import range_image
from forest_addon.sensing.lidar.pattern import pattern_of
from forest_addon.sensing.reverb.ends import ends_of
from forest_addon.sensing.sonar.station import posed
from forest_addon.ui.sensors import look_through
from forest_addon.ui.sensors.add import STARTS
from forest_addon.ui.settings import exchange
from forest_addon.ui.shell.views import choose_sensor, chosen_sensor


@pytest.fixture(autouse=True)
def ended(registered):
    yield
    look_through.end()


def choose(name):
    choose_sensor(bpy.context, bpy.data.objects[name])


def scanned(name):
    """The first returns of a scan, without noise: (E, A) metres."""
    settings = exchange.to_spec(bpy.context.scene, [bpy.data.objects[name]])
    (scanner,) = settings.sensors
    cloud = Observer(bpy.context.evaluated_depsgraph_get()).observe(scanner, settings)
    return range_image(cloud, scanner)


def agree(image, scan):
    """Columns of the image are those of the scan from the last to the first, as one sees them."""
    return np.allclose(
        np.where(np.isfinite(image), image, np.nan)[:, ::-1], scan, atol=1e-9, equal_nan=True
    )


@pytest.mark.medium
def test_the_image_is_the_scan_and_follows_the_scanner(built):
    obj = bpy.data.objects["cloud"]
    obj.forest_sensor.terrestrial.range_noise = 0.0
    choose("cloud")
    press("look_through")
    eye = look_through.eye()
    assert np.isfinite(eye.found.distance).mean() > 0.2
    assert agree(eye.found.distance, scanned("cloud"))
    observer = eye.observer
    assert not eye.look(bpy.context)  # nothing has changed
    obj.location.x += 0.5
    obj.rotation_euler.z = 0.3
    bpy.context.view_layer.update()
    assert eye.look(bpy.context)
    assert eye.observer is observer  # the scene is not read again
    assert agree(eye.found.distance, scanned("cloud"))
    obj.forest_sensor.terrestrial.max_range = 2.0
    assert eye.look(bpy.context)
    assert np.max(eye.found.distance, where=np.isfinite(eye.found.distance), initial=0) <= 2.0


def test_a_changed_scene_is_read_again_when_it_is_quiet(built, monkeypatch):
    choose("cloud")
    press("look_through")
    eye = look_through.eye()
    observer, before = eye.observer, eye.found.distance
    trees()[0].location.z += 30
    bpy.context.view_layer.update()
    eye.look(bpy.context)
    assert eye.observer is observer
    assert eye.changed_at is not None
    monkeypatch.setattr(look_through, "QUIET", -1.0)
    assert eye.look(bpy.context)
    assert eye.observer is not observer
    assert eye.changed_at is None
    assert (eye.found.distance != before).any()
    assert agree(eye.found.distance, scanned("cloud"))


def test_a_plane_below_by_the_equation(props, sensor):
    add_mesh(
        "plane", [(-200, -200, 0), (200, -200, 0), (200, 200, 0), (-200, 200, 0)], (0, 1, 2, 3)
    )
    sensor(
        "terrestrial", position=(0, 0, 2), angle_step_deg=3, elevation_deg=(-60, 30), max_range=100
    )
    bpy.context.view_layer.update()
    press("look_through")
    found = look_through.eye().found
    elevation = np.radians(np.arange(-60, 31, 3))
    below = np.flatnonzero(elevation < -math.asin(2 / 100) - 1e-9)
    wanted = 2 / np.sin(-elevation[below])
    assert np.abs(found.distance[below] - wanted[:, None]).max() < 1e-5
    others = np.delete(found.distance, below, axis=0)
    assert not np.isfinite(others).any()
    scanner = exchange.sensor_of(bpy.data.objects["cloud"])
    clear = np.exp(-2 * scanner.beam.extinction * wanted)
    bright = scanner.surfaces.other * np.sin(-elevation[below]) * clear
    assert np.abs(found.brightness[below] - bright[:, None]).max() < 1e-6
    assert (np.delete(found.brightness, below, axis=0) == 0).all()


@pytest.mark.medium
@pytest.mark.parametrize(
    ("name", "shown"),
    [
        *(("cloud", shown) for shown in ("DISTANCE", "BRIGHTNESS", "ORGAN")),
        *(("scan", "ORGAN"), ("drone", "BRIGHTNESS"), ("airborne", "DISTANCE")),
    ],
)
def test_every_scanner_has_an_image_in_colours(built, name, shown):
    if name in bpy.data.objects:
        choose(name)
    else:
        press("add_sensor", kind=name)
    press("look_through")
    found = look_through.eye().found
    colours, legend = glance_colours(found, shown)
    assert colours.shape == (*found.distance.shape, 3)
    assert legend
    there = np.isfinite(found.distance)
    assert there.any()
    assert len(np.unique(colours[there], axis=0)) > 1
    assert len(np.unique(colours[~there], axis=0)) <= 1


@pytest.mark.medium
def test_a_sonar_listens_at_the_cursor(built):
    choose("echo")
    sonar = bpy.data.objects["echo"].forest_sensor.sonar
    sonar.ears = 2
    cursor = bpy.context.scene.cursor
    cursor.location = (-1.0, 3.0, 1.0)
    press("look_through")
    eye = look_through.eye()
    assert not eye.problem
    first = eye.found.level
    assert first.shape[0] == 2
    assert first.max() > first.min()
    assert not eye.look(bpy.context)  # nothing has changed
    cursor.location.x -= 1.0  # away from all that sounds
    assert eye.look(bpy.context)
    channel = first.shape[1] // 2
    moved = int(eye.found.level[0, channel].argmax()) - int(first[0, channel].argmax())
    assert moved > 256 / sonar.max_range / 4
    colours, legend = glance_colours(eye.found, "DISTANCE")
    assert colours.shape == (2 * 41 - 1, 256, 3)
    assert [text[-2:] for text, _ in legend] == ["dB", "dB", "Hz"]
    cursor.location = (0.0, 0.0, 0.0)  # on the ground itself
    assert eye.look(bpy.context)
    assert not eye.problem
    cursor.location = (500.0, 0.0, 1.0)
    assert eye.look(bpy.context)
    assert not eye.problem
    press("look_through")


def test_ears_do_not_look_and_the_end_leaves_nothing(built):
    choose("cloud")
    before = counts()
    press("look_through")
    choose("reverb")
    eye = look_through.eye()
    assert eye.look(bpy.context)
    assert "no eyes" in eye.problem
    press("look_through")
    assert look_through.eye() is None
    assert counts() == before
    assert not bpy.app.timers.is_registered(look_through._tick)


# ------------------------------------------------------------------------------------------ turning
# A sensor's object moved and turned by hand: its rays are the ones of before, moved and turned alike.

TURN, MOVE = math.radians(31.0), np.array([1.5, -2.0, 0.0])
RAYS = 400


def direction(azimuth_deg, elevation_deg):
    a, e = math.radians(azimuth_deg), math.radians(elevation_deg)
    return np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])


def rays(obj):
    """(R, 3), (R, 3) where from and where to the sensor of an object looks: its first rays, and some more."""
    sensor = exchange.sensor_of(obj)
    if sensor.kind == "sonar":
        way = Observer.way(sensor)
        pose = posed(sensor) if way is None else way[0]
        return np.tile(pose.position, (3, 1)), pose.frame
    if sensor.kind == "reverb":
        ((source, _receiver),) = ends_of(sensor).pairs
        way = direction(sensor.facing_azimuth_deg, sensor.facing_elevation_deg)
        return np.array([source]), way[None]
    if sensor.kind == "tractor":
        steps = len(tractor.fan(sensor))
        number = np.linspace(0, steps * len(tractor.positions(sensor)) - 1, RAYS).astype(int)
        return tractor.axes(sensor, *np.divmod(number, steps))
    pattern = pattern_of(sensor, Observer.way(sensor))
    pulses = pattern.pulses(np.linspace(0, pattern.count - 1, RAYS).astype(int))
    return pulses.origin, pulses.direction


def added(which, **settings):
    press("add_sensor", kind=which)
    obj = bpy.context.view_layer.objects.active
    for name, value in settings.items():
        setattr(getattr(obj.forest_sensor, which), name, value)
    return obj


@pytest.fixture
def wide(props):
    """Something to sense, over which paths lead."""
    add_cube().scale = (20, 30, 5)


@pytest.mark.parametrize("which", STARTS)
def test_rays_move_and_turn_with_what_a_hand_may_move(wide, which):
    """The object itself; of a drone and a vehicle, which are locked, the curve that the panel points to."""
    obj = added(which)
    if kind_of(obj) == "mobile":
        assert all((*obj.lock_location, *obj.lock_rotation))
        assert KINDS["mobile"].fixed(obj.forest_sensor.mobile) == "Move what it follows"
        held = obj[PATH_KEY]
    else:
        held = obj
        assert not any((obj.lock_rotation[2], *obj.lock_location))
    origin, way = rays(obj)
    pivot = np.array(held.location)
    held.rotation_euler.z += TURN
    held.location = pivot + MOVE
    bpy.context.view_layer.update()
    cos, sin = math.cos(TURN), math.sin(TURN)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    moved, turned = rays(obj)
    assert np.abs(turned - way @ turn.T).max() < 2e-5
    assert np.abs(moved - ((origin - pivot) @ turn.T + pivot + MOVE)).max() < 2e-3


@pytest.mark.parametrize("which", ["sonar", "reverb"])
def test_what_may_look_up_does(wide, which):
    obj = added(which)
    _, way = rays(obj)
    axis = 1 if which == "sonar" else 0
    obj.rotation_euler[axis] += 0.3 * (-1 if which == "sonar" else 1)
    bpy.context.view_layer.update()
    raised = math.asin(rays(obj)[1][0, 2]) - math.asin(way[0, 2])
    assert raised == pytest.approx(0.3, abs=1e-5)


@pytest.mark.parametrize("which", STARTS)
def test_a_parent_moves_and_turns_it_too(wide, which):
    """Locks are for hands; a parent, a constraint or a key moves what hands may move."""
    obj = added(which)
    held = obj.get(PATH_KEY, obj)
    carrier = link("carrier")
    held.parent = carrier
    bpy.context.view_layer.update()
    origin, way = rays(obj)
    carrier.location, carrier.rotation_euler.z = (3, 4, 0), math.pi / 2
    bpy.context.view_layer.update()
    moved, turned = rays(obj)
    assert np.abs(turned - np.stack([-way[:, 1], way[:, 0], way[:, 2]], axis=1)).max() < 2e-5
    expected = np.stack([3 - origin[:, 1], 4 + origin[:, 0], origin[:, 2]], axis=1)
    assert np.abs(moved - expected).max() < 2e-3


@pytest.mark.parametrize("which", STARTS)
def test_where_a_turn_has_no_effect_the_panel_says_why(wide, which):
    obj = added(which)
    kind = kind_of(obj)
    if len(KINDS[kind].turns) < 3 or kind == "reverb":
        assert KINDS[kind].fixed(getattr(obj.forest_sensor, kind))


def test_a_bat_that_follows_says_so(wide):
    obj, other = added("sonar"), bpy.data.objects["cube"]
    settings = obj.forest_sensor.sonar
    settings.follow = other.name
    assert KINDS["sonar"].fixed(settings) == "Move what it follows"
    settings.follow, settings.route = "", "bat.csv"
    assert KINDS["sonar"].fixed(settings) == "It flies its route"
    reverb = added("reverb").forest_sensor.reverb
    assert KINDS["reverb"].fixed(reverb) == "It sends alike to all sides"
    reverb.directivity = "cardioid"
    assert not KINDS["reverb"].fixed(reverb)


# ------------------------------------------------------------------------------------------ anywhere
# A sensor is a sensor wherever it is: moved, copied, appended, linked, in another scene's forest.


@pytest.fixture
def scene(props):
    return props.id_data


def send(obj, home):
    for old in list(obj.users_collection):
        old.objects.unlink(obj)
    home.objects.link(obj)
    bpy.context.view_layer.update()


def test_in_any_collection_it_is_listed_chosen_and_removed(scene):
    obj = added("terrestrial")
    own = add_collection("instruments")
    for home in (own, scene.collection, part(scene, TREES), grove(scene, "oak")):
        send(obj, home)
        assert sensors.sensors_of(scene) == [obj]
        bpy.context.view_layer.objects.active = obj
        assert chosen_sensor(bpy.context) == obj
        listed = sensors.home_of(scene).objects
        assert listed[scene.forest_sensing.active_sensor] == obj
    other = added("sonar")
    scene.forest_sensing.active_sensor = list(sensors.home_of(scene).objects).index(obj)
    assert chosen_sensor(bpy.context) == obj
    assert [s.kind for s in exchange.to_spec(scene).sensors] == ["sonar", "terrestrial"]
    press("remove_sensor")
    assert sensors.sensors_of(scene) == [other]


def test_among_many_trees_it_is_seen_as_it_comes_and_goes(scene):
    oaks = grove(scene, "oak")
    for _ in range(12):
        oaks.objects.link(bpy.data.objects.new("oak", None))
    assert sensors.sensors_of(scene) == []
    obj = added("terrestrial")
    send(obj, oaks)
    assert sensors.sensors_of(scene) == [obj]
    copy = obj.copy()
    oaks.objects.link(copy)
    assert set(sensors.sensors_of(scene)) == {obj, copy}
    obj.name = "renamed"
    assert {s.name for s in sensors.sensors_of(scene)} == {"renamed", copy.name}
    bpy.data.objects.remove(copy)
    assert sensors.sensors_of(scene) == [obj]


def saved(tmp_path, kind, **settings):
    """A file with one sensor, and the sensor's name."""
    obj = added(kind, **settings)
    name = obj.name
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "field.blend"))
    bpy.ops.wm.read_homefile(app_template="", use_empty=True)
    return name


def loaded(tmp_path, name, link):
    with bpy.data.libraries.load(str(tmp_path / "field.blend"), link=link) as (_, target):
        target.objects = [name]
    (obj,) = target.objects
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    bpy.context.view_layer.update()
    return obj


def test_pasted_into_another_file_it_runs_with_its_settings(scene, tmp_path):
    """As Append and Paste do it: into the scene's own collection, what it points to into none."""
    name = saved(tmp_path, "terrestrial", angle_step_deg=7.5)
    obj = loaded(tmp_path, name, link=False)
    assert sensors.sensors_of(bpy.context.scene) == [obj]
    (settings,) = exchange.to_spec(bpy.context.scene).sensors
    assert settings.angle_step_deg == 7.5
    assert find_part(bpy.context.scene, TREES) is None  # no forest is needed


def test_a_pasted_reverb_says_that_its_receiver_is_missing_and_adopts_it(scene, tmp_path):
    name = saved(tmp_path, "reverb")
    obj = loaded(tmp_path, name, link=False)
    receiver = sensors.receiver_of(obj)
    assert receiver is not None
    assert not receiver.users_scene
    assert sensors.is_foreign(bpy.context.scene, obj)
    assert press("adopt_sensor") == {"FINISHED"}
    assert not sensors.is_foreign(bpy.context.scene, obj)
    assert receiver.users_scene == (bpy.context.scene,)
    place = tuple(receiver.location)
    (settings,) = exchange.to_spec(bpy.context.scene).sensors
    assert settings.receiver == pytest.approx(place)


def test_a_linked_sensor_is_adopted(scene, tmp_path):
    name = saved(tmp_path, "sonar", ears=2)
    obj = loaded(tmp_path, name, link=True)
    assert sensors.sensors_of(bpy.context.scene) == []
    assert sensors.is_foreign(bpy.context.scene, obj)
    assert press("adopt_sensor") == {"FINISHED"}
    (made,) = sensors.sensors_of(bpy.context.scene)
    assert made.library is None
    assert made.forest_sensor.sonar.ears == 2
    assert len([t for t in bpy.context.scene.objects if sensors.kind_of(t)]) == 1
    assert not bpy.ops.forest.adopt_sensor.poll()


def test_one_of_another_scenes_forest_is_copied(scene):
    obj = added("terrestrial")
    other = bpy.data.scenes.new("other")
    part(other, "Sensors")
    other.collection.children.link(root(scene))  # shown there, too
    assert sensors.sensors_of(other) == []
    assert sensors.is_foreign(other, obj)
    made = sensors.adopt(other, obj)
    assert made != obj
    assert sensors.sensors_of(other) == [made]
    assert sensors.sensors_of(scene) == [obj]
