"""While work goes on: bars at every button that starts it and in the status bar, Escape and Cancel, times.

Runs in Blender's window (see run.py). Keys and clicks are real ones; how soon each stops a scan is a figure.
"""

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import bpy
from drive import (
    Ending,
    Scenario,
    Steps,
    click,
    find_button,
    key,
    open_tab,
    play,
    press,
    settle,
    view,
    wait_for,
)

OUT = Path(__file__).parent / "working"
FINE = 0.03  # degrees between two beams: a scan that takes long enough to be stopped


def props():
    return bpy.context.scene.forest_sensing


def running():
    from bl_ext.user_default.forest_sensing.forest_addon.ui.shell import running

    return running.current()


def grow() -> Scenario:
    """Grow by a click on the button; returns when all is drawn."""
    place = yield from find_button("forest.build()", 0.5)
    began = time.perf_counter()
    click(*place)
    yield from wait_for(lambda: running() is not None, 10, "the click")
    yield from wait_for(lambda: running() is None, 120, "the forest")
    grown = time.perf_counter() - began
    yield from settle()
    print(
        f"FIGURE grown {grown:.1f} s after the click, drawn after {time.perf_counter() - began:.1f} s"
    )


def begin() -> Scenario:
    """Have a fine scan run."""
    press("forest.run", sensor="tripod", sure=True)
    yield from wait_for(lambda: running() is not None and running().left is not None, 60, "a time")
    yield 0.5


def stopped(what: str, ending: Ending) -> Scenario:
    yield from wait_for(lambda: ending.known and running() is None, 60, "the end")
    print(f"FIGURE {what}: {ending.over:.2f} s, its thread {ending.ended:.2f} s", flush=True)
    assert "tripod" not in props().results
    yield 0.3


def editors() -> tuple[bpy.types.Area, ...]:
    kinds = ("PROPERTIES", "OUTLINER", "DOPESHEET_EDITOR")
    areas = bpy.context.window_manager.windows[0].screen.areas
    return tuple(next(area for area in areas if area.type == kind) for kind in kinds)


def middle_of(area: bpy.types.Area) -> tuple[int, int]:
    return area.x + area.width // 2, area.y + area.height // 2


def scenario(steps: Steps) -> Scenario:
    window, area, main, side = view()
    properties, outliner, timeline = editors()

    steps.step("a forest by a click")
    bpy.context.preferences.system.viewport_aa = "8"  # as it comes: views are drawn eight times
    yield from open_tab("Forest")
    yield from grow()

    steps.step("and another at once")
    props().seed += 1
    yield from grow()
    assert bpy.context.preferences.system.viewport_aa == "8"
    bpy.context.preferences.system.viewport_aa = "FXAA"

    steps.step("bars in the sidebar, in Properties and in the status bar")
    scanner = bpy.data.objects["tripod"]
    scanner.forest_sensor.terrestrial.angle_step_deg = FINE
    with bpy.context.temp_override(window=window, area=area, region=main):
        bpy.ops.object.select_all(action="DESELECT")
    scanner.select_set(True)
    bpy.context.view_layer.objects.active = scanner
    yield 0.5
    properties.spaces.active.context = "DATA"
    yield from begin()

    steps.step("Cancel at the Run button")
    found = yield from find_button("forest.cancel()", 0.83)
    ending = Ending(running())
    click(*found)
    yield from stopped("Cancel beside a button", ending)

    steps.step("Cancel in the status bar")
    yield from begin()
    ending = Ending(running())
    for x in range(60, 700, 12):
        if running() is None or running().over:
            break
        click(x, 10)
        yield 0.3
    yield from stopped("Cancel in the status bar, found by looking", ending)

    for number, (what, place) in enumerate(
        {
            "over the view": (main.x + main.width // 3, main.y + main.height // 2),
            "over the sidebar": (side.x + side.width // 2, side.y + 40),
            "over Properties": middle_of(properties),
            "over the Outliner": middle_of(outliner),
            "over the timeline": middle_of(timeline),
        }.items()
    ):
        if not number:
            steps.step("Escape wherever the mouse is")
        yield from begin()
        key("Escape", at=place)
        ending = Ending(running())
        yield from stopped(f"Escape {what}", ending)

    steps.step("times of all that ran")
    scanner.forest_sensor.terrestrial.angle_step_deg = 1.0
    place = yield from find_button("forest.run(frames=", 0.65)
    click(*place)
    names = {"tractor", "tripod", "bat", "clap"}
    yield from wait_for(
        lambda: names <= set(props().results.keys()) and running() is None, 240, "all results"
    )
    for name in names:
        assert "estimated" in props().results[name].figures["Time"].value, name
    yield from settle()


play(scenario, OUT)
