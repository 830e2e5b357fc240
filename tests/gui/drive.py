"""Drives a Blender window from within: one step after the other, each photographed and noted.

``blender --python drive.py -- NAME`` plays the ``scenario`` of NAME.py, a generator function. It yields the
seconds to wait, during which Blender's window lives; what it raises fails the step it is in. ``step`` names
what follows; at its end the screen is photographed into ``NN-name.png`` and a line goes to ``steps.jsonl``.
Mouse and keys are xdotool's: real events.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterable
from importlib import import_module
from pathlib import Path
from types import ModuleType

import bpy

Scenario = Generator[float, None, None]
ROW = 15  # pixels between two looks down the sidebar; its buttons are 20 high
TAB = 10  # pixels from the sidebar's right edge to the middle of its tabs
HOVER = 0.08  # s until Blender knows what is below the mouse
LONGEST = 60  # s that a window may take to draw


class Steps:
    """The photographed steps of a scenario."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.number = 0
        self.name = ""
        self.started = time.perf_counter()

    def step(self, name: str) -> None:
        """End the step before this one and begin a new one."""
        if self.name:
            self._note(True, "")
        self.number += 1
        self.name = name
        self.started = time.perf_counter()

    def fail(self, problem: str) -> None:
        """End the step with a problem."""
        self._note(False, problem)
        self.name = ""

    def end(self) -> None:
        """End the last step."""
        if self.name:
            self._note(True, "")
        self.name = ""

    def _note(self, passed: bool, problem: str) -> None:
        seconds = time.perf_counter() - self.started
        words = re.sub(r"[^a-z0-9]+", "-", self.name.lower()).strip("-")
        photograph(self.folder / f"{self.number:02d}-{words}.png")
        entry = {"step": self.name, "passed": passed, "seconds": seconds, "problem": problem}
        with (self.folder / "steps.jsonl").open("a", encoding="utf-8") as file:
            file.write(json.dumps(entry) + "\n")


def play(scenario: Callable[[Steps], Scenario], folder: Path) -> None:
    """Run a scenario in the window that is just opening, then quit Blender."""
    folder.mkdir(parents=True, exist_ok=True)
    steps = Steps(folder)
    running = scenario(steps)

    def tick() -> float:
        try:
            wait = next(running)
        except StopIteration:
            steps.end()
            os._exit(0)
        except Exception:
            steps.fail(traceback.format_exc())
            traceback.print_exc()
            os._exit(1)
        return wait

    bpy.context.preferences.view.show_splash = False
    bpy.context.preferences.system.viewport_aa = "FXAA"  # others draw a view again and again
    bpy.app.timers.register(tick, first_interval=2.0, persistent=True)


def photograph(path: Path) -> None:
    """The whole screen as a picture."""
    if subprocess.run(["import", "-window", "root", str(path)], check=False).returncode:
        bpy.ops.screen.screenshot(filepath=str(path))


def ours(name: str) -> ModuleType:
    """A module of the installed extension."""
    return import_module(f"bl_ext.user_default.forest_sensing.forest_addon.{name}")


def props() -> bpy.types.PropertyGroup:
    return bpy.context.scene.forest_sensing


def running() -> object:
    """The job that runs, None where none does."""
    return ours("ui.shell.running").current()


def idle() -> bool:
    return running() is None


def results(names: Iterable[str], seconds: float) -> Scenario:
    """Wait until these results are there and all is drawn."""
    there = set(names)
    yield 0.3
    yield from wait_for(lambda: there <= {*props().results.keys()} and idle(), seconds, str(there))
    yield from settle()


def demo_forest() -> Scenario:
    """Grow the demo forest, without the cube that it would stand beside."""
    yield from open_tab("Forest")
    bpy.data.objects.remove(bpy.data.objects["Cube"])
    press("forest.start", preset="demo", grow=True)
    yield from results(["forest"], 120)


def show_boxes() -> None:
    """Show each tree as a box: without a graphics card a frame of the demo forest takes seconds."""
    for obj in bpy.data.objects:
        if "forest_tree" in obj:
            obj.display_type = "BOUNDS"


def choose(obj: bpy.types.Object) -> None:
    """Select an object and nothing else."""
    for other in bpy.context.view_layer.objects:
        other.select_set(other == obj)
    bpy.context.view_layer.objects.active = obj


