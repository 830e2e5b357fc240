"""Every button, pressed for real in Blender on a forest of three small trees."""

import shutil
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.blender import forest as forest_room
from forest_addon.blender.cloud import CLOUD_KEY
from forest_addon.blender.depsgraph import TREE_KEY
from forest_addon.formats.toml_file import read_settings
from forest_addon.spec import Scene, Terrestrial
from forest_addon.ui import exchange, requirements

ROOT = Path(__file__).resolve().parents[2]
SENSES = {"scan": "tractor", "sweep": "terrestrial", "ping": "sonar", "clap": "reverb"}


def press(name, **settings):
    return getattr(bpy.ops.forest, name)(**settings)


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
    assert {"scan", "cloud", "echo", "reverb source", "reverb receiver"} <= {
        thing.name for thing in forest_room.part(bpy.context.scene, "Sensors").objects
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


def test_a_forest_without_trees_is_a_ground(small):
    small.plantings[0].expected = 0
    assert press("build") == {"FINISHED"}
    assert trees() == []
    assert press("sweep") == {"FINISHED"}
    assert facts(small, "terrestrial")["Ground"] == "100.0 %"


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda p: setattr(p.forest, "size", (0, 6)), r"forest\.size\[0\].*larger than 0"),
        (lambda p: setattr(p.plantings[0], "species", "baobab"), "baobab.*hazelnut"),
        (lambda p: setattr(p.plantings[0], "species", "no.toml"), "no.toml.*no such file"),
        (lambda p: setattr(p.plantings[0], "use_expected", False), "expected.*give a number"),
        (lambda p: setattr(p.plantings[0], "scale", (2, 1)), "smallest, largest"),
        (lambda p: setattr(p.sonar, "name", "cloud"), "a name of its own"),
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

    monkeypatch.setattr(forest_room, "_lay_ground", full)
    with pytest.raises(RuntimeError, match="not enough memory"):
        press("build")
    assert counts() == before
    assert {tree.name for tree in trees()} == names


def test_what_the_user_has_is_left_alone(small):
    own = bpy.data.collections.new("Forest")
    bpy.context.scene.collection.children.link(own)
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
    from forest_addon.ui import operators

    monkeypatch.setattr(operators, "DEMO", demo)
    assert press("build") == {"FINISHED"}
    assert props.name == "Demo forest"
    assert exchange.to_spec(props).forest == read_settings(demo, Scene).forest


# ------------------------------------------------------------------------------------------ sensing


@pytest.mark.parametrize("name", SENSES)
def test_each_sensor_finds_something(built, name):
    assert press(name) == {"FINISHED"}
    figures = facts(built, SENSES[name])
    found = {"scan": "Points", "sweep": "Points", "ping": "Leaves Heard", "clap": "Trunks Heard"}
    assert int(figures[found[name]].split()[0].replace(",", "")) > 0


@pytest.mark.parametrize("name", ["scan", "sweep"])
def test_points_are_shown_and_selected(built, name):
    add_cube().select_set(True)
    press(name)
    (cloud,) = clouds()
    assert bpy.context.selected_objects == [cloud]
    assert bpy.context.view_layer.objects.active == cloud
    assert cloud.visible_get()
    assert len(cloud.data.vertices) == int(facts(built, SENSES[name])["Points"].replace(",", ""))
    assert {"tree", "organ", "distance"} <= set(cloud.data.attributes.keys())


def test_points_of_both_lidars_lie_on_the_same_things(built):
    press("scan")
    press("sweep")
    for cloud in clouds():
        ground = np.empty(len(cloud.data.vertices), dtype=np.int32)
        cloud.data.attributes["organ"].data.foreach_get("value", ground)
        place = np.empty((len(ground), 3), dtype=np.float32)
        cloud.data.attributes["position"].data.foreach_get("vector", place.ravel())
        assert np.abs(place[ground == 3, 2]).max(initial=0) < 1e-5
        assert place[ground != 3, 2].min() > -0.05


@pytest.mark.parametrize("name", SENSES)
def test_twice_in_a_row_nothing_piles_up(built, name):
    press(name)
    before = counts()
    press(name)
    assert counts() == before
    assert len(built.results) == 2


def test_everything_twice_nothing_piles_up(small):
    def everything():
        for name in ("build", *SENSES):
            assert press(name) == {"FINISHED"}

    everything()
    everything()
    before = counts()
    everything()
    assert counts() == before
    assert sorted(result.name for result in small.results) == sorted(["forest", *SENSES.values()])


@pytest.mark.parametrize("name", SENSES)
def test_a_scene_with_nothing_in_it_says_build_first(props, name):
    with pytest.raises(RuntimeError, match="Build a forest first"):
        press(name)


@pytest.mark.parametrize("name", SENSES)
def test_sensors_run_in_a_scene_of_the_users_own(props, name):
    add_cube()
    props.terrestrial.angle_step_deg = 6
    props.tractor.step = 5
    assert press(name) == {"FINISHED"}


