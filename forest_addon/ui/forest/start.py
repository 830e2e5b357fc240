"""Starting a forest: the gallery, set-ups of the papers, an empty one; in the scene or as a new file.

*Add > Forest* and *File > New > Forest* have the same menu. Pictures of the gallery are made by
packaging/make_previews.py; Blender reads a picture's file when it shows it.

New files are no application templates: Blender finds those only in its folders of templates, and an extension
writes to no folder but its own. So a start scene begins as Blender's own new file, asked for as the other
entries of the menu do, with its question whether to save changes; once that is loaded it is furnished.
"""

from __future__ import annotations

import functools
import textwrap
import tomllib
from typing import Any

import bpy

from ...base.places import ASSETS
from ...blender.jobs import Work
from ...spec import Scene
from ..settings.drawing import split
from ..settings.exchange import from_spec
from ..shell.running import (
    WhenReady,
    Working,
    asked,
    button,
    current,
    long_button,
    made,
    menu,
    press,
)
from ..shell.views import icons, look_at, open_tab, region_of, views
from ..shell.words import keep, label, say
from .build import FOREST_OT_build
from .scene_file import open_scene

PREVIEWS = ASSETS / "previews"
ACROSS = 3  # cards in a row
LETTERS, LINES = 36, 2  # below a picture


GALLERY = {  # scenes of the add-on with title and words, as the gallery shows them
    "demo": (
        keep("One of Each"),
        keep("Maples and hazels with a tractor, a tripod, a bat and a clap"),
    ),
    "maple-walk": (
        keep("A Walk in a Maple Stand"),
        keep("Turning beams on your back, carried in a bow through the trees"),
    ),
    "conifer-drone": (
        keep("A Drone over Conifers"),
        keep("Crowns from above: two legs at 45 m, lines across the way"),
    ),
    "simlidar-orchard": (
        keep("An Orchard and a Tractor"),
        keep("Rows of apple trees; a fan of beams that drives past them"),
    ),
    "hedge-bat": (
        keep("A Bat at a Hedge"),
        keep("One call towards a row of hazels, and what comes back of each leaf"),
    ),
    "koli-summer": (
        keep("A Clap in Koli"),
        keep("Spruces and birches as in Finland, and how long a clap rings there"),
    ),
}


@made(
    bpy.types.Operator,
    "OT",
    "draw",
    "Gallery",
    bl_options={"INTERNAL"},
    invoke=lambda pressed, context, _: set(context.window_manager.invoke_popup(pressed, width=720)),
    execute=lambda _pressed, _context: {"FINISHED"},
    new=bpy.props.BoolProperty(
        name="New File", description="Begin a file with it", options={"SKIP_SAVE", "HIDDEN"}
    ),
)
def gallery(pressed: bpy.types.Operator, _context: bpy.types.Context) -> None:
    """Forests to start from, with pictures"""
    draw_gallery(pressed.layout, "forest.new" if pressed.new else "forest.start")


def draw_gallery(layout: bpy.types.UILayout, operator: str) -> None:
    """A card for every forest, three in a row."""
    heading = label("Start a new file with") if operator == "forest.new" else label("Add a forest")
    layout.label(text=heading)
    grid = layout.grid_flow(
        row_major=True, columns=ACROSS, even_columns=True, even_rows=True, align=False
    )
    for preset, (title, help_of) in GALLERY.items():
        column = grid.box().column(align=True)
        column.template_icon(icon_value=icon_of(preset), scale=7.0)
        _draw_entry(column, operator, preset, label(title))
        lines = column.column(align=True)
        lines.active = False
        words = textwrap.wrap(label(help_of), LETTERS)
        for line in words + [""] * (LINES - len(words)):  # cards of a row end at one height
            lines.label(text=line)


