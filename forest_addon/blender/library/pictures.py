"""Pictures of grown trees by Cycles: contact sheets and close-ups.

On a sheet trees hang in a grid before an orthographic camera that looks slightly down on them; the
background stays transparent. ``SheetCell`` says where each came to stand in the picture, so that labels
can be drawn below. Close-ups show a fork, the bark of the stem, a twig against the light.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import bpy
import numpy as np
from mathutils import Vector

from ... import spec
from ...base.progress import Progress
from ...base.rng import stream
from ...base.trimesh import TriMesh
from ...growth.skeleton import Skeleton
from ...growth.tree import Tree
from ..files.export import empty_file
from ..scene import materials
from ..scene.meshes import to_mesh
from ..scene.nodes import tree_of
from ..show.preview import SUN, grow_around, lay_horizon, render, set_stage

TILT = math.radians(7.0)
FIELD = (1.0, 1.28)  # width and height of a cell, Blender's units
ROOM = (0.90, 0.98)  # of a tree in its cell
DEEP = 0.5  # of its extent away from the eye, that counts as width
FOOT = 0.20  # of a tree above the lower edge of its cell, for a label


@dataclass(frozen=True)
class SheetCell:
    """A tree's place in the picture: its foot, in pixels from the upper left, and metres per pixel."""

    x: float
    y: float
    metres: float


def render_sheet(
    trees: Sequence[tuple[spec.Species, Tree]],
    columns: int,
    width: int,
    path: str | os.PathLike[str],
    samples: int = 16,
    progress: Progress | None = None,
    one_scale: bool = False,
) -> list[SheetCell]:
    """Render trees of species in rows; returns where each stands.

    width : of the picture, pixels. one_scale : all as large as the largest needs, not each as its cell
        allows.

    Raises
    ------
    OSError : the picture could not be written.
    """
    empty_file()
    scene = bpy.context.scene
    rows = max(math.ceil(len(trees) / columns), 1)
    pixels = width / (columns * FIELD[0])
    high = rows * FIELD[1]
    scene.render.resolution_x, scene.render.resolution_y = width, round(high * pixels)
    cells = []
    least = min((_fit(tree) for _, tree in trees), default=1.0)
    for number, (species, tree) in enumerate(trees):
        row, column = divmod(number, columns)
        x = (column + 0.5) * FIELD[0]
        up = high - (row + 1) * FIELD[1] + FOOT  # on the picture; the camera's tilt shortens z
        size = least if one_scale else _fit(tree)
        _hang(scene, species, tree, x, up / math.cos(TILT), size)
        cells.append(SheetCell(x * pixels, (high - up) * pixels, 1 / (size * pixels)))
    _aim(scene, columns * FIELD[0], high)
    _light(scene)
    scene.render.film_transparent = True
    scene.render.image_settings.color_mode = "RGBA"
    output = spec.Output(preview_samples=samples)
    render(scene, output, path, progress)
    return cells


def _fit(tree: Tree) -> float:
    """The scale at which a tree fills its cell."""
    corners = tree.mesh.vertices
    wide = max(float(np.ptp(corners[:, 0])), DEEP * float(np.ptp(corners[:, 1])), 1e-3)
    tall = max(float(corners[:, 2].max()), 1e-3)
    return float(min(ROOM[0] / wide, ROOM[1] / tall))


def _hang(
    scene: bpy.types.Scene,
    species: spec.Species,
    tree: Tree,
    x: float,
    z: float,
    size: float,
) -> None:
    """Put a tree with its foot at (x, 0, z), scaled to this size."""
    low, top = tree.mesh.vertices.min(axis=0), tree.mesh.vertices.max(axis=0)
    middle = (low[0] + top[0]) / 2
    above = tree.mesh.vertices * [1, 1, 0] + np.maximum(tree.mesh.vertices * [0, 0, 1], 0.0)
    mesh = _coated(species, replace(tree.mesh, vertices=above))  # without its sunk foot
    thing = bpy.data.objects.new(species.name, mesh)
    thing.scale = (size, size, size)
    thing.location = (x - middle * size, 0.0, z)
    scene.collection.objects.link(thing)


def _coated(species: spec.Species, mesh: TriMesh) -> bpy.types.Mesh:
    """A mesh in the bark and leaves of its species."""
    made = to_mesh(species.name, mesh)
    for material in materials.coats_of(species):
        made.materials.append(material)
    return made


