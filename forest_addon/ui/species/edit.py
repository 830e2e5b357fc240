"""Species: chosen by picture, taken into properties and changed, recognised in files, saved, made assets; the
sub-panel *Species*, and the settings of one that is edited.

Folders are looked into when species are first drawn, and not again; ``refresh`` takes note of a new file.
Pictures of what is planted are read then, the others by Blender when the menu is opened.

An edited species lives in the .blend under a name such as edited/maple.toml, which plantings use as if it
were a file; ``load`` takes it from there. STL files that it names start from the folder that it came from.
"""

from __future__ import annotations

import functools
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
from bpy_extras.io_utils import ExportHelper

from ... import spec
from ...base.places import ASSETS
from ...base.progress import Progress
from ...blender.jobs import Task, Work
from ...blender.sensors.objects import file_name
from ...formats.atomic import replacing
from ...formats.toml_file import read_settings, write_settings
from ...spec import SpecError
from ..settings import exchange
from ..settings.drawing import (
    WithForest,
    draw_list,
    draw_settings,
    has,
    is_narrow,
    name_in,
    open_parts,
    split,
)
from ..settings.preferences import library_folder, species_folder
from ..shell.running import (
    Button,
    Reading,
    Taking,
    WhenReady,
    Working,
    button,
    dropped,
    getting_ready,
    long_button,
    panel,
    press,
)
from ..shell.views import PLANTED, chosen_planting, icons
from ..shell.words import EDITED, free_name, keep, label, language, say, title_of

Choice = tuple[str, str, str, int, int]  # what a planting calls it, name, help, icon, number

# Buttons and tooltips point to these texts and do not copy them: none may go while Blender runs.
_offered: list[Sequence[Choice]] = []


def choices(props: Any) -> tuple[Choice, ...]:
    """Presets, one's own species, those edited here, and what else is planted."""
    edited = tuple((item.name, item.origin) for item in props.edited)
    return _choices(edited, tuple(planting.species for planting in props.plantings), language())


def menu(props: Any, first: str) -> list[Choice]:
    """Presets, one's own species and those edited and planted, as items of a menu that starts with one."""
    planted = {planting.species for planting in props.plantings}
    edited = tuple((item.name, item.origin) for item in props.edited if item.name in planted)
    return _menu(edited, first, language())


@functools.lru_cache(maxsize=4)
def _menu(edited: tuple[tuple[str, str], ...], first: str, _language: str) -> list[Choice]:
    ordered = sorted(_choices(edited, (), _language), key=lambda choice: choice[0] != first)
    made = [
        (name, title, label("Grow a {species}", species=title), icon, number)
        for number, (name, title, _, icon, _) in enumerate(ordered)
    ]
    _offered.append(made)
    return made


def number_of(props: Any) -> int:
    """The place of the chosen planting's species in ``choices``."""
    planting = chosen_planting(props)
    species = "" if planting is None else planting.species
    return next((choice[4] for choice in choices(props) if choice[0] == species), 0)


def choose(props: Any, number: int) -> None:
    """Plant another of ``choices``, in place of the chosen planting's species."""
    planting = chosen_planting(props)
    if planting is not None:
        planting.species = choices(props)[number][0]


def refresh() -> None:
    """Look into the folders again when species are next drawn."""
    _files.cache_clear()
    _choices.cache_clear()
    _menu.cache_clear()


unregister = refresh


@functools.lru_cache(maxsize=16)
def _choices(
    edited: tuple[tuple[str, str], ...], planted: tuple[str, ...], _language: str
) -> tuple[Choice, ...]:
    origins = dict(edited)
    names = dict.fromkeys([*_files(), *origins, *filter(None, planted)])
    titles = [
        label("{species} (edited)", species=title_of(name)) if name in origins else title_of(name)
        for name in names
    ]
    made = tuple(
        (
            name,
            title,
            label("Plant {species}", species=title),
            _icon(origins.get(name, name), name in planted),
            number,
        )
        for number, (name, title) in enumerate(zip(names, titles, strict=True))
    )
    _offered.append(made)
    return made


