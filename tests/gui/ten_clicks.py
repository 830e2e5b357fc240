"""Ten clicks: from the enabled add-on to a point cloud, an echo and a reverb, with mouse and keys alone.

Each click is a real one, on a button that is found as a user finds it: the mouse moves down the sidebar
until Blender says that what is under it is the button looked for. Looking for it is not counted, neither as
a click nor in the seconds; pressing a key and turning the wheel are clicks too.
"""

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import bpy
from drive import (
    Scenario,
    Steps,
    click,
    find_button,
    find_tab,
    key,
    play,
    scroll,
    seek,
    settle,
    view,
    wait_for,
)

OUT = Path(__file__).parent / "ten-clicks"
ALLOWED = 10  # clicks
ICONS = (0.82, 0.74)  # where across the sidebar the icons of a result are


class Counted:
    """Clicks so far, and the seconds between each and what it brought about."""

    def __init__(self) -> None:
        self.clicks = 0
        self.seconds = 0.0
        self._begun = 0.0

    def begin(self) -> None:
        self.clicks += 1
        self._begun = time.perf_counter()

    def end(self) -> None:
        self.seconds += time.perf_counter() - self._begun


def results() -> set[str]:
    return set(bpy.context.scene.forest_sensing.results.keys())


def idle() -> bool:
    from bl_ext.user_default.forest_sensing.forest_addon.ui.shell import running

    return running.current() is None


def shown_picture() -> str:
    """The picture in the Image Editor."""
    for area in bpy.context.window_manager.windows[0].screen.areas:
        if area.type == "IMAGE_EDITOR" and area.spaces.active.image is not None:
            return str(area.spaces.active.image.name)
    return ""


def newcomer(steps: Steps) -> Scenario:
    count = Counted()
    _, area, main, side = view()
    middle = (main.x + main.width // 3, main.y + main.height // 2)

    def press(place: tuple[int, int], condition, seconds: float, what: str) -> Scenario:
        count.begin()
        click(*place)
        yield from wait_for(condition, seconds, what)
        count.end()
        yield 1

    steps.step("N opens the sidebar")
    count.begin()
    key("n", at=middle)
    yield from wait_for(lambda: area.spaces.active.show_region_ui, 10, "the sidebar")
    count.end()
    yield 1

    steps.step("the tab Forest")
    place = yield from find_tab("Forest")
    yield from press(place, lambda: side.active_panel_category == "Forest", 10, "the tab")

    steps.step("Grow Forest")
    place = yield from find_button("forest.build()", 0.5)
    yield from press(place, lambda: "forest" in results() and idle(), 180, "the forest")

    steps.step("Run All")
    place = yield from find_button("forest.run(frames=", 0.65)
    wanted = {"forest", "tractor", "tripod", "bat", "clap"}
    yield from press(place, lambda: results() == wanted and idle(), 400, "what the sensors find")

    steps.step("down to the results")
    count.begin()
    scroll(side, 20)
    yield from settle()
    count.end()

    steps.step("the echo as a picture")
    place = yield from find_button('forest.show_picture(result="bat")', *ICONS)
    yield from press(place, lambda: "bat" in shown_picture(), 20, "the picture of the echo")

    steps.step("the reverb as a picture")
    wanted = 'forest.show_picture(result="clap")'
    place = yield from seek(wanted, *ICONS)
    if place is None:  # the view has become lower
        count.begin()
        scroll(view()[3], 20)
        yield from settle()
        count.end()
        place = yield from find_button(wanted, *ICONS)
    yield from press(place, lambda: "clap" in shown_picture(), 20, "the picture of the reverb")

    told = f"{count.clicks} clicks, {count.seconds:.0f} s"
    print(f"FIGURE from enable to cloud, echo and reverb: {told}", flush=True)
    assert count.clicks <= ALLOWED
    yield 0.5


play(newcomer, OUT)
