"""Drives a Blender window from within: one step after the other, each photographed and noted.

A scenario is a generator function. It yields the seconds to wait, during which Blender's window lives; what
it raises fails the step it is in. ``step`` names what follows; at its end the screen is photographed into
``NN-name.png`` and a line goes to ``steps.jsonl``. Mouse and keys are xdotool's: real events.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import time
import traceback
from collections.abc import Callable, Generator
from pathlib import Path

import bpy

Scenario = Generator[float, None, None]


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
    bpy.app.timers.register(tick, first_interval=2.0, persistent=True)


def photograph(path: Path) -> None:
    """The whole screen as a picture."""
    if subprocess.run(["import", "-window", "root", str(path)], check=False).returncode:
        bpy.ops.screen.screenshot(filepath=str(path))


def view() -> tuple[bpy.types.Window, bpy.types.Area, bpy.types.Region, bpy.types.Region]:
    """The window, its 3D view, that view's own region and its sidebar."""
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
    """Run an operator in the 3D view, as its button does."""
    window, area, main, _ = view()
    room, _, verb = operator.partition(".")
    with bpy.context.temp_override(window=window, area=area, region=main):
        run = getattr(getattr(bpy.ops, room), verb)
        return run("INVOKE_DEFAULT", **settings) if invoke else run(**settings)


def wait_for(condition: Callable[[], bool], seconds: float, what: str) -> Scenario:
    """Let the window live until a condition holds."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"{what} did not come about in {seconds:g} s")
        yield 0.1


def point_at(x: int, y: int) -> None:
    """Move the mouse."""
    subprocess.run(["xdotool", "mousemove", str(x), str(y)], check=True)


def click(x: int, y: int) -> None:
    """Click with the left button."""
    subprocess.Popen(["xdotool", "mousemove", str(x), str(y), "sleep", "0.2", "click", "1"])


def key(name: str) -> None:
    """Press a key over the 3D view."""
    subprocess.Popen(["xdotool", "key", name])


def redraw_ms(region: bpy.types.Region, times: int = 20) -> float:
    """Milliseconds that drawing a region takes."""
    window, area, _, _ = view()
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.wm.redraw_timer(type="DRAW", iterations=3)
        started = time.perf_counter()
        bpy.ops.wm.redraw_timer(type="DRAW", iterations=times)
    return (time.perf_counter() - started) / times * 1e3
