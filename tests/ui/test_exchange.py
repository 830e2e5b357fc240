"""Settings to properties and back: nothing is lost, nothing is made up, errors say where."""

import contextlib
import dataclasses
import math
import types
import typing
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

from hypothesis import given, settings, strategies as st
from mathutils import Vector
from references.scenes import add_collection, link, reopened
from ui import test_panels
from ui.pressing import add_cube

from forest_addon import spec
from forest_addon.blender.sensors import objects as sensors
from forest_addon.formats.toml_file import read_settings
from forest_addon.ui import properties
from forest_addon.ui.forest.start import SCENES
from forest_addon.ui.settings import exchange, references
from forest_addon.ui.settings.groups import LARGEST_INT, fields_of
from forest_addon.ui.settings.presets import values_of
from forest_addon.ui.shell.views import chosen_sensor

DEMO = Path(__file__).resolve().parents[2] / "assets/scenes/demo.toml"
IN_BLENDER = settings(max_examples=6)


def values(kind, known, digits):
    """Strategy for one field: within its range, floats of so many significant digits."""
    if isinstance(kind, types.UnionType):
        return st.none() | values(typing.get_args(kind)[0], known, digits)
    if typing.get_origin(kind) is tuple:
        parts = typing.get_args(kind)
        if parts[-1] is Ellipsis and typing.get_origin(parts[0]) is tuple:
            item = values(parts[0], known, digits)
            if typing.get_args(parts[0])[-1] is Ellipsis:  # holes: rings, none of them empty
                return st.lists(item.filter(bool), max_size=2).map(tuple)
            return st.just(()) | st.lists(item, min_size=3, max_size=4).map(tuple)
        if parts[-1] is Ellipsis:
            return st.lists(values(parts[0], known, digits), max_size=3).map(tuple)
        return st.tuples(*(values(part, known, digits) for part in parts))
    if dataclasses.is_dataclass(kind):
        return groups(kind, digits)
    if kind is bool:
        return st.booleans()
    if kind is str:
        return (
            st.sampled_from(known.choices)
            if known.choices
            else st.text("abc-é", min_size=known.required, max_size=9)
        )
    low, high = max(known.minimum, -1e7), min(known.maximum, 1e7)
    if kind is int:
        return st.integers(int(low), int(min(high, LARGEST_INT)))
    numbers = st.floats(low, high, exclude_min=known.open_minimum, allow_subnormal=False)
    return numbers.map(lambda x: float(f"{x:.{digits}g}")).filter(
        lambda x: low <= x <= high and (x == 0 or abs(x) > 1e-30)
    )


# What fields are put into one by one, where a class has no defaults for all of them.
STARTS = {
    spec.Planting: {"species": "maple", "expected": 3.0},
    spec.Gaussian: {"centre": (1.0, 2.0), "width": (3.0, 4.0)},
    spec.HandTree: {"position": (1.0, 2.0)},
    spec.Clearing: {"position": (1.0, 2.0)},
    spec.Raster: {"file": "hill.png"},
    spec.Distance: {"species": "maple", "other": "maple", "distance": 2.0},
    spec.Template: {"wood": "wood.stl"},
    spec.Discrete: {"values": (1, 2)},
    spec.Normal: {"mean": 1.0},
}


@st.composite
def groups(draw, cls, digits=6):
    """Settings in which each field is drawn at random, but for what others do not allow beside them.

    So nothing that is drawn is thrown away, however many rules the fields have among them.
    """
    drawn = cls(**STARTS.get(cls, {}))
    kinds = typing.get_type_hints(cls)
    for field in draw(st.permutations(dataclasses.fields(cls))):
        value = draw(values(kinds[field.name], spec.param_of(field), digits))
        if ordered(value):
            value = tuple(sorted(value))
        with contextlib.suppress(spec.SpecError):
            drawn = dataclasses.replace(drawn, **{field.name: value})
    return drawn


def ordered(value):
    """Whether it is a pair of numbers, which most often means from and to."""
    return isinstance(value, tuple) and len(value) == 2 and isinstance(value[0], float)


OF_PLANTING = {spec.Gaussian: "gaussians", spec.Raster: "rasters"}
SINGLE = [
    *(
        spec.Forest,
        spec.Terrain,
        spec.Distance,
        *OF_PLANTING,
        spec.Rows,
        spec.Planting,
        spec.Air,
        spec.Wind,
        spec.Flight,
    ),
    spec.Rays,
    *spec.SENSORS.values(),
]


