"""Every field of every setting refuses every value of a wrong kind in one sentence."""

import dataclasses
import inspect
import pickle
import types
import typing
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from forest_addon import spec
from forest_addon.base import places
from forest_addon.base.places import ASSETS
from forest_addon.sensing.sonar.equipment_files import find
from forest_addon.spec import FORMER, Grammar, Rules
from forest_addon.spec.base import Settings, _check
from forest_addon.spec.choices import CHOICES, meaning_of, title_of
from headless.command import scene_file
from headless.dataset import settings as plans

GROUPS = sorted(
    {
        c
        for room in (spec, plans)
        for _, c in inspect.getmembers(room, inspect.isclass)
        if issubclass(c, spec.Settings) and c is not spec.Settings
    },
    key=lambda c: c.__name__,
)
NEEDED = {
    "Planting": {"species": "maple", "expected": 3},
    "Law": {"intercept": 1, "slope": 1, "low": -1, "high": 1, "dbh": (0.1, 0.5), "trees": 9},
    "Gaussian": {"centre": (0, 0), "width": (1, 1)},
    "HandTree": {"position": (0, 0)},
    "Clearing": {"position": (0, 0)},
    "Raster": {"file": "a.png"},
    "Distance": {"species": "a", "other": "b", "distance": 2},
    "Stems": {"count": 3},
    "Normal": {"mean": 1.0},
    "Discrete": {"values": (1, 2)},
    "Template": {"wood": "a.stl"},
    "Rules": {"axiom": "F"},
    "Species": {"name": "oak"},
    "Architecture": {"model": "Rauh"},
    "Placing": {"sensor": "a", "rule": "centre"},
}
LAW = spec.Law(**NEEDED["Law"])
MEASURES = dict.fromkeys(("height", "crown_width", "crown_base", "leaf_area"), LAW)
NEEDED["Allometry"] = {"name": "oak", "correlation": (0,) * 6, **MEASURES}

NUMBERS = [0, 1, 3, -2, 10**400, np.int64(2), np.uint8(7)]
FRACTIONS = [0.5, 1.5, -3.0, float("nan"), float("inf"), 1e308, np.float32(0.5), np.float64(2.5)]
TEXTS = ["", "2", "auto", "maple", np.str_("x"), Path("a.toml")]
TRUTHS = [True, False, np.bool_(True)]
OTHERS = [
    *(None, b"2", 1j, Decimal("2"), Fraction(1, 2), {}, {"subrays": 3}, {1, 2}, range(3)),
    *(object(), int, len, iter([1.0]), memoryview(b"ab"), np.datetime64("2020-01-01")),
    *(np.array([[1.0, 2.0]]), np.array(["a", "b"]), np.zeros((0, 3)), [], [[]], [None], ["a"]),
    *([1, 2], (1.5, 2.5), [1, 2, 3], [True, False], "ab", (("a",),), [1, [2]]),
    *(spec.Air(), spec.Beam(), spec.Normal(mean=0.1), spec.Sonar(), spec.Sonar),
]
VALUES = [*NUMBERS, *FRACTIONS, *TEXTS, *TRUTHS, *OTHERS]
FIELDS = [(group, field) for group in GROUPS for field in dataclasses.fields(group)]
KIND = {(g, f.name): typing.get_type_hints(g)[f.name] for g, f in FIELDS}


def fits(kind, value, auto=False):
    """Tell whether a value is of a kind, in another way: by how Python would print it."""
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        return any(fits(one, value) for one in typing.get_args(kind))
    if typing.get_origin(kind) is tuple:
        of = typing.get_args(kind)
        items = value.tolist() if isinstance(value, (np.ndarray, memoryview)) else value
        if type(items) not in (list, tuple):
            return False
        many = of[-1] is ...
        return (many or len(of) == len(items)) and all(
            fits(of[0] if many else of[k], item) for k, item in enumerate(items)
        )
    if kind is type(None):
        return value is None
    name = type(value).__name__
    if kind is bool:
        return name in ("bool", "bool_")
    if kind is int:
        return name.startswith(("int", "uint"))
    if kind is float:
        return name.startswith(("int", "uint", "float")) or (auto and str(value) == "auto")
    if kind is str:
        return name in ("str", "str_", "PosixPath", "WindowsPath")
    return isinstance(value, kind)


