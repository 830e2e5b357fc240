"""What a newcomer meets first: the empty tab's doors, sensors to add, the gallery, a scan of any scene with
its legend, rendered by EEVEE, and frames that the timeline plays.
"""

import bpy
from drive import (
    Scenario,
    Steps,
    escape,
    has_view,
    idle,
    in_view,
    middle,
    open_tab,
    point_at,
    press,
    props,
    results,
    scroll,
    settle,
    view,
    wait_for,
)

KINDS = ("terrestrial", "drone", "mobile", "airborne", "tractor", "sonar", "reverb")
TITLES = ("Drone LiDAR", "Vehicle LiDAR", "Aircraft LiDAR", "Tractor LiDAR", "Bat Sonar", "Reverb")


def at_rest() -> Scenario:
    """What was asked for is drawn, however slow the machine is."""
    yield 1
    yield from settle()


def data_editor() -> None:
    """Show the settings of the active object in the Properties editor."""
    areas = view()[0].screen.areas
    next(area for area in areas if area.type == "PROPERTIES").spaces.active.context = "DATA"


def rendered(engine: str, path: str) -> float:
    """The share of a small picture that a renderer covers."""
    scene = bpy.context.scene
    scene.render.engine, scene.render.filepath = engine, path
    scene.render.resolution_x = scene.render.resolution_y = 64
    scene.render.film_transparent = True
    bpy.ops.render.render(write_still=True)
    picture = bpy.data.images.load(path)
    alpha = list(picture.pixels)[3::4]
    bpy.data.images.remove(picture)
    return sum(alpha) / len(alpha)


def every_sensor(steps: Steps) -> Scenario:
    """Each of the seven, its lines strong beside faint ones, its settings in the Properties editor."""
    for kind in KINDS:
        steps.step(f"a new sensor: {kind}")
        bpy.context.scene.cursor.location = (-4, -4, 0)
        assert press("forest.add_sensor", invoke=False, kind=kind) == {"FINISHED"}
        yield 0.5
        data_editor()
        props().advanced = kind in ("sonar", "reverb")
        yield from at_rest()
    props().advanced = False

    steps.step("each of them runs as it is")
    scroll(view()[3], -40)
    press("forest.run", frames="THIS", sure=True)
    yield from results(TITLES, 300)

    steps.step("a reverb is played")
    props().results["Reverb"].opened = True
    told = "it sounds"
    try:
        press("forest.play", invoke=False, sensor="Reverb")
    except RuntimeError as problem:  # a machine without sound says so
        told = str(problem)
    assert told == "it sounds" or "No sound can be played here" in told
    print(f"FIGURE Play: {told}", flush=True)
    scroll(view()[3], 40)
    yield from at_rest()


def instruments(steps: Steps, name: str) -> Scenario:
    """The menu of instruments of a tripod, by their makers' names; basic settings and all."""
    steps.step("the menu of instruments")
    thing = bpy.data.objects[name]
    bpy.context.view_layer.objects.active = thing
    before = thing.forest_sensor.terrestrial.angle_step_deg
    point_at(*middle())
    in_view(bpy.ops.wm.call_menu, name="FOREST_MT_instruments")
    yield from at_rest()
    steps.step("an instrument is chosen, and all its settings")
    yield from escape()
    press("forest.choose_instrument", invoke=False, scanner="riegl-vz-400i")
    props().advanced = True
    data_editor()
    yield from at_rest()
    assert thing.forest_sensor.terrestrial.max_range == 800
    press("forest.choose_instrument", invoke=False, scanner="")
    thing.forest_sensor.terrestrial.angle_step_deg = before
    props().advanced = False


def a_large_run_asks(steps: Steps, name: str) -> Scenario:
    """What it will cost, and a question; Escape leaves all as it is."""
    steps.step("a large run asks first")
    scanner = bpy.data.objects[name].forest_sensor.terrestrial
    before, scanner.angle_step_deg = scanner.angle_step_deg, 0.01
    point_at(*middle())
    yield 0.5
    press("forest.run", sensor=name)
    yield from at_rest()
    assert idle()
    steps.step("and Escape leaves all as it is")
    yield from escape()
    assert idle()
    scanner.angle_step_deg = before


def kept_and_removed(steps: Steps, name: str) -> Scenario:
    """A result is exported, called otherwise, and removed with its points."""
    steps.step("export asks for format and labels")
    bpy.context.preferences.view.filebrowser_display_type = "SCREEN"
    press("forest.export_result", result=name)
    yield from at_rest()
    steps.step("an exported file")
    yield from escape()
    yield from wait_for(has_view, 20, "the view")
    file = steps.folder / "kept.laz"
    press("forest.export_result", invoke=False, result=name, filepath=str(file))
    assert file.stat().st_size > 1000
    steps.step("a result has another name")
    props().results[name].title = "Monkey and box"
    scroll(view()[3], 40)
    yield from at_rest()
    steps.step("a result is removed with its points")
    shown = props().results[name].shown
    press("forest.remove_result", invoke=False, result=name)
    yield 1
    assert name not in props().results
    assert shown not in bpy.data.objects