def group_for(props, cls):
    """A property group of this kind within the scene's."""
    if cls in OF_PLANTING:
        return getattr(props.plantings.add(), OF_PLANTING[cls]).add()
    if cls is spec.Rows:
        return props.plantings.add().rows
    if cls is spec.Distance:
        return props.forest.distances.add()
    if cls is spec.Terrain:
        return props.forest.terrain
    if cls is spec.Planting:
        return props.plantings.add()
    if cls in spec.SENSORS.values():
        kind = cls.__name__.lower()
        data = bpy.data.objects.new("thing", None)
        return getattr(data.forest_sensor, kind)
    return getattr(props, cls.__name__.lower())


@pytest.mark.slow
@pytest.mark.parametrize("cls", SINGLE, ids=lambda c: c.__name__)
@given(data=st.data())
@IN_BLENDER
def test_round_trip_is_exact_to_six_digits(props, cls, data):
    drawn = data.draw(groups(cls))
    group = group_for(props, cls)
    exchange.write(group, drawn)
    assert exchange.read(group, cls) == drawn


@pytest.mark.medium
@given(drawn=groups(spec.Forest, digits=17))
@IN_BLENDER
def test_any_number_is_kept_to_single_precision(props, drawn):
    exchange.write(props.forest, drawn)
    back = exchange.read(props.forest, spec.Forest)
    assert back.spacing == pytest.approx(drawn.spacing, rel=2**-23)
    assert back.size == pytest.approx(drawn.size, rel=2**-23)
    assert back.polygon == drawn.polygon  # corners are kept as text, to the last digit


def test_a_scene_replaces_what_was_there(props):
    scene = bpy.context.scene
    exchange.from_spec(scene, read_settings(DEMO, spec.Scene))
    exchange.from_spec(scene, spec.Scene())
    assert exchange.to_spec(scene) == spec.Scene()
    assert not bpy.data.speakers


def rounded(low, high):
    return st.floats(low, high).map(lambda x: round(x, 3))


@pytest.mark.parametrize(
    ("kind", "names", "ahead"),
    [
        ("sonar", ("azimuth_deg", "elevation_deg", "position"), (1, 0, 0)),
        ("reverb", ("facing_azimuth_deg", "facing_elevation_deg", "source"), (0, 0, -1)),
    ],
)
@given(
    azimuth=rounded(-179, 179),
    elevation=rounded(-89, 89),
    place=st.tuples(rounded(-1e3, 1e3), rounded(-1e3, 1e3), rounded(0.001, 1e3)),
)
@IN_BLENDER
def test_a_pose_comes_back_from_the_transform(props, kind, names, ahead, azimuth, elevation, place):
    """ahead : where an object looks or sends in its own frame; a speaker along its minus Z."""
    sensor = spec.SENSORS[kind](**dict(zip(names, (azimuth, elevation, place), strict=True)))
    obj = exchange.add_sensor(bpy.context.scene, sensor)
    bpy.context.view_layer.update()
    way, back = obj.matrix_world.to_3x3() @ Vector(ahead), exchange.sensor_of(obj)
    sensors.remove_sensor(obj)
    up, turn = math.radians(elevation), math.radians(azimuth)
    along = (math.cos(up) * math.cos(turn), math.cos(up) * math.sin(turn), math.sin(up))
    assert tuple(way) == pytest.approx(along, abs=1e-6)
    found = [getattr(back, name) for name in names]
    assert found[:2] == pytest.approx([azimuth, elevation], abs=2e-4)
    assert found[2] == place


def test_a_reverb_without_its_receiver_is_named(props):
    obj = exchange.add_sensor(bpy.context.scene, spec.Reverb())
    bpy.data.objects.remove(sensors.receiver_of(obj))
    with pytest.raises(spec.SpecError, match="receiver is gone"):
        exchange.sensor_of(obj)