def hold(group, field, value):
    """A value becomes what its field says, or is refused by name in one sentence; nothing else."""
    kind, auto = KIND[group, field.name], spec.param_of(field).auto
    said, made = None, None
    try:
        made = group(**NEEDED.get(group.__name__, {}) | {field.name: value})
    except spec.SpecError as problem:
        said = problem
    if said is None:
        assert fits(kind, value, auto), (field.name, value)
        assert kind not in (bool, int, float, str) or type(getattr(made, field.name)) is kind
        return
    assert "\n" not in str(said)
    assert len(str(said)) < 1200
    assert fits(kind, value, auto) or said.key.split("[")[0] == field.name


@pytest.mark.slow
@pytest.mark.parametrize("group", GROUPS, ids=lambda g: g.__name__)
def test_every_field_refuses_every_value_of_a_wrong_kind(group):
    for field in dataclasses.fields(group):
        for value in VALUES:
            hold(group, field, value)


DRAWN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary(),
    lambda inner: st.lists(inner, max_size=6) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=12,
)


@given(st.sampled_from(FIELDS), DRAWN)
def test_every_field_stands_any_value_at_all(where, value):
    hold(*where, value)


@given(st.sampled_from(FIELDS), st.integers(0, 5), st.sampled_from(VALUES))
def test_so_is_one_of_several(where, index, value):
    """A list that is right but for one item names that item."""
    group, field = where
    kind = KIND[group, field.name]
    of = typing.get_args(kind)
    if typing.get_origin(kind) is not tuple or of[0] not in (int, float, str):
        return
    length = 3 if of[-1] is ... else len(of)
    known = spec.param_of(field)
    right = "a" if of[0] is str else of[0](min(max(known.minimum, 1), known.maximum))
    items = [right] * length
    items[index % length] = value
    if fits(of[0], value):
        return
    with pytest.raises(spec.SpecError) as said:
        group(**NEEDED.get(group.__name__, {}) | {field.name: items})
    assert said.value.key.startswith(f"{field.name}[{index % length}]")


def hears(**changes):
    return spec.SonarReceiver(**({"source_level_db": 110.0} | changes))


def planting(**changes):
    return spec.Planting(species="m", **changes)


