"""Sensors added and run for real in a forest of three small trees; results in the panel and in files."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

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

from forest_addon.ui.sensors.run import FOREST_OT_run, FOREST_OT_run_frames
from forest_addon.ui.settings import exchange


@pytest.mark.medium
def test_points_of_both_lidars_lie_on_the_same_things(built):
    run("scan")
    run("cloud")
    for cloud in clouds():
        ground = np.empty(len(cloud.data.vertices), dtype=np.int32)
        cloud.data.attributes["organ"].data.foreach_get("value", ground)
        place = np.empty((len(ground), 3), dtype=np.float32)
        cloud.data.attributes["position"].data.foreach_get("vector", place.ravel())
        assert np.abs(place[ground == 3, 2]).max(initial=0) < 1e-5
        assert place[ground != 3, 2].min() > -0.05


def test_a_scene_with_nothing_in_it_says_build_first(props, sensor):
    sensor("sonar")
    with pytest.raises(RuntimeError, match="Grow a forest first"):
        press("run")


def test_a_scene_without_sensors_says_add_one(props):
    add_cube()
    with pytest.raises(RuntimeError, match="no sensor yet"):
        press("run")


def test_a_sensor_that_is_gone_is_named(built):
    with pytest.raises(RuntimeError, match="ear is no sensor"):
        run("ear")


@pytest.mark.medium
def test_sensors_run_in_a_scene_of_the_users_own(props, sensor):
    add_cube()
    sensor("terrestrial", angle_step_deg=6)
    sensor("tractor", step=5)
    sensor("sonar")
    sensor("reverb")
    assert press("run") == {"FINISHED"}
    assert len(props.results) == 4


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "key", "value", "words"),
    [
        ("cloud", "azimuth_deg", (90, 10), "from < to"),
        ("scan", "top", 0.5, r"scan\.top.*above the scanner"),
        ("echo", "band", (1e5, 3e5), r"echo\.band.*sample_rate"),
    ],
)
def test_a_bad_sensor_is_reported_and_its_last_result_kept(built, name, key, value, words):
    run(name)
    before, figures = counts(), facts(built, name)
    setattr(settings_of(name), key, value)
    with pytest.raises(RuntimeError, match=words):
        run(name)
    assert counts() == before
    assert facts(built, name) == figures


def test_a_source_below_the_ground_is_refused(built):
    bpy.data.objects["reverb"].location.z = -1
    with pytest.raises(RuntimeError, match="above the ground"):
        run("reverb")


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
    scene, reverb = bpy.context.scene, bpy.data.objects["reverb"]
    for frame, z in ((1, 1.0), (2, -1.0), (3, 1.0)):
        reverb.location.z = z
        reverb.keyframe_insert("location", frame=frame)
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
    scene, echo = bpy.context.scene, bpy.data.objects["echo"]
    for frame, x in ((1, -1), (3, -2)):
        echo.location.x = x
        echo.keyframe_insert("location", frame=frame)
    scene.frame_start, scene.frame_end, scene.frame_current = 1, 3, 2
    built.output = str(tmp_path)
    assert run("echo", frames="RANGE") == {"FINISHED"}
    written = sorted(tmp_path.glob("*.npz"))
    assert [file.name for file in written] == [f"echo-000{frame}.npz" for frame in (1, 2, 3)]
    assert scene.frame_current == 2
    records = [np.load(file)["impulse_response"] for file in written]
    assert len({record.tobytes() for record in records}) == 3


def test_sensors_are_added_chosen_and_removed(built):
    for kind in SENSORS.values():
        assert press("add_sensor", kind=kind) == {"FINISHED"}
    assert bpy.context.view_layer.objects.active.name == "Reverb"
    before = counts()["objects"]
    assert press("remove_sensor") == {"FINISHED"}
    assert counts()["objects"] == before - 2  # the receiver goes too
    assert "Reverb" not in bpy.data.objects


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "file"),
    [("scan", "scan.npz"), ("cloud", "cloud.laz"), ("echo", "echo.npz"), ("reverb", "reverb.wav")],
)
def test_results_are_saved_where_the_user_says(built, name, file, tmp_path):
    built.output = str(tmp_path / "new" / "folder")
    run(name)
    written = tmp_path / "new" / "folder" / file
    assert written.stat().st_size > 0
    assert built.results[name].file == str(written)


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


def test_a_folder_that_cannot_be_is_said_before_the_work(built, tmp_path):
    (tmp_path / "file").write_text("x")
    built.output = str(tmp_path / "file" / "folder")
    with pytest.raises(RuntimeError, match=r"Save To.*cannot be made"):
        run("cloud")
    assert clouds() == []


def test_a_folder_beside_an_unsaved_file_is_refused(built):
    built.output = "//results"
    with pytest.raises(RuntimeError, match="save that first"):
        run("echo")


@pytest.mark.medium
def test_a_full_disk_keeps_the_result_in_the_scene(built, tmp_path, monkeypatch):
    from forest_addon.formats import las

    def full(*_, **__):
        raise OSError(28, "No space left on device", "cloud.laz")

    monkeypatch.setattr(las, "write_las", full)
    built.output = str(tmp_path)
    assert run("cloud") == {"FINISHED"}
    assert len(clouds()) == 1
    assert list(tmp_path.iterdir()) == []
    assert built.results["cloud"].file == ""


def test_a_scanner_without_a_way_is_told_so(built, sensor):
    track = sensor("mobile").forest_sensor.mobile
    with pytest.raises(RuntimeError, match="give poses, or the object to follow"):
        run("track")
    track.follow = "Nothing"
    with pytest.raises(RuntimeError, match='no object "Nothing"'):
        run("track")


@pytest.mark.medium
def test_a_scanner_flies_over_the_forest(built, sensor):
    settings = {"position": (3, -2, 30), "track": 10, "speed": 10}
    sensor("airborne", pulse_rate=2000, line_rate=20, **settings)
    assert run("flight") == {"FINISHED"}
    figures = facts(built, "flight")
    assert figures["Beams"] == "2,000"
    assert int(figures["Points"].replace(",", "")) > 100


def test_choosing_a_scanner_fills_in_its_figures(built):
    settings = settings_of("cloud")
    settings.max_range = 77
    settings.scanner = "riegl-vz"  # not complete yet
    assert settings.max_range == 77
    settings.scanner = "riegl-vz-400i"
    found = exchange.sensor_of(bpy.data.objects["cloud"])
    assert (found.max_range, found.min_range, found.beam.exit_diameter) == (800, 1.5, 0.007)
    assert (found.name, found.position) == ("cloud", (3, 3, 1))
    settings.beam.subrays = 3
    assert exchange.sensor_of(bpy.data.objects["cloud"]).beam.subrays == 3


# -------------------------------------------------------------------------- frame ranges, instances


@pytest.mark.medium
def test_a_frame_range_needs_a_folder(built):
    """Without one, all but the last frame would be lost."""
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, 3
    with pytest.raises(
        RuntimeError, match=r"Save To.*choose a folder, or Keep.*of 3 frames.*keeps one"
    ):
        run("echo", frames="RANGE")
    assert "echo" not in built.results
    bpy.context.scene.frame_end = 1
    assert run("echo", frames="RANGE") == {"FINISHED"}


@pytest.mark.slow
def test_the_button_for_frames_asks_and_counts_first(built, tmp_path):
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 2
    asked = partial(
        FOREST_OT_run_frames._how_many, SimpleNamespace(which="ALL", sensor="echo", keep=False)
    )
    assert asked(scene) == "Choose a folder in Save To, or Keep in File"
    with pytest.raises(RuntimeError, match="choose a folder"):
        press("run_frames", sensor="echo")
    built.output = str(tmp_path)
    assert asked(scene).startswith("4 × 2 frames: 8 runs, 2,618 pulses")
    assert press("run_frames", sensor="echo") == {"FINISHED"}
    assert sorted(f.name for f in tmp_path.glob("*.npz")) == ["echo-0001.npz", "echo-0002.npz"]
    assert not hasattr(FOREST_OT_run, "draw")


@pytest.mark.medium
@pytest.mark.parametrize("depth", [1, 2])
def test_a_scene_of_instanced_collections_alone_is_sensed(props, sensor, depth):
    home = bpy.data.collections.new("library")  # in no scene, as one that is linked
    add_cube(home)
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
    empty = bpy.data.objects.new("instance", None)
    empty.instance_type = "COLLECTION"
    empty.instance_collection = bpy.data.collections.new("library")
    bpy.context.scene.collection.objects.link(empty)
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
    thing = sensor(kind)
    for axis in range(3):
        bpy.context.view_layer.update()
        before = exchange.sensor_of(thing)
        was = thing.rotation_euler[axis]
        thing.rotation_euler[axis] = was + 0.5
        bpy.context.view_layer.update()
        heeded = exchange.sensor_of(thing) != before
        assert heeded or thing.lock_rotation[axis] or kind == "reverb"
        thing.rotation_euler[axis] = was
    assert all(thing.lock_scale)
