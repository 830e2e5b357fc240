"""A forest as a Blender scene: variants as meshes, trees that share them, a ground.

Everything stands in named collections below *Forest*: *Trees*, *Variants* (hidden; assets to drag in),
their *Outlines* (hidden), *Ground*, *Sensors* and *Results*. Trees are objects, one collection a species, or
points of one object that geometry nodes put variants on. A new forest is complete before an old one is
touched, what was made of one that fails is taken back, and what others put into our collections is kept in
those of the new forest.
"""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix

from .. import spec
from ..growth.outline import outline
from ..growth.trimesh import TriMesh
from ..growth.truth import tree_truth
from ..stand.forest import Forest
from ..stand.terrain import Flat, Terrain
from . import assets, materials
from .depsgraph import SPECIES_KEY, TREE_KEY
from .ground import lay_ground
from .instances import plant_points
from .layout import (
    GROUND_NAME,
    OUTLINES,
    PART_KEY,
    PARTS,
    TREES,
    VARIANTS,
    new_part,
    new_root,
    root,
)
from .meshes import to_mesh
from .ours import all_or_nothing, claim, make_collection, make_object, remove, settle, want

MANY = 1000  # trees; where there are more, they are points unless the settings say otherwise


def build(
    scene: bpy.types.Scene, settings: spec.Scene, forest: Forest, terrain: Terrain | None = None
) -> bpy.types.Collection:
    """Put a forest into a Blender scene, in place of the one that may be there; its sensors stay.

    terrain : the ground that the forest was planned on; None: flat.

    Raises
    ------
    ValueError : a tree that cannot stand (see ``plant_points``); nothing is changed.
    """
    terrain = Flat(settings.forest.terrain.base) if terrain is None else terrain
    with all_or_nothing():
        made = new_root()
        homes = {name: new_part(name, made) for name in PARTS}
        _plant(homes, settings.forest, forest)
        lay_ground(homes[GROUND_NAME], settings.forest, terrain)

    old = root(scene)
    scene.collection.children.link(made)
    if old is not None:
        _replace(old, made)
    settle(made)
    return made


def _plant(homes: dict[str, bpy.types.Collection], field: spec.Forest, forest: Forest) -> None:
    """Make every variant, and stand the trees as points or as objects."""
    stand = forest.stand
    points = len(stand) > MANY if field.instancing == "auto" else field.instancing == "points"
    number_of = _fill_library(homes[VARIANTS], homes[OUTLINES], forest, points)
    pairs = zip(stand.species.tolist(), stand.variant.tolist(), strict=True)
    variant = np.array([number_of[pair] for pair in pairs], dtype=np.int64)
    if not points:
        _stand_objects(homes[TREES], homes[VARIANTS], forest, variant)
    elif len(stand):
        thing = plant_points(
            TREES,
            homes[VARIANTS],
            homes[OUTLINES],
            position=forest.transforms()[:, :, 3],
            rotation=stand.rotation,
            scale=stand.scale,
            variant=variant,
            tree=stand.id,
            species=stand.species,
        )
        claim(thing, TREES, homes[TREES])


def _fill_library(
    variants: bpy.types.Collection,
    outlines: bpy.types.Collection,
    forest: Forest,
    with_outlines: bool,
) -> dict[tuple[int, int], int]:
    """An object for every variant, named so that their order is their number; returns the numbers."""
    for home in (variants, outlines):
        home.hide_viewport = home.hide_render = True
    coats: dict[int, list[bpy.types.Material]] = {}
    for planting, label in enumerate(forest.labels):
        look = forest.species[planting].look
        coats[planting] = [
            materials.bark(f"{label} bark", look.bark),
            materials.leaf(f"{label} leaf", look.leaf),
        ]
    digits = max(3, len(str(len(forest.variants))))
    for number, ((planting, variant), tree) in enumerate(forest.variants.items()):
        label = forest.labels[planting]
        name = f"{label}.{variant:03d}"
        mesh = _coated(name, tree.mesh, coats[planting])
        for key, value in tree_truth(tree).items():  # custom properties, for whoever looks
            mesh[key] = value
        thing = make_object(f"{number:0{digits}d} {name}", mesh, variants)
        thing[SPECIES_KEY] = planting
        assets.mark(thing, forest.species[planting], label, tree.mesh)
        if with_outlines:
            rough = _coated(f"{name} outline", outline(tree.mesh), coats[planting])
            make_object(f"{number:0{digits}d} {name} outline", rough, outlines)
    return {key: number for number, key in enumerate(forest.variants)}


def _coated(name: str, mesh: TriMesh, coats: list[bpy.types.Material]) -> bpy.types.Mesh:
    data = to_mesh(name, mesh)
    want(data, name)
    for material in coats:
        data.materials.append(material)
    return data


def _stand_objects(
    trees: bpy.types.Collection, library: bpy.types.Collection, forest: Forest, variant: np.ndarray
) -> None:
    homes = [make_collection(label, trees) for label in forest.labels]
    meshes = [thing.data for thing in library.objects]
    stand = forest.stand
    for tree, matrix in enumerate(forest.transforms()):
        planting, number = int(stand.species[tree]), int(stand.id[tree])
        thing = make_object(
            f"{forest.labels[planting]} {number:04d}", meshes[variant[tree]], homes[planting]
        )
        thing.matrix_world = Matrix([*matrix.tolist(), [0.0, 0.0, 0.0, 1.0]])
        thing[TREE_KEY] = number
        thing[SPECIES_KEY] = planting


def _replace(old: bpy.types.Collection, new: bpy.types.Collection) -> None:
    """Remove a forest; what others put into a collection of it goes into the same one of the new."""
    heirs = {home[PART_KEY]: home for home in new.children}
    for home in list(old.children):
        if home.get(PART_KEY) in heirs:
            remove(home, heirs[home[PART_KEY]])
        elif PART_KEY in home:  # of which no new one was made: it goes on as it is
            new.children.link(home)
            old.children.unlink(home)
    remove(old, new)
