"""Files that are saved and loaded: of today, of a later version, of somebody else."""

import math

import pytest

bpy = pytest.importorskip("bpy")

from ui import test_panels

from forest_addon import spec
from forest_addon.ui.settings import exchange
from forest_addon.ui.settings import references as saved


def reopened(path):
    """The scene after saving to a file and loading that."""
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.context.scene


def test_a_file_of_a_newer_version_says_so(props, tmp_path, caplog):
    props.seed, props.layout = 5, saved.LAYOUT + 1
    for _ in range(2):  # also when it was saved here
        props = reopened(tmp_path / "newer.blend").forest_sensing
        assert props.notice.startswith("Saved by a newer version")
        assert "Update Forest Sensing" in props.notice
        assert "newer version" in caplog.text
        assert props.layout == saved.LAYOUT + 1
        assert "Saved by a newer version" in test_panels.drawn()
    assert props.seed == 5
    assert bpy.ops.forest.take_note() == {"FINISHED"}
    assert not props.notice
    assert not bpy.ops.forest.take_note.poll()


def test_a_file_without_settings_of_ours_is_not_touched(props, tmp_path, caplog):
    test_panels.drawn()  # drawing makes empty groups in Blender 4.5
    scene = reopened(tmp_path / "own.blend")
    assert exchange.untouched(scene.forest_sensing)
    assert not scene.forest_sensing.is_property_set("layout")
    assert len(bpy.data.objects) == 0
    assert caplog.text == ""


def test_handlers_go_with_the_add_on(registered):
    from forest_addon import ui

    handlers = bpy.app.handlers
    lists = (handlers.load_post, handlers.blend_import_post, handlers.save_pre)
    assert all(any(h.__module__ == saved.__name__ for h in hooked) for hooked in lists)
    ui.unregister()
    try:
        assert not any(h.__module__ == saved.__name__ for hooked in lists for h in hooked)
        assert not bpy.app.timers.is_registered(saved._look_at_all)
    finally:
        ui.register()


def test_what_is_shown_in_other_units_is_not_stored(props, tmp_path, caplog):
    """Angles, kHz and the instruments' names convert what a file has, and leave it in its units."""
    props.seed = 4
    scene = bpy.context.scene
    for sensor in (spec.Sonar(beam_width_deg=(40, 40)), spec.Terrestrial(angle_step_deg=6)):
        exchange.add_sensor(scene, sensor)
    bpy.context.view_layer.update()
    before = exchange.to_spec(scene)
    bat = bpy.data.objects["echo"].forest_sensor.sonar
    cloud = bpy.data.objects["cloud"].forest_sensor.terrestrial
    assert list(bat.band_shown) == [60.0, 80.0]
    assert cloud.angle_step_deg_shown == pytest.approx(math.radians(6))
    for name in ("band_shown", "sample_rate_shown", "beam_width_deg_shown"):
        setattr(bat, name, getattr(bat, name))
    cloud.angle_step_deg_shown = cloud.angle_step_deg_shown
    assert exchange.to_spec(scene) == before
    scene = reopened(tmp_path / "today.blend")
    assert exchange.to_spec(scene) == before
    assert scene.forest_sensing.layout == saved.LAYOUT
    assert (scene.forest_sensing.notice, caplog.text) == ("", "")
