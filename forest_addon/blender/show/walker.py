"""A picture as a walker in the forest sees it: a place among the trees, and what grows around the feet.

Of many places and directions the walker takes those with most stems ahead, near ones above all, and none in
the way. Grass, ferns, bilberries and fallen leaves stand around for the picture alone: sensors do not meet
them, views do not show them. They are shipped species, in patches that are made once and then instanced.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

from ...base.rng import stream
from ...base.trimesh import TriMesh, join
from ...base.vectors import azimuth_of
from ...growth.library.species_file import find_species, load_species
from ...growth.tree import grow
from ..scene import materials
from ..scene.meshes import to_mesh
from ..scene.standings import IGNORED_KEY
from .preview import SUN

NAME = "Forest undergrowth"
EYE, LENS = 1.65, 27.0  # metres above the ground; millimetres
HALF_VIEW = math.radians(30.0)
SIDE, AHEAD, TURNS = 2.5, 45.0, 24  # metres between places, as far as stems count, directions
CLEAR, ROOM = 3.0, 6.5  # metres to any stem, and to those in view; twice that to shrubs
SHRUB = 5.0  # metres of height, below which a plant hides what is behind it
UP = 0.09  # how much the eye looks up, a metre forward
SUN_HEIGHT, SUN_ASIDE = math.radians(32.0), math.radians(105.0)  # to the right of straight ahead
FAR, FULL = 34.0, 9.0  # metres as far as anything grows, and as far as everything does
NEAR, THINNEST = 0.9, 0.2  # metres from the eye; share of what grows far away
CELL = 0.8  # metres between patches
PATCH = 0.55  # metres from the middle of a patch to its plants


@dataclass(frozen=True)
class Plant:
    """Undergrowth: plants of a patch, patches to choose from, and where it grows.

    share : of the ground. sort : which waves of the ground it follows. size : least and most.
    """

    species: str
    plants: int
    patches: int
    share: float
    sort: int
    size: tuple[float, float]


PLANTS = (
    Plant("grass", 16, 4, 0.52, 0, (0.6, 1.25)),
    Plant("bilberry", 14, 3, 0.38, 1, (0.7, 1.3)),
    Plant("fern", 1, 4, 0.10, 2, (0.6, 1.2)),
    Plant("litter", 1, 4, 0.16, 3, (0.7, 1.1)),
)


def walkers_view(
    stems: np.ndarray, tall: np.ndarray, middle: np.ndarray, reach: float
) -> tuple[np.ndarray, float]:
    """Place (2,) and direction, radians from +X, from which a walker sees most of a forest.

    stems : (N, 2) metres. tall : (N,) their heights. middle : (2,) of the field. reach : to its sides.
    """
    window = min(reach, 20.0) + ROOM
    some = np.abs(stems - middle).max(axis=1) < window + AHEAD
    near, tree = stems[some], tall[some] > SHRUB
    ticks = np.arange(-window, window + SIDE, SIDE)
    places = middle + np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    turn = 2 * np.pi * np.arange(TURNS) / TURNS
    if not len(near):
        return middle - [0.0, reach], np.pi / 2
    best = (-np.inf, places[0], 0.0)
    for place in places:
        offset = near - place
        far = np.hypot(offset[:, 0], offset[:, 1])
        if far.min() < CLEAR:
            continue
        azimuth = azimuth_of(offset)
        aside = np.abs((azimuth[None] - turn[:, None] + np.pi) % (2 * np.pi) - np.pi)
        seen = (aside < HALF_VIEW) & (far < AHEAD)
        weight = tree / (1 + (far / 14.0) ** 2)
        hidden = far < np.where(tree, ROOM, 2 * ROOM)
        crowd = (seen & hidden).sum(axis=1) + 2.0 * ((aside < 0.12) & (far < 9.0)).sum(axis=1)
        score = (seen * weight).sum(axis=1) - 0.5 * crowd
        if score.max() > best[0]:
            best = (float(score.max()), place, float(turn[score.argmax()]))
    return best[1], best[2]


def stand_walker(
    scene: bpy.types.Scene,
    stems: np.ndarray,
    tall: np.ndarray,
    middle: np.ndarray,
    reach: float,
    height: Callable[[np.ndarray], np.ndarray],
) -> None:
    """Move the scene's camera and sun to where a walker sees most, and grow what is around the feet.

    stems, tall, middle, reach : as of ``walkers_view``. height : of the ground (N,) at places (N, 2).
    """
    place, turn = walkers_view(stems, tall, middle, reach)
    way = np.array([math.cos(turn), math.sin(turn), UP])
    ground = float(np.nan_to_num(height(place[None]))[0])
    camera, sun = scene.camera, scene.objects[SUN]
    camera.location = (*place, ground + EYE)
    camera.rotation_euler = Vector(way).to_track_quat("-Z", "Y").to_euler()
    camera.data.lens, camera.data.clip_start = LENS, 0.05
    side = turn - SUN_ASIDE
    flat = math.cos(SUN_HEIGHT)
    light = Vector((flat * math.cos(side), flat * math.sin(side), math.sin(SUN_HEIGHT)))
    sun.rotation_euler = light.to_track_quat("Z", "Y").to_euler()
    grow_around(scene, place, turn, height)


def grow_around(
    scene: bpy.types.Scene,
    place: np.ndarray,
    turn: float,
    height: Callable[[np.ndarray], np.ndarray],
    reach: float = FAR,
) -> None:
    """Put patches of undergrowth, for the picture alone, where an eye sees the ground.

    place : (2,) of the eye, metres. turn : where it looks, radians from +X. height : of the ground (N,) at
    places (N, 2). reach : metres as far as anything grows.
    """
    home = bpy.data.collections.new(NAME)
    scene.collection.children.link(home)
    rng = stream(11, "undergrowth")
    cells = np.arange(-reach, reach, CELL)
    spots = np.stack(np.meshgrid(cells, cells), axis=-1).reshape(-1, 2)
    spots = spots + rng.uniform(-0.5, 0.5, spots.shape) * CELL
    far = np.hypot(spots[:, 0], spots[:, 1])
    aside = np.abs((azimuth_of(spots) - turn + np.pi) % (2 * np.pi) - np.pi)
    spots, far = (spots + place)[keep := (far > NEAR) & (far < reach) & (aside < 0.75)], far[keep]
    thinned = np.clip((reach - far) / (reach - FULL), THINNEST, 1.0)
    ground = height(spots)
    for plant in PLANTS:
        waves = _waves(spots, plant.sort)
        grows = (waves < np.quantile(waves, plant.share)) if len(waves) else np.empty(0, bool)
        grows &= (rng.random(len(spots)) < thinned) & np.isfinite(ground)
        patches = _patches(plant)
        for number in np.flatnonzero(grows):
            thing = bpy.data.objects.new(NAME, patches[int(rng.integers(len(patches)))])
            thing.location = (*spots[number], float(ground[number]) - 0.01)
            thing.rotation_euler.z = float(rng.uniform(0, 2 * np.pi))
            thing.scale = (float(rng.uniform(*plant.size)),) * 3
            thing[IGNORED_KEY] = thing.hide_viewport = thing.hide_select = True
            home.objects.link(thing)


def _waves(spots: np.ndarray, sort: int) -> np.ndarray:
    """(N,) numbers that change over metres, of their own for every sort of plant."""
    rng = stream(12, "waves", sort)
    total = np.zeros(len(spots))
    for wide in (9.0, 5.0, 2.6, 1.5):
        for _ in range(3):
            turn, phase = rng.uniform(0, 2 * np.pi, 2)
            along = spots @ [np.cos(turn), np.sin(turn)]
            total += wide**0.5 * np.sin(2 * np.pi * along / wide + phase)
    return total


def _patches(plant: Plant) -> list[bpy.types.Mesh]:
    """Meshes of patches, each of a few plants that were grown for it."""
    species, kind = load_species(find_species(plant.species, Path()))
    coats = materials.coats_of(species)
    made = []
    for number in range(plant.patches):
        rng = stream(13, plant.species, number)
        grown = [grow(species, kind, rng).mesh for _ in range(min(3, plant.plants))]
        parts = [
            _set_down(grown[k % len(grown)], rng, plant.plants > 1) for k in range(plant.plants)
        ]
        mesh = to_mesh(NAME, join(parts))
        for coat in coats:
            mesh.materials.append(coat)
        made.append(mesh)
    return made


def _set_down(mesh: TriMesh, rng: np.random.Generator, apart: bool) -> TriMesh:
    """A plant turned about the vertical, somewhere in its patch."""
    turn, size = rng.uniform(0, 2 * np.pi), rng.uniform(0.7, 1.15)
    cos, sin = size * np.cos(turn), size * np.sin(turn)
    matrix = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, size]])
    out = PATCH * np.sqrt(rng.random()) * apart
    around = rng.uniform(0, 2 * np.pi)
    foot = np.array([out * np.cos(around), out * np.sin(around), 0.0])
    return replace(mesh, vertices=mesh.vertices @ matrix.T + foot, edges=None)
