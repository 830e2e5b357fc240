"""A forest as a Blender scene: variants as meshes, trees as objects that share them, a ground.

Everything stands in named collections below *Forest*: *Trees*, one collection a species within it,
*Ground*, *Sensors* and *Results*. A new forest is complete before an old one is touched, and what was made
of one that fails is taken back.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np
from mathutils import Matrix

from .. import spec
from ..growth.trimesh import GROUND, TriMesh
from ..growth.truth import tree_truth
from ..stand.forest import Forest
from . import materials
from .depsgraph import SPECIES_KEY, TREE_KEY
from .meshes import to_mesh

ROOT_KEY = "forest_sensing"  # custom property that tells our collection from a user's own *Forest*
ROOT, TREES, GROUND_NAME, SENSORS, RESULTS = "Forest", "Trees", "Ground", "Sensors", "Results"
MARK_KEY = "forest_sensor"


def build(scene: bpy.types.Scene, settings: spec.Scene, forest: Forest) -> bpy.types.Collection:
    """Put a forest into a Blender scene, in place of the one that may be there."""
    with _all_or_nothing():
        made = _root()
        _plant(_collection(TREES, made), forest)
        _lay_ground(_collection(GROUND_NAME, made), settings.forest)
        _mark(_collection(SENSORS, made), settings)
        _collection(RESULTS, made)

    old = root(scene)
    if old is not None:
        remove(old)
    made.name = ROOT
    for child, name in zip(made.children, (TREES, GROUND_NAME, SENSORS, RESULTS), strict=True):
        child.name = name
    scene.collection.children.link(made)
    return made


def root(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """The collection of the scene's forest, None where it has none."""
    return next((c for c in scene.collection.children if ROOT_KEY in c), None)


def part(scene: bpy.types.Scene, name: str) -> bpy.types.Collection:
    """One of the collections of the scene's forest, made where it is missing."""
    top = root(scene)
    if top is None:
        top = _root()
        scene.collection.children.link(top)
    for child in top.children:
        if child.name.startswith(name):
            return child
    return _collection(name, top)


def mark_sensors(scene: bpy.types.Scene, settings: spec.Scene) -> None:
    """Move the markers of these sensors to where they are now; make those that are missing."""
    _mark(part(scene, SENSORS), settings)


def remove(collection: bpy.types.Collection) -> None:
    """Remove a collection with what only it uses: objects, meshes, materials."""
    for child in list(collection.children):
        remove(child)
    meshes = set()
    for thing in list(collection.objects):
        if thing.type == "MESH":
            meshes.add(thing.data)
        bpy.data.objects.remove(thing)
    used = {material for mesh in meshes for material in mesh.materials if material}
    bpy.data.batch_remove([mesh for mesh in meshes if not mesh.users])
    bpy.data.batch_remove([material for material in used if not material.users])
    bpy.data.collections.remove(collection)


def _plant(trees: bpy.types.Collection, forest: Forest) -> None:
    meshes: dict[tuple[int, int], bpy.types.Mesh] = {}
    homes: dict[int, bpy.types.Collection] = {}
    coats: dict[int, list[bpy.types.Material]] = {}
    for planting, label in enumerate(forest.labels):
        look = forest.species[planting].look
        homes[planting] = _collection(label, trees)
        coats[planting] = [
            materials.bark(f"{label} bark", look.bark),
            materials.leaf(f"{label} leaf", look.leaf),
        ]
    for (planting, variant), tree in forest.variants.items():
        mesh = to_mesh(f"{forest.labels[planting]}.{variant:03d}", tree.mesh)
        for material in coats[planting]:
            mesh.materials.append(material)
        for name, value in tree_truth(tree).items():  # custom properties, for whoever looks
            mesh[name] = value
        meshes[planting, variant] = mesh
    stand = forest.stand
    for tree, matrix in enumerate(forest.transforms()):
        planting, variant = int(stand.species[tree]), int(stand.variant[tree])
        number = int(stand.id[tree])
        thing = bpy.data.objects.new(
            f"{forest.labels[planting]} {number:04d}", meshes[planting, variant]
        )
        thing.matrix_world = Matrix([*matrix.tolist(), [0.0, 0.0, 0.0, 1.0]])
        thing[TREE_KEY] = number
        thing[SPECIES_KEY] = planting
        homes[planting].objects.link(thing)


def _lay_ground(home: bpy.types.Collection, field: spec.Forest) -> None:
    low = np.array(field.origin) - field.margin
    high = np.array(field.origin) + np.array(field.size) + field.margin
    corners = np.array(
        [[low[0], low[1], 0], [high[0], low[1], 0], [high[0], high[1], 0], [low[0], high[1], 0]]
    )
    mesh = to_mesh("Ground", TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), GROUND))
    mesh.materials.append(materials.ground("Ground"))
    home.objects.link(bpy.data.objects.new("Ground", mesh))


def _mark(home: bpy.types.Collection, settings: spec.Scene) -> None:
    """An empty where each sensor is, its X axis along the beam; for the eye, not for the result."""
    for sensor in settings.sensors:
        if isinstance(sensor, spec.Reverb):
            _place(home, f"{sensor.name} source", sensor.source, 0.0, 0.0, "SPHERE")
            _place(home, f"{sensor.name} receiver", sensor.receiver, 0.0, 0.0, "SPHERE")
        elif isinstance(sensor, spec.Sonar):
            _place(home, sensor.name, sensor.position, sensor.azimuth_deg, sensor.elevation_deg)
        elif isinstance(sensor, spec.Tractor | spec.Airborne):
            _place(home, sensor.name, sensor.position, sensor.heading_deg, 0.0)
        elif isinstance(sensor, spec.Mobile):
            for pose in sensor.poses[:1]:
                _place(home, sensor.name, pose.position, pose.heading_deg, pose.pitch_deg)
        else:
            _place(home, sensor.name, sensor.position, 0.0, 0.0)


def _place(
    home: bpy.types.Collection,
    name: str,
    position: tuple[float, float, float],
    azimuth_deg: float,
    elevation_deg: float,
    shape: str = "ARROWS",
) -> None:
    empty = next((thing for thing in home.objects if thing.get(MARK_KEY) == name), None)
    if empty is None:
        empty = bpy.data.objects.new(name, None)
        empty[MARK_KEY] = name
        empty.empty_display_type = shape
        empty.empty_display_size = 0.6
        empty.show_in_front = empty.show_name = True
        home.objects.link(empty)
    empty.location = position
    empty.rotation_euler = (0.0, -np.deg2rad(elevation_deg), np.deg2rad(azimuth_deg))


def _root() -> bpy.types.Collection:
    made = bpy.data.collections.new(ROOT)
    made[ROOT_KEY] = True
    return made


def _collection(name: str, parent: bpy.types.Collection) -> bpy.types.Collection:
    made = bpy.data.collections.new(name)
    parent.children.link(made)
    return made


@contextmanager
def _all_or_nothing() -> Iterator[None]:
    """Take back every data block that is made in the block when that fails."""
    kinds = (bpy.data.objects, bpy.data.meshes, bpy.data.materials, bpy.data.collections)
    before = {block for kind in kinds for block in kind}
    try:
        yield
    except BaseException:
        bpy.data.batch_remove([block for kind in kinds for block in kind if block not in before])
        raise
