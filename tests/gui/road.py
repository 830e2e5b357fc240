"""A newcomer's road: installed, a first forest, a tree and a sensor of one's own, a cloud, the file reopened.

Runs in Blender's window (see run.py). The pictures of docs/panel.md are this session's photographs, which
``python tests/gui/run.py road`` takes and ``packaging/window_pictures.py`` puts there.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import bpy
from drive import (
    Scenario,
    Steps,
    click,
    find_button,
    key,
    open_tab,
    play,
    press,
    scroll,
    settle,
    view,
    wait_for,
)

OUT = Path(__file__).parent / "road"


def props():
    return bpy.context.scene.forest_sensing


def idle() -> bool:
    from bl_ext.user_default.forest_sensing.forest_addon.ui.shell import running

    return running.current() is None


def own_tree() -> Path:
    """A tree of two STL files that one might have measured: a copy of one that is shipped."""
    from bl_ext.user_default.forest_sensing.forest_addon.base.places import ASSETS

    home = OUT / "my-hazel"
    home.mkdir(parents=True, exist_ok=True)
    for part in ("wood.stl", "leaves.stl"):
        (home / part).write_bytes((ASSETS / "templates" / "hazelnut" / part).read_bytes())
    return home


def scenario(steps: Steps) -> Scenario:
    steps.step("installed")
    _, area, _, _ = view()
    yield from settle()
    area.ui_type = "PREFERENCES"
    bpy.context.preferences.active_section = "EXTENSIONS"
    bpy.context.window_manager.extension_search = "forest"
    yield 2
    steps.step("the tab Forest")
    area.ui_type = "VIEW_3D"
    yield from settle()
    yield from open_tab("Forest")
    yield from settle()

    steps.step("a first forest")
    place = yield from find_button("forest.build(", 0.5, 0.3)
    click(*place)
    yield from wait_for(lambda: "forest" in props().results and idle(), 180, "the forest")
    yield from settle()

    steps.step("a tree of my own")
    home = own_tree()
    for sensor in [t for t in bpy.data.objects if t.name in ("tractor", "bat", "clap", "tripod")]:
        bpy.data.objects.remove(sensor)
    press(
        "forest.import_tree", invoke=False, directory=f"{home}/", title="my-hazel", accept=True,
        filepath=str(home / "wood.stl"), files=[{"name": "wood.stl"}, {"name": "leaves.stl"}],
    )  # fmt: skip
    yield 0.5
    yield from wait_for(lambda: idle() and len(props().plantings) == 3, 240, "the species")
    props().plantings[2].expected = 25
    yield from settle()
    press("forest.build")
    yield 0.5
    yield from wait_for(lambda: idle() and not stale(), 180, "my trees in the forest")
    yield from settle()

    steps.step("a sensor of my own")
    bpy.context.scene.cursor.location = (18.0, 12.0, 0.0)
    assert press("forest.add_sensor", invoke=False, kind="terrestrial") == {"FINISHED"}
    yield from settle()
    name = bpy.context.view_layer.objects.active.name
    place = yield from find_button("forest.run(sensor", 0.3, 0.5)
    click(*place)
    yield from wait_for(lambda: name in props().results and idle(), 240, "its cloud")
    yield from settle()

    steps.step("what was found is told beside Run")
    picture = f'forest.show_picture(result="{name}")'
    yield from find_button(picture, 0.93, 0.85)  # without turning the wheel
    assert not view()[1].spaces.active.shading.show_object_outline

    steps.step("the cloud is exported")
    bpy.context.preferences.view.filebrowser_display_type = "SCREEN"
    press("forest.export_result", result=name)
    yield from settle()
    yield 1
    steps.step("back to the view")
    main = bpy.context.window_manager.windows[0]
    key("Escape", at=(main.width // 2, main.height // 2))
    yield from wait_for(lambda: any(a.type == "VIEW_3D" for a in main.screen.areas), 20, "the view")
    file = OUT / "cloud.laz"
    press("forest.export_result", invoke=False, result=name, filepath=str(file))
    assert file.stat().st_size > 1000

    steps.step("the file reopened")
    path = OUT / "my-forest.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    yield 2
    yield from open_tab("Forest")
    scroll(view()[3], 40)
    yield from settle()
    assert name in props().results
    press("forest.export_result", invoke=False, result=name, filepath=str(OUT / "again.laz"))
    assert (OUT / "again.laz").stat().st_size > 1000
    path.unlink()


def stale() -> bool:
    from bl_ext.user_default.forest_sensing.forest_addon.ui.forest import build

    return build.is_stale(bpy.context.scene)


play(scenario, OUT)
