"""Rays a second where some bodies of a scene move, beside where none does, and their error against float64.

400 bumpy bodies of 7,000 triangles, some of which go 1 m and turn by 1 rad within 1 s, or are drawn out to
1.5 times their height meanwhile; rays from the middle into every direction, each at a time of its own, no two
alike: the worst case. Time is CPU time of one thread.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from forest_addon.base.progress import Say
from forest_addon.base.rng import stream
from forest_addon.base.trimesh import OTHER, TriMesh
from forest_addon.blender.rays.bvh import BvhCaster
from forest_addon.blender.rays.embree import EmbreeCaster
from forest_addon.blender.rays.embree_parts import embree_parts
from forest_addon.sensing.rays.caster import RayCaster
from forest_addon.sensing.rays.exact import cast_exactly
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.rays.moving import MovingCaster
from forest_addon.sensing.rays.paths import RigidPath, SceneMotion, ShapePath

from ..tables import median_seconds, table

BODIES = 400
MOVING = (1, 10, 40)
BENDING = 10
SIDES = 60  # of a body
RAYS = {BvhCaster: 20_000, EmbreeCaster: 200_000}
CHECKED = 100  # rays towards bodies that move, each against the scene as it is at its time


def run(say: Say) -> None:
    """Print how much longer rays take where bodies move, and their error."""
    say(f"\nOf {BODIES} bodies some move, or bend as well; each ray has a time of its own:\n")
    scene, rows = _bodies(), []
    for engine, count in RAYS.items():
        for moving, bending in [*((moving, 0) for moving in MOVING), (BENDING, BENDING)]:
            some = _measure(scene, _motion(scene, moving, bending), engine, count)
            rows.append([f"{moving}", f"{bending}", engine.engine, *some])
    head = ["moving", "bending", "engine", "still, rays/s", "moving, rays/s", "times", "error, m"]
    table(say, head, rows)


def _measure(
    scene: SceneGeometry,
    motion: SceneMotion,
    make: Callable[[SceneGeometry], RayCaster],
    count: int,
) -> list[str]:
    rng = stream(1, "bench", len(motion.paths))
    ways, time = rng.normal(size=(count, 3)), rng.uniform(0, 1, count)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    origins = np.zeros((count, 3))
    engine = embree_parts if make is EmbreeCaster else None
    still, caster = make(scene), MovingCaster(scene, motion, make, engine)
    still.cast(origins, ways)
    caster.cast(origins, ways, time=time)
    before = median_seconds(lambda: still.cast(origins, ways))
    after = median_seconds(lambda: caster.cast(origins, ways, time=time))
    off = _error(caster, motion)
    return [f"{count / before:,.0f}", f"{count / after:,.0f}", f"{after / before:.2f}", off]


def _error(caster: MovingCaster, motion: SceneMotion) -> str:
    """Largest error of a distance; infinite where another body is met, or none."""
    paths = motion.paths
    rng = stream(2, "bench", len(paths))
    number, time = rng.integers(len(paths), size=CHECKED), rng.uniform(0, 1, CHECKED)
    place = np.array([paths[n].at(t[None])[0] for n, t in zip(number, time, strict=True)])
    ways = place[:, :, 3] + rng.uniform(-0.5, 0.5, (CHECKED, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    origins = np.zeros((CHECKED, 3))
    found = caster.cast(origins, ways, time=time)
    worst = 0.0
    for row in range(CHECKED):
        now = caster.scene.transform.copy()
        for part, path in paths.items():
            now[part] = path.at(time[row, None])[0]
        body = caster.scene.meshes[0]
        shape = motion.shapes.get(0)
        meshes = [body]
        if shape is not None:  # all that bend do alike
            every = np.arange(len(body.vertices))[None]
            meshes.append(replace(body, vertices=shape.at(every, time[row, None])[0]))
        scene = _scene(tuple(meshes), now, len(motion.shapes))
        truth = cast_exactly(scene, origins[:1], ways[row, None])
        same = truth.instance[0] == found.instance[row]
        off = abs(truth.distance[0] - found.distance[row]) if same else np.inf
        worst = max(worst, float(off))
    return f"{worst:.0e}"


def _motion(scene: SceneGeometry, moving: int, bending: int) -> SceneMotion:
    time, body = np.linspace(0, 1, 25), scene.meshes[0].vertices.astype(np.float32)
    drawn = np.repeat(body[None], len(time), axis=0)
    drawn[:, :, 2] *= 1 + time[:, None].astype(np.float32) / 2
    shape = ShapePath(time, drawn)
    paths = {number: _path(scene.transform[number]) for number in range(moving)}
    return SceneMotion(paths, dict.fromkeys(range(bending), shape))


def _path(transform: np.ndarray) -> RigidPath:
    time = np.linspace(0, 1, 25)
    found = np.repeat(transform[None], len(time), axis=0)
    found[:, 0, 3] += time
    found[:, 0, 0] = found[:, 1, 1] = np.cos(time)
    found[:, 1, 0] = np.sin(time)
    found[:, 0, 1] = -np.sin(time)
    return RigidPath(time, found)


def _bodies() -> SceneGeometry:
    round_, up = np.meshgrid(
        np.linspace(0, 2 * np.pi, SIDES), np.linspace(0, np.pi, SIDES), indexing="ij"
    )
    ball = [np.cos(round_) * np.sin(up), np.sin(round_) * np.sin(up), np.cos(up)]
    bumps = 1 + 0.1 * np.sin(7 * round_) * np.sin(5 * up)
    vertices = np.stack([bumps * x for x in ball], axis=-1).reshape(-1, 3)
    i = (np.arange(SIDES - 1)[:, None] * SIDES + np.arange(SIDES - 1)).ravel()
    lower = np.stack([i, i + 1, i + SIDES], axis=1)
    upper = np.stack([i + 1, i + SIDES + 1, i + SIDES], axis=1)
    triangles = np.concatenate([lower, upper])
    count = len(triangles)
    mesh = TriMesh(
        vertices,
        triangles,
        part=np.full(count, OTHER, np.int8),
        leaf=np.full(count, -1),
        material=np.zeros(count, np.int64),
    )
    transform = np.repeat(np.eye(3, 4)[None], BODIES, axis=0)
    transform[:, :, 3] = stream(3, "bench").uniform(-40, 40, (BODIES, 3))
    return _scene((mesh,), transform)


def _scene(meshes: tuple[TriMesh, ...], transform: np.ndarray, bent: int = 0) -> SceneGeometry:
    index = np.zeros(len(transform), np.int64)
    index[:bent] = len(meshes) - 1
    none = np.full(len(transform), -1)
    names = tuple("body" for _ in transform)
    return SceneGeometry(meshes, transform, index, names, none, none)
