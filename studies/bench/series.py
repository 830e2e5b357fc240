"""Cost of a scene in a series: a fresh process runs one after the other, each with a seed of its own.

Imports stand apart. The first scene is cold; the next ones find what it has made. Error is what a run's audit
finds of its own rays.
"""

from __future__ import annotations

import json
from functools import partial
from importlib import import_module
from itertools import count as counting
from pathlib import Path
from tempfile import TemporaryDirectory

from .rows import BenchRow, Rows

TITLE = "series: one scene after the other in a process"
WORDS = """\
40 trees, one terrestrial scanner, a seed for each scene; how many: pulses. Imports: first is what counts.
"""
STAND = """
[forest]
size = [40, 40]
[[plantings]]
species = "spruce"
variants = 4
expected = 40
exact = true
[[sensors]]
kind = "terrestrial"
name = "cloud"
position = [20, 20, 1.6]
angle_step_deg = {step}
[output]
blend = false
glb = false
preview = false
"""
BARE = "pictures = false\ngoodness = false\nleaves = false\nreport = false\n"


def _blender() -> BenchRow:
    return BenchRow(lambda: import_module("bpy"))


def _own() -> BenchRow:
    import_module("bpy")
    return BenchRow(lambda: import_module("..inside", __package__).run_scene)


def _run(step: float, output: str) -> BenchRow:
    from ..inside import pattern_of, read_scene, run_scene

    folder, seeds = TemporaryDirectory(), counting()  # which is there as long as the work
    path = Path(folder.name) / "scene.toml"
    path.write_text(STAND.format(step=step) + output)

    def work() -> float:
        out = Path(folder.name) / "out"
        run_scene(read_scene(path, next(seeds)), path.parent, out, quiet=True)
        return json.loads((out / "run.json").read_text())["sensors"]["cloud"]["audit"]["error"]

    many = pattern_of(read_scene(path, 0).sensors[0]).count
    return BenchRow(work, lambda error: f"{error:.0e} m", many)


ROWS: Rows = {
    "import of Blender": _blender,
    "own imports": _own,
    "all off in [output]": partial(_run, 0.659, BARE),
    "pictures, tests of the stand, leaves, report": partial(_run, 0.659, ""),
    "all off, 1 pulse in 100": partial(_run, 6.59, BARE),
}
