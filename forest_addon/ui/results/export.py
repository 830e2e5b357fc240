"""Export and removal of a result: written in a format of one's choice, or removed with its points."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import bpy
from bpy_extras.io_utils import ExportHelper

from ...blender.scene.layout import RESULTS, find_part, is_ours
from ...blender.sensors.objects import file_name
from ...spec import SpecError
from ..shell.running import PROBLEMS, InOwnScene, in_words
from ..shell.words import say
from . import frames
from .show import heard_of
from .shown import points_of

if TYPE_CHECKING:
    from ...results.coordinates import Offset

WORDS = {
    ".laz": ("LAZ", "A compressed point cloud with all labels"),
    ".las": ("LAS", "A point cloud with all labels"),
    ".ply": ("PLY", "A point cloud with all labels, binary"),
    ".copc.laz": ("COPC", "A point cloud that viewers stream, with all labels"),
    ".e57": ("E57", "A point cloud with the scanner's pose and a panorama"),
    ".pcd": ("PCD", "A point cloud with all labels, for PCL and ROS"),
    ".xyz": ("XYZ", "A point cloud as lines of text"),
    ".sofa": ("SOFA", "Impulse responses with their places (AES69)"),
    ".wav": ("WAV", "A sound; echoes slowed down for human ears"),
    ".npz": ("NPZ", "Arrays for Python"),
    ".csv": ("CSV", "A table, for spreadsheets"),
}


def endings_of(result: Any) -> tuple[str, ...]:
    """Return the endings of files that a result can be written to; none where nothing of it is kept."""
    from ...results.kinds import RESULTS
    from ...results.points import can_write

    if not (result.found or _scan_of(result)):
        return ()
    return tuple(ending for ending in RESULTS[result.kind].endings if can_write(ending))


def _scan_of(result: Any) -> bpy.types.Mesh | None:
    """The points that the object of a result shows, where those are all that it is."""
    from ...blender.show.cloud import is_scan

    shown = points_of(result)
    return (
        shown.data if shown is not None and shown.type == "MESH" and is_scan(shown.data) else None
    )


def _write(path: Path, result: Any, label: str) -> Offset:
    """Write a result as it is shown; returns the offset that was added to its positions."""
    from ...blender.show.cloud import kept_scan
    from ...results.coordinates import Offset
    from ...results.kinds import write_as
    from ...results.points import write_points
    from .kept import unpack

    data = _scan_of(result)
    if data is None:
        sensor, found, offset = unpack(result.found)
        write_as(path, sensor, found, offset)
        return offset
    kept = kept_scan(data)
    offset = Offset(kept.offset, kept.crs)
    write_points(path, kept.cloud, offset, kept.labels.get(label))
    return offset


def _is_response(result: Any) -> bool:
    """Return whether there is a choice of what sounds when it becomes a WAV."""
    from ...results.kinds import RESULTS

    return result is not None and result.kind in RESULTS and RESULTS[result.kind].is_response


class FOREST_OT_export_result(bpy.types.Operator, ExportHelper):
    """Write this result to a file; its ending says in which format"""

    bl_idname = "forest.export_result"
    bl_label = "Export Result"
    filename_ext = ""
    check_extension = False

    result: bpy.props.StringProperty(options={"HIDDEN"})
    filter_glob: bpy.props.StringProperty(
        default=";".join(f"*{ending}" for ending in WORDS), options={"HIDDEN"}
    )
    ending: bpy.props.EnumProperty(
        name="Format",
        description="Which kind of file",
        items=[(ending[1:].upper(), name, words) for ending, (name, words) in WORDS.items()],
        options={"SKIP_SAVE"},
    )
    labels: bpy.props.EnumProperty(
        name="Labels",
        description="What points are classed by; the file holds the names",
        items=[
            ("CLASS", "Class", "Other, wood, leaf, ground"),
            ("OBJECT", "Object", "The object that was hit, by its name"),
            ("SPECIES", "Species", "The species of the tree, by its name"),
            ("MATERIAL", "Material", "The material that was hit, by its name"),
        ],
    )
    heard: bpy.props.BoolProperty(
        name="As It Is Played",
        description="The chosen sound as it is heard in the forest, not the impulse response",
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        endings = self._endings(context)
        if not endings:
            return self._refuse()
        usual = endings[0]
        self.ending = usual[1:].upper()
        self.filepath = f"{file_name(self.result)}{usual}"
        return ExportHelper.invoke(self, context, event)

    def check(self, _context: bpy.types.Context) -> bool:
        """The name follows the format that is chosen beside it."""
        from ...results.points import ending_of

        path = Path(self.filepath)
        had = ending_of(path)
        if had not in WORDS or not path.name:
            return False
        renamed = str(path.with_name(path.name[: -len(had)] + f".{self.ending.lower()}"))
        if renamed == self.filepath:
            return False
        self.filepath = renamed
        return True

    def draw(self, context: bpy.types.Context) -> None:
        column = self.layout.column(align=True)
        for ending in self._endings(context):
            column.prop_enum(self, "ending", ending[1:].upper())
        result = context.scene.forest_sensing.results.get(self.result)
        if result is not None and _scan_of(result) is not None:
            self.layout.prop(self, "labels")
        if self.ending == "WAV" and _is_response(result):
            self.layout.prop(self, "heard")
            props = context.scene.forest_sensing
            if self.heard:
                self.layout.prop(props, "dry", text="")

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ...formats.crs import can_tell_crs
        from ...formats.wav import write_wav
        from ...results.points import ending_of

        endings = self._endings(context)
        if not endings:
            return self._refuse()
        path = Path(bpy.path.abspath(self.filepath))
        result, crs = context.scene.forest_sensing.results[self.result], ""
        try:
            if ending_of(path) not in endings:
                raise SpecError(
                    path.name,
                    say(
                        'cannot be written as "{ending}"; use {endings}',
                        ending=ending_of(path),
                        endings=", ".join(endings),
                    ),
                )
            if self.heard and _is_response(result) and path.suffix.lower() == ".wav":
                write_wav(path, *heard_of(result))
            else:
                crs = _write(path, result, self.labels).crs
        except PROBLEMS as problem:
            self.report({"ERROR"}, in_words(problem))
            return {"CANCELLED"}
        if context.scene.is_editable:
            result.file = str(path)
        if crs and not can_tell_crs():
            problem = say("Written without its coordinate system: Blender has no pyproj")
            self.report({"WARNING"}, problem)
        self.report({"INFO"}, say("Written: {file}", file=path))
        return {"FINISHED"}

    def _endings(self, context: bpy.types.Context) -> tuple[str, ...]:
        result = context.scene.forest_sensing.results.get(self.result)
        return () if result is None else endings_of(result)

    def _refuse(self) -> set[str]:
        problem = say("{name} is not kept in this file. Run its sensor again", name=self.result)
        self.report({"ERROR"}, problem)
        return {"CANCELLED"}


class FOREST_OT_remove_result(InOwnScene, bpy.types.Operator):
    """Remove this result, with its points and its picture; files that were written stay"""

    bl_idname = "forest.remove_result"
    bl_label = "Remove Result"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    result: bpy.props.StringProperty(options={"HIDDEN"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        results = context.scene.forest_sensing.results
        number = results.find(self.result)
        if number < 0:
            self.report({"ERROR"}, say("{name} is no longer there", name=self.result))
            return {"CANCELLED"}
        shown = context.scene.objects.get(results[number].shown)
        left = frames.blocks_of(results[number])
        results.remove(number)
        home = find_part(context.scene, RESULTS)
        if shown is not None and home is not None and shown.name in home.objects and is_ours(shown):
            left.append(shown.data)
            bpy.data.objects.remove(shown)
        frames.let_go(left)
        return {"FINISHED"}


CLASSES = (FOREST_OT_export_result, FOREST_OT_remove_result)
