"""Export and removal of a result: written in a format of one's choice, or removed with its points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import bpy
from bpy_extras.io_utils import ExportHelper

from ...blender.scene.layout import RESULTS, find_part
from ...blender.scene.ours import is_ours
from ...blender.sensors.objects import file_name
from ..shell.running import PROBLEMS, in_words
from ..shell.words import say
from . import frames
from .held import find, labels_of, let_go
from .show import heard_of

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


@dataclass(frozen=True)
class Exportable:
    """A result that can be exported: formats, labels by what they are of, offset, how it is written.

    precision : metres, of points that are taken from the file; 0 of a result that is held.
    """

    endings: tuple[str, ...]
    labels: dict[str, Any]
    offset: Any
    write: Callable[[Path, Any], None]
    is_response: bool = False
    precision: float = 0.0


def found_of(scene: bpy.types.Scene, name: str) -> Exportable | None:
    """Return a result as it can be exported: what is held of this session, else the points that the file
    keeps; None where there is neither."""
    from ...results.coordinates import Offset
    from ...results.kinds import results_of, write_as
    from ...results.points import ENDINGS, can_write, write_points

    held = find(scene, name)
    if held is not None:
        record = results_of(held[0])
        endings = tuple(ending for ending in record.endings if can_write(ending))
        return Exportable(
            endings,
            labels_of(scene, name),
            held[2],
            lambda path, labels: write_as(path, *held, labels),
            record.is_response,
        )
    kept = _kept(scene, name)
    if kept is None:
        return None
    offset = Offset(kept.offset, kept.crs)
    return Exportable(
        tuple(ending for ending in ENDINGS if can_write(ending)),
        kept.labels,
        offset,
        lambda path, label: write_points(path, kept.cloud, offset, label),
        precision=kept.precision,
    )


def _kept(scene: bpy.types.Scene, name: str) -> Any:
    """Return the cloud that the object of a result still shows."""
    from ...blender.show.kept_cloud import kept_scan

    results = scene.forest_sensing.results
    shown = scene.objects.get(results[name].shown) if name in results else None
    return kept_scan(shown.data) if shown is not None and shown.type == "MESH" else None


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
        found = found_of(context.scene, self.result)
        if found is None:
            return self._refuse()
        usual = found.endings[0]
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
        found = found_of(context.scene, self.result)
        column = self.layout.column(align=True)
        for ending in found.endings if found is not None else ():
            column.prop_enum(self, "ending", ending[1:].upper())
        if found is not None and found.labels:
            self.layout.prop(self, "labels")
        if self._has_sounds(context):
            self.layout.prop(self, "heard")
            props = context.scene.forest_sensing
            if self.heard:
                self.layout.prop(props, "dry", text="")

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ...formats.crs import can_tell_crs
        from ...formats.wav import write_wav

        found = found_of(context.scene, self.result)
        if found is None:
            return self._refuse()
        path = Path(bpy.path.abspath(self.filepath))
        try:
            if self.heard and found.is_response and path.suffix.lower() == ".wav":
                write_wav(path, *heard_of(context.scene, self.result))
            else:
                found.write(path, found.labels.get(self.labels))
        except PROBLEMS as problem:
            self.report({"ERROR"}, in_words(problem))
            return {"CANCELLED"}
        context.scene.forest_sensing.results[self.result].file = str(path)
        if found.offset.crs and not can_tell_crs():
            problem = say("Written without its coordinate system: Blender has no pyproj")
            self.report({"WARNING"}, problem)
        words = say("Written: {file}", file=path)
        if found.precision:
            words = say(
                "Written: {file}, from the points that this file keeps, to {metres:.1g} m",
                file=path,
                metres=found.precision,
            )
        self.report({"INFO"}, words)
        return {"FINISHED"}

    def _has_sounds(self, context: bpy.types.Context) -> bool:
        """Return whether there is a choice of what sounds: for a reverb that becomes a WAV."""
        found = found_of(context.scene, self.result)
        return found is not None and found.is_response and self.ending == "WAV"

    def _refuse(self) -> set[str]:
        problem = say("{name} is held no longer. Run its sensor again", name=self.result)
        self.report({"ERROR"}, problem)
        return {"CANCELLED"}


class FOREST_OT_remove_result(bpy.types.Operator):
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


def register() -> None:
    """Hear of other files: what is held belongs to this one."""
    bpy.app.handlers.load_pre.append(_let_go)


def unregister() -> None:
    """Take the handler back, and hold nothing."""
    if _let_go in bpy.app.handlers.load_pre:
        bpy.app.handlers.load_pre.remove(_let_go)
    let_go()


@bpy.app.handlers.persistent
def _let_go(*_: object) -> None:
    let_go()