def icon_of(preset: str) -> int:
    """The number of a preset's picture; 0 where it has none."""
    name, file = f"scene/{preset}", PREVIEWS / f"{preset}.jpg"
    if name not in icons():
        if preset not in GALLERY or not file.is_file():
            return 0
        tuple(icons().load(name, str(file), "IMAGE").image_size)  # reads it now: no spinner
    return int(icons()[name].icon_id)


SCENES = ASSETS / "scenes"


@functools.cache
def presets() -> tuple[tuple[str, str], ...]:
    """(file, title) of every scene that comes with the add-on, the demo first."""
    files = sorted(SCENES.glob("*.toml"), key=lambda path: (path.stem != "demo", path.stem))
    tables = (tomllib.loads(path.read_text(encoding="utf-8")) for path in files)
    return tuple(
        (p.stem, table.get("name", p.stem)) for p, table in zip(files, tables, strict=True)
    )


PRESET = bpy.props.StringProperty(
    name="Preset", description="A scene of the add-on; empty: nothing planted, no sensor"
)


def _words_of_preset(cls: type, _context: bpy.types.Context, given: Any) -> str:
    """Return what one does with a preset; for one that the gallery does not show, what the button does."""
    if given.preset in GALLERY:
        return label(GALLERY[given.preset][1])
    return say(cls.__doc__ or "")


def _is_planted(context: bpy.types.Context) -> bool:
    """Return whether there is a forest to replace."""
    props = context.scene.forest_sensing
    return bool(props.plantings or props.stems)


def _draw_replaced(pressed: bpy.types.Operator, _context: bpy.types.Context) -> None:
    column = split(pressed.layout)
    column.label(text="Field and plantings are replaced.")
    column.row().prop(pressed, "sensors", expand=True)


@button(
    "Start a Forest",
    WhenReady,
    bl_options={"UNDO"},
    invoke=asked(keep("Replace this forest?"), keep("Set Up"), 320, _is_planted),
    draw=_draw_replaced,
    description=classmethod(_words_of_preset),
    preset=PRESET,
    sensors=bpy.props.EnumProperty(
        name="Sensors",
        description="What becomes of sensors that are in the scene",
        items=[
            ("KEEP", "Keep", "Sensors of this scene stay, those of the set-up are added"),
            ("REPLACE", "Replace", "Those of the set-up take their place"),
        ],
        options={"SKIP_SAVE"},
    ),
    grow=bpy.props.BoolProperty(
        name="Grow",
        description="Grow it at once and look at it; else Grow Forest does",
        options={"SKIP_SAVE"},
    ),
)
def _start(pressed: bpy.types.Operator, context: bpy.types.Context) -> str:
    """Take this set-up, species, field, sensors, and grow it; what else is in the scene stays"""
    name = take(context.scene, pressed.preset, pressed.sensors == "KEEP")
    if pressed.grow and _is_planted(context):
        press(bpy.ops.forest.build, frame=True)
        return ""
    return say("{name} is set up. Press Grow Forest in the sidebar", name=name)


