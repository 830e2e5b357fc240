"""Thousands of scenes in a process: no run leaves anything behind, neither in Blender nor in Python.

Counts are exact: after the first runs, which fill what is kept on purpose, a further run of the same scene
adds no block of Blender's and no object of ours. Arrays are not counted by Python's collector, so what
memory they hold is measured: the process after the allocator gave back what it keeps for itself.
"""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("bpy")


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
