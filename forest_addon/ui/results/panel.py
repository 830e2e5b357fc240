"""The panel *Results*: what came of it, in figures and pictures, and what the colours of points mean.

Operators of a result's icons select its points, show its picture, play its sound, export and remove it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy_extras.io_utils import ExportHelper

from ...blender.scene.layout import (
    COLOUR_BY,
    COLOUR_MAP,
    FAR_POINTS,
    GAMMA,
    LUMINANCE,
    RADIUS,
    RESULTS,
    SHARE,
    find_part,
    is_ours,
)
from ...blender.scene.nodes import chosen_input, drawn_inputs
from ...blender.sensors.objects import file_name
from ...blender.show.cloud_nodes import is_measure, on_map
from ...formats.crs import can_tell_crs
from ...formats.wav import write_wav
from ...results.coordinates import Offset
from ...spec import SpecError
from ..settings.drawing import OnceStarted, icon_of, is_narrow, split
from ..shell.running import Button, Reading, button, panel
from ..shell.views import icons, region_of, select
from ..shell.words import keep, label, label_of_kept, say
from .keep import blocks_of, let_go, points_of, record_of

SIDE = 32  # pixels of an icon
EDGE = 2  # of these, left free around it
RIM = 2  # of these, around the colour: dark around what is light and light around what is dark


def draw_legend(layout: bpy.types.UILayout, result: Any, choice: str, colour_map: str = "") -> None:
    """Draw what the colours of this choice mean, two in a row; nothing where nobody noted it.

    colour_map : the scale that values are coloured on; empty: as they were noted.
    """
    entries = [entry for entry in result.legend if entry.choice == choice]
    if not entries:
        return
    colours = [tuple(entry.colour) for entry in entries]
    if colour_map:
        colours = list(map(tuple, on_map(colour_map, np.linspace(0.0, 1.0, len(entries)))))
    rows = layout.column(align=True)
    for first in range(0, len(entries), 2):
        row = rows.split(factor=0.5)
        for number in range(first, min(first + 2, len(entries))):
            row.label(text=entries[number].name, icon_value=_icon(colours[number]))


def pixels_of(colour: tuple[float, float, float]) -> np.ndarray:
    """(SIDE, SIDE, 4) a square of a colour, as the screen has it, rimmed, so that it is seen on any theme."""
    pixels = np.zeros((SIDE, SIDE, 4), np.float32)
    shown = np.array([channel**GAMMA for channel in colour])
    rim = 0.05 if shown @ LUMINANCE > 0.5 else 0.95
    for edge, filled in ((EDGE, (rim, rim, rim)), (EDGE + RIM, shown)):
        inner = slice(edge, SIDE - edge)
        pixels[inner, inner] = (*filled, 1.0)
    return pixels


def _icon(colour: tuple[float, float, float]) -> int:
    name = "colour " + " ".join(f"{channel:.4f}" for channel in colour)
    if name not in icons():
        made = icons().new(name)
        made.icon_size = (SIDE, SIDE)
        made.icon_pixels_float.foreach_set(pixels_of(colour).ravel())
    return int(icons()[name].icon_id)


@panel("Results", OnceStarted, bl_order=2)
def results(tab: bpy.types.Panel, context: bpy.types.Context) -> None:
    known = context.scene.forest_sensing.results
    if not known:
        tab.layout.label(text="Nothing has run yet", icon="INFO")
    if any(result.stale for result in known):
        column = tab.layout.column(align=True)  # beside the button the words would be cut off
        column.label(text="Some are from before the last change", icon="TIME")
        column.operator("forest.run", text="Run Again", icon="FILE_REFRESH").again = True
    for result in known:
        _draw_result(tab.layout, result)


def _draw_result(layout: bpy.types.UILayout, result: Any) -> None:
    header, body = layout.panel_prop(result, "opened")
    title = label("{name} (before)", name=result.title) if result.stale else result.title
    header.label(text=title, icon=icon_of(result.kind))
    if points_of(result) is not None:
        chosen = header.operator("forest.select_result", text="", icon="RESTRICT_SELECT_OFF")
        chosen.shown = result.shown
    _draw_looks(header, result)
    record = record_of(result)
    if result.file:
        opened = header.operator("wm.path_open", text="", icon="FILE_FOLDER")
        opened.filepath = result.file
    if body is None:
        return
    if result.picture is not None and result.picture.preview is not None:
        body.template_icon(result.picture.preview.icon_id, scale=8)
        caption = body.row()
        caption.alignment = "CENTER"
        caption.active = False
        caption.label(text=result.caption)
    if result.frames:
        frames = label(
            "Frames {first} to {last}: play the timeline",
            first=result.frames[0].frame,
            last=result.frames[-1].frame,
        )
        body.label(text=frames, icon="PLAY")
    _draw_points(body, result)
    if record is not None and record.is_response:
        column, props = split(body), result.id_data.forest_sensing
        column.prop(props, "dry")
        if props.dry == "FILE":
            column.prop(props, "dry_file")
    table = body.split(factor=0.5 if is_narrow() else 0.45)
    names, values = table.column(align=True), table.column(align=True)
    names.active = False
    for figure in result.figures:
        names.label(text=figure.name)
        values.label(text=label_of_kept(figure.made_of) if figure.made_of else figure.value)
    if result.kind != "forest":
        row = body.row(align=True)
        row.prop(result, "title", text="")
        row.operator("forest.export_result", text="", icon="EXPORT").result = result.name
        row.operator("forest.remove_result", text="", icon="TRASH").result = result.name


def draw_found(layout: bpy.types.UILayout, result: Any) -> None:
    """Draw in one line what a sensor found, with the buttons that show it; the result itself is far below."""
    row = layout.row(align=True)
    said = result.summary
    words = label_of_kept(said.made_of) if said.made_of else said.value
    if result.frames or not words:  # each frame has its own; earlier versions kept no such line
        words = result.title
    if result.stale:
        words = label("{name} (before)", name=words)
    row.label(text=words, icon="TIME" if result.stale else "CHECKMARK")
    _draw_looks(row, result)


def _draw_looks(layout: bpy.types.UILayout, result: Any) -> None:
    """Draw the buttons that show the points of a result, play it, and show its picture."""
    points, record = points_of(result), record_of(result)
    if points is not None:
        eye = "HIDE_OFF" if points.visible_get() else "HIDE_ON"
        layout.operator("forest.show_result", text="", icon=eye).result = result.name
    if record is not None and record.sound is not None:
        layout.operator("forest.play", text="", icon="PLAY_SOUND").sensor = result.name
    if result.picture is not None:
        layout.operator("forest.show_picture", text="", icon="IMAGE_DATA").result = result.name


def _draw_points(layout: bpy.types.UILayout, result: Any) -> None:
    """Draw how the points of a cloud look: its modifier's menu and radius, and whether renders show them."""
    cloud = bpy.data.objects.get(result.shown)
    for modifier in cloud.modifiers if cloud is not None else ():
        inputs = drawn_inputs(modifier)
        if COLOUR_BY not in inputs:
            continue
        column = split(layout)
        column.prop(*inputs[COLOUR_BY], text=COLOUR_BY)
        if RADIUS in inputs:
            row = column.row(align=True)
            row.prop(*inputs[RADIUS], text="Radius")
            row.prop(cloud, "hide_render", text="")
        if SHARE in inputs:
            column.prop(*inputs[SHARE], text=SHARE)
        if FAR_POINTS in inputs and "Far Points" in result.figures:
            column.prop(*inputs[FAR_POINTS], text=FAR_POINTS)
        choice, colour_map = chosen_input(modifier, COLOUR_BY), ""
        if COLOUR_MAP in inputs and is_measure(choice):
            column.prop(*inputs[COLOUR_MAP], text=COLOUR_MAP)
            colour_map = chosen_input(modifier, COLOUR_MAP)
        draw_legend(layout, result, choice, colour_map)


