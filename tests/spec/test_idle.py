"""Settings without effect are said: each changes something in a scene, is refused or is called idle."""

import dataclasses
import math

import numpy as np
import pytest

from forest_addon.spec import (
    Airborne,
    Mobile,
    Planting,
    Reverb,
    Sonar,
    SpecError,
    Terrestrial,
    param_of,
)
from forest_addon.spec.choices import APPLIES, idle

GROUPS = (Sonar(), Reverb(), Terrestrial(), Mobile(), Airborne(), Planting(species="x", expected=3))


@pytest.mark.parametrize(
    ("group", "name"),
    [
        (Sonar(call_duration=0.01), "call_duration"),
        (Sonar(speed=3.0), "speed"),
        (Sonar(ear_spacing=0.1), "ear_spacing"),
        (Sonar(hearing_width_deg=(10.0, 10.0)), "hearing_width_deg"),
        (Reverb(bark=0.2), "bark"),
        (Reverb(foliage=False), "foliage"),
        (Reverb(flow_resistivity=100.0), "flow_resistivity"),
        (Reverb(model="forest", strength=1.0), "strength"),
        (Planting(species="x", expected=3, trees="missing.csv"), "trees"),
        (Planting(species="x", density=0.1, exact=True), "exact"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_setting_without_effect_is_named_with_what_it_needs(group, name):
    (sentence,) = idle(group)
    assert sentence.startswith(f"{name} has no effect: it needs {APPLIES[name][0]} to be ")


@pytest.mark.parametrize(
    "group",
    [
        *GROUPS,
        Sonar(call="fm", call_duration=0.01, doppler=True, speed=3.0, ears=2, ear_spacing=0.1),
        Reverb(model="forest", bark=0.2, flow_resistivity=100.0),
        Reverb(surface="grass", flow_resistivity=100.0),
        Planting(species="x", layout="list", trees="t.csv"),
    ],
)
def test_settings_with_an_effect_are_not_named(group):
    assert idle(group) == []


def others(value, known):
    """Other values that a setting may have, one or two."""
    if isinstance(value, bool):
        return [not value]
    if known.choices:
        return [choice for choice in known.choices if choice != value]
    if isinstance(value, (int, float)):
        step = 1 if isinstance(value, int) else 0.013
        middle = type(value)((known.minimum + known.maximum) / 2) if known.maximum < 1e3 else 1
        tried = (value * 1.5 + step, value * 0.6, middle, known.minimum)
        return [
            v
            for v in map(type(value), tried)
            if v != value and known.minimum < v <= known.maximum and math.isfinite(v)
        ]
    if isinstance(value, tuple) and value and isinstance(value[0], float):
        return [(value[0] * 0.8 + 0.11, *value[1:])]
    return []


def arrays(found):
    """All numbers of a finding, flat."""
    if dataclasses.is_dataclass(found):
        return [a for f in dataclasses.fields(found) for a in arrays(getattr(found, f.name))]
    if isinstance(found, (list, tuple)):
        return [a for one in found for a in arrays(one)]
    return [found] if isinstance(found, np.ndarray) else []


def alike(one, other):
    one, other = arrays(one), arrays(other)
    return len(one) == len(other) and all(map(np.array_equal, one, other))


@pytest.fixture(scope="module")
def world():
    pytest.importorskip("bpy")
    from forest_addon import api

    planting = api.Planting(species="hazelnut", variants=1, expected=2, exact=True)
    forest = api.Forest(size=(8, 8))
    return api.build(
        api.Scene(forest=forest, plantings=(planting,), accuracy=api.Accuracy(audit=0))
    )


TRIED = {
    "sonar": Sonar(
        position=(4, 4, 1.5), max_range=6.0, leaf_model="piston", cull=1e-2, tolerance=1e-3
    ),
    "reverb": Reverb(source=(1, 1, 1.5), receiver=(7, 7, 1.5), sample_rate=8000.0, duration=0.2),
    "terrestrial": Terrestrial(position=(4, 4, 1.5), angle_step_deg=8.0),
}
FILES = {"time_expansion", "contributions"}  # what is written, not what is found
OF_THE_SCENE = {  # without anything so near or far, or shining
    "near_limit",
    "continue_to",
    "min_range",
    "max_range",
    "keep",
    "halo",
    "halo_mrad",
    "blanking",
    "beyond",
    "faintest",
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", TRIED)
def test_every_setting_changes_something_or_is_refused_or_said_to_be_idle(world, kind):
    sensor, silent = TRIED[kind], []
    first = world.look(sensor).found
    for field in dataclasses.fields(sensor):
        values = others(getattr(sensor, field.name), param_of(field))
        for value in values:
            try:
                changed = sensor.changed(**{field.name: value})
                if idle(changed) or not alike(first, world.look(changed).found):
                    break
            except SpecError:
                break
        else:
            if values and field.name not in FILES | OF_THE_SCENE:
                silent.append(field.name)
    assert not silent
