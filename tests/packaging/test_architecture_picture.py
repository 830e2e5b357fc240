"""The picture in docs/architecture.md shows the code as it is."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def drawing():
    file = ROOT / "packaging" / "draw_architecture.py"
    spec = importlib.util.spec_from_file_location("draw_architecture", file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def project(drawing):
    """Which box imports from which: every file is read."""
    return drawing.project_arrows()


@pytest.mark.slow
def test_the_picture_is_current(drawing, project):
    with Image.open(drawing.PICTURE) as image:
        shown = json.loads(image.info[drawing.SHOWN])
    assert shown == drawing.shown_of(project), "run: make architecture"


def reachable(arrows, start):
    found, pending = {start}, [start]
    while pending:
        here = pending.pop()
        for a, b in arrows:
            if a == here and b not in found:
                found.add(b)
                pending.append(b)
    return found


LOADS = """
import importlib, sys
for module in sys.argv[1:]:
    importlib.import_module(f"forest_addon.{module}")
    ours = [name for name in sys.modules if name.startswith("forest_addon.")]
    print(*ours)
    for name in ours:  # the next finds none of ours there
        del sys.modules[name]
"""


@pytest.mark.slow
def test_what_python_really_loads_is_below_in_the_picture(drawing, project):
    """The arrows are read from the text; here Python says what an import brought in."""
    modules = ["sensing.lidar.scan", "sensing.reverb.response", "stand.plan", "results.kinds"]
    words = [sys.executable, "-c", LOADS, *modules]
    loaded = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True)
    wings = [(wing, wing.split("/")[0]) for wing in drawing.WINGS]  # a package loads its own file
    for module, names in zip(modules, loaded.stdout.splitlines(), strict=True):
        boxes = {drawing.box_of(name) for name in names.split()}
        assert len(boxes) > 2
        assert boxes <= reachable(project + wings, drawing.box_of(f"forest_addon.{module}"))


def test_arrows_that_follow_are_left_out(drawing):
    arrows = [("ui", "blender"), ("blender", "spec"), ("ui", "spec"), ("ui", "sensing/lidar")]
    arrows += [("sensing/lidar", "spec"), ("blender", "sensing/lidar")]
    expected = [("blender", "sensing"), ("sensing", "spec"), ("ui", "blender")]
    assert drawing.reduced(arrows) == expected


@pytest.mark.medium
def test_every_arrow_drawn_has_its_boxes(drawing, project):
    rooms = {room for _, row in drawing.ROWS for room in row}
    for arrow in drawing.reduced(project):
        for box in arrow:
            assert box in rooms or box in drawing.WINGS, f"{box} has no place in the picture"