def _aim(scene: bpy.types.Scene, wide: float, high: float) -> None:
    """A camera whose picture is (0..wide, 0..high) of the plane y = 0, seen slightly from above."""
    data = bpy.data.cameras.new("Sheet camera")
    data.type = "ORTHO"
    data.ortho_scale = max(wide, high)
    data.clip_end = 1000.0
    camera = bpy.data.objects.new("Sheet camera", data)
    middle = np.array([wide / 2, 0.0, high / 2 / math.cos(TILT)])
    back = np.array([0.0, -math.cos(TILT), math.sin(TILT)])
    camera.location = middle + 50.0 * back
    camera.rotation_euler = (math.pi / 2 - TILT, 0.0, 0.0)
    scene.collection.objects.link(camera)
    scene.camera = camera


def _light(scene: bpy.types.Scene) -> None:
    """Sun from the front left, so that no tree shades its neighbour much, and a bright sky."""
    data = bpy.data.lights.new("Sheet sun", "SUN")
    data.energy, data.angle = 5.5, math.radians(3.0)
    data.color = (1.0, 0.92, 0.80)
    sun = bpy.data.objects.new("Sheet sun", data)
    sun.rotation_euler = (math.radians(52), 0.0, math.radians(-38))
    scene.collection.objects.link(sun)
    world = bpy.data.worlds.new("Sheet sky")
    sky = next(n for n in tree_of(world).nodes if n.type == "BACKGROUND")
    sky.inputs["Color"].default_value = (0.75, 0.86, 1.0, 1.0)
    sky.inputs["Strength"].default_value = 0.8
    scene.world = world


BEHIND, NEAREST, FARTHEST = 60, 7.0, 55.0  # trees behind, metres


@dataclass(frozen=True)
class View:
    """An eye, its target and where light comes from, metres; a lens, millimetres, and its f-number."""

    eye: np.ndarray
    target: np.ndarray
    sun: np.ndarray
    lens: float
    stop: float


def render_closeup(
    species: spec.Species,
    tree: Tree,
    shot: str,
    path: str | os.PathLike[str],
    *,
    size: tuple[int, int] = (800, 1000),
    samples: int = 48,
    progress: Progress | None = None,
) -> None:
    """Render one of ``SHOTS`` of a tree to a PNG file.

    Raises
    ------
    SpecError : the tree has nothing of the kind: no fork, no stem at eye height, no leaf.
    OSError : the picture could not be written.
    """
    view = SHOTS[shot](species, tree)
    empty_file()
    scene = bpy.context.scene
    mesh = _coated(species, tree.mesh)
    scene.collection.objects.link(bpy.data.objects.new(species.name, mesh))
    set_stage(scene, size)
    lay_horizon(scene, np.zeros(2), FARTHEST, 0.0)
    data, far = bpy.data.meshes.new("Close-up ground"), FARTHEST + 100  # level forest floor
    corners = [(-far, -far, 0.0), (far, -far, 0.0), (far, far, 0.0), (-far, far, 0.0)]
    data.from_pydata(corners, [], [(0, 1, 2, 3)])
    data.materials.append(materials.ground("Close-up ground"))
    scene.collection.objects.link(bpy.data.objects.new("Close-up ground", data))
    _stand_behind(scene, mesh, view)
    way = view.target - view.eye
    grow_around(scene, view.eye[:2], math.atan2(way[1], way[0]), lambda place: np.zeros(len(place)))
    camera, data = scene.camera, scene.camera.data
    camera.location = view.eye
    camera.rotation_euler = Vector(view.target - view.eye).to_track_quat("-Z", "Y").to_euler()
    data.lens, data.clip_start = view.lens, 0.02
    data.dof.use_dof, data.dof.aperture_fstop = True, view.stop
    data.dof.focus_distance = float(np.linalg.norm(view.target - view.eye))
    scene.objects[SUN].rotation_euler = Vector(view.sun).to_track_quat("Z", "Y").to_euler()
    render(scene, spec.Output(preview_samples=samples), path, progress, exposure=1.0)


