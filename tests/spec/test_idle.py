"""Settings without effect are said: each changes something in a scene, is refused or is called idle."""

import dataclasses
import json
import math
import types
import typing
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from forest_addon.api.world import Site
from forest_addon.base.places import ASSETS
from forest_addon.base.rng import stream
from forest_addon.formats.toml_file import read_settings
from forest_addon.growth.library import complete_species, find_species
from forest_addon.growth.tree import grow
from forest_addon.spec import (
    Airborne,
    Detail,
    Flight,
    Forest,
    Grammar,
    Honda,
    Jitter,
    Leaf,
    Mobile,
    Normal,
    Output,
    Planting,
    Pose,
    Reverb,
    Scene,
    Sonar,
    SonarReceiver,
    SpecError,
    Species,
    Template,
    Terrestrial,
    Tiles,
    Tractor,
    Wind,
    param_of,
)
from forest_addon.spec.base import Settings, types_of
from forest_addon.spec.choices import (
    OF_SPECIES,
    idle,
    idle_in_scene,
    idle_in_species,
    need_of,
)
from forest_addon.stand.compose import Inputs
from headless.dataset.place import heights_of, place_sensors
from headless.dataset.plan import read_plan, recipes
from headless.dataset.settings import Ground, Keep, Mix, Placing, Splits

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
    assert sentence.startswith(f"{name} has no effect: it needs {need_of(group, name)[0]} to be ")


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


def others(value, known, kind):
    """Other values that a setting of a type may have, one or two."""
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
    if isinstance(value, tuple) and value and isinstance(value[0], (int, float)):
        return [(type(value[0])(value[0] * 0.8 + 1.31), *value[1:])]
    if value is None:  # left out: a number, or some
        given = next(one for one in typing.get_args(kind) if one is not types.NoneType)
        if typing.get_origin(given) is tuple:
            return [tuple(2.0 + k for k, _ in enumerate(typing.get_args(given)))]
        return [given(known.minimum + 2)] if given in (int, float) else []
    return []


def arrays(found):
    """All numbers of a finding, flat."""
    if dataclasses.is_dataclass(found):
        return [a for f in dataclasses.fields(found) for a in arrays(getattr(found, f.name))]
    if isinstance(found, dict):
        return arrays(list(found.values()))
    if isinstance(found, (list, tuple)):
        return [a for one in found for a in arrays(one)]
    return [np.array(found)] if isinstance(found, (np.ndarray, bytes, int, float)) else []


def alike(one, other):
    one, other = ([a.tobytes() for a in arrays(found)] for found in (one, other))
    return one == other


@pytest.fixture(scope="module")
def world():
    pytest.importorskip("bpy")
    from forest_addon import api

    planting = api.Planting(species="whorl-8", variants=1, expected=2, exact=True)
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
    "reverb": Reverb(source=(1, 7, 1.5), receiver=(7, 6, 1.5), sample_rate=8000.0, duration=0.2),
    "terrestrial": Terrestrial(position=(4, 4, 1.5), angle_step_deg=8.0),
    "tractor": Tractor(position=(-2, 0, 1.0), track=8, step=1.0, angle_step_deg=6.0, top=5.0),
    "mobile": Mobile(
        poses=(Pose(position=(0, 4, 2)), Pose(time=0.5, position=(8, 4, 2))),
        pulse_rate=2000.0,
        field_deg=(-80, 80),
    ),
    "airborne": Airborne(
        position=(0, 4, 20), heading_deg=0.0, track=8.0, speed=8.0, pulse_rate=1000.0
    ),
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
    """Every setting of a group and of those in it: its path, its value, what is known of it, its type."""
    for field in dataclasses.fields(group):
        value, path = getattr(group, field.name), (*within, field.name)
        if isinstance(value, Settings):
            yield from paths(value, path)
        elif isinstance(value, tuple) and value and isinstance(value[0], Settings):
            yield from paths(value[0], (*path, 0))
        else:
            yield path, value, param_of(field), types_of(type(group))[field.name]


