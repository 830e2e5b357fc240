"""Sensors added and run for real in a forest of three small trees; results in the panel and in files."""

import math
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.scenes import keyed, link, values
from ui.pressing import (
    SENSORS,
    add_cube,
    clouds,
    counts,
    facts,
    press,
    run,
    settings_of,
)

from forest_addon import api as forest
from forest_addon.blender.read.depsgraph import read_scene
from forest_addon.blender.scene.instances import IGNORED_KEY
from forest_addon.blender.sensors import objects as sensors
from forest_addon.blender.sensors.objects import sensors_of
from forest_addon.formats.toml_file import read_scanner, scanner_names
from forest_addon.ui import properties
from forest_addon.ui.forest import build
from forest_addon.ui.sensors import panels
from forest_addon.ui.sensors.add import STARTS
from forest_addon.ui.sensors.run import FOREST_OT_run, _how_many
from forest_addon.ui.settings import exchange
from forest_addon.ui.settings.exchange import to_spec


@pytest.mark.medium
def test_points_of_both_lidars_lie_on_the_same_things(ran):
    for name in ("scan", "cloud"):
        data = bpy.data.objects[ran.results[name].shown].data
        organ, height = values(data, "organ"), values(data, "position")[:, 2]
        assert np.abs(height[organ == 3]).max(initial=0) < 1e-5
        assert height[organ != 3].min() > -0.05


def test_a_broken_sensor_does_not_stop_the_others(built, capfd):
    settings_of("echo").band = (1e5, 3e5)  # found before it runs
    bpy.data.objects["reverb"].location.z = -1  # found when it runs
    assert press("run") == {"FINISHED"}
    assert {"scan", "cloud"} <= {*built.results.keys()}
    assert not {"echo", "reverb"} & {*built.results.keys()}
    said = capfd.readouterr().out
    for words in ("NOT RUN", "echo.band", "reverb.source"):
        assert words in said
    assert said.count("above the ground") == 2  # a warning, and at the end
    with pytest.raises(RuntimeError, match=r"reverb\.source.*above the ground"):
        run("reverb")
    for name in ("scan", "cloud"):
        bpy.data.objects.remove(bpy.data.objects[name])
    with pytest.raises(RuntimeError, match=r"(?s)echo\.band.*reverb\.source"):
        press("run")


def test_a_broken_sensor_does_not_stop_the_forest(small):
    settings_of("echo").band = (1e5, 3e5)
    assert press("build") == {"FINISHED"}
    small.wind.speed = 3.0
    assert run("cloud") == {"FINISHED"}


@pytest.mark.medium
def test_a_frame_that_a_sensor_cannot_run_in_does_not_stop_the_others(built, capfd):
    scene = bpy.context.scene
    keyed(bpy.data.objects["reverb"], "location", {1: (1, 1, 1), 2: (1, 1, -1), 3: (1, 1, 1)})
    scene.frame_start, scene.frame_end = 1, 3
    assert run("reverb", frames="RANGE", keep=True) == {"FINISHED"}
    assert [each.frame for each in built.results["reverb"].frames] == [1, 3]
    said = capfd.readouterr().out
    assert "2 runs in" in said
    assert "NOT RUN: frame 2: reverb.source[2]: must be above the ground" in said


@pytest.mark.parametrize("part", [None, 1])
def test_a_reverb_among_trees_of_the_users_own_says_why_it_hears_none(props, sensor, capfd, part):
    bpy.ops.mesh.primitive_cylinder_add(vertices=12, radius=0.2, depth=6, location=(2, 1, 3))
    if part is not None:
        faces = bpy.context.object.data.attributes.new("part", "INT", "FACE")
        faces.data.foreach_set("value", [part] * len(faces.data))
        bpy.context.object.data.update()
    sensor("reverb", source=(0, 0, 1), receiver=(5, 0, 1), sample_rate=4000, duration=0.1)
    assert press("run") == {"FINISHED"}
    said = capfd.readouterr().out
    assert ('give trees the face attribute "part", 1 on wood' in said) == (part is None)
    assert ("1 trunk heard" in said) == (part is not None)


@pytest.mark.slow
def test_a_sensor_follows_the_frames(built, tmp_path):
    scene = bpy.context.scene
    keyed(bpy.data.objects["echo"], "location", {1: (-1, 3, 1), 3: (-2, 3, 1)})
    scene.frame_start, scene.frame_end, scene.frame_current = 1, 3, 2
    built.output = str(tmp_path)
    assert run("echo", frames="RANGE") == {"FINISHED"}
    written = sorted(tmp_path.glob("*.npz"))
    assert [file.name for file in written] == [f"echo-000{frame}.npz" for frame in (1, 2, 3)]
    assert scene.frame_current == 2
    records = [np.load(file)["impulse_response"] for file in written]
    assert len({record.tobytes() for record in records}) == 3


