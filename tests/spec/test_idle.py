"""Settings without effect are said: each changes something in a scene, is refused or is called idle."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from forest_addon.api.site import Site
from forest_addon.base.places import ASSETS
from forest_addon.base.rng import stream
from forest_addon.formats.toml_file import read_settings
from forest_addon.growth.library.species_file import complete_species, find_species
from forest_addon.growth.tree import grow
from forest_addon.spec import (
    Airborne,
    Forest,
    Grammar,
    Honda,
    Jitter,
    Leaf,
    Mobile,
    Planting,
    Reverb,
    Scene,
    Sonar,
    SonarReceiver,
    SpecError,
    Species,
    Template,
    Terrestrial,
    Tractor,
    param_of,
)
from forest_addon.spec.base import Settings
from forest_addon.spec.choices import APPLIES, OF_SPECIES, idle, idle_in_species

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
    "receiver": Sonar(
        position=(4, 4, 1.5),
        max_range=6.0,
        leaf_model="piston",
        cull=1e-2,
        tolerance=1e-3,
        receiver=SonarReceiver(
            source_level_db=110.0,
            resonance=70e3,
            ringing_db=-40.0,
            gain=((0.0, 0.0), (0.03, 20.0)),
            self_noise_db=20.0,
            ambient="wind",
            overload_db=80.0,
            bits=12,
            threshold_db=10.0,
        ),
    ),
    "reverb": Reverb(source=(1, 1, 1.5), receiver=(7, 7, 1.5), sample_rate=8000.0, duration=0.2),
    "terrestrial": Terrestrial(position=(4, 4, 1.5), angle_step_deg=8.0),
    "tractor": Tractor(position=(-2, 0, 1.0), track=8, step=1.0, angle_step_deg=6.0, top=5.0),
}
FILES = {"time_expansion", "contributions", "wavelength_nm"}  # what is written, not what is found
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
    "max_returns",
    "other",
    "dead_zone",
}


def paths(group, within=()):
    """Every setting of a group and of those in it: its path, its value, what is known of it."""
    for field in dataclasses.fields(group):
        value = getattr(group, field.name)
        if isinstance(value, Settings):
            yield from paths(value, (*within, field.name))
        else:
            yield (*within, field.name), value, param_of(field)


def put(group, path, value):
    inner = value if len(path) == 1 else put(getattr(group, path[0]), path[1:], value)
    return group.changed(**{path[0]: inner})


def silent(group, find, without=frozenset()):
    """Settings of which no other value is refused, is said to be idle, or changes what is found."""
    first, found = find(group), []
    for path, value, known in paths(group):
        values = others(value, known)
        for other in values:
            try:
                changed = put(group, path, other)
                said = idle_in_species(changed) if isinstance(changed, Species) else idle(changed)
                if said or not alike(first, find(changed)):
                    break
            except SpecError:
                break
        else:
            if values and without.isdisjoint(path):
                found.append(".".join(path))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("kind", TRIED)
def test_every_setting_changes_something_or_is_refused_or_said_to_be_idle(world, kind):
    assert not silent(TRIED[kind], lambda s: world.look(s).found, FILES | OF_THE_SCENE)


LOOKS = {"look", "bark", "relief"}  # of pictures, and of stems thicker than these
OF_SYMBOLS = {"angle_deg", "rotation_deg", "length", "diameter", "thinning", "leaf", "leaves"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "without"),
    [
        ("hazelnut", {"leaves"}),  # of a template, which has all of them or none
        ("whorl-8", {"leaves"}),
        ("abop-ternary-a", OF_SYMBOLS),  # none of its symbols asks for them
    ],
)
def test_every_setting_of_a_species_changes_its_trees_or_is_said_to_be_idle(name, without):
    path = find_species(name, Path())

    def grown(species):
        tree = grow(*complete_species(species, path.parent, name), stream(3, "idle"))
        return [*arrays(tree.mesh), *arrays(tree.leaves), *arrays(tree.skeleton)]

    assert not silent(read_settings(path, Species), grown, LOOKS | without)


@pytest.mark.slow
@pytest.mark.parametrize("layout", ["poisson", "clusters", "strauss", "rows"])
def test_every_setting_of_a_planting_changes_the_stand_or_is_said_to_be_idle(layout):
    start = Planting(species="hazelnut", variants=2, expected=40, layout=layout)
    start = start.changed(expected=None) if layout == "rows" else start

    def planted(planting):
        scene = Scene(forest=Forest(size=(20, 20)), plantings=(planting,))
        forest = Site.of(scene, Path()).grow(None)
        return [*arrays(forest.stand), *(tree.mesh.vertices for tree in forest.variants.values())]

    not_here = {"season", "base", "altitude"}  # colours; without hills it is scaled; flat ground
    assert not silent(start, planted, not_here)


@pytest.mark.parametrize(
    ("species", "place"),
    [
        (Species(name="a", honda=Honda(), grammar=Grammar(copies=3)), "grammar"),
        (Species(name="a", honda=Honda(), jitter=Jitter(length=0.2)), "jitter"),
        (Species(name="a", grammar=Grammar(whorls=5)), "grammar.whorls"),
        (Species(name="a", honda=Honda(), leaf=Leaf(nodes=9)), "leaf.nodes"),
        (Species(name="a", leaf=Leaf(curl_deg=20.0)), "leaf.curl_deg"),
        (
            Species(name="a", template=Template(wood="w.stl"), leaf=Leaf(shape="oak")),
            "leaf",
        ),
        (
            Species(name="a", template=Template(wood="w.stl", leaves="l.stl", grow_leaves=True)),
            "template.grow_leaves",
        ),
        (Species(name="a", template=Template(wood="w.stl"), dead=True), "dead"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_table_of_a_species_that_grows_otherwise_is_named(species, place):
    (sentence,) = idle_in_species(species)
    assert sentence.startswith(f"{place} has no effect: it needs {OF_SPECIES[place][0]} to be ")


def test_no_species_that_is_shipped_has_a_setting_without_effect():
    for path in sorted((ASSETS / "species").glob("*.toml")):
        assert idle_in_species(read_settings(path, Species)) == [], path.name
