"""`headless run` of a field in tiles by workers, what is lost meanwhile, and what a sample says of it."""

import dataclasses
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import laspy
import numpy as np
import pytest

pytest.importorskip("bpy")

from forest_addon import api as forest
from forest_addon.formats.toml_file import read_settings
from headless.cli import main
from headless.dataset.engine import SceneOutcome, Worker
from headless.dataset.settings import Running
from headless.tiled import TileJob

FIELD = """
seed = 3

[forest]
size = [60, 60]

[forest.terrain]
file = "ground.npy"

[tiles]
size = 30
buffer = 10

[[plantings]]
species = "abop-monopodial-a"
variants = 1
expected = 20
exact = true

[[sensors]]
kind = "airborne"
name = "als"
position = [0, 30, 60]
track = 60
pulse_rate = 1000
"""


@pytest.fixture
def field(tmp_path):
    (tmp_path / "field.toml").write_text(FIELD)
    np.save(tmp_path / "ground.npy", np.full((3, 3), 2.0))
    return tmp_path / "field.toml"


def run(field, out, *more):
    folder = field.with_name(out)
    assert main(["run", str(field), "--out", str(folder), "--quiet", *more]) == 0
    return folder


@pytest.mark.slow
def test_workers_of_which_one_lost_a_piece_make_the_same_bytes(field, empty_blender, capsys):
    whole = run(field, "whole")
    parts = field.with_name("parts")
    # As if the command had been killed when it had one piece, and a worker in the middle of another.
    tiling = forest.Tiling.of(read_settings(field, forest.Scene), field.parent)
    scan = forest.TiledScan(tiling, tiling.site.scene.sensors[0], parts / "tiles")
    scan.make(int(scan.todo(False)[0]))
    (parts / "tiles" / ".als-1-1-0.1.partial.rows").write_bytes(b"half")
    run(field, "parts", "--resume", "--workers", "2")
    names = ["als.laz", "leaf_angles.csv", "tiles.csv", "trees.csv"]
    for folder in (whole, parts):
        written = sorted(file.name for file in folder.glob("[!.]*.*"))
        assert written == [*names[:2], "run.json", *names[2:]]
        assert not list(folder.glob("tiles/*.[rnp]*z"))
    for name in names:
        assert (parts / name).read_bytes() == (whole / name).read_bytes(), name
    (audit,) = json.loads((parts / "run.json").read_text())["sensors"]["als"]["audits"].values()
    assert audit["kept"]
    assert audit["checks"][0]["what"] == "figures computed again"
    before = (whole / "als.laz").stat().st_mtime_ns
    assert main(["run", str(field), "--out", str(whole), "--resume"]) == 0
    assert "ground.npy is an image or array without a place: heights" in str(capsys.readouterr())
    assert (whole / "als.laz").stat().st_mtime_ns == before


@pytest.mark.slow
def test_shares_that_are_joined_make_the_same_bytes(field, empty_blender):
    whole = (run(field, "whole") / "als.laz").read_bytes()
    for share in ("1/2", "2/2"):
        assert not (run(field, "parts", "--share", share) / "als.laz").exists()
    assert (run(field, "parts", "--resume") / "als.laz").read_bytes() == whole
    for wrong in ("3", "0/2", "3/2", "a/b"):
        with pytest.raises(SystemExit):
            main(["run", str(field), "--share", wrong])


@pytest.mark.slow
def test_a_tile_in_smaller_scenes_is_the_same(field, tmp_path, empty_blender):
    tiling = forest.Tiling.of(read_settings(field, forest.Scene), field.parent)
    scan = forest.TiledScan(tiling, tiling.site.scene.sensors[0], tmp_path)
    points = 0
    for piece in scan.todo(False):
        scan.make(piece)
        at_once = scan.path(piece).read_bytes()
        points += len(at_once) > 8
        scan.make(piece, cuts=3)
        assert scan.path(piece).read_bytes() == at_once
    assert points


