"""A tree of one's own from files: recognised in the background, kept as a species, and planted."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import bpy
from bpy_extras.io_utils import ImportHelper

from ...blender.jobs import Task, Work
from ...blender.sensors.objects import file_name
from ...spec import SpecError
from ..settings.preferences import species_folder
from ..shell.running import PROBLEMS, WhenReady, Working, in_words
from ..shell.words import say
from .pictures import picture_of, refresh

JUDGED = 24  # siblings that are grown to be held to the tree
OF_LEAVES = ("leaf", "leaves", "foliage")  # within the name of the file that holds them
OF_WOOD = ("wood", "stem", "trunk", "branches")


class FOREST_OT_import_tree(WhenReady, bpy.types.Operator, ImportHelper):
    """Make a species from files of a tree: one of its wood and, if there is, one of its leaves"""

    bl_idname = "forest.import_tree"
    bl_label = "Import STL"
    bl_options: ClassVar[set[str]] = set()  # it starts a job, which is not redone
    filename_ext = ".stl"
    filter_glob: bpy.props.StringProperty(
        default="*.stl;*.ply;*.obj;*.gltf;*.glb", options={"HIDDEN"}
    )
    files: bpy.props.CollectionProperty(
        type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"}
    )
    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN"})
    title: bpy.props.StringProperty(
        name="Name", description="Name of the species; empty: as the file", options={"SKIP_SAVE"}
    )
    height: bpy.props.FloatProperty(
        name="Height",
        description="Height of the tree; 0: the unit of the files is inferred",
        unit="LENGTH",
        min=0,
        max=200,
        options={"SKIP_SAVE"},
    )
    accept: bpy.props.BoolProperty(
        name="Accept",
        description="Plant siblings of the tree even if they are too unlike it",
        options={"SKIP_SAVE"},
    )

    def draw(self, _context: bpy.types.Context) -> None:
        layout = self.layout
        column = layout.column(align=True)
        column.label(text="Choose the file of the wood and,")
        column.label(text="with Ctrl, that of the leaves, or one of both.")
        column = layout.column()
        column.use_property_split = True
        column.use_property_decorate = False
        column.prop(self, "title", placeholder="As the file")
        column.prop(self, "height")
        column.prop(self, "accept")

    def execute(self, _context: bpy.types.Context) -> set[str]:
        named = [Path(self.directory) / file.name for file in self.files if file.name]
        try:
            wood, leaves = parts_of(named or [Path(self.filepath)])
            return bpy.ops.forest.make_species(
                "EXEC_DEFAULT" if bpy.app.background else "INVOKE_DEFAULT",
                wood=str(wood),
                leaves=str(leaves or ""),
                title=self.title or title_from(wood),
                height=self.height,
                accept=self.accept,
            ) and {"FINISHED"}
        except (*PROBLEMS, RuntimeError) as problem:
            self.report({"ERROR"}, in_words(problem).removeprefix("Error: ").strip())
            return {"CANCELLED"}


class FOREST_OT_make_species(Working, bpy.types.Operator):
    """Recognise a tree in files, keep it as a species and plant it"""

    bl_idname = "forest.make_species"
    bl_label = "Import STL"

    wood: bpy.props.StringProperty(name="Wood", subtype="FILE_PATH", options={"SKIP_SAVE"})
    leaves: bpy.props.StringProperty(name="Leaves", subtype="FILE_PATH", options={"SKIP_SAVE"})
    title: bpy.props.StringProperty(name="Name", options={"SKIP_SAVE"})
    height: bpy.props.FloatProperty(name="Height", unit="LENGTH", options={"SKIP_SAVE"})
    accept: bpy.props.BoolProperty(name="Accept", options={"SKIP_SAVE"})

    def work(self, context: bpy.types.Context) -> Work:
        from ...base.progress import Progress
        from ...blender.files.tree_files import read_parts
        from ...blender.scene.assets import on_paper
        from ...formats.atomic import replacing
        from ...formats.raster_file import write_png
        from ...growth.library.template_library import Brought, Library, check_name, make_library
        from ...spec import Look

        props = context.scene.forest_sensing
        wood, leaves = Path(self.wood), Path(self.leaves) if self.leaves else None
        accept, height = self.accept, self.height
        name = self.title or title_from(wood)
        check_name(name)
        plain = all(path.suffix.lower() == ".stl" for path in (wood, leaves) if path)
        groups = [] if plain else read_parts(wood, leaves)
        folder = free_folder(species_folder(), name)
        brought = Brought(wood, leaves, height, groups=groups)

        def recognise(tell: Progress) -> Library:
            made = make_library(brought, folder.name, folder, tell, siblings=JUDGED, accept=accept)
            picture = on_paper(made.wood, made.leaves, Look())
            with replacing(picture_of(made.species)) as file:
                file.write_bytes(write_png(picture))
            return made

        made = yield Task(say("recognising the tree"), recognise)
        if made.verdict is not None and not made.verdict.stands and not accept:
            shutil.rmtree(folder)
            problem = say("tick Accept to plant them all the same")
            raise SpecError(say("Import STL"), f"{made.verdict.sentence}; {problem}")
        planting = props.plantings.add()
        planting.species = made.species.as_posix()
        planting.use_expected = True
        props.active_plantings = len(props.plantings) - 1
        refresh()
        if made.verdict is not None and made.verdict.missed:
            return f"{folder.name}: {made.verdict.sentence}"
        return say(
            "{name}: {branches:,} branches, {leaves:,} leaves, {height:.2f} m high ({unit})",
            name=folder.name,
            branches=made.branches,
            leaves=made.leaf_count,
            height=made.height,
            unit=made.unit.name,
        )


CLASSES = (FOREST_OT_import_tree, FOREST_OT_make_species)


def parts_of(files: Sequence[Path]) -> tuple[Path, Path | None]:
    """Return which of the files that were chosen is the wood and which the leaves.

    Raises
    ------
    SpecError : there are more than two, or their names do not tell.
    """
    if len(files) > 2:
        problem = say("{count} files are chosen; choose wood and leaves only", count=len(files))
        raise SpecError(say("Import STL"), problem)
    if len(files) == 1:
        return files[0], None
    leafy = [any(word in file.stem.lower() for word in OF_LEAVES) for file in files]
    if sum(leafy) != 1:
        problem = say('names do not tell wood from leaves; have "leaves" in one of them')
        raise SpecError(say("Import STL"), problem)
    return files[leafy.index(False)], files[leafy.index(True)]


def title_from(wood: Path) -> str:
    """A name for the species from its file, or from the folder where the file is just called wood."""
    plain = wood.stem.lower() in OF_WOOD and wood.parent.name
    return file_name(wood.parent.name if plain else wood.stem)


def free_folder(home: Path, name: str) -> Path:
    """A folder of this name that is not there yet; numbered where there is one."""
    folder, number = home / name, 1
    while folder.exists():
        number += 1
        folder = home / f"{name}-{number}"
    return folder
