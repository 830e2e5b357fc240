"""Drawings over the view: one that breaks takes no other along, and is tried again when something changes."""

import logging
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import spec
from forest_addon.blender.sensors import objects as sensors
from forest_addon.sensing.kinds import KINDS
from forest_addon.ui import overlay


class Sheet:
    """A drawing that counts how often it was drawn; a broken one fails."""

    def __init__(self, broken=False):
        self.broken, self.drawn = broken, 0

    def draw(self, _context):
        if self.broken:
            raise ValueError("no vertices")
        self.drawn += 1


def test_a_broken_drawing_takes_no_other_along(registered, caplog):
    sheets = [Sheet(), Sheet(broken=True), Sheet()]
    drawings = [sheet.draw for sheet in sheets]
    for _ in range(3):
        overlay.draw(drawings, bpy.context)
    assert [sheet.drawn for sheet in sheets] == [3, 0, 3]
    assert len(caplog.records) == 1  # not at every redraw
    sheets[1].broken = False
    overlay.forget()
    overlay.draw(drawings, bpy.context)
    assert [sheet.drawn for sheet in sheets] == [4, 1, 4]


def test_a_scanner_that_follows_a_curve_has_no_lines_and_others_keep_theirs(props, sensor):
    sensor("mobile", follow="track")
    sensor("mobile", name="one", poses=(spec.Pose(),))
    sensor("sonar")
    sensor("terrestrial")
    bpy.context.view_layer.update()
    found = list(overlay.lines(bpy.context.scene))
    assert [sensors.kind_of(thing) for thing, _ in found] == ["terrestrial", "sonar"]
    assert all(len(ends) for _, ends in found)


def test_a_sensor_whose_lines_cannot_be_made_takes_no_other_along(
    props, sensor, monkeypatch, caplog
):
    def broken(_sonar):
        raise ZeroDivisionError

    monkeypatch.setitem(KINDS, "sonar", replace(KINDS["sonar"], outline=broken))
    for kind in spec.SENSORS:
        sensor(kind)
    bpy.context.view_layer.update()
    with caplog.at_level(logging.ERROR):
        found = {sensors.kind_of(thing) for thing, _ in overlay.lines(bpy.context.scene)}
    assert found == set(spec.SENSORS) - {"sonar", "mobile"}  # which has no poses yet
    assert "where echo looks" in caplog.text


@pytest.mark.medium
@pytest.mark.parametrize("kind", spec.SENSORS)
@pytest.mark.parametrize("place", [(0, 0, 0), (1e6, -1e6, 1e-6), (0, 0, 1e4), (0, 0, -5)])
def test_lines_are_finite_wherever_a_sensor_is_put(props, sensor, kind, place):
    thing = sensor(kind)
    thing.location = place
    bpy.context.view_layer.update()
    for _, ends in overlay.lines(bpy.context.scene):
        assert np.isfinite(ends).all()
        assert len(ends) > 0


def test_the_chosen_sensor_is_drawn_strong_and_others_faint():
    for colour in (kind.colour for kind in KINDS.values()):
        (*_, strong), wide = overlay.strength(colour, True)
        (*_, faint), narrow = overlay.strength(colour, False)
        assert strong > 2 * faint
        assert wide > narrow