def test_a_tile_that_needs_too_much_memory_is_cut_and_that_is_said(field, monkeypatch):
    scene = read_settings(field, forest.Scene)
    job = TileJob(scene, field.parent, field.parent, 32, ("als",), Running(), 1e9, 1)
    asked = []

    def once(self, job):
        asked.append(job.cuts)
        enough = job.cuts > 2
        why = "" if enough else "needs more memory than it may have (1.0 GB)"
        return SceneOutcome("done" if enough else "memory", why, scene=job.number)

    monkeypatch.setattr(Worker, "once", once)
    found = Worker().make(job)
    assert asked == [1, 2, 4]
    assert (found.kind, found.why) == (
        "done",
        "tile 1-0 needs more memory than it may have (1.0 GB): it is cut",
    )
    monkeypatch.setattr(Worker, "once", lambda self, job: SceneOutcome("memory", "needs more"))
    assert Worker().make(dataclasses.replace(job, cuts=8)).kind == "memory"


@pytest.mark.slow
@pytest.mark.skipif(not os.environ.get("FOREST_LONG_TESTS"), reason="0.6 GB, 12 s of CPU")
def test_a_worker_that_is_short_of_memory_makes_the_same_tile_in_parts(tmp_path):
    """With FOREST_LONG_TESTS set: 160,000 trees in one tile; the limit lies between whole and parts."""
    planting = forest.Planting(species="abop-monopodial-a", variants=1, density=4.0)
    scene = forest.Scene(
        seed=3,
        forest=forest.Forest(size=(200.0, 200.0), undergrowth="none"),
        tiles=forest.Tiles(size=200.0, buffer=5.0),
        plantings=(planting,),
        sensors=(
            forest.Airborne(name="als", position=(0, 100, 60), track=200.0, pulse_rate=200.0),
        ),
    )
    (tmp_path / "tiles").mkdir()
    job = TileJob(scene, tmp_path, tmp_path, 0, ("als",), Running(), 1e12, 1)
    worker, peaks, made = Worker(), [], []
    for one in (job, dataclasses.replace(job, cuts=2), None):
        limited = dataclasses.replace(job, memory=sum(peaks) / 2)
        outcome = worker.make(limited if one is None else one)
        worker.end()
        peaks.append(outcome.peak)
        made.append((tmp_path / "tiles" / "als-0-0-0.rows").read_bytes())
        (tmp_path / "tiles" / "als-0-0-0.json").unlink()
    assert outcome.kind == "done"
    assert outcome.why.endswith("it is cut")
    assert peaks[2] < peaks[0]
    assert len(set(made)) == 1


