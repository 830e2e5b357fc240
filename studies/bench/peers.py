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
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import bpy  # noqa: F401  where Blender is a module, it brings mathutils
import numpy as np
from mathutils import Matrix, Vector
from mathutils.bvhtree import BVHTree

from ..inside import (
    BvhCaster,
    EmbreeCaster,
    Say,
    SceneGeometry,
    Search,
    apply_transform,
    cast_exactly,
    environment_of_child,
)
from ..tables import table, timed
from .lidar_rays import grow_trees, plant

TITLE = "peers: the same scan by other programs"
COUNTS = 180, 560  # zenith angles, azimuths
JOBS = ((1, "200k"), (20, "20k"))
CHECKED = 64  # points of each against brute force
HEIGHT = 1.6  # m
PYTHON = "PYHELIOS_PYTHON"  # the environment's name for a Python that has the peer
INSTALL = (
    "PyHelios3D is not here: make an environment with `python -m venv peer`, install it with "
    f"`peer/bin/pip install pyhelios3d`, and run again with {PYTHON}=peer/bin/python."
)

Took = tuple[
    float, float, np.ndarray
]  # CPU s of set-up and first scan, of a later one, points (P, 3)


def run(say: Say) -> None:
    """Print one table; the peers that are not here are named with how to get them."""
    rows = []
    peer = _peer_python()
    for count, size in JOBS:
        scene = plant(grow_trees(size), count)
        low, high = (edge(scene.transform[:, :2, 3], axis=0) for edge in (np.min, np.max))
        origin = np.array([*(low + high) / 2 + 1.3, HEIGHT])
        ways = _ways()
        found: dict[str, Took] = {}
        if peer:
            found["PyHelios3D"] = _by_helios(peer, scene, origin)
        found["loop over ray_cast"] = _by_loop(scene, origin, ways)
        found["ours, BVHTree"] = _ours(BvhCaster, scene, origin, ways)
        found["ours, Embree"] = _ours(EmbreeCaster, scene, origin, ways)
        for name, (first, again, points) in found.items():
            ratios = [
                f"{first / other[0]:.1f}x, {again / other[1]:.1f}x"
                for other in (found["ours, BVHTree"], found["ours, Embree"])
            ]
            error = _errors(scene, origin, points)
            rows.append([f"{count} x {size}", name, f"{first:.2f}", f"{again:.2f}", *ratios])
            rows[-1] += [f"{len(points):,}", *error]
    say(
        f"{COUNTS[0] * COUNTS[1]:,} rays of a tripod; CPU seconds of one thread, imports not counted\n"
    )
    head = ["trees", "program", "set-up and first scan, s", "again, s"]
    head += ["over our BVHTree, first and again", "over our Embree"]
    table(say, [*head, "points", "error, median m", "largest"], rows)
    if not peer:
        say(f"\n{INSTALL}")


def _peer_python() -> str:
    """A Python that has PyHelios3D; empty where none is known."""
    if importlib.util.find_spec("pyhelios") is not None:
        return sys.executable
    return os.environ.get(PYTHON, "")


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


def _by_helios(python: str, scene: SceneGeometry, origin: np.ndarray) -> Took:
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


def _by_loop(scene: SceneGeometry, origin: np.ndarray, ways: np.ndarray) -> Took:
    start = time.process_time()
    trees: dict[int, BVHTree] = {}
    for index in np.unique(scene.mesh_index).tolist():
        mesh = scene.meshes[index]
        trees[index] = BVHTree.FromPolygons(mesh.vertices.tolist(), mesh.triangles.tolist())
    things = []
    for place, mesh in zip(scene.transform, scene.mesh_index.tolist(), strict=True):
        world = Matrix([*place.tolist(), [0, 0, 0, 1]])
        things.append((trees[mesh], world, world.inverted()))

    def scan() -> list[Vector]:
        points = []
        at = Vector(origin)
        for way in map(Vector, ways.tolist()):
            nearest, point = np.inf, None
            for tree, world, local in things:
                location = tree.ray_cast(local @ at, local.to_3x3() @ way)[0]
                if location is not None:
                    hit = world @ location
                    distance = (hit - at).length
                    if distance < nearest:
                        nearest, point = distance, hit
            if point is not None:
                points.append(point)
        return points

    return _twice(start, scan)


def _ours(engine: type[Search], scene: SceneGeometry, origin: np.ndarray, ways: np.ndarray) -> Took:
    start = time.process_time()
    caster = engine(scene)
    origins = np.broadcast_to(origin, ways.shape)

    def scan() -> np.ndarray:
        hits = caster.cast(origins, ways)
        return origin + hits.distance[hits.found, None] * ways[hits.found]

    return _twice(start, scan)


def _twice(start: float, scan: Callable[[], Any]) -> Took:
    """CPU seconds since the start of the set-up to the end of a scan, those of another, and its points."""
    scan()
    first = time.process_time() - start
    found, again = timed(scan)
    return first, again, np.array(found).reshape(-1, 3)


def _errors(scene: SceneGeometry, origin: np.ndarray, points: np.ndarray) -> list[str]:
    """Median and largest error of the distance of some points, of those whose ray meets something."""
    some = points[:: max(1, len(points) // CHECKED)].astype(np.float64)
    away = some - origin
    exact = cast_exactly(scene, np.broadcast_to(origin, away.shape), away)
    error = np.abs(np.linalg.norm(away, axis=1) - exact.distance)[exact.found]
    return [f"{np.median(error):.0e}", f"{error.max(initial=0.0):.0e}"]
