"""A large forest in a window: what views show of it, results that stay, clouds of a reopened file.

Runs in Blender's window (see run.py); the button that runs sensors again is found and clicked.
"""

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import bpy
from drive import (
    Scenario,
    Steps,
    click,
    find_button,
    open_tab,
    play,
    press,
    scroll,
    settle,
    view,
    wait_for,
)

OUT = Path(__file__).parent / "large"


def props():
    return bpy.context.scene.forest_sensing


def idle() -> bool:
    from bl_ext.user_default.forest_sensing.forest_addon.ui.shell import running

    return running.current() is None


def grown(seconds: float) -> Scenario:
    yield 0.3
    yield from wait_for(lambda: "forest" in props().results and idle(), seconds, "the forest")
    yield from settle()


def turn(what: str, seconds: float = 4) -> Scenario:
    """Turn the view for so long; says frames a second, and the CPU seconds of one.

    Without a graphics card all of Blender's window is drawn by the CPU, an empty one too.
    """
    frames, began, spent = 0, time.perf_counter(), time.process_time()
    while frames < 3 or time.perf_counter() - began < seconds:
        window, area, main, _ = view()
        with bpy.context.temp_override(window=window, area=area, region=main):
            bpy.ops.view3d.view_orbit(angle=0.1, type="ORBITLEFT")
        yield 0.0
        frames += 1
    rate, cost = frames / (time.perf_counter() - began), (time.process_time() - spent) / frames
    print(f"FIGURE {what}: {rate:.1f} frames/s, {cost:.2f} CPU s a frame", flush=True)


def grow_many(trees: int) -> Scenario:
    """Grow about so many trees, as dense in any number."""
    settings = props()
    settings.forest.size = [(14.4 * trees) ** 0.5] * 2
    settings.forest.spacing = 0.5
    for planting in settings.plantings:
        planting.use_expected, planting.expected, planting.exact = True, trees / 2 + 20, True
        planting.gaussians.clear()
    press("forest.build", frame=True)
    yield from grown(240)
    assert settings.display == "LIGHT"
    assert int(settings.results["forest"].figures["Trees"].value.replace(",", "")) > 0.9 * trees


def scenario(steps: Steps) -> Scenario:
    steps.step("an empty scene")
    yield from open_tab("Forest")
    yield from settle()
    yield from turn("an empty scene, solid view")

    steps.step("one click in the gallery grows a forest and keeps what is there")
    mine = set(bpy.context.scene.objects)
    press("forest.start", preset="demo", grow=True)
    yield from grown(120)
    assert mine <= set(bpy.context.scene.objects)

    steps.step("a thousand trees are shown by stand-ins")
    settings = props()
    yield from grow_many(1001)
    yield from turn("1,001 trees as stand-ins")

    steps.step("two thousand")
    yield from grow_many(2000)
    yield from turn("2,000 trees as stand-ins")

    steps.step("among them")
    area = view()[1]
    area.spaces.active.region_3d.view_distance = 25
    yield from settle()

    steps.step("as dots")
    settings.display = "DOTS"
    yield from settle()
    yield from turn("2,000 trees as dots")
    settings.display = "LIGHT"

    steps.step("a scan of full trees")
    bpy.data.objects["tripod"].forest_sensor.terrestrial.angle_step_deg = 1.0
    press("forest.run", sensor="tripod", sure=True)
    yield from wait_for(lambda: "tripod" in settings.results and idle(), 240, "a cloud")
    yield from settle()
    assert settings.display == "LIGHT"

    steps.step("results stay when the forest is grown anew")
    settings.seed += 1
    press("forest.build")
    yield from grown(240)
    result = settings.results["tripod"]
    assert result.stale
    assert len(bpy.data.objects[result.shown].data.vertices) > 100

    steps.step("one click runs them again")
    scroll(view()[3], 40)
    yield from settle()
    place = yield from find_button("forest.run(again=True", 0.9, 0.75)
    click(*place)
    yield from wait_for(lambda: not settings.results["tripod"].stale and idle(), 240, "the scan")
    yield from settle()

    steps.step("a cloud of a reopened file is exported")
    path = OUT / "forest.blend"
    path.parent.mkdir(exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    yield 2
    count = len(bpy.data.objects[props().results["tripod"].shown].data.vertices)
    press("forest.export_result", invoke=False, result="tripod", filepath=str(OUT / "again.ply"))
    assert f"element vertex {count}\n".encode() in (OUT / "again.ply").read_bytes()[:4000]
    path.unlink()


play(scenario, OUT)