@pytest.mark.parametrize("name", SENSES)
def test_sensors_run_when_trees_or_results_were_deleted(built, name):
    press(name)
    for thing in [*trees(), *clouds()]:
        bpy.data.objects.remove(thing)
    assert press(name) == {"FINISHED"}
    assert len(clouds()) == (name in ("scan", "sweep"))


def test_sensors_run_when_our_collections_were_deleted(built):
    press("sweep")
    bpy.data.collections.remove(forest_room.root(bpy.context.scene))
    add_cube()
    assert press("sweep") == {"FINISHED"}
    assert press("build") == {"FINISHED"}


def test_a_cloud_shows_even_where_its_collection_was_hidden(built):
    layer = bpy.context.view_layer.layer_collection.children["Forest"]
    layer.children["Results"].exclude = True
    press("sweep")
    (cloud,) = clouds()
    assert cloud.visible_get()
    assert cloud.select_get()


@pytest.mark.parametrize(
    ("name", "spoil", "words"),
    [
        ("sweep", lambda p: setattr(p.terrestrial, "azimuth_deg", (90, 10)), "from < to"),
        ("scan", lambda p: setattr(p.tractor, "top", 0.5), r"tractor\.top.*above the scanner"),
        ("ping", lambda p: setattr(p.sonar, "band", (1e5, 3e5)), r"sonar\.band.*sample_rate"),
        ("clap", lambda p: setattr(p.reverb, "source", (1, 1, -1)), "above the ground"),
    ],
)
def test_a_bad_sensor_is_reported_and_its_last_result_kept(built, name, spoil, words):
    press(name)
    before, figures = counts(), facts(built, SENSES[name])
    spoil(built)
    with pytest.raises(RuntimeError, match=words):
        press(name)
    assert counts() == before
    assert facts(built, SENSES[name]) == figures


def test_markers_follow_the_sensors(built):
    before = counts()["objects"]
    built.sonar.position = (2, 2, 2)
    press("ping")
    assert counts()["objects"] == before
    assert tuple(bpy.data.objects["echo"].location) == (2, 2, 2)


def test_a_new_forest_forgets_the_results_of_the_old_one(built):
    for name in SENSES:
        press(name)
    press("build")
    assert [result.name for result in built.results] == ["forest"]
    assert clouds() == []


def test_an_edit_of_the_scene_is_seen(built):
    press("sweep")
    before = facts(built, "terrestrial")
    roof = add_cube()
    roof.location, roof.scale = (-20, -20, 3), (40, 40, 1)
    press("sweep")
    assert facts(built, "terrestrial") != before


# ------------------------------------------------------------------------------------------- saving


@pytest.mark.parametrize(
    ("name", "file"),
    [("scan", "scan.npz"), ("sweep", "cloud.laz"), ("ping", "echo.npz"), ("clap", "reverb.wav")],
)
def test_results_are_saved_where_the_user_says(built, name, file, tmp_path):
    built.output = str(tmp_path / "new" / "folder")
    press(name)
    written = tmp_path / "new" / "folder" / file
    assert written.stat().st_size > 0
    assert built.results[SENSES[name]].file == str(written)


