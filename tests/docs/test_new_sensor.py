"""A new sensor is two files and a line in two tables: the one of docs/architecture.md runs everywhere."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("bpy")

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "architecture.md"
WALL = 7.25  # m from where the rangefinder stands
SCENE = """
[forest]
size = [10.0, 10.0]
[accuracy]
audit = 0.0
[output]
goodness = false
leaves = false
preview = false
blend = false
glb = false
[[sensors]]
kind = "rangefinder"
name = "down"
position = [5.0, 5.0, 7.25]
elevation_deg = -90.0
"""
PLAN = """
count = 1
licence = "CC0-1.0"
[scene.forest]
size = [8.0, 8.0]
[[scene.sensors]]
kind = "rangefinder"
name = "down"
elevation_deg = -90.0
[mix]
species = ["apple"]
kinds = [1, 1]
density = 0.001
variants = 1
[[place]]
sensor = "down"
rule = "centre"
height = 3.5
clear = 3.0
"""
DOORS = """
import json, sys
from pathlib import Path
import bpy, numpy as np
from forest_addon import api, ui
from headless.cli import main

assert main(["run", "scene.toml", "--out", "out", "--quiet"]) == 0
assert main(["dataset", "plan.toml", "--out", "data", "--quiet"]) == 0
told = {}
world = api.build(api.read(Path("scene.toml")))  # the Python API
found = world.look(world.scene.sensors[0])
told["api"] = [float(found.found[0]), found.summary()["distance"]]
told["saved"] = [found.save(f"r{end}").read_bytes()[:9].decode("latin1") for end in found.endings]

ui.register()  # the panel
try:
    scene = bpy.context.scene
    assert bpy.ops.forest.add_sensor(kind="rangefinder") == {"FINISHED"}
    thing = bpy.context.view_layer.objects.active
    thing.location, thing.rotation_euler = (5.0, 5.0, 7.25), (0.0, np.pi / 2, 0.0)
    bpy.context.view_layer.update()
    assert bpy.ops.forest.run(sensor=thing.name) == {"FINISHED"}
    result = scene.forest_sensing.results[thing.name]
    told["panel"] = {figure.name: figure.value for figure in result.figures}
    bpy.ops.forest.export_result(result=thing.name, filepath=str(Path("panel.csv").absolute()))
    told["exported"] = Path("panel.csv").read_text().split()
finally:
    ui.unregister()
Path("told.json").write_text(json.dumps(told))
"""


def blocks():
    """(path, code) of every block that names a file."""
    found = re.findall(r"^```python\n# (\S+)\n(.*?)^```", PAGE.read_text("utf-8"), re.M | re.S)
    assert len(found) == 4
    return found


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    """The program with the sensor added as the page says."""
    home = tmp_path_factory.mktemp("house")
    for name in ("forest_addon", "headless"):
        shutil.copytree(ROOT / name, home / name)  # bytecode, too: it takes seconds to make
    (home / "assets").symlink_to(ROOT / "assets")
    shutil.copy(ROOT / "pyproject.toml", home)
    shutil.copy(ROOT / "blender_manifest.toml", home)
    for path, code in blocks():
        file = home / path
        if file.exists():  # a table: lines more
            code = file.read_text("utf-8") + "\n" + code
        elif file.name == "kind.py":
            file.parent.mkdir()
            (file.parent / "__init__.py").write_text("")
        file.write_text(code, "utf-8")
    (home / "scene.toml").write_text(SCENE)
    (home / "plan.toml").write_text(PLAN)
    (home / "doors.py").write_text(DOORS)
    return home


@pytest.mark.slow
def test_commands_and_report_python_and_panel_and_datasets_have_it(house):
    ended = subprocess.run(
        [sys.executable, "doors.py"],
        cwd=house,
        env=os.environ | {"PYTHONPATH": str(house)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert distance_in(house / "out" / "down.npz") == pytest.approx([WALL])
    report = (house / "out" / "report.html").read_text("utf-8")
    assert "Laser rangefinder: down" in report
    assert "7.250 m" in report
    record = json.loads((house / "out" / "run.json").read_text("utf-8"))
    assert record["results"]["Laser rangefinder: down"] == {"distance": "7.250 m"}
    (file,) = (house / "data").rglob("down.npz")
    assert distance_in(file) == pytest.approx([3.5], abs=1e-6)
    told = json.loads((house / "told.json").read_text("utf-8"))
    assert told["api"] == [pytest.approx(WALL), "7.250 m"]
    assert told["saved"][0].startswith("PK")
    assert told["saved"][1] == "distance\n"
    assert told["panel"]["Distance"] == "7.250 m"
    assert told["exported"][0] == "distance"
    assert float(told["exported"][1]) == pytest.approx(WALL)


def test_the_page_is_as_short_as_it_says():
    code = [text for path, text in blocks() if not path.endswith("kinds.py")]
    assert sum(bool(line.strip()) for line in "\n".join(code).splitlines()) <= 32


def distance_in(file):
    with np.load(file) as found:
        return found["distance"].tolist()