@pytest.mark.slow
@pytest.mark.parametrize(("name", "file"), [("cloud", "cloud.laz"), ("echo", "echo.npz")])
def test_a_users_file_of_that_name_stays(built, name, file, tmp_path):
    """The panel saves beside it where another run had saved, and never over what others wrote."""
    (tmp_path / file).write_text("the user's")
    built.output = str(tmp_path)
    run(name)
    assert (tmp_path / file).read_text() == "the user's"
    assert built.results[name].file == ""
    (tmp_path / file).unlink()
    run(name)
    run(name)  # over its own
    assert (tmp_path / file).stat().st_size > 100
    assert built.results[name].file == str(tmp_path / file)


def test_a_folder_beside_an_unsaved_file_is_said_before_the_work(built):
    built.output = "//results"
    with pytest.raises(RuntimeError, match="save that first"):
        run("cloud")
    assert clouds() == []


# -------------------------------------------------------------------------- frame ranges, instances


def test_a_range_of_one_frame_needs_no_folder(built):
    bpy.context.scene.frame_start = bpy.context.scene.frame_end = 1
    assert run("echo", frames="RANGE") == {"FINISHED"}


@pytest.mark.slow
def test_the_button_for_frames_asks_and_counts_first(built, tmp_path):
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 2
    asked = partial(_how_many, SimpleNamespace(which="ALL", sensor="echo", keep=False))
    assert asked(scene) == "Choose a folder in Save To, or Keep in File"
    built.output = str(tmp_path)
    assert asked(scene).startswith("4 × 2 frames: 8 runs, 2,618 pulses")
    assert press("run_frames", sensor="echo") == {"FINISHED"}
    assert sorted(f.name for f in tmp_path.glob("*.npz")) == ["echo-0001.npz", "echo-0002.npz"]
    assert not hasattr(FOREST_OT_run, "draw")


