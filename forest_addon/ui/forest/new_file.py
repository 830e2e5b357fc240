"""File > New > Forest: start scenes, each a preset that stands built and lit in a file of its own.

They are no application templates: Blender finds those only in its folders of templates, and an extension
writes to no folder but its own. So a start scene begins as Blender's own new file, asked for as the other
entries of the menu do, with its question whether to save changes; once that is loaded it is furnished.
"""

from __future__ import annotations

from typing import ClassVar

import bpy

from ...blender.jobs import Work
from ..shell.running import Working, current
from ..shell.views import look_at, open_tab, region_of, views
from ..shell.words import say
from .build import FOREST_OT_build
from .gallery import words_of
from .start import draw_presets, take

NEW_FILE = {"app_template": "", "use_empty": True}
PICTURE = (1920, 1080)
RETRY = 0.1  # s until it is seen again whether a job of the old file has ended

_awaited: str | None = None  # the preset that the next new file is furnished with


class FOREST_OT_new(bpy.types.Operator):
    """Start a new file with this forest: grown, lit, with a camera and its sensors"""

    bl_idname = "forest.new"
    bl_label = "New Forest"
    bl_options: ClassVar[set[str]] = set()  # it cannot be repeated: the file of before is gone

    preset: bpy.props.StringProperty(
        name="Preset", description="A scene of the add-on; empty: nothing planted, no sensor"
    )

    @classmethod
    def description(cls, _context: bpy.types.Context, given: bpy.types.OperatorProperties) -> str:
        return words_of(given.preset) or say(cls.__doc__ or "")

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        global _awaited
        if bpy.app.background:
            return self.execute(context)
        _awaited = self.preset
        bpy.ops.wm.read_homefile("INVOKE_DEFAULT", **NEW_FILE)
        return {"FINISHED"}

    def execute(self, _context: bpy.types.Context) -> set[str]:
        preset = self.preset  # this operator does not outlive the file
        bpy.ops.wm.read_homefile(**NEW_FILE)
        if bpy.app.background:
            return set(bpy.ops.forest.furnish(preset=preset))
        _furnish_soon(preset)
        return {"FINISHED"}


class FOREST_OT_furnish(Working, bpy.types.Operator):
    """Take a set-up into this scene, grow it, light it, and look at it"""

    bl_idname = "forest.furnish"
    bl_label = "Start Scene"
    bl_options: ClassVar[set[str]] = {"UNDO", "INTERNAL"}

    preset: bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"})

    def work(self, context: bpy.types.Context) -> Work:
        scene = context.scene
        sentence = take(scene, self.preset)
        self._job.kept.append(say("the settings"))
        for _, area in views():
            area.spaces.active.show_region_ui = True
        if scene.forest_sensing.plantings or scene.forest_sensing.stems:
            sentence = yield from FOREST_OT_build.work(self, context)
        from ...blender.show.preview import lay_lawn, set_stage

        field = scene.forest_sensing.forest
        low, size = tuple(field.origin), tuple(field.size)
        trees = bool(scene.forest_sensing.plantings)  # stems are seen from above alone
        set_stage(scene, PICTURE, None if trees else (low, size), golden=True)
        if trees and not (field.terrain.object or field.terrain.file):
            lay_lawn(scene, field.terrain.base)
        for _, area in views():
            look_at(area, field)
            open_tab(area)
        return sentence


class FOREST_MT_new(bpy.types.Menu):
    """Forests to start a new file with"""

    bl_idname = "FOREST_MT_new"
    bl_label = "Forest"

    def draw(self, _context: bpy.types.Context) -> None:
        draw_presets(self.layout, "forest.new")


def draw_in_menu(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """The entry in File > New."""
    global _awaited
    _awaited = None  # who chooses anew has not started what was awaited
    menu.layout.separator()
    menu.layout.menu(FOREST_MT_new.bl_idname, icon="OUTLINER_OB_CURVES")


CLASSES = (FOREST_OT_new, FOREST_OT_furnish, FOREST_MT_new)
MENUS = (("TOPBAR_MT_file_new", draw_in_menu),)


@bpy.app.handlers.persistent
def _furnish_awaited(*_: object) -> None:
    """A file is loaded: furnish it if it is the new one that was asked for."""
    global _awaited
    preset, _awaited = _awaited, None
    if preset is not None and not bpy.data.filepath:
        _furnish_soon(preset)


def _furnish_soon(preset: str) -> None:
    """Furnish the file as soon as its window is there and the job of the old file has ended."""

    def furnish() -> float | None:
        if current() is not None:
            return RETRY
        for window, area in views():
            region = region_of(area, "WINDOW")
            with bpy.context.temp_override(window=window, area=area, region=region):
                bpy.ops.forest.furnish("INVOKE_DEFAULT", preset=preset)
            return None
        bpy.ops.forest.furnish(preset=preset)  # no view is open
        return None

    bpy.app.timers.register(furnish)


HANDLERS = (("load_post", _furnish_awaited),)
