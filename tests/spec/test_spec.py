"""Settings check themselves, and every field is described."""

import dataclasses
import inspect

import pytest

from forest_addon import spec
from forest_addon.spec.base import _check

GROUPS = [
    c
    for _, c in inspect.getmembers(spec, inspect.isclass)
    if issubclass(c, spec.Settings) and c is not spec.Settings
]


@pytest.mark.parametrize("group", GROUPS, ids=lambda g: g.__name__)
def test_every_field_has_help_and_a_default_within_its_range(group):
    for field in dataclasses.fields(group):
        known = spec.param_of(field)
        assert known.help, field.name
        assert known.minimum <= known.maximum
        if not known.required:
            _check(field.name, field.default, known)  # does not raise


@pytest.mark.parametrize(
    ("make", "key", "words"),
    [
        (lambda: spec.Forest(size=(-3.0, 2.0)), "size[0]", "-3 m is out of range"),
        (lambda: spec.Forest(size=(0.0, 2.0)), "size[0]", "larger than 0"),
        (lambda: spec.Forest(spacing=float("nan")), "spacing", "nan"),
        (lambda: spec.Forest(spacing=float("inf")), "spacing", "inf"),
        (lambda: spec.Sonar(leaf_model="wood"), "leaf_model", '"exact", "piston", "paper"'),
        (lambda: spec.Sonar(band=(60e3, 250e3)), "band", "half the sample_rate"),
        (lambda: spec.Planting(species="maple"), "expected", "give a number"),
        (lambda: spec.Planting(species="m", expected=1, scale=(2.0, 1.0)), "scale", "smallest"),
        (lambda: spec.Reverb(source=(0.0, 0.0, 0.0)), "source[2]", "above the ground"),
        (lambda: spec.Tractor(top=0.5), "top", "above the scanner"),
        (
            lambda: spec.Scene(sensors=(spec.Sonar(), spec.Sonar())),
            "sensors[1].name",
            "a name of its own",
        ),
        (lambda: spec.Scene(sensors=(spec.Sonar(name="a/b"),)), "sensors[0].name", "letters"),
    ],
)
def test_bad_values_never_become_settings(make, key, words):
    with pytest.raises(spec.SpecError) as caught:
        make()
    assert caught.value.key == key
    assert words in caught.value.problem


def test_sound_speed_follows_temperature():
    assert spec.Air().speed() == pytest.approx(343.2, abs=1e-9)
    assert spec.Air(temperature_c=0.0).speed() == pytest.approx(331.3, abs=0.1)
    assert spec.Air(sound_speed=340.0).speed() == 340.0


@pytest.mark.parametrize(
    ("make", "key"),
    [
        (lambda: spec.Terrestrial(angle_step_deg=1e-6), "angle_step_deg"),
        (lambda: spec.Terrestrial(line_step_deg=1e-12), "line_step_deg"),
        (
            lambda: spec.Terrestrial(angle_step_deg=1e-3, beam=spec.Beam(subrays=100_000)),
            "of 100,000 rays",
        ),
        (lambda: spec.Tractor(step=1e-12), "step"),
        (lambda: spec.Tractor(angle_step_deg=1e-12), "angle_step_deg"),
        (lambda: spec.Airborne(speed=1e-9), "speed"),
        (lambda: spec.Mobile(poses=(spec.Pose(), spec.Pose(time=1e9))), "poses"),
    ],
)
def test_a_scan_that_would_take_years_is_refused_before_it_begins(make, key):
    with pytest.raises(spec.SpecError, match=f"{key}.*years of work"):
        make()


def test_the_finest_scan_that_an_instrument_makes_is_taken():
    made = spec.Terrestrial(angle_step_deg=0.0007, beam=spec.Beam(subrays=1))  # 8.8e10 pulses
    assert made.angle_step_deg == 0.0007
