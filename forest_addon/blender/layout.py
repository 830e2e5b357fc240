"""Where everything of ours stands in a Blender scene: the collections below *Forest*.

*Trees* has one collection a species within it; *Ground*, *Sensors* and *Results* hold what their names
say. A custom property tells our *Forest* from a user's own.
"""

from __future__ import annotations

import bpy

ROOT_KEY = "forest_sensing"
ROOT, TREES, GROUND_NAME, SENSORS, RESULTS = "Forest", "Trees", "Ground", "Sensors", "Results"


def root(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """The collection of the scene's forest, None where it has none."""
    return next((c for c in scene.collection.children if ROOT_KEY in c), None)


def part(scene: bpy.types.Scene, name: str) -> bpy.types.Collection:
    """One of the collections of the scene's forest, made where it is missing."""
    top = root(scene)
    if top is None:
        top = new_root()
        scene.collection.children.link(top)
    for child in top.children:
        if child.name.startswith(name):
            return child
    return new_collection(name, top)


def new_root() -> bpy.types.Collection:
    """A collection *Forest* of ours, not yet in a scene."""
    made = bpy.data.collections.new(ROOT)
    made[ROOT_KEY] = True
    return made


def new_collection(name: str, parent: bpy.types.Collection) -> bpy.types.Collection:
    """A new collection within another."""
    made = bpy.data.collections.new(name)
    parent.children.link(made)
    return made