def put(group, path, value):
    if not path:
        return value
    if path[0] == 0:
        return (put(group[0], path[1:], value), *group[1:])
    return group.changed(**{path[0]: put(getattr(group, path[0]), path[1:], value)})


def said_of(group):
    """Sentences about what is idle in a group, whatever it is of."""
    if isinstance(group, Species):
        return idle_in_species(group)
    return idle_in_scene(group) if isinstance(group, Scene) else idle(group)


def silent(group, find, without=frozenset(), within=()):
    """Settings of which no other value is refused, is said to be idle, or changes what is found.

    within : the settings, or groups of them, that are tried; none: all.
    """
    first, found = find(group), []
    assert alike(first, find(group))  # else everything would change it
    for path, value, known, kind in paths(group):
        if (within and path[0] not in within) or not without.isdisjoint(path):
            continue
        values = others(value, known, kind)
        for other in values:
            try:
                changed = put(group, path, other)
                if said_of(changed) or not alike(first, find(changed)):
                    break
            except SpecError:
                break
        else:
            if values:
                found.append(".".join(map(str, path)))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("kind", TRIED)
def test_every_setting_changes_something_or_is_refused_or_said_to_be_idle(world, kind):
    found = silent(TRIED[kind], lambda s: world.look(s).found, FILES | OF_THE_SCENE)
    assert not found, found


LOOKS = {"look", "bark", "relief", "model"}  # of pictures, of thicker stems, a name
OF_SYMBOLS = {"angle_deg", "rotation_deg", "length", "diameter", "thinning", "leaf", "leaves"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "without"),
    [
        ("hazelnut", {"leaves"}),  # of a template, which has all of them or none
        ("whorl-8", {"leaves"}),
        ("abop-ternary-a", OF_SYMBOLS),  # none of its symbols asks for them
        ("silver-birch", {"targets", "leaf_area_index"}),  # given below
    ],
)
def test_every_setting_of_a_species_changes_its_trees_or_is_said_to_be_idle(name, without):
    path = find_species(name, Path())

    def grown(species):
        found = []
        for dbh in (
            (0.25, 0.08) if species.crown else (0,)
        ):  # a stem that divides, and one with whorls
            measures = {"crown_width": 3.0, "crown_base": 2.0, "leaf_area": 0.5, "height": 9.0}
            targets = species.targets
            if dbh:
                targets = targets.changed(**measures, dbh=Normal(mean=dbh))
            kind = complete_species(species.changed(targets=targets), path.parent, name)
            tree = grow(*kind, stream(3, "idle"))
            found += [tree.mesh, tree.leaves, tree.skeleton]
        return arrays(found)

    start = read_settings(path, Species)
    if start.crown:
        fork = start.architecture.changed(fork=0.3)
        light = {"crown": start.crown.changed(points=40, twig_leaves=2), "architecture": fork}
        start = start.changed(**light, detail=Detail(tolerance=0.02))
    if start.rules:
        start = start.changed(rules=start.rules.changed(generations=4))
    found = silent(start, grown, LOOKS | without)
    assert not found, found


@pytest.mark.slow
@pytest.mark.parametrize("layout", ["poisson", "clusters", "strauss", "rows"])
def test_every_setting_of_a_planting_changes_the_stand_or_is_said_to_be_idle(layout):
    start = Planting(species="whorl-8", variants=2, expected=30, layout=layout)
    start = start.changed(expected=None) if layout == "rows" else start

    def planted(planting):
        scene = Scene(forest=Forest(size=(20, 20)), plantings=(planting,))
        forest = Site.of(scene, Path()).grow(None)
        return [*arrays(forest.stand), *(tree.mesh.vertices for tree in forest.variants.values())]

    not_here = {"season", "base", "altitude"}  # colours; without hills it is scaled; flat ground
    assert not silent(start, planted, not_here)


@pytest.mark.slow
def test_every_setting_of_air_and_wind_changes_what_is_sensed_or_is_said_to_be_idle(world):
    def looked(scene):
        there = dataclasses.replace(world, scene=scene)
        return [there.look(TRIED[kind]).found for kind in ("sonar", "terrestrial")]

    blown = world.scene.changed(wind=Wind(speed=4.0))
    assert not silent(blown, looked, within=("wind",))
    assert not silent(world.scene, looked, within=("air", "wind"))


