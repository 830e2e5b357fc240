"""Other files in this Blender: an empty one, or a user's.

``read_factory_settings`` is called nowhere: in a Blender of a user it switches every extension off, and
Blender then removes the packages that they brought, from under open windows too. Scripts in a user's file
never run by us, whatever the preferences say.
"""

from __future__ import annotations

from pathlib import Path

import bpy

from ...spec import Scene, SpecError

STARTUP = ("Cube", "Camera", "Light")  # what Blender itself puts into a new file


def empty_file() -> None:
    """A new file without anything in it; preferences and extensions stay as they are."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)


def open_file(path: Path) -> None:
    """Open a .blend file without its windows, and without running what scripts it has.

    Raises
    ------
    SpecError : Blender cannot open it; says why.
    """
    try:
        bpy.ops.wm.open_mainfile(filepath=str(path.resolve()), load_ui=False, use_scripts=False)
    except RuntimeError as problem:
        why = str(problem).strip().removeprefix("Error: ")
        raise SpecError(str(path), f"cannot be opened ({why}); check the path") from None


def open_for(scene: Scene, folder: Path) -> None:
    """Open the file that a scene starts from; without one, stay in the file that is open, but for the cube,
    camera and lamp that ``bpy`` as a module starts with.

    Raises
    ------
    SpecError : Blender cannot open it; says why.
    """
    if scene.blend:
        path = folder / scene.blend
        try:
            open_file(path)
        except SpecError as problem:
            raise SpecError("blend", f"{path} {problem.problem}") from None
    elif getattr(bpy.app, "module", False) and not bpy.data.filepath:
        things = [bpy.data.objects.get(name) for name in STARTUP]
        if all(things) and len(bpy.data.objects) == len(STARTUP):
            bpy.data.batch_remove(things)