LINK, LIGHT = spec.LinkBudget(energy=1.0, aperture=0.05), "more light than arrives"
NAN, ONE = float("nan"), {"expected": 3}
REFUSED = [  # and what is said: the setting first
    (lambda: spec.Terrestrial(angle_step_deg="2"), 'angle_step_deg: "2" is not a number'),
    (lambda: spec.Terrestrial(beam={"subrays": 3}), "give Beam(...)"),
    (lambda: spec.Terrestrial(beam=3), "beam: 3 is not settings; give Beam(...)"),
    (lambda: spec.Scene(plantings=spec.Planting(species="a", expected=1)), "is not a list"),
    (lambda: spec.Scene(seed=1.5), "seed: 1.5 is not a whole number"),
    (lambda: spec.Stems(count=10.5), "count: 10.5 is not a whole number"),
    (lambda: spec.Stems(count=3, radius=0.15), "radius: 0.15 is not settings; give Normal"),
    (lambda: spec.Sonar(speed=True), "speed: true is not a number"),
    (lambda: spec.Sonar(band=(60, 80)), "band[0]: 60 Hz is out of range; use from 1000"),
    (lambda: spec.Sonar(sample_rate=400), "400 Hz is out of range"),
    (lambda: spec.Beam(pulse_ns=4e-9), "4e-09 ns is out of range"),
    (lambda: spec.Beam(wavelength_nm=1.55), "1.55 nm is out of range"),
    (lambda: spec.Beam(subray=3), 'subray: is not known; did you mean "subrays"?'),
    (
        lambda: spec.Reverb(position=(1, 2, 3)),
        'position: is not known; did you mean "receiver"?',
    ),
    (lambda: spec.Beam(3), "3 has no name; give NAME=VALUE"),
    (lambda: spec.Planting(expected=3), "species: is missing in Planting"),
    (lambda: spec.Raster(file="a\0.png"), "null character"),
    (lambda: spec.Scene(sensors=(spec.Air(),)), "sensors[0]: Air("),
    (lambda: spec.Forest(size=(-3.0, 2.0)), "size[0]: -3 m is out of range"),
    (lambda: spec.Forest(size=(0.0, 2.0)), "larger than 0"),
    (lambda: spec.Forest(spacing=NAN), "spacing: nan"),
    (lambda: spec.Forest(spacing=float("inf")), "spacing: inf"),
    (lambda: spec.Reverb(source=(0.0, 0.0, 0.0)), "above the ground"),
    (lambda: spec.Tractor(top=0.5), "above the scanner"),
    (lambda: spec.Scene(sensors=(spec.Sonar(), spec.Sonar())), "sensors[1].name"),
    (lambda: spec.Scene(sensors=(spec.Sonar(name="a/b"),)), "sensors[0].name"),
    (lambda: spec.Planting(species="maple"), "expected"),
    (lambda: planting(expected=1, scale=(2.0, 1.0)), "scale"),
    (lambda: planting(**ONE, density=0.1), "density"),
    (lambda: planting(layout="list"), "trees"),
    (lambda: planting(layout="list", trees="a", collection="b"), "trees"),
    (lambda: planting(**ONE, polygon=((0, 0), (1, 1))), "polygon"),
    (lambda: planting(**ONE, holes=(((0, 0), (1, 1), (1, 0)),)), "holes"),
    (lambda: planting(**ONE, slope_deg=(30, 10)), "slope_deg"),
    (lambda: planting(**ONE, layout="clusters", exact=True), "cannot be used with"),
    (lambda: planting(**ONE, layout="strauss", exact=True), "cannot be used with"),
    (lambda: spec.Sonar(leaf_model="wood"), 'leaf_model: "wood"'),
    (lambda: spec.Sonar(band=(60e3, 250e3)), "band: "),
    (lambda: spec.Sonar(beam="file"), "beam_file"),
    (lambda: spec.Sonar(hearing="file"), "hearing_file"),
    (lambda: spec.Sonar(call="file"), "call_file"),
    (lambda: spec.Sonar(beam="horseshoe", band=(40e3, 80e3)), "band: "),
    (lambda: spec.Sonar(doppler=True), "doppler: "),
    (lambda: spec.Sonar(call="fm", band=(70e3, 70e3)), "call: "),
    (lambda: spec.Sonar(band=(80e3, 70e3)), "band: "),
    (lambda: spec.Sonar(tolerance=0.5), "tolerance: "),
    (lambda: hears(source_level_db=None, self_noise_db=10.0), "source_level_db"),
    (lambda: hears(threshold_db=10.0), "threshold_db"),
    (lambda: hears(ambient="rain"), "ambient_level_db"),
    (lambda: hears(resonance=50e3, transducer_file="a.wav"), "resonance"),
    (lambda: hears(gain=((1.0, 0.0), (0.5, 0.0))), "gain"),
    (lambda: hears(gain=((0.0, 1e6),)), "gain"),
    (lambda: hears(self_noise_db=0.0, self_noise_shape=((0.0, NAN),)), "self_noise_shape[0][1]"),
    (lambda: spec.Sonar(receiver=hears(resonance=250e3)), "receiver.resonance"),
    (lambda: spec.Terrestrial(faintest=0.1, link=LINK), "faintest: is given beside a link budget"),
    (lambda: spec.LinkBudget(energy=1.0), "aperture: is missing"),
    (
        lambda: spec.Terrestrial(receiver=spec.Receiver(dynamic_range=20.0)),
        "receiver.dynamic_range: counts from the faintest",
    ),
    *[
        (
            lambda leaf=leaf, passes=passes: spec.Surfaces(leaf=leaf, leaf_transmittance=passes),
            LIGHT,
        )
        for leaf, passes in ((0.9, 0.9), (0.5, 0.51), (1.0, 0.01))
    ],
    (
        lambda: spec.Mobile(poses=(spec.Pose(time=1.0), spec.Pose(time=1.0))),
        "later than the pose before",
    ),
    (lambda: spec.Wind(speed=-1.0), "speed"),
    (lambda: spec.Wind(speed=31.0), "speed"),
    (lambda: spec.Wind(speed=5.0, turbulence=0.7), "turbulence"),
    (lambda: spec.Targets(height=5.0, crown_base=6.0), "is not below the height"),
    (lambda: spec.Siblings(age=2.0, height=10.0), "beside age"),
    (lambda: spec.Inclination(mean_deg=10, sd_deg=40), "40 is too wide for a mean of 10; use at"),
    (lambda: spec.Inclination(shares=(0, 0)), "are all zero"),
    (lambda: spec.Species(name="x", architecture=spec.Architecture(model="Rauh")), "crown"),
    *[
        (lambda key=key, ratio=ratio: Grammar(**{key: ratio}), "out of range")
        for ratio in (0.0, -0.5, NAN)
        for key in ("side_ratio", "centre_ratio", "radius_ratio")
    ],
    (lambda: spec.Honda(length_ratio=spec.Normal(mean=0.0)), "length_ratio: can draw 0"),
    (lambda: spec.Honda(length_ratio=spec.Normal(mean=-0.5)), "can draw -0.5"),
    (lambda: spec.Honda(length_ratio=spec.Normal(mean=0.5, sd=0.3)), "can draw -0.1"),
    (lambda: spec.Honda(radius_ratio=spec.Normal(mean=0.0)), "radius_ratio: can draw 0"),
    (lambda: spec.Honda(radius_ratio=spec.Normal(mean=1.2)), "at most 1"),
    (lambda: spec.Honda(length=spec.Normal(mean=0.0)), "length: can draw 0"),
    (lambda: spec.Honda(angle_deg=spec.Normal(mean=181.0)), "at most 180"),
    (lambda: spec.Honda(levels=spec.Discrete(values=(13,))), "at most 12"),
    # Scans of years, before they begin.
    (lambda: spec.Terrestrial(angle_step_deg=1e-6), "angle_step_deg: "),
    (lambda: spec.Terrestrial(line_step_deg=1e-12), "line_step_deg: "),
    (
        lambda: spec.Terrestrial(angle_step_deg=1e-3, beam=spec.Beam(subrays=100_000)),
        "of 100,000 rays",
    ),
    (lambda: spec.Tractor(step=1e-12), "years of work"),
    (lambda: spec.Tractor(angle_step_deg=1e-12), "years of work"),
    (lambda: spec.Airborne(speed=1e-9), "years of work"),
    (lambda: spec.Mobile(poses=(spec.Pose(), spec.Pose(time=1e9))), "years of work"),
]


