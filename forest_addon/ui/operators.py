"""Operators: build the forest, run a sensor in it, open a scene file.

An operator asks the panel's properties for settings, hands them to the rooms below and says what came
of it. Those rooms, and scipy with them, are imported when an operator runs and not before.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import ClassVar

import bpy
from bpy_extras.io_utils import ImportHelper

from .. import spec
from ..spec import SpecError
from . import requirements
from .exchange import from_spec, to_spec, untouched
from .properties import ASSETS

DEMO = ASSETS / "scenes" / "demo.toml"
SOLID_TYPES = {"MESH", "CURVE", "SURFACE", "META", "FONT"}
Tell = Callable[[int, int], None]


class _Work:
    """What every operator that computes shares: when it can run, and how it says what is wrong."""

    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        reason = _obstacle(context)
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            if untouched(context.scene.forest_sensing):
                open_scene(context, DEMO)
            with _progress(context) as tell:
                sentence = self.work(context, tell)
        except (SpecError, ValueError, OSError, ImportError, MemoryError) as problem:
            self.report({"ERROR"}, _in_words(problem))
            return {"CANCELLED"}
        self.report({"INFO"}, sentence)
        return {"FINISHED"}

    def work(self, context: bpy.types.Context, tell: Tell) -> str:
        """Do it; returns a sentence with the key figures."""
        raise NotImplementedError


class FOREST_OT_build(_Work, bpy.types.Operator):
    """Grow the trees and plant them, in place of the forest that stands in this scene"""

    bl_idname = "forest.build"
    bl_label = "Build Forest"

    def work(self, context: bpy.types.Context, tell: Tell) -> str:
        from ..blender.forest import build, root
        from ..formats.species_file import find_species, load_species
        from ..stand.forest import grow_forest
        from .results import keep_forest

        started = time.perf_counter()
        settings = to_spec(context.scene.forest_sensing)
        folder = Path(bpy.path.abspath(context.scene.forest_sensing.folder))
        species = [load_species(find_species(p.species, folder)) for p in settings.plantings]
        forest = grow_forest(settings, species, tell)
        first = root(context.scene) is None
        build(context.scene, settings, forest)
        if first:
            _look_at(context, settings.forest)
        return keep_forest(context, settings, forest, time.perf_counter() - started)


class _Sense(_Work):
    """Running one kind of sensor in the scene as it is evaluated now."""

    kind: ClassVar[str]

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not super().poll(context):
            return False
        if not any(thing.type in SOLID_TYPES for thing in context.view_layer.objects):
            cls.poll_message_set("There is nothing to sense in this scene. Build a forest first")
            return False
        return True

    def work(self, context: bpy.types.Context, tell: Tell) -> str:
        from ..blender.forest import mark_sensors
        from ..blender.observe import Observer
        from .results import keep_finding, save_finding

        started = time.perf_counter()
        props = context.scene.forest_sensing
        settings = to_spec(props, [self.kind])
        folder = _folder(props.output)
        (sensor,) = settings.sensors
        observer = Observer(context.evaluated_depsgraph_get())
        home = Path(bpy.path.abspath(props.folder))
        found = observer.observe(sensor, settings, tell, home)
        mark_sensors(context.scene, settings)
        sentence = keep_finding(context, sensor, found, time.perf_counter() - started)
        if folder is None:
            return sentence
        try:
            return f"{sentence}, saved as {save_finding(context, folder, sensor, found)}"
        except (OSError, ImportError) as problem:
            self.report({"WARNING"}, f"Not saved: {_in_words(problem)}")
            return sentence


class FOREST_OT_scan(_Sense, bpy.types.Operator):
    """Drive the tractor's scanner past the forest and show where its beams end"""

    bl_idname = "forest.scan"
    bl_label = "Drive and Scan"
    kind = "tractor"


class FOREST_OT_sweep(_Sense, bpy.types.Operator):
    """Scan the forest all round from the tripod and show the point cloud"""

    bl_idname = "forest.sweep"
    bl_label = "Scan All Round"
    kind = "terrestrial"


class FOREST_OT_ping(_Sense, bpy.types.Operator):
    """Send one call into the foliage and compute the echo of its leaves"""

    bl_idname = "forest.ping"
    bl_label = "Ping"
    kind = "sonar"


