"""Results that are kept: frame by frame, by the names of their sensors, and which of them views show.

The panel keeps the last result of each kind, the newest first; views show the points of one at a time, unless
several are asked for. Of a frame range, a result holds a mesh, a picture, a sound, what is exported, figures
and a legend of every frame that ran. When Blender goes to a frame, all that shows the result is given those
of that frame, or of the last one before it that ran. A result whose sensor is renamed follows, with its
points.

Operators of a result's icons select its points, show its picture, play its sound, export and remove it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import bpy
import numpy as np
from bpy_extras.io_utils import ExportHelper

from ...blender.scene.layout import CLOUD_KEY, FRAME_KEY, RESULTS, find_part, is_ours
from ...blender.sensors.objects import file_name, kind_of, sensors_of
from ...spec import SpecError
from ..shell.running import Button, Reading
from ..shell.views import redraw_panels, region_of, select, show
from ..shell.words import say

if TYPE_CHECKING:
    from ...results.coordinates import Offset


def blocks_of(result: Any) -> list[bpy.types.ID | None]:
    """The points, pictures and sounds that a result holds."""
    of_frames = ((each.points, each.picture, each.sound) for each in result.frames)
    return [result.picture, *(block for blocks in of_frames for block in blocks)]


def hold_frame(result: Any, frame: int, sound: bpy.types.Sound | None) -> None:
    """Keep what a result shows now for a frame, beside what is kept of others. sound : of its Speaker."""
    shown = bpy.data.objects.get(result.shown)
    points = shown.data if shown is not None else None
    if points is not None:
        points[FRAME_KEY] = frame
    numbers = [each.frame for each in result.frames]
    if frame in numbers:
        item = result.frames[numbers.index(frame)]
    else:
        result.frames.add()
        at = sum(number < frame for number in numbers)
        result.frames.move(len(numbers), at)
        item = result.frames[at]
    item.frame, item.said, item.found = frame, _said_of(result), result.found
    item.points, item.picture, item.sound = points, result.picture, sound


def tell_again(result: Any, frame: int) -> None:
    """Note what a result says by now, where it is kept for this frame."""
    for each in result.frames:
        if each.frame == frame:
            each.said = _said_of(result)


def _said_of(result: Any) -> str:
    """Figures and legend of a result as one text: hundreds of frames have hundreds of lines each."""
    figures = [(each.name, each.value, each.made_of) for each in result.figures]
    legend = [(each.name, each.choice, *each.colour) for each in result.legend]
    return json.dumps((figures, legend))


def set_figures(result: Any, figures: Iterable[tuple[str, str, str]]) -> None:
    """Add figures to a result, or change them: name, value, and what says the value in another language."""
    for name, value, made_of in figures:
        item = result.figures.get(name) or result.figures.add()
        item.name, item.value, item.made_of = name, value, made_of


def set_legend(result: Any, legend: Iterable[tuple[str, str, Sequence[float]]]) -> None:
    """Have a result explain its colours: choice of the menu, name and colour of each."""
    result.legend.clear()
    for choice, name, colour in legend:
        item = result.legend.add()
        item.name, item.choice, item.colour = name, choice, colour


def begin_frames(scene: bpy.types.Scene, name: str) -> None:
    """Keep nothing of earlier frames of a sensor any longer, but what is shown now."""
    result = scene.forest_sensing.results.get(name)
    if result is None:
        return
    left = blocks_of(result)
    for each in result.frames:
        if each.points is not None:
            del each.points[FRAME_KEY]  # it is points as any other now
    result.frames.clear()
    let_go(left)


def let_go(blocks: Iterable[bpy.types.ID | None]) -> None:
    """Remove those of these points, pictures and sounds that nothing shows or keeps any longer."""
    there = {block for block in blocks if block is not None}
    bpy.data.batch_remove([block for block in there if not block.users])


def show_frame(scene: bpy.types.Scene) -> None:
    """Give every result all that is kept of the frame that the scene is at."""
    for result in scene.forest_sensing.results:
        if not result.frames:
            continue
        now = scene.frame_current
        before = [each for each in result.frames if each.frame <= now]
        each = before[-1] if before else result.frames[0]
        thing = scene.objects.get(result.shown)
        ours = thing is not None and CLOUD_KEY in thing and FRAME_KEY in thing.data
        if ours and each.points is not None and thing.data != each.points:
            thing.data = each.points
        speaker = scene.objects.get(result.name)
        if each.sound is not None and speaker is not None and speaker.type == "SPEAKER":
            speaker.data.sound = each.sound
        if bpy.app.is_job_running("RENDER"):
            continue  # its thread goes from frame to frame while windows draw the panel
        if each.picture is not None and result.picture != each.picture:
            result.picture = each.picture
        result.found = each.found
        if each.said and each.said != _said_of(result):  # nothing, in files of before
            figures, legend = json.loads(each.said)
            result.figures.clear()
            set_figures(result, figures)
            set_legend(result, ((choice, name, colour) for name, choice, *colour in legend))
            redraw_panels()


@bpy.app.handlers.persistent
def _to_frame(scene: bpy.types.Scene, _depsgraph: object = None) -> None:
    if scene.is_editable:
        show_frame(scene)


_sensor_of: dict[tuple[int, str], int] = {}  # uid of a sensor, by scene and name of its result


def follow_names(scene: bpy.types.Scene) -> None:
    """Rename results whose sensor has another name by now."""
    results = scene.forest_sensing.results
    for result in results:
        key = scene.session_uid, result.name
        thing = scene.objects.get(result.name)
        if thing is not None and kind_of(thing) == result.kind:
            _sensor_of[key] = thing.session_uid
            continue
        uid = _sensor_of.pop(key, None)
        if uid is None:
            continue
        thing = next((t for t in sensors_of(scene) if t.session_uid == uid), None)
        if thing is not None and thing.name not in results:
            _rename(scene, result, thing.name)
            _sensor_of[scene.session_uid, thing.name] = uid


def _rename(scene: bpy.types.Scene, result: Any, name: str) -> None:
    """Call a result otherwise, and its points, unless the user has named those."""
    from ...blender.show.cloud import rename_cloud  # brings in scipy

    if result.title == result.name:
        result.title = name
    result.name = name
    shown = scene.objects.get(result.shown)
    if shown is not None and CLOUD_KEY in shown:
        rename_cloud(shown, file_name(name))
        result.shown = shown.name


def unregister() -> None:
    """Forget the sensors."""
    _sensor_of.clear()


@bpy.app.handlers.persistent
def _look(scene: bpy.types.Scene, _depsgraph: object) -> None:
    if scene.is_editable and len(scene.forest_sensing.results):
        follow_names(scene)


HANDLERS = (("frame_change_pre", _to_frame), ("depsgraph_update_post", _look))


class FOREST_OT_show_result(Reading, bpy.types.Operator):
    """Show these points alone, or hide them; with Shift beside those that are shown"""

    bl_idname = "forest.show_result"
    bl_label = "Show Points"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}
    result: bpy.props.StringProperty(options={"HIDDEN"})
    more: bpy.props.BoolProperty(
        name="Beside Others", description="Other points stay as they are", options={"SKIP_SAVE"}
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.more = event.shift
        return self.execute(context)

    def act(self, context: bpy.types.Context) -> str:
        results = context.scene.forest_sensing.results
        thing = points_of(results[self.result]) if self.result in results else None
        if thing is None:
            raise ValueError(
                say("{name} has no points here. Run its sensor again", name=self.result)
            )
        if thing.visible_get():
            thing.hide_set(True)
        else:
            show_result(context, results[self.result], self.more)
        return ""


def points_of(result: Any) -> bpy.types.Object | None:
    """The object of a result's points in its scene, None where there is none."""
    return result.id_data.objects.get(result.shown) if result.shown else None


