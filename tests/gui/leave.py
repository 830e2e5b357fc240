"""Quitting Blender while a fine scan runs: how long the window takes to be gone (see run.py)."""

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import bpy
from drive import Scenario, Steps, open_tab, play, press, wait_for

OUT = Path(__file__).parent / "leave"


def idle() -> bool:
    from bl_ext.user_default.forest_sensing.forest_addon.ui.shell import running

    return running.current() is None


def scenario(steps: Steps) -> Scenario:
    steps.step("a fine scan is under way")
    yield from open_tab("Forest")
    press("forest.start", preset="demo", grow=True)
    yield 0.3
    yield from wait_for(
        lambda: "forest" in bpy.context.scene.forest_sensing.results and idle(), 120, "the forest"
    )
    bpy.data.objects["tripod"].forest_sensor.terrestrial.angle_step_deg = 0.02
    press("forest.run", sensor="tripod", sure=True)
    yield 4
    assert not idle()
    steps.end()
    print(f"LEAVING {time.time():.2f}", flush=True)
    bpy.ops.wm.quit_blender()
    yield 60


play(scenario, OUT)
