"""What a newcomer does, from an empty Blender on: growing, stopping, undo, Live, reopening, the command line.

Operators are invoked as their buttons do, in the view; Escape is a real key. What a step must have brought
about is asserted in it.
"""

import subprocess
import time
from importlib import metadata
from pathlib import Path

import addon_utils
import bpy
from drive import (
    Ending,
    Scenario,
    Steps,
    click,
    files_touched,
    idle,
    key,
    middle,
    open_every_panel,
    open_tab,
    ours,
    point_at,
    press,
    props,
    results,
    running,
    show_boxes,
    turn,
    view,
    wait_for,
)

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


def places() -> list[tuple[float, float, float]]:
    """Where the trees stand."""
    return sorted(tuple(tree.location) for tree in bpy.data.objects if "forest_tree" in tree)


def built_after(built: object, what: str) -> Scenario:
    yield from wait_for(lambda: props().built != built and idle(), 60, what)
    yield 1


def stop(name: str) -> Scenario:
    """Press Escape while a sensor runs, and see it end without a result."""
    assert not idle()
    ending = Ending(running())
    key("Escape")
    yield from wait_for(lambda: ending.known and idle(), 60, "the end")
    told = f"{ending.over:.2f} s to the end, {ending.ended:.2f} s to that of its thread"
    print(f"FIGURE Escape in {name}: {told}", flush=True)
    assert name not in props().results


def a_broken_overlay_stays_alone() -> Scenario:
    """A scanner on an empty curve has nothing to draw; points and beams of others are drawn all the same."""
    overlay = ours("ui.overlay")
    curve = bpy.data.objects.new("way", bpy.data.curves.new("way", "CURVE"))
    bpy.context.scene.collection.objects.link(curve)
    known = set(bpy.data.objects)
    press("forest.add_sensor", invoke=False, kind="mobile")
    added = set(bpy.data.objects) - known  # the scanner and its path
    track = next(obj for obj in added if obj.type != "CURVE")
    track.forest_sensor.mobile.follow_pointer = curve
    yield 1
    assert not overlay._broken
    assert len(overlay._outlines) == 4
    assert any(overlay._points.values())
    for obj in (*added, curve):
        bpy.data.objects.remove(obj)


