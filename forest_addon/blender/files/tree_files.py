"""Meshes of a tree from PLY, OBJ and glTF files, through Blender's own importers.

A file is opened in a scene of its own, its meshes are read with their places in the world, in metres and
along the file's own axes, and everything that came with it is removed again: the user's scene, selection
and data stay as they were. None of these formats runs a script.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from ...formats.foreign import guarded, refuse_coarse
from ...formats.helios.parts import read_obj
from ...formats.stl import StlError, read_stl
from ...growth.own_tree.pieces import Group
from ...spec import SpecError
from ..scene.attributes import world_places_of

ENDINGS = (".ply", ".obj", ".gltf", ".glb")
DRACO = b"KHR_draco_mesh_compression"
COMPRESSED = "this Blender cannot decode its compressed meshes (Draco); export it without"


@guarded("a mesh", key="template")
def read_groups(path: Path) -> list[Group]:
    """The meshes of a file, one group for each object and material.

    Raises
    ------
    SpecError : the file is not there, is no such file, holds no facets, or lost its shape at map coordinates.
    """
    with _apart() as scene:
        try:
            _open(path)
        except RuntimeError:
            if _is_compressed(path):
                raise SpecError("template", f"{path} cannot be read: {COMPRESSED}") from None
            raise
        groups = [group for obj in scene.objects for group in _groups_of(obj)]
    if path.suffix.lower() in (".gltf", ".glb"):  # Blender has turned it to z up
        groups = [Group(g.name, g.material, g.facets @ _Y_TO_Z) for g in groups]
    if not groups:
        problem = f"{path.name} has no facets; export it with its meshes"
        compressed = f"{path} cannot be read: {COMPRESSED}"
        raise SpecError("template", compressed if _is_compressed(path) else problem)
    refuse_coarse(path, np.concatenate([group.facets for group in groups]))
    return groups


def read_parts(wood: Path, leaves: Path | None) -> list[Group]:
    """The meshes of one file, or of two that are wood and leaves whatever names say; STL too."""
    if leaves is None:
        return read_groups(wood)
    return [
        Group(kind, kind, group.facets)
        for kind, path in (("wood", wood), ("leaves", leaves))
        for group in _of_any(path)
    ]


def _of_any(path: Path) -> list[Group]:
    if path.suffix.lower() != ".stl":
        return read_groups(path)
    try:
        return [Group(path.stem, "", read_stl(path))]
    except FileNotFoundError:
        raise SpecError("template", f"there is no file {path}; check the path") from None
    except StlError as problem:
        raise SpecError("template", str(problem)) from None


def _is_compressed(path: Path) -> bool:
    return path.suffix.lower() in (".gltf", ".glb") and DRACO in path.read_bytes()


_Y_TO_Z = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # rows times this: z up back to y up


def _open(path: Path) -> None:
    ending = path.suffix.lower()
    # importers say of a missing file what it is not, and pass over what is wrong in an OBJ
    {".obj": read_obj}.get(ending, Path.stat)(path)
    if ending == ".ply":
        bpy.ops.wm.ply_import(filepath=str(path), forward_axis="Y", up_axis="Z")
    elif ending == ".obj":
        bpy.ops.wm.obj_import(
            filepath=str(path), forward_axis="Y", up_axis="Z", use_split_objects=True
        )
    else:
        bpy.ops.import_scene.gltf(filepath=str(path), import_shading="FLAT")


@contextmanager
def _apart() -> Iterator[bpy.types.Scene]:
    """A scene for a while, current to what is called within; then all new data is removed."""
    before = {data.session_uid for data in _everything()}
    window, current = bpy.context.window, bpy.context.scene
    if bpy.context.mode != "OBJECT":
        raise SpecError("template", "a file cannot be read in this mode; go to Object Mode first")
    scene = bpy.data.scenes.new("tree file")
    try:
        if window is not None:
            window.scene = scene
            yield scene
        else:
            with bpy.context.temp_override(scene=scene, view_layer=scene.view_layers[0]):
                yield scene
    finally:
        if window is not None:
            window.scene = current
        bpy.data.batch_remove([data for data in _everything() if data.session_uid not in before])


def _everything() -> Iterator[bpy.types.ID]:
    for prop in bpy.data.bl_rna.properties:
        if prop.type == "COLLECTION":
            every = getattr(bpy.data, prop.identifier)
            yield from (d for d in every if isinstance(d, bpy.types.ID) and d.id_type != "LIBRARY")


def _groups_of(obj: bpy.types.Object) -> list[Group]:
    if obj.type != "MESH":
        return []
    mesh = obj.data
    mesh.calc_loop_triangles()
    corners = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("vertices", corners)
    slot = np.empty(len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("material_index", slot)
    facets = world_places_of(obj, mesh)[corners.reshape(-1, 3)]
    names = [slot.material.name if slot.material else "" for slot in obj.material_slots] or [""]
    slot = np.clip(slot, 0, len(names) - 1)
    return [Group(obj.name, names[number], facets[slot == number]) for number in np.unique(slot)]