def record_of(result: Any) -> Any:
    """Return what there is to know of results of this kind; None of the forest, and of no result."""
    from ...results.kinds import RESULTS as KINDS_OF_RESULTS

    return None if result is None else KINDS_OF_RESULTS.get(result.kind)


def show_result(context: bpy.types.Context, result: Any, more: bool = False) -> None:
    """Show the points of a result, and hide those of others. more : those stay as they are."""
    thing = points_of(result)
    if thing is None:
        return
    show(context, thing)  # not selected: all points would be orange
    for other in () if more else context.scene.forest_sensing.results:
        points = points_of(other)
        if points is not None and points != thing and CLOUD_KEY in points and points.visible_get():
            points.hide_set(True)


EARS = 2  # channels that are played; files have all

_playing: Any = None  # what sounds now, and its sound; it stops when nobody holds it


class FOREST_OT_select_result(Reading, bpy.types.Operator):
    """Select these points and show them"""

    bl_idname = "forest.select_result"
    bl_label = "Select Points"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}
    shown: bpy.props.StringProperty(options={"HIDDEN"})

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        if context.mode == "OBJECT":
            return ""
        return say("Leave this mode first: objects are selected in Object Mode")

    def act(self, context: bpy.types.Context) -> str:
        thing = context.scene.objects.get(self.shown)
        if thing is None:
            problem = say("{name} is no longer in the scene. Run its sensor again", name=self.shown)
            raise ValueError(problem)
        select(context, thing)
        return ""


