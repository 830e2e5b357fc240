"""Ten clicks: from the enabled add-on to a point cloud, an echo and a reverb, with mouse and keys alone.

Each click is a real one, on a button that is found as a user finds it: the mouse moves down the sidebar
until Blender says that what is under it is the button looked for. Looking for it is not counted, neither as
a click nor in the seconds; pressing a key and turning the wheel are clicks too.
"""

import time

import bpy
from drive import (
    Scenario,
    Steps,
    click,
    find_button,
    find_tab,
    idle,
    key,
    middle,
    props,
    scroll,
    seek,
    settle,
    show_boxes,
    view,
    wait_for,
)

ALLOWED = 10  # clicks
ICONS = (0.82, 0.74)  # where across the sidebar the icons of a result are


def shown_picture() -> str:
    """The picture in the Image Editor."""
    for area in bpy.context.window_manager.windows[0].screen.areas:
        if area.type == "IMAGE_EDITOR" and area.spaces.active.image is not None:
            return str(area.spaces.active.image.name)
    return ""


def scenario(steps: Steps) -> Scenario:
    clicks: list[float] = []  # seconds between each and what it brought about
    _, area, _, side = view()

    def counted(act, condition, seconds: float, what: str) -> Scenario:
        begun = time.perf_counter()
        act()
        yield from wait_for(condition, seconds, what)
        clicks.append(time.perf_counter() - begun)
        yield 1

    def press(place: tuple[int, int], condition, seconds: float, what: str) -> Scenario:
        yield from counted(lambda: click(*place), condition, seconds, what)

    def down() -> Scenario:
        yield from counted(lambda: scroll(view()[3], 20), lambda: True, 10, "the wheel")
        yield from settle()

    def results() -> set[str]:
        return set(props().results.keys())

    steps.step("N opens the sidebar")
    opened = area.spaces.active
    yield from counted(lambda: key("n", at=middle()), lambda: opened.show_region_ui, 10, "N")

    steps.step("the tab Forest")
    place = yield from find_tab("Forest")
    yield from press(place, lambda: side.active_panel_category == "Forest", 10, "the tab")

    steps.step("Grow Forest")
    place = yield from find_button("forest.build()", 0.5)
    yield from press(place, lambda: "forest" in results() and idle(), 180, "the forest")

    steps.step("Run All")
    show_boxes()
    place = yield from find_button("forest.run(frames=", 0.65)
    wanted = {"forest", "tractor", "tripod", "bat", "clap"}
    yield from press(place, lambda: results() == wanted and idle(), 400, "what the sensors find")

    steps.step("down to the results")
    yield from down()

    steps.step("the echo as a picture")
    place = yield from find_button('forest.show_picture(result="bat")', *ICONS)
    yield from press(place, lambda: "bat" in shown_picture(), 20, "the picture of the echo")

    steps.step("the reverb as a picture")
    wanted = 'forest.show_picture(result="clap")'
    place = yield from seek(wanted, *ICONS)
    if place is None:  # the view has become lower
        yield from down()
        place = yield from find_button(wanted, *ICONS)
    yield from press(place, lambda: "clap" in shown_picture(), 20, "the picture of the reverb")

    told = f"{len(clicks)} clicks, {sum(clicks):.0f} s"
    print(f"FIGURE from enable to cloud, echo and reverb: {told}", flush=True)
    assert len(clicks) <= ALLOWED
