"""Operators: build the forest, add and run sensors, open and save scene files.

An operator asks the panel's properties for settings, hands them to the rooms below and says what came
of it. Those rooms, and scipy with them, are imported when an operator runs and not before.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import bpy
from bpy_extras.io_utils import ExportHelper, ImportHelper

from .. import spec
from ..blender import sensors
from ..blender.jobs import Task, Work
from ..blender.sensors import file_name
from ..blender.standings import SOLID_TYPES
from ..spec import SpecError
from . import live
from .exchange import add_sensor, from_spec, to_spec, untouched
from .preferences import expansions, rays_of
from .properties import ASSETS
from .running import PROBLEMS, FOREST_OT_cancel, InOwnScene, Working, in_words
from .selection import select
from .species_edit import edited_species, load
from .views import look_at, region_of
from .words import say

DEMO = ASSETS / "scenes" / "demo.toml"


def _import_rooms(_tell: Any) -> None:
    """Import what building and sensing needs, scipy with it: the first time that takes a while."""
    from ..blender import forest, inputs, observe  # noqa: F401
    from ..formats import stand_files  # noqa: F401
    from . import results  # noqa: F401


def _getting_ready() -> Task:
    return Task(say("getting ready"), _import_rooms, whole=True)


class FOREST_OT_build(Working, bpy.types.Operator):
    """Grow the trees and plant them, in place of the forest that stands in this scene"""

    bl_idname = "forest.build"
    bl_label = "Build Forest"

    def work(self, context: bpy.types.Context) -> Work:
        started, scene = time.perf_counter(), context.scene
        yield _getting_ready()
        from ..blender.forest import build
        from ..blender.inputs import inputs_from_scene
        from ..formats.stand_files import read_inputs
        from ..stand.forest import grow_forest
        from .results import keep_forest

        if untouched(scene.forest_sensing):
            open_scene(scene, DEMO)
        settings, edited = to_spec(scene), edited_species(scene)
        mark = live.fingerprint(scene, context.evaluated_depsgraph_get())
        folder = Path(bpy.path.abspath(scene.forest_sensing.folder))
        files = yield Task(say("reading files"), lambda _: read_inputs(settings, folder))
        inputs = inputs_from_scene(settings, context.evaluated_depsgraph_get(), files)

        def grow(tell: Any) -> Any:
            species = [load(planting.species, folder, edited) for planting in settings.plantings]
            return grow_forest(settings, species, tell, inputs)

        forest = yield Task(say("growing trees"), grow)
        first = "forest" not in scene.forest_sensing.results
        build(scene, settings, forest, inputs.terrain)
        scene.forest_sensing.built = mark
        if first and context.area is not None and context.area.type == "VIEW_3D":
            look_at(context.area, settings.forest)
        return keep_forest(context, settings, forest, time.perf_counter() - started)


class FOREST_OT_run(Working, bpy.types.Operator):
    """Run sensors in the scene as it is evaluated now, or on every frame of the frame range"""

    bl_idname = "forest.run"
    bl_label = "Run Sensor"

    sensor: bpy.props.StringProperty(
        name="Sensor",
        description="Name of its object; empty: all of them",
        options={"SKIP_SAVE"},
    )
    frames: bpy.props.EnumProperty(
        name="Frames",
        items=[
            ("THIS", "This Frame", "The scene as it is now"),
            ("RANGE", "Frame Range", "Each frame of the scene's range; files are numbered"),
        ],
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not super().poll(context):
            return False
        if not sensors.sensors_of(context.scene):
            cls.poll_message_set(say("There is no sensor yet. Add one to the list"))
            return False
        if not any(thing.type in SOLID_TYPES for thing in context.view_layer.objects):
            reason = say("There is nothing to sense in this scene. Build a forest first")
            cls.poll_message_set(reason)
            return False
        return True

    def work(self, context: bpy.types.Context) -> Work:
        scene = context.scene
        yield _getting_ready()
        chosen = [t for t in sensors.sensors_of(scene) if self.sensor in ("", t.name)]
        if not chosen:
            problem = say("{name} is no sensor of this scene; add it again", name=self.sensor)
            raise SpecError("sensor", problem)
        to_spec(scene, chosen)  # all of them, before the first one runs
        folder = _folder(scene.forest_sensing.output)
        if self.frames == "THIS":
            return (yield from self._look(context, chosen, folder, ""))
        now, part_of_frame, sentence = scene.frame_current, scene.frame_subframe, ""
        try:
            for frame in range(scene.frame_start, scene.frame_end + 1, scene.frame_step):
                scene.frame_set(frame)
                sentence = yield from self._look(context, chosen, folder, f"-{frame:04d}")
        finally:
            scene.frame_set(now, subframe=part_of_frame)
        return sentence

    def _look(
        self,
        context: bpy.types.Context,
        things: Iterable[bpy.types.Object],
        folder: Path | None,
        number: str,
    ) -> Work:
        """Run these sensors in the scene of one frame."""
        from ..blender.observe import Observer
        from .results import keep_finding, save_finding

        rays = rays_of(to_spec(context.scene, []).rays)
        observer = Observer.of(context.evaluated_depsgraph_get(), rays, expansions())
        if observer.warning:
            self.report({"WARNING"}, observer.warning)
        home = Path(bpy.path.abspath(context.scene.forest_sensing.folder))
        sentence = ""
        for thing in things:
            started = time.perf_counter()
            settings = to_spec(context.scene, [thing])
            (sensor,) = settings.sensors
            observe = partial(observer.observe, sensor, settings, folder=home)
            way = observer.way(sensor, home)
            found = yield Task(f"{thing.name}{number}", partial(observe, way=way))
            sentence = keep_finding(context, thing, sensor, found, time.perf_counter() - started)
            if folder is not None:
                try:
                    numbered = replace(sensor, name=sensor.name + number)
                    path = save_finding(
                        context, folder, thing.name, numbered, found, settings.offset
                    )
                    sentence = say("{found}, saved as {path}", found=sentence, path=path)
                except (OSError, ImportError) as problem:
                    reason = in_words(problem)
                    self.report({"WARNING"}, say("Not saved: {reason}", reason=reason))
        return sentence


class FOREST_OT_add_sensor(InOwnScene, bpy.types.Operator):
    """Add a sensor as an object: move it, turn it, parent it, key it"""

    bl_idname = "forest.add_sensor"
    bl_label = "Add Sensor"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    kind: bpy.props.EnumProperty(
        name="Kind",
        items=[(kind, cls.TITLE, cls.__doc__ or "") for kind, cls in spec.SENSORS.items()],
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = spec.SENSORS[self.kind]()
        thing = add_sensor(context.scene, settings)
        if context.scene.cursor.location.length:
            shift = context.scene.cursor.location - thing.location
            thing.location = context.scene.cursor.location
            thing.location.z = max(thing.location.z, settings_height(settings))
            receiver = sensors.receiver_of(thing)
            if receiver is not None:
                receiver.location += shift
                receiver.location.z = thing.location.z
        _choose(context, thing)
        return {"FINISHED"}


class FOREST_OT_remove_sensor(InOwnScene, bpy.types.Operator):
    """Remove the chosen sensor; what it found stays"""

    bl_idname = "forest.remove_sensor"
    bl_label = "Remove Sensor"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not super().poll(context):
            return False
        if chosen_sensor(context) is None:
            cls.poll_message_set(say("Choose a sensor in the list first"))
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        sensors.remove_sensor(chosen_sensor(context))
        return {"FINISHED"}


class FOREST_OT_load_scene(InOwnScene, bpy.types.Operator, ImportHelper):
    """Take forest and sensors from a scene file (.toml), the same that runs without a window"""

    bl_idname = "forest.load_scene"
    bl_label = "Open Scene File"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}
    filename_ext = ".toml"
    filter_glob: bpy.props.StringProperty(default="*.toml", options={"HIDDEN"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            name = open_scene(context.scene, Path(self.filepath))
        except PROBLEMS as problem:
            self.report({"ERROR"}, in_words(problem))
            return {"CANCELLED"}
        self.report({"INFO"}, say("{name} is loaded. Build the forest to see it", name=name))
        return {"FINISHED"}


class FOREST_OT_save_scene(bpy.types.Operator, ExportHelper):
    """Write forest and sensors to a scene file (.toml) that gives the same results without a window"""

    bl_idname = "forest.save_scene"
    bl_label = "Export Scene File"
    filename_ext = ".toml"
    filter_glob: bpy.props.StringProperty(default="*.toml", options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.filepath = f"{file_name(context.scene.forest_sensing.name)}.toml"
        return ExportHelper.invoke(self, context, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        from .scene_export import write_scene

        try:
            wanting = write_scene(context.scene, Path(self.filepath))
        except PROBLEMS as problem:
            self.report({"ERROR"}, in_words(problem))
            return {"CANCELLED"}
        written = say("Written: {file}", file=self.filepath)
        if wanting:
            self.report({"WARNING"}, f"{written}. {wanting}")
        else:
            self.report({"INFO"}, written)
        return {"FINISHED"}


class FOREST_OT_select_result(bpy.types.Operator):
    """Select these points and show them"""

    bl_idname = "forest.select_result"
    bl_label = "Select Points"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}
    shown: bpy.props.StringProperty(options={"HIDDEN"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.mode != "OBJECT":
            reason = say("Leave this mode first: objects are selected in Object Mode")
            cls.poll_message_set(reason)
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        thing = context.scene.objects.get(self.shown)
        if thing is None:
            problem = say("{name} is no longer in the scene. Run its sensor again", name=self.shown)
            self.report({"ERROR"}, problem)
            return {"CANCELLED"}
        select(context, thing)
        return {"FINISHED"}


class FOREST_OT_new_seed(InOwnScene, bpy.types.Operator):
    """Throw the dice: another seed is another forest. Press Update to see it"""

    bl_idname = "forest.new_seed"
    bl_label = "New Seed"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        props = context.scene.forest_sensing
        # Not a stream of the scene: this is the one place where chance itself is wanted.
        props.seed = secrets.randbelow(1_000_000)
        return {"FINISHED"}


class FOREST_OT_play(bpy.types.Operator):
    """Play what this Speaker sounds like: a click in the forest"""

    bl_idname = "forest.play"
    bl_label = "Play"
    sensor: bpy.props.StringProperty(options={"HIDDEN"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        thing = context.scene.objects.get(self.sensor)
        sound = thing.data.sound if thing is not None and thing.type == "SPEAKER" else None
        if sound is None:
            self.report({"ERROR"}, say("{name} has no sound. Run it again", name=self.sensor))
            return {"CANCELLED"}
        if sound.factory is None:
            self.report({"ERROR"}, "No sound can be played here: this Blender has not loaded it")
            return {"CANCELLED"}
        import aud

        global _playing
        try:
            _playing = aud.Device().play(sound.factory)
        except aud.error as problem:
            self.report({"ERROR"}, say("No sound can be played here: {reason}", reason=problem))
            return {"CANCELLED"}
        return {"FINISHED"}


class FOREST_OT_show_picture(bpy.types.Operator):
    """Show this picture in an Image Editor, below this view where none is open"""

    bl_idname = "forest.show_picture"
    bl_label = "Show in Image Editor"
    result: bpy.props.StringProperty(options={"HIDDEN"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        results = context.scene.forest_sensing.results
        picture = results[self.result].picture if self.result in results else None
        if picture is None:
            self.report({"ERROR"}, "This picture is no longer there. Run its sensor again")
            return {"CANCELLED"}
        area = next((a for a in context.screen.areas if a.type == "IMAGE_EDITOR"), None)
        if area is None:
            known = set(context.screen.areas)
            bpy.ops.screen.area_split(direction="HORIZONTAL", factor=0.45)
            area = next(iter(set(context.screen.areas) - known), None)
            if area is None:
                self.report({"ERROR"}, "There is no room for it here. Open an Image Editor first")
                return {"CANCELLED"}
            area.type = "IMAGE_EDITOR"
        area.spaces.active.image = picture
        with context.temp_override(area=area, region=region_of(area, "WINDOW")):
            bpy.ops.image.view_all(fit_view=True)
        return {"FINISHED"}


CLASSES = (
    FOREST_OT_build,
    FOREST_OT_run,
    FOREST_OT_cancel,
    FOREST_OT_add_sensor,
    FOREST_OT_remove_sensor,
    FOREST_OT_load_scene,
    FOREST_OT_save_scene,
    FOREST_OT_select_result,
    FOREST_OT_show_picture,
    FOREST_OT_new_seed,
    FOREST_OT_play,
)

_playing: Any = None  # what sounds now; it stops when nobody holds it


def open_scene(scene: bpy.types.Scene, path: Path) -> str:
    """Put a scene file into a Blender scene; returns its name.

    Raises
    ------
    SpecError : the file cannot be used; nothing is changed.
    """
    from ..formats.toml_file import read_settings

    settings = read_settings(path, spec.Scene)
    from_spec(scene, settings)
    scene.forest_sensing.folder = str(path.resolve().parent)
    scene.forest_sensing.active_sensor = 0  # active in the scene, too
    return settings.name


def chosen_sensor(context: bpy.types.Context) -> bpy.types.Object | None:
    """The sensor that the panel shows: the active object if it is one, else the list's."""
    thing = context.view_layer.objects.active
    if thing is not None and sensors.kind_of(thing):
        return thing
    home = sensors.home_of(context.scene)
    number = context.scene.forest_sensing.active_sensor
    if home is None or not 0 <= number < len(home.objects):
        return None
    thing = home.objects[number]
    return thing if sensors.kind_of(thing) else None


def settings_height(settings: spec.Settings) -> float:
    """How high above z = 0 a new sensor stands."""
    place = getattr(settings, "position", None) or getattr(settings, "source", (0.0, 0.0, 2.0))
    return float(place[2])


def _choose(context: bpy.types.Context, thing: bpy.types.Object) -> None:
    home = sensors.home_of(context.scene)
    context.view_layer.update()
    context.scene.forest_sensing.active_sensor = list(home.objects).index(thing)


def _folder(output: str) -> Path | None:
    """Where results are saved, made where it is missing; None where they are not.

    Raises
    ------
    SpecError : there can be no such folder.
    """
    if not output:
        return None
    if output.startswith("//") and not bpy.data.filepath:
        problem = say("// means beside the .blend file; save that first")
        raise SpecError(say("Save To"), problem)
    folder = Path(bpy.path.abspath(output))
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        said = say("{folder} cannot be made: {reason}", folder=folder, reason=problem.strerror)
        raise SpecError(say("Save To"), said) from None
    return folder
