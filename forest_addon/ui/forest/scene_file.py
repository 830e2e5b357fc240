"""Scene files from the panel: taken into a Blender scene, written from one."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import bpy
from bpy_extras.io_utils import ExportHelper, ImportHelper

from ... import spec
from ...blender.sensors.objects import file_name, sensors_of
from ..settings.exchange import from_spec, to_spec
from ..settings.preferences import rays_of
from ..shell.chosen import choose_sensor
from ..shell.running import PROBLEMS, InOwnScene, in_words
from ..shell.words import say
from .beside import beside_cube


def open_scene(
    scene: bpy.types.Scene, path: Path, keep_sensors: bool = False, beside: bool = False
) -> str:
    """Put a scene file into a Blender scene; returns its name.

    keep_sensors : those of the scene stay, else those of the file take their place. beside : it is moved
    beside Blender's start cube, where that is.

    Raises
    ------
    SpecError : the file cannot be used; nothing is changed.
    """
    from ...formats.toml_file import read_settings

    settings = read_settings(path, spec.Scene)
    if beside:
        settings = beside_cube(scene, settings)
    take_scene(scene, settings, path.resolve().parent, keep_sensors)
    return settings.name


def take_scene(
    scene: bpy.types.Scene, settings: spec.Scene, folder: Path, keep_sensors: bool
) -> None:
    """Put settings into a Blender scene; names of files in them start from ``folder``.

    Raises
    ------
    SpecError : a number that Blender cannot hold; nothing is changed.
    """
    from_spec(scene, settings, keep_sensors)
    scene.forest_sensing.folder = str(folder)
    for layer in scene.view_layers:
        if layer == bpy.context.view_layer and sensors_of(scene):
            choose_sensor(bpy.context, sensors_of(scene)[0])  # active in the scene, too


class FOREST_OT_load_scene(InOwnScene, bpy.types.Operator, ImportHelper):
    """Take forest and sensors from a scene file (.toml), the same that runs without a window"""

    bl_idname = "forest.load_scene"
    bl_label = "Open Scene File"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}
    filename_ext = ".toml"
    filter_glob: bpy.props.StringProperty(default="*.toml", options={"HIDDEN"})
    keep_sensors: bpy.props.BoolProperty(
        name="Keep Sensors",
        description="Sensors of this scene stay beside those of the file; off: those take their place",
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        before = len(sensors_of(context.scene))
        try:
            name = open_scene(context.scene, Path(self.filepath), self.keep_sensors)
        except PROBLEMS as problem:
            self.report({"ERROR"}, in_words(problem))
            return {"CANCELLED"}
        done = say("{name} is loaded. Press Grow Forest to see it", name=name)
        if before and not self.keep_sensors:
            gone = say(
                "Its sensors took the place of {count}; undo brings those back", count=before
            )
            done = f"{done}. {gone}"
        self.report({"INFO"}, done)
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


class FOREST_OT_export_others(bpy.types.Operator):
    """Write the scene into a folder for other programs: OBJ parts, surveys of HELIOS++, JSON, .glb, .blend"""

    bl_idname = "forest.export_others"
    bl_label = "Export for Other Programs"
    directory: bpy.props.StringProperty(
        name="Folder",
        description="Folder that the files go to; made if missing",
        subtype="DIR_PATH",
        options={"SKIP_SAVE"},
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ...blender.files.others import export_for_others
        from ...blender.sensors.observe import Observer
        from ...sensing.lidar.surveys.export import flown

        scene = context.scene
        folder = Path(bpy.path.abspath(self.directory or "//export"))
        home = Path(bpy.path.abspath(scene.forest_sensing.folder))
        told: list[str] = []
        try:
            settings = to_spec(scene)
            observer = Observer(context.evaluated_depsgraph_get(), rays_of(settings.rays))
            ways = {s.name: flown(s) or observer.way(s, home) for s in settings.sensors}
            count = export_for_others(settings, observer.geometry, ways, folder, told.append)
        except PROBLEMS as problem:
            self.report({"ERROR"}, in_words(problem))
            return {"CANCELLED"}
        self.report(
            {"INFO"},
            say(
                "{count} parts are in {folder}; scene.json there says what HELIOS++ has no word for",
                count=count,
                folder=str(folder),
            ),
        )
        return {"FINISHED"}


CLASSES = (FOREST_OT_load_scene, FOREST_OT_save_scene, FOREST_OT_export_others)
