"""What a newcomer does, from an empty Blender to results: runs in Blender's window (see run.py).

Operators are invoked as their buttons do, in the view; Escape is a real key. What a step must have
brought about is asserted in it.
"""

import subprocess
import sys
import time
from collections.abc import Generator
from importlib import metadata
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import addon_utils
import bpy
from drive import (
    Ending,
    Scenario,
    Steps,
    click,
    files_touched,
    in_panels,
    key,
    open_every_panel,
    open_tab,
    panels,
    play,
    point_at,
    press,
    view,
    wait_for,
)

OUT = Path(__file__).parent
MOST = 4.0  # ms of CPU that the panels take of a redraw
MODULE = "bl_ext.user_default.forest_sensing"

JOB = """
seed = 3
[forest]
size = [8.0, 8.0]
[[plantings]]
species = "hazelnut"
variants = 1
expected = 2
exact = true
[[sensors]]
kind = "terrestrial"
name = "cloud"
position = [4.0, 4.0, 1.6]
angle_step_deg = 4.0
[output]
preview = false
"""


def installed() -> set[str]:
    """Names of the packages that extensions brought, as they lie on the disk."""
    local = Path(bpy.utils.user_resource("EXTENSIONS")) / ".local"
    folders = [str(folder) for folder in local.rglob("site-packages")]
    return {dist.name for dist in metadata.distributions(path=folders)}


def props():
    return bpy.context.scene.forest_sensing


def done(name: str) -> bool:
    return name in props().results


def trees() -> list[bpy.types.Object]:
    return [thing for thing in bpy.data.objects if "forest_tree" in thing]


def idle() -> bool:
    from bl_ext.user_default.forest_sensing.forest_addon.ui.shell import running

    return running.current() is None


def run(name: str, seconds: float = 120) -> Scenario:
    props().results.remove(props().results.find(name)) if done(name) else None
    assert press("forest.run", sensor=name) == {"RUNNING_MODAL"}
    yield from wait_for(lambda: done(name) and idle(), seconds, name)
    yield 1


def orbit(seconds: float) -> Generator[float, None, float]:
    """Turn the view, frame by frame; returns the seconds a frame takes."""
    frames, began = 0, time.perf_counter()
    while not frames or time.perf_counter() - began < seconds:
        window, area, main, _ = view()
        with bpy.context.temp_override(window=window, area=area, region=main):
            bpy.ops.view3d.view_orbit(angle=0.1, type="ORBITLEFT")
        yield 0.0
        frames += 1
    return (time.perf_counter() - began) / frames


def stop(what: str) -> Scenario:
    """Press Escape while a job runs, and see it end."""
    from bl_ext.user_default.forest_sensing.forest_addon.ui.shell import running

    assert not idle()
    ending = Ending(running.current())
    key("Escape")
    yield from wait_for(lambda: ending.known and idle(), 60, "the end")
    told = f"{ending.over:.2f} s to the end, {ending.ended:.2f} s to that of its thread"
    print(f"FIGURE Escape in {what}: {told}", flush=True)


def a_broken_overlay_stays_alone() -> Scenario:
    """A scanner on an empty curve has nothing to draw; points and beams of others are drawn all the same."""
    from bl_ext.user_default.forest_sensing.forest_addon.ui import overlay

    curve = bpy.data.objects.new("way", bpy.data.curves.new("way", "CURVE"))
    bpy.context.scene.collection.objects.link(curve)
    known = set(bpy.data.objects)
    press("forest.add_sensor", invoke=False, kind="mobile")
    added = set(bpy.data.objects) - known  # the scanner and its path
    track = next(thing for thing in added if thing.type != "CURVE")
    track.forest_sensor.mobile.follow_pointer = curve
    yield 1
    assert not overlay._broken
    assert len(overlay._outlines) == 4
    assert any(overlay._points.values())
    for thing in (*added, curve):
        bpy.data.objects.remove(thing)


def a_copy_is_chosen(area: bpy.types.Area, main: bpy.types.Region) -> Scenario:
    """Copy the echo as Shift-D does, see that list and buttons mean the copy, and remove it."""
    from bl_ext.user_default.forest_sensing.forest_addon.ui.shell.views import chosen_sensor

    window, echo = view()[0], bpy.data.objects["bat"]
    things = echo.users_collection[0].objects
    props().active_sensor = list(things).index(echo)
    with bpy.context.temp_override(window=window, area=area, region=main):
        bpy.ops.object.duplicate()
    yield 0.5
    assert things[props().active_sensor].name == "bat.001"
    assert chosen_sensor(bpy.context).name == "bat.001"
    press("forest.remove_sensor", invoke=False)
    yield 0.5
    assert "bat" in bpy.data.objects
    assert "bat.001" not in bpy.data.objects


def one_tree() -> Scenario:
    """A new file with a scene that is soon drawn."""
    press("forest.new", invoke=False, preset="t20-one-tree")
    yield from wait_for(lambda: len(trees()) == 1 and idle(), 60, "a tree")
    yield 1