@pytest.mark.parametrize(("make", "words"), REFUSED)
def test_what_is_wrong_is_said(make, words):
    with pytest.raises(spec.SpecError) as said:
        make()
    assert words in str(said.value)
    assert "\n" not in str(said.value)


def test_what_means_the_same_is_taken():
    there = spec.Terrestrial(position=np.array([1, 2, 3]), max_range=np.float32(100), name="a")
    assert there == spec.Terrestrial(position=[1.0, 2, 3.0], max_range=100, name="a")
    assert [type(x) for x in there.position] == [float] * 3
    assert spec.Raster(file=Path("a.png")).file == "a.png"
    assert spec.Reverb(tolerance="auto").tolerance == spec.AUTO


def test_an_error_survives_a_process():
    said = pickle.loads(pickle.dumps(spec.SpecError("seed", "is wrong")))
    assert (said.key, said.problem, str(said)) == ("seed", "is wrong", "seed: is wrong")


# ---------------------------------------------------------------------------------------------- spec
# Settings check themselves, and every field is described.


@pytest.mark.parametrize("group", GROUPS, ids=lambda g: g.__name__)
def test_every_field_has_help_and_a_default_within_its_range(group):
    for field in dataclasses.fields(group):
        known = spec.param_of(field)
        assert known.help, field.name
        assert known.minimum <= known.maximum
        if not known.required:
            _check(field.name, field.default, known)  # does not raise