EARS = 2  # channels that are played; files have all

_playing: Any = None  # what sounds now, and its sound; it stops when nobody holds it


@button(
    "Select Points",
    Reading,
    needs=(
        (
            lambda context: context.mode == "OBJECT",
            keep("Leave this mode first: objects are selected in Object Mode"),
        ),
    ),
    bl_options={"REGISTER", "UNDO"},
    shown=bpy.props.StringProperty(options={"HIDDEN"}),
)
def _select_result(pressed: bpy.types.Operator, context: bpy.types.Context) -> str:
    """Select these points and show them"""
    obj = context.scene.objects.get(pressed.shown)
    if obj is None:
        problem = say("{name} is no longer in the scene. Run its sensor again", name=pressed.shown)
        raise ValueError(problem)
    select(context, obj)
    return ""


@button("Play", Reading, sensor=bpy.props.StringProperty(options={"HIDDEN"}))
def _play(pressed: bpy.types.Operator, context: bpy.types.Context) -> str:
    """Play it: a reverb as the chosen sound is heard in the forest, an echo slowed down for human ears"""
    import aud

    global _playing
    result = context.scene.forest_sensing.results.get(pressed.sensor)
    heard = None if result is None else heard_of(result)
    if heard is None:
        raise ValueError(say("{name} has no sound. Run it again", name=pressed.sensor))
    samples, rate = heard
    try:
        sound = aud.Sound.buffer(np.ascontiguousarray(samples[:, :EARS], np.float32), rate)
        _playing = aud.Device().play(sound), sound
    except aud.error as problem:
        raise ValueError(say("No sound can be played here: {reason}", reason=problem)) from None
    return ""


