"""A newcomer's road: installed, a first forest, a tree and a sensor of one's own, a cloud, the file reopened.

The pictures of docs/panel.md are this session's photographs, which ``python tests/gui/run.py road`` takes and
``packaging/window_pictures.py`` puts there.
"""

import bpy
from drive import (
    Scenario,
    Steps,
    click,
    escape,
    find_button,
    idle,
    middle,
    open_tab,
    ours,
    press,
    props,
    results,
    scroll,
    settle,
    view,
    wait_for,
)


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
    yield from results(["forest"], 180)

    steps.step("a tree of my own")
    home = steps.folder / "my-hazel"  # a copy of one that is shipped, as one might have measured it
    home.mkdir()
    for part in ("wood.stl", "leaves.stl"):
        shipped = ours("base.places").ASSETS / "templates" / "hazelnut" / part
        (home / part).write_bytes(shipped.read_bytes())
    for name in ("tractor", "bat", "clap", "tripod"):
        bpy.data.objects.remove(bpy.data.objects[name])
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
    stale = ours("ui.forest.build").is_stale
    yield from wait_for(lambda: idle() and not stale(bpy.context.scene), 180, "the new forest")
    yield from settle()

    steps.step("a sensor of my own")
    bpy.context.scene.cursor.location = (18.0, 12.0, 0.0)
    assert press("forest.add_sensor", invoke=False, kind="terrestrial") == {"FINISHED"}
    yield from settle()
    name = bpy.context.view_layer.objects.active.name
    place = yield from find_button("forest.run(sensor", 0.3, 0.5)
    click(*place)
    yield from results([name], 240)

    steps.step("what was found is told beside Run")
    picture = f'forest.show_picture(result="{name}")'
    yield from find_button(picture, 0.93, 0.85)  # without turning the wheel
    assert not view()[1].spaces.active.shading.show_object_outline

    steps.step("the cloud is exported")
    bpy.context.preferences.view.filebrowser_display_type = "SCREEN"
    place = middle()
    press("forest.export_result", result=name)
    yield from settle()
    yield 1
    steps.step("back to the view")
    yield from escape(place)

    steps.step("the file reopened")
    path = steps.folder / "my-forest.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    yield 2
    yield from open_tab("Forest")
    scroll(view()[3], 40)
    yield from settle()
    assert name in props().results
    file = steps.folder / "again.laz"
    press("forest.export_result", invoke=False, result=name, filepath=str(file))
    assert file.stat().st_size > 1000
    path.unlink()