def scenario(steps: Steps) -> Scenario:
    bpy.ops.ed.undo_push(message="before")

    steps.step("the doors of the empty tab")
    yield from open_tab("Forest")
    yield 1

    steps.step("Add > Sensor")
    point_at(*middle())
    yield 0.5
    in_view(bpy.ops.wm.call_menu, name="FOREST_MT_sensors")
    yield 1.5
    steps.step("Add > Forest")
    yield from escape()
    in_view(bpy.ops.wm.call_menu, name="FOREST_MT_start")
    yield 2
    steps.step("the gallery")
    yield from escape()
    press("forest.gallery")
    yield 3
    steps.step("scan this scene")
    yield from escape()
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)
    bpy.ops.mesh.primitive_plane_add(size=20)
    bpy.ops.mesh.primitive_monkey_add(size=3, location=(0, 3, 1.5))
    bpy.ops.mesh.primitive_cube_add(size=2, location=(3, 0, 1))
    bpy.context.scene.cursor.location = (-2, -3, 0)
    assert press("forest.scan_here", invoke=False) == {"FINISHED"}
    name = bpy.context.view_layer.objects.active.name
    bpy.data.objects[name].forest_sensor.terrestrial.angle_step_deg = 0.5
    yield 1
    press("forest.run", sensor=name)
    yield from results([name], 60)

    steps.step("the legend of its points")
    props().point_size = 4
    scroll(view()[3], 20)
    yield from at_rest()

    steps.step("EEVEE and Cycles render the points")
    shown = bpy.data.objects[props().results[name].shown]
    eye = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    eye.location, eye.rotation_euler = (0, -14, 6), (1.2, 0, 0)
    bpy.context.scene.collection.objects.link(eye)
    bpy.context.scene.camera = eye
    for thing in bpy.data.objects:
        thing.hide_render = thing is not shown
    bpy.context.scene.cycles.samples = bpy.context.scene.eevee.taa_render_samples = 1
    engines = bpy.types.RenderSettings.bl_rna.properties["engine"].enum_items.keys()
    eevee = next(e for e in ("BLENDER_EEVEE", "BLENDER_EEVEE_NEXT") if e in engines)
    for engine in (eevee, "CYCLES"):
        covered = rendered(engine, str(steps.folder / "render.png"))
        print(f"FIGURE {engine} covers {covered:.0%} of the picture with points", flush=True)
        assert covered > 0.02
    for thing in bpy.data.objects:
        thing.hide_render = False

    steps.step("frames that the timeline plays")
    cube = bpy.data.objects["Cube"]
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 3
    for frame in (1, 3):
        cube.location.x = frame
        cube.keyframe_insert("location", frame=frame)
    press("forest.run", sensor=name, frames="RANGE", keep=True, sure=True)
    yield from wait_for(
        lambda: len(props().results[name].frames) == 3 and idle(), 60, "three frames"
    )
    seen = set()
    for frame in (1, 2, 3):
        scene.frame_set(frame)
        seen.add(shown.data.name)
        yield 0.5
    assert len(seen) == 3
    seen.clear()

    def playing() -> bool:
        seen.add(shown.data.name)
        return len(seen) == 3

    press("screen.animation_play", invoke=False)
    yield from wait_for(playing, 60, "every frame while it plays")
    press("screen.animation_play", invoke=False)

    steps.step("a frame range asks first")
    point_at(*middle())  # a dialog that the mouse is not over closes
    yield 0.5
    press("forest.run_frames", sensor=name)
    yield from at_rest()
    yield from escape()
    yield from a_large_run_asks(steps, name)
    yield from every_sensor(steps)
    yield from instruments(steps, name)
    yield from kept_and_removed(steps, name)
    steps.step("a tree that can be grown again")
    press("forest.add_tree", invoke=False)
    before = len(bpy.context.object.data.vertices)
    bpy.context.object.data.forest_grown.seed = 7
    press("forest.grow_again", invoke=False)
    assert len(bpy.context.object.data.vertices) != before
    yield 1

    steps.step("a new forest from eye level")
    press("forest.new", invoke=False, preset="maple-walk")
    yield from results(["forest"], 120)
    steps.step("what its camera sees")
    view()[1].spaces.active.region_3d.view_perspective = "CAMERA"
    yield 2

    steps.step("painting shows the trees through the canvas")
    view()[1].spaces.active.region_3d.view_perspective = "PERSP"
    yield 1
    press("forest.paint", invoke=False)
    yield 2
    steps.step("painting is done")
    press("forest.paint", invoke=False)
    yield 1
    assert bpy.context.mode == "OBJECT"
    assert not view()[1].spaces.active.shading.show_xray
