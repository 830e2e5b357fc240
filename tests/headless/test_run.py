"""A whole run, as a user starts it: a process, a scene file, an output folder."""

import csv
import json
import re
import struct
import subprocess
import sys
from pathlib import Path

import laspy
import numpy as np
import pytest
from matplotlib.image import imread
from references import gltf
from scipy.io import loadmat

bpy = pytest.importorskip("bpy")

from forest_addon import api as forest
from forest_addon.blender.rays.casters import embree_problem
from forest_addon.formats.ownership import RECORD
from forest_addon.spec import Accuracy, Forest, Output, Planting, Reverb, Scene, Targets
from forest_addon.ui import registered
from forest_addon.ui.settings.exchange import from_spec, to_spec
from headless.pipeline import run_scene
from headless.report.page import viewer

ROOT = Path(__file__).resolve().parents[2]
SMALL = Path(__file__).with_name("small.toml")
RESULTS = [
    *("cloud.laz", "cloud.png", "echo.npz", "echo.png", "echo.wav", "forest.blend", "forest.glb"),
    *(
        "leaf_angles.csv",
        "leaves.npz",
        "preview.png",
        "report.html",
        "reverb.npz",
        "reverb.png",
        "reverb.wav",
        "run.json",
    ),
    *("scan.npz", "scan.png", "stand.png", "trees.csv"),
]


BARE = (
    "[output]\nblend = false\nglb = false\npreview = false\n"
    "pictures = false\ngoodness = false\nreport = false\n"
)


