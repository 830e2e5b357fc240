"""Lists of the panel: their buttons add and remove."""

import pytest

bpy = pytest.importorskip("bpy")

from ui.pressing import (
    facts,
    press,
    run,
    settings_of,
)

from forest_addon.ui.forest import hand
from forest_addon.ui.settings import exchange
from forest_addon.ui.shell import running


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


def test_whoever_changes_a_list_has_panels_drawn_anew(props, monkeypatch):
    """Buttons that are drawn point to where items were: a mouse over one would end Blender."""
    drawn = []
    for room in (running, exchange, hand):
        monkeypatch.setattr(room, "redraw_panels", lambda: drawn.append(1))
    for change in (
        lambda: press("add_planting"),
        lambda: hand.add_tree(props.plantings[0], (1.0, 2.0), 0.0, 1.0, 0),
        lambda: hand.remove_tree(props.plantings[0], (1.0, 2.0)),
        lambda: exchange.fill(props, "plantings", ()),
    ):
        drawn.clear()
        change()
        assert drawn


@pytest.mark.slow
def test_a_scanner_travels_along_poses(built, sensor):
    bpy.context.view_layer.objects.active = sensor("mobile")
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


@pytest.mark.slow
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


@pytest.mark.medium
def test_a_planting_shows_what_stands(built):
    from forest_addon.ui.forest.panels import _planting_row

    (planting,) = built.plantings
    standing = len([thing for thing in bpy.data.objects if "forest_tree" in thing])
    assert planting.standing == standing
    meant = round(planting.expected)
    assert _planting_row(planting).right in (
        f"{standing} trees",
        f"{standing} of {meant} trees",
        "1 tree",
    )
    fresh = built.plantings.add()
    fresh.species, fresh.use_expected, fresh.expected = "maple", True, 7
    assert _planting_row(fresh).right == "7 trees"