def scenario(steps: Steps) -> Scenario:
    window, area, _, _ = view()
    steps.step("build the demo forest")
    yield from open_tab("Forest")
    started = time.perf_counter()
    assert press("forest.build") == {"RUNNING_MODAL"}
    yield from results(["forest"], 60)
    print(f"FIGURE build of the demo forest: {time.perf_counter() - started:.1f} s", flush=True)
    assert places()

    steps.step("a scan is under way, the view can be turned")
    scanner = bpy.data.objects["tripod"].forest_sensor.terrestrial
    scanner.angle_step_deg = 0.05  # long enough to be stopped on any machine
    show_boxes()
    still = yield from turn(1)
    press("forest.run", sensor="tripod", sure=True)
    yield 0.5
    before = area.spaces[0].region_3d.view_matrix.copy()
    working = yield from turn(2)
    assert area.spaces[0].region_3d.view_matrix != before
    print(f"FIGURE a frame of the window: {still:.2f} s, {working:.2f} s during a scan", flush=True)

    steps.step("Escape stops it, and an echo and a reverb that are exact")
    yield from stop("tripod")
    scanner.angle_step_deg = 0.5
    for name, kind in (("bat", "sonar"), ("clap", "reverb")):
        settings = getattr(bpy.data.objects[name].forest_sensor, kind)
        usual, settings.tolerance = settings.tolerance, 0
        press("forest.run", sensor=name)
        yield 3
        yield from stop(name)
        settings.tolerance = usual

    steps.step("a scan and a clap")
    for name in ("tripod", "clap"):
        assert press("forest.run", sensor=name) == {"RUNNING_MODAL"}
        yield from results([name], 120)
    done = bpy.context.window_manager.operators
    assert "FOREST_OT_run" in {op.bl_idname for op in done}  # its results can be undone
    again = {op.bl_idname for op in done if "REGISTER" in op.bl_options}
    assert not {"FOREST_OT_run", "FOREST_OT_build"} & again  # neither redone nor repeated

    steps.step("a scanner that follows a curve, beside what else is drawn")
    yield from a_broken_overlay_stays_alone()

    steps.step("change the seed and grow the forest anew: results stay, marked")
    stood = places()
    props().seed += 1
    press("forest.build")
    yield from wait_for(lambda: idle() and props().results["clap"].stale, 60, "the new forest")
    yield 1
    assert places() != stood

    steps.step("undo brings the old forest back")
    press("ed.undo", invoke=False)
    yield 1
    bpy.context.view_layer.update()
    assert places() == stood

    steps.step("drag a hill, and Live builds the forest anew")
    built = props().built
    props().drag_hills = props().live = True
    for planting in props().plantings:
        planting.variants = 1
    yield from built_after(built, "the first Live build")
    bpy.ops.ed.undo_push(message="Live")
    props().plantings[0].active_gaussians = 1
    hill = props().plantings[0].gaussians[1]
    was, built = tuple(hill.centre), props().built
    x, y = middle()
    key("g", at=(x, y))
    yield from wait_for(lambda: len(window.modal_operators), 10, "grabbing")
    point_at(x + 30, y + 20)
    point_at(x + 60, y + 20)
    yield from wait_for(lambda: tuple(hill.centre) != was, 10, "the hill")
    assert props().built == built
    click(x + 60, y + 20)
    yield from built_after(built, "the Live build")
    assert tuple(hill.handle.location[:2]) == tuple(hill.centre) != was

    steps.step("undo takes the hill back, and Live lets it be")
    standing = props().built
    press("ed.undo", invoke=False)  # the build
    press("ed.undo", invoke=False)  # the drag
    yield 2
    hill = props().plantings[0].gaussians[1]
    assert tuple(hill.handle.location[:2]) == tuple(hill.centre) == was
    assert idle()
    assert props().built == built != standing
    props().drag_hills = props().live = False

    steps.step("save and open again")
    stood, file = places(), str(steps.folder / "session.blend")
    bpy.ops.wm.save_as_mainfile(filepath=file)
    bpy.ops.wm.open_mainfile(filepath=file)
    yield 2
    assert places() == stood
    yield from open_tab("Forest")

    steps.step("every panel is drawn without touching a file")
    open_every_panel()
    props().advanced = True
    for result in props().results:
        result.opened = True
    yield 1
    assert files_touched() == []

    steps.step("a job of the command line leaves the extension and its packages")
    before, scene, out = installed(), steps.folder / "job.toml", steps.folder / "job"
    assert {"scipy", "laspy", "lazrs"} <= before
    scene.write_text(JOB, encoding="utf-8")
    job = [bpy.app.binary_path, "-b", "--command", "forest", "run", str(scene)]
    job += ["--out", str(out), "--quiet"]
    answer = subprocess.run(job, capture_output=True, text=True, timeout=300)
    assert answer.returncode == 0, answer.stdout + answer.stderr
    assert (out / "report.html").exists()
    assert (out / "cloud.laz").exists()
    assert installed() == before
    assert addon_utils.check(MODULE) == (True, True)
    yield 0.5

    steps.step("File > New asks whether to save")
    bpy.ops.ed.undo_push(message="a change")
    press("forest.new", preset="demo")
    yield 1
    assert bpy.data.filepath == file

    steps.step("a start scene")
    key("d", at=(window.width // 2, window.height // 2))  # Don't Save
    yield from wait_for(lambda: not bpy.data.filepath and idle(), 60, "the new file")
    yield from results(["forest"], 60)
    assert bpy.context.scene.camera is not None
    assert view()[3].active_panel_category == "Forest"
