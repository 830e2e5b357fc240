"""All or nothing: what the add-on registers, and that nothing of it stays."""

import importlib
import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import ui

ROOT = Path(__file__).resolve().parents[2]


def ours():
    """What Blender knows of us."""
    found = {
        cls.__name__
        for base in (bpy.types.PropertyGroup, bpy.types.Operator, bpy.types.Panel, bpy.types.UIList)
        for cls in base.__subclasses__()
        if cls.__name__.startswith("FOREST_") and getattr(cls, "is_registered", False)
    }
    found |= {name for name in dir(bpy.types) if name.startswith("FOREST_")}
    if hasattr(bpy.types.Scene, "forest_sensing"):
        found.add("Scene.forest_sensing")
    return found


@pytest.mark.parametrize("scenario", sorted((ROOT / "tests" / "gui").glob("*.py")), ids=str)
def test_scenarios_of_the_window_name_what_is_there(scenario):
    """Most of them are played by hand alone."""
    for room, name in re.findall(r'ours\("([^"]+)"\)\.(\w+)', scenario.read_text("utf-8")):
        assert hasattr(importlib.import_module(f"forest_addon.{room}"), name), (room, name)


@pytest.fixture
def unregistered(registered):
    """The add-on taken back for one test, and registered again after it."""
    ui.unregister()
    yield
    ui.register()


def test_unregistering_leaves_nothing(unregistered):
    assert ours() == set()
    ui.register()
    assert {"Scene.forest_sensing", "FOREST_PT_forest", "FOREST_PG_scene"} <= ours()
    assert hasattr(bpy.context.scene, "forest_sensing")
    ui.unregister()
    assert ours() == set()
    assert not hasattr(bpy.context.scene, "forest_sensing")


def test_again_and_again(unregistered):
    for _ in range(3):
        ui.register()
        ui.unregister()
    assert ours() == set()


def test_registering_twice_is_refused_and_changes_nothing(registered):
    before = ours()
    with pytest.raises(ValueError, match="already registered"):
        ui.register()
    assert ours() == before


@pytest.mark.parametrize("position", [0, 9, -1])
def test_a_class_that_fails_takes_back_those_before_it(unregistered, monkeypatch, position):
    class Broken(bpy.types.Panel):
        """No space type: Blender refuses it."""

    classes = list(ui._classes())
    classes.insert(position, Broken)
    monkeypatch.setattr(ui, "_classes", lambda: tuple(classes))
    with pytest.raises((RuntimeError, ValueError, AttributeError)):
        ui.register()
    assert ours() == set()
    monkeypatch.undo()


IMPORTED = """
import atexit, sys
import bpy
before = set(sys.modules)
import forest_addon
atexit.register(forest_addon.unregister)
forest_addon.register()
new = {name.split(".")[0] for name in set(sys.modules) - before}
heavy = new & {"scipy", "laspy", "lazrs", "cattrs", "matplotlib", "tqdm"}
rooms = {n for n in sys.modules if n.startswith("forest_addon.")}
rooms = {r for r in rooms if r.split(".")[1] not in ("base", "ui", "spec", "blender")}
records = {"kind", "kinds", "look", "looks", "cost", "audit", "lines"}  # of sensors: light
records |= {"emptiness", "sensing", "lidar", "sonar", "reverb", "rays", "boxes"}
records |= {"geometry", "caster", "table", "exact"}
print(sorted(heavy), sorted(r for r in rooms if not set(r.split(".")[1:]) <= records))
"""


@pytest.mark.slow
def test_enabling_imports_nothing_heavy():
    run = subprocess.run(
        [sys.executable, "-c", IMPORTED], cwd=ROOT, capture_output=True, text=True, timeout=300
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.strip().splitlines()[-1] == "[] []"


WITHOUT_SCIPY = """
import atexit, importlib.util
import bpy

find = importlib.util.find_spec
importlib.util.find_spec = lambda name: None if name == "scipy" else find(name)
import forest_addon
atexit.register(forest_addon.unregister)
forest_addon.register()
from forest_addon.ui.shell import running
print(running.missing())
try:
    bpy.ops.forest.build()
except RuntimeError as problem:
    print(problem)
"""


@pytest.mark.slow
def test_enables_without_scipy_and_says_what_is_missing():
    run = subprocess.run(
        [sys.executable, "-c", WITHOUT_SCIPY], cwd=ROOT, capture_output=True, text=True, timeout=300
    )
    assert run.returncode == 0, run.stderr
    assert "('scipy',)" in run.stdout
    assert "scipy is missing in this Blender" in run.stdout


@pytest.mark.parametrize("file", sorted((ROOT / "forest_addon" / "ui").rglob("*.py")), ids=str)
def test_what_work_imports_first_is_there(file):
    """It is named by text."""
    for call in re.findall(r"getting_ready\(([^)]*)\)", file.read_text("utf-8")):
        for room in re.findall(r'"([\w.]+)"', call):
            assert importlib.util.find_spec(f"forest_addon.{room}"), room
