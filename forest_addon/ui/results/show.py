"""Operators of a result's icons: select its points, show its picture, play its sound."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import bpy
import numpy as np

from ..shell.running import PROBLEMS, in_words
from ..shell.selection import select
from ..shell.views import region_of
from ..shell.words import say

EARS = 2  # channels that are played; files have all

_playing: Any = None  # what sounds now, and its sound; it stops when nobody holds it


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


class FOREST_OT_play(bpy.types.Operator):
    """Play it: a reverb as the chosen sound is heard in the forest, an echo slowed down for human ears"""

    bl_idname = "forest.play"
    bl_label = "Play"
    sensor: bpy.props.StringProperty(options={"HIDDEN"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        import aud

        global _playing
        try:
            result = context.scene.forest_sensing.results.get(self.sensor)
            heard = None if result is None else heard_of(result)
        except PROBLEMS as problem:
            self.report({"ERROR"}, in_words(problem))
            return {"CANCELLED"}
        if heard is None:
            self.report({"ERROR"}, say("{name} has no sound. Run it again", name=self.sensor))
            return {"CANCELLED"}
        samples, rate = heard
        try:
            sound = aud.Sound.buffer(np.ascontiguousarray(samples[:, :EARS], np.float32), rate)
            _playing = aud.Device().play(sound), sound
        except aud.error as problem:
            self.report({"ERROR"}, say("No sound can be played here: {reason}", reason=problem))
            return {"CANCELLED"}
        return {"FINISHED"}


def heard_of(result: Any) -> tuple[np.ndarray, float] | None:
    """Return what a result sounds like: (N, C) samples and their rate, as its WAV has them; None: like
    nothing, or nothing of it is kept.

    An echo is slowed down; a reverb is what the scene's dry sound becomes in the forest.

    Raises
    ------
    SpecError : the file of the dry sound cannot be used.
    """
    from ...results.dry_sounds import PEAK_DB, dry_sound
    from ...results.kinds import RESULTS
    from ...sensing.reverb.auralise import normalised
    from .kept import unpack

    if not result.found:
        return None
    record, (sensor, found, _) = RESULTS[result.kind], unpack(result.found)
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


CLASSES = (FOREST_OT_select_result, FOREST_OT_show_picture, FOREST_OT_play)
