"""Every button, pressed for real in Blender on a forest of three small trees."""

import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.blender import forest as forest_room
from forest_addon.blender import layout
from forest_addon.blender.depsgraph import TREE_KEY
from forest_addon.blender.jobs import Job
from forest_addon.blender.layout import CLOUD_KEY
from forest_addon.formats.toml_file import read_settings
from forest_addon.spec import Scene
from forest_addon.ui import exchange, operators, requirements, running

ROOT = Path(__file__).resolve().parents[2]
SENSORS = {"scan": "tractor", "cloud": "terrestrial", "echo": "sonar", "reverb": "reverb"}
LIDARS = ("scan", "cloud")


def press(name, **settings):
    return getattr(bpy.ops.forest, name)(**settings)


def run(name, **settings):
    return press("run", sensor=name, **settings)


def settings_of(name):
    """The settings on the object of a sensor."""
    return getattr(bpy.data.objects[name].forest_sensor, SENSORS[name])


def trees():
    return [thing for thing in bpy.data.objects if TREE_KEY in thing]


def clouds():
    return [thing for thing in bpy.data.objects if CLOUD_KEY in thing]


def counts():
    """How many of everything there is."""
    kinds = ("objects", "meshes", "materials", "collections", "node_groups", "images")
    return {kind: len(getattr(bpy.data, kind)) for kind in kinds}


def facts(props, name):
    return {figure.name: figure.value for figure in props.results[name].figures}


def add_cube(collection=None):
    data = bpy.data.meshes.new("cube")
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    data.from_pydata(corners.tolist(), [], [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6)])
    cube = bpy.data.objects.new("cube", data)
    (collection or bpy.context.scene.collection).objects.link(cube)
    return cube


@pytest.fixture
def built(small):
    assert press("build") == {"FINISHED"}
    return small


# ----------------------------------------------------------------------------------------- building


def test_build_plants_a_forest(built):
    assert 1 <= len(trees()) <= 12
    assert len({tree.data for tree in trees()}) == 1
    assert facts(built, "forest")["Trees"] == str(len(trees()))
    assert {*SENSORS, "reverb receiver"} == {
        thing.name for thing in layout.part(bpy.context.scene, "Sensors").objects
    }


def test_building_again_is_the_same_forest_and_nothing_piles_up(built):
    places = sorted(tuple(tree.matrix_world.translation) for tree in trees())
    before = counts()
    assert press("build") == {"FINISHED"}
    assert sorted(tuple(tree.matrix_world.translation) for tree in trees()) == places
    assert counts() == before
    assert [c.name for c in bpy.context.scene.collection.children] == ["Forest"]


def test_another_seed_is_another_forest(built):
    places = sorted(tuple(tree.matrix_world.translation) for tree in trees())
    built.seed += 1
    press("build")
    assert sorted(tuple(tree.matrix_world.translation) for tree in trees()) != places


def test_an_update_keeps_objects_and_edits_and_can_be_undone(built):
    tree, ground = trees()[0], bpy.data.objects["Ground"]
    tree.modifiers.new("mine", "DECIMATE").ratio = 0.5
    ground.hide_render = True
    ground.data.materials[0] = bpy.data.materials.new("mine")
    states = []
    for _ in range(3):
        bpy.ops.ed.undo_push(message="step")
        places = {tree.name: tuple(tree.location) for tree in trees()}
        states.append((bpy.context.scene.forest_sensing.seed, places))
        bpy.context.scene.forest_sensing.seed += 1
        assert press("build") == {"FINISHED"}
        assert (bpy.data.objects["Ground"], trees()[0]) == (ground, tree)
    assert len({str(places) for _, places in states}) == 3
    bpy.ops.ed.undo_push(message="step")
    for seed, places in reversed(states):
        bpy.ops.ed.undo()
        assert bpy.context.scene.forest_sensing.seed == seed
        assert {tree.name: tuple(tree.location) for tree in trees()} == places
        assert trees()[0].modifiers["mine"].ratio == 0.5
        ground = bpy.data.objects["Ground"]
        assert (ground.hide_render, ground.data.materials[0].name) == (True, "mine")


