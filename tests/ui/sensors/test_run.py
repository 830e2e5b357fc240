"""Sensors added and run for real in a forest of three small trees; results in the panel and in files."""

import math
from functools import partial
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.scenes import keyed, link, values
from ui.pressing import SENSORS, add_cube, clouds, counts, facts, next_uid, press, run, settings_of

from forest_addon import api as forest, spec
from forest_addon.blender.read import depsgraph
from forest_addon.blender.read.depsgraph import read_scene
from forest_addon.blender.scene.instances import IGNORED_KEY
from forest_addon.blender.sensors import objects as sensors
from forest_addon.blender.sensors.objects import sensors_of
from forest_addon.blender.sensors.observe import Observer
from forest_addon.formats.toml_file import read_scanner, scanner_names
from forest_addon.sensing import kind as costs_of
from forest_addon.sensing.kinds import KINDS, kind_of
from forest_addon.sensing.lidar.tractor import TractorScan
from forest_addon.spec import Sonar
from forest_addon.ui import properties
from forest_addon.ui.forest import build
from forest_addon.ui.sensors import panels, run as costing
from forest_addon.ui.sensors.add import STARTS
from forest_addon.ui.sensors.run import Ahead, FOREST_OT_run, _how_many
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


# --------------------------------------------------------------------------------------------- cost
# What a run costs is said before, and what is large is asked about; then one bar leads through all of it.


def things():
    return sensors.sensors_of(bpy.context.scene)


@pytest.mark.medium
def test_pulses_are_counted_as_they_are_sent(built):
    press("add_sensor", kind="drone")
    bpy.context.view_layer.objects.active.forest_sensor.mobile.pulse_rate = 500
    bpy.context.view_layer.update()
    observer = Observer(bpy.context.evaluated_depsgraph_get())
    for obj in things():
        settings = to_spec(bpy.context.scene, [obj])
        found = observer.observe(settings.sensors[0], settings)
        said = costing.costs(bpy.context, [obj])[0].count
        if isinstance(found, TractorScan):
            assert said == found.distance.size
        else:
            assert said == getattr(found, "pulses", 1)


def test_tooltips_write_nothing_and_know_the_way_of_what_is_followed(props):
    """Blender forbids to write while it draws: no block is made, and no frame is gone to."""
    scene = bpy.context.scene
    for kind in ("drone", "mobile", "sonar", "tractor"):
        press("add_sensor", kind=kind)
    sonar = bpy.context.view_layer.objects["Bat Sonar"]
    carrier = link("carrier")
    carrier.keyframe_insert("location", frame=1)
    sonar.forest_sensor.sonar.follow, sonar.forest_sensor.sonar.poses = "carrier", 7
    bpy.context.view_layer.update()
    exact = {}
    for obj in things():
        (sensor,) = to_spec(scene, [obj]).sensors
        exact[obj.name] = kind_of(sensor).cost(sensor, Observer.way(sensor), "embree").count
    gone_to = []
    note = gone_to.append
    bpy.app.handlers.frame_change_pre.append(note)
    before = next_uid()
    counts = {obj.name: costing.costs(bpy.context, [obj])[0].count for obj in things()}
    for given in (SimpleNamespace(sensor=name, again=False) for name in ("", *counts)):
        assert costing.FOREST_OT_run.description(bpy.context, given)
    bpy.app.handlers.frame_change_pre.remove(note)
    assert (next_uid(), gone_to) == (before + 1, [])
    assert counts == pytest.approx(exact, rel=1e-5)
    assert counts["Bat Sonar"] == 7