def process(*words, **options):
    """A command in a process of its own, as a shell starts it."""
    return subprocess.run(
        [sys.executable, "-m", "headless", *map(str, words)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=900,
        **options,
    )


@pytest.mark.medium
def test_undergrowth_is_said_and_is_no_tree(headless, tmp_path):
    """Five trees on 100 m² are 500 trees/ha, whatever grows below them."""
    scene = tmp_path / "a.toml"
    plant = '[[plantings]]\nspecies = "scots-pine"\nexpected = 5\nexact = true\nvariants = 1\n'
    sensor = '[[sensors]]\nkind = "terrestrial"\nangle_step_deg = 5.0\n'
    scene.write_text(f"[forest]\nsize = [10.0, 10.0]\n{plant}{sensor}{BARE}")
    ended = headless("run", scene, "--out", tmp_path / "out")
    facts = json.loads((tmp_path / "out" / "run.json").read_text())["results"]["Forest"]
    with (tmp_path / "out" / "trees.csv").open() as file:
        rows = len(list(csv.DictReader(file)))
    assert (facts["trees"], facts["density"]) == ("5", "500 trees/ha")
    assert int(facts["undergrowth"]) == rows - 5 > 20
    assert f"{rows - 5} plants of undergrowth stand beside 5 trees" in ended.stderr
    assert 'forest.undergrowth = "none" leaves them out' in ended.stderr


@pytest.fixture(scope="module")
def done(once):
    """One run of the small scene: its folder, and what it said on its two streams."""

    def make(folder):
        ended = process("run", SMALL, "--out", folder / "out")
        assert ended.returncode == 0, ended.stderr
        (folder / "said.json").write_text(json.dumps([ended.stdout, ended.stderr]))

    folder = once("run", make)
    return folder / "out", *json.loads((folder / "said.json").read_text())


def test_every_result_is_there_and_nothing_else(done):
    out, said, told = done
    assert sorted(p.name for p in out.iterdir()) == [RECORD, *RESULTS]
    assert all((out / name).stat().st_size > 100 for name in RESULTS)
    assert said == ""  # Blender's chatter is kept away
    assert "report.html" in told.splitlines()[-1]


def test_the_record_tells_how_to_run_it_again(done):
    record = json.loads((done[0] / "run.json").read_text())
    assert record["seed"] == 3
    assert record["ray_engine"] == ("bvhtree" if embree_problem() else "embree")
    assert record["settings"]["forest"]["size"] == [10.0, 10.0]
    assert record["settings"]["sensors"][0]["name"] == "scan"
    assert set(record["versions"]) == {
        *("forest_sensing", "blender", "python", "numpy", "scipy", "kernels")
    }
    assert all(took >= 0 for took in record["stage_seconds"].values())
    assert sorted(record["files"]) == sorted(set(RESULTS) - {"report.html"})


def test_results_agree_with_each_other(done):
    out = done[0]
    trees = np.genfromtxt(out / "trees.csv", delimiter=",", names=True, dtype=None, encoding="utf8")
    with np.load(out / "leaves.npz") as leaves:
        assert len(leaves["radius"]) == trees["leaves"].sum()
        assert set(leaves["tree"]) == set(trees["tree"])
        area = [np.pi * (leaves["radius"][leaves["tree"] == t] ** 2).sum() for t in trees["tree"]]
        assert area == pytest.approx(trees["leaf_area_m2"], rel=1e-9)
        assert str(leaves["radius_unit"]) == "m"
        centre, leaf_tree, leaf_number = leaves["centre"], leaves["tree"], leaves["leaf"]
        length = leaves["length"]
    cloud = laspy.read(out / "cloud.laz")
    hit = np.flatnonzero(np.asarray(cloud.leaf) >= 0)
    assert len(hit) > 20
    # A point on a leaf lies on that leaf of that tree, as the truth has it.
    row = {(t, n): i for i, (t, n) in enumerate(zip(leaf_tree, leaf_number, strict=True))}
    own = np.array([row[int(cloud.tree[i]), int(cloud.leaf[i])] for i in hit])
    away = np.linalg.norm(cloud.xyz[hit] - centre[own], axis=1)
    assert (away <= length[own]).all()
    with np.load(out / "scan.npz") as scan:
        assert scan["distance"].shape == (len(scan["track"]), len(scan["angle"]))
        assert ((scan["organ"] < 0) == np.isinf(scan["distance"])).all()


def test_the_blend_file_opens_with_everything_in_named_collections(done, empty_blender):
    bpy.ops.wm.open_mainfile(filepath=str(done[0] / "forest.blend"))
    forest = bpy.context.scene.collection.children["Forest"]
    parts = {"Ground", "Outlines", "Results", "Sensors", "Trees", "Variants"}
    assert {part.name for part in forest.children} == parts
    trees = (done[0] / "trees.csv").read_text().splitlines()[1:]
    assert len(forest.children["Trees"].all_objects) == len(trees)
    assert bpy.data.objects["cloud points"].data.attributes["organ"].domain == "POINT"
    assert bpy.context.scene.camera.name == "Forest camera"


def test_the_glb_is_valid_and_shares_meshes(done, tmp_path):
    raw = (done[0] / "forest.glb").read_bytes()
    length = int.from_bytes(raw[12:16], "little")
    document = json.loads(raw[20 : 20 + length])
    trees = len((done[0] / "trees.csv").read_text().splitlines()) - 1
    assert len(document["nodes"]) >= trees + 1
    assert len(document["meshes"]) <= 2  # a variant and the ground
    issues = gltf.validate(done[0] / "forest.glb")
    if issues is None:
        pytest.skip("Khronos' glTF validator needs node and npm, or they are offline")
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"][:5]


def test_the_report_holds_its_pictures(done):
    page = (done[0] / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 6
    assert viewer() in page  # of the turning clouds, in the page itself
    words = re.sub("base64,[A-Za-z0-9+/=]+", "", page.replace(viewer(), ""))
    assert "http" not in words.replace("http-equiv", "")


@pytest.mark.slow
def test_the_same_seed_gives_the_same_results_in_another_process(headless, done, tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(SMALL.read_text().split("[output]")[0] + BARE)
    ended = headless("run", scene, "--out", tmp_path, "--quiet")
    assert ended.stderr.count("\n") == 1  # of the reverb, whose record is short
    for name in ("trees.csv", "cloud.laz", "reverb.wav", "scan.npz", "echo.npz", "leaves.npz"):
        assert (tmp_path / name).read_bytes() == (done[0] / name).read_bytes(), name


@pytest.mark.slow
def test_without_trees_the_sensors_see_the_ground_only(headless, tmp_path):
    scene = tmp_path / "none.toml"
    text = SMALL.read_text().split("[output]")[0].replace("expected = 4", "expected = 0")
    scene.write_text(text + BARE)
    headless("run", scene, "--out", tmp_path / "o")
    with np.load(tmp_path / "o" / "scan.npz") as scan:
        assert set(np.unique(scan["organ"])) == {-1, 3}
    with np.load(tmp_path / "o" / "echo.npz") as echo:
        loudest = echo["time"][np.abs(echo["impulse_response"]).argmax()]
        height, speed = float(echo["position"][2]), float(echo["sound_speed"])
        assert loudest == pytest.approx(2 * height / speed, abs=1e-4)
        assert np.isfinite(echo["spectrum"]).all()


@pytest.mark.slow
def test_the_script_for_blender_itself(tmp_path):
    bare = tmp_path / "bare.toml"
    text = SMALL.read_text().split("[[plantings]]")[0]
    bare.write_text(text + BARE)
    script = ROOT / "headless" / "in_blender.py"
    words = [sys.executable, script, "--", bare, "--out", tmp_path / "o"]
    ended = subprocess.run([*map(str, words)], cwd=tmp_path, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    assert (tmp_path / "o" / "trees.csv").exists()


@pytest.mark.slow
def test_a_run_starts_from_a_blend_file_and_stands_on_what_is_in_it(headless, tmp_path):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_plane_add(size=30, location=(5, 5, 40))
    bpy.context.object.name = "hill"
    bpy.context.object.rotation_euler = (0, 0.3, 0)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "site.blend"))
    scene = tmp_path / "scene.toml"
    scene.write_text(
        'blend = "site.blend"\n[forest]\nsize = [10, 10]\ninstancing = "points"\n'
        '[forest.terrain]\nobject = "hill"\n'
        '[[plantings]]\nspecies = "apple"\nvariants = 1\nexpected = 4\nexact = true\n' + BARE
    )
    headless("run", scene, "--out", tmp_path / "o", "--quiet")
    trees = np.genfromtxt(tmp_path / "o" / "trees.csv", delimiter=",", names=True, encoding="utf8")
    assert len(trees) == 4
    assert trees["z_m"] == pytest.approx(40 - np.tan(0.3) * (trees["x_m"] - 5), abs=1e-4)
    scene.write_text(scene.read_text().replace("site.blend", "gone.blend"))
    ended = headless("run", scene, "--out", tmp_path / "p", "--quiet", ends=2)
    assert "there is no such file" in ended.stderr


@pytest.mark.slow
@pytest.mark.filterwarnings("error:Attempting to set identical")  # by a tractor that scans once
@pytest.mark.filterwarnings("error:Only one segment")  # of a record shorter than a window
def test_sensors_that_meet_nothing_are_reported_too(headless, tmp_path):
    """A field without trees or ground in reach: every picture is drawn, every file is written."""
    scene = tmp_path / "nothing.toml"
    scene.write_text(
        'seed = 1\n[[plantings]]\nspecies = "hazelnut"\nvariants = 1\nexpected = 0\n'
        '[[sensors]]\nkind = "terrestrial"\nposition = [0, 0, 50]\nelevation_deg = [10, 60]\n'
        'angle_step_deg = 10\n[[sensors]]\nkind = "tractor"\nposition = [0, 0, 50]\n'
        "angle_step_deg = 5\nstep = 100\nreach = 2\ntop = 60\n"
        '[[sensors]]\nkind = "sonar"\nposition = [0, 0, 50]\nmax_range = 4\n'
        '[[sensors]]\nkind = "reverb"\nsample_rate = 4000\nduration = 0.03\n'
        "[output]\nblend = false\nglb = false\npreview = false\n"
    )
    headless("run", scene, "--out", tmp_path / "out", "--quiet")
    with laspy.open(tmp_path / "out" / "cloud.laz") as cloud:
        assert cloud.header.point_count == 0
    for picture in ("cloud.png", "scan.png", "echo.png", "reverb.png"):
        assert imread(tmp_path / "out" / picture).std() > 0.02


# -------------------------------------------------------------------------------------------- output
# What ``[output]`` switches off is neither made nor paid for; all else stays as it is.

STAND = """
seed = 5
[forest]
size = [20, 20]
[[plantings]]
species = "hazelnut"
variants = 1
expected = 12
exact = true
[[sensors]]
kind = "terrestrial"
name = "cloud"
position = [10, 10, 1.6]
angle_step_deg = 4
[output]
blend = false
glb = false
preview = false
"""
OFF = "pictures = false\ngoodness = false\nleaves = false\nreport = false\n"
ALWAYS = ["cloud.laz", "leaf_angles.csv", "run.json", "trees.csv"]
HEAVY = ("matplotlib", "scipy.signal", "scipy.stats")


def run(scene, out):
    """A run in a process of its own: which heavy packages it imported."""
    code = (
        "import sys; from headless.cli import main\n"
        f"assert main(['run', {str(scene)!r}, '--out', {str(out)!r}, '--quiet']) == 0\n"
        f"print(*[name for name in {HEAVY} if name in sys.modules])"
    )
    words = [sys.executable, "-c", code]
    return subprocess.run(
        words, cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.split()


@pytest.mark.slow
def test_what_is_switched_off_is_not_made_nor_imported(tmp_path, headless, quick):
    scene = tmp_path / "scene.toml"
    scene.write_text(STAND + OFF)
    assert run(scene, tmp_path / "bare") == []
    assert sorted(file.name for file in (tmp_path / "bare").iterdir()) == [RECORD, *ALWAYS]
    scene.write_text(STAND)
    headless("run", scene, "--out", tmp_path / "all")
    pictures = ["cloud.png", "goodness.png", "stand.png"]
    made = sorted(file.name for file in (tmp_path / "all").iterdir())
    assert made == sorted([RECORD, *ALWAYS, *pictures, "leaves.npz", "report.html"])
    for name in ALWAYS:
        if name != "run.json":  # which says how long it took
            same = (tmp_path / "all" / name).read_bytes() == (tmp_path / "bare" / name).read_bytes()
            assert same, name
    bare, whole = (
        json.loads((tmp_path / name / "run.json").read_text())["results"]
        for name in ("bare", "all")
    )
    del whole["Where the trees stand"]
    assert bare == whole


@pytest.mark.slow
def test_without_pictures_the_test_of_the_stand_is_still_told(tmp_path, headless, quick):
    scene = tmp_path / "scene.toml"
    scene.write_text(
        STAND.split("[[sensors]]")[0]
        + "[output]\n"
        + STAND.split("[output]\n")[1]
        + "pictures = false\n"
    )
    headless("run", scene, "--out", tmp_path / "out")
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert "L function" in record["results"]["Where the trees stand"]
    assert not list((tmp_path / "out").glob("*.png"))
    assert "<img" not in (tmp_path / "out" / "report.html").read_text()


# ------------------------------------------------------------------------------------------- targets
# A run of trees with targets: the report, run.json and trees.csv say target and reached.

LIST = "x,y,dbh,height,leaf_area\n2,2,0.10,8.0,20\n5,5,0.12,9.0,25\n"
OUTPUT = Output(blend=False, glb=False, preview=False, pictures=False)


@pytest.mark.slow
def test_the_report_says_target_and_reached(tmp_path, capsys):
    (tmp_path / "plot.csv").write_text(LIST)
    measured = Planting(
        species="honda-birch",
        layout="list",
        trees="plot.csv",
        variants=2,
        targets=Targets(allometry="betula"),
    )
    plain = Planting(species="grass", layout="list", trees="plot.csv", variants=1)
    scene = Scene(forest=Forest(size=(10, 10)), plantings=(measured, plain), output=OUTPUT)
    run_scene(scene, tmp_path, tmp_path / "out")
    told = json.loads((tmp_path / "out/run.json").read_text())
    assert told["targets"]["honda-birch"]["measures"]["leaf_area"]["target"] == [20, 22.5, 25]
    assert told["targets"]["honda-birch"]["allometry"] == "Betula"
    assert list(told["targets"]) == ["honda-birch"]
    page = (tmp_path / "out/report.html").read_text()
    assert "What the trees were to measure" in page
    assert "honda-birch: leaf area" in page
    assert "grass: its list gives dbh and height and leaf_area" in page
    assert "Warning: grass: its list gives" in capsys.readouterr().err
    with open(tmp_path / "out/trees.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["target_leaf_area_m2"] for row in rows] == ["20.0", "25.0", "", ""]
    assert rows[0]["in_band"] in ("0", "1")
    assert rows[2]["in_band"] == rows[2]["not_met"] == ""


# --------------------------------------------------------------------------------------- coordinates
# One rule of coordinates for all files of numbers: the same scene with and without an offset.

OFFSET = (432100.25, 5612300.5, 130.0)
PLAIN = """[output]
pictures = false
goodness = false
report = false
preview = false
glb = true
qsm = true
"""


def columns(path):
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


def numbers(table, names):
    return np.array([[float(value) for value in table[name]] for name in names]).T


@pytest.mark.slow
def test_every_file_has_the_offset(headless, tmp_path):
    text = SMALL.read_text().split("[output]")[0]
    text = text.replace("cull = 0.01", "cull = 0.01\ncontributions = true")
    for name, head in (("near", ""), ("far", f'offset = {list(OFFSET)}\ncrs = "EPSG:32632"\n')):
        (tmp_path / f"{name}.toml").write_text(head + text + PLAIN)
        headless("run", tmp_path / f"{name}.toml", "--out", tmp_path / name)
    near, far = tmp_path / "near", tmp_path / "far"
    tables = columns(near / "trees.csv"), columns(far / "trees.csv")
    places = [numbers(table, ("x_m", "y_m", "z_m")) for table in tables]
    assert np.allclose(places[1] - places[0], OFFSET, rtol=0, atol=1e-8)
    assert {k: v for k, v in tables[0].items() if k[1:] != "_m"} == {
        k: v for k, v in tables[1].items() if k[1:] != "_m"
    }
    for file, key in (("leaves", "centre"), ("echo", "position"), ("echo-heard", "position")):
        with np.load(near / f"{file}.npz") as here, np.load(far / f"{file}.npz") as there:
            assert len(np.atleast_2d(here[key]))
            assert np.allclose(there[key] - here[key], OFFSET, rtol=0, atol=1e-8), file
            assert {k for k in here if k != key and not np.array_equal(here[k], there[k])} == set()
    tables = [columns(folder / "cylinders.csv") for folder in (near, far)]
    for ends in ("start", "end"):
        here, there = (numbers(table, [f"{ends}{axis}" for axis in "XYZ"]) for table in tables)
        assert len(here)
        assert np.allclose(there - here, OFFSET, rtol=0, atol=2e-5)  # digits of the table
    models = [
        loadmat(next((folder / "qsm").iterdir()), simplify_cells=True) for folder in (near, far)
    ]
    here, there = (model["QSM"]["cylinder"]["start"] for model in models)
    assert np.allclose(there - here, OFFSET, rtol=0, atol=1e-8)
    clouds = [laspy.read(folder / "cloud.laz") for folder in (near, far)]
    assert np.allclose(clouds[1].xyz - clouds[0].xyz, OFFSET, rtol=0, atol=2e-4)
    note = (far / "coordinates.txt").read_text()
    assert "metres in EPSG:32632; the offset 432100.25, 5612300.5, 130 has been added" in note
    assert not (near / "coordinates.txt").exists()
    raw = (far / "forest.glb").read_bytes()
    told = json.loads(raw[20 : 20 + struct.unpack_from("<I", raw, 12)[0]])
    assert told["scenes"][0]["extras"]["offset_m"] == list(OFFSET)
    bpy.ops.wm.open_mainfile(filepath=str(far / "forest.blend"))
    assert tuple(bpy.context.scene["offset_m"]) == OFFSET


# -------------------------------------------------------------------------------------------- detail
# A run that models no more than its sensors need: the same sound, and what was left out in words.

QUIET = Output(goodness=False, pictures=False, blend=False, glb=False, preview=False)


@pytest.mark.slow
def test_a_clap_sounds_the_same_without_leaves(tmp_path):
    clap = Reverb(source=(-3, 3, 0.2), receiver=(9, 3, 0.2), sample_rate=8000, duration=0.1)
    bush = Planting(species="hazelnut", variants=1, expected=2, exact=True)
    full = Scene(
        seed=4, forest=Forest(size=(6, 6)), plantings=(bush,), sensors=(clap,), output=QUIET
    )
    for detail in ("full", "auto"):
        asked = full.changed(accuracy=Accuracy(detail=detail))
        run_scene(asked, tmp_path, tmp_path / detail, quiet=True)
    record = {d: json.loads((tmp_path / d / "run.json").read_text()) for d in ("full", "auto")}
    assert "chosen" not in record["full"]
    (chosen,) = record["auto"]["chosen"]
    assert (chosen["key"], chosen["bound"]) == ("detail.leaves", 0.0)
    assert "was left to auto" in (tmp_path / "auto" / "report.html").read_text()
    unique = {d: record[d]["triangles"]["unique"] for d in record}
    assert unique["auto"] < 0.8 * unique["full"]
    left_out = record["auto"]["sensors"]["reverb"].get("chosen", [])
    sounds = [(tmp_path / d / "reverb.wav").read_bytes() for d in ("full", "auto")]
    assert left_out or sounds[0] == sounds[1]


# ------------------------------------------------------------------------------------- blend sensors
# Sensors that live in a .blend file, run without a window, and the command that a usage line names.

WINDY = forest.Scene(
    name="Windy",
    seed=5,
    forest=forest.Forest(size=(6, 6), margin=2),
    plantings=(forest.Planting(species="hazelnut", variants=1, expected=3, exact=True),),
    wind=forest.Wind(speed=8),
    sensors=(
        forest.Terrestrial(name="cloud", position=(3, 3, 1), angle_step_deg=4),
        forest.Sonar(name="echo", position=(-1, 3, 1), max_range=4),
    ),
)


def saved(path, settings, *, grow):
    """A .blend file as the panel leaves it; returns the settings that the panel holds."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with registered():
        from_spec(bpy.context.scene, settings)
        if grow:
            assert bpy.ops.forest.build() == {"FINISHED"}
        bpy.ops.wm.save_as_mainfile(filepath=str(path))
        return to_spec(bpy.context.scene)


@pytest.mark.slow
def test_sensors_of_a_blend_file_find_what_the_api_finds_in_the_wind(headless, tmp_path):
    blend, out = tmp_path / "windy.blend", tmp_path / "o"
    settings = saved(blend, WINDY, grow=True)
    before = blend.read_bytes()
    ended = headless("run", blend, "--out", out)
    assert "stand still" not in ended.stderr
    assert blend.read_bytes() == before
    made = {p.name for p in out.iterdir()}
    pictures = {"cloud.png", "echo.png", "report.html"}
    assert made == {RECORD, "cloud.laz", "echo.npz", "echo.wav", "run.json"} | pictures
    record = json.loads((out / "run.json").read_text())
    assert record["settings"]["blend"] == "windy.blend"
    assert set(record["sensors"]) == {"cloud", "echo"}

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    world = forest.build(settings)  # grown anew, so nothing comes from the file
    for sensor, name in zip(settings.sensors, ("cloud.laz", "echo.npz"), strict=True):
        world.look(sensor).save(tmp_path / name)
    ours, theirs = (laspy.read(folder / "cloud.laz") for folder in (out, tmp_path))
    assert len(ours.points) > 500
    assert np.array_equal(ours.points.array, theirs.points.array)
    ours, theirs = (np.load(folder / "echo.npz") for folder in (out, tmp_path))
    assert sorted(ours.files) == sorted(theirs.files)
    assert all(np.array_equal(ours[name], theirs[name]) for name in ours.files)
    calm = forest.build(settings.changed(wind=forest.Wind())).look(settings.sensors[0])
    calm.save(tmp_path / "calm.laz")
    assert not np.array_equal(
        laspy.read(tmp_path / "calm.laz").xyz, laspy.read(out / "cloud.laz").xyz
    )


def test_a_blend_file_without_sensors_or_things_says_so(headless, tmp_path):
    bare = WINDY.changed(wind=forest.Wind())
    blend, out = tmp_path / "bare.blend", tmp_path / "o"
    saved(blend, bare.changed(sensors=()), grow=False)
    assert "add one in the panel" in headless("run", blend, "--out", out, ends=2).stderr
    saved(blend, bare, grow=False)
    assert "has nothing to scan" in headless("run", blend, "--out", out, ends=2).stderr
    assert (
        "belongs to a scene file"
        in headless("run", blend, "--out", out, "--seed", 3, ends=2).stderr
    )


@pytest.mark.medium
def test_centimetres_become_metres_and_a_warning_says_so(headless, tmp_path):
    blend, out = tmp_path / "cm.blend", tmp_path / "o"
    scanner = forest.Terrestrial(name="cloud", position=(300, 0, 0), angle_step_deg=1)
    saved(blend, forest.Scene(sensors=(scanner,)), grow=False)
    bpy.ops.mesh.primitive_cube_add(size=200)
    bpy.context.scene.unit_settings.scale_length = 0.01
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    assert "a unit is made 0.01 m" in headless("run", blend, "--out", out).stderr
    cloud = laspy.read(out / "cloud.laz")
    assert len(cloud.points) > 100
    assert np.abs(cloud.x - 1).max() < 0.1  # noise of ranges; it sees the face towards it alone
    assert np.abs(cloud.xyz[:, 1:]).max() == pytest.approx(1, abs=0.1)


@pytest.mark.medium
@pytest.mark.parametrize(
    ("before", "after"),
    [
        (("--python", "headless/in_blender.py", "--"), ("run",)),
        (("scene.blend", "--command", "forest"), ("run",)),
    ],
)
def test_the_usage_line_names_the_command_that_was_typed(tmp_path, before, after):
    code = (
        "import runpy, sys; "
        f"sys.argv = {['/usr/bin/blender', '-b', *before, *after, '--help']!r}; "
        f"runpy.run_path({str(ROOT / 'headless' / 'in_blender.py')!r})['run']({[*after, '--help']!r})"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.startswith(f"usage: blender -b {' '.join(before)} run ")
