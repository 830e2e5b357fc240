"""While work goes on: bars at buttons that start it and in the status bar, Escape and Cancel, quitting.

Keys and clicks are real ones; how soon each stops a scan is a figure.
"""

import time

import bpy
from drive import (
    Ending,
    Scenario,
    Steps,
    choose,
    click,
    find_button,
    idle,
    key,
    middle,
    open_tab,
    press,
    props,
    running,
    settle,
    view,
    wait_for,
)

FINE = 0.03  # degrees between two beams: a scan that takes long enough to be stopped


def begin() -> Scenario:
    """Have a fine scan run."""
    press("forest.run", sensor="tripod", sure=True)
    yield from wait_for(lambda: running() is not None and running().left is not None, 60, "a time")
    yield 0.5


def stopped(what: str, ending: Ending) -> Scenario:
    yield from wait_for(lambda: ending.known and idle(), 60, "the end")
    print(f"FIGURE {what}: {ending.over:.2f} s, its thread {ending.ended:.2f} s", flush=True)
    assert "tripod" not in props().results
    yield 0.3


def middle_of(area: bpy.types.Area) -> tuple[int, int]:
    return area.x + area.width // 2, area.y + area.height // 2


def scenario(steps: Steps) -> Scenario:
    window, _, _, side = view()
    areas = {area.type: area for area in window.screen.areas}
    kinds = ("PROPERTIES", "OUTLINER", "DOPESHEET_EDITOR")
    properties, outliner, timeline = (areas[kind] for kind in kinds)

    steps.step("a forest by a click")
    bpy.context.preferences.system.viewport_aa = "8"  # as it comes: views are drawn eight times
    yield from open_tab("Forest")
    place = yield from find_button("forest.build()", 0.5)
    began = time.perf_counter()
    click(*place)
    yield from wait_for(lambda: not idle(), 10, "the click")
    yield from wait_for(idle, 120, "the forest")
    grown = time.perf_counter() - began
    yield from settle()
    drawn = time.perf_counter() - began
    print(f"FIGURE grown {grown:.1f} s after the click, drawn after {drawn:.1f} s", flush=True)
    assert bpy.context.preferences.system.viewport_aa == "8"
    bpy.context.preferences.system.viewport_aa = "FXAA"

    steps.step("bars in the sidebar, in Properties and in the status bar")
    scanner = bpy.data.objects["tripod"]
    scanner.forest_sensor.terrestrial.angle_step_deg = FINE
    choose(scanner)
    yield 0.5
    properties.spaces.active.context = "DATA"
    yield from begin()

    steps.step("Cancel at the Run button")
    place = yield from find_button("forest.cancel()", 0.83)
    ending = Ending(running())
    click(*place)
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

    steps.step("Escape wherever the mouse is")
    for what, place in {
        "the view": middle(),
        "the sidebar": (side.x + side.width // 2, side.y + 40),
        "Properties": middle_of(properties),
        "the Outliner": middle_of(outliner),
        "the timeline": middle_of(timeline),
    }.items():
        yield from begin()
        key("Escape", at=place)
        yield from stopped(f"Escape over {what}", Ending(running()))

    steps.step("quitting while a scan runs")
    scanner.forest_sensor.terrestrial.angle_step_deg = 0.02
    yield from begin()
    steps.end()
    print(f"LEAVING {time.time():.2f}", flush=True)
    bpy.ops.wm.quit_blender()
    yield 60
