"""The mouse rests on every button of every sensor until its tooltip is drawn, with all parts of all panels
open for the last, and a scene is copied in full.

Blender forbids to write while it draws; a tooltip that does leaves a traceback in the log, which fails the
run.
"""

from collections.abc import Generator

import bpy
from drive import (
    HOVER,
    ROW,
    Scenario,
    Steps,
    choose,
    demo_forest,
    idle,
    open_every_panel,
    ours,
    point_at,
    press,
    props,
    scroll,
    settle,
    view,
    wait_for,
)

TOOLTIP = 1.0  # s until Blender has drawn one
COLUMNS = (0.3, 0.6, 0.8, 0.93)  # of the sidebar's width
PAGES = 20  # of the sidebar, one above the other, at most
SENSORS = ("terrestrial", "drone", "mobile", "airborne", "tractor", "sonar", "reverb")


def hover(told: set[str]) -> Scenario:
    """Rest on each button of ours that the sidebar shows; told : commands whose tooltip was drawn already."""
    window, area, _, side = view()
    yield from settle()
    for column in COLUMNS:
        x = side.x + int(column * side.width)
        for y in range(side.y + side.height - 8, side.y, -ROW):
            point_at(x, y)
            yield HOVER
            yield 0
            with bpy.context.temp_override(window=window, area=area, region=side):
                if not bpy.ops.ui.copy_python_command_button.poll():
                    continue
                bpy.ops.ui.copy_python_command_button()
            command = bpy.context.window_manager.clipboard
            if command.startswith("bpy.ops.forest.") and command not in told:
                told.add(command)
                yield TOOLTIP


def hover_all() -> Generator[float, None, set[str]]:
    """Rest on all buttons of the sidebar, page by page; returns the commands whose tooltips were drawn."""
    told: set[str] = set()
    for _ in range(PAGES):
        yield from hover(told)
        side = view()[3]
        top = side.view2d.region_to_view(0, 0)
        scroll(side, 12)
        yield from settle()
        if side.view2d.region_to_view(0, 0) == top:
            break
    scroll(view()[3], -100)
    return told


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

    steps.step("a full copy is a copy: growing in it moves nothing of the first")
    first = bpy.context.scene
    stood = {obj.name for obj in first.objects if "forest_tree" in obj}
    press("scene.new", invoke=False, type="FULL_COPY")
    yield from settle()
    press("forest.build")
    yield 0.3
    yield from wait_for(idle, 120, "the forest of the copy")
    assert bpy.context.scene != first
    copied = [obj for obj in bpy.context.scene.objects if "forest_tree" in obj]
    assert len(copied) == len(stood) == sum(p.standing for p in props().plantings)
    assert {obj.name for obj in first.objects if "forest_tree" in obj} == stood

    steps.step("every button of every part of a panel")
    bpy.ops.wm.read_homefile(use_empty=False, use_factory_startup=False)
    yield 1.0
    open_every_panel()
    yield from demo_forest()
    yield from hover_sensor("sonar")