@pytest.mark.parametrize("cls", SINGLE, ids=lambda c: c.__name__)
def test_properties_say_what_spec_says(props, cls):
    group = group_for(props, cls)
    shown = {
        prop.identifier: prop for prop in group.bl_rna.properties
    }  # ours after Blender's "name"
    for field in dataclasses.fields(cls):
        known = spec.param_of(field)
        if field.name == "kind" or shown[field.name].type in ("COLLECTION", "POINTER"):
            continue
        prop = shown[field.name]
        told = known.help.lower().replace("left out:", "off:")  # of a switch in the panel
        told = told.replace("auto:", "-1, automatic:") if known.auto else told
        assert prop.description.lower() == told, field.name
        assert not prop.name.endswith(" Deg")
        if prop.type in ("FLOAT", "INT"):
            least = spec.AUTO if known.auto else known.minimum  # which files call "auto"
            assert prop.hard_min == pytest.approx(max(least, prop.hard_min), rel=1e-6)
            assert prop.hard_max == pytest.approx(min(known.maximum, prop.hard_max), rel=1e-6)
        if known.unit == "m" and prop.type != "STRING":
            assert prop.unit == "LENGTH", field.name
        if known.unit == "Hz":
            assert prop.unit == "FREQUENCY", field.name


@pytest.mark.parametrize("cls", [spec.Forest, spec.Air, *spec.SENSORS.values()])
def test_untouched_properties_are_the_defaults(props, cls):
    assert exchange.read(group_for(props, cls), cls) == cls()


def test_an_offset_keeps_every_digit(props):
    scene = spec.Scene(offset=(499987.123456789, 5400123.37, 212.5), crs="EPSG:32632")
    exchange.from_spec(bpy.context.scene, scene)
    back = exchange.to_spec(bpy.context.scene)
    assert (back.offset, back.crs) == (scene.offset, scene.crs)


def thing(kind):
    """The settings of a new sensor."""
    obj = exchange.add_sensor(bpy.context.scene, spec.SENSORS[kind]())
    return getattr(obj.forest_sensor, kind)


@pytest.mark.parametrize(
    ("spoil", "key"),
    [
        (lambda p: setattr(p.forest, "size", (0, 5)), "forest.size[0]"),
        (lambda p: setattr(p.plantings.add(), "scale", (2, 1)), "plantings[0].scale"),
        (
            lambda p: setattr(p.plantings.add().gaussians.add(), "width", (0, 1)),
            "plantings[0].gaussians[0].width[0]",
        ),
        *(
            (lambda p, text=text: setattr(p.forest, "polygon", text), "forest.polygon")
            for text in ("[[0, 0], [1, ]]", "7 8", '[["a", 1]]', "[true]")
        ),
        (lambda _: setattr(thing("sonar"), "band", (8e4, 6e4)), "echo.band"),
    ],
)
def test_an_error_says_where(props, spoil, key):
    spoil(props)
    with pytest.raises(spec.SpecError) as caught:
        exchange.to_spec(bpy.context.scene)
    assert caught.value.key == key


def test_only_the_asked_sensor_has_to_be_right(props, sensor):
    sensor("sonar").forest_sensor.sonar.band = (8e4, 6e4)
    scanner = sensor("terrestrial")
    bpy.context.view_layer.update()
    assert exchange.to_spec(bpy.context.scene, [scanner]).sensors == (spec.Terrestrial(),)


def test_several_sensors_of_a_kind_have_names_of_their_own(props):
    scene = spec.Scene(sensors=(spec.Sonar(name="a"), spec.Sonar(name="b"), spec.Tractor()))
    exchange.from_spec(bpy.context.scene, scene)
    bpy.context.view_layer.update()
    assert set(exchange.to_spec(bpy.context.scene).sensors) == set(scene.sensors)


def test_a_name_that_is_taken_becomes_one_of_files(props, sensor):
    names = {exchange.sensor_of(sensor("sonar")).name for _ in range(2)}
    assert names == {"echo", "echo-001"}


def test_a_seed_that_blender_cannot_hold_is_refused(props):
    props.seed = 5
    with pytest.raises(spec.SpecError, match="2147483647"):
        exchange.from_spec(bpy.context.scene, spec.Scene(seed=2**31))
    assert props.seed == 5


@pytest.mark.parametrize(
    "change", [lambda p: setattr(p.air, "humidity", 20), lambda p: p.plantings.add()]
)
def test_whether_anything_was_set(props, change):
    assert exchange.untouched(props)
    change(props)
    assert not exchange.untouched(props)


