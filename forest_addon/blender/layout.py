"""Where everything of ours stands in a Blender scene: the collections below *Forest*.

*Trees*, the *Variants* that they are copies of, and their *Outlines* for the view; *Ground*, *Sensors* and
*Results* hold what their names say, *Intensity* what hills are dragged and weights are painted on, where that
is done. Custom properties tell our collections from a user's own.
"""

from __future__ import annotations

import bpy

from .ours import make_collection

ROOT_KEY = "forest_sensing"
PART_KEY = "forest_part"
ROOT, TREES, VARIANTS, OUTLINES = "Forest", "Trees", "Variants", "Outlines"
GROUND_NAME, SENSORS, RESULTS, INTENSITY = "Ground", "Sensors", "Results", "Intensity"
PARTS = (TREES, VARIANTS, OUTLINES, GROUND_NAME, SENSORS, RESULTS)  # of every forest


def root(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """The collection of the scene's forest, None where it has none."""
    return next((c for c in scene.collection.children if ROOT_KEY in c), None)


def part(scene: bpy.types.Scene, name: str) -> bpy.types.Collection:
    """One of the collections of the scene's forest, made where it is missing."""
    top = root(scene)
    if top is None:
        top = new_root()
        scene.collection.children.link(top)
    return find_part(scene, name) or new_part(name, top)


def find_part(scene: bpy.types.Scene, name: str) -> bpy.types.Collection | None:
    """One of the collections of the scene's forest, None where it is missing."""
    top = root(scene)
    return next((c for c in top.children if c.get(PART_KEY) == name), None) if top else None


def new_root() -> bpy.types.Collection:
    """A collection *Forest* of ours, not yet in a scene."""
    made = make_collection(ROOT, None)
    made[ROOT_KEY] = True
    return made


def new_part(name: str, top: bpy.types.Collection) -> bpy.types.Collection:
    """One of the collections of a forest, empty."""
    made = make_collection(name, top)
    made[PART_KEY] = name
    return made
