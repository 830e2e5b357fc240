"""Words, scenes and maps that no command can use: one sentence says what, and nothing is written."""

import json
import math
import os
import shlex
import types
import typing
import warnings
from dataclasses import MISSING, fields
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from hypothesis import given, settings, strategies as st

bpy = pytest.importorskip("bpy")

from references.model_tree import tree

from forest_addon.formats.stl import write_stl
from forest_addon.formats.wav import write_wav
from forest_addon.spec import SENSORS, Forest, Planting, Scene
from forest_addon.spec.base import Settings, param_of, types_of

SMALL = Path(__file__).with_name("small.toml").read_text(encoding="utf-8")
FIELD = SMALL.partition("[[sensors]]")[0]


def sensor(kind, more="", name="a"):
    return f"[[sensors]]\nkind = '{kind}'\nname = '{name}'\n{more}\n"


def planting(species, more="expected = 2"):
    return f"[[plantings]]\nspecies = '{species}'\n{more}\n"


SCENES = [
    ("[forest]\nsize = [-3, 4]", "forest.size[0]: -3 m is out of range; use larger than 0"),
    ("[forest]\nsise = [3, 4]", 'forest.sise: is not known; did you mean "size"?'),
    ("this is not toml", "is not TOML"),
    ("seed = -1", "-1 is out of range; use from 0 to 9,223,372,036,854,775,807"),
    ("[plantings]\nspecies = 'maple'\nexpected = 3", "plantings: is one table"),
    ("[tiles]\nsize = 0.0001\n", "give at least 0.03 m"),
    (
        "[forest]\npolygon = [[0, 0], [9, 9], [9, 0], [0, 9]]\n" + planting("maple"),
        "cross or touch",
    ),
    (planting("oak"), "use one of abop-monopodial-a"),
    (planting("oak.toml"), "oak.toml: there is no such file"),
    (
        planting("spuce") + planting("apple") + planting("hazlenut"),
        'plantings[0].species, plantings[2].species: "spuce" (did you mean "spruce"?), "hazlenut" (did',
    ),
    (
        planting("maple", "expected = 3\ngaussians = [{ centre = [9e6, 0], width = [1, 1] }]"),
        "put nothing on the field",
    ),
    (planting("maple", "expected = 1e9"), "plantings[0].expected"),
    (planting("maple", "expected = 5e7"), "50,000,000 trees, more than 20,000,000"),
    (planting("maple", "expected = 2\nrasters = [{ file = 'gone.npy' }]"), "gone.npy: there is no"),
    (
        planting("scots-pine", "expected = 9\ntargets = {dbh = {mean = 2.8}}"),
        "times the largest measured of Pinus",
    ),
    (planting("gone-stl.toml"), "gone-stl.toml: template: there is no file"),
    (planting("page-stl.toml"), "page-stl.toml: template: page.stl is not an STL"),
    (planting("cut-stl.toml"), "cut-stl.toml: template: cut.stl is cut"),
    (sensor("reverb", "sample_rate = 8000.5"), "need a whole number of hertz"),
    (sensor("terrestrial", name="x" * 300), "give a shorter one"),
    (FIELD + sensor("sonar", name="leaves"), "leaves.npz, as the scene does"),
    (FIELD + sensor("terrestrial", name="preview"), "preview.png, as the scene does"),
    (sensor("terrestrial", name="tls") + sensor("sonar", name="TLS"), 'as sensor "tls" does'),
    (sensor("reverb") + sensor("reverb", name="a-dry"), 'a-dry.wav, as sensor "a" does'),
    (sensor("sonar") + sensor("sonar", name="a-heard"), 'a-heard.npz, as sensor "a" does'),
    *(  # forests have grown and nothing is written when these are met
        (FIELD + sensor("sonar", name="b") + sensor(kind, more), said)
        for kind, more, said in (
            ("sonar", "call = 'file'\ncall_file = 'dry.wav'", "holds nothing above 4000 Hz"),
            ("sonar", "hearing = 'file'\nhearing_file = 'gone.csv'", '"gone.csv" is not in'),
            ("sonar", "route = 'map.csv'", "needs the columns x_m"),
            ("mobile", "follow = 'Drone'", "Drone"),
            ("reverb", "heard_as = 'binaural'\nhead_file = 'gone.sofa'", "gone.sofa"),
            ("reverb", "source_objects = 'Horn'", 'no Speaker, Empty or Camera "Horn"'),
            ("terrestrial", "angle_step_deg = 0.002", "GB of memory"),
        )
    ),
]
SCAN = "--scanner riegl-vz-400i --at -1,0.5,1.6 --set angle_step_deg=1.0"
WORDS = [
    ("--versoin", 'did you mean "--version"'),
    ("rnu demo", 'did you mean "run"'),
    ("run dmo", 'did you mean "demo"'),
    ("run demo --quite", 'did you mean "--quiet"'),
    ("run demo hedge", "hedge: is a word too many"),
    ("run demo --workers=0", "--workers"),
    ("run demo --workers=-3", "--workers"),
    ("run demo --out ''", "is empty; name a file or folder"),
    ("run small.toml --seed -1", "--seed: -1 is out of range"),
    ("run small.toml --out small.toml/o", "cannot be written to"),
    ("run 'a\x1b[2Jb.toml' --out o", "a\\x1b[2Jb.toml"),  # names do not command the terminal
    ("canopy small.toml --at '1;2'", "is not 2 or 3 numbers"),
    ("canopy small.toml --at 1,2,3,4", "is not 2 or 3 numbers"),
    ("canopy small.toml --at nan,2", "is not 2 or 3 numbers"),
    ("canopy small.toml --grid 0", "out of range"),
    ("convolve none.wav dry.wav", "none.wav"),
    ("convolve dry.wav dry.wav --normalise nan", "nan is no finite number"),
    ("convolve dry.wav head.wav --out wet.mp3", "must end in .wav"),
    ("convolve dry.wav head.wav --out head.wav", "is read by"),
    ("convolve head.wav dry.wav", "its head is broken"),
    ("convolve . dry.wav", "is a folder; name a WAV file in it"),
    ("dataset --convert none --to s3dis", "holds no finished scene"),
    ("dataset --convert empty", "needs --to"),
    ("derive apple --generations 40", "symbols, more than 50,000,000"),
    ("derive apple --generations -1", "--generations: -1 is out of range"),
    ("derive apple --seed -1", "--seed: -1 is out of range"),
    ("derive honda-birch", "not by an L-system"),
    ("derive scots-pine", "not by an L-system"),
    ("derive aple", '"aple" is not known'),
    ("estimate map.csv --out map.csv", "must end in .toml"),
    ("lidar", "needs a .blend file"),
    ("lidar park.blend", "--scanner: is missing"),
    ("lidar park.blend --scanner rigel", "use one of dji-zenmuse-l2, faro-focus-s350"),
    ("lidar park.blend --scanner riegl-vz-400i", "--at: is missing"),
    ("lidar park.blend --scanner riegl-vz-400i --at 1,2", "is not 3 numbers with commas"),
    ("lidar park.blend --scanner riegl-vz-400i --along Drone", "is no mobile scanner"),
    ("lidar park.blend --scanner riegl-vux-1uav --along Road", "curves and empties here: Drone"),
    (f"lidar bare.blend {SCAN}", "has nothing to scan"),
    (f"lidar park.blend {SCAN} --set angel_step_deg=1", 'did you mean "angle_step_deg"'),
    (f"lidar park.blend {SCAN} --set max_range=-3", "max_range: -3 m is out of range"),
    (f"lidar park.blend {SCAN} --set nonsense", "is not KEY=VALUE"),
    (f"lidar park.blend {SCAN} --seed -1", "--seed: -1 is out of range"),
    (f"lidar park.blend {SCAN} --chunk 0", "--chunk: 0 is out of range"),
    (f"lidar park.blend {SCAN} --out x.txt", "must end in one of .laz"),
    (f"lidar none.blend {SCAN}", "there is no such file"),
    (f"lidar small.toml {SCAN}", "must end in one of .blend, .glb"),
    ("species hazelnut --pixels 5", "--pixels"),
    ("species plum-pudding", "plum-pudding"),
    ("stand demo --out points.xls", "must end in .csv or .geojson"),
    ("stand demo --out points.png", "must end in .csv or .geojson"),
    ("stand demo --out points", "must end in .csv or .geojson"),
    ("template nowhere.stl --name x", "there is no file nowhere.stl"),
    ("template w.stl --name 'a b'", "letters, digits"),
    ("template w.stl --name x --height -1", "out of range"),
    ("template w.stl --name x --siblings 1", "--siblings: 1 is out of range"),
    ("template w.stl --name x --unit miles", "use one of metres"),
]
MAPS = [  # a table of trees, further words of ``estimate``
    *(
        ("x,y\n1,2\n", f"--species maple --window {window}", said)
        for window, said in (
            ("0 0 10", "give X0 Y0 X1 Y1"),
            ("0 0 0 9", "give X0 Y0 X1 Y1"),
            ("0 a 1 9", "could not convert"),
            ("none.csv", "there is no such file"),
        )
    ),
    ("", "", "is empty; it needs a header"),
    ("x,y\n", "", "has no trees below its header"),
    ("a,b\n1,2\n", "", "has no column x, only a, b; call one of them x, another y"),
    ("x,y\n1,2\n3,zwei\n", "", 'row 3: y is "zwei", not a finite number'),
    ("x,y\n3,nan\n", "", "has no trees below its header"),
    ("x,y,bhd\n1,2,31.5\n3,4,28\n", "--species maple", "say the unit in the header, as dbh_cm"),
    ("x,y\n1\n", "", "row 2 has 1 values, its header 2"),
    ("x,y\n1,2\n", "", "some trees have no species; say what grows there"),
    ("x,y,species\n1,2,pine\n", "", '"pine" is no preset; say what grows in its place'),
    (
        "x,y,SPCD\n1,2,318\n3,4,202\n5,6,318\n",
        "",
        '"202", "318" are no presets; say what grows in their place, as '
        "--species 202=douglas-fir --species 318=PRESET. Presets: ",
    ),
    (
        "x;y;Baumart\n1;2;Fi\n3;4;Bu\n5;6;Picea abies\n",
        "",
        "as --species Bu=european-beech --species Fi=norway-spruce "
        "--species 'Picea abies=norway-spruce'. ",
    ),
    ("x,y,taxonID\n1,2,ACSA3\n", "--species ACSA3=acer", "as --species ACSA3="),
    (
        "x,y,species\n1,2,pine\n",
        "--species oak=maple",
        'no tree of the map is "oak"; it has "pine"',
    ),
    ("x,y,species\n1,2,pine\n", "--species pine=oak.toml", "there is no file oak.toml"),
    ("x,y,species\n1,2,pine\n", "--species pine=elm", '--species: "elm" is no preset'),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Write the files that commands find beside them, sound and broken."""
    folder = tmp_path_factory.mktemp("refused")
    (folder / "empty").mkdir()
    (folder / "small.toml").write_text(SMALL)
    (folder / "map.csv").write_text("x,y\n1,2\n")
    write_stl(folder / "w.stl", tree().wood())
    write_stl(folder / "l.stl", tree().leaves())
    (folder / "cut.stl").write_bytes((folder / "w.stl").read_bytes()[:-1000])
    (folder / "page.stl").write_text("<html>not found</html>")
    for name in ("gone", "page", "cut"):
        told = f'name = "a"\n[template]\nwood = "{name}.stl"\n'
        (folder / f"{name}-stl.toml").write_text(told)
    write_wav(folder / "dry.wav", np.sin(np.arange(4000.0)), 8000)
    (folder / "head.wav").write_bytes(b"RIFF\0\0\0\0WAVE")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "bare.blend"))
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.object.empty_add()
    bpy.context.object.name = "Drone"
    for frame in (1, 5):
        bpy.context.object.keyframe_insert("location", frame=frame)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "park.blend"))
    return folder


def content(folder):
    return {p: p.read_bytes() if p.is_file() else b"" for p in folder.rglob("*")}


@pytest.fixture
def refused(headless, folder, monkeypatch):
    """The one sentence by which a command ends that cannot be done, and leaves all as it was."""

    def run(words):
        monkeypatch.chdir(folder)
        before = content(folder)
        said = headless(*shlex.split(words), ends=2).stderr
        assert content(folder) == before
        assert said.count("error: ") == 1
        return said

    return run


@pytest.mark.slow
@pytest.mark.parametrize(("words", "said"), WORDS)
def test_words_that_cannot_be_used(refused, words, said):
    assert said in refused(words)


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "said"), SCENES)
def test_scenes_that_cannot_be_used(refused, folder, scene, said):
    (folder / "s.toml").write_text(scene)
    assert said in refused("run s.toml --out o --quiet --convolve dry.wav")


@pytest.mark.medium
@pytest.mark.parametrize(("table", "words", "said"), MAPS)
def test_maps_that_cannot_be_used(refused, folder, table, words, said):
    (folder / "t.csv").write_text(table)
    assert said in refused(f"estimate t.csv --out o/s.toml {words}")


# ------------------------------------------------------------------------------------- drawn scenes
# Scenes drawn from the ranges that settings themselves tell: each ends as a run, or in one sentence.

SPECIES = (
    "apple",
    "maple",
    "hazelnut",
    "honda-birch",
    "silver-birch",
    "scots-pine",
    "whorl-8",
    "fern",
)
KINDS = ("tractor", "terrestrial", "mobile", "airborne", "sonar", "reverb")
DEEPEST = 2  # tables in tables
OFF = dict.fromkeys(("pictures", "goodness", "report", "blend", "glb", "preview"), False)
AT_ONCE = {  # what keeps a run to seconds, unless drawn
    "tractor": {"track": 5.0, "gap": 199},
    "terrestrial": {"angle_step_deg": 4.0},
    "mobile": {"pulse_rate": 1000.0},
    "airborne": {"pulse_rate": 1000.0},
    "sonar": {},
    "reverb": {"source": [2.0, 2.0, 1.5], "receiver": [5.0, 4.0, 1.5]},
}
ASIDE = {  # of a table: files, what the scene has by itself, and what would take long
    "name", "kind", "poses", "engine", "polygon", "holes", "size", "margin", "species", "gaussians", "raster",
    "scale_height", "distances", "origin",
}  # fmt: skip


class UndrawableError(Exception):
    """A setting whose values are not told by its range: a text, a file, a law."""


def numbers(param, default, whole):
    """Numbers of a setting: its ends, its default times some, and what lies between."""
    low = param.minimum if math.isfinite(param.minimum) else -20.0
    high = min(param.maximum, low + 100.0)
    least = low + 1e-3 * max(1.0, abs(low)) if param.open_minimum else low
    near = isinstance(default, int | float) and not isinstance(default, bool) and default
    some = [default * by for by in (0.5, 0.8, 1.3, 2, 3)] if near else [0.1, 1, 5]
    ends = [least, *([param.maximum] if param.maximum < 1e5 else [])]
    found = st.one_of(st.sampled_from([*ends, *some]), st.floats(least, max(high, least)))
    kept = found.map(lambda value: float(f"{min(max(value, least), param.maximum):.4g}"))
    return kept.map(lambda value: round(min(value, 200))) if whole else kept


def values(param, kind, default, depth):
    """Values of one setting by its type and range."""
    parts, form = typing.get_args(kind), typing.get_origin(kind)
    if form in (types.UnionType, typing.Union):
        able = []
        for part in parts:
            if part is not type(None):
                with_part = values_or_none(param, part, default, depth)
                able += [with_part] if with_part is not None else []
        if not able:
            raise UndrawableError
        return st.one_of(able)
    if param.file:
        raise UndrawableError
    if param.choices and (kind is str or form is typing.Literal):
        return st.sampled_from([each for each in param.choices if each])
    if kind is bool:
        return st.booleans()
    if kind in (int, float):
        found = numbers(param, default, kind is int)
        return st.one_of(found, st.just("auto")) if param.auto else found
    if form is tuple and parts[1:] == (Ellipsis,):
        return st.lists(values(param, parts[0], None, depth + 1), min_size=1, max_size=3)
    if form is tuple:
        usual = default if isinstance(default, tuple) and len(default) == len(parts) else None
        usual = usual or (None,) * len(parts)
        each = [values(param, *one, depth + 1) for one in zip(parts, usual, strict=True)]
        return st.tuples(*each).map(list)
    if isinstance(kind, type) and issubclass(kind, Settings) and depth <= DEEPEST:
        return tables(kind, depth + 1, 2)
    raise UndrawableError


def values_or_none(param, kind, default, depth):
    try:
        return values(param, kind, default, depth)
    except UndrawableError:
        return None


@st.composite
def tables(draw, cls, depth=0, most=3):
    """A table of some of the settings of a class, and of all that it cannot be without."""
    able = {each.name: each for each in fields(cls) if each.name not in ASIDE}
    must = [name for name, each in able.items() if param_of(each).required]
    some = draw(st.lists(st.sampled_from(sorted(able)), max_size=most, unique=True)) if able else []
    told = {}
    for name in dict.fromkeys([*must, *some]):
        default = None if able[name].default is MISSING else able[name].default
        found = values_or_none(param_of(able[name]), types_of(cls)[name], default, depth)
        if found is not None:
            told[name] = draw(found)
    return told


@st.composite
def scenes(draw):
    """The tables of a scene of a few small trees and one or two sensors."""
    side = draw(st.sampled_from([4.0, 8.0]))
    planting = {
        "species": draw(st.sampled_from(SPECIES)),
        "expected": draw(st.sampled_from([1, 2])),
    }
    told = {
        "seed": draw(st.integers(0, 10**6)),
        "forest": draw(tables(Forest, most=2)) | {"size": [side, side]},
        "plantings": [draw(tables(Planting, most=2)) | planting | {"variants": 1}],
        "output": OFF,
        "sensors": [],
    }
    rooms = {"air", "wind", "accuracy", "rays"}
    for name, kind in types_of(Scene).items():
        if name in rooms and draw(st.integers(0, 2)) == 0:
            told[name] = draw(tables(kind, most=2))
    for number in range(draw(st.integers(1, 2))):
        kind = draw(st.sampled_from(KINDS))
        sensor = AT_ONCE[kind] | draw(tables(SENSORS[kind], most=4))
        if kind in ("mobile", "airborne"):
            high = 20.0 if kind == "airborne" else 1.5
            way = ((0.0, [0.0, 0.0, high]), (2.0, [8.0, 4.0, high]))
            sensor["poses"] = [{"time": time, "position": place} for time, place in way]
        told["sensors"].append(sensor | {"kind": kind, "name": f"s{number}"})
    return told


@pytest.mark.slow
@settings(max_examples=6)
@given(scene=scenes())
def test_a_drawn_scene_ends_as_a_run_or_in_one_sentence(headless, tmp_path_factory, scene):
    """No traceback, no warning, no audit that calls a right result wrong, nothing half written."""
    folder = tmp_path_factory.mktemp("drawn")
    (folder / "s.toml").write_text(tomli_w.dumps(scene))
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        done = headless("run", folder / "s.toml", "--out", folder / "o", "--quiet", ends=None)
    assert done.returncode in (0, 2), done.stderr
    assert not [str(each) for each in heard if issubclass(each.category, RuntimeWarning)]
    if done.returncode == 2:
        assert len([line for line in done.stderr.splitlines() if line.startswith("error: ")]) == 1
        assert not (folder / "o").exists() or not os.listdir(folder / "o")
        return
    told = (folder / "o" / "run.json").read_text()
    json.loads(told, parse_constant=lambda word: pytest.fail(f"run.json holds {word}"))
    assert not [path.name for path in (folder / "o").rglob("*") if "partial" in path.name]