@pytest.mark.slow
def test_a_sample_of_all_tiles_tells_the_whole(field, empty_blender, capsys, warm, monkeypatch):
    warm.lend(monkeypatch)
    words = ["--sample", "100%", "--workers", "1", "--quiet", "--json"]
    assert main(["tiles", str(field), *words]) == 0
    found = json.loads(capsys.readouterr().out)
    points = len(laspy.read(run(field, "o") / "als.laz").points)
    assert found["scanned"] == found["tiles"] == 4
    assert found["points"] == [points] * 3  # nothing is left to chance
    assert main(["tiles", str(field), "--sample", "50%", *words[2:]]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["scanned"] == 2
    assert found["points"][1] <= points <= found["points"][2]


def test_what_has_no_scanner_is_not_sampled(field, empty_blender):
    field.write_text(FIELD.replace('kind = "airborne"', 'kind = "sonar"').partition("position")[0])
    assert main(["tiles", str(field), "--quiet"]) == 2


# ------------------------------------------------------------------------------------------- memory
# Thousands of scenes in a process: no run leaves anything behind, neither in Blender nor in Python.
#
# Counts are exact: after the first runs, which fill what is kept on purpose, a further run of the same
# scene adds no block of Blender's and no object of ours. Arrays are not counted by Python's collector, so
# what memory they hold is measured: the process after the allocator gave back what it keeps for itself.

ROOT = Path(__file__).resolve().parents[2]
FIRST, RUNS = 2, 4
LIMIT = 1.0  # MB a run
SCENE = """
[forest]
size = [10, 10]
[[plantings]]
species = "whorl-8"
variants = 1
expected = 1
exact = true
[[sensors]]
kind = "terrestrial"
name = "cloud"
position = [5, 5, 1.6]
angle_step_deg = 12
[[sensors]]
kind = "sonar"
name = "echo"
position = [0, 0, 1]
azimuth_deg = 45
beam_width_deg = [60, 60]
max_range = 4
cull = 0.1
[[sensors]]
kind = "reverb"
name = "reverb"
source = [1, 5, 0.5]
receiver = [9, 5, 0.5]
sample_rate = 4000
duration = 0.05
[output]
blend = false
glb = false
preview = false
pictures = false
goodness = false
"""
CODE = """
import collections, ctypes, gc, json, sys
from pathlib import Path
import bpy
from headless.command import read_scene
from headless.pipeline import run_scene

def resident():
    gc.collect()
    ctypes.CDLL("libc.so.6").malloc_trim(0)
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6

def alive():
    ours = (type(thing) for thing in gc.get_objects())
    counts = collections.Counter(
        f"{kind.__module__}.{kind.__name__}" for kind in ours
        if str(kind.__module__).startswith(("forest_addon", "headless"))
    )
    for name in dir(bpy.data):
        if isinstance(found := getattr(bpy.data, name), bpy.types.bpy_prop_collection):
            counts["bpy.data." + name] = len(found)
    return counts

scene, first, runs = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
memory, things = [], []
for _ in range(runs):
    run_scene(read_scene(scene, 1), scene.parent, scene.parent / "out", quiet=True)
    memory.append(resident())
    things.append(alive())
grown = {name: [count, things[-1][name]] for name, count in things[first - 1].items()}
grown |= {name: [0, count] for name, count in things[-1].items() if name not in grown}
print(json.dumps({"memory": memory, "grown": {k: v for k, v in grown.items() if v[1] > v[0]}}))
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc, and asks glibc to give back")
def test_runs_in_one_process_keep_nothing(tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE)
    words = [sys.executable, "-c", CODE, str(scene), str(FIRST), str(RUNS)]
    ended = subprocess.run(words, cwd=ROOT, check=True, capture_output=True, text=True)
    told = json.loads(ended.stdout.splitlines()[-1])
    assert not told["grown"]
    a_run = (told["memory"][-1] - told["memory"][FIRST - 1]) / (RUNS - FIRST)
    assert a_run < LIMIT, told["memory"]


# ----------------------------------------------------------------------------------------- interrupt
# Ctrl-C at any moment, also while modules are imported: one line, exit code 130.

SCAN = """
[[plantings]]
species = "whorl-8"
variants = 1
expected = 1
exact = true
[[sensors]]
kind = "terrestrial"
angle_step_deg = 10
[output]
pictures = false
"""
WHEN = """
import os, runpy, sys

class Finger:
    def find_spec(self, name, path=None, target=None):
        if name == {moment!r}:
            os.kill(os.getpid(), 2)

sys.meta_path.insert(0, Finger())
sys.argv = ["headless", "run", {scene!r}, "--out", {out!r}]
runpy.run_module("headless", run_name="__main__", alter_sys=True)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "moment",
    [
        *("signal", "headless.cli", "cattrs", "bpy", "numpy._core.multiarray", "laspy"),
    ],
)
def test_ctrl_c_during_an_import(tmp_path, moment):
    text = WHEN.format(moment=moment, scene=str(tmp_path / "s.toml"), out=str(tmp_path / "o"))
    (tmp_path / "s.toml").write_text(SCAN)
    done = subprocess.run(
        [sys.executable, "-c", text],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    lines = (done.stdout + done.stderr).split("\n")
    if moment == "signal":  # the first of all
        assert (done.returncode, lines) == (-signal.SIGINT, [""])
        return
    assert done.returncode == 130, done.stderr
    assert [line for line in lines if line.startswith("interrupted; ")], lines
    assert not [line for line in lines if "Traceback" in line or "Error" in line], lines
    assert not list(tmp_path.glob("o/.*partial*"))