@functools.cache
def _files() -> dict[str, Path | None]:
    """Name by which a planting calls each species that is there, and its picture if it has one."""
    presets = sorted(file.stem for file in (ASSETS / "species").glob("*.toml"))
    pictures = {file.stem: file for file in (ASSETS / "species" / "pictures").glob("*.jpg")}
    own = sorted([*species_folder().glob("*.toml"), *species_folder().glob("*/*.toml")])
    called = {
        file.as_posix(): picture_of(file) if picture_of(file).exists() else None
        for file in own
        if file.name != "scene.toml"
    }
    return {name: pictures.get(name) for name in presets} | called


def picture_of(species: Path) -> Path:
    """The picture of one's own species, beside its file."""
    return species.with_suffix(".png")


def _icon(species: str, now: bool) -> int:
    """The number of a species' picture; that of a plain icon where it has none. now : it is read at once."""
    picture = _files().get(species)
    if picture is None:
        return int(_plain_icons()["OUTLINER_OB_CURVES"].value)
    if species not in icons():
        icons().load(species, str(picture), "IMAGE")
    if now:  # Blender does so when it is asked for the size
        tuple(icons()[species].image_size)
    return int(icons()[species].icon_id)


def _plain_icons() -> Any:
    return bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items


Edited = Mapping[str, tuple[spec.Species, Path]]  # by what plantings call it; where its files are


def edited_species(scene: bpy.types.Scene) -> dict[str, tuple[spec.Species, Path]]:
    """Species that are edited in a scene and planted in it.

    Raises
    ------
    SpecError : a value that cannot be used; ``key`` begins with the species.
    """
    props = scene.forest_sensing
    planted = {planting.species for planting in props.plantings}
    return {item.name: _read(item) for item in props.edited if item.name in planted}


def load(name: str, folder: Path, edited: Edited) -> Any:
    """A species with what it takes from STL files: an edited one, a preset or a file.

    Raises
    ------
    SpecError : there is no such species, or it cannot be used.
    """
    from ...growth.library import complete_species, find_species, load_species

    if name in edited:
        species, home = edited[name]
        return complete_species(species, home, Path(name).stem)
    return load_species(find_species(name, folder))


def relocated(species: spec.Species, origin: Path, home: Path) -> spec.Species:
    """A species whose STL files are named from another folder."""

    def found(file: str) -> str:  # a name without an ending is a preset's
        return from_folder(origin / file, home) if Path(file).suffix else file

    return spec.with_files(species, found)


def from_folder(file: Path, home: Path) -> str:
    """Name of a file in one that stands in another folder."""
    try:
        return Path(os.path.relpath(file, home)).as_posix()
    except ValueError:  # another drive
        return file.resolve().as_posix()


def edited_item(props: Any) -> Any:
    """Edited species of the chosen planting, None where it is a preset or a file."""
    planting = chosen_planting(props)
    return None if planting is None else props.edited.get(planting.species)


EDITS = (  # what the buttons of an edited species need
    PLANTED,
    (
        lambda context: edited_item(context.scene.forest_sensing),
        keep("This species is not edited yet. Press Edit first"),
    ),
)


PLAIN = (
    PLANTED,
    (
        lambda context: edited_item(context.scene.forest_sensing) is None,
        keep("This species is being edited already"),
    ),
)


@button("Edit", Button, needs=PLAIN)
def edit_species(_button: Button, context: bpy.types.Context) -> str:
    """Change this species: its settings are taken into this file, the preset stays as it is"""
    from ...growth.library import find_species

    props = context.scene.forest_sensing
    planting = chosen_planting(props)
    path = find_species(planting.species, Path(bpy.path.abspath(props.folder)))
    species = read_settings(path, spec.Species)
    item = props.edited.add()
    item.name = free_name(f"{EDITED}{path.stem}", "-", ".toml", props.edited.__contains__)
    item.origin = planting.species
    item.folder = "" if _is_preset(planting.species) else str(path.resolve().parent)
    exchange.write(item.settings, species)
    planting.species = item.name
    title = title_of(path.stem)
    return say("{species} can be changed now; Grow Forest grows it so", species=title)


