"""Instruments by their makers' names, what choosing one sets, and frequencies as people say them."""

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import api as forest
from forest_addon.formats.scanner_file import read_scanner, scanner_names
from forest_addon.ui import exchange
from forest_addon.ui.sensors import instruments


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
    instruments.FOREST_MT_instruments.draw(menu, bpy.context)
    return {entry.text: entry.scanner for entry in menu.layout.shown}


@pytest.mark.parametrize("kind", ["terrestrial", "mobile", "airborne"])
def test_the_menu_has_the_instruments_of_what_carries_the_sensor(sensor, kind):
    sensor(kind)
    able = {name for name in scanner_names() if kind in read_scanner(name).tables}
    shown = listed()
    assert set(shown.values()) == able | {""}
    assert not set(shown) & set(scanner_names())  # names, not those of files


def test_choosing_an_instrument_is_the_same_as_in_python(sensor):
    thing = sensor("terrestrial", position=(1.0, 2.0, 3.0))
    assert bpy.ops.forest.choose_instrument(scanner=listed()["RIEGL VZ-400i"]) == {"FINISHED"}
    found = exchange.sensor_of(thing)
    chosen = forest.instrument("riegl-vz-400i", position=(1.0, 2.0, 3.0), name=found.name)
    assert found.beam == chosen.beam
    assert (found.pulse_rate, found.max_range) == (chosen.pulse_rate, chosen.max_range)
    assert found.position == chosen.position
    bpy.ops.forest.choose_instrument(scanner="")
    assert exchange.sensor_of(thing).beam == chosen.beam  # settings stay, they are one's own now
    assert thing.forest_sensor.terrestrial.scanner == ""


def test_a_tooltip_says_range_rate_and_spread(sensor):
    sensor("terrestrial")
    words = instruments.FOREST_OT_choose_instrument.description(
        bpy.context, type("Settings", (), {"scanner": "riegl-vz-400i"})()
    )
    assert words.startswith("RIEGL VZ-400i: ")
    assert "kHz" in words
    assert "mrad" in words


def test_a_sonar_has_no_instruments(sensor):
    sensor("sonar")
    assert not bpy.ops.forest.choose_instrument.poll()
