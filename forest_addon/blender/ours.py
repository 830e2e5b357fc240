"""What we made in a Blender file, and how it goes without anything that is not ours.

Every object and collection that we make carries a custom property with the name it was made under. A copy
has the property but another name, and a block that was renamed has too: both belong to the user.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy

MADE_KEY = "forest_made"
NAME_KEY = "forest_name"  # the name that it was meant to have, where another block still has that


def make_object(
    name: str, data: bpy.types.ID | None, home: bpy.types.Collection
) -> bpy.types.Object:
    """A new object of ours in a collection."""
    return claim(bpy.data.objects.new(name, data), name, home)


def claim(thing: bpy.types.Object, name: str, home: bpy.types.Collection) -> bpy.types.Object:
    """Put a new object, that was to be called so, into a collection as one of ours."""
    _own(thing, name)
    home.objects.link(thing)
    return thing


def make_collection(name: str, parent: bpy.types.Collection | None) -> bpy.types.Collection:
    """A new collection of ours within another."""
    made = bpy.data.collections.new(name)
    _own(made, name)
    if parent is not None:
        parent.children.link(made)
    return made


def want(block: bpy.types.ID, name: str) -> None:
    """Note the name that a new block was to have, if another block still has it."""
    if block.name != name:
        block[NAME_KEY] = name


def settle(collection: bpy.types.Collection) -> None:
    """Give what is in a collection of ours the names that were wanted, as far as they are free now."""
    things = collection.all_objects
    meshes = {thing.data for thing in things if thing.type == "MESH"}
    for block in (collection, *collection.children_recursive, *things, *meshes):
        if NAME_KEY in block:
            block.name = block[NAME_KEY]
            del block[NAME_KEY]
            if MADE_KEY in block:
                block[MADE_KEY] = block.name


def _own(block: bpy.types.ID, name: str) -> None:
    block[MADE_KEY] = block.name
    want(block, name)


def is_ours(block: bpy.types.ID) -> bool:
    """Whether we made it and nobody has copied or renamed it."""
    return bool(block.get(MADE_KEY) == block.name)


def remove(collection: bpy.types.Collection, heir: bpy.types.Collection) -> None:
    """Remove a collection of ours with what only it uses: objects, meshes, materials.

    heir : gets what others put there. What of ours stands in a collection of theirs too stays in that.
    """
    doomed: set[bpy.types.Object] = set()
    _empty(collection, heir, doomed)
    meshes = {thing.data for thing in doomed if thing.type == "MESH"}
    used = {material for mesh in meshes for material in mesh.materials if material}
    bpy.data.batch_remove(list(doomed))
    bpy.data.batch_remove([mesh for mesh in meshes if not mesh.users])
    bpy.data.batch_remove([material for material in used if not material.users])


def _empty(
    collection: bpy.types.Collection, heir: bpy.types.Collection, doomed: set[bpy.types.Object]
) -> None:
    for child in list(collection.children):
        if is_ours(child):
            _empty(child, heir, doomed)
        elif child.name not in heir.children:
            heir.children.link(child)
    for thing in list(collection.objects):
        if is_ours(thing):
            if all(is_ours(home) for home in thing.users_collection):
                doomed.add(thing)
        elif thing.name not in heir.objects:
            heir.objects.link(thing)
    bpy.data.collections.remove(collection)


@contextmanager
def all_or_nothing() -> Iterator[None]:
    """Take back every data block that is made in the block when that fails."""
    kinds = (
        *(bpy.data.objects, bpy.data.meshes, bpy.data.materials),
        *(bpy.data.collections, bpy.data.node_groups),
    )
    before = {block for kind in kinds for block in kind}
    try:
        yield
    except BaseException:
        bpy.data.batch_remove([block for kind in kinds for block in kind if block not in before])
        raise
