"""Which Blender file a scene is built in: the one that it names, else the one that is open.

``bpy`` as a module starts with Blender's cube, camera and lamp, which nobody asked for; they are taken out.
"""

from __future__ import annotations

from pathlib import Path

import bpy

from ..spec import Scene, SpecError

STARTUP = ("Cube", "Camera", "Light")


def open_for(scene: Scene, folder: Path) -> None:
    """Open the file that a scene starts from, or clear what Blender itself put into a new one.

    Raises
    ------
    SpecError : the file cannot be opened.
    """
    if scene.blend:
        open_file(folder / scene.blend)
    elif getattr(bpy.app, "module", False) and not bpy.data.filepath:
        things = [bpy.data.objects.get(name) for name in STARTUP]
        if all(things) and len(bpy.data.objects) == len(STARTUP):
            bpy.data.batch_remove(things)


def open_file(path: Path) -> None:
    """Open a Blender file; scripts in it do not run.

    Raises
    ------
    SpecError : it is not there or cannot be read.
    """
    try:
        bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False, use_scripts=False)
    except RuntimeError as problem:
        why = str(problem).strip().removeprefix("Error: ")
        raise SpecError("blend", f"{path} cannot be opened ({why}); check the path") from None