def test_a_reverb_is_guessed_to_take_longer_among_more_trees(built, monkeypatch):
    """By what each tree adds; a run's pace is of the whole guess then."""
    monkeypatch.setattr(costs_of, "_pace", {})
    plantings = bpy.context.scene.forest_sensing.plantings
    (obj,) = (one for one in things() if sensors.kind_of(one) == "reverb")
    few = costing.costs(bpy.context, [obj])[0]
    plantings[0].standing += 1000
    many = costing.costs(bpy.context, [obj])[0]
    settings = to_spec(bpy.context.scene, [obj])
    kind, standing = KINDS["reverb"], sum(planting.standing for planting in plantings)
    more = [
        sum(kind.seconds_among(settings.sensors[0], settings, n, 1))
        for n in (standing - 1000, standing)
    ]
    assert many.seconds - few.seconds == pytest.approx(more[1] - more[0])
    assert more[1] > more[0]
    costs_of.note_pace(to_spec(bpy.context.scene, [obj]).sensors[0], many, 30.0)
    assert costing.costs(bpy.context, [obj])[0].seconds == pytest.approx(30.0)


def test_its_own_pace_counts_once_a_sensor_has_run(built, monkeypatch):
    monkeypatch.setattr(costs_of, "_pace", {})
    (obj,) = (obj for obj in things() if obj.name == "cloud")
    guess = costing.costs(bpy.context, [obj])[0]
    assert guess.seconds == pytest.approx(guess.setup + guess.work * costs_of.RAY)
    assert guess.setup > costs_of.BEGIN
    sensor = to_spec(bpy.context.scene, [obj]).sensors[0]
    costs_of.note_pace(sensor, guess, 12.0)
    assert costing.costs(bpy.context, [obj])[0].seconds == pytest.approx(12.0)
    twice = Sonar(ears=2)  # of which the seconds to begin are no less by half
    guessed = [kind_of(bat).cost(bat, None, "embree") for bat in (Sonar(ears=1), twice)]
    assert 0.5 < guessed[0].seconds / guessed[1].seconds < 1.0
    costs_of.note_pace(twice, guessed[1], 3.0)
    after = [kind_of(bat).cost(bat, None, "embree").seconds for bat in (Sonar(ears=1), twice)]
    assert after[1] == pytest.approx(3.0)
    assert 0.5 < after[0] / after[1] < 1.0


@pytest.mark.parametrize(
    ("count", "seconds", "memory", "words"),
    [
        (22_500_000, 300.0, 1.8e9, "22.5 M pulses, about 5 min, 1.8 GB"),
        (691_200, 1.0, 1e6, "691k pulses, about a second"),
        (900, 7000.0, 0, "900 pulses, about 1.9 h"),
    ],
)
def test_in_words(props, count, seconds, memory, words):
    one = costs_of.Cost("pulses", count, count, seconds, int(memory))
    assert costing.cost_in_words([one]) == words
    assert costing.is_large([one]) == (seconds > 60)


def test_what_all_frames_keep_counts_too(props):
    one = costs_of.Cost("pulses", 1000, 1000, 0.01, 30_000_000)
    assert not costing.is_large([one], 250)
    assert costing.is_large([one], 250, keep=True)
    assert costing.cost_in_words([one], 250, keep=True).endswith(
        "2.8 GB"
    )  # 30 MB + 249 x (10 + 1) MB


def test_what_is_large_is_asked_about_before(built):
    for obj in things():
        if obj.name == "cloud":
            obj.forest_sensor.terrestrial.angle_step_deg = 0.01
    assert costing.is_large(costing.costs(bpy.context, things()))
    told = bpy.types.Operator.bl_rna_get_subclass_py("FOREST_OT_run").description

    class Given:
        sensor, again = "cloud", False

    assert "pulses" in told(bpy.context, Given)


def test_one_bar_leads_through_all_sensors_and_frames():
    found = [costs_of.Cost("pulses", 1, 1, seconds, 0) for seconds in (1.0, 3.0)]
    ahead = Ahead(found, frames=3)
    spans, words = [], []
    for _ in range(6):
        step, span, _ = ahead.next("cloud")
        spans.append(span)
        words.append(step)
    assert [low for low, _ in spans] == pytest.approx([0, 1 / 12, 4 / 12, 5 / 12, 8 / 12, 9 / 12])
    assert all(before[1] == pytest.approx(after[0]) for before, after in pairwise(spans))
    assert spans[-1][1] == pytest.approx(1.0)
    assert words[3] == "cloud, 2 of 2, frame 2 of 3"


