"""Marks of the things that we made in a Blender file, and of what they stand for there.

Every block that we make carries a custom property with the name it was made under. A copy has the property
but another name, and a block that was renamed has too: both belong to the user, and so does what comes from
another file. What stands for something in a forest, a tree or the material of a planting's leaves, says so
in a second property: by that the next build finds it again.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import bpy

MADE_KEY = "forest_made"
ROLE_KEY = "forest_role"
SHAPE_KEY = "forest_shape"  # of the mesh that was made, whatever has been done to it since

Block = TypeVar("Block", bound=bpy.types.ID)


def make_object(
    name: str, data: bpy.types.ID | None, home: bpy.types.Collection
) -> bpy.types.Object:
    """A new object of ours in a collection."""
    made = own(bpy.data.objects.new(name, data))
    if data is not None:
        own(data)
    home.objects.link(made)
    return made


def make_collection(name: str, parent: bpy.types.Collection) -> bpy.types.Collection:
    """A new collection of ours within another."""
    made = own(bpy.data.collections.new(name))
    parent.children.link(made)
    return made


def own(block: Block, name: str = "") -> Block:
    """Mark a new block as ours; ``name`` is what ``settle`` is to call it, where that is not free yet."""
    block[MADE_KEY] = name or block.name
    return block


def settle(block: bpy.types.ID, name: str = "") -> None:
    """Give a block of ours a name, as far as it is free now: this, or the one that it was to have."""
    name = name or block[MADE_KEY]
    if block.name != name:
        block.name = name
        if block.name != name:  # Blender counts on from a number at its end, which says something
            block.name = f"{name}.001"
    block[MADE_KEY] = block.name


def is_ours(block: bpy.types.ID) -> bool:
    """Return whether we made it and nobody has copied or renamed it."""
    return block.get(MADE_KEY) == block.name and is_local(block)


def is_local(block: bpy.types.ID) -> bool:
    """Return whether it is of this file, and no override of what is of another."""
    return block.library is None and block.override_library is None


def by_role(blocks: Iterable[Block]) -> dict[str, Block]:
    """The blocks that are ours, by what each stands for; of two that say the same the later one."""
    return {block[ROLE_KEY]: block for block in blocks if ROLE_KEY in block and is_ours(block)}


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