@pytest.mark.medium
@pytest.mark.parametrize("depth", [1, 2])
def test_a_scene_of_instanced_collections_alone_is_sensed(props, sensor, depth):
    home = bpy.data.collections.new("library")  # in no scene, as one that is linked
    add_cube(home=home)
    for _ in range(depth):
        empty = bpy.data.objects.new("instance", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", home
        home = bpy.data.collections.new("outer")
        home.objects.link(empty)
    bpy.context.scene.collection.objects.link(empty)
    sensor("terrestrial", name="cloud", position=(4, 0.5, 0.5), angle_step_deg=3)
    assert run("cloud") == {"FINISHED"}
    assert int(facts(props, "cloud")["Points"]) > 5


def test_an_instance_of_nothing_is_nothing_to_sense(props, sensor):
    empty = link("instance")
    empty.instance_type = "COLLECTION"
    empty.instance_collection = bpy.data.collections.new("library")
    sensor("terrestrial")
    with pytest.raises(RuntimeError, match="Grow a forest first"):
        press("run")


# ------------------------------------------------------------------------------- how sensors stand


@pytest.mark.medium
@pytest.mark.parametrize("turn", [30.0, -170.0, 180.0])
def test_turning_a_tripod_turns_its_window(props, sensor, turn):
    """What the turned scanner sees of a cube is what one sees whose azimuth says the same."""
    add_cube()
    place = {"position": (4, 0.5, 0.5), "angle_step_deg": 2, "elevation_deg": (-30, 30)}
    sensor("terrestrial", name="turned", azimuth_deg=(100, 260), **place)
    sensor("terrestrial", name="told", azimuth_deg=(100 + turn, 260 + turn), **place)
    bpy.data.objects["turned"].rotation_euler.z = np.deg2rad(turn)
    bpy.context.view_layer.update()
    for name in ("turned", "told"):
        run(name)
    points = [facts(props, name).get("Points") for name in ("turned", "told")]
    assert points[0] == points[1]
    found = exchange.sensor_of(bpy.data.objects["turned"]).azimuth_deg
    assert np.allclose(np.mod(found, 360), np.mod((100 + turn, 260 + turn), 360))


@pytest.mark.parametrize("kind", SENSORS.values())
def test_what_a_sensor_does_not_heed_cannot_be_done_by_hand(props, sensor, kind):
    """Each turn either changes what a sensor is set to, or is locked."""
    obj = sensor(kind)
    for axis in range(3):
        bpy.context.view_layer.update()
        before = exchange.sensor_of(obj)
        was = obj.rotation_euler[axis]
        obj.rotation_euler[axis] = was + 0.5
        bpy.context.view_layer.update()
        heeded = exchange.sensor_of(obj) != before
        assert heeded or obj.lock_rotation[axis] or kind == "reverb"
        obj.rotation_euler[axis] = was
    assert all(obj.lock_scale)


# -------------------------------------------------------------------------------------------- flight
# Add > Forest > Flight, and Fly: a flyer with sensors, keyed along its way, a trail in colours.


def wall(x, size=0.5):
    bpy.ops.mesh.primitive_cube_add(size=size, location=(x, 0.0, 2.0))
    return bpy.context.object


def trail():
    return next(t for t in bpy.data.objects if t.name.endswith("trail"))


def test_it_flies_around_what_stands_there_and_is_animated(props):
    wall(5.0)
    bpy.ops.forest.add_flight()
    flyer = bpy.data.objects["Flyer"]
    assert tuple(flyer.location) == (0.0, 0.0, 2.0)
    assert {obj.name for obj in sensors_of(bpy.context.scene)} == {"Flyer lidar", "Flyer sonar"}
    assert {s.follow for s in to_spec(bpy.context.scene).sensors} == {"Flyer"}
    props.flight.distance = 10.0
    assert bpy.ops.forest.fly(policy="gap") == {"FINISHED"}
    scene = bpy.context.scene
    places = []
    for frame in range(1, scene.frame_end + 1):
        scene.frame_set(frame)
        places.append(tuple(flyer.matrix_world.translation))
    places = np.array(places)
    assert np.allclose(places[0], [0, 0, 2], atol=1e-5)
    assert np.hypot(*(places[-1, :2] - [10, 0])) < 2.3
    assert np.abs(places[:, 1]).max() > 0.3  # around the cube
    assert len(np.unique(values(trail().data, "sensed").round(2), axis=0)) > 3
    assert trail()[IGNORED_KEY]
    geometry = read_scene(bpy.context.evaluated_depsgraph_get())
    assert "Flyer trail" not in geometry.object_name


def test_twice_in_a_row_nothing_piles_up(props):
    wall(4.0)
    bpy.ops.forest.add_flight()
    props.flight.distance = 6.0
    bpy.ops.forest.fly(policy="straight")
    things, meshes = len(bpy.data.objects), len(bpy.data.meshes)
    bpy.context.scene.frame_set(1)
    bpy.ops.forest.fly(policy="straight")
    assert (len(bpy.data.objects), len(bpy.data.meshes)) == (things, meshes)


# --------------------------------------------------------------------------------------- instruments
# Instruments by their makers' names, what choosing one sets, and limits of what is shown otherwise.


class Entries:
    """A layout that keeps what a menu lists: titles, and what choosing one sets."""

    def __init__(self):
        self.shown = []

    def operator(self, name, text):
        entry = type("Entry", (), {"text": text, "name": name})()
        self.shown.append(entry)
        return entry


def listed():
    menu = type("Menu", (), {"layout": Entries()})()
    panels.INSTRUMENTS.draw(menu, bpy.context)
    return {entry.text: entry.scanner for entry in menu.layout.shown}


@pytest.mark.parametrize("kind", ["terrestrial", "mobile", "airborne"])
def test_the_menu_has_the_instruments_of_what_carries_the_sensor(sensor, kind):
    sensor(kind)
    able = {name for name in scanner_names() if kind in read_scanner(name).tables}
    shown = listed()
    assert set(shown.values()) == able | {""}
    assert not set(shown) & set(scanner_names())  # names, not those of files


def test_choosing_an_instrument_is_the_same_as_in_python(sensor):
    obj = sensor("terrestrial", position=(1.0, 2.0, 3.0))
    assert bpy.ops.forest.choose_instrument(scanner=listed()["RIEGL VZ-400i"]) == {"FINISHED"}
    found = exchange.sensor_of(obj)
    chosen = forest.instrument("riegl-vz-400i", position=(1.0, 2.0, 3.0), name=found.name)
    assert found.beam == chosen.beam
    assert (found.pulse_rate, found.max_range) == (chosen.pulse_rate, chosen.max_range)
    assert found.position == chosen.position
    bpy.ops.forest.choose_instrument(scanner="")
    assert exchange.sensor_of(obj).beam == chosen.beam  # settings stay, they are one's own now
    assert obj.forest_sensor.terrestrial.scanner == ""


def test_a_tooltip_says_range_rate_and_spread(sensor):
    sensor("terrestrial")
    words = panels.choose_instrument.description(
        bpy.context, type("Settings", (), {"scanner": "riegl-vz-400i"})()
    )
    assert words.startswith("RIEGL VZ-400i: ")
    assert "kHz" in words
    assert "mrad" in words


def test_a_sonar_has_no_instruments(sensor):
    sensor("sonar")
    assert not bpy.ops.forest.choose_instrument.poll()


def test_a_file_of_ones_own_is_shown_by_its_name(sensor):
    group = sensor("terrestrial").forest_sensor.terrestrial
    assert panels.instrument_title(group) == panels.OWN
    group.scanner = "riegl-vz-400i"
    assert panels.instrument_title(group) == "RIEGL VZ-400i"
    group.scanner = "my/own.toml"
    assert panels.instrument_title(group) == "own.toml"


def test_what_is_shown_in_another_unit_keeps_its_limits_and_says_so(registered):
    shown = 0
    for group in properties.GROUPS.values():
        known = group.bl_rna.properties
        for name in [key for key in known.keys() if key.endswith("_shown")]:  # noqa: SIM118
            base, face = known[name.removesuffix("_shown")], known[name]
            one = math.radians(1) if face.unit == "ROTATION" else 1e-3
            assert face.description == base.description
            for limit in ("hard_min", "hard_max"):
                bound = getattr(base, limit)
                if abs(bound) < 1e30:
                    assert getattr(face, limit) == pytest.approx(one * bound, rel=1e-6)
            shown += 1
    assert shown > 20


# ----------------------------------------------------------------------------------------------- add
# Sensors added where the user is: in any scene, on its ground, ready to run.


@pytest.fixture
def room(props):
    """A scene of the user's own: a slab whose top is at 3 m, a block on it, and no forest."""
    for place, scale in (((0, 0, 2.5), (12, 12, 1)), ((3.5, 0, 5), (1, 2, 4))):
        bpy.ops.mesh.primitive_cube_add(size=1, location=place, scale=scale)
    bpy.context.view_layer.update()
    return props


@pytest.mark.slow
@pytest.mark.parametrize("which", STARTS)
def test_each_runs_at_once_in_any_scene(room, which):
    bpy.context.scene.cursor.location = (-2, 0, 3)
    assert press("add_sensor", kind=which) == {"FINISHED"}
    obj = bpy.context.view_layer.objects.active
    assert obj.name == STARTS[which].title
    group = getattr(obj.forest_sensor, STARTS[which].kind)
    for name, coarse in {"angle_step_deg": 4.0, "step": 1.0, "pulse_rate": 2000.0}.items():
        if hasattr(group, name):
            setattr(group, name, coarse)
    assert run(obj.name) == {"FINISHED"}
    assert obj.name in room.results
    assert exchange.forestless(room)
    assert not exchange.untouched(room)
    if STARTS[which].kind not in ("sonar", "reverb"):
        points = bpy.data.objects[room.results[obj.name].shown]
        assert len(points.data.vertices if points.type == "MESH" else points.data.points) > 10


def test_it_stands_on_the_ground_below_the_cursor(room):
    scene = bpy.context.scene
    for cursor, foot in (((0, 0, 3), 3), ((0, 0, 40), 3), ((50, 0, 1), 1), ((3.5, 0, 0), 3)):
        scene.cursor.location = cursor
        press("add_sensor", kind="terrestrial")
        obj = bpy.context.view_layer.objects.active
        assert np.allclose(obj.location, (*cursor[:2], foot + 1.6), atol=1e-5)
        scene.cursor.location = (0, 0, 0)


def test_a_path_goes_through_what_there_is_to_sense(room):
    bpy.context.scene.cursor.location = (0, 0, 3)
    press("add_sensor", kind="drone")
    path = sensors._held(bpy.context.view_layer.objects.active, sensors.PATH_KEY)
    line = np.array([(path.matrix_world @ p.co.xyz)[:] for p in path.data.splines[0].points])
    assert np.allclose(line[:, 2], 37)  # 30 m above the block's top
    assert np.allclose((line[:, 1].min(), line[:, 1].max()), (-6, 6))


@pytest.mark.parametrize(
    ("kind", "key"), [("mobile", sensors.PATH_KEY), ("reverb", sensors.RECEIVER_KEY)]
)
def test_a_path_or_receiver_goes_with_its_sensor_unless_a_copy_has_it_too(room, kind, key):
    before = counts()
    press("add_sensor", kind=kind)
    obj = bpy.context.view_layer.objects.active
    copy = obj.copy()
    sensors.home_of(bpy.context.scene).objects.link(copy)
    press("remove_sensor")
    assert sensors._held(copy, key).name in bpy.data.objects
    bpy.context.view_layer.objects.active = copy
    press("remove_sensor")
    assert counts()["objects"] == before["objects"]


@pytest.mark.medium
def test_a_forest_grown_later_leaves_the_users_sensors(room, tmp_path, monkeypatch):
    demo = tmp_path / "demo.toml"
    demo.write_text('[[plantings]]\nspecies = "fern"\nexpected = 3\n[[sensors]]\nkind = "sonar"\n')
    monkeypatch.setattr(build, "DEMO", demo)  # smaller than the real one
    press("scan_here")
    assert press("build") == {"FINISHED"}
    assert [obj.name for obj in sensors.sensors_of(bpy.context.scene)] == ["Tripod LiDAR"]
    assert len(room.plantings)
