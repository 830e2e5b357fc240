"""Files of older versions. data/first-panel.blend was saved by the first panel, in Blender 4.5."""

import math
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

from ui import test_panels

from forest_addon import spec
from forest_addon.blender.read.depsgraph import TREE_KEY
from forest_addon.blender.scene import layout
from forest_addon.blender.scene.layout import CLOUD_KEY
from forest_addon.blender.sensors import objects as sensors
from forest_addon.spec import Gaussian, Planting
from forest_addon.ui.settings import exchange, migration

FIRST = Path(__file__).with_name("data") / "first-panel.blend"


@pytest.fixture
def first(registered):
    """The scene of the first panel, as it is after loading."""
    bpy.ops.wm.open_mainfile(filepath=str(FIRST))
    yield bpy.context.scene
    bpy.ops.wm.read_factory_settings(use_empty=True)


def test_settings_are_what_they_were(first):
    settings = exchange.to_spec(first)
    assert (settings.name, settings.seed) == ("My old wood", 12)
    assert settings.forest == spec.Forest(size=(8.0, 6.0), margin=5.0, spacing=1.5)
    hill = Gaussian(peak=0.25, centre=(3.0, 2.0), width=(4.0, 5.0))
    hazel = Planting(species="hazelnut", variants=1, expected=4.0, scale=(0.8, 1.1),
                     gaussians=(hill,))  # fmt: skip
    assert settings.plantings == (hazel, Planting(species="maple", variants=2, expected=0.0))
    assert settings.air == spec.Air(temperature_c=11.0, humidity=70.0, sound_speed=338.5)
    assert first.forest_sensing.output == "//results"


def test_sensors_become_objects_with_their_settings(first):
    found = {sensor.name: sensor for sensor in exchange.to_spec(first).sensors}
    assert found == {
        "scan": spec.Tractor(position=(-2, 0, 1), track=6, step=0.5, gap=14, angle_step_deg=5,
                             reach=16, top=18, side="left"),
        "cloud": spec.Terrestrial(position=(3, 3, 1.7), angle_step_deg=6,
                                  surfaces=spec.Surfaces(other=0.35, wood=0.35, leaf=0.35,
                                                         ground=0.35)),
        "echo": spec.Sonar(position=(-1, 3, 1), azimuth_deg=35, elevation_deg=12, max_range=4,
                           beam_width_deg=(40, 40), leaf_model="paper"),
        "reverb": spec.Reverb(source=(1, 1, 1), receiver=(7, 5, 1.25), duration=0.1,
                              sample_rate=4000, continue_to=180),
    }  # fmt: skip
    assert {thing.type for thing in sensors.sensors_of(first)} == {"EMPTY", "SPEAKER"}
    names = [thing.name for thing in sensors.home_of(first).objects]
    assert sorted(names) == ["cloud", "echo", "reverb", "reverb receiver", "scan"]


def test_a_setting_that_was_never_changed_keeps_what_it_then_meant():
    assert migration._first_sensor("sonar", {})[0].leaf_model == "piston"
    assert spec.Sonar().leaf_model == "exact"


def test_what_cannot_be_used_is_said():
    sensor, problem = migration._first_sensor("sonar", {"band": [9e5, 2e5]})
    assert sensor == spec.Sonar()
    assert "sonar has default settings, because band" in problem


def test_results_stay_with_their_sensors(first):
    results = first.forest_sensing.results
    assert [(r.name, r.kind) for r in results] == [
        *(("forest", "forest"), ("cloud", "terrestrial"), ("echo", "sonar"))
    ]
    assert results["cloud"].shown == "cloud points"
    assert results["echo"].picture is not None
    assert bpy.ops.forest.select_result(shown="cloud points") == {"FINISHED"}


@pytest.mark.slow
def test_the_next_forest_takes_the_place_of_the_old_one(first):
    rock = bpy.data.objects["My rock"]
    first.forest_sensing.output = ""
    assert bpy.ops.forest.build() == {"FINISHED"}
    assert bpy.ops.forest.run() == {"FINISHED"}
    top = layout.root(first)
    trees = [thing for thing in bpy.data.objects if TREE_KEY in thing]
    assert trees
    assert set(trees) <= set(top.all_objects)
    assert len(trees) == int(first.forest_sensing.results["forest"].figures["Trees"].value)
    assert [thing.name for thing in bpy.data.objects if thing.name.startswith("Ground")] == [
        "Ground"
    ]
    assert len([thing for thing in bpy.data.objects if thing.get(CLOUD_KEY) == "cloud"]) == 1
    assert rock.name in top.all_objects  # the user's own
    assert "Forest.001" not in bpy.data.collections


