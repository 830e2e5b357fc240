"""Instruments by their makers' names, what choosing one sets, and frequencies as people say them."""

import math

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import api as forest
from forest_addon.formats.scanner_file import read_scanner, scanner_names
from forest_addon.ui import exchange, properties
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


def test_a_band_is_shown_in_khz_and_stored_in_hz(sensor):
    thing = sensor("sonar", band=(60e3, 80e3), sample_rate=400e3)
    group = thing.forest_sensor.sonar
    assert list(group.band_shown) == pytest.approx([60.0, 80.0])
    group.band_shown = (38.4, 81.25)
    group.sample_rate_shown = 441.0
    found = exchange.sensor_of(thing)
    assert found.band == (38400.0, 81250.0)
    assert found.sample_rate == 441000.0


@pytest.mark.parametrize("degrees", [(-40.0, 60.0), (0.1, 0.2), (-12.3456, 89.9999)])
def test_angles_are_blenders_own_and_stored_in_degrees(sensor, degrees):
    thing = sensor("terrestrial")
    group = thing.forest_sensor.terrestrial
    group.elevation_deg_shown = [math.radians(angle) for angle in degrees]
    assert exchange.sensor_of(thing).elevation_deg == degrees
    assert group.bl_rna.properties["elevation_deg_shown"].unit == "ROTATION"


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