def test_an_update_that_is_cancelled_changes_nothing(built):
    before, places = counts(), {tree.name: tree.matrix_world.copy() for tree in trees()}
    meshes = {mesh.name: mesh.session_uid for mesh in bpy.data.meshes}
    built.seed += 1
    job = Job("Update", operators.FOREST_OT_build.work(None, bpy.context))
    while job.label != "growing trees":
        assert not job.step()
    job.cancel()
    while job.busy:
        pass
    assert counts() == before
    assert {tree.name: tree.matrix_world for tree in trees()} == places
    assert {mesh.name: mesh.session_uid for mesh in bpy.data.meshes} == meshes
    assert press("build") == {"FINISHED"}
    assert {tree.name: tree.matrix_world for tree in trees()} != places


def test_a_forest_without_trees_is_a_ground(small):
    small.plantings[0].expected = 0
    assert press("build") == {"FINISHED"}
    assert trees() == []
    assert run("cloud") == {"FINISHED"}
    assert facts(small, "cloud")["Ground"] == "100.0 %"


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda p: setattr(p.forest, "size", (0, 6)), r"forest\.size\[0\].*larger than 0"),
        (lambda p: setattr(p.plantings[0], "species", "baobab"), "baobab.*hazelnut"),
        (lambda p: setattr(p.plantings[0], "species", "no.toml"), "no.toml.*no such file"),
        (lambda p: setattr(p.plantings[0], "use_expected", False), "expected.*give a number"),
        (lambda p: setattr(p.plantings[0], "scale", (2, 1)), "smallest, largest"),
        (lambda p: setattr(settings_of("echo"), "band", (8e4, 6e4)), r"echo\.band"),
    ],
)
def test_a_bad_setting_is_reported_and_the_old_forest_kept(built, spoil, words):
    before, places = counts(), {tree.name: tree.matrix_world.copy() for tree in trees()}
    spoil(built)
    with pytest.raises(RuntimeError, match=words):
        press("build")
    assert counts() == before
    assert {tree.name: tree.matrix_world for tree in trees()} == places
    assert facts(built, "forest")["Trees"] == str(len(places))


def test_a_build_that_breaks_midway_takes_back_what_it_made(built, monkeypatch):
    before, names = counts(), {tree.name for tree in trees()}

    def full(*_):
        raise MemoryError

    monkeypatch.setattr(forest_room, "ground_mesh", full)
    with pytest.raises(RuntimeError, match="not enough memory"):
        press("build")
    assert counts() == before
    assert {tree.name for tree in trees()} == names


def test_what_the_user_has_is_left_alone(props, request):
    own = bpy.data.collections.new("Forest")
    bpy.context.scene.collection.children.link(own)
    request.getfixturevalue("small")
    cube = add_cube(own)
    for _ in range(2):
        press("build")
    assert cube.name in bpy.data.objects
    assert own.name == "Forest"
    assert len(bpy.context.scene.collection.children) == 2


def test_the_first_press_starts_with_the_demo_scene(props, monkeypatch, tmp_path):
    text = (ROOT / "assets/scenes/demo.toml").read_text().split("[[plantings]]")[0]
    demo = tmp_path / "demo.toml"
    demo.write_text(text)
    monkeypatch.setattr(operators, "DEMO", demo)
    assert press("build") == {"FINISHED"}
    assert props.name == "Demo forest"
    assert exchange.to_spec(bpy.context.scene).forest == read_settings(demo, Scene).forest


# ------------------------------------------------------------------------------------------ sensing


@pytest.mark.parametrize("name", SENSORS)
def test_each_sensor_finds_something(built, name):
    assert run(name) == {"FINISHED"}
    figures = facts(built, name)
    found = {"scan": "Points", "cloud": "Points", "echo": "Leaves Heard", "reverb": "Trunks Heard"}
    assert int(figures[found[name]].split()[0].replace(",", "")) > 0


