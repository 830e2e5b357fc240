"""A whole run, as a user starts it: a process, a scene file, an output folder."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import laspy
import numpy as np
import pytest
from references import gltf

bpy = pytest.importorskip("bpy")

from forest_addon.blender.rays.casters import embree_problem
from forest_addon.formats.ownership import RECORD
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


@pytest.mark.slow
def test_the_blend_file_opens_with_everything_in_named_collections(done):
    code = """
import bpy, sys
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
forest = bpy.context.scene.collection.children["Forest"]
print(sorted(c.name for c in forest.children), len(forest.children["Trees"].all_objects),
      bpy.data.objects["cloud points"].data.attributes["organ"].domain, bpy.context.scene.camera.name)
"""
    shown = subprocess.run(
        [sys.executable, "-c", code, str(done[0] / "forest.blend")], capture_output=True, text=True
    )
    trees = len((done[0] / "trees.csv").read_text().splitlines()) - 1
    parts = ["Ground", "Outlines", "Results", "Sensors", "Trees", "Variants"]
    expected = f"{parts} {trees} POINT Forest camera"
    assert expected in shown.stdout, shown.stdout + shown.stderr


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
    assert ended.returncode == 0
    assert ended.stderr == ""
    for name in ("trees.csv", "cloud.laz", "reverb.wav", "scan.npz", "echo.npz", "leaves.npz"):
        assert (tmp_path / name).read_bytes() == (done[0] / name).read_bytes(), name


@pytest.mark.slow
def test_another_seed_gives_another_forest(headless, done, tmp_path):
    bare = tmp_path / "bare.toml"
    text = SMALL.read_text().split("[[sensors]]")[0]
    bare.write_text(text + BARE)
    assert headless("run", bare, "--out", tmp_path / "o", "--seed", 4).returncode == 0
    assert (tmp_path / "o" / "trees.csv").read_bytes() != (done[0] / "trees.csv").read_bytes()


@pytest.mark.slow
def test_without_trees_the_sensors_see_the_ground_only(headless, tmp_path):
    scene = tmp_path / "none.toml"
    text = SMALL.read_text().replace("expected = 4", "expected = 0")
    scene.write_text(text)
    ended = headless("run", scene, "--out", tmp_path / "o")
    assert ended.returncode == 0, ended.stderr
    assert sorted(p.name for p in (tmp_path / "o").iterdir()) == [RECORD, *RESULTS]
    with np.load(tmp_path / "o" / "scan.npz") as scan:
        assert set(np.unique(scan["organ"])) == {-1, 3}
    with np.load(tmp_path / "o" / "echo.npz") as echo:
        loudest = echo["time"][np.abs(echo["impulse_response"]).argmax()]
        height, speed = float(echo["position"][2]), float(echo["sound_speed"])
        assert loudest == pytest.approx(2 * height / speed, abs=1e-4)
        assert np.isfinite(echo["spectrum"]).all()


@pytest.mark.slow
def test_a_species_file_and_stl_files_of_ones_own(headless, tmp_path):
    for part in ("wood", "leaves"):
        shutil.copy(ROOT / "assets" / "templates" / "apple" / f"{part}.stl", tmp_path)
    (tmp_path / "mine.toml").write_text(
        'name = "mine"\n[template]\nwood = "wood.stl"\nleaves = "leaves.stl"\n'
        "[grammar]\ngenerations = 4\n"
    )
    scene = tmp_path / "scene.toml"
    scene.write_text('[[plantings]]\nspecies = "mine.toml"\nexpected = 3\n' + BARE)
    assert headless("run", scene, "--out", tmp_path / "o").returncode == 0
    assert "mine" in (tmp_path / "o" / "trees.csv").read_text()


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
    words[3] = tmp_path / "none.toml"
    assert subprocess.run([*map(str, words)], capture_output=True).returncode == 2


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
    ended = headless("run", scene, "--out", tmp_path / "o", "--quiet")
    assert ended.returncode == 0, ended.stderr
    trees = np.genfromtxt(tmp_path / "o" / "trees.csv", delimiter=",", names=True, encoding="utf8")
    assert len(trees) == 4
    assert trees["z_m"] == pytest.approx(40 - np.tan(0.3) * (trees["x_m"] - 5), abs=1e-4)
    scene.write_text(scene.read_text().replace("site.blend", "gone.blend"))
    ended = headless("run", scene, "--out", tmp_path / "p", "--quiet")
    assert ended.returncode == 2
    assert "there is no such file" in ended.stderr


@pytest.mark.slow
def test_sensors_that_meet_nothing_are_reported_too(headless, tmp_path):
    """A field without trees or ground in reach: every picture is drawn, every file is written."""
    scene = tmp_path / "nothing.toml"
    scene.write_text(
        'seed = 1\n[[plantings]]\nspecies = "hazelnut"\nvariants = 1\nexpected = 0\n'
        '[[sensors]]\nkind = "terrestrial"\nposition = [0, 0, 50]\nelevation_deg = [10, 60]\n'
        'angle_step_deg = 10\n[[sensors]]\nkind = "tractor"\nposition = [0, 0, 50]\n'
        "angle_step_deg = 5\nstep = 1\nreach = 2\ntop = 60\n"
        '[[sensors]]\nkind = "sonar"\nposition = [0, 0, 50]\nmax_range = 4\n'
        '[[sensors]]\nkind = "reverb"\nsample_rate = 4000\nduration = 0.1\n'
        "[output]\nblend = false\nglb = false\npreview = false\n"
    )
    done = headless("run", scene, "--out", tmp_path / "out", "--quiet")
    assert done.returncode == 0, done.stderr
    with laspy.open(tmp_path / "out" / "cloud.laz") as cloud:
        assert cloud.header.point_count == 0
    for picture in ("cloud.png", "scan.png", "echo.png", "reverb.png"):
        assert (tmp_path / "out" / picture).stat().st_size > 5000
