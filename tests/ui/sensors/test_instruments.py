"""Instruments by their makers' names, what choosing one sets, and limits of what is shown otherwise."""

import math

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import api as forest
from forest_addon.formats.toml_file import read_scanner, scanner_names
from forest_addon.ui import properties
from forest_addon.ui.sensors import panels
from forest_addon.ui.settings import exchange


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
    panels.FOREST_MT_instruments.draw(menu, bpy.context)
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
    words = panels.FOREST_OT_choose_instrument.description(
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