def view() -> tuple[bpy.types.Window, bpy.types.Area, bpy.types.Region, bpy.types.Region]:
    """The window, its 3D view, that view's region and its sidebar."""
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    main = next(region for region in area.regions if region.type == "WINDOW")
    side = next(region for region in area.regions if region.type == "UI")
    return window, area, main, side


def open_tab(name: str) -> Scenario:
    """Show the sidebar with this tab; tabs are known once the sidebar was drawn."""
    _, area, _, side = view()
    area.spaces[0].show_region_ui = True
    while side.active_panel_category == "UNSUPPORTED":
        yield 0.1
    side.active_panel_category = name
    area.tag_redraw()
    yield 0.5


def press(operator: str, invoke: bool = True, **settings: object) -> set[str]:
    """Run an operator in the 3D view, as its button does or at once."""
    window, area, main, _ = view()
    room, _, verb = operator.partition(".")
    with bpy.context.temp_override(window=window, area=area, region=main):
        run = getattr(getattr(bpy.ops, room), verb)
        return run("INVOKE_DEFAULT", **settings) if invoke else run(**settings)


def middle() -> tuple[int, int]:
    """A place over the 3D view that no panel covers."""
    main = view()[2]
    return main.x + main.width // 3, main.y + main.height // 2


def has_view() -> bool:
    """Tell if a 3D view is there; a file browser may take its place."""
    areas = bpy.context.window_manager.windows[0].screen.areas
    return any(area.type == "VIEW_3D" for area in areas)


def escape(place: tuple[int, int]) -> Scenario:
    """Close what is open there, also a menu that was opened by a script or a file browser."""
    for _ in range(2):
        key("Escape", at=place)
        yield 1
    yield from wait_for(has_view, 20, "the view")


def turn(seconds: float) -> Generator[float, None, float]:
    """Turn the view, frame by frame; returns the seconds a frame takes.

    Without a graphics card all of Blender's window is drawn by the CPU, an empty one too.
    """
    frames, began = 0, time.perf_counter()
    while frames < 3 or time.perf_counter() - began < seconds:
        press("view3d.view_orbit", invoke=False, angle=0.1, type="ORBITLEFT")
        yield 0.0
        frames += 1
    return (time.perf_counter() - began) / frames


