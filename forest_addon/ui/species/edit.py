"""Species of one's own: take a preset into properties, change it, save it as a species file.

An edited species lives in the .blend under a name such as edited/maple.toml, which plantings use as if it
were a file; ``load`` takes it from there. STL files that it names start from the folder that it came
from.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import bpy
from bpy_extras.io_utils import ExportHelper

from ... import spec
from ...base.places import ASSETS
from ..settings import exchange
from ..settings.preferences import species_folder
from ..shell.chosen import chosen_planting
from ..shell.names import EDITED, title_of
from ..shell.running import LINKED, PROBLEMS, in_words
from ..shell.words import say
from .pictures import refresh

Edited = Mapping[str, tuple[spec.Species, Path]]  # by what plantings call it; where its files are


def edited_species(scene: bpy.types.Scene) -> dict[str, tuple[spec.Species, Path]]:
    """Return what is edited in a scene and planted in it.

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
    from ...growth.library.species_file import complete_species, find_species, load_species

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
    """Return what a file is called in one that stands in another folder."""
    try:
        return Path(os.path.relpath(file, home)).as_posix()
    except ValueError:  # another drive
        return file.resolve().as_posix()


def edited_item(props: Any) -> Any:
    """Return what is edited of the chosen planting's species, None where it is a preset or a file."""
    planting = chosen_planting(props)
    return None if planting is None else props.edited.get(planting.species)


class _OfSpecies:
    """An operator on the species of the chosen planting."""

    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}
    of_edited = True

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        props = context.scene.forest_sensing
        reason = ""
        if not context.scene.is_editable:
            reason = say(LINKED)
        elif chosen_planting(props) is None:
            reason = say("There is no planting yet. Add one to the list")
        elif (edited_item(props) is not None) != cls.of_edited:
            not_yet = say("This species is not edited yet. Press Edit first")
            reason = not_yet if cls.of_edited else say("This species is being edited already")
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            said = self.change(context.scene)
        except PROBLEMS as problem:
            self.report({"ERROR"}, in_words(problem))
            return {"CANCELLED"}
        self.report({"INFO"}, said)
        return {"FINISHED"}


class FOREST_OT_edit_species(_OfSpecies, bpy.types.Operator):
    """Change this species: its settings are taken into this file, the preset stays as it is"""

    bl_idname = "forest.edit_species"
    bl_label = "Edit"
    of_edited = False

    def change(self, scene: bpy.types.Scene) -> str:
        from ...formats.toml_file import read_settings
        from ...growth.library.species_file import find_species

        props = scene.forest_sensing
        planting = chosen_planting(props)
        path = find_species(planting.species, Path(bpy.path.abspath(props.folder)))
        species = read_settings(path, spec.Species)
        item = props.edited.add()
        item.name = _free_name(props, path.stem)
        item.origin = planting.species
        item.folder = "" if _is_preset(planting.species) else str(path.resolve().parent)
        exchange.write(item.settings, species)
        planting.species = item.name
        return say(
            "{species} can be changed now; Grow Forest grows it so",
            species=title_of(path.stem),
        )


class FOREST_OT_discard_species(_OfSpecies, bpy.types.Operator):
    """Give these changes up and plant what the species was made from"""

    bl_idname = "forest.discard_species"
    bl_label = "Discard"

    def change(self, scene: bpy.types.Scene) -> str:
        item = edited_item(scene.forest_sensing)
        origin = item.origin
        _replace(scene, item, origin)
        return say("Back to {species}", species=title_of(origin))


class FOREST_OT_save_species(_OfSpecies, bpy.types.Operator, ExportHelper):
    """Write this species to a file of its own (.toml), which the planting uses from then on"""

    bl_idname = "forest.save_species"
    bl_label = "Save As"
    filename_ext = ".toml"
    filter_glob: bpy.props.StringProperty(default="*.toml", options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        item = edited_item(context.scene.forest_sensing)
        if _is_preset(item.origin):
            species_folder().mkdir(parents=True, exist_ok=True)
            self.filepath = str(species_folder() / Path(item.name).name)
        else:
            self.filepath = str(Path(item.folder) / Path(item.origin).name)
        return ExportHelper.invoke(self, context, event)

    def change(self, scene: bpy.types.Scene) -> str:
        from ...formats.toml_file import write_settings

        props = scene.forest_sensing
        item = edited_item(props)
        species, home = _read(item)
        path = Path(bpy.path.abspath(self.filepath)).resolve()
        path.parent.mkdir(parents=True, exist_ok=True)
        own = relocated(replace(species, name=path.stem), home, path.parent)
        write_settings(path, own)
        _replace(scene, item, _called(path, props.folder))
        refresh()
        return say("Written: {file}", file=path)


CLASSES = (FOREST_OT_edit_species, FOREST_OT_discard_species, FOREST_OT_save_species)


def _read(item: Any) -> tuple[spec.Species, Path]:
    """An edited species, and the folder that its STL files start from."""
    stem = Path(item.name).stem
    species = exchange.read(item.settings, spec.Species, stem)
    return species, Path(item.folder) if item.folder else ASSETS / "species"


def _replace(scene: bpy.types.Scene, item: Any, species: str) -> None:
    """Plant another species wherever an edited one is planted, and forget that."""
    props = scene.forest_sensing
    name = item.name
    for planting in props.plantings:
        if planting.species == name:
            planting.species = species
    props.edited.remove(props.edited.find(name))


def _free_name(props: Any, stem: str) -> str:
    name, number = f"{EDITED}{stem}.toml", 1
    while name in props.edited:
        number += 1
        name = f"{EDITED}{stem}-{number}.toml"
    return name


def _is_preset(species: str) -> bool:
    return not species.endswith(".toml")


def _called(path: Path, folder: str) -> str:
    """Return what a planting calls a species file: within the scene's folder, relative to that."""
    home = Path(bpy.path.abspath(folder)).resolve()
    inside = folder and path.is_relative_to(home)
    return (path.relative_to(home) if inside else path).as_posix()
