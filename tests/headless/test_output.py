"""What ``[output]`` switches off is neither made nor paid for; all else stays as it is."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("bpy")

from forest_addon.formats.ownership import RECORD

ROOT = Path(__file__).resolve().parents[2]
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
    assert headless("run", scene, "--out", tmp_path / "all").returncode == 0
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
    assert headless("run", scene, "--out", tmp_path / "out").returncode == 0
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert "L function" in record["results"]["Where the trees stand"]
    assert not list((tmp_path / "out").glob("*.png"))
    assert "<img" not in (tmp_path / "out" / "report.html").read_text()
