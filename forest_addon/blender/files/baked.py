"""A forest in the wind as a file of another program: Alembic or USD, a transform a piece and frame."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...formats.atomic import replacing
from ..scene.layout import root


def bake(scene: bpy.types.Scene, path: Path) -> None:
    """Write what the scene's forest shows over its range of frames; in Alembic trees of a variant
    share their meshes.

    Raises
    ------
    RuntimeError : Blender could not write it.
    OSError : the file could not be put in its place.
    """
    top = root(scene)
    name = top.name if top is not None else ""
    with replacing(path) as part:
        if path.suffix.lower() == ".abc":
            bpy.ops.wm.alembic_export(
                filepath=str(part),
                start=scene.frame_start,
                end=scene.frame_end,
                collection=name,
                evaluation_mode="RENDER",
                as_background_job=False,
                use_instancing=True,
            )
        else:
            bpy.ops.wm.usd_export(
                filepath=str(part),
                export_animation=True,
                collection=name,
                evaluation_mode="RENDER",
                use_instancing=False,  # Blender 5.2 refers pieces to themselves otherwise
            )
