"""Plant by hand in a window: trees are clicked, painted, cleared, moved and kept, with a real mouse."""

from collections.abc import Callable

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from drive import (
    Scenario,
    Steps,
    click,
    demo_forest,
    drag_over,
    idle,
    key,
    ours,
    point_at,
    press,
    props,
    settle,
    view,
    wait_for,
    xdotool,
)
from mathutils import Euler, Vector


def on_screen(x: float, y: float) -> tuple[int, int]:
    """Where a place on the ground is in the window."""
    _, area, main, _ = view()
    found = location_3d_to_region_2d(main, area.spaces.active.region_3d, Vector((x, y, 0)))
    return round(main.x + found.x), round(main.y + found.y)


def drag(places: list[tuple[float, float]], held: str = "") -> Scenario:
    """Drag over places on the ground, a key held if one is named."""
    if held:
        xdotool("keydown", held)
    yield from drag_over([on_screen(*place) for place in places])
    if held:
        xdotool("keyup", held)


def maple():
    """The planting that the brush sets; a list that grew may have moved."""
    return props().plantings[0]


def trees() -> list:
    return ours("blender.scene.instances").stood_trees(bpy.context.scene)


def nearest(x: float, y: float):
    return min(trees(), key=lambda tree: np.hypot(tree.place[0] - x, tree.place[1] - y))


def near(x: float, y: float, radius: float) -> int:
    """How many trees stand on a disc."""
    return sum((t.place[0] - x) ** 2 + (t.place[1] - y) ** 2 <= radius**2 + 1e-3 for t in trees())


def grown(condition: Callable[[], bool], what: str) -> Scenario:
    """Wait until it holds and the forest is grown and drawn."""
    yield from wait_for(lambda: condition() and idle(), 60, what)
    yield from settle()


def scenario(steps: Steps) -> Scenario:
    steps.step("the brush is in hand above a forest")
    yield from demo_forest()
    eye = view()[1].spaces.active.region_3d
    eye.view_rotation = Euler((0.5, 0.0, 0.0)).to_quaternion()
    eye.view_location, eye.view_distance = (22.0, 18.0, 0.0), 75.0
    assert press("forest.plant") == {"RUNNING_MODAL"}
    yield from settle()
    is_planting = ours("ui.forest.planting").is_planting
    assert is_planting()

    steps.step("a click sets a tree where it points")
    before = len(trees())
    click(*on_screen(3.0, 33.0))
    yield from wait_for(lambda: len(maple().by_hand) == 1, 10, "a tree set by hand")
    x, y = maple().by_hand[0].position
    assert max(abs(x - 3), abs(y - 33)) < 0.3, (x, y)
    yield from grown(lambda: near(x, y, 0.01) == 1, "the tree that was set")
    print(f"FIGURE a click among {before} trees: {props().results['forest'].figures['Time'].value}")

    steps.step("a drag fills a field")
    props().plant_radius, props().plant_density = 4.0, 0.15
    yield from drag([(24.0 + k, -4.0) for k in range(0, 16, 4)])
    yield from grown(lambda: len(maple().by_hand) > 8 and near(31, -4, 12) >= 8, "the field")

    steps.step("a drag with Ctrl clears")
    assert near(14, 14, 4)
    yield from drag([(12.0 + k, 14.0) for k in range(0, 5, 2)], held="ctrl")
    yield from grown(lambda: len(maple().clearings) and not near(14, 14, 4), "a clearing")

    steps.step("a drag with Shift moves one tree")
    one = nearest(3, 33)
    yield from drag([one.place, (0.0, 36.0), (-4.0, 38.0)], held="shift")
    yield from grown(lambda: near(-4, 38, 0.5) == 1, "the tree that was moved")
    assert near(*one.place, 0.1) == 0

    steps.step("Ctrl Z takes the last stroke back")
    point_at(*on_screen(20.0, 20.0))
    yield 0.3
    key("ctrl+z")
    yield from grown(lambda: near(3, 33, 0.5) == 1, "the tree where it was")

    steps.step("V makes another variant of a tree")
    one = nearest(3, 33)
    key("v", at=on_screen(*one.place))
    yield from grown(
        lambda: any(t.place == one.place and t.variant != one.variant for t in trees()),
        "the other variant",
    )

    steps.step("Esc puts the brush away")
    key("Escape", at=on_screen(20.0, 20.0))
    yield from wait_for(lambda: not is_planting(), 10, "the end")

    steps.step("a thumbnail dragged from the Asset Browser is planted where it is dropped")
    browser = next(area for area in view()[0].screen.areas if area.type == "PROPERTIES")
    browser.ui_type = "ASSETS"
    yield from settle()
    shown = browser.spaces.active
    shown.show_region_toolbar = shown.show_region_ui = False
    shown.params.asset_library_reference = "LOCAL"
    yield from settle()
    yield 2
    before, count, wanted = len(trees()), len(maple().by_hand), (30.0, 1.0)
    x, y = browser.x + 50, browser.y + browser.height - 75
    place = on_screen(*wanted)
    yield from drag_over([(x, y), (x - 20, y - 10), (x - 60, y - 30), place, place])
    yield from grown(
        lambda: len(maple().by_hand) == count + 1 and len(trees()) == before + 1,
        "the forest with it",
    )
    x, y = maple().by_hand[count].position
    assert np.hypot(x - wanted[0], y - wanted[1]) < 0.5, (x, y)