def heard_of(result: Any) -> tuple[np.ndarray, float] | None:
    """Sound of a result: (N, C) samples and their rate, as its WAV has them; None: like
    nothing, or nothing of it is kept.

    An echo is slowed down; a reverb is what the scene's dry sound becomes in the forest.

    Raises
    ------
    SpecError : the file of the dry sound cannot be used.
    """
    from ...results.reverb import PEAK_DB, dry_sound
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


@button("Show in Image Editor", Reading, result=bpy.props.StringProperty(options={"HIDDEN"}))
def _show_picture(pressed: bpy.types.Operator, context: bpy.types.Context) -> str:
    """Show this picture in an Image Editor, below this view where none is open"""
    results = context.scene.forest_sensing.results
    picture = results[pressed.result].picture if pressed.result in results else None
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
    from ...results.kinds import write_as
    from ...results.points import write_points
    from .finding import unpack

    data = _scan_of(result)
    if data is None:
        sensor, found, offset = unpack(result.found)
        write_as(path, sensor, found, offset)
        return offset
    cloud, offset, labels = kept_scan(data)
    write_points(path, cloud, offset, labels.get(label))
    return offset


def _endings(context: bpy.types.Context, pressed: bpy.types.Operator) -> tuple[str, ...]:
    result = context.scene.forest_sensing.results.get(pressed.result)
    return () if result is None else endings_of(result)


def _by_name_of_result(
    pressed: bpy.types.Operator, context: bpy.types.Context, event: bpy.types.Event
) -> set[str]:
    endings = _endings(context, pressed)
    if not endings:
        return set(pressed.execute(context))  # which says why
    usual = endings[0]
    pressed.ending = usual[1:].upper()
    pressed.filepath = f"{file_name(pressed.result)}{usual}"
    return set(ExportHelper.invoke(pressed, context, event))


def _with_ending(pressed: bpy.types.Operator, _context: bpy.types.Context) -> bool:
    """The name follows the format that is chosen beside it."""
    from ...results.points import ending_of

    path, before = Path(pressed.filepath), pressed.filepath
    had = ending_of(path)
    if had in WORDS and path.name:
        pressed.filepath = str(
            path.with_name(path.name[: -len(had)] + f".{pressed.ending.lower()}")
        )
    return pressed.filepath != before