def test_sound_speed_follows_temperature():
    assert spec.Air().speed() == pytest.approx(343.2, abs=1e-9)
    assert spec.Air(temperature_c=0.0).speed() == pytest.approx(331.3, abs=0.1)
    assert spec.Air(sound_speed=340.0).speed() == 340.0


def test_the_finest_scan_that_an_instrument_makes_is_taken():
    made = spec.Terrestrial(angle_step_deg=0.0007, beam=spec.Beam(subrays=1))  # 8.8e10 pulses
    assert made.angle_step_deg == 0.0007


# ------------------------------------------------------------------------------------------- choices
# Every entry of every menu says what it does, in words of its own.

NAMES = {"kind", "allometry"}  # what these name needs no further words


def groups(cls=Settings):
    for sub in cls.__subclasses__():
        if sub.__module__.startswith("forest_addon."):
            yield sub
            yield from groups(sub)


def menus():
    for group in sorted(set(groups()), key=lambda group: group.__name__):
        for field in dataclasses.fields(group):
            known = spec.param_of(field)
            if known.choices and field.name not in NAMES:
                yield pytest.param(field.name, known, id=f"{group.__name__}.{field.name}")


@pytest.mark.parametrize(("name", "known"), list(menus()))
def test_every_choice_has_a_name_and_a_meaning_of_its_own(name, known):
    titles = [title_of(name, choice) for choice in known.choices]
    meanings = [meaning_of(name, choice) for choice in known.choices]
    assert all(meanings), dict(zip(known.choices, meanings, strict=True))
    assert len(set(titles)) == len(set(meanings)) == len(titles)
    assert known.help not in meanings
    assert max(map(len, titles)) <= 20


def test_nothing_is_said_of_what_there_is_not():
    there = {}
    for group in set(groups()):
        for field in dataclasses.fields(group):
            there.setdefault(field.name, set()).update(spec.param_of(field).choices)
    for name, choices in CHOICES.items():
        assert set(choices) <= there.get(name, set()), name


# -------------------------------------------------------------------------------------- former names
# Scene and species files of earlier releases name choices and shipped files as they did then.


@pytest.mark.parametrize(("group", "old"), [(Grammar, "T20"), (Grammar, "A20"), (Rules, "S")])
def test_a_dialect_of_an_earlier_release_is_read(group, old):
    given = {"axiom": "A"} if group is Rules else {}
    assert group(dialect=old, **given).dialect == FORMER[old]


def test_shipped_files_of_an_earlier_release_are_found(tmp_path):
    for old, now in places.FORMER.items():
        if old.endswith(".csv"):
            assert find(old, tmp_path, "route") == ASSETS / "scenes" / now
            (tmp_path / old).write_text("a user's own\n")
            assert find(old, tmp_path, "route") == tmp_path / old
        else:
            found = scene_file(old)
            assert found == ASSETS / "scenes" / f"{now}.toml"
            assert found.is_file()


def test_python_shows_what_settings_take():
    shown = str(inspect.signature(spec.Clearing))
    assert shown == "(*, position: 'tuple[float, float]', radius: 'float' = 0.01) -> None"