def test_nothing_is_saved_unless_asked(built, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in SENSES:
        press(name)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_is_said_before_the_work(built, tmp_path):
    (tmp_path / "file").write_text("x")
    built.output = str(tmp_path / "file" / "folder")
    with pytest.raises(RuntimeError, match=r"Save To.*cannot be made"):
        press("sweep")
    assert clouds() == []


def test_a_folder_beside_an_unsaved_file_is_refused(built):
    built.output = "//results"
    with pytest.raises(RuntimeError, match="save that first"):
        press("ping")


def test_a_full_disk_keeps_the_result_in_the_scene(built, tmp_path, monkeypatch):
    from forest_addon.formats import findings

    def full(*_):
        raise OSError(28, "No space left on device", "cloud.laz")

    monkeypatch.setattr(findings, "write_las", full)
    built.output = str(tmp_path)
    assert press("sweep") == {"FINISHED"}
    assert len(clouds()) == 1
    assert list(tmp_path.iterdir()) == []
    assert built.results["terrestrial"].file == ""


# --------------------------------------------------------------------------------- moving scanners


def test_a_scanner_travels_along_poses(built):
    for x in (-2.0, 4.0):
        assert press("add_pose") == {"FINISHED"}
        built.mobile.poses[-1].position = (x, 3, 2)
    built.mobile.pulse_rate, built.mobile.line_rate = 200, 2
    built.mobile.field_deg = (-180, 180)
    assert built.mobile.poses[1].time == 10
    assert press("travel") == {"FINISHED"}
    assert int(facts(built, "mobile")["Points"].replace(",", "")) > 500
    assert bpy.data.objects["track"].location.x == -2  # its marker
    assert press("remove_pose") == {"FINISHED"}
    assert len(built.mobile.poses) == 1


def test_a_scanner_without_a_way_is_told_so(built):
    with pytest.raises(RuntimeError, match="give poses, or the object to follow"):
        press("travel")
    built.mobile.follow = "Nothing"
    with pytest.raises(RuntimeError, match='no object "Nothing"'):
        press("travel")


def test_a_scanner_flies_over_the_forest(built):
    built.airborne.position, built.airborne.track, built.airborne.speed = (3, -2, 30), 10, 10
    built.airborne.pulse_rate, built.airborne.line_rate = 2000, 20
    assert press("fly") == {"FINISHED"}
    figures = facts(built, "airborne")
    assert figures["Beams"] == "2,000"
    assert int(figures["Points"].replace(",", "")) > 100


def test_choosing_a_scanner_fills_in_its_figures(props):
    props.terrestrial.max_range = 77
    props.terrestrial.name = "mine"
    props.terrestrial.scanner = "riegl-vz-400"  # not complete yet
    assert props.terrestrial.max_range == 77
    props.terrestrial.scanner = "riegl-vz-400i"
    sensor = exchange.read(props.terrestrial, Terrestrial)
    assert (sensor.max_range, sensor.min_range, sensor.beam.exit_diameter) == (800, 1.5, 0.007)
    assert (sensor.name, sensor.position) == ("mine", Terrestrial().position)
    props.terrestrial.beam.subrays = 3
    assert exchange.read(props.terrestrial, Terrestrial).beam.subrays == 3


# ------------------------------------------------------------------------------ scene files, modes


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
    before = exchange.to_spec(small)
    with pytest.raises(RuntimeError, match=words):
        press("load_scene", filepath=str(path))
    assert exchange.to_spec(small) == before


def test_species_files_are_found_beside_the_scene_file(props, tmp_path):
    for name in ("species", "templates"):
        shutil.copytree(ROOT / "assets" / name, tmp_path / name)
    (tmp_path / "scene.toml").write_text(
        '[forest]\nsize = [6, 6]\n[[plantings]]\nspecies = "species/hazelnut.toml"\nexpected = 3\n'
    )
    press("load_scene", filepath=str(tmp_path / "scene.toml"))
    assert press("build") == {"FINISHED"}


@pytest.mark.parametrize("name", ["build", *SENSES])
def test_other_modes_are_refused_with_a_reason(built, name):
    bpy.context.view_layer.objects.active = add_cube()
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="Object Mode"):
        press(name)
    bpy.ops.object.mode_set(mode="OBJECT")


@pytest.mark.parametrize("name", ["build", *SENSES])
def test_a_missing_package_is_named(small, name, monkeypatch):
    monkeypatch.setattr(requirements, "missing", lambda: ("scipy",))
    with pytest.raises(RuntimeError, match="scipy is missing"):
        press(name)


def test_a_saved_file_brings_everything_back(built, tmp_path):
    press("sweep")
    press("ping")
    before, figures = exchange.to_spec(built), facts(built, "sonar")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "forest.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "forest.blend"))
    props = bpy.context.scene.forest_sensing
    assert exchange.to_spec(props) == before
    assert facts(props, "sonar") == figures
    count = counts()
    press("build")
    press("sweep")
    press("ping")
    assert counts() == count


def test_each_scene_has_a_forest_of_its_own(built):
    first = bpy.context.scene
    number = len(trees())
    second = bpy.data.scenes.new("Second")
    with bpy.context.temp_override(scene=second, view_layer=second.view_layers[0]):
        exchange.from_spec(second.forest_sensing, exchange.to_spec(built))
        press("build")
    assert forest_room.root(first) is not None
    assert len(trees()) == 2 * number


# -------------------------------------------------------------------------------------------- lists


def test_plantings_and_hills_are_added_and_removed(props):
    assert press("add_planting") == {"FINISHED"}
    assert press("add_gaussian") == {"FINISHED"}
    assert press("add_gaussian") == {"FINISHED"}
    planting = exchange.to_spec(props).plantings[0]
    assert planting.species == "maple"
    assert planting.gaussians[0].centre == (15.0, 15.0)
    assert press("remove_gaussian") == {"FINISHED"}
    assert len(props.plantings[0].gaussians) == 1
    assert press("remove_planting") == {"FINISHED"}
    assert len(props.plantings) == 0
    assert not bpy.ops.forest.remove_planting.poll()
    assert not bpy.ops.forest.add_gaussian.poll()


def test_points_are_selected_from_the_results(built):
    press("sweep")
    (cloud,) = clouds()
    cloud.select_set(False)
    assert press("select_result", shown=cloud.name) == {"FINISHED"}
    assert cloud.select_get()
    bpy.data.objects.remove(cloud)
    with pytest.raises(RuntimeError, match="Run its sensor again"):
        press("select_result", shown="cloud points")