# ---------------------------------------------------------------------------------------- references
# What settings name of the scene: pointers that outlive a rename, names in scene files and older files.


def names(scene=None):
    """Every name that the scene's settings say."""
    settings = exchange.to_spec(scene or bpy.context.scene)
    by_kind = {sensor.kind: sensor for sensor in settings.sensors}
    planting, reverb = settings.plantings[0], by_kind["reverb"]
    return {
        "object": settings.forest.terrain.object,
        "painted": planting.painted,
        "collection": planting.collection,
        "mobile": by_kind["mobile"].follow,
        "sonar": by_kind["sonar"].follow,
        "source_objects": reverb.source_objects,
        "receiver_objects": reverb.receiver_objects,
    }


@pytest.fixture
def naming(small, sensor):
    """A scene whose settings name something each, by their texts as a script sets them."""
    add_cube("hill").vertex_groups.new(name="weights")
    add_collection("orchard")
    link("way", bpy.data.curves.new("way", "CURVE"))
    for name in ("ear", "eye"):
        link(name)
    link("bell", bpy.data.speakers.new("bell"))
    sensor("mobile", follow="way")
    bpy.data.objects["echo"].forest_sensor.sonar.follow = "way"
    reverb = bpy.data.objects["reverb"].forest_sensor.reverb
    reverb.source_objects, reverb.receiver_objects = "bell", "ear, eye"
    small.forest.terrain.object = "hill"
    small.plantings[0].painted, small.plantings[0].collection = "hill:weights", "orchard"
    bpy.context.view_layer.update()
    return small


NAMED = {
    "object": "hill", "painted": "hill:weights", "collection": "orchard", "mobile": "way",
    "sonar": "way", "source_objects": "bell", "receiver_objects": "ear, eye",
}  # fmt: skip
RENAMED = {
    "object": "mound", "painted": "mound:weights", "collection": "grove", "mobile": "path",
    "sonar": "path", "source_objects": "gong", "receiver_objects": "left, eye",
}  # fmt: skip


def rename():
    for old, new in {"hill": "mound", "way": "path", "bell": "gong", "ear": "left"}.items():
        bpy.data.objects[old].name = new
    bpy.data.collections["orchard"].name = "grove"


def test_every_setting_that_names_something_is_known():
    """The class of the fault: a text whose help speaks of the Blender scene is a reference."""
    classes = {*spec.SENSORS.values(), spec.Forest, spec.Terrain, spec.Planting, spec.Stems}
    for cls in classes:
        for field in exchange.fields_of(cls):
            words, known = ("blender scene", "object that", "names of"), field.param
            text = field.kind is str and not known.choices
            if text and any(word in known.help.lower() for word in words):
                assert field.name in references.REFERENCES, f"{cls.__name__}.{field.name}"


def test_a_copy_of_a_sensor_follows_too(naming):
    copy = bpy.data.objects["reverb"].copy()
    bpy.data.objects["ear"].name = "left"
    assert exchange.sensor_of(copy).receiver_objects == "left, eye"


def test_a_picked_object_is_named(naming):
    other = add_cube("slope")
    naming.forest.terrain.object_pointer = other
    assert naming.forest.terrain.object == "slope"
    naming.plantings[0].painted_pointer = other
    naming.plantings[0].painted_layer = ""
    assert exchange.to_spec(bpy.context.scene).plantings[0].painted == "slope"
    naming.forest.terrain.object_pointer = None
    assert exchange.to_spec(bpy.context.scene).forest.terrain.object == ""


def test_a_name_that_nothing_has_yet_stays_a_name(naming):
    naming.forest.terrain.object = "later"
    reverb = bpy.data.objects["reverb"].forest_sensor.reverb
    reverb.receiver_objects = "ear, later"
    assert references.is_lost(naming.forest.terrain, "object")
    assert names()["object"] == "later"
    assert names()["receiver_objects"] == "ear, later"
    assert "Not Here" in test_panels.drawn()


def test_what_was_deleted_is_said(naming):
    hill = bpy.data.objects["hill"]
    bpy.context.scene.collection.objects.unlink(hill)  # as deleting in a view does
    with pytest.raises(spec.SpecError, match=r'"hill" was deleted') as caught:
        exchange.to_spec(bpy.context.scene)
    assert caught.value.key == "forest.terrain.object"


