"""Rays a second of both engines, and beside them how far their hits are from float64 brute force.

Closed stands of one species, five variants: crowns that just touch. Rays are those of a tripod in the
middle, of a flight 200 m above, and from anywhere to anywhere (no two alike: the worst case). Time is CPU
time of one thread; of two threads, how much sooner they end on the clock.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from forest_addon.api import TriMesh

from ..inside import (
    OTHER,
    BvhCaster,
    EmbreeCaster,
    Hits,
    Kind,
    MovingCaster,
    MovingScene,
    RayCaster,
    RigidPath,
    Say,
    SceneGeometry,
    SceneMotion,
    Search,
    ShapePath,
    cast_exactly,
    embree_motion,
    find_species,
    grow,
    load_species,
    stream,
    typical_tree,
)
from ..scenes import scene_of, turned
from ..tables import median_seconds, table

TREES = {"20k": "whorl-8", "200k": "honda-broadleaf"}  # leaf-on, of about as many triangles
VARIANTS = 5
MEASURED = ("european-beech", "scots-pine", "norway-spruce")  # middle trees, among 1000
INSTANCES = (1, 100, 1000)
RAYS = {BvhCaster: 20_000, EmbreeCaster: 200_000}
CHECKED = 64  # rays of each kind against brute force

Rays = tuple[np.ndarray, np.ndarray]  # origins, directions


def say_rays(say: Say) -> None:
    """Print speed, cost and error by size of tree, number of instances and engine."""
    rows = []
    for size in TREES:
        meshes = grow_trees(size)
        for count in INSTANCES:
            scene = plant(meshes, count)
            exact = {
                kind: cast_exactly(scene, *rays) for kind, rays in _rays(scene, CHECKED).items()
            }
            for engine in (BvhCaster, EmbreeCaster):
                rows.append([f"{count} x {size}", *_measure(engine, scene, exact)])
    rows += [_measured_row(name) for name in MEASURED]
    head = ["trees", "engine", "tripod, rays/s", "flight, rays/s", "anywhere, rays/s"]
    head += ["two threads", "build, s"]
    head += ["error, median m", "99 %", "other surface", "missed"]
    table(say, head, rows)


def _measured_row(name: str) -> list[str]:
    """Embree among many middle trees of a measured species."""
    meshes = grow_trees(name)
    scene = plant(meshes, INSTANCES[-1])
    exact = {kind: cast_exactly(scene, *rays) for kind, rays in _rays(scene, CHECKED).items()}
    size = np.mean([len(mesh.triangles) for mesh in meshes]) / 1000
    trees = f"{INSTANCES[-1]} x {name}, {size:,.0f}k"
    return [trees, *_measure(EmbreeCaster, scene, exact)]


def grow_trees(size: str) -> list[TriMesh]:
    """Trees of about a size, or middle trees of a measured species, with all their leaves."""
    name = TREES.get(size, size)
    species, template = load_species(find_species(name, Path()))
    wanted = None
    if species.targets is not None and isinstance(template, Kind):
        wanted = typical_tree(species.targets, template.allometry, name)
    return [grow(species, template, stream(1, "bench", n), wanted).mesh for n in range(VARIANTS)]


def _measure(engine: type[Search], scene: SceneGeometry, exact: dict[str, Hits]) -> list[str]:
    start = time.process_time()
    caster = engine(scene)
    checked = {kind: caster.cast(*rays) for kind, rays in _rays(scene, CHECKED).items()}
    build = time.process_time() - start  # BVHTree builds the meshes that rays come to

    many = _rays(scene, RAYS[engine])
    speeds = [
        f"{len(rays[0]) / median_seconds(lambda r=rays: caster.cast(*r)):,.0f}"
        for rays in many.values()
    ]
    sooner = "-"
    if engine is EmbreeCaster:
        two = EmbreeCaster(scene, threads=2)
        sooner = f"{_clock(caster, many['tripod']) / _clock(two, many['tripod']):.2f}"
    return [
        caster.engine,
        *speeds,
        sooner,
        f"{build:.2f}",
        *_errors(list(checked.values()), list(exact.values())),
    ]


def _errors(found: list[Hits], exact: list[Hits]) -> list[str]:
    """Distance error on the same triangle; shares of other triangles and of misses on one side."""
    distance, other, missed, count = [], 0, 0, 0
    for ours, truth in zip(found, exact, strict=True):
        same = (ours.instance == truth.instance) & (ours.triangle == truth.triangle) & truth.found
        distance.append(np.abs(ours.distance[same] - truth.distance[same]))
        missed += np.count_nonzero(ours.found != truth.found)
        other += np.count_nonzero(ours.found & truth.found & ~same)
        count += len(same)
    error = np.concatenate(distance)
    median, tail = np.quantile(error, [0.5, 0.99]) if len(error) else (np.nan, np.nan)
    return [f"{median:.0e}", f"{tail:.0e}", f"{other} of {count}", f"{missed} of {count}"]


def _clock(caster: Search, rays: Rays) -> float:
    taken = []
    for _ in range(5):
        start = time.perf_counter()
        caster.cast(*rays)
        taken.append(time.perf_counter() - start)
    return min(taken)


def plant(meshes: list[TriMesh], count: int) -> SceneGeometry:
    """Trees on a square grid, shifted by up to a quarter of its step, each turned."""
    rng = stream(2, "bench", "stand", count)
    crown = np.mean([np.ptp(mesh.vertices[:, :2], axis=0).mean() for mesh in meshes])
    side = int(np.ceil(np.sqrt(count)))
    cell = np.stack(np.divmod(np.arange(count), side), axis=1)
    turn = rng.uniform(0, 2 * np.pi, count)
    place = crown * (cell + rng.uniform(-0.25, 0.25, (count, 2)))
    return scene_of(meshes, turned(place, turn))


def _rays(scene: SceneGeometry, count: int) -> dict[str, Rays]:
    rng = stream(3, "bench", "rays")
    low, high = (
        edge for edge in (scene.transform[:, :, 3].min(0), scene.transform[:, :, 3].max(0))
    )
    low, high = low[:2] - 3, high[:2] + 3

    lines = int(np.sqrt(count))
    azimuth, elevation = np.divmod(np.arange(count), lines)
    azimuth, elevation = 2 * np.pi * azimuth / lines, np.deg2rad(-30 + 110 * elevation / lines)
    around = np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ],
        axis=1,
    )
    middle = np.broadcast_to([*(low + high) / 2 + 1.3, 1.6], (count, 3))

    line, pulse = np.divmod(np.arange(count), lines)
    angle = np.deg2rad(-15 + 30 * pulse / lines)
    down = np.stack([np.sin(angle), np.zeros(count), -np.cos(angle)], axis=1)
    across = rng.uniform(low, high, (count, 2))
    across[:, 1] = low[1] + (high[1] - low[1]) * line / lines
    above = np.column_stack([across, np.zeros(count)]) - 200 * down / np.abs(down[:, 2:])

    start = np.column_stack([rng.uniform(low, high, (count, 2)), np.full(count, 1.6)])
    end = np.column_stack([rng.uniform(low, high, (count, 2)), rng.uniform(0, 9, count)])
    return {"tripod": (middle, around), "flight": (above, down), "anywhere": (start, end - start)}


# Rays a second where some bodies of a scene move, beside where none does, and their error against
# float64.
#
# 400 bumpy bodies of 7,000 triangles, some of which go 1 m and turn by 1 rad within 1 s, or are drawn out
# to 1.5 times their height meanwhile; rays from the middle into every direction, each at a time of its
# own, no two alike: the worst case. Time is CPU time of one thread.


BODIES = 400
MOVING = (1, 10, 40)
BENDING = 10
SIDES = 60  # of a body
MOVING_RAYS = {BvhCaster: 20_000, EmbreeCaster: 200_000}
MOVING_CHECKED = 100  # rays towards bodies that move, each against the scene as it is at its time


def say_moving(say: Say) -> None:
    """Print how much longer rays take where bodies move, and their error."""
    say(f"\nOf {BODIES} bodies some move, or bend as well; each ray has a time of its own:\n")
    scene, rows = _bodies(), []
    for engine, count in MOVING_RAYS.items():
        for moving, bending in [*((moving, 0) for moving in MOVING), (BENDING, BENDING)]:
            some = _moving(scene, _motion(scene, moving, bending), engine, count)
            rows.append([f"{moving}", f"{bending}", engine.engine, *some])
    head = ["moving", "bending", "engine", "still, rays/s", "moving, rays/s", "times", "error, m"]
    table(say, head, rows)


def _moving(
    scene: SceneGeometry,
    motion: SceneMotion,
    make: Callable[[SceneGeometry], RayCaster],
    count: int,
) -> list[str]:
    rng = stream(1, "bench", len(motion.paths))
    ways, time = rng.normal(size=(count, 3)), rng.uniform(0, 1, count)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    origins = np.zeros((count, 3))
    engine = embree_motion if make is EmbreeCaster else None
    still, caster = make(scene), MovingCaster(MovingScene(scene, motion), make, engine)
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
    number, time = rng.integers(len(paths), size=MOVING_CHECKED), rng.uniform(0, 1, MOVING_CHECKED)
    place = np.array([paths[n].at(t[None])[0] for n, t in zip(number, time, strict=True)])
    ways = place[:, :, 3] + rng.uniform(-0.5, 0.5, (MOVING_CHECKED, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    origins = np.zeros((MOVING_CHECKED, 3))
    found = caster.cast(origins, ways, time=time)
    worst = 0.0
    for row in range(MOVING_CHECKED):
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
    transforms = np.repeat(transform[None], len(time), axis=0)
    transforms[:, 0, 3] += time
    transforms[:, 0, 0] = transforms[:, 1, 1] = np.cos(time)
    transforms[:, 1, 0] = np.sin(time)
    transforms[:, 0, 1] = -np.sin(time)
    return RigidPath(time, transforms)


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
