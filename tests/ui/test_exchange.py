"""Settings to properties and back: nothing is lost, nothing is made up, errors say where."""

import dataclasses
import types
import typing
from pathlib import Path

import pytest

pytest.importorskip("bpy")

from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from forest_addon import spec
from forest_addon.formats.toml_file import read_settings
from forest_addon.ui import exchange, properties

DEMO = Path(__file__).resolve().parents[2] / "assets/scenes/demo.toml"
IN_BLENDER = settings(
    max_examples=30,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.filter_too_much],
)


def values(kind, known, digits):
    """Strategy for one field: within its range, floats of so many significant digits."""
    if isinstance(kind, types.UnionType):
        return st.none() | values(typing.get_args(kind)[0], known, digits)
    if typing.get_origin(kind) is tuple:
        parts = typing.get_args(kind)
        if parts[-1] is Ellipsis:
            return st.lists(groups(parts[0], digits), max_size=3).map(tuple)
        return st.tuples(*(values(part, known, digits) for part in parts))
    if isinstance(kind, type) and issubclass(kind, spec.Settings):
        return groups(kind, digits)
    if kind is bool:
        return st.booleans()
    if kind is str:
        return st.sampled_from(known.choices) if known.choices else st.text("abc-é", min_size=1)
    low, high = max(known.minimum, -1e7), min(known.maximum, 1e7)
    if kind is int:
        return st.integers(int(low), int(min(high, properties.LARGEST_INT)))
    numbers = st.floats(low, high, exclude_min=known.open_minimum, allow_subnormal=False)
    return numbers.map(lambda x: float(f"{x:.{digits}g}")).filter(
        lambda x: low <= x <= high and (x == 0 or abs(x) > 1e-30)
    )


@st.composite
def groups(draw, cls, digits=6):
    """A settings object with every field drawn at random."""
    kinds = typing.get_type_hints(cls)
    drawn = {
        field.name: draw(values(kinds[field.name], spec.param_of(field), digits))
        for field in dataclasses.fields(cls)
    }
    try:
        return cls(**drawn)
    except spec.SpecError:
        assume(False)


SINGLE = [spec.Forest, spec.Gaussian, spec.Planting, spec.Air, spec.Rays, *spec.SENSORS.values()]


def group_for(props, cls):
    """A property group of this kind within the scene's."""
    if cls is spec.Gaussian:
        return props.plantings.add().gaussians.add()
    if cls is spec.Planting:
        return props.plantings.add()
    return getattr(props, cls.__name__.lower())


@pytest.mark.parametrize("cls", SINGLE, ids=lambda c: c.__name__)
@given(data=st.data())
@IN_BLENDER
def test_round_trip_is_exact_to_six_digits(props, cls, data):
    drawn = data.draw(groups(cls))
    group = group_for(props, cls)
    exchange.write(group, drawn)
    assert exchange.read(group, cls) == drawn


@given(drawn=groups(spec.Forest, digits=17))
@IN_BLENDER
def test_any_number_is_kept_to_single_precision(props, drawn):
    exchange.write(props.forest, drawn)
    back = exchange.read(props.forest, spec.Forest)
    assert back.spacing == pytest.approx(drawn.spacing, rel=2**-23)
    assert back.size == pytest.approx(drawn.size, rel=2**-23)


def test_the_demo_scene_comes_back_as_it_was(props):
    demo = read_settings(DEMO, spec.Scene)
    assert exchange.from_spec(props, demo) == []
    back = exchange.to_spec(props, [sensor.kind for sensor in demo.sensors])
    assert sorted(back.sensors, key=lambda s: s.kind) == sorted(demo.sensors, key=lambda s: s.kind)
    assert dataclasses.replace(back, sensors=demo.sensors) == demo


def test_a_scene_replaces_what_was_there(props):
    exchange.from_spec(props, read_settings(DEMO, spec.Scene))
    exchange.from_spec(props, spec.Scene())
    assert exchange.to_spec(props) == spec.Scene(
        sensors=tuple(settings() for settings in spec.SENSORS.values())
    )


