"""What the icons of a result do: select its points, show its picture, play its sound."""

from __future__ import annotations

from typing import Any, ClassVar

import bpy

from ..selection import select
from ..views import region_of
from ..words import say

_playing: Any = None  # what sounds now; it stops when nobody holds it


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
    """Play it: a reverb as a click sounds in the forest, an echo slowed down for human ears"""

    bl_idname = "forest.play"
    bl_label = "Play"
    sensor: bpy.props.StringProperty(options={"HIDDEN"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        thing = context.scene.objects.get(self.sensor)
        sound = thing.data.sound if thing is not None and thing.type == "SPEAKER" else None
        echo = _echo(context.scene, self.sensor) if sound is None else None
        if sound is None and echo is None:
            self.report({"ERROR"}, say("{name} has no sound. Run it again", name=self.sensor))
            return {"CANCELLED"}
        if sound is not None and sound.factory is None:
            self.report({"ERROR"}, "No sound can be played here: this Blender has not loaded it")
            return {"CANCELLED"}
        import aud

        global _playing
        try:
            played = aud.Sound.buffer(*echo) if sound is None else sound.factory
            _playing = aud.Device().play(played)
        except aud.error as problem:
            self.report({"ERROR"}, say("No sound can be played here: {reason}", reason=problem))
            return {"CANCELLED"}
        return {"FINISHED"}


def _echo(scene: bpy.types.Scene, name: str) -> tuple[Any, float] | None:
    """The samples of an echo and their rate, as its WAV has them; None where none is held."""
    from ...formats.echo_files import sound_of
    from ...sensing.sonar.flight import Flight
    from ...sensing.sonar.ping import Echo
    from .held import find

    sensor, found, _ = find(scene, name) or (None, None, None)
    if not isinstance(found, Echo | Flight):
        return None
    samples, rate = sound_of(found, sensor.time_expansion)
    return samples.astype("float32"), rate


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