class FOREST_OT_play(Reading, bpy.types.Operator):
    """Play it: a reverb as the chosen sound is heard in the forest, an echo slowed down for human ears"""

    bl_idname = "forest.play"
    bl_label = "Play"
    sensor: bpy.props.StringProperty(options={"HIDDEN"})

    def act(self, context: bpy.types.Context) -> str:
        import aud

        global _playing
        result = context.scene.forest_sensing.results.get(self.sensor)
        heard = None if result is None else heard_of(result)
        if heard is None:
            raise ValueError(say("{name} has no sound. Run it again", name=self.sensor))
        samples, rate = heard
        try:
            sound = aud.Sound.buffer(np.ascontiguousarray(samples[:, :EARS], np.float32), rate)
            _playing = aud.Device().play(sound), sound
        except aud.error as problem:
            raise ValueError(say("No sound can be played here: {reason}", reason=problem)) from None
        return ""


def heard_of(result: Any) -> tuple[np.ndarray, float] | None:
    """Return what a result sounds like: (N, C) samples and their rate, as its WAV has them; None: like
    nothing, or nothing of it is kept.

    An echo is slowed down; a reverb is what the scene's dry sound becomes in the forest.

    Raises
    ------
    SpecError : the file of the dry sound cannot be used.
    """
    from ...results.dry_sounds import PEAK_DB, dry_sound
    from ...sensing.reverb.auralise import normalised
    from .finding import unpack

    if not result.found:
        return None
    record, (sensor, found, _) = record_of(result), unpack(result.found)
    assert record.sound is not None, "what has no points sounds"
    response, rate = record.sound(sensor, found)
    if not record.is_response:
        return response, rate
    props = result.id_data.forest_sensing
    if props.dry == "NONE" or record.wet is None:
        return normalised(np.reshape(response, (len(response), -1)), PEAK_DB)[0], rate
    dry = dry_sound(props.dry.lower(), Path(bpy.path.abspath(props.dry_file)))
    wet, rate = record.wet(sensor, found, *dry)
    return normalised(wet, PEAK_DB)[0], rate


class FOREST_OT_show_picture(Reading, bpy.types.Operator):
    """Show this picture in an Image Editor, below this view where none is open"""

    bl_idname = "forest.show_picture"
    bl_label = "Show in Image Editor"
    result: bpy.props.StringProperty(options={"HIDDEN"})

    def act(self, context: bpy.types.Context) -> str:
        results = context.scene.forest_sensing.results
        picture = results[self.result].picture if self.result in results else None
        if picture is None:
            raise ValueError(say("This picture is no longer there. Run its sensor again"))
        area = next((a for a in context.screen.areas if a.type == "IMAGE_EDITOR"), None)
        if area is None:
            known = set(context.screen.areas)
            bpy.ops.screen.area_split(direction="HORIZONTAL", factor=0.45)
            area = next(iter(set(context.screen.areas) - known), None)
            if area is None:
                raise ValueError(say("There is no room for it here. Open an Image Editor first"))
            area.type = "IMAGE_EDITOR"
        area.spaces.active.image = picture
        with context.temp_override(area=area, region=region_of(area, "WINDOW")):
            bpy.ops.image.view_all(fit_view=True)
        return ""


WORDS = {
    ".laz": ("LAZ", "A compressed point cloud with all labels"),
    ".las": ("LAS", "A point cloud with all labels"),
    ".ply": ("PLY", "A point cloud with all labels, binary"),
    ".copc.laz": ("COPC", "A point cloud that viewers stream, with all labels"),
    ".e57": ("E57", "A point cloud with the scanner's pose and a panorama"),
    ".pcd": ("PCD", "A point cloud with all labels, for PCL and ROS"),
    ".double.ply": ("PLY, Doubles", "A binary PLY whose places are whole coordinates"),
    ".double.pcd": ("PCD, Doubles", "A PCD whose places are whole coordinates"),
    ".xyz": ("XYZ", "A point cloud as lines of text"),
    ".sofa": ("SOFA", "Impulse responses with their places (AES69)"),
    ".wav": ("WAV", "A sound; echoes slowed down for human ears"),
    ".npz": ("NPZ", "Arrays for Python"),
    ".csv": ("CSV", "A table, for spreadsheets"),
}