@pytest.fixture(scope="module")
def stock(world):
    """Solids of the world that are no thinner than is asked."""
    from forest_addon.flight.woods import Stock

    @cache
    def standing(thinnest):
        flight = Flight(thinnest=thinnest)
        return Stock.standing(dataclasses.replace(world, scene=world.scene.changed(flight=flight)))

    return standing


@pytest.mark.slow
@pytest.mark.parametrize("body", ["bat", "bird", "planar", "quadrotor"])
def test_every_setting_of_a_flight_changes_it_or_is_said_to_be_idle(stock, body):
    from forest_addon.flight.bodies import ACTIONS
    from forest_addon.flight.simulation import Flyers

    def flown(flight):
        flyers = Flyers(flight, 1, None, None)
        flyers.enter(stock(flight.thinnest).surroundings())
        flyers.start([0], [0])
        seen = [[int(solid.count.sum()) for solid in stock(flight.thinnest).solids]]
        for _ in range(3):
            outcome = flyers.step(np.full((1, len(ACTIONS[body])), 0.9))
            seen += [flyers.sense(), flyers.state, outcome]
        return arrays(seen)

    free = {
        "start_low": (-1.0, -1.0),
        "start_high": (2.0, 2.0),
        "distance": 3.0,
        "steps": 3,
        "speed": 2.0,
        "thinnest": 0.03,
    }
    assert not silent(Flight(body=body, **free), flown)


@pytest.mark.slow
def test_every_setting_of_a_field_changes_the_scene_or_is_said_to_be_idle():
    bpy = pytest.importorskip("bpy")
    from forest_addon import api

    plantings = tuple(
        Planting(species=name, variants=1, expected=8, exact=True) for name in ("whorl-8", "grass")
    )
    start = Scene(forest=Forest(size=(8, 8), spacing=2, margin=2), plantings=plantings)

    def built(scene):
        geometry = api.build(scene).observer.geometry
        return [len(bpy.data.objects), *arrays(geometry.meshes), *arrays(geometry)]

    assert not silent(start, built, within=("forest",))


@pytest.mark.medium
def test_every_setting_of_tiles_changes_them_or_is_said_to_be_idle():
    pytest.importorskip("bpy")
    from forest_addon import api

    planting = Planting(species="hazelnut", variants=1, expected=12, exact=True)
    scene = Scene(
        forest=Forest(size=(40, 40)), plantings=(planting,), tiles=Tiles(size=20, buffer=5)
    )

    def cut(scene):
        tiling = api.Tiling.of(scene)
        return [
            tiling.grid.corners(np.arange(len(tiling.grid))),
            len(tiling.build(0).observer.geometry),
        ]

    assert not silent(scene, cut, {"files"}, within=("tiles",))  # files: see headless/test_tiled


@pytest.mark.slow
def test_every_setting_of_the_output_changes_files_or_is_said_to_be_idle(tmp_path, quick):
    pytest.importorskip("bpy")
    from matplotlib.image import imread

    from headless.pipeline import run_scene

    off = dict.fromkeys(("pictures", "goodness", "leaves", "report", "blend", "glb"), False)
    planting = Planting(species="grass", variants=1, expected=12, exact=True)
    runs = iter(range(1000))

    def files(output):
        scene = Scene(forest=Forest(size=(12, 12)), plantings=(planting,), output=output)
        out = tmp_path / str(next(runs))
        run_scene(scene, Path(), out, quiet=True)
        fixed = (path for path in sorted(out.rglob("*")) if path.suffix in (".png", ""))
        names = [path.name.encode() for path in sorted(out.rglob("*"))]
        told = str(list(json.loads((out / "run.json").read_text())["results"])).encode()
        return [told, *names, *(imread(path) for path in fixed if path.is_file())]

    small = Output(**off, preview=True, preview_size=(32, 32))
    assert not silent(small, files)
    drawn = small.changed(preview="cycles", preview_samples=1)
    assert not silent(drawn, files, within=("preview_samples",))


