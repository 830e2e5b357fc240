"""Scene files from the panel: taken into a Blender scene, written from one, written for other programs.

In a new file that a window shows, a forest is moved as a whole beside Blender's start cube.

A scene file that is written gives the same results without a window, wherever it is written. Files that
settings name are named from its folder; those that come with the add-on are copied beside it. Edited species
are written into a folder beside it. Objects that are not ours are seen by sensors and may be named by
settings, so a scene that has them starts from its .blend file.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import bpy
from bpy_extras.io_utils import ExportHelper

from ... import spec
from ...base.places import ASSETS
from ...blender.scene.instances import IGNORED_KEY, may_be_met
from ...blender.scene.layout import is_ours
from ...blender.scene.nodes import around
from ...blender.sensors.objects import file_name, sensors_of
from ...formats.ownership import Keeper, keeping
from ...formats.toml_file import read_settings, write_settings
from ..settings.exchange import from_spec, to_spec
from ..settings.groups import text_of
from ..settings.preferences import rays_of
from ..shell.running import Button, Reading, Taking, ask_for_file, button, dropped
from ..shell.views import choose_sensor
from ..shell.words import say
from ..species.edit import Edited, edited_species, from_folder, relocated

CUBE, CORNERS = "Cube", 8  # what Blender starts with
BESIDE = 2.0  # metres from the cube's middle to the ground that views show
PLACES = {"origin", "centre", "start", "position", "source", "receiver", "polygon", "holes"}
# What is given by files and objects of its own does not move with the rest.
NAMED = {
    *("painted", "trees", "collection", "object", "file", "follow", "array_file"),
    *("source_path", "receiver_path", "source_objects", "receiver_objects"),
}


def beside_cube(scene: bpy.types.Scene, settings: spec.Scene) -> spec.Scene:
    """Move a forest beside the start cube of a new file, if a window shows that; else it stays in place."""
    if bpy.app.background or bpy.data.filepath or not _is_start(scene) or _is_bound(settings):
        return settings
    field = settings.forest
    right = BESIDE + around(field) - field.origin[0]
    return moved(settings, (round(right, 1), -field.origin[1] - field.size[1] / 2))


def moved(settings: Any, way: tuple[float, float]) -> Any:
    """Return settings with all places in them moved on the map, metres."""
    changed = {}
    for field in fields(settings):
        value = getattr(settings, field.name)
        if isinstance(settings, spec.Rows):
            break  # they start at a place of the field
        if field.name in PLACES and isinstance(value, tuple):
            changed[field.name] = _shifted(value, way)
        elif is_dataclass(value):
            changed[field.name] = moved(value, way)
        elif isinstance(value, tuple) and any(map(is_dataclass, value)):
            changed[field.name] = tuple(moved(item, way) for item in value)
    return replace(settings, **changed)


def _shifted(place: tuple[Any, ...], way: tuple[float, float]) -> tuple[Any, ...]:
    """A place moved, an outline of places, or several outlines."""
    if not place or isinstance(place[0], tuple):
        return tuple(_shifted(inner, way) for inner in place)
    return (place[0] + way[0], place[1] + way[1], *place[2:])


def _is_start(scene: bpy.types.Scene) -> bool:
    """Return whether the start cube stands where Blender has put it."""
    cube = scene.objects.get(CUBE)
    return (
        cube is not None
        and cube.type == "MESH"
        and len(cube.data.vertices) == CORNERS
        and not any(cube.location)
    )


def _is_bound(settings: spec.Settings) -> bool:
    """Return whether anything in settings is placed by a file or an object."""
    return any(
        name in NAMED and value and not isinstance(value, int) for name, value in _all_in(settings)
    )


def _all_in(settings: spec.Settings) -> Iterator[tuple[str, Any]]:
    """Name and value of every setting, also of settings within others."""
    for name, value in vars(settings).items():
        yield name, value
        for inner in value if isinstance(value, tuple) else (value,):
            if isinstance(inner, spec.Settings):
                yield from _all_in(inner)


OF_OBJECTS = ("object", "painted", "collection", "follow", "source_objects", "receiver_objects")


def write_scene(scene: bpy.types.Scene, path: Path) -> str:
    """Write settings, edited species and sensors of a scene.

    Returns what the user should know or do for the same results without a window; empty: nothing.

    Raises
    ------
    SpecError : a value that cannot be used.
    OSError : a file cannot be written.
    """
    path = path.resolve()
    settings, edited = to_spec(scene), edited_species(scene)
    origin = Path(bpy.path.abspath(scene.forest_sensing.folder))

    shipped: dict[str, Path] = {}  # with the add-on, whose folder other machines do not have

    def move(file: str) -> str:
        known = (origin / file).resolve()
        if not known.is_file():  # a name that is found everywhere, or missing anyhow
            return file
        if not known.is_relative_to(ASSETS.resolve()):
            return from_folder(known, path.parent)
        shipped[known.name] = known
        return f"{path.stem}-files/{known.name}"

    settings = spec.with_files(settings, move)
    if shipped:
        home = path.with_name(f"{path.stem}-files")
        with keeping(Keeper(home, "panel", advice=say("choose another name, or move it away"))):
            home.mkdir(parents=True, exist_ok=True)
            for name, file in shipped.items():
                shutil.copyfile(file, home / name)
    blend, wanting = _blend_for(scene, settings, path.parent)
    write_settings(path, replace(_with_edited(settings, edited, path), blend=blend))
    return wanting


def _blend_for(scene: bpy.types.Scene, settings: spec.Scene, home: Path) -> tuple[str, str]:
    """The .blend file that a scene file starts from, if it needs one, and what is wanting."""
    others = sorted(
        obj.name
        for obj in scene.objects
        if may_be_met(obj) and not is_ours(obj) and not obj.get(IGNORED_KEY)
    )
    others += sorted(
        {value for name, value in _all_in(settings) if name in OF_OBJECTS and value} - set(others)
    )
    if not others:
        return "", ""
    few = ", ".join(others[:3])
    if not bpy.data.filepath:
        return "", say(
            "It needs objects of this .blend ({few}): save that and export again", few=few
        )
    blend = from_folder(Path(bpy.data.filepath), home)
    if bpy.data.is_dirty and not bpy.app.background:  # without a window 4.5 says so always
        return blend, say("It starts from this .blend ({few}): save that too", few=few)
    return blend, ""


def _with_edited(settings: spec.Scene, edited: Edited, path: Path) -> spec.Scene:
    """Write edited species into a folder beside a scene file; returns the settings that name them so."""
    home = path.with_name(f"{path.stem}-species")
    names = {name: f"{home.name}/{Path(name).name}" for name in edited}
    with keeping(Keeper(home, "panel", advice=say("choose another name, or move it away"))):
        for name, (species, origin) in edited.items():
            home.mkdir(parents=True, exist_ok=True)
            write_settings(path.parent / names[name], relocated(species, origin, home))
    plantings = (replace(p, species=names.get(p.species, p.species)) for p in settings.plantings)
    return replace(settings, plantings=tuple(plantings))


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


@button(
    "Ground from File",
    Button,
    Taking,
    filter_glob=bpy.props.StringProperty(default="*.laz;*.las;*.tif;*.asc", options={"HIDDEN"}),
)
def _take_ground(pressed: bpy.types.Operator, context: bpy.types.Context) -> str:
    """Have the forest stand on the ground of a file: points, a raster or a surface"""
    context.scene.forest_sensing.forest.terrain.file = pressed.filepath
    name = Path(pressed.filepath).name
    return say("The forest stands on {name}. Press Grow Forest to see it", name=name)


@button(
    "Open Scene File",
    Button,
    Taking,
    filename_ext=".toml",
    filter_glob=bpy.props.StringProperty(default="*.toml", options={"HIDDEN"}),
    keep_sensors=bpy.props.BoolProperty(
        name="Keep Sensors",
        description="Sensors of this scene stay beside those of the file; off: those take their place",
    ),
)
def _load_scene(pressed: bpy.types.Operator, context: bpy.types.Context) -> str:
    """Take forest and sensors from a scene file (.toml), the same that runs without a window"""
    before = len(sensors_of(context.scene))
    name = open_scene(context.scene, Path(pressed.filepath), pressed.keep_sensors)
    done = say("{name} is loaded. Press Grow Forest to see it", name=name)
    if before and not pressed.keep_sensors:
        gone = say("Its sensors took the place of {count}; undo brings those back", count=before)
        done = f"{done}. {gone}"
    return done


CLASSES = (
    dropped(".toml", "Forest Sensing Scene", "forest.load_scene"),
    dropped(".laz;.las", "Ground of a Forest", "forest.take_ground"),
)


@button("Take Offset from Files", Button)
def take_offset(_button: Button, context: bpy.types.Context) -> str:
    """Take the offset that puts the field on the terrain, rasters or tables of trees that it names"""
    from ...stand.files import ElsewhereError, read_inputs

    props, settings = context.scene.forest_sensing, to_spec(context.scene, [])
    folder = Path(bpy.path.abspath(props.folder))
    try:
        read_inputs(settings, folder)
    except ElsewhereError as refusal:
        if refusal.offset is None:
            raise
        read_inputs(settings.changed(offset=refusal.offset), folder)  # where all files lie
        props.offset = text_of(refusal.offset)
        return say("The offset is {offset} now", offset=props.offset)
    return say("The field lies on its files already")


def _by_name_of_scene(
    pressed: bpy.types.Operator, context: bpy.types.Context, event: bpy.types.Event
) -> set[str]:
    pressed.filepath = f"{file_name(context.scene.forest_sensing.name)}.toml"
    return set(ExportHelper.invoke(pressed, context, event))


@button(
    "Export Scene File",
    Reading,
    ExportHelper,
    invoke=_by_name_of_scene,
    filename_ext=".toml",
    filter_glob=bpy.props.StringProperty(default="*.toml", options={"HIDDEN"}),
)
def save_scene(pressed: bpy.types.Operator, context: bpy.types.Context) -> str:
    """Write forest and sensors to a scene file (.toml) that gives the same results without a window"""
    wanting = write_scene(context.scene, Path(pressed.filepath))
    written = say("Written: {file}", file=pressed.filepath)
    if wanting:
        pressed.report({"WARNING"}, f"{written}. {wanting}")
    return "" if wanting else written


@button(
    "Export for Other Programs",
    Reading,
    invoke=ask_for_file,
    directory=bpy.props.StringProperty(
        name="Folder",
        description="Folder that the files go to; made if missing",
        subtype="DIR_PATH",
        options={"SKIP_SAVE"},
    ),
)
def export_others(pressed: bpy.types.Operator, context: bpy.types.Context) -> str:
    """Write the scene into a folder for other programs: OBJ parts, surveys of HELIOS++, JSON, .glb, .blend"""
    from ...blender.files.others import export_for_others
    from ...blender.sensors.observe import Observer
    from ...sensing.lidar.surveys.export import flown

    scene = context.scene
    folder = Path(bpy.path.abspath(pressed.directory or "//export"))
    home = Path(bpy.path.abspath(scene.forest_sensing.folder))
    told: list[str] = []
    settings = to_spec(scene)
    observer = Observer(context.evaluated_depsgraph_get(), rays_of(settings.rays))
    ways = {s.name: flown(s) or observer.way(s, home) for s in settings.sensors}
    count = export_for_others(settings, observer.geometry, ways, folder, told.append)
    return say(
        "{count} parts are in {folder}; scene.json there says what HELIOS++ has no word for",
        count=count,
        folder=str(folder),
    )