def demo_with_results() -> Scenario:
    """A new file with the demo forest, its species taken in for editing, and what each sensor finds."""
    press("forest.new", invoke=False, preset="demo")
    yield from wait_for(lambda: len(trees()) > 10 and idle(), 120, "the demo")
    few = {name: thing.forest_sensor for name, thing in bpy.data.objects.items()}
    few["tripod"].terrestrial.angle_step_deg = 1.0
    few["tractor"].tractor.step = 0.1
    few["bat"].sonar.max_range = 6.0
    few["clap"].reverb.duration = 0.3
    yield 1
    press("forest.run", frames="THIS", sure=True)
    wanted = ("tripod", "bat", "clap", "tractor")
    yield from wait_for(lambda: all(map(done, wanted)) and idle(), 240, "results")
    press("forest.edit_species", invoke=False)
    props().advanced = True
    for result in props().results:
        result.opened = True
    yield 1


def newcomer(steps: Steps) -> Scenario:
    window, area, main, side = view()
    steps.step("open the tab")
    yield from open_tab("Forest")

    steps.step("build the demo forest")
    started = time.perf_counter()
    assert press("forest.build") == {"RUNNING_MODAL"}
    yield from wait_for(lambda: done("forest") and idle(), 60, "the forest")
    print(f"FIGURE build of the demo forest: {time.perf_counter() - started:.1f} s", flush=True)
    assert trees()
    yield 1

    steps.step("a scan is under way, the view can be turned")
    scanner = bpy.data.objects["tripod"].forest_sensor.terrestrial
    scanner.angle_step_deg = 0.05  # long enough to be stopped on any machine
    yield 1
    still = yield from orbit(1)
    press("forest.run", sensor="tripod")
    yield 0.5
    assert idle()  # it is large, and asks first
    key("Escape", at=(main.x + main.width // 3, main.y + main.height // 2))
    yield 1
    press("forest.run", sensor="tripod", sure=True)
    yield 0.5
    assert not idle()
    before = area.spaces[0].region_3d.view_matrix.copy()
    working = yield from orbit(2)
    assert area.spaces[0].region_3d.view_matrix != before
    print(f"FIGURE a frame of the window: {still:.2f} s, {working:.2f} s during a scan", flush=True)

    steps.step("Escape stops it")
    yield from stop("a scan")
    assert not done("tripod")
    scanner.angle_step_deg = 0.25

    steps.step("Escape stops an echo and a reverb that are exact")
    for name, kind in (("bat", "sonar"), ("clap", "reverb")):
        settings = getattr(bpy.data.objects[name].forest_sensor, kind)
        usual, settings.tolerance = settings.tolerance, 0
        press("forest.run", sensor=name)
        yield 3
        yield from stop(f"an exact {name}")
        assert not done(name)
        settings.tolerance = usual
    yield 1

    steps.step("scan all round")
    yield from run("tripod")
    steps.step("ping")
    bpy.data.objects["bat"].forest_sensor.sonar.max_range = 8.0  # the whole of it is in ten_clicks
    yield from run("bat")
    assert props().results["bat"].picture is not None
    steps.step("clap")
    yield from run("clap")

    steps.step("a scanner that follows a curve, beside what else is drawn")
    yield from a_broken_overlay_stays_alone()

    steps.step("Shift-D: the copy is chosen in list and buttons")
    yield from a_copy_is_chosen(area, main)

    steps.step("a frame range asks first")
    props().active_sensor = list(bpy.data.objects["tripod"].users_collection[0].objects).index(
        bpy.data.objects["tripod"]
    )
    before = set(props().results.keys())
    press("forest.run_frames", sensor="tripod")
    yield 1.5
    assert idle()
    key("Escape", at=(main.x + main.width // 3, main.y + main.height // 2))
    yield 1
    assert idle()
    assert set(props().results.keys()) == before
    done_so_far = bpy.context.window_manager.operators
    assert "FOREST_OT_run" in {op.bl_idname for op in done_so_far}  # its results can be undone
    again = {op.bl_idname for op in done_so_far if "REGISTER" in op.bl_options}
    assert not {"FOREST_OT_run", "FOREST_OT_build"} & again  # neither redone nor repeated

    steps.step("the echo in the Image Editor")
    press("forest.show_picture", result="bat")
    yield 2
    shown = next(a for a in bpy.context.screen.areas if a.type == "IMAGE_EDITOR")
    assert shown.spaces.active.image == props().results["bat"].picture

    steps.step("back to the view")
    with bpy.context.temp_override(window=window, area=shown):
        bpy.ops.screen.area_close()
    yield 1
    window, area, main, side = view()

    steps.step("change the seed and grow the forest anew: results stay, marked")
    places = sorted(tuple(tree.location) for tree in trees())
    props().seed += 1
    press("forest.build")
    yield from wait_for(lambda: idle() and props().results["clap"].stale, 60, "the new forest")
    yield 1
    assert sorted(tuple(tree.location) for tree in trees()) != places

    steps.step("undo brings the old forest back")
    with bpy.context.temp_override(window=window, area=area, region=main):
        bpy.ops.ed.undo()
    yield 1
    bpy.context.view_layer.update()
    assert sorted(tuple(tree.location) for tree in trees()) == places

    steps.step("drag a hill, and Live builds the forest anew")
    was_built = props().built
    props().drag_hills = props().live = True
    for planting in props().plantings:
        planting.variants = 1
    yield from wait_for(lambda: props().built != was_built and idle(), 60, "the first Live build")
    bpy.ops.ed.undo_push(message="Live")
    props().plantings[0].active_gaussians = 1
    hill = props().plantings[0].gaussians[1]
    was, built = tuple(hill.centre), props().built
    x, y = main.x + main.width // 3, main.y + main.height // 2
    key("g", at=(x, y))
    yield from wait_for(lambda: len(window.modal_operators), 10, "grabbing")
    point_at(x + 30, y + 20)
    point_at(x + 60, y + 20)
    yield from wait_for(lambda: tuple(hill.centre) != was, 10, "the hill")
    assert props().built == built
    click(x + 60, y + 20)
    yield from wait_for(lambda: props().built != built and idle(), 60, "the Live build")
    yield 1
    assert tuple(hill.handle.location[:2]) == tuple(hill.centre) != was

    steps.step("undo takes the hill back, and Live lets it be")
    standing = props().built
    with bpy.context.temp_override(window=window, area=area, region=main):
        bpy.ops.ed.undo()  # the build
        bpy.ops.ed.undo()  # the drag
    yield 2
    hill = props().plantings[0].gaussians[1]
    assert tuple(hill.handle.location[:2]) == tuple(hill.centre) == was
    assert idle()
    assert props().built == built != standing
    props().drag_hills = props().live = False
    places = sorted(tuple(tree.location) for tree in trees())

    steps.step("save and open again")
    file = str(OUT / "session.blend")
    bpy.ops.wm.save_as_mainfile(filepath=file)
    bpy.ops.wm.open_mainfile(filepath=file)
    yield 2
    assert sorted(tuple(tree.location) for tree in trees()) == places
    yield from open_tab("Forest")

    steps.step("the command line of the installed extension")
    command = [
        bpy.app.binary_path,
        "-b",
        "--command",
        "forest",
        "derive",
        "maple",
        "--generations",
        "1",
    ]
    answer = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert "d(g)[g)+g)" in answer.stdout, answer.stdout + answer.stderr
    yield 0.5

    steps.step("a job of the command line leaves the extension and its packages")
    before = installed()
    assert {"scipy", "laspy", "lazrs"} <= before
    scene = OUT / "job.toml"
    scene.write_text(JOB, encoding="utf-8")
    job = [bpy.app.binary_path, "-b", "--command", "forest", "run", str(scene)]
    job += ["--out", str(OUT / "job"), "--quiet"]
    answer = subprocess.run(job, capture_output=True, text=True, timeout=300)
    assert answer.returncode == 0, answer.stdout + answer.stderr
    assert (OUT / "job" / "report.html").exists()
    assert (OUT / "job" / "cloud.laz").exists()
    assert installed() == before
    assert addon_utils.check(MODULE) == (True, True)
    print(f"FIGURE packages of the extension after a job: {len(before)}, as before", flush=True)
    yield 0.5

    steps.step("File > New asks whether to save")
    middle = (window.width // 2, window.height // 2)
    bpy.ops.ed.undo_push(message="a change")
    press("forest.new", preset="demo")
    yield 1
    assert bpy.data.filepath == file
    assert done("forest")

    steps.step("a start scene")
    key("d", at=middle)  # Don't Save
    yield from wait_for(lambda: not bpy.data.filepath and done("forest") and idle(), 60, "it")
    yield 1.5
    assert bpy.context.scene.camera is not None
    _, area, _, side = view()
    assert side.active_panel_category == "Forest"

    steps.step("how long the panel takes to draw")
    yield from one_tree()
    usual = in_panels(panels())
    open_every_panel()
    yield from demo_with_results()
    every = in_panels(panels())
    assert every[1] > usual[1] > 0
    assert any(result.legend for result in props().results)
    told = f"{usual[0]:.1f} ms of CPU for {usual[1]} panels, {every[0]:.1f} ms for {every[1]}"
    told += ", all open, Advanced, with results and legends"
    told += "" if every[0] < MOST else f": MORE than {MOST:g} ms"
    print(f"FIGURE drawing the sidebar: {told}", flush=True)
    assert files_touched() == []
    yield 0.5

    steps.step("disable the add-on")
    bpy.ops.preferences.addon_disable(module=MODULE)
    yield 1
    assert not hasattr(bpy.types.Scene, "forest_sensing")
    assert not [name for name in dir(bpy.types) if name.startswith("FOREST_")]

    steps.step("enable it again")
    started = time.perf_counter()
    bpy.ops.preferences.addon_enable(module=MODULE)
    told = f"{time.perf_counter() - started:.2f} s, in which Blender unpacks its wheels"
    print(f"FIGURE enabling the add-on: {told}", flush=True)
    yield 1
    assert done("forest")


play(newcomer, OUT)
