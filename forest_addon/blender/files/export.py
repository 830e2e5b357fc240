"""The scene as a .blend and the forest as a .glb, each whole or not there.

In a .glb, trees that are objects are nodes that share meshes; trees that are points become one node a
variant with a list of places (``formats.glb``), which Blender's own exporter cannot write with their
numbers and without a node for each first.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np

from ...formats.atomic import replacing
from ...formats.glb import Copies, instance_nodes
from ..scene.instances import read_points
from ..scene.layout import GROUND_NAME, PART_KEY, TREES, objects_in, root
from ..scene.nodes import in_full

NUMBERS = {"_TREE": "tree", "_SPECIES": "species"}


def save_blend(path: str | os.PathLike[str]) -> None:
    """Save a copy of the whole file, compressed.

    Raises
    ------
    OSError : Blender could not write it.
    """
    with replacing(path) as partial:
        try:
            bpy.ops.wm.save_as_mainfile(
                filepath=str(partial), copy=True, compress=True, check_existing=False
            )
        except RuntimeError as problem:
            raise _refused(problem, path) from None


def export_glb(scene: bpy.types.Scene, path: str | os.PathLike[str]) -> None:
    """Export trees and ground as binary glTF; trees of one variant share a mesh.

    Trees that are points carry their numbers as the attributes ``_TREE`` and ``_SPECIES`` of their nodes,
    trees that are objects as custom properties.

    Raises
    ------
    OSError : the exporter could not write it.
    ValueError : nodes that were edited instance something that is no object; says what to do.
    """
    top = root(scene)
    wanted = {
        thing
        for child in (top.children if top else ())
        if child.get(PART_KEY) in (TREES, GROUND_NAME)
        for thing in objects_in(child)
    }
    with in_full(bpy.context.evaluated_depsgraph_get()), _stand_ins(scene, wanted) as copies:
        bare = {thing for thing in wanted if thing.type == "MESH" and not thing.data.polygons}
        shown = (wanted - bare) | {scene.objects[name] for name in copies}
        with replacing(path) as partial, _selected(shown):
            try:
                bpy.ops.export_scene.gltf(
                    filepath=str(partial),
                    export_format="GLB",
                    use_selection=True,
                    export_extras=True,
                    export_apply=False,
                    export_animations=False,
                    export_attributes=False,
                    export_texcoords=False,
                    export_yup=True,
                )
            except RuntimeError as problem:
                raise _refused(problem, path) from None
            if copies:
                instance_nodes(partial, copies)


@contextmanager
def _stand_ins(
    scene: bpy.types.Scene, things: set[bpy.types.Object]
) -> Iterator[dict[str, Copies]]:
    """An object at the origin for everything that geometry nodes instance, and by its name the copies."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    made: dict[str, Copies] = {}
    objects = []
    try:
        for thing in sorted(things, key=lambda thing: thing.name):
            placed = read_points(thing.evaluated_get(depsgraph))
            solid = np.abs(np.linalg.det(placed.transform[:, :, :3])) > 0
            for number, source in enumerate(placed.source):
                mine = solid & (placed.index == number)
                if not mine.any():
                    continue
                if not isinstance(source, bpy.types.Object) or source.type != "MESH":
                    raise ValueError(
                        f'the nodes of "{thing.name}" instance something that is no mesh object, which a '
                        ".glb cannot share; let them pick mesh objects"
                    )
                stand_in = bpy.data.objects.new(source.name, source.original.data)
                objects.append(stand_in)
                scene.collection.objects.link(stand_in)
                made[stand_in.name] = Copies(
                    name=source.original.data.name,
                    transform=placed.transform[mine],
                    numbers={key: getattr(placed, name)[mine] for key, name in NUMBERS.items()},
                )
        yield made
    finally:
        bpy.data.batch_remove(objects)


@contextmanager
def _selected(things: set[bpy.types.Object]) -> Iterator[None]:
    """Select these objects, and in the end those that were."""
    layer = bpy.context.view_layer
    before = {thing for thing in layer.objects if thing.select_get()}
    for thing in layer.objects:
        thing.select_set(thing in things)
    try:
        yield
    finally:
        for thing in layer.objects:
            thing.select_set(thing in before)


def _refused(problem: RuntimeError, path: str | os.PathLike[str]) -> OSError:
    """Return what the system refused, found in what an operator reports."""
    text = str(problem).strip()
    for code in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EACCES, errno.EROFS):
        if os.strerror(code) in text:
            return OSError(code, os.strerror(code), os.fspath(path))
    return OSError(text.splitlines()[-1].removeprefix("Error: ") if text else "Blender failed")
