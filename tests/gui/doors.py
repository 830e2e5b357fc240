"""What a newcomer meets first: the empty tab's doors, sensors to add, the gallery, a scan of any scene with
its legend, rendered by EEVEE, and frames that the timeline plays.
"""

from collections.abc import Callable

import bpy
from drive import (
    Scenario,
    Steps,
    escape,
    idle,
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


def at_rest() -> Scenario:
    """What was asked for is drawn, however slow the machine is."""
    yield 1
    yield from settle()


def opened(steps: Steps, name: str, act: Callable[[], object]) -> Scenario:
    """A menu or a dialog, photographed; Escape leaves all as it is."""
    steps.step(name)
    place = middle()
    point_at(*place)  # a dialog that the mouse is not over closes
    yield 0.5
    act()
    yield from at_rest()
    assert idle()
    steps.end()
    yield from escape(place)
    assert idle()


def menu(name: str) -> Callable[[], None]:
    return lambda: press("wm.call_menu", invoke=False, name=f"FOREST_MT_{name}")


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
    areas = {area.type: area for area in view()[0].screen.areas}
    for kind in KINDS:
        steps.step(f"a new sensor: {kind}")
        bpy.context.scene.cursor.location = (-4, -4, 0)
        assert press("forest.add_sensor", invoke=False, kind=kind) == {"FINISHED"}
        yield 0.5
        areas["PROPERTIES"].spaces.active.context = "DATA"
        props().advanced = kind in ("sonar", "reverb")
        yield from at_rest()
    props().advanced = False


def scenario(steps: Steps) -> Scenario:
    bpy.ops.ed.undo_push(message="before")

    steps.step("the doors of the empty tab")
    yield from open_tab("Forest")
    yield 1

    yield from opened(steps, "Add > Sensor", menu("sensors"))
    yield from opened(steps, "Add > Forest", menu("start"))
    yield from opened(steps, "the gallery", lambda: press("forest.gallery"))

    steps.step("scan this scene, with the legend of its points")
    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
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
    props().point_size = 4
    scroll(view()[3], 20)
    yield from at_rest()

    steps.step("EEVEE and Cycles render the points")
    shown = bpy.data.objects[props().results[name].shown]
    eye = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    eye.location, eye.rotation_euler = (0, -14, 6), (1.2, 0, 0)
    bpy.context.scene.collection.objects.link(eye)
    bpy.context.scene.camera = eye
    for obj in bpy.data.objects:
        obj.hide_render = obj is not shown
    bpy.context.scene.cycles.samples = bpy.context.scene.eevee.taa_render_samples = 1
    engines = bpy.types.RenderSettings.bl_rna.properties["engine"].enum_items.keys()
    eevee = next(e for e in ("BLENDER_EEVEE", "BLENDER_EEVEE_NEXT") if e in engines)
    for engine in (eevee, "CYCLES"):
        covered = rendered(engine, str(steps.folder / "render.png"))
        print(f"FIGURE {engine} covers {covered:.0%} of the picture with points", flush=True)
        assert covered > 0.02
    for obj in bpy.data.objects:
        obj.hide_render = False

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

    def playing() -> bool:
        seen.add(shown.data.name)
        return len(seen) == 3

    press("screen.animation_play", invoke=False)
    yield from wait_for(playing, 60, "every frame while it plays")
    press("screen.animation_play", invoke=False)

    scanner = bpy.data.objects[name].forest_sensor.terrestrial
    run, frames, export = "forest.run", "forest.run_frames", "forest.export_result"
    bpy.context.preferences.view.filebrowser_display_type = "SCREEN"
    yield from opened(steps, "a frame range asks first", lambda: press(frames, sensor=name))
    scanner.angle_step_deg = 0.01
    yield from opened(steps, "a large run asks first", lambda: press(run, sensor=name))
    scanner.angle_step_deg = 0.5
    yield from opened(steps, "export asks for format", lambda: press(export, result=name))
    yield from opened(steps, "the menu of instruments", menu("instruments"))
    yield from every_sensor(steps)

    steps.step("a new forest by what its camera sees")
    press("forest.new", invoke=False, preset="maple-walk")
    yield from results(["forest"], 120)
    view()[1].spaces.active.region_3d.view_perspective = "CAMERA"
    yield from settle()

    steps.step("painting shows the trees through the canvas")
    view()[1].spaces.active.region_3d.view_perspective = "PERSP"
    yield 1
    press("forest.paint", invoke=False)
    yield 2
    steps.end()
    press("forest.paint", invoke=False)
    yield 1
    assert bpy.context.mode == "OBJECT"
    assert not view()[1].spaces.active.shading.show_xray