@pytest.mark.parametrize("name", LIDARS)
def test_points_are_shown_and_selected_on_request(built, name):
    cube = add_cube()
    cube.select_set(True)
    run(name)
    (cloud,) = clouds()
    assert cloud.visible_get()
    assert bpy.context.selected_objects == [cube]
    assert press("select_result", shown=cloud.name) == {"FINISHED"}
    assert bpy.context.selected_objects == [cloud]
    assert bpy.context.view_layer.objects.active == cloud
    assert len(cloud.data.vertices) == int(facts(built, name)["Points"].replace(",", ""))
    assert {"tree", "organ", "distance"} <= set(cloud.data.attributes.keys())


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


@pytest.mark.parametrize("name", SENSORS)
def test_twice_in_a_row_nothing_piles_up(built, name):
    run(name)
    before = counts()
    run(name)
    assert counts() == before
    assert len(built.results) == 2


def test_everything_twice_nothing_piles_up(small):
    def everything():
        assert press("build") == {"FINISHED"}
        assert press("run") == {"FINISHED"}

    everything()
    everything()
    before = counts()
    everything()
    assert counts() == before
    assert sorted(result.name for result in small.results) == sorted(["forest", *SENSORS])


def test_a_scene_with_nothing_in_it_says_build_first(props, sensor):
    sensor("sonar")
    with pytest.raises(RuntimeError, match="Build a forest first"):
        press("run")


def test_a_scene_without_sensors_says_add_one(props):
    add_cube()
    with pytest.raises(RuntimeError, match="no sensor yet"):
        press("run")


def test_a_sensor_that_is_gone_is_named(built):
    with pytest.raises(RuntimeError, match="ear is no sensor"):
        run("ear")


def test_sensors_run_in_a_scene_of_the_users_own(props, sensor):
    add_cube()
    sensor("terrestrial", angle_step_deg=6)
    sensor("tractor", step=5)
    sensor("sonar")
    sensor("reverb")
    assert press("run") == {"FINISHED"}
    assert len(props.results) == 4


@pytest.mark.parametrize("name", SENSORS)
def test_sensors_run_when_trees_or_results_were_deleted(built, name):
    run(name)
    for thing in [*trees(), *clouds()]:
        bpy.data.objects.remove(thing)
    assert run(name) == {"FINISHED"}
    assert len(clouds()) == (name in (*LIDARS, "echo"))


def test_a_forest_is_built_when_our_collections_were_deleted(built, sensor):
    run("cloud")
    bpy.data.collections.remove(layout.root(bpy.context.scene))
    assert press("build") == {"FINISHED"}
    sensor("terrestrial", name="another", position=(3, 3, 1), angle_step_deg=6)
    assert run("another") == {"FINISHED"}


def test_a_cloud_shows_even_where_its_collection_was_hidden(built):
    layer = bpy.context.view_layer.layer_collection.children["Forest"]
    layer.children["Results"].exclude = True
    run("cloud")
    (cloud,) = clouds()
    assert cloud.visible_get()
    assert press("select_result", shown=cloud.name) == {"FINISHED"}
    assert cloud.select_get()


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


def test_a_sensor_that_is_moved_sees_from_there(built):
    run("cloud")
    before = facts(built, "cloud")
    bpy.data.objects["cloud"].location = (0, 0, 3)
    run("cloud")
    assert facts(built, "cloud") != before


def test_a_new_forest_keeps_the_sensors_where_they_are(built):
    echo = bpy.data.objects["echo"]
    echo.location = (2, 2, 2)
    press("build")
    assert bpy.data.objects["echo"] == echo
    assert tuple(echo.location) == (2, 2, 2)
    assert echo.users_collection[0].name == "Sensors"


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
    assert bpy.context.view_layer.objects.active.name == "reverb.001"
    before = counts()["objects"]
    assert press("remove_sensor") == {"FINISHED"}
    assert counts()["objects"] == before - 2  # the receiver goes too
    assert "reverb.001" not in bpy.data.objects


def test_a_new_forest_forgets_the_results_of_the_old_one(built):
    press("run")
    press("build")
    assert [result.name for result in built.results] == ["forest"]
    assert clouds() == []


def test_an_edit_of_the_scene_is_seen(built):
    run("cloud")
    before = facts(built, "cloud")
    roof = add_cube()
    roof.location, roof.scale = (-20, -20, 3), (40, 40, 1)
    run("cloud")
    assert facts(built, "cloud") != before