@pytest.mark.parametrize("cls", SINGLE, ids=lambda c: c.__name__)
def test_properties_say_what_spec_says(props, cls):
    group = group_for(props, cls)
    shown = {
        prop.identifier: prop for prop in group.bl_rna.properties
    }  # ours after Blender's "name"
    for field in dataclasses.fields(cls):
        known = spec.param_of(field)
        if field.name == "kind" or shown[field.name].type == "COLLECTION":
            continue
        prop = shown[field.name]
        assert prop.description.lower() == known.help.lower(), field.name
        assert not prop.name.endswith(" Deg")
        if prop.type in ("FLOAT", "INT"):
            assert prop.hard_min == pytest.approx(max(known.minimum, prop.hard_min), rel=1e-6)
            assert prop.hard_max == pytest.approx(min(known.maximum, prop.hard_max), rel=1e-6)
        if known.unit == "m":
            assert prop.unit == "LENGTH", field.name
        if known.unit == "Hz":
            assert prop.unit == "FREQUENCY", field.name


@pytest.mark.parametrize("cls", [spec.Forest, spec.Air, *spec.SENSORS.values()])
def test_untouched_properties_are_the_defaults(props, cls):
    assert exchange.read(group_for(props, cls), cls) == cls()


def test_degrees_stay_degrees(props):
    props.terrestrial.angle_step_deg = 0.25
    assert exchange.read(props.terrestrial, spec.Terrestrial).angle_step_deg == 0.25


def test_a_value_may_be_left_out(props):
    assert exchange.read(props.air, spec.Air).sound_speed is None
    props.air.use_sound_speed = True
    props.air.sound_speed = 340.3
    assert exchange.read(props.air, spec.Air).sound_speed == 340.3


@pytest.mark.parametrize(
    ("spoil", "key"),
    [
        (lambda p: setattr(p.forest, "size", (0, 5)), "forest.size[0]"),
        (lambda p: setattr(p.plantings.add(), "scale", (2, 1)), "plantings[0].scale"),
        (lambda p: setattr(p.sonar, "band", (8e4, 6e4)), "sonar.band"),
        (lambda p: setattr(p.reverb, "source", (0, 0, -1)), "reverb.source[2]"),
        (lambda p: setattr(p.tractor, "name", "../x"), "sensors[0].name"),
    ],
)
def test_an_error_says_where(props, spoil, key):
    spoil(props)
    with pytest.raises(spec.SpecError) as caught:
        exchange.to_spec(props)
    assert caught.value.key == key


def test_a_hill_without_width_is_named(props):
    planting = props.plantings.add()
    planting.gaussians.add()
    planting.gaussians.add().width = (0, 1)
    with pytest.raises(spec.SpecError) as caught:
        exchange.to_spec(props)
    assert caught.value.key == "plantings[0].gaussians[1].width[0]"


def test_only_the_asked_sensor_has_to_be_right(props):
    props.sonar.band = (8e4, 6e4)
    (sensor,) = exchange.to_spec(props, ["terrestrial"]).sensors
    assert sensor == spec.Terrestrial()


def test_a_second_sensor_of_a_kind_is_named_as_left_out(props):
    scene = spec.Scene(sensors=(spec.Sonar(name="a"), spec.Sonar(name="b"), spec.Tractor()))
    assert exchange.from_spec(props, scene) == ["b"]
    assert props.sonar.name == "a"


def test_names_of_sensors_that_a_scene_lacks_do_not_clash(props):
    exchange.from_spec(props, spec.Scene(sensors=(spec.Tractor(name="cloud"),)))
    names = [sensor.name for sensor in exchange.to_spec(props).sensors]
    assert len(set(names)) == len(names)


def test_a_seed_that_blender_cannot_hold_is_refused(props):
    props.seed = 5
    with pytest.raises(spec.SpecError, match="2147483647"):
        exchange.from_spec(props, spec.Scene(seed=2**31))
    assert props.seed == 5


def test_whether_anything_was_set(props):
    assert exchange.untouched(props)
    props.sonar.band = (5e4, 6e4)
    assert not exchange.untouched(props)


def test_a_list_counts_as_set(props):
    props.plantings.add()
    assert not exchange.untouched(props)