@button("Discard", Button, needs=EDITS)
def discard_species(_button: Button, context: bpy.types.Context) -> str:
    """Give these changes up and plant what the species was made from"""
    item = edited_item(context.scene.forest_sensing)
    origin = item.origin
    _replace(context.scene, item, origin)
    return say("Back to {species}", species=title_of(origin))


def _by_name_of_species(
    pressed: bpy.types.Operator, context: bpy.types.Context, event: bpy.types.Event
) -> set[str]:
    item = edited_item(context.scene.forest_sensing)
    if _is_preset(item.origin):
        species_folder().mkdir(parents=True, exist_ok=True)
        pressed.filepath = str(species_folder() / Path(item.name).name)
    else:
        pressed.filepath = str(Path(item.folder) / Path(item.origin).name)
    return set(ExportHelper.invoke(pressed, context, event))


@button(
    "Save As",
    Button,
    ExportHelper,
    needs=EDITS,
    invoke=_by_name_of_species,
    filename_ext=".toml",
    filter_glob=bpy.props.StringProperty(default="*.toml", options={"HIDDEN"}),
)
def save_species(pressed: bpy.types.Operator, context: bpy.types.Context) -> str:
    """Write this species to a file of its own (.toml), which the planting uses from then on"""
    scene = context.scene
    props = scene.forest_sensing
    item = edited_item(props)
    species, home = _read(item)
    path = Path(bpy.path.abspath(pressed.filepath)).resolve()
    path.parent.mkdir(parents=True, exist_ok=True)
    write_settings(path, relocated(replace(species, name=path.stem), home, path.parent))
    _replace(scene, item, _called(path, props.folder))
    refresh()
    return say("Written: {file}", file=path)


def _read(item: Any) -> tuple[spec.Species, Path]:
    """An edited species, and the folder that its STL files start from."""
    species = exchange.read(item.settings, spec.Species, Path(item.name).stem)
    return species, Path(item.folder) if item.folder else ASSETS / "species"


def _replace(scene: bpy.types.Scene, item: Any, species: str) -> None:
    """Plant another species wherever an edited one is planted, and forget that."""
    props = scene.forest_sensing
    name = item.name
    for planting in props.plantings:
        if planting.species == name:
            planting.species = species
    props.edited.remove(props.edited.find(name))


def _is_preset(species: str) -> bool:
    return not species.endswith(".toml")


def _called(path: Path, folder: str) -> str:
    """Name by which a planting calls a species file: within the scene's folder, relative to that."""
    home = Path(bpy.path.abspath(folder)).resolve()
    inside = folder and path.is_relative_to(home)
    return (path.relative_to(home) if inside else path).as_posix()


NAME = "Forest Sensing"
SEED = 1
FIRST = ("norway-maple", "silver-birch", "norway-spruce", "hazelnut")  # where nothing is planted


@long_button(
    "Make Asset Library",
    Working,
    variants=bpy.props.IntProperty(
        name="Trees", description="How many of each species", default=4, min=1, max=200
    ),
    add=bpy.props.BoolProperty(
        name="Add", description="Add it to Blender's asset libraries", options={"SKIP_SAVE"}
    ),
)
def _make_library(pressed: bpy.types.Operator, context: bpy.types.Context) -> Work:
    """Write trees of this scene's species, or four usual ones, as assets for the Asset Browser"""
    yield getting_ready("blender.scene.assets")
    from ...blender.scene.assets import grow_exhibits, write_species

    props, out = context.scene.forest_sensing, library_folder()
    folder = Path(bpy.path.abspath(props.folder))
    edited, count = edited_species(context.scene), int(pressed.variants)
    names = list(dict.fromkeys(p.species for p in props.plantings if p.species)) or [*FIRST]
    for done, name in enumerate(names):
        loaded = yield Task(say("reading files"), lambda _, name=name: load(name, folder, edited))
        exhibits = yield Task(
            say("growing trees"),
            lambda tell, loaded=loaded: grow_exhibits(*loaded, count, SEED, tell),
            span=(done / len(names), (done + 1) / len(names)),
        )
        write_species(out, loaded[0], exhibits)
    if pressed.add and not _is_added(context):
        _add(context)
    return say("{trees} trees in {folder}", trees=count * len(names), folder=out)