def test_times_of_all_runs_are_told_beside_what_was_estimated():
    one, other = (costs_of.Cost("pulses", 1, 1, seconds, 0) for seconds in (1.0, 30.0))
    alone = Ahead([one], frames=1)
    alone.next("cloud")
    alone.note("cloud", 2.04, one.seconds)
    assert alone.told("300 points in 2.0 s") == "300 points in 2.0 s (1.0 s estimated)"
    frames = Ahead([one, other], frames=2)
    for name, took, cost_of in [("cloud", 2.0, one), ("echo", 20.0, other)] * 2:
        frames.next(name)
        frames.note(name, took, cost_of.seconds)
    assert frames.told("") == (
        "4 runs in 44 s (62 s estimated): cloud 4.0 s (2.0 s estimated), echo 40 s (60 s estimated)"
    )


def test_what_set_a_scene_up_is_not_estimated_again(built, monkeypatch):
    """Until something of it has changed; a run that is too short says nothing of others."""
    monkeypatch.setattr(costs_of, "_pace", {})
    depsgraph.close()
    (obj,) = (obj for obj in things() if obj.name == "cloud")

    def estimate():
        bpy.context.view_layer.update()
        return costing.costs(bpy.context, [obj])[0]

    first = estimate()
    assert first.setup >= costs_of.BEGIN + costs_of.TRIANGLE * costing.triangles_in(
        bpy.context.scene
    )
    assert press("run", sensor="cloud") == {"FINISHED"}
    again = estimate()
    assert again.setup == 0
    assert again.work == first.work
    obj.location.x += 0.1
    assert estimate().setup == 0
    next(one for one in bpy.data.objects if "forest_tree" in one).location.x += 0.1
    assert estimate().setup == pytest.approx(first.setup)
    assert press("run", sensor="cloud") == {"FINISHED"}
    others = [one for one in things() if sensors.kind_of(one) == "sonar"]
    assert costing.costs(bpy.context, others)[0].setup > 1.0  # none of its kind has run yet


@pytest.mark.parametrize("part", ["setup", "work"])
def test_a_pace_is_of_the_part_that_it_was_seen_in(monkeypatch, part):
    """A slow set-up does not slow the rays of the next run down, nor the other way round."""
    monkeypatch.setattr(costs_of, "_pace", {})
    bat = Sonar()
    setup, work = (9.0, 1.0) if part == "setup" else (1.0, 9.0)
    cost = costs_of.Cost("pings", 1, 1, 10.0, 0, 10.0, setup)
    costs_of.note_pace(bat, cost, 19.0)
    later = costs_of.cost_with("sonar", cost, 0.0, 0.0)
    assert later.seconds == pytest.approx(19.0)
    other = costs_of.Cost("pings", 1, 1, 0.0, 0, work, 0.0)
    assert costs_of.cost_with("sonar", other, 0.0, 0.0).seconds == pytest.approx(
        work if part == "setup" else 18.0
    )
    costs_of.note_pace(bat, costs_of.Cost("pings", 1, 1, 0.01, 0, 0.01), 0.1)
    assert costs_of.cost_with("sonar", cost, 0.0, 0.0).seconds == pytest.approx(19.0)


# -------------------------------------------------------------------------------------------- things
# What an object is to sensors, from the panel to what they find.


@pytest.fixture
def wall_at(small):
    bpy.ops.mesh.primitive_cube_add(location=(3, 3, 1))
    return bpy.context.object


def found():
    return read_scene(bpy.context.evaluated_depsgraph_get())


