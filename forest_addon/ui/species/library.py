"""An asset library from a button: the scene's species as assets, and the library among Blender's own.

Nothing is added to the preferences but by the button that says so.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import bpy

from ...blender.jobs import Task, Work
from ..settings.preferences import library_folder
from ..shell.running import Working, getting_ready
from ..shell.words import say
from .edit import edited_species, load

NAME = "Forest Sensing"
SEED = 1
FIRST = ("norway-maple", "silver-birch", "norway-spruce", "hazelnut")  # where nothing is planted


def _import_rooms(_tell: Any) -> None:
    pass


class FOREST_OT_make_library(Working, bpy.types.Operator):
    """Write trees of this scene's species, or four usual ones, as assets for the Asset Browser"""

    bl_idname = "forest.make_library"
    bl_label = "Make Asset Library"

    variants: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Trees", description="How many of each species", default=4, min=1, max=200
    )
    add: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Add", description="Add it to Blender's asset libraries", options={"SKIP_SAVE"}
    )

    def work(self, context: bpy.types.Context) -> Work:
        yield getting_ready(_import_rooms)
        from ...blender.library.build import grow_exhibits, write_species

        props, out = context.scene.forest_sensing, library_folder()
        folder = Path(bpy.path.abspath(props.folder))
        edited, count = edited_species(context.scene), int(self.variants)
        names = list(dict.fromkeys(p.species for p in props.plantings if p.species)) or [*FIRST]
        for done, name in enumerate(names):
            loaded = yield Task(
                say("reading files"), lambda _, name=name: load(name, folder, edited)
            )
            exhibits = yield Task(
                say("growing trees"),
                lambda tell, loaded=loaded: grow_exhibits(*loaded, count, SEED, tell),
                span=(done / len(names), (done + 1) / len(names)),
            )
            write_species(out, loaded[0], exhibits)
        if self.add and not _is_added(context):
            _add(context)
        return say("{trees} trees in {folder}", trees=count * len(names), folder=out)


class FOREST_OT_add_library(bpy.types.Operator):
    """Add the folder of trees to Blender's asset libraries; where it is empty, trees are made first"""

    bl_idname = "forest.add_library"
    bl_label = "Add to Asset Libraries"
    bl_options: ClassVar[set[str]] = set()

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if _is_added(context):
            cls.poll_message_set(say("It is among Blender's asset libraries already"))
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        if not any(library_folder().glob("*.blend")):
            how = "EXEC_DEFAULT" if bpy.app.background else "INVOKE_DEFAULT"
            try:
                return set(bpy.ops.forest.make_library(how, add=True))
            except RuntimeError as refusal:
                self.report({"ERROR"}, str(refusal).removeprefix("Error: ").strip())
                return {"CANCELLED"}
        _add(context)
        self.report({"INFO"}, say("The Asset Browser has it as {name}", name=NAME))
        return {"FINISHED"}


def _add(context: bpy.types.Context) -> None:
    libraries = context.preferences.filepaths.asset_libraries
    libraries.new(name=NAME, directory=str(library_folder()))
    context.preferences.is_dirty = True


def _is_added(context: bpy.types.Context) -> bool:
    mine = library_folder().resolve()
    known = context.preferences.filepaths.asset_libraries
    return any(Path(bpy.path.abspath(one.path)).resolve() == mine for one in known)


CLASSES = (FOREST_OT_make_library, FOREST_OT_add_library)
