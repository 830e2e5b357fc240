"""Forests of many trees in Blender: time and memory to build, read back, scan, save and open them.

Each size runs in a process of its own, because a process has one peak of memory. The error is how far the
evaluated instances stand from the plan, and how many trees are missing or bear another number. The first
chunk is that of an airborne strip, with all that it needs of the scene.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from forest_addon import spec
from forest_addon.base.places import environment_of_child
from forest_addon.base.progress import Say
from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.stand.forest import GrownForest, grow_forest
from headless.memory import peak_memory_mb

from ..tables import table

TITLE = "stand_scene: forests of 20 maples in Blender, by number of trees"
SIZES = (("points", 1_000), ("points", 10_000), ("points", 100_000), ("objects", 1_000))
VARIANTS, ROOM = 20, 25.0  # m² a tree


def run(say: Say) -> None:
    """Print CPU seconds, peak memory and errors by number of trees."""
    rows = []
    for instancing, count in SIZES:
        words = [sys.executable, "-m", __name__, instancing, str(count)]
        ended = subprocess.run(
            words, capture_output=True, text=True, check=True, env=environment_of_child()
        )
        told = json.loads(ended.stdout.strip().splitlines()[-1])
        seconds = (f"{told[key]:.2f}" for key in ("grow", "build", "evaluate", "read", "strip"))
        files = (f"{told[key]:.2f}" for key in ("save", "open"))
        sizes = (f"{told['peak']:.2f}", f"{told['size']:.0f}")
        error = (f"{told['error']:.0e}", f"{told['wrong']:.0f}")
        shown = (f"{told['trees']:,}", instancing, f"{told['triangles']:,}")
        rows.append([*shown, *seconds, *files, *sizes, *error])
    times = [
        "grow, s",
        "build, s",
        "evaluate, s",
        "read, s",
        "first chunk, s",
        "save, s",
        "open, s",
    ]
    head = ["trees", "as", "triangles shown", *times, "peak, GB", "file, MB"]
    table(say, [*head, "largest error, m", "wrong numbers"], rows)


def measure(instancing: str, count: int) -> dict[str, float]:
    """Build, evaluate, read, scan, save and open one forest: CPU seconds, GB, MB, metres."""
    import bpy

    from forest_addon.blender.files.export import save_blend
    from forest_addon.blender.files.opening import empty_file, open_file
    from forest_addon.blender.scene.forest import build
    from forest_addon.blender.sensors.observe import Observer
    from forest_addon.sensing.kinds import choose
    from forest_addon.sensing.lidar.scan import Scan

    empty_file()
    told: dict[str, float] = {}
    start = time.process_time()

    def lap(name: str) -> None:
        nonlocal start
        told[name] = time.process_time() - start
        start = time.process_time()

    settings, forest = _forest(instancing, count)
    lap("grow")
    build(bpy.context.scene, settings, forest)
    lap("build")
    depsgraph = bpy.context.evaluated_depsgraph_get()
    lap("evaluate")
    observer = Observer(depsgraph)
    geometry = observer.geometry
    lap("read")
    strip, _ = choose(spec.Airborne(name="strip"))
    next(iter(Scan(strip, observer.eyes(strip), 0).chunks()))
    lap("strip")
    faces = np.array([len(mesh.triangles) for mesh in geometry.meshes])
    told |= {"trees": len(forest.stand), "triangles": int(faces[geometry.mesh_index].sum())}
    told |= _errors(geometry, forest)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "forest.blend"
        start = time.process_time()
        save_blend(path)
        lap("save")
        told["size"] = path.stat().st_size / 1e6
        open_file(path)
        bpy.context.evaluated_depsgraph_get()
        lap("open")
    told["peak"] = (peak_memory_mb() or 0.0) / 1024
    return told


def _forest(instancing: str, count: int) -> tuple[spec.Scene, GrownForest]:
    side = float(np.sqrt(ROOM * count))
    settings = spec.Scene(
        seed=4,
        forest=spec.Forest(size=(side, side), instancing=instancing),
        plantings=(spec.Planting(species="maple", variants=VARIANTS, expected=count, exact=True),),
    )
    return settings, grow_forest(settings, [load_species(find_species("maple", Path()))])


def _errors(geometry, forest: GrownForest) -> dict[str, float]:
    """Of the evaluated scene against the plan."""
    trees = np.flatnonzero(geometry.tree >= 0)
    number = geometry.tree[trees]
    offset = geometry.transform[trees] - forest.transforms()[number]
    missing = len(forest.stand) - len(np.unique(number))
    other = np.count_nonzero(geometry.species[trees] != forest.stand.species[number])
    return {"error": float(np.abs(offset).max()), "wrong": float(missing + other)}


if __name__ == "__main__":
    print(json.dumps(measure(sys.argv[1], int(sys.argv[2]))))