def test_an_object_is_seen_until_it_is_not_to_be(wall_at):
    assert wall_at.forest_seen
    assert wall_at.name in found().object_name
    wall_at.forest_seen = False
    assert wall_at.name not in found().object_name
    assert wall_at["forest_ignored"]
    wall_at.forest_seen = True
    assert wall_at.name in found().object_name
    assert "forest_ignored" not in wall_at


WATER, MIRROR, RETRO = ({"forest_polish": kind} for kind in ("WATER", "MIRROR", "RETRO"))


@pytest.mark.parametrize(
    ("settings", "reflects", "optics"),
    [
        ({"forest_reflects": True}, spec.Surfaces().other, {}),
        ({"forest_reflects": True, "forest_reflected": 0.25}, 0.25, {}),
        ({"forest_reflects": True, "forest_reflected": 3.0}, 1.0, {}),  # a share
        (WATER, np.nan, {0: 2}),
        (WATER | {"forest_refraction": 1.4}, np.nan, {0: 2, 1: 1.4}),
        (MIRROR | {"forest_mirrored": 0.75}, np.nan, {0: 0, 2: 0.75}),
        (RETRO | {"forest_gained": 300.0}, np.nan, {0: 3, 3: 300}),
    ],
)
def test_an_object_has_a_reflectance_of_its_own_is_a_mirror_or_water(
    wall_at, settings, reflects, optics
):
    for key, value in settings.items():
        setattr(wall_at, key, value)
    scene = found()
    assert scene.reflectance.tolist() == pytest.approx([reflects], nan_ok=True)
    assert (scene.optics is None) == (not optics)
    for column, value in optics.items():
        assert scene.optics[0, column] == pytest.approx(value)
    wall_at.forest_reflects, wall_at.forest_polish = False, "NONE"
    assert np.isnan(found().reflectance).all()
    assert found().optics is None


def test_optics_have_usual_values_and_what_is_misspelt_is_refused(wall_at):
    assert (wall_at.forest_reflects, wall_at.forest_polish) == (False, "NONE")
    wall_at.forest_polish = "WATER"
    assert wall_at["forest_optics"] == "water"
    assert wall_at.forest_refraction == pytest.approx(1.33)
    wall_at.forest_polish = "RETRO"
    assert wall_at.forest_gained == 785.0
    wall_at["forest_optics"] = "mirorr"
    wall_at.update_tag()  # a scanner that follows bounces refuses it
    assert found().optics[0, 0] == -1


def test_what_a_script_has_set_is_shown(wall_at):
    wall_at["forest_ignored"], wall_at["forest_reflectance"] = 1, 0.75
    assert not wall_at.forest_seen
    assert wall_at.forest_reflects
    assert wall_at.forest_reflected == 0.75
    wall_at["forest_reflectance"] = "white"  # sensors do not count it either
    assert wall_at.forest_reflected == spec.Surfaces().other


def test_it_is_undone(wall_at):
    bpy.ops.ed.undo_push(message="before")
    wall_at.forest_seen = False
    bpy.ops.ed.undo_push(message="after")
    bpy.ops.ed.undo()
    assert bpy.data.objects["Cube"].forest_seen


def test_the_panel_is_there_for_what_sensors_could_see(wall_at):
    assert panels.thing.poll(bpy.context)
    for other in ("reverb", "cloud"):
        bpy.context.view_layer.objects.active = bpy.data.objects[other]
        assert not panels.thing.poll(bpy.context)
    bpy.context.view_layer.objects.active = None
    assert panels.seen_thing(SimpleNamespace(object=None)) is None
    assert not panels.thing.poll(bpy.context)


def test_objects_keep_it_without_the_add_on(wall_at):
    wall_at.forest_seen = False
    for owner, name, _ in panels.PROPERTIES:
        delattr(owner, name)
    try:
        assert not hasattr(wall_at, "forest_seen")
        assert wall_at["forest_ignored"]
        assert wall_at.name not in found().object_name
    finally:
        for owner, name, prop in panels.PROPERTIES:
            setattr(owner, name, prop)
    assert not wall_at.forest_seen
