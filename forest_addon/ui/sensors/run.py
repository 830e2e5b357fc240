"""Running sensors: one or all, in the scene as it is or frame by frame; results in the panel and a folder."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import bpy

from ...blender import sensors
from ...blender.jobs import Task, Work
from ...blender.standings import SOLID_TYPES
from ...spec import SpecError
from ..exchange import to_spec
from ..preferences import expansions, rays_of
from ..running import Working, getting_ready, in_words
from ..words import say


def _import_rooms(_tell: Any) -> None:
    from ...blender import observe  # noqa: F401
    from ..results import finding  # noqa: F401


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
        yield getting_ready(_import_rooms)
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
        from ...blender.observe import Observer
        from ..results.finding import keep_finding, save_finding

        rays = rays_of(to_spec(context.scene, []).rays)
        observer = Observer.of(context.evaluated_depsgraph_get(), rays, expansions())
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


CLASSES = (FOREST_OT_run,)
