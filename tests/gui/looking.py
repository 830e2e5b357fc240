"""Look through a scanner in a window: the image in the corner of the view follows the scanner.

The button is found and clicked.
"""

import bpy
from drive import (
    Scenario,
    Steps,
    choose,
    click,
    demo_forest,
    find_button,
    ours,
    settle,
    wait_for,
)


def eye():
    return ours("ui.sensors.look_through").eye()


def shown():
    """The figure that is seen or heard now, None before there is anything."""
    return None if eye() is None else eye().found


def look_through(name: str) -> Scenario:
    """Click the button of a sensor; its first image."""
    choose(bpy.data.objects[name])
    yield from settle()
    click(*(yield from find_button("forest.look_through", 0.9, 0.1)))
    yield from wait_for(lambda: shown() is not None, 60, "an image")
    yield from settle()
    print(f"FIGURE the demo through its {name}: {1e3 * eye().seconds:.0f} ms", flush=True)


def scenario(steps: Steps) -> Scenario:
    steps.step("a forest")
    yield from demo_forest()

    steps.step("one click looks through its tripod, and the image follows it")
    yield from look_through("tripod")
    first, observer = shown().distance, eye().observer
    for _ in range(10):
        bpy.data.objects["tripod"].location.x += 0.3
        yield 0.1
    yield from settle()
    assert (shown().distance != first).any()
    assert eye().observer is observer

    steps.step("a tree that moved is seen when it is quiet")
    tree = next(t for t in bpy.context.scene.objects if "forest_tree" in t)
    tree.location.z += 20
    yield from wait_for(lambda: eye().observer is not observer, 30, "the scene read again")
    yield 2
    observer = eye().observer
    yield 2
    assert eye().observer is observer  # reading is no change

    steps.step("a click ends it")
    click(*(yield from find_button("forest.look_through", 0.9, 0.1)))
    yield from wait_for(lambda: eye() is None, 10, "the end")

    steps.step("a sonar's ears at the 3D cursor")
    bpy.context.scene.cursor.location = bpy.data.objects["bat"].location
    yield from look_through("bat")
    level = shown().level
    bpy.context.scene.cursor.location.x += 0.5
    yield from wait_for(lambda: shown().level is not level, 30, "another image")
