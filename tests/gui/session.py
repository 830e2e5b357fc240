"""What a newcomer does, from an empty Blender to results: runs in Blender's window (see run.py)."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import bpy
from drive import Scenario, Steps, open_tab, play, press

OUT = Path(__file__).parent


def newcomer(steps: Steps) -> Scenario:
    steps.step("open the tab")
    yield from open_tab("Forest")
    steps.step("build the forest")
    assert press("forest.build") == {"FINISHED"}
    yield 2
    assert bpy.context.scene.forest_sensing.results
    steps.step("scan all round")
    press("forest.sweep")
    yield 1


play(newcomer, OUT)
