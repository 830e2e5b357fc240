"""Presets in Blender's own menu: kept in a file, applied to another sensor or planting, removed."""

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.ui.settings import exchange
from forest_addon.ui.settings.presets import values_of


@pytest.fixture
def folder(registered, tmp_path, monkeypatch):
    """Folder of the user's scripts, empty."""
    monkeypatch.setattr(
        bpy.utils, "user_resource", lambda *_, path="", **__: _made(tmp_path / path)
    )
    monkeypatch.setattr(
        bpy.utils, "preset_paths", lambda below: [str(tmp_path / "presets" / below)]
    )
    return tmp_path


def _made(path):
    path.mkdir(parents=True, exist_ok=True)
    return str(path)


def keep(kind, name, **how):
    return getattr(bpy.ops.forest, f"preset_{kind}")(name=name, **how)


def choose(kind, folder, name):
    path = folder / "presets" / "forest_sensing" / kind / f"{name}.py"
    assert path.exists()
    menu = f"FOREST_PT_presets_{kind}"
    return bpy.ops.script.execute_preset(filepath=str(path), menu_idname=menu)


def chosen_values(sensor):
    bpy.context.view_layer.objects.active = sensor
    return exchange.sensor_of(sensor)


@pytest.mark.parametrize(
    "kind", ["sonar", "terrestrial", "reverb", "tractor", "mobile", "airborne"]
)
def test_a_sensor_is_set_as_another_was_and_stays_where_it_is(folder, sensor, kind):
    one, two = sensor(kind), sensor(kind)
    group = getattr(one.forest_sensor, kind)
    name = {"reverb": "duration", "tractor": "step"}.get(kind, "max_range")
    setattr(group, name, 0.75 if kind in ("reverb", "tractor") else 17.5)
    two.location = (3.0, 4.0, 5.0)
    bpy.context.view_layer.update()
    wanted = chosen_values(one)
    assert keep(kind, "Mine") == {"FINISHED"}
    before = chosen_values(two)
    assert choose(kind, folder, "Mine") == {"FINISHED"}
    after = chosen_values(two)
    names = set(values_of(kind, bpy.context))
    assert {"max_range", "step", "duration"} & names
    assert {n: getattr(after, n) for n in names} == {n: getattr(wanted, n) for n in names}
    left = set(vars(before)) - names
    assert "name" in left
    assert {n: getattr(after, n) for n in left} == {n: getattr(before, n) for n in left}
    assert after != before
    assert keep(kind, "Mine", remove_name=True) == {"FINISHED"}
    assert not list(folder.rglob("Mine.py"))


def test_a_planting_keeps_its_places_and_takes_the_rest(folder, props):
    for species, density in (("maple", 0.02), ("spruce", None)):
        planting = props.plantings.add()
        planting.species = species
        planting.use_expected = density is None
        planting.expected = 30
        planting.use_density, planting.density = density is not None, density or 1
    props.active_plantings = 0
    props.plantings[1].by_hand.add().position = (1.0, 2.0)
    keep("planting", "Thin")
    props.active_plantings = 1
    assert choose("planting", folder, "Thin") == {"FINISHED"}
    first, second = exchange.to_spec(bpy.context.scene, []).plantings
    assert second.changed(by_hand=()) == first
    assert second.by_hand[0].position == (1.0, 2.0)


def test_wind_and_a_preset_that_cannot_be_used(folder, props):
    props.wind.speed = 6.5
    keep("wind", "Fresh")
    props.wind.speed = 0
    choose("wind", folder, "Fresh")
    assert props.wind.speed == 6.5
    with pytest.raises(RuntimeError, match="speed"):
        bpy.ops.forest.apply_preset(kind="wind", values='{"speed": 400}')
    with pytest.raises(RuntimeError, match="Choose what the preset is for"):
        bpy.ops.forest.apply_preset(kind="sonar", values="{}")
    assert props.wind.speed == 6.5
