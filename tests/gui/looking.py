"""Look through a scanner in a window: the image in the corner of the view follows the scanner.

Runs in Blender's window (see run.py); the button is found and clicked.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import bpy
from drive import Scenario, Steps, click, find_button, open_tab, play, press, settle, wait_for

OUT = Path(__file__).parent / "looking"


def eye():
    from bl_ext.user_default.forest_sensing.forest_addon.ui.sensors import look_through

    return look_through.eye()


def idle() -> bool:
    from bl_ext.user_default.forest_sensing.forest_addon.ui.shell import running

    return running.current() is None


def image():
    return None if eye() is None or eye().found is None else eye().found.distance


def scenario(steps: Steps) -> Scenario:
    steps.step("a forest")
    yield from open_tab("Forest")
    bpy.data.objects.remove(bpy.data.objects["Cube"])  # the forest would stand beside it
    press("forest.start", preset="demo", grow=True)
    yield 0.3
    props = bpy.context.scene.forest_sensing
    yield from wait_for(lambda: "forest" in props.results and idle(), 120, "the forest")
    yield from settle()

    steps.step("one click looks through its tripod")
    tripod = bpy.data.objects["tripod"]
    bpy.ops.object.select_all(action="DESELECT")
    tripod.select_set(True)
    bpy.context.view_layer.objects.active = tripod
    yield from settle()
    place = yield from find_button("forest.look_through", 0.9, 0.1)
    click(*place)
    yield from wait_for(lambda: image() is not None, 60, "an image")
    yield from settle()
    first, seconds = image(), eye().seconds
    print(f"FIGURE the demo through its tripod, {first.shape}: {1e3 * seconds:.0f} ms", flush=True)

    steps.step("it follows the scanner")
    observer = eye().observer
    for _ in range(10):
        tripod.location.x += 0.3
        yield 0.1
    yield from settle()
    assert (image() != first).any()
    assert eye().observer is observer

    for shown in ("BRIGHTNESS", "ORGAN"):
        steps.step(f"it shows {shown.lower()}")
        props.look_shows = shown
        yield from settle()

    steps.step("a tree that moved is seen when it is quiet")
    tree = next(t for t in bpy.context.scene.objects if "forest_tree" in t)
    tree.location.z += 20
    yield from wait_for(lambda: eye().observer is not observer, 30, "the scene read again")
    yield 2
    observer = eye().observer
    yield 2
    assert eye().observer is observer  # reading is no change

    steps.step("a click ends it")
    place = yield from find_button("forest.look_through", 0.9, 0.1)
    click(*place)
    yield from wait_for(lambda: eye() is None, 10, "the end")

    steps.step("a sonar's ears at the 3D cursor")
    bpy.ops.object.select_all(action="DESELECT")
    echo = bpy.data.objects["bat"]
    echo.select_set(True)
    bpy.context.view_layer.objects.active = echo
    bpy.context.scene.cursor.location = echo.location
    yield from settle()
    place = yield from find_button("forest.look_through", 0.9, 0.1)
    click(*place)
    yield from wait_for(lambda: eye() is not None and eye().found is not None, 60, "an image")
    first = eye().found.level
    yield from settle()
    bpy.context.scene.cursor.location.x += 0.5
    yield from wait_for(lambda: eye().found.level is not first, 30, "another image")
    print(f"FIGURE ears at the cursor: {1e3 * eye().seconds:.0f} ms", flush=True)
    yield from settle()


play(scenario, OUT)