@menu("Forest")
def start(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """Set-ups to start from"""
    draw_presets(menu.layout, "forest.start")
    menu.layout.separator()
    menu.layout.operator("forest.add_flight", icon="EMPTY_SINGLE_ARROW")


def _others(name: str, starts: str) -> type:
    """The menu of presets that the gallery does not show, by their titles; ``starts``: what they do."""

    def draw(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
        """Set-ups of published papers, and further forests"""
        for file, title in presets():
            if file not in GALLERY:
                _draw_entry(menu.layout, starts, file, title)

    return menu("From Papers")(draw, name)


CLASSES = (_others("more", "forest.start"), _others("more_new", "forest.new"))


def take(scene: bpy.types.Scene, preset: str, keep_sensors: bool = False) -> str:
    """Put a preset into a scene, an empty forest where none is named; returns its name.

    keep_sensors : those of the scene stay beside those of the preset.

    Raises
    ------
    SpecError : there is no such preset, or its file cannot be used; nothing is changed.
    """
    if preset:
        return open_scene(scene, SCENES / f"{preset}.toml", keep_sensors, beside=True)
    from_spec(scene, Scene(name="My forest", seed=1), keep_sensors)
    return say("An empty forest")


def draw_presets(layout: bpy.types.UILayout, operator: str) -> None:
    """The gallery and what it shows, the menu of every other preset, and the empty one."""
    layout.operator("forest.gallery", icon="IMGDISPLAY").new = operator == "forest.new"
    layout.separator()
    for preset, (title, _) in GALLERY.items():
        _draw_entry(layout, operator, preset, label(title), icon_value=icon_of(preset))
    layout.separator()
    more = "FOREST_MT_more_new" if operator == "forest.new" else "FOREST_MT_more"
    layout.menu(more, icon="DOCUMENTS")
    layout.operator(operator, text="Empty", icon="FILE_NEW").preset = ""


def _draw_entry(
    layout: bpy.types.UILayout, operator: str, preset: str, text: str, **icon: int
) -> None:
    """A preset to press; one that is added is grown by the click, that of a new file is anyway."""
    entry = layout.operator(operator, text=text, **icon)
    entry.preset = preset
    if operator == "forest.start":
        entry.grow = True


def draw_in_menu(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """The entry in Add."""
    menu.layout.menu(start.__name__, icon="OUTLINER_OB_CURVES")


NEW_FILE = {"app_template": "", "use_empty": True}
PICTURE = (1920, 1080)
RETRY = 0.1  # s until it is seen again whether a job of the old file has ended

_awaited: str | None = None  # the preset that the next new file is furnished with


def _await_file(
    pressed: bpy.types.Operator, context: bpy.types.Context, _event: bpy.types.Event
) -> set[str]:
    global _awaited
    if bpy.app.background:
        return set(pressed.execute(context))
    _awaited = pressed.preset
    bpy.ops.wm.read_homefile("INVOKE_DEFAULT", **NEW_FILE)
    return {"FINISHED"}


@made(
    bpy.types.Operator,
    "OT",
    "execute",
    "New Forest",
    bl_options=set(),  # it cannot be repeated: the file of before is gone
    invoke=_await_file,
    description=classmethod(_words_of_preset),
    preset=PRESET,
)
def _new(pressed: bpy.types.Operator, _context: bpy.types.Context) -> set[str]:
    """Start a new file with this forest: grown, lit, with a camera and its sensors"""
    preset = pressed.preset  # this operator does not outlive the file
    if preset and not (SCENES / f"{preset}.toml").is_file():
        pressed.report({"ERROR"}, say('There is no scene "{name}"', name=preset))
        return {"CANCELLED"}
    bpy.ops.wm.read_homefile(**NEW_FILE)
    if bpy.app.background:
        return set(bpy.ops.forest.furnish(preset=preset))
    _furnish_soon(preset)
    return {"FINISHED"}


@long_button(
    "Start Scene",
    Working,
    bl_options={"UNDO", "INTERNAL"},
    preset=bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"}),
)
def _furnish(pressed: bpy.types.Operator, context: bpy.types.Context) -> Work:
    """Take a set-up into this scene, grow it, light it, and look at it"""
    scene = context.scene
    sentence = take(scene, pressed.preset)
    pressed._job.kept.append(say("the settings"))
    for _, area in views():
        area.spaces.active.show_region_ui = True
    if _is_planted(context):
        sentence = yield from FOREST_OT_build.work(pressed, context)
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


@menu("Forest")
def new(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """Forests to start a new file with"""
    draw_presets(menu.layout, "forest.new")


def draw_in_new(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """The entry in File > New."""
    global _awaited
    _awaited = None  # who chooses anew has not started what was awaited
    menu.layout.separator()
    menu.layout.menu(new.__name__, icon="OUTLINER_OB_CURVES")


MENUS = (("VIEW3D_MT_add", draw_in_menu), ("TOPBAR_MT_file_new", draw_in_new))


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