NEW = (
    lambda context: not _is_added(context),
    keep("It is among Blender's asset libraries already"),
)


@button("Add to Asset Libraries", Reading, bl_options=set(), needs=(NEW,))
def add_library(_button: Reading, context: bpy.types.Context) -> str:
    """Add the folder of trees to Blender's asset libraries; where it is empty, trees are made first"""
    if not any(library_folder().glob("*.blend")):
        press(bpy.ops.forest.make_library, add=True)
        return ""
    _add(context)
    return say("The Asset Browser has it as {name}", name=NAME)


def _add(context: bpy.types.Context) -> None:
    libraries = context.preferences.filepaths.asset_libraries
    libraries.new(name=NAME, directory=str(library_folder()))
    context.preferences.is_dirty = True


def _is_added(context: bpy.types.Context) -> bool:
    library = library_folder().resolve()
    known = context.preferences.filepaths.asset_libraries
    return any(Path(bpy.path.abspath(one.path)).resolve() == library for one in known)


JUDGED = 24  # siblings that are grown to be held to the tree
OF_LEAVES = ("leaf", "leaves", "foliage")  # within the name of the file that holds them
OF_WOOD = ("wood", "stem", "trunk", "branches")


CLASSES = (dropped(".stl", "Species from a Tree", "forest.import_tree"),)


def _draw_import(pressed: bpy.types.Operator, _context: bpy.types.Context) -> None:
    column = pressed.layout.column(align=True)
    column.label(text="Choose the file of the wood and,")
    column.label(text="with Ctrl, that of the leaves, or one of both.")
    column = split(pressed.layout)
    column.prop(pressed, "title", placeholder="As the file")
    column.prop(pressed, "height")
    column.prop(pressed, "accept")


@button(
    "Import STL",
    WhenReady,
    Taking,
    bl_options=set(),  # it starts a job, which is not redone
    draw=_draw_import,
    filename_ext=".stl",
    filter_glob=bpy.props.StringProperty(
        default="*.stl;*.ply;*.obj;*.gltf;*.glb", options={"HIDDEN"}
    ),
    files=bpy.props.CollectionProperty(
        type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"}
    ),
    directory=bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN"}),
    title=bpy.props.StringProperty(
        name="Name", description="Name of the species; empty: as the file", options={"SKIP_SAVE"}
    ),
    height=bpy.props.FloatProperty(
        name="Height",
        description="Height of the tree; 0: the unit of the files is inferred",
        unit="LENGTH",
        min=0,
        max=200,
        options={"SKIP_SAVE"},
    ),
    accept=bpy.props.BoolProperty(
        name="Accept",
        description="Plant siblings of the tree even if they are too unlike it",
        options={"SKIP_SAVE"},
    ),
)
def import_tree(pressed: bpy.types.Operator, _context: bpy.types.Context) -> str:
    """Make a species from files of a tree: one of its wood and, if there is, one of its leaves"""
    named = [Path(pressed.directory) / file.name for file in pressed.files if file.name]
    wood, leaves = parts_of(named or [Path(pressed.filepath)])
    press(
        bpy.ops.forest.make_species,
        wood=str(wood),
        leaves=str(leaves or ""),
        title=pressed.title or title_from(wood),
        height=pressed.height,
        accept=pressed.accept,
    )
    return ""