def _draw_export(pressed: bpy.types.Operator, context: bpy.types.Context) -> None:
    column = pressed.layout.column(align=True)
    for ending in _endings(context, pressed):
        column.prop_enum(pressed, "ending", ending[1:].upper())
    props = context.scene.forest_sensing
    result, record = props.results.get(pressed.result), record_of(props.results.get(pressed.result))
    if result is not None and _scan_of(result) is not None:
        pressed.layout.prop(pressed, "labels")
    if pressed.ending == "WAV" and record is not None and record.is_response:
        pressed.layout.prop(pressed, "heard")
        if pressed.heard:
            pressed.layout.prop(props, "dry", text="")


@button(
    "Export Result",
    Reading,
    ExportHelper,
    invoke=_by_name_of_result,
    check=_with_ending,
    draw=_draw_export,
    filename_ext="",
    check_extension=False,
    result=bpy.props.StringProperty(options={"HIDDEN"}),
    filter_glob=bpy.props.StringProperty(
        default=";".join(f"*{ending}" for ending in WORDS), options={"HIDDEN"}
    ),
    ending=bpy.props.EnumProperty(
        name="Format",
        description="Which kind of file",
        items=[(ending[1:].upper(), name, words) for ending, (name, words) in WORDS.items()],
        options={"SKIP_SAVE"},
    ),
    labels=bpy.props.EnumProperty(
        name="Labels",
        description="What points are classed by; the file holds the names",
        items=[
            ("CLASS", "Class", "Other, wood, leaf, ground"),
            ("OBJECT", "Object", "The object that was hit, by its name"),
            ("SPECIES", "Species", "The species of the tree, by its name"),
            ("MATERIAL", "Material", "The material that was hit, by its name"),
        ],
    ),
    heard=bpy.props.BoolProperty(
        name="As It Is Played",
        description="The chosen sound as it is heard in the forest, not the impulse response",
    ),
)
def export_result(pressed: bpy.types.Operator, context: bpy.types.Context) -> str:
    """Write this result to a file; its ending says in which format"""
    from ...results.points import ending_of

    endings = _endings(context, pressed)
    if not endings:
        problem = say("{name} is not kept in this file. Run its sensor again", name=pressed.result)
        raise ValueError(problem)
    path = Path(bpy.path.abspath(pressed.filepath))
    result, crs = context.scene.forest_sensing.results[pressed.result], ""
    if ending_of(path) not in endings:
        problem = say(
            'cannot be written as "{ending}"; use {endings}',
            ending=ending_of(path),
            endings=", ".join(endings),
        )
        raise SpecError(path.name, problem)
    if pressed.heard and record_of(result).is_response and path.suffix.lower() == ".wav":
        write_wav(path, *heard_of(result))
    else:
        crs = _write(path, result, pressed.labels).crs
    if context.scene.is_editable:
        result.file = str(path)
    if crs and not can_tell_crs():
        problem = say("Written without its coordinate system: Blender has no pyproj")
        pressed.report({"WARNING"}, problem)
    return say("Written: {file}", file=path)


@button("Remove Result", Button, result=bpy.props.StringProperty(options={"HIDDEN"}))
def _remove_result(pressed: bpy.types.Operator, context: bpy.types.Context) -> str:
    """Remove this result, with its points and its picture; files that were written stay"""
    results = context.scene.forest_sensing.results
    number = results.find(pressed.result)
    if number < 0:
        raise ValueError(say("{name} is no longer there", name=pressed.result))
    shown = context.scene.objects.get(results[number].shown)
    left = blocks_of(results[number])
    results.remove(number)
    home = find_part(context.scene, RESULTS)
    if shown is not None and home is not None and shown.name in home.objects and is_ours(shown):
        left.append(shown.data)
        bpy.data.objects.remove(shown)
    let_go(left)
    return ""