def endings_of(result: Any) -> tuple[str, ...]:
    """Return the endings of files that a result can be written to; none where nothing of it is kept."""
    from ...results.points import can_write

    if not (result.found or _scan_of(result)):
        return ()
    return tuple(ending for ending in record_of(result).endings if can_write(ending))


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
    from .finding import unpack

    data = _scan_of(result)
    if data is None:
        sensor, found, offset = unpack(result.found)
        write_as(path, sensor, found, offset)
        return offset
    kept = kept_scan(data)
    offset = Offset(kept.offset, kept.crs)
    write_points(path, kept.cloud, offset, kept.labels.get(label))
    return offset


class FOREST_OT_export_result(Reading, bpy.types.Operator, ExportHelper):
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
            return self.execute(context)  # which says why
        usual = endings[0]
        self.ending = usual[1:].upper()
        self.filepath = f"{file_name(self.result)}{usual}"
        return ExportHelper.invoke(self, context, event)

    def check(self, _context: bpy.types.Context) -> bool:
        """The name follows the format that is chosen beside it."""
        from ...results.points import ending_of

        path, before = Path(self.filepath), self.filepath
        had = ending_of(path)
        if had in WORDS and path.name:
            self.filepath = str(path.with_name(path.name[: -len(had)] + f".{self.ending.lower()}"))
        return self.filepath != before

    def draw(self, context: bpy.types.Context) -> None:
        column = self.layout.column(align=True)
        for ending in self._endings(context):
            column.prop_enum(self, "ending", ending[1:].upper())
        props = context.scene.forest_sensing
        result, record = props.results.get(self.result), record_of(props.results.get(self.result))
        if result is not None and _scan_of(result) is not None:
            self.layout.prop(self, "labels")
        if self.ending == "WAV" and record is not None and record.is_response:
            self.layout.prop(self, "heard")
            if self.heard:
                self.layout.prop(props, "dry", text="")

    def act(self, context: bpy.types.Context) -> str:
        from ...formats.crs import can_tell_crs
        from ...formats.wav import write_wav
        from ...results.points import ending_of

        endings = self._endings(context)
        if not endings:
            problem = say("{name} is not kept in this file. Run its sensor again", name=self.result)
            raise ValueError(problem)
        path = Path(bpy.path.abspath(self.filepath))
        result, crs = context.scene.forest_sensing.results[self.result], ""
        if ending_of(path) not in endings:
            problem = say(
                'cannot be written as "{ending}"; use {endings}',
                ending=ending_of(path),
                endings=", ".join(endings),
            )
            raise SpecError(path.name, problem)
        if self.heard and record_of(result).is_response and path.suffix.lower() == ".wav":
            write_wav(path, *heard_of(result))
        else:
            crs = _write(path, result, self.labels).crs
        if context.scene.is_editable:
            result.file = str(path)
        if crs and not can_tell_crs():
            problem = say("Written without its coordinate system: Blender has no pyproj")
            self.report({"WARNING"}, problem)
        return say("Written: {file}", file=path)

    def _endings(self, context: bpy.types.Context) -> tuple[str, ...]:
        result = context.scene.forest_sensing.results.get(self.result)
        return () if result is None else endings_of(result)


class FOREST_OT_remove_result(Button, bpy.types.Operator):
    """Remove this result, with its points and its picture; files that were written stay"""

    bl_idname = "forest.remove_result"
    bl_label = "Remove Result"

    result: bpy.props.StringProperty(options={"HIDDEN"})

    def act(self, context: bpy.types.Context) -> str:
        results = context.scene.forest_sensing.results
        number = results.find(self.result)
        if number < 0:
            raise ValueError(say("{name} is no longer there", name=self.result))
        shown = context.scene.objects.get(results[number].shown)
        left = blocks_of(results[number])
        results.remove(number)
        home = find_part(context.scene, RESULTS)
        if shown is not None and home is not None and shown.name in home.objects and is_ours(shown):
            left.append(shown.data)
            bpy.data.objects.remove(shown)
        let_go(left)
        return ""
