"""Files of other versions: what is not read of them is said, once, and can be dismissed."""

import math

import pytest

bpy = pytest.importorskip("bpy")

from ui import test_panels

from forest_addon.ui.settings import exchange, migration


@pytest.fixture
def old(props):
    """A scene as the first panel kept it: settings of a sensor in the scene."""
    props.seed = 5
    scene = bpy.context.scene
    new = hasattr(scene, "bl_system_properties_get")
    home = scene.bl_system_properties_get(do_create=True) if new else scene
    home[migration.KEY]["tractor"] = {"reach": 16.0}
    return scene


def test_a_file_of_before_1_0_is_told_of_once_and_can_be_dismissed(old, caplog):
    migration._look_at_all()
    notice = old.forest_sensing.notice
    assert notice.startswith("Saved before version 1.0: its sensors are not read")
    assert "sensors are not read" in caplog.text
    assert "Saved before version 1.0" in test_panels.drawn()
    assert notice in migration.FOREST_OT_take_note.description(bpy.context, None)
    assert bpy.ops.forest.take_note() == {"FINISHED"}
    assert "Saved before version 1.0" not in test_panels.drawn()
    assert not bpy.ops.forest.take_note.poll()


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


def test_what_is_shown_in_other_units_is_not_stored(small, sensor, tmp_path):
    """Angles, kHz and the instruments' names convert what an older file has, and leave it in its units."""
    bat = sensor("sonar", name="bat", beam_width_deg=(40, 40))
    first = bpy.context.scene
    bpy.context.view_layer.update()
    before = exchange.to_spec(first)
    bat = bat.forest_sensor.sonar
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