def test_objects_that_are_further_ends_are_added_and_removed(naming):
    bpy.context.view_layer.objects.active = bpy.data.objects["reverb"]
    reverb = bpy.data.objects["reverb"].forest_sensor.reverb
    assert bpy.ops.forest.add_receiver_object() == {"FINISHED"}
    reverb.receiver_objects_pointers[2].thing = bpy.data.objects["cloud"]
    assert exchange.sensor_of(bpy.data.objects["reverb"]).receiver_objects == "ear, eye, cloud"
    for _ in range(3):
        assert bpy.ops.forest.remove_receiver_object() == {"FINISHED"}
    assert exchange.sensor_of(bpy.data.objects["reverb"]).receiver_objects == ""


def test_a_rename_is_followed_also_in_a_saved_file(naming, tmp_path):
    assert names() == NAMED
    rename()
    assert names() == RENAMED
    props = reopened(tmp_path / "today.blend").forest_sensing
    assert props.forest.terrain.object == "mound"  # for whoever reads the text
    bpy.data.objects["mound"].name = "hill"
    assert names()["object"] == "hill"


# --------------------------------------------------------------------------------------------- shown
# Angles and high frequencies are shown in other units than files have; what is stored stays the file's.


def test_every_angle_of_a_panel_is_one_of_blenders(registered):
    for kind, group in properties.GROUPS.items():
        known = {p.identifier: p for p in group.bl_rna.properties}
        for field in fields_of(kind):
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
    obj = sensor("terrestrial")
    scanner = obj.forest_sensor.terrestrial
    scanner.azimuth_deg_shown = (math.radians(-100.0), math.radians(degrees))
    found = exchange.read(scanner, spec.Terrestrial, "cloud", {"name": "cloud"})
    assert found.azimuth_deg == (-100.0, degrees)


# -------------------------------------------------------------------------------------------- chosen
# Which sensor is chosen: list, panel and buttons mean the same one, whatever was clicked last.


def listed(props):
    """What the list highlights."""
    home = sensors.home_of(bpy.context.scene)
    number = props.active_sensor
    return home.objects[number] if number >= 0 else None


def activate(obj):
    bpy.context.view_layer.objects.active = obj
    bpy.context.view_layer.update()


def agree(props, obj):
    assert listed(props) == chosen_sensor(bpy.context) == obj


def test_after_shift_d_the_copy_is_chosen_everywhere(small):
    echo = bpy.data.objects["echo"]
    small.active_sensor = list(sensors.home_of(bpy.context.scene).objects).index(echo)
    agree(small, echo)
    for obj in bpy.data.objects:
        obj.select_set(obj == echo)
    bpy.ops.object.duplicate()
    copy = bpy.context.view_layer.objects.active
    assert copy != echo
    bpy.context.view_layer.update()
    agree(small, copy)
    assert bpy.ops.forest.remove_sensor() == {"FINISHED"}
    assert "echo" in bpy.data.objects
    assert "echo.001" not in bpy.data.objects


def test_the_chosen_one_stays_when_something_else_is_clicked_or_removed(small):
    cloud, echo = bpy.data.objects["cloud"], bpy.data.objects["echo"]
    activate(cloud)
    activate(echo)
    other = link("rock")
    activate(other)
    agree(small, echo)
    sensors.remove_sensor(cloud)  # numbers of the list move up
    agree(small, echo)
    echo.name = "ear"
    agree(small, echo)
    sensors.remove_sensor(echo)
    bpy.context.view_layer.update()
    assert chosen_sensor(bpy.context) == listed(small) is not None


@pytest.mark.medium
@pytest.mark.parametrize("preset", sorted(Path(path).stem for path in SCENES.glob("*.toml")))
def test_every_preset_starts_with_a_sensor_chosen(props, preset):
    bpy.ops.forest.start(preset=preset)
    bpy.context.view_layer.update()
    there = sensors.sensors_of(bpy.context.scene)
    if there:
        agree(props, there[0])
    else:
        assert props.active_sensor == -1


# ------------------------------------------------------------------------------------------- presets
# Presets in Blender's own menu: kept in a file, applied to another sensor or planting, removed.


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
    with pytest.raises(RuntimeError, match="Choose what the preset is for"):
        bpy.ops.forest.apply_preset(kind="sonar", values="{}")
    assert props.wind.speed == 6.5