# ------------------------------------------------------------------------------------------- saving


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


def test_nothing_is_saved_unless_asked(built, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    press("run")
    assert list(tmp_path.iterdir()) == []


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


def test_a_full_disk_keeps_the_result_in_the_scene(built, tmp_path, monkeypatch):
    from forest_addon.formats import findings

    def full(*_):
        raise OSError(28, "No space left on device", "cloud.laz")

    monkeypatch.setattr(findings, "write_las", full)
    built.output = str(tmp_path)
    assert run("cloud") == {"FINISHED"}
    assert len(clouds()) == 1
    assert list(tmp_path.iterdir()) == []
    assert built.results["cloud"].file == ""


# --------------------------------------------------------------------------------- moving scanners


def test_a_scanner_travels_along_poses(built):
    press("add_sensor", kind="mobile")
    track = bpy.data.objects["track"].forest_sensor.mobile
    for x in (-2.0, 4.0):
        assert press("add_pose") == {"FINISHED"}
        track.poses[-1].position = (x, 3, 2)
    track.pulse_rate, track.line_rate = 200, 2
    track.field_deg = (-180, 180)
    assert track.poses[1].time == 10
    assert run("track") == {"FINISHED"}
    assert int(facts(built, "track")["Points"].replace(",", "")) > 500
    assert press("remove_pose") == {"FINISHED"}
    assert len(track.poses) == 1


def test_a_reverb_has_further_ends(built):
    bpy.context.view_layer.objects.active = bpy.data.objects["reverb"]
    for end in ("source", "receiver", "receiver"):
        assert press(f"add_{end}") == {"FINISHED"}
    settings = settings_of("reverb")
    assert tuple(settings.sources[0].position) == (3, 3, 1.5)
    settings.receivers[0].position = (5, 1, 1)
    assert run("reverb") == {"FINISHED"}
    found = exchange.sensor_of(bpy.data.objects["reverb"])
    assert [tuple(place.position) for place in found.receivers] == [(5, 1, 1), (3, 3, 1.5)]
    assert press("remove_receiver") == {"FINISHED"}
    assert len(settings.receivers) == 1
    bpy.context.view_layer.objects.active = bpy.data.objects["cloud"]
    with pytest.raises(RuntimeError, match="Choose a reverb"):
        press("add_source")


def test_a_scanner_without_a_way_is_told_so(built, sensor):
    track = sensor("mobile").forest_sensor.mobile
    with pytest.raises(RuntimeError, match="give poses, or the object to follow"):
        run("track")
    track.follow = "Nothing"
    with pytest.raises(RuntimeError, match='no object "Nothing"'):
        run("track")


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
    settings.scanner = "riegl-vz-400"  # not complete yet
    assert settings.max_range == 77
    settings.scanner = "riegl-vz-400i"
    found = exchange.sensor_of(bpy.data.objects["cloud"])
    assert (found.max_range, found.min_range, found.beam.exit_diameter) == (800, 1.5, 0.007)
    assert (found.name, found.position) == ("cloud", (3, 3, 1))
    settings.beam.subrays = 3
    assert exchange.sensor_of(bpy.data.objects["cloud"]).beam.subrays == 3


# ------------------------------------------------------------------------------ scene files, modes


def test_an_exported_scene_file_says_the_same(built, tmp_path):
    path = tmp_path / "mine.toml"
    assert press("save_scene", filepath=str(path)) == {"FINISHED"}
    assert read_settings(path, Scene) == exchange.to_spec(bpy.context.scene)
    before = exchange.to_spec(bpy.context.scene)
    assert press("load_scene", filepath=str(path)) == {"FINISHED"}
    assert exchange.to_spec(bpy.context.scene) == before


def test_without_a_window_the_exported_scene_gives_the_same_bytes(built, tmp_path):
    """The panel's scene and the one of a file are the same thing: every result, bit for bit."""
    built.output = str(tmp_path / "panel")
    assert press("run") == {"FINISHED"}
    path = tmp_path / "mine.toml"
    press("save_scene", filepath=str(path))
    path.write_text(path.read_text() + "\n[output]\nblend = false\nglb = false\npreview = false\n")
    out = tmp_path / "headless"
    done = subprocess.run(
        [sys.executable, "-m", "headless", "run", str(path), "--out", str(out), "--quiet"],
        cwd=ROOT, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    results = sorted(file.name for file in (tmp_path / "panel").iterdir())
    assert len(results) == 6
    for name in results:
        ours, theirs = ((tmp_path / where / name).read_bytes() for where in ("panel", "headless"))
        if name.endswith(".npz"):  # an archive also holds when it was written
            ours, theirs = ({k: v.tobytes() for k, v in np.load(tmp_path / where / name).items()}
                            for where in ("panel", "headless"))  # fmt: skip
        assert ours == theirs, name


def test_the_dice_and_the_sound(built):
    seed = built.seed
    assert press("new_seed") == {"FINISHED"}
    assert built.seed != seed
    with pytest.raises(RuntimeError, match="Run it again"):
        press("play", sensor="reverb")
    run("reverb")
    sound = bpy.data.objects["reverb"].data.sound
    assert sound.packed_file is not None


def test_a_scene_file_is_opened(props):
    demo = ROOT / "assets/scenes/demo.toml"
    assert press("load_scene", filepath=str(demo)) == {"FINISHED"}
    assert props.plantings[0].species == read_settings(demo, Scene).plantings[0].species
    assert trees() == []


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("seed = -1", "seed"),
        ("forrest = 1", "did you mean"),
        ("[", "not TOML"),
        (None, "no such file"),
        ("seed = 9999999999", "too large for the panel"),
    ],
)
def test_a_bad_scene_file_changes_nothing(small, tmp_path, text, words):
    path = tmp_path / "bad.toml"
    if text is not None:
        path.write_text(text)
    before = exchange.to_spec(bpy.context.scene)
    with pytest.raises(RuntimeError, match=words):
        press("load_scene", filepath=str(path))
    assert exchange.to_spec(bpy.context.scene) == before