def test_it_is_said_once_and_can_be_dismissed(registered, caplog):
    bpy.ops.wm.open_mainfile(filepath=str(FIRST))
    notice = bpy.context.scene.forest_sensing.notice
    assert notice.startswith("Saved by an older version: sensors are objects now")
    assert notice in caplog.text
    assert "Saved by an older version" in test_panels.drawn()
    assert notice in migration.FOREST_OT_take_note.description(bpy.context, None)
    assert bpy.ops.forest.take_note() == {"FINISHED"}
    assert "Saved by an older version" not in test_panels.drawn()
    assert not bpy.ops.forest.take_note.poll()


def test_once_saved_it_is_a_file_of_today(first, tmp_path, caplog):
    bpy.ops.forest.take_note()
    before = exchange.to_spec(first)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "today.blend"))
    caplog.clear()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "today.blend"))
    scene = bpy.context.scene
    assert scene.forest_sensing.layout == migration.LAYOUT
    assert exchange.to_spec(scene) == before
    assert (scene.forest_sensing.notice, caplog.text) == ("", "")


def test_an_appended_scene_is_migrated_too(registered, empty_blender):
    with bpy.data.libraries.load(str(FIRST)) as (source, target):
        target.scenes = source.scenes
    migration._look_at_all()  # Blender calls it after File > Append
    (scene,) = target.scenes
    assert len(sensors.sensors_of(scene)) == 4


def test_a_linked_scene_is_left_as_it_is(registered, empty_blender):
    with bpy.data.libraries.load(str(FIRST), link=True) as (source, target):
        target.scenes = source.scenes
    migration._look_at_all()
    assert sensors.sensors_of(target.scenes[0]) == []


def test_a_file_of_a_newer_version_says_so(props, tmp_path, caplog):
    props.seed, props.layout = 5, migration.LAYOUT + 1
    path = str(tmp_path / "newer.blend")
    for _ in range(2):  # also when it was saved here
        bpy.ops.wm.save_as_mainfile(filepath=path)
        bpy.ops.wm.open_mainfile(filepath=path)
        props = bpy.context.scene.forest_sensing
        assert props.notice.startswith("Saved by a newer version")
        assert "Update Forest Sensing" in props.notice
        assert "newer version" in caplog.text
        assert props.layout == migration.LAYOUT + 1
        assert "Saved by a newer version" in test_panels.drawn()
    assert props.seed == 5


def test_a_file_without_settings_of_ours_is_not_touched(props, tmp_path, caplog):
    test_panels.drawn()  # drawing makes empty groups in Blender 4.5
    path = str(tmp_path / "own.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    scene = bpy.context.scene
    assert exchange.untouched(scene.forest_sensing)
    assert not scene.forest_sensing.is_property_set("layout")
    assert len(bpy.data.objects) == 0
    assert caplog.text == ""


def test_handlers_go_with_the_add_on(registered):
    from forest_addon import ui

    handlers = bpy.app.handlers
    lists = (handlers.load_post, handlers.blend_import_post, handlers.save_pre)
    assert all(any(h.__module__ == migration.__name__ for h in hooked) for hooked in lists)
    ui.unregister()
    try:
        assert not any(h.__module__ == migration.__name__ for hooked in lists for h in hooked)
        assert not bpy.app.timers.is_registered(migration._look_at_all)
    finally:
        ui.register()


def test_what_is_shown_in_other_units_is_not_stored(first, tmp_path):
    """Angles, kHz and the instruments' names convert what an older file has, and leave it in its units."""
    before = exchange.to_spec(first)
    bat = bpy.data.objects["echo"].forest_sensor.sonar
    cloud = bpy.data.objects["cloud"].forest_sensor.terrestrial
    assert list(bat.band_shown) == [60.0, 80.0]
    assert cloud.angle_step_deg_shown == pytest.approx(math.radians(6))
    for name in ("band_shown", "sample_rate_shown", "beam_width_deg_shown"):
        setattr(bat, name, getattr(bat, name))
    cloud.angle_step_deg_shown = cloud.angle_step_deg_shown
    assert exchange.to_spec(first) == before
    path = str(tmp_path / "today.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert exchange.to_spec(bpy.context.scene) == before
