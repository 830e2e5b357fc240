"""The same scan by other programs beside ours: times, their ratio, and everybody's error.

A tripod's rays, one a pulse, go through one tree and through a small stand. PyHelios3D (its own ray tracing)
runs where a Python has it; a plain loop over ``BVHTree.ray_cast``, ray by ray and object by object as
scanners written as add-ons do, runs everywhere. Errors are those of the distances of points against
float64 brute force along the ray through the point.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import bpy  # noqa: F401  where Blender is a module, it brings mathutils
import numpy as np
from mathutils import Matrix, Vector
from mathutils.bvhtree import BVHTree

from ..inside import (
    BvhCaster,
    EmbreeCaster,
    ExactCaster,
    Say,
    SceneGeometry,
    Search,
    apply_transform,
    environment_of_child,
)
from ..tables import table
from .lidar import grow_trees, plant
from .rows import BenchRow, Rows

TITLE = "peers: the same scan by other programs"
COUNTS = 180, 560  # zenith angles, azimuths
JOBS = ((1, "200k"), (20, "20k"))
CHECKED = 64  # points of each against brute force
HEIGHT = 1.6  # m
PYTHON = "PYHELIOS_PYTHON"  # the environment's name for a Python that has the peer
WORDS = f"""\
{COUNTS[0] * COUNTS[1]:,} rays of a tripod; first: the set-up and a scan. Errors: of the distances of points.
"""
INSTALL = (
    "PyHelios3D is not here: make an environment with `python -m venv peer`, install it with "
    f"`peer/bin/pip install pyhelios3d`, and run again with {PYTHON}=peer/bin/python."
)


def run(say: Say, _: object) -> None:
    """Print what PyHelios3D takes, or how to get it."""
    peer = sys.executable if importlib.util.find_spec("pyhelios") else os.environ.get(PYTHON, "")
    if not peer:
        say(f"\n{INSTALL}")
        return
    rows = []
    for count, size in JOBS:
        scene, origin = _scene(count, size)
        first, again, points = _by_helios(peer, scene, origin)
        error = _error(scene, origin, points)
        rows.append([f"{count} x {size}, PyHelios3D", f"{first:.2f}", f"{again:.2f}", error])
    say("")
    table(say, ["job", "first, s", "next, s", "error"], rows)


def _scene(count: int, size: str) -> tuple[SceneGeometry, np.ndarray]:
    """Trees, and where the tripod stands."""
    scene = plant(grow_trees(size), count)
    low, high = (edge(scene.transform[:, :2, 3], axis=0) for edge in (np.min, np.max))
    return scene, np.array([*(low + high) / 2 + 1.3, HEIGHT])


def _ways() -> np.ndarray:
    """(R, 3) unit vectors at equal steps of zenith angle and azimuth."""
    zenith = np.linspace(0.0, 2.0, COUNTS[0])[:, None]
    azimuth = np.linspace(0.0, 2 * np.pi, COUNTS[1])
    ways = [
        np.sin(zenith) * np.cos(azimuth),
        np.sin(zenith) * np.sin(azimuth),
        np.cos(zenith) + 0 * azimuth,
    ]
    return np.stack(ways, axis=2).reshape(-1, 3)


def _by_helios(
    python: str, scene: SceneGeometry, origin: np.ndarray
) -> tuple[float, float, np.ndarray]:
    """CPU seconds of the set-up and a first scan, those of another, and points (P, 3)."""
    vertices, triangles, first = [], [], 0
    for place, mesh in zip(scene.transform, scene.mesh_index, strict=True):
        tree = scene.meshes[mesh]
        vertices.append(apply_transform(place, tree.vertices))
        triangles.append(tree.triangles + first)
        first += len(tree.vertices)
    with TemporaryDirectory() as folder:
        job, points = Path(folder) / "job.npz", Path(folder) / "points.npz"
        np.savez(
            job,
            vertices=np.concatenate(vertices),
            triangles=np.concatenate(triangles).astype(np.int32),
            origin=origin,
            counts=COUNTS,
        )
        words = [python, str(Path(__file__).with_name("helios_scan.py")), str(job), str(points)]
        environment = environment_of_child(OMP_NUM_THREADS="1")
        done = subprocess.run(words, capture_output=True, text=True, check=True, env=environment)
        times = [float(word) for word in done.stdout.split()[-2:]]
        return times[0], times[1], np.load(points)["points"]


def _trees(scene: SceneGeometry) -> list[tuple[BVHTree, Matrix, Matrix]]:
    """Each tree as an add-on finds it: its own BVHTree, its place and the way back."""
    trees = {
        index: BVHTree.FromPolygons(
            scene.meshes[index].vertices.tolist(), scene.meshes[index].triangles.tolist()
        )
        for index in np.unique(scene.mesh_index).tolist()
    }
    worlds = [Matrix([*place.tolist(), [0, 0, 0, 1]]) for place in scene.transform]
    return [
        (trees[mesh], world, world.inverted())
        for world, mesh in zip(worlds, scene.mesh_index.tolist(), strict=True)
    ]


def _by_loop(count: int, size: str) -> BenchRow:
    scene, origin = _scene(count, size)
    at, ways = Vector(origin), [Vector(way) for way in _ways().tolist()]
    trees = cache(lambda: _trees(scene))

    def scan() -> np.ndarray:
        points = []
        for way in ways:
            nearest, point = np.inf, None
            for tree, world, local in trees():
                location = tree.ray_cast(local @ at, local.to_3x3() @ way)[0]
                if location is not None and (world @ location - at).length < nearest:
                    point = world @ location
                    nearest = (point - at).length
            if point is not None:
                points.append(point)
        return np.array(points).reshape(-1, 3)

    return BenchRow(scan, partial(_error, scene, origin), len(ways))


def _ours(engine: type[Search], count: int, size: str) -> BenchRow:
    scene, origin = _scene(count, size)
    ways, caster = _ways(), cache(lambda: engine(scene))
    origins = np.broadcast_to(origin, ways.shape)

    def scan() -> np.ndarray:
        hits = caster().cast(origins, ways)
        return origin + hits.distance[hits.found, None] * ways[hits.found]

    return BenchRow(scan, partial(_error, scene, origin), len(ways))


def _error(scene: SceneGeometry, origin: np.ndarray, points: np.ndarray) -> str:
    """Median and largest error of the distance of some points, of those whose ray meets something."""
    some = points[:: max(1, len(points) // CHECKED)].astype(np.float64)
    away = some - origin
    exact = ExactCaster(scene).cast(np.broadcast_to(origin, away.shape), away)
    error = np.abs(np.linalg.norm(away, axis=1) - exact.distance)[exact.found]
    return f"{np.median(error):.0e} m, at most {error.max(initial=0.0):.0e}; {len(points):,} points"


WAYS = {
    "loop over ray_cast": _by_loop,
    "ours, BVHTree": partial(_ours, BvhCaster),
    "ours, Embree": partial(_ours, EmbreeCaster),
}
ROWS: Rows = {
    f"{count} x {size}, {name}": partial(way, count, size)
    for count, size in JOBS
    for name, way in WAYS.items()
}