def wait_for(condition: Callable[[], bool], seconds: float, what: str) -> Scenario:
    """Let the window live until a condition holds."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"{what} did not come about in {seconds:g} s")
        yield 0.1


def xdotool(*words: str) -> None:
    """Mouse and keys."""
    subprocess.run(["xdotool", *words], check=True)


def point_at(x: int, y: int) -> None:
    """Move the mouse to a place of the window, counted from its lower left as Blender does."""
    high = int(bpy.context.window_manager.windows[0].height)
    xdotool("mousemove", str(x), str(high - y))


def click(x: int, y: int) -> None:
    """Click with the left button, a moment later: Blender first sees what is below the mouse."""
    point_at(x, y)
    subprocess.Popen(["xdotool", "sleep", "0.2", "click", "1"])


def key(name: str, at: tuple[int, int] | None = None) -> None:
    """Press a key, over a place of the window."""
    if at is not None:
        point_at(*at)
    subprocess.Popen(["xdotool", "sleep", "0.2" if at else "0", "key", name])


def scroll(region: bpy.types.Region, notches: int) -> None:
    """Turn the wheel over a region, down or up, at its edge: lists within it take it for themselves."""
    point_at(region.x + 4, region.y + region.height // 2)
    wheel = "5" if notches > 0 else "4"
    xdotool("click", "--repeat", str(abs(notches)), "--delay", "20", wheel)


def settle() -> Scenario:
    """Let the window live until all that is due is drawn: until it has answered at once a few times."""
    calm, end = 0, time.monotonic() + LONGEST
    while calm < 4 and time.monotonic() < end:
        asked = time.perf_counter()
        yield HOVER
        calm = calm + 1 if time.perf_counter() - asked < 3 * HOVER else 0


def find_button(command: str, *columns: float) -> Generator[float, None, tuple[int, int]]:
    """Where in the sidebar the button of a command is; it must be there (see ``seek``)."""
    place = yield from seek(command, *columns)
    assert place is not None, f"no button of the sidebar does {command}"
    return place


def seek(command: str, *columns: float) -> Generator[float, None, tuple[int, int] | None]:
    """Where in the sidebar the button of a command is, as its Python text begins; None: nowhere.

    columns : where to look across the sidebar, as shares of its width. The mouse goes down each until
    Blender says that the button below it is this one.
    """
    yield from settle()
    for place in places_down(columns):
        found = yield from command_at(*place)
        if found.startswith(f"bpy.ops.{command}"):
            return place
    return None


def places_down(columns: Iterable[float]) -> list[tuple[int, int]]:
    """Return places along the sidebar to look at, at shares of its width."""
    side = view()[3]
    rows = range(side.y + side.height - 8, side.y, -ROW)
    return [(side.x + int(column * side.width), y) for column in columns for y in rows]


def command_at(x: int, y: int) -> Generator[float, None, str]:
    """The Python text of the button there, which the mouse is moved to; empty where there is none."""
    window, area, _, side = view()
    point_at(x, y)
    yield HOVER
    yield 0  # a timer comes before the mouse when the window was busy
    with bpy.context.temp_override(window=window, area=area, region=side):
        if not bpy.ops.ui.copy_python_command_button.poll():
            return ""
        bpy.ops.ui.copy_python_command_button()
    return str(bpy.context.window_manager.clipboard)


def drag_over(places: list[tuple[int, int]]) -> Scenario:
    """Drag the left button over places of the window.

    It is given time at each: Blender takes the place of a press from where the mouse is by then.
    """
    for number, place in enumerate(places):
        point_at(*place)
        yield from settle()
        if not number:
            xdotool("mousedown", "1")
            yield from settle()
    xdotool("mouseup", "1")
    yield from settle()


def find_tab(name: str) -> Generator[float, None, tuple[int, int]]:
    """Where the tab of the sidebar is; the tab that is open stays open."""
    _, _, _, side = view()
    while side.active_panel_category == "UNSUPPORTED":
        yield 0.1
    before = side.active_panel_category
    x = side.x + side.width - TAB
    for y in range(side.y + side.height - ROW, side.y, -2 * ROW):
        click(x, y)
        yield 0.2 + 2 * HOVER
        yield from settle()
        if side.active_panel_category == name:
            side.active_panel_category = before
            yield 0.2
            return x, y
    raise AssertionError(f"there is no tab {name}")


def open_every_panel() -> None:
    """Have every panel and every part of one open where it was not shown yet."""
    ours("ui.settings.drawing").FOLDED = False
    panels = [cls for cls in ours("ui")._classes() if issubclass(cls, bpy.types.Panel)]
    for cls in reversed(panels):
        bpy.utils.unregister_class(cls)
    for cls in panels:
        cls.bl_options = getattr(cls, "bl_options", set()) - {"DEFAULT_CLOSED"}
        bpy.utils.register_class(cls)


def files_touched() -> list[str]:
    """What a redraw opens, lists or imports."""
    touched: list[str] = []
    watching = True

    def note(event: str, given: tuple) -> None:
        if watching and event in ("open", "os.listdir", "os.scandir", "import"):
            touched.append(f"{event} {given[0]}")

    sys.addaudithook(note)  # stays, and says nothing after this
    view()[3].tag_redraw()
    press("wm.redraw_timer", invoke=False, type="DRAW_WIN_SWAP", iterations=1)
    watching = False
    return touched


class Ending:
    """Notes, in a thread beside the window, when a job is over and when its own thread has ended."""

    def __init__(self, job: object) -> None:
        self._job = job
        self.asked = time.perf_counter()
        self.over = self.ended = 0.0
        self._watch = threading.Thread(target=self._look, daemon=True)
        self._watch.start()

    @property
    def known(self) -> bool:
        return not self._watch.is_alive()

    def _look(self) -> None:
        while not self._job.over:
            time.sleep(0.002)
        self.over = time.perf_counter() - self.asked
        while self._job.busy:
            time.sleep(0.002)
        self.ended = time.perf_counter() - self.asked


if __name__ == "__main__":
    HERE = Path(__file__).parent
    sys.path.insert(0, str(HERE))
    play(import_module(sys.argv[-1]).scenario, HERE / sys.argv[-1])
