"""Cost of a scene in a series: a fresh process runs one after the other, each with a seed of its own.

Imports are named apart and find their bytecode, the first scene is cold; of the later ones the median
counts. Error is what each run's audit finds of its own rays.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from ..inside import Say, environment_of_child
from ..tables import table

TITLE = "series: one scene after the other in a process"
LATER = 2  # scenes after the first
STAND = """
[forest]
size = [40, 40]
[[plantings]]
species = "{species}"
variants = {variants}
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
# what is in the row, species, variants, degrees between pulses, what is written
CASES = (
    ("all off in [output]", "spruce", 4, 0.659, BARE),
    ("pictures, tests of the stand, leaves, report", "spruce", 4, 0.659, ""),
    ("all off, 1 pulse in 100", "spruce", 4, 6.59, BARE),
)


def run(say: Say) -> None:
    """Print one table."""
    say("40 trees, one terrestrial scanner, a seed for each scene; CPU seconds of the process\n")
    rows = []
    for name, species, variants, step, output in CASES:
        scene = STAND.format(species=species, variants=variants, step=step) + output
        with TemporaryDirectory() as folder:
            # compiled once and kept, as where the package is installed
            environment = environment_of_child(OMP_NUM_THREADS="1", PYTHONPYCACHEPREFIX=folder)
            environment.pop("PYTHONDONTWRITEBYTECODE", None)
            path = Path(folder) / "scene.toml"
            path.write_text(scene)
            words = [sys.executable, "-m", __name__, str(path)]
            subprocess.run(words[:3], check=True, env=environment)
            told = subprocess.run(
                words, capture_output=True, text=True, check=True, env=environment
            ).stdout
        blender, own, first, later, pulses, error = told.split()[-6:]
        rows.append([name, f"{int(pulses):,}", blender, own, first, later, error])
    head = ["written", "pulses", "import of Blender, s", "own imports, s"]
    table(say, [*head, "first scene, s", "later, s", "largest error, m"], rows)


def measure(path: Path | None) -> None:
    """Print the CPU seconds of this process by stage, and the pulses and the error of its scans.

    path : of the scene; None imports what a run imports, and ends.
    """
    start = time.process_time()
    import bpy  # noqa: F401

    blender = time.process_time()
    from ..inside import read_scene, run_scene

    own = time.process_time()
    if path is None:
        return
    taken, errors = [], []
    for seed in range(1 + LATER):
        began = time.process_time()
        run_scene(read_scene(path, seed), path.parent, path.parent / "out", quiet=True)
        taken.append(time.process_time() - began)
        record = json.loads((path.parent / "out" / "run.json").read_text())
        errors.append(record["sensors"]["cloud"]["audit"]["error"])

    from ..inside import pattern_of

    pulses = pattern_of(read_scene(path, 0).sensors[0]).count
    print(
        f"{blender - start:.2f} {own - blender:.2f} {taken[0]:.2f} {statistics.median(taken[1:]):.2f}"
    )
    print(pulses, f"{max(errors):.0e}")


if __name__ == "__main__":
    measure(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
