"""Add > Forest: whole set-ups of the papers, an empty start, and the demo."""

from __future__ import annotations

import functools
import tomllib
from typing import Any, ClassVar

import bpy

from ...base.places import ASSETS
from ..shell.running import PROBLEMS, WhenReady, in_words
from ..shell.words import label, say
from .gallery import GALLERY, icon_of, words_of

SCENES = ASSETS / "scenes"


@functools.cache
def presets() -> tuple[tuple[str, str], ...]:
    """(file, title) of every scene that comes with the add-on, the demo first."""
    found = []
    for path in sorted(SCENES.glob("*.toml"), key=lambda path: (path.stem != "demo", path.stem)):
        found.append(
            (path.stem, tomllib.loads(path.read_text(encoding="utf-8")).get("name", path.stem))
        )
    return tuple(found)


class FOREST_OT_start(WhenReady, bpy.types.Operator):
    """Take this set-up, species, field, sensors, and grow it; what else is in the scene stays"""

    bl_idname = "forest.start"
    bl_label = "Start a Forest"
    bl_options: ClassVar[set[str]] = {"UNDO"}

    preset: bpy.props.StringProperty(
        name="Preset",
        description="A scene of the add-on; empty: nothing planted, no sensor",
        options={"HIDDEN"},
    )
    sensors: bpy.props.EnumProperty(
        name="Sensors",
        description="What becomes of sensors that are in the scene",
        items=[
            ("KEEP", "Keep", "Sensors of this scene stay, those of the set-up are added"),
            ("REPLACE", "Replace", "Those of the set-up take their place"),
        ],
        options={"SKIP_SAVE"},
    )

    grow: bpy.props.BoolProperty(
        name="Grow",
        description="Grow it at once and look at it; else Grow Forest does",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def description(cls, _context: bpy.types.Context, given: bpy.types.OperatorProperties) -> str:
        return words_of(given.preset) or say(cls.__doc__ or "")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        props = context.scene.forest_sensing
        if bpy.app.background or not (props.plantings or props.stems):
            return self.execute(context)
        return context.window_manager.invoke_props_dialog(
            self, width=320, title=say("Replace this forest?"), confirm_text=say("Set Up")
        )

    def draw(self, _context: bpy.types.Context) -> None:
        column = self.layout.column()
        column.use_property_split = True
        column.use_property_decorate = False
        column.label(text="Field and plantings are replaced.")
        column.row().prop(self, "sensors", expand=True)

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            name = take(context.scene, self.preset, self.sensors == "KEEP")
        except PROBLEMS as problem:
            self.report({"ERROR"}, in_words(problem))
            return {"CANCELLED"}
        props = context.scene.forest_sensing
        if self.grow and (props.plantings or props.stems):
            how = "EXEC_DEFAULT" if bpy.app.background else "INVOKE_DEFAULT"
            bpy.ops.forest.build(how, frame=True)
            return {"FINISHED"}
        done = say("{name} is set up. Press Grow Forest in the sidebar", name=name)
        self.report({"INFO"}, done)
        return {"FINISHED"}


class FOREST_MT_start(bpy.types.Menu):
    """Set-ups to start from"""

    bl_idname = "FOREST_MT_start"
    bl_label = "Forest"

    def draw(self, _context: bpy.types.Context) -> None:
        draw_presets(self.layout, "forest.start")
        self.layout.separator()
        self.layout.operator("forest.add_flight", icon="EMPTY_SINGLE_ARROW")


class FOREST_MT_more(bpy.types.Menu):
    """Set-ups of published papers, and further forests"""

    bl_label = "From Papers"

    def draw(self, _context: bpy.types.Context) -> None:
        draw_others(self.layout, "forest.start")


class FOREST_MT_more_new(bpy.types.Menu):
    """Set-ups of published papers, and further forests"""

    bl_label = "From Papers"

    def draw(self, _context: bpy.types.Context) -> None:
        draw_others(self.layout, "forest.new")


def take(scene: bpy.types.Scene, preset: str, keep_sensors: bool = False) -> str:
    """Put a preset into a scene, an empty forest where none is named; returns its name.

    keep_sensors : those of the scene stay beside those of the preset.

    Raises
    ------
    SpecError : there is no such preset, or its file cannot be used; nothing is changed.
    """
    from ... import spec
    from ..settings.exchange import from_spec
    from .scene_file import open_scene

    if preset:
        return open_scene(scene, SCENES / f"{preset}.toml", keep_sensors, beside=True)
    from_spec(scene, spec.Scene(name="My forest", seed=1), keep_sensors)
    return say("An empty forest")


def draw_presets(layout: bpy.types.UILayout, operator: str) -> None:
    """The gallery and what it shows, the menu of every other preset, and the empty one."""
    layout.operator("forest.gallery", icon="IMGDISPLAY").new = operator == "forest.new"
    layout.separator()
    for card in GALLERY:
        entry = layout.operator(operator, text=label(card.title), icon_value=icon_of(card.preset))
        entry.preset = card.preset
        _grown_at_once(entry, operator)
    layout.separator()
    more = FOREST_MT_more_new if operator == "forest.new" else FOREST_MT_more
    layout.menu(more.__name__, icon="DOCUMENTS")
    layout.operator(operator, text="Empty", icon="FILE_NEW").preset = ""


def draw_others(layout: bpy.types.UILayout, operator: str) -> None:
    """Presets that the gallery does not show, by their titles."""
    shown = {card.preset for card in GALLERY}
    for file, title in presets():
        if file not in shown:
            entry = layout.operator(operator, text=title)
            entry.preset = file
            _grown_at_once(entry, operator)


def _grown_at_once(entry: Any, operator: str) -> None:
    """Have a forest that is added be grown by the click; that of a new file is anyway."""
    if operator == "forest.start":
        entry.grow = True


def draw_in_menu(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """The entry in Add."""
    menu.layout.menu(FOREST_MT_start.bl_idname, icon="OUTLINER_OB_CURVES")


CLASSES = (FOREST_OT_start, FOREST_MT_more, FOREST_MT_more_new, FOREST_MT_start)
MENUS = (("VIEW3D_MT_add", draw_in_menu),)