@long_button(
    "Import STL",
    Working,
    wood=bpy.props.StringProperty(name="Wood", subtype="FILE_PATH", options={"SKIP_SAVE"}),
    leaves=bpy.props.StringProperty(name="Leaves", subtype="FILE_PATH", options={"SKIP_SAVE"}),
    title=bpy.props.StringProperty(name="Name", options={"SKIP_SAVE"}),
    height=bpy.props.FloatProperty(name="Height", unit="LENGTH", options={"SKIP_SAVE"}),
    accept=bpy.props.BoolProperty(name="Accept", options={"SKIP_SAVE"}),
)
def _make_species(pressed: bpy.types.Operator, context: bpy.types.Context) -> Work:
    """Recognise a tree in files, keep it as a species and plant it"""
    from ...blender.files.export import read_parts
    from ...blender.scene.assets import on_paper
    from ...formats.raster_file import write_png
    from ...growth.library import Brought, Library, check_name, make_library
    from ...spec import Look

    props = context.scene.forest_sensing
    wood, leaves = Path(pressed.wood), Path(pressed.leaves) if pressed.leaves else None
    accept, height = pressed.accept, pressed.height
    name = pressed.title or title_from(wood)
    check_name(name)
    plain = all(path.suffix.lower() == ".stl" for path in (wood, leaves) if path)
    groups = [] if plain else read_parts(wood, leaves)
    home = species_folder()
    folder = home / free_name(name, "-", "", lambda name: (home / name).exists())
    brought = Brought(wood, leaves, height, groups=groups)

    def recognise(tell: Progress) -> Library:
        made = make_library(brought, folder.name, folder, tell, siblings=JUDGED, accept=accept)
        picture = on_paper(made.wood, made.leaves, Look())
        with replacing(picture_of(made.species)) as file:
            file.write_bytes(write_png(picture))
        return made

    made = yield Task(say("recognising the tree"), recognise)
    if made.verdict is not None and not made.verdict.stands and not accept:
        shutil.rmtree(folder)
        problem = say("tick Accept to plant them all the same")
        raise SpecError(say("Import STL"), f"{made.verdict.sentence}; {problem}")
    planting = props.plantings.add()
    planting.species = made.species.as_posix()
    planting.use_expected = True
    props.active_plantings = len(props.plantings) - 1
    refresh()
    if made.verdict is not None and made.verdict.missed:
        return f"{folder.name}: {made.verdict.sentence}"
    return say(
        "{name}: {branches:,} branches, {leaves:,} leaves, {height:.2f} m high ({unit})",
        name=folder.name,
        branches=made.branches,
        leaves=made.leaf_count,
        height=made.height,
        unit=made.unit.name,
    )


def parts_of(files: Sequence[Path]) -> tuple[Path, Path | None]:
    """Files, of those that were chosen, of the wood and of the leaves.

    Raises
    ------
    SpecError : there are more than two, or their names do not tell.
    """
    if len(files) > 2:
        problem = say("{count} files are chosen; choose wood and leaves only", count=len(files))
        raise SpecError(say("Import STL"), problem)
    if len(files) == 1:
        return files[0], None
    leafy = [any(word in file.stem.lower() for word in OF_LEAVES) for file in files]
    if sum(leafy) != 1:
        problem = say('names do not tell wood from leaves; have "leaves" in one of them')
        raise SpecError(say("Import STL"), problem)
    return files[leafy.index(False)], files[leafy.index(True)]


def title_from(wood: Path) -> str:
    """A name for the species from its file, or from the folder where the file is just called wood."""
    plain = wood.stem.lower() in OF_WOOD and wood.parent.name
    return file_name(wood.parent.name if plain else wood.stem)


GROWN = ("siblings", "rules", "honda", "crown")  # in place of the grammar
SPREADS = {"FOREST_PG_normal": ("mean", "sd"), "FOREST_PG_discrete": ("values", "weights")}


@panel("Species", WithForest, bl_parent_id="FOREST_PT_forest", bl_order=0)
def species(tab: bpy.types.Panel, context: bpy.types.Context) -> None:
    layout, props = tab.layout, context.scene.forest_sensing
    draw_list(layout, props, "plantings", "planting")
    halves = layout.column() if is_narrow() else layout.split(factor=0.5)
    if chosen_planting(props) is not None:
        halves.template_icon_view(
            props, "species_picture", show_labels=True, scale=5.5, scale_popup=6.5
        )
    buttons = halves.column(align=True)
    if not _is_edited(context):
        buttons.operator("forest.edit_species", icon="GREASEPENCIL")
    else:
        buttons.operator("forest.build", icon="FILE_REFRESH")
        buttons.operator("forest.save_species", icon="FILE_TICK")
        buttons.operator("forest.discard_species", icon="LOOP_BACK")
    buttons.separator()
    buttons.operator("forest.import_tree", icon="IMPORT")
    buttons.operator("forest.make_library", text="As Assets", icon="ASSET_MANAGER")