def test_species_files_are_found_beside_the_scene_file(props, tmp_path):
    for name in ("species", "templates"):
        shutil.copytree(ROOT / "assets" / name, tmp_path / name)
    (tmp_path / "scene.toml").write_text(
        '[forest]\nsize = [6, 6]\n[[plantings]]\nspecies = "species/hazelnut.toml"\nexpected = 3\n'
    )
    press("load_scene", filepath=str(tmp_path / "scene.toml"))
    assert press("build") == {"FINISHED"}


@pytest.mark.parametrize("name", ["build", "run"])
def test_other_modes_are_refused_with_a_reason(built, name):
    bpy.context.view_layer.objects.active = add_cube()
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="Object Mode"):
        press(name)
    bpy.ops.object.mode_set(mode="OBJECT")


@pytest.mark.parametrize("name", ["build", "run"])
def test_a_missing_package_is_named(small, name, monkeypatch):
    monkeypatch.setattr(requirements, "missing", lambda: ("scipy",))
    with pytest.raises(RuntimeError, match="scipy is missing"):
        press(name)


def test_a_saved_file_brings_everything_back(built, tmp_path):
    run("cloud")
    run("echo")
    before, figures = exchange.to_spec(bpy.context.scene), facts(built, "echo")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "forest.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "forest.blend"))
    props = bpy.context.scene.forest_sensing
    assert exchange.to_spec(bpy.context.scene) == before
    assert facts(props, "echo") == figures
    count = counts()
    press("build")
    run("cloud")
    run("echo")
    assert counts() == count


def test_each_scene_has_a_forest_of_its_own(built):
    first = bpy.context.scene
    number = len(trees())
    second = bpy.data.scenes.new("Second")
    with bpy.context.temp_override(scene=second, view_layer=second.view_layers[0]):
        exchange.from_spec(second, exchange.to_spec(first))
        press("build")
    assert layout.root(first) is not None
    assert len(trees()) == 2 * number


def test_one_tree_is_no_trees(small):
    small.plantings[0].expected, small.plantings[0].exact = 1, True
    work, outcome = operators.FOREST_OT_build.work(None, bpy.context), None
    with pytest.raises(StopIteration, match=r"^1 tree with [\d,]+ leaves in [\d.]+ s$"):
        while True:
            outcome = work.send(outcome).run(lambda done, total: None)


