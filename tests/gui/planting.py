"""Plant by hand in a window: trees are clicked, painted, cleared, moved and kept, with a real mouse."""

import subprocess
import time

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from drive import (
    Scenario,
    Steps,
    choose,
    click,
    demo_forest,
    idle,
    in_view,
    key,
    middle,
    open_every_panel,
    ours,
    point_at,
    press,
    props,
    results,
    scroll,
    seek,
    settle,
    view,
    wait_for,
)
from mathutils import Euler, Vector


def on_screen(x: float, y: float) -> tuple[int, int]:
    """Where a place on the ground is in the window."""
    _, area, main, _ = view()
    found = location_3d_to_region_2d(main, area.spaces.active.region_3d, Vector((x, y, 0)))
    return round(main.x + found.x), round(main.y + found.y)


def drag(places: list[tuple[float, float]], held: str = "") -> Scenario:
    """Drag the left button over places on the ground, a key held if one is named.

    The window is given time at each: Blender takes the place of a press from where the mouse is by then.
    """
    if held:
        subprocess.run(["xdotool", "keydown", held], check=True)
    for number, place in enumerate(places):
        point_at(*on_screen(*place))
        yield from settle()
        if not number:
            subprocess.run(["xdotool", "mousedown", "1"], check=True)
            yield from settle()
    subprocess.run(["xdotool", "mouseup", "1"], check=True)
    yield from settle()
    if held:
        subprocess.run(["xdotool", "keyup", held], check=True)


def trees() -> list:
    return ours("blender.scene.stood").stood_trees(bpy.context.scene)


def nearest(x: float, y: float):
    return min(trees(), key=lambda tree: np.hypot(tree.place[0] - x, tree.place[1] - y))


def near(x: float, y: float, radius: float) -> int:
    """How many trees stand on a disc."""
    return sum((t.place[0] - x) ** 2 + (t.place[1] - y) ** 2 <= radius**2 + 1e-3 for t in trees())


def from_the_browser(steps: Steps, maple) -> Scenario:
    """Drag a thumbnail onto the ground, then plant a copy by the button in the sidebar."""
    steps.step("a thumbnail dragged from the Asset Browser is planted where it is dropped")
    browser = next(area for area in view()[0].screen.areas if area.type == "PROPERTIES")
    browser.ui_type = "ASSETS"
    yield from settle()
    shown = browser.spaces.active
    shown.show_region_toolbar = shown.show_region_ui = False
    shown.params.asset_library_reference = "LOCAL"
    yield from settle()
    yield 2
    before, count, wanted = len(trees()), len(maple.by_hand), (30.0, 1.0)
    place = on_screen(*wanted)
    start = browser.x + 50, browser.y + browser.height - 75
    point_at(*start)
    yield from settle()
    subprocess.run(["xdotool", "mousedown", "1"], check=True)
    for at in ((start[0] - 20, start[1] - 10), (start[0] - 60, start[1] - 30), place, place):
        yield from settle()
        point_at(*at)
    yield from settle()
    subprocess.run(["xdotool", "mouseup", "1"], check=True)
    yield from wait_for(lambda: len(props().plantings[0].by_hand) == count + 1, 20, "the tree")
    yield from wait_for(lambda: len(trees()) == before + 1 and idle(), 60, "the forest with it")
    x, y = props().plantings[0].by_hand[count].position
    assert np.hypot(x - wanted[0], y - wanted[1]) < 0.5, (x, y)
    yield from settle()

    steps.step("Plant Copies plants a copy that was put beside")
    one = next(t.thing for t in trees() if t.thing is not None and t.label == "maple")
    choose(one)
    in_view(bpy.ops.object.duplicate, linked=True)
    bpy.context.view_layer.objects.active.location[:2] = 33.0, 3.0
    yield from settle()
    button = None
    for _ in range(8):  # all panels are open: it is far down
        button = button or (yield from seek("forest.adopt_trees", 0.5))
        if button is None:
            scroll(view()[3], 10)
            yield from settle()
    assert button is not None
    click(*button)
    yield from wait_for(lambda: len(props().plantings[0].by_hand) == count + 2, 20, "the copy")
    yield from wait_for(lambda: near(33, 3, 0.01) == 1 and idle(), 60, "the forest with it")
    yield from settle()