def _stand_behind(scene: bpy.types.Scene, mesh: bpy.types.Mesh, view: View) -> None:
    """More trees of the same mesh in what the eye sees beyond its target."""
    rng = stream(3, "closeup")
    way = view.target - view.eye
    turn = math.atan2(way[1], way[0]) + rng.uniform(-0.7, 0.7, BEHIND)
    far = np.sqrt(rng.uniform(NEAREST**2, FARTHEST**2, BEHIND))
    for angle, distance in zip(turn, far, strict=True):
        thing = bpy.data.objects.new("Behind", mesh)
        x, y = view.eye[:2] + distance * np.array([np.cos(angle), np.sin(angle)])
        if math.hypot(x, y) < 0.7 * NEAREST:
            continue
        thing.location = (x, y, 0.0)
        thing.rotation_euler.z = float(rng.uniform(0, 2 * np.pi))
        thing.scale = (float(rng.uniform(0.85, 1.1)),) * 3
        scene.collection.objects.link(thing)


def _fork(species: spec.Species, tree: Tree) -> View:
    """A heavy limb at its stem, from the side and a little below."""
    wood = tree.skeleton
    parent = np.maximum(wood.parent, 0)
    heads = np.flatnonzero((wood.order == 1) & (wood.order[parent] == 0) & ~wood.is_dead)
    if not len(heads):
        raise spec.SpecError(species.name, "has no limb, so no fork can be shown")
    own, thick = wood.radius[heads, 0], wood.radius[parent[heads], 1]
    head = heads[np.argmax(own * np.minimum(own / thick, 0.85))]
    limb = wood.axis(int(head))[:12]
    foot, thick_here = wood.start[head], float(wood.radius[parent[head], 1])
    way = _unit(wood.end[limb[-1]] - foot)
    side = _unit(np.cross(way, [0.0, 0.0, 1.0]))
    target = foot + 2.2 * thick_here * way + [0.0, 0.0, 0.5 * thick_here]
    eye = target + 13.0 * thick_here * side + [0.0, 0.0, -2.5 * thick_here]
    sun = _unit(0.9 * side + 0.45 * way + [0.0, 0.0, 0.45])
    return View(eye, target, sun, 42.0, 5.6)


def _bark(species: spec.Species, tree: Tree) -> View:
    """The stem's bark at eye height, from a metre away."""
    centre, radius = _stem_at(tree.skeleton, 1.5)
    if not radius:
        raise spec.SpecError(species.name, "has no stem 1.5 m above the ground to be looked at")
    back = _unit(np.array([-0.45, -1.0, 0.0]))
    target = centre + radius * back
    sun = _unit(np.array([-1.0, -0.35, 0.85]))
    return View(target + 1.0 * back + [0.0, 0.0, 0.06], target, sun, 44.0, 4.0)


def _twig(species: spec.Species, tree: Tree) -> View:
    """Leaves at the edge of the crown between the eye and the sun."""
    leaves = tree.leaves
    if not len(leaves):
        raise spec.SpecError(species.name, "bears no leaves, so no twig can be shown")
    far = np.hypot(leaves.centre[:, 0], leaves.centre[:, 1])
    low, high = np.percentile(leaves.centre[:, 2], [8, 45])
    rim = np.where((leaves.centre[:, 2] > low) & (leaves.centre[:, 2] < high), far, 0.0)
    leaf = int(np.argmax(rim))
    near = np.linalg.norm(leaves.centre - leaves.centre[leaf], axis=1) < 0.3
    target = leaves.centre[near].mean(axis=0)
    out = _unit(np.array([*target[:2], 0.0]))
    along = np.array([-out[1], out[0], 0.0])
    eye = target - 0.75 * along + 0.12 * out + [0.0, 0.0, -0.10]
    sun = _unit(along + 0.35 * out + [0.0, 0.0, 0.65])
    return View(eye, target, sun, 45.0, 5.6)


SHOTS: dict[str, Callable[[spec.Species, Tree], View]] = {
    "fork": _fork,
    "bark": _bark,
    "twig": _twig,
}


def _stem_at(wood: Skeleton, height: float) -> tuple[np.ndarray, float]:
    """Centre (3,) and radius of the stem at a height; radius 0 where it does not reach it."""
    on = np.flatnonzero(
        (wood.order == 0) & (wood.start[:, 2] <= height) & (wood.end[:, 2] > height)
    )
    if not len(on):
        return np.zeros(3), 0.0
    row = on[0]
    share = (height - wood.start[row, 2]) / (wood.end[row, 2] - wood.start[row, 2])
    centre = wood.start[row] + share * (wood.end[row] - wood.start[row])
    return centre, float(wood.radius[row, 0] + share * (wood.radius[row, 1] - wood.radius[row, 0]))


def _unit(vector: np.ndarray) -> np.ndarray:
    return np.asarray(vector / np.linalg.norm(vector))