@pytest.mark.medium
@pytest.mark.parametrize("rule", ["centre", "corners", "scattered", "path", "over", "pairs"])
def test_every_setting_of_a_place_moves_a_sensor_or_is_said_to_be_idle(rule):

    sensor = {"path": Sonar(name="a"), "over": Airborne(name="a"), "pairs": Reverb(name="a")}
    scene = Scene(forest=Forest(size=(20, 20)), sensors=(sensor.get(rule, Terrestrial(name="a")),))
    trunks = np.random.default_rng(1).uniform(0, 20, (200, 2))

    def placed(place):
        settings, files = place_sensors(scene, [place], trunks, Inputs().ground(0.0))
        return [*arrays(settings.sensors), *(text.encode() for text in files.values())]

    assert not silent(Placing(sensor="a", rule=rule, count=12), placed)


@pytest.mark.medium
def test_every_table_of_a_plan_changes_its_scenes_or_is_said_to_be_idle(tmp_path):

    field = Forest(size=(20, 20))
    for ground in (Ground(), Ground(relief=3.0)):
        assert not silent(ground, lambda one: list(heights_of(one, 1, field)) if one.relief else [])

    def scenes(key, written):
        def drawn(group):
            plan = tmp_path / "plan.toml"
            plan.write_text(written + key + text_of(group))
            return [
                str((one.scene, one.split, one.library)).encode()
                for one in recipes(read_plan(plan))
            ]

        return drawn

    def text_of(group):
        table = dataclasses.asdict(group)
        return "".join(f"{key} = {toml(value)}\n" for key, value in table.items())

    base = "count = 8\n[scene]\n[[scene.plantings]]\nspecies = 'silver-birch'\ndensity = 0.1\n"
    base += "[[scene.plantings]]\nspecies = 'scots-pine'\ndensity = 0.2\n"
    species = ("hazelnut", "norway-spruce", "silver-birch")
    for mix in (Mix(), Mix(species=species), Mix(redealt=2.0)):
        assert not silent(mix, scenes("[mix]\n", base))
    assert not silent(
        Splits(),
        scenes("[splits]\n", f"trees = 'shared library of 3'\n{base}"),
        {"train", "validation", "test"},
    )


def toml(value):
    """A value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f"'{value}'"
    return str(list(value) if isinstance(value, tuple) else value)


@pytest.mark.slow
def test_everything_that_a_dataset_keeps_is_a_file_or_is_said_to_be_idle(tmp_path):
    pytest.importorskip("bpy")
    from headless.dataset import disk
    from headless.dataset.scene import Session, make

    written = (
        "count = 1\n[scene.forest]\nsize = [8, 8]\n"
        "[[scene.plantings]]\nspecies = 'whorl-8'\nvariants = 1\nexpected = 2\nexact = true\n"
        "[[scene.sensors]]\nkind = 'terrestrial'\nname = 'a'\nposition = [4, 4, 1.5]\n"
        "angle_step_deg = 8.0\n[scene.output]\npreview_size = [32, 32]\npreview_samples = 1\n"
    )
    (tmp_path / "plan.toml").write_text(written)
    (recipe,) = recipes(read_plan(tmp_path / "plan.toml"))
    session, runs = Session(), iter(range(1000))

    def made(keep):
        out = tmp_path / str(next(runs))
        folder = disk.begin(out, recipe.number)
        make(dataclasses.replace(recipe, keep=keep), folder, out, session, 1)
        files = sorted(out.rglob("*.npz"))
        names = [path.name.encode() for path in sorted(out.rglob("*"))]
        return [*names, *(path.read_bytes() for path in files)]

    assert not silent(Keep(), made, {"empty"})  # of the check, see headless/dataset


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
    sentence = idle_in_species(species)[0]
    assert sentence.startswith(f"{place} has no effect: it needs {OF_SPECIES[place][0]} to be ")


def test_no_species_that_is_shipped_has_a_setting_without_effect():
    for path in sorted((ASSETS / "species").glob("*.toml")):
        assert idle_in_species(read_settings(path, Species)) == [], path.name
