"""The scene as a .blend and the forest as a .glb, each whole or not there."""

from __future__ import annotations

import errno
import os

import bpy

from ..formats.atomic import replacing
from .layout import GROUND_NAME, TREES, root


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

    Raises
    ------
    OSError : the exporter could not write it.
    """
    top = root(scene)
    wanted = {
        thing
        for child in (top.children if top else ())
        if child.name.startswith((TREES, GROUND_NAME))
        for thing in child.all_objects
    }
    selected = [thing for thing in scene.objects if thing.select_get()]
    for thing in scene.objects:
        thing.select_set(thing in wanted)
    try:
        with replacing(path) as partial:
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
    finally:
        for thing in scene.objects:
            thing.select_set(thing in selected)


def _refused(problem: RuntimeError, path: str | os.PathLike[str]) -> OSError:
    """What the system refused, found in what an operator reports."""
    text = str(problem).strip()
    for code in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EACCES, errno.EROFS):
        if os.strerror(code) in text:
            return OSError(code, os.strerror(code), os.fspath(path))
    return OSError(text.splitlines()[-1].removeprefix("Error: ") if text else "Blender failed")
