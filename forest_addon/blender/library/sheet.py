"""A contact sheet: one tree beside the other, each as large as its cell allows, in one render.

Trees hang in a grid before an orthographic camera that looks slightly down on them; the background stays
transparent. ``SheetCell`` says where each came to stand in the picture, so that labels can be drawn below.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ... import spec
from ...base.progress import Progress
from ...growth.tree import Tree
from ..files.opening import empty_file
from ..scene import materials
from ..scene.meshes import to_mesh
from ..show.preview import render

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
    mesh = to_mesh(species.name, replace(tree.mesh, vertices=above))  # without its sunk foot
    for material in materials.coats_of(species):
        mesh.materials.append(material)
    thing = bpy.data.objects.new(species.name, mesh)
    thing.scale = (size, size, size)
    thing.location = (x - middle * size, 0.0, z)
    scene.collection.objects.link(thing)


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
    if world.node_tree is None:
        world.use_nodes = True
    sky = next(n for n in world.node_tree.nodes if n.type == "BACKGROUND")
    sky.inputs["Color"].default_value = (0.75, 0.86, 1.0, 1.0)
    sky.inputs["Strength"].default_value = 0.8
    scene.world = world
