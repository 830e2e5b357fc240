"""Angles and high frequencies are shown in other units than files have; what is stored stays the file's."""

import math

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import spec
from forest_addon.ui import properties
from forest_addon.ui.settings import exchange
from forest_addon.ui.settings.groups import fields_of


def test_every_angle_of_a_panel_is_one_of_blenders(registered):
    for settings, group in properties.GROUPS.items():
        known = {p.identifier: p for p in group.bl_rna.properties}
        for field in fields_of(settings):
            if field.param.unit == "deg" and field.name in group.shown:
                shown = known[f"{field.name}_shown"]
                assert shown.unit == "ROTATION", f"{group.__name__}.{field.name}"
                assert "°" not in shown.name
                assert shown.is_skip_save


def test_frequencies_of_calls_and_records_are_in_khz(sensor):
    bat = sensor("sonar").forest_sensor.sonar
    assert list(bat.band_shown) == [60.0, 80.0]
    bat.band_shown = (25.1, 50.7)
    bat.sample_rate_shown = 192.0
    assert [round(edge, 2) for edge in bat.band] == [25100.0, 50700.0]
    assert exchange.sensor_of(bpy.data.objects["echo"]).band == (25100.0, 50700.0)
    assert exchange.sensor_of(bpy.data.objects["echo"]).sample_rate == 192e3
    line = sensor("mobile").forest_sensor.mobile.bl_rna.properties
    assert "line_rate_shown" not in {p.identifier for p in line}  # 100 Hz


@pytest.mark.parametrize("degrees", [0.0, 0.036, 0.25, 30.0, 47.5, -72.25, 90.0, 360.0])
def test_an_angle_that_is_set_is_stored_as_whole_degrees_of_a_file(sensor, degrees):
    thing = sensor("terrestrial")
    scanner = thing.forest_sensor.terrestrial
    scanner.azimuth_deg_shown = (math.radians(-100.0), math.radians(degrees))
    found = exchange.read(scanner, spec.Terrestrial, "cloud", {"name": "cloud"})
    assert found.azimuth_deg == (-100.0, degrees)


def test_what_is_only_shown_counts_as_nothing_set(sensor, props):
    scanner = sensor("terrestrial").forest_sensor.terrestrial
    before = exchange.sensor_of(bpy.data.objects["cloud"])
    assert scanner.angle_step_deg_shown == pytest.approx(math.radians(0.25))
    assert exchange.sensor_of(bpy.data.objects["cloud"]) == before
