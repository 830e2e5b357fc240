"""Instruments as settings: every preset works, a sensor's own settings go over it."""

import pytest

from forest_addon import spec
from forest_addon.formats.toml_file import (
    merged,
    read_scanner,
    read_settings,
    scanner_names,
    settings_of,
    structure,
)
from forest_addon.spec import Scene, SpecError


def scene_of(tmp_path, text):
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return read_settings(path, Scene)


@pytest.mark.parametrize("name", scanner_names())
def test_every_preset_is_whole(name):
    file = read_scanner(name)
    assert file.source
    assert file.title
    for kind, table in file.tables.items():
        sensor = structure(table, spec.SENSORS[kind])
        assert sensor.kind == kind
        assert sensor.beam.divergence_mrad > (0, 0)
        for key in file.assumed:
            group = sensor
            for part in key.split("."):
                assert hasattr(group, part) or kind != next(iter(file.tables)), key
                group = getattr(group, part, None)


def test_presets_are_what_their_sheets_say():
    vz = structure(settings_of("riegl-vz-400i", "terrestrial"), spec.Terrestrial)
    assert (vz.max_range, vz.min_range, vz.beam.divergence_mrad) == (800, 1.5, (0.35, 0.35))
    puck = structure(settings_of("velodyne-vlp-16", "mobile"), spec.Mobile)
    assert (puck.channels, puck.field_deg, puck.pulse_rate) == (16, (-15, 15), 300e3)


def test_a_sensor_starts_from_its_scanner(tmp_path):
    scene = scene_of(
        tmp_path,
        '[[sensors]]\nkind = "terrestrial"\nscanner = "riegl-vz-400i"\nmax_range = 50.0\n'
        "beam = { subrays = 3 }\n",
    )
    (sensor,) = scene.sensors
    assert sensor.scanner == "riegl-vz-400i"
    assert (sensor.max_range, sensor.min_range) == (50, 1.5)
    assert (sensor.beam.subrays, sensor.beam.divergence_mrad) == (3, (0.35, 0.35))


def test_a_scanner_file_of_ones_own_beside_the_scene(tmp_path):
    (tmp_path / "mine.toml").write_text("[terrestrial]\nmax_range = 33.0\n")
    scene = scene_of(tmp_path, '[[sensors]]\nkind = "terrestrial"\nscanner = "mine.toml"\n')
    assert scene.sensors[0].max_range == 33


@pytest.mark.parametrize(
    ("kind", "name", "words"),
    [
        ("terrestrial", "riegl-vz-900", "use one of dji-zenmuse-l2, faro-focus-s350"),
        ("terrestrial", "riegl-vq-780i", 'no terrestrial scanner; use kind = "airborne"'),
        ("airborne", "none.toml", "is not known"),
        ("airborne", "bad.toml", "cannot be read"),
        ("airborne", "empty.toml", "has no table"),
        ("airborne", "typo.toml", "airbone is not known"),
        ("airborne", "wrong.toml", "beam.subrais: is not known"),
    ],
)
def test_what_cannot_be_used_is_said(tmp_path, kind, name, words):
    (tmp_path / "bad.toml").write_text("[")
    (tmp_path / "empty.toml").write_text('title = "x"')
    (tmp_path / "typo.toml").write_text("[airbone]\nspeed = 3\n")
    (tmp_path / "wrong.toml").write_text("[airborne]\nbeam = { subrais = 3 }\n")
    with pytest.raises(SpecError, match=words):
        scene_of(tmp_path, f'[[sensors]]\nkind = "{kind}"\nscanner = "{name}"\n')


def test_tables_are_merged_within():
    under = {"a": 1, "beam": {"x": 1, "y": 2}}
    assert merged(under, {"beam": {"y": 3}, "b": 4}) == {"a": 1, "beam": {"x": 1, "y": 3}, "b": 4}
    assert under["beam"] == {"x": 1, "y": 2}