def scenario(steps: Steps) -> Scenario:
    steps.step("a forest, seen from above")
    open_every_panel()
    yield from demo_forest()
    eye = view()[1].spaces.active.region_3d
    eye.view_rotation = Euler((0.5, 0.0, 0.0)).to_quaternion()
    eye.view_location, eye.view_distance = (22.0, 18.0, 0.0), 75.0
    yield from settle()
    maple = props().plantings[0]

    steps.step("the brush is in hand")
    assert press("forest.plant") == {"RUNNING_MODAL"}
    yield from settle()
    is_planting = ours("ui.forest.planting").is_planting
    assert is_planting()

    steps.step("a click sets a tree where it points")
    before = len(trees())
    click(*on_screen(3.0, 33.0))
    yield from wait_for(lambda: len(maple.by_hand) == 1, 10, "a tree set by hand")
    x, y = maple.by_hand[0].position
    assert max(abs(x - 3), abs(y - 33)) < 0.3, (x, y)
    yield from wait_for(lambda: near(x, y, 0.01) == 1 and idle(), 60, "the tree that was set")
    print(f"FIGURE a click among {before} trees: {props().results['forest'].figures['Time'].value}")
    yield from settle()

    steps.step("a drag fills a field")
    props().plant_radius, props().plant_density = 4.0, 0.15
    yield from drag([(24.0 + k, -4.0) for k in range(0, 16, 4)])
    yield from wait_for(lambda: len(maple.by_hand) > 8, 20, "trees of a drag")
    yield from wait_for(lambda: near(31, -4, 12) >= 8 and idle(), 60, "the field that was planted")
    yield from settle()

    steps.step("a drag with Ctrl clears")
    count = near(14, 14, 4)
    assert count
    yield from drag([(12.0 + k, 14.0) for k in range(0, 5, 2)], held="ctrl")
    yield from wait_for(lambda: len(maple.clearings) > 0, 20, "a clearing")
    yield from wait_for(lambda: near(14, 14, 4) == 0 and idle(), 60, "no tree there")
    yield from settle()

    steps.step("a drag with Shift moves one tree")
    one = nearest(3, 33)
    yield from drag([one.place, (0.0, 36.0), (-4.0, 38.0)], held="shift")
    yield from wait_for(lambda: near(-4, 38, 0.5) == 1 and idle(), 60, "the tree that was moved")
    assert near(*one.place, 0.1) == 0
    yield from settle()

    steps.step("Ctrl Z takes the last stroke back")
    point_at(*on_screen(20.0, 20.0))
    yield 0.3
    key("ctrl+z")
    yield from wait_for(lambda: near(3, 33, 0.5) == 1 and idle(), 60, "the tree where it was")
    yield from settle()

    steps.step("V makes another variant of a tree")
    one = nearest(3, 33)
    key("v", at=on_screen(*one.place))
    yield from wait_for(
        lambda: any(t.place == one.place and t.variant != one.variant for t in trees()) and idle(),
        60, "the other variant",
    )  # fmt: skip
    yield from settle()

    steps.step("Esc puts the brush away")
    key("Escape", at=on_screen(20.0, 20.0))
    yield from wait_for(lambda: not is_planting(), 10, "the end")
    planted = len(maple.by_hand)

    steps.step("a tree moved as any object stays when the forest is grown with another seed")
    thing = next(t.thing for t in trees() if t.thing is not None and t.label == "maple")
    thing.location.x, thing.location.y = -8.0, 0.0
    yield 0.3
    for seed in (props().seed, props().seed + 1):
        props().seed = seed
        press("forest.build")
        yield from results(["forest"], 60)
    assert near(-8, 0, 0.01) == 1
    assert len(maple.by_hand) == planted + 1
    yield from settle()

    yield from from_the_browser(steps, maple)

    steps.step("the season's slider takes leaves as soon as it is let go")
    props().live = True
    yield from wait_for(idle, 60, "what Live found")
    built, maple = props().built, props().plantings[0]  # a list that grew may have moved
    begun = time.perf_counter()
    maple.season = 0.8
    yield from wait_for(lambda: props().built != built and idle(), 60, "the forest in autumn")
    print(f"FIGURE a season with Live: {time.perf_counter() - begun:.1f} s in all", flush=True)
    print(f"FIGURE of it growing: {props().results['forest'].figures['Time'].value}", flush=True)
    props().live = False
    yield from settle()

    steps.step("a preset of the planting in Blender's menu")
    assert press("forest.preset_planting", invoke=False, name="Late autumn") == {"FINISHED"}
    point_at(*middle())
    yield from settle()
    in_view(bpy.ops.wm.call_panel, "INVOKE_DEFAULT", name="FOREST_PT_presets_planting")
    yield from settle()