def test_a_terrain_that_is_deleted_while_trees_grow_on_it(small):
    """They stand where it was."""
    data = bpy.data.meshes.new("hill")
    data.from_pydata([(-9, -9, 5), (9, -9, 5), (9, 9, 5), (-9, 9, 5)], [], [(0, 1, 2, 3)])
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("hill", data))
    small.forest.terrain.object = "hill"
    work, outcome = operators.FOREST_OT_build.work(None, bpy.context), None
    with pytest.raises(StopIteration, match="trees with"):
        while True:
            task = work.send(outcome)
            outcome = task.run(lambda done, total: None)
            if task.label == "growing trees":
                bpy.data.objects.remove(bpy.data.objects["hill"])
    bpy.context.view_layer.update()
    assert {round(tree.matrix_world.translation.z, 6) for tree in trees()} == {5.0}


def test_a_job_stays_in_the_scene_that_it_was_begun_in(built):
    """Whatever the window shows meanwhile: points, figures and forest belong where the button was pressed."""
    first, second = bpy.context.scene, bpy.data.scenes.new("Second")
    for name, expected in (("build", ["forest"]), ("run", ["cloud", "forest"])):
        begun, kind = bpy.context, getattr(operators, f"FOREST_OT_{name}")
        button = SimpleNamespace(sensor="cloud", frames="THIS")
        button._look = partial(operators.FOREST_OT_run._look, button)
        work = kind.work(button, begun)
        modal = SimpleNamespace(
            _job=Job(name, work), _begun_in=(begun.scene, begun.view_layer.name), _shown="",
            _leave=lambda _: None, report=lambda *_: None,
        )  # fmt: skip
        tick, answer = SimpleNamespace(type="TIMER", value="NOTHING"), {"RUNNING_MODAL"}
        while answer == {"RUNNING_MODAL"}:
            answer = running.Working.modal(modal, bpy.context, tick)
            bpy.context.window.scene = second
        assert answer == {"FINISHED"}
        assert sorted(first.forest_sensing.results.keys()) == expected
        assert len(second.forest_sensing.results) == len(second.objects) == 0
        bpy.context.window.scene = first


def test_a_job_whose_scene_is_removed_says_so(built):
    scene, said = bpy.data.scenes.new("Second"), []
    modal = SimpleNamespace(
        _job=Job("Build", (None for _ in ())), _begun_in=(scene, scene.view_layers[0].name),
        _leave=lambda _: None, report=lambda _, words: said.append(words),
    )  # fmt: skip
    bpy.data.scenes.remove(scene)
    tick = SimpleNamespace(type="TIMER", value="NOTHING")
    assert running.Working.modal(modal, bpy.context, tick) == {"CANCELLED"}
    assert said == ["The scene was removed or undone meanwhile; run it again"]


# -------------------------------------------------------------------------------------------- lists


def test_plantings_and_hills_are_added_and_removed(props):
    assert press("add_planting") == {"FINISHED"}
    assert press("add_gaussian") == {"FINISHED"}
    assert press("add_gaussian") == {"FINISHED"}
    planting = exchange.to_spec(bpy.context.scene).plantings[0]
    assert planting.species == "maple"
    assert planting.gaussians[0].centre == (15.0, 15.0)
    assert press("remove_gaussian") == {"FINISHED"}
    assert len(props.plantings[0].gaussians) == 1
    assert press("remove_planting") == {"FINISHED"}
    assert len(props.plantings) == 0
    assert not bpy.ops.forest.remove_planting.poll()
    assert not bpy.ops.forest.add_gaussian.poll()


def test_points_are_selected_from_the_results(built):
    run("cloud")
    (cloud,) = clouds()
    cloud.select_set(False)
    assert press("select_result", shown=cloud.name) == {"FINISHED"}
    assert cloud.select_get()
    bpy.data.objects.remove(cloud)
    with pytest.raises(RuntimeError, match="Run its sensor again"):
        press("select_result", shown="cloud points")