def _is_edited(context: bpy.types.Context) -> bool:
    return edited_item(context.scene.forest_sensing) is not None


SECTIONS = {  # of a species: by what they do
    "template": keep("Branches from STL Files"),
    "siblings": keep("Trees Like That One"),
    "grammar": keep("L-system of the Papers"),
    "rules": keep("L-system of Your Own"),
    "honda": keep("Branching by Angles and Ratios"),
    "crown": keep("Crown That Fills a Shape"),
    "architecture": keep("Limbs, Forks, Dead Branches"),
    "targets": keep("Size to Reach"),
    "needles": keep("Shoots of Needles"),
    "jitter": keep("Natural Variation"),
    "leaf": keep("Leaves"),
    "inclination": keep("How Leaves Incline"),
    "detail": keep("Detail of the Mesh"),
    "look": keep("Colours"),
    "bark": keep("Bark"),
}


@panel("Species Settings", WithForest, bl_parent_id="FOREST_PT_species", needs=_is_edited)
def edited(tab: bpy.types.Panel, context: bpy.types.Context) -> None:
    """The settings of an edited species, part by part."""
    group = edited_item(context.scene.forest_sensing).settings
    for part, body in open_parts(tab.layout, group, "species", SECTIONS):
        body.active = body.active and not _is_idle(group, part)
        _draw_part(body, getattr(group, part))
    split(tab.layout).prop(group, "source")


def _is_idle(group: Any, part: str) -> bool:
    """Return whether a part of a species has no effect beside others that are in use."""
    if part in ("grammar", "jitter"):
        return any(getattr(group, f"use_{other}") for other in GROWN)
    if part == "siblings":
        return not group.use_template
    return part == "detail" and group.use_template


def _draw_part(layout: bpy.types.UILayout, group: Any) -> None:
    """Numbers and texts first, then what is drawn from a distribution."""
    wide = ("axiom", "productions", "constants", "symbols")  # texts of an L-system
    long = [name for name in group.shown if name in wide]
    draw_settings(split(layout), group, long)
    kind = type(group)
    for name in long:
        layout.label(text=name_in(kind, name))
        layout.prop(group, name, text="")
    for name in group.nested:
        if type(getattr(group, name)).__name__ in SPREADS:
            _draw_spread(layout, group, name)
        else:
            layout.label(text=name_in(kind, name))
            _draw_part(layout, getattr(group, name))


def _draw_spread(layout: bpy.types.UILayout, owner: Any, name: str) -> None:
    """A distribution in a line or two: what is drawn, and within which limits."""
    group, kind = getattr(owner, name), type(owner)
    first, second = SPREADS[type(group).__name__]
    column = layout.column(align=True)
    row = _line(column, name_in(kind, name))
    if has(kind, f"use_{name}"):
        row.prop(owner, f"use_{name}", text="")
    row.prop(group, first, text="")
    row.prop(group, second, text="", placeholder="weights")
    if has(type(group), "use_low"):
        row = _line(column, label("Within"))
        for limit in ("low", "high"):
            row.prop(group, f"use_{limit}", text="")
            value = row.row(align=True)
            value.active = getattr(group, f"use_{limit}")
            value.prop(group, limit, text="")


def _line(column: bpy.types.UILayout, heading: str) -> bpy.types.UILayout:
    """A row for several values, with a label to the left as other settings have it."""
    halves = column.split(factor=0.4)
    left = halves.row()
    left.alignment = "RIGHT"
    left.label(text=heading)
    return halves.row(align=True)