class FOREST_OT_clap(_Sense, bpy.types.Operator):
    """Clap at the source and compute what the receiver hears among the trunks"""

    bl_idname = "forest.clap"
    bl_label = "Clap"
    kind = "reverb"


class FOREST_OT_load_scene(_Work, bpy.types.Operator, ImportHelper):
    """Take forest and sensors from a scene file (.toml), the same that runs without a window"""

    bl_idname = "forest.load_scene"
    bl_label = "Open Scene File"
    filename_ext = ".toml"
    filter_glob: bpy.props.StringProperty(default="*.toml", options={"HIDDEN"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            name, left_out = open_scene(context, Path(self.filepath))
        except (SpecError, ImportError) as problem:
            self.report({"ERROR"}, _in_words(problem))
            return {"CANCELLED"}
        if left_out:
            names = ", ".join(left_out)
            self.report({"WARNING"}, f"The panel has one sensor of a kind; left out: {names}")
        self.report({"INFO"}, f"{name} is loaded. Build the forest to see it")
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
            cls.poll_message_set("Leave this mode first: objects are selected in Object Mode")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        from .results import select

        thing = context.scene.objects.get(self.shown)
        if thing is None:
            self.report({"ERROR"}, f"{self.shown} is no longer in the scene. Run its sensor again")
            return {"CANCELLED"}
        select(context, thing)
        return {"FINISHED"}


CLASSES = (
    FOREST_OT_build,
    FOREST_OT_scan,
    FOREST_OT_sweep,
    FOREST_OT_ping,
    FOREST_OT_clap,
    FOREST_OT_load_scene,
    FOREST_OT_select_result,
)


def open_scene(context: bpy.types.Context, path: Path) -> tuple[str, list[str]]:
    """Put a scene file into the panel; returns its name and the sensors that found no place.

    Raises
    ------
    SpecError : the file cannot be used; nothing is changed.
    """
    from ..formats.toml_file import read_settings

    scene = read_settings(path, spec.Scene)
    left_out = from_spec(context.scene.forest_sensing, scene)
    context.scene.forest_sensing.folder = str(path.resolve().parent)
    return scene.name, left_out


def _obstacle(context: bpy.types.Context) -> str:
    """Why nothing can be computed now; empty where it can."""
    if requirements.missing():
        return f"{requirements.in_words(requirements.missing())}. The panel says what to do"
    if context.mode != "OBJECT":
        return "Leave this mode first: the forest is built and sensed in Object Mode"
    if not context.scene.is_editable:
        return "This scene is linked from another file and cannot be changed"
    return ""


def _folder(output: str) -> Path | None:
    """Where results are saved, made where it is missing; None where they are not.

    Raises
    ------
    SpecError : there can be no such folder.
    """
    if not output:
        return None
    if output.startswith("//") and not bpy.data.filepath:
        raise SpecError("Save To", "// means beside the .blend file; save that first")
    folder = Path(bpy.path.abspath(output))
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise SpecError("Save To", f"{folder} cannot be made: {problem.strerror}") from None
    return folder


def _look_at(context: bpy.types.Context, field: spec.Forest) -> None:
    """Turn the 3D view that was pressed in to the whole field."""
    view = getattr(context.space_data, "region_3d", None)
    if view is None or view.view_perspective == "CAMERA":
        return
    middle = [o + s / 2 for o, s in zip(field.origin, field.size, strict=True)]
    view.view_location = (*middle, 3.0)
    view.view_distance = 1.6 * max(field.size)


@contextmanager
def _progress(context: bpy.types.Context) -> Iterator[Tell]:
    """Show how far a piece of work is, at the mouse pointer."""
    manager = context.window_manager
    manager.progress_begin(0, 100)
    try:
        yield lambda done, total: manager.progress_update(100 * done / max(total, 1))
    finally:
        manager.progress_end()


def _in_words(problem: BaseException) -> str:
    """One sentence for what went wrong, with what to do."""
    if isinstance(problem, ModuleNotFoundError) and problem.name:
        return f"{requirements.in_words((problem.name,))}. {' '.join(requirements.WHAT_TO_DO)}"
    if isinstance(problem, ImportError):
        return f"{problem}. {' '.join(requirements.WHAT_TO_DO)}"
    if isinstance(problem, MemoryError):
        return "There is not enough memory for this; take fewer trees or coarser steps"
    if isinstance(problem, OSError) and problem.strerror and problem.filename:
        return f"{problem.filename}: {problem.strerror}"
    return str(problem)
