"""The mouse rests on every button of every sensor until its tooltip is drawn, with all parts of all panels
open for the last, which are then drawn so narrow that they are looked at page by page.

Blender forbids to write while it draws; a tooltip that does leaves a traceback in the log, which fails the
run.
"""

from collections.abc import Generator

import bpy
from drive import (
    Scenario,
    Steps,
    choose,
    command_at,
    demo_forest,
    drag_over,
    open_every_panel,
    ours,
    places_down,
    press,
    scroll,
    settle,
    view,
)

TOOLTIP = 1.0  # s until Blender has drawn one
COLUMNS = (0.3, 0.6, 0.8, 0.93)  # of the sidebar's width
NARROW = 180  # pixels
PAGES = 20  # of the sidebar, one above the other, at most
SENSORS = ("terrestrial", "drone", "mobile", "airborne", "tractor", "sonar", "reverb")


def hover(told: set[str]) -> Scenario:
    """Rest on each button of ours that the sidebar shows; told : commands whose tooltip was drawn already."""
    yield from settle()
    for place in places_down(COLUMNS):
        command = yield from command_at(*place)
        if command.startswith("bpy.ops.forest.") and command not in told:
            told.add(command)
            yield TOOLTIP


def hover_all() -> Generator[float, None, set[str]]:
    """Rest on all buttons of the sidebar, page by page; returns the commands whose tooltips were drawn."""
    told: set[str] = set()
    for _ in range(PAGES):
        yield from hover(told)
        if not (yield from turn_page(12)):
            break
    scroll(view()[3], -100)
    return told


def turn_page(notches: int) -> Generator[float, None, bool]:
    """Scroll down the sidebar; returns whether there was more of it."""
    side = view()[3]
    top = side.view2d.region_to_view(0, 0)
    scroll(side, notches)
    yield from settle()
    return side.view2d.region_to_view(0, 0) != top


def drag_edge(width: int) -> Scenario:
    """Drag the sidebar's edge until it is so wide."""
    side = view()[3]
    y, to = side.y + side.height // 3, side.x + side.width - width
    yield from drag_over([(x, y) for x in (side.x + 1, side.x + 5, (side.x + to) // 2, to)])


def blocks() -> int:
    """Counts of curves and objects in the file: a tooltip makes none."""
    return len(bpy.data.objects) + len(bpy.data.curves)


def hover_sensor(kind: str) -> Scenario:
    """Rest on all buttons while a sensor of this kind is chosen."""
    press("forest.add_sensor", invoke=False, kind=kind)
    choose(bpy.context.view_layer.objects.active)
    before = blocks()
    told = yield from hover_all()
    assert blocks() == before
    assert sum("forest.run" in command for command in told) >= 2, told
    print(f"FIGURE tooltips drawn of {kind}: {len(told)}", flush=True)
    press("forest.remove_sensor", invoke=False)


def scenario(steps: Steps) -> Scenario:
    steps.step("a forest")
    yield from demo_forest()
    for name in [one.name for one in ours("blender.sensors.objects").sensors_of(bpy.context.scene)]:
        choose(bpy.data.objects[name])
        press("forest.remove_sensor", invoke=False)
    for kind in SENSORS:
        steps.step(f"every button of a sensor: {kind}")
        yield from hover_sensor(kind)

    steps.step("every button of every part of a panel")
    bpy.ops.wm.read_homefile(use_empty=False, use_factory_startup=False)
    yield 1.0
    open_every_panel()
    yield from demo_forest()
    yield from hover_sensor("sonar")

    yield from drag_edge(NARROW)
    assert abs(view()[3].width - NARROW) < 5, view()[3].width
    for page in range(PAGES):
        steps.step(f"page {page} of the sidebar at {NARROW} pixels")
        yield from settle()
        if not (yield from turn_page(16)):
            break
