"""What a newcomer does, from an empty Blender to results: runs in Blender's window (see run.py)."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import bpy
from drive import Scenario, Steps, key, open_tab, play, press, wait_for

OUT = Path(__file__).parent


def done(name: str) -> bool:
    return name in bpy.context.scene.forest_sensing.results


def newcomer(steps: Steps) -> Scenario:
    steps.step("open the tab")
    yield from open_tab("Forest")
    steps.step("a build is under way")
    assert press("forest.build") == {"RUNNING_MODAL"}
    yield 0.4
    steps.step("build the forest")
    yield from wait_for(lambda: done("forest"), 60, "the forest")
    yield 0.5
    steps.step("a scan is under way")
    press("forest.run", sensor="cloud")
    yield 2
    steps.step("cancel the scan with Escape")
    key("Escape")
    yield 1
    from bl_ext.user_default.forest_sensing.forest_addon.ui import running

    yield from wait_for(lambda: running.current() is None, 5, "the end of the scan")
    assert not done("cloud")
    steps.step("scan all round")
    press("forest.run", sensor="cloud")
    yield from wait_for(lambda: done("cloud"), 120, "the scan")
    yield 1
    for name in ("echo", "reverb"):
        steps.step(f"run {name}")
        press("forest.run", sensor=name)
        yield from wait_for(lambda name=name: done(name), 120, name)
        yield 1


play(newcomer, OUT)
