"""A Blender scene as a scene file that gives the same results without a window, wherever it is written.

Files that settings name are named from the folder of the scene file. Edited species are written into a
folder beside it. Objects that are not ours are seen by sensors and may be named by settings, so a scene
that has them starts from its .blend file.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy

from ... import spec
from ...blender.scene.instances import IGNORED_KEY, may_be_met
from ...blender.scene.layout import is_ours
from ...formats.toml_file import write_settings
from ..settings.exchange import to_spec
from ..shell.words import say
from ..species.edit import Edited, edited_species, from_folder, relocated

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

    def move(file: str) -> str:
        known = (origin / file).is_file()  # else it is shipped with the add-on, or missing anyhow
        return from_folder(origin / file, path.parent) if known else file

    settings = spec.with_files(settings, move)
    blend, wanting = _blend_for(scene, settings, path.parent)
    write_settings(path, replace(_with_edited(settings, edited, path), blend=blend))
    return wanting


def _blend_for(scene: bpy.types.Scene, settings: spec.Scene, home: Path) -> tuple[str, str]:
    """The .blend file that a scene file starts from, if it needs one, and what is wanting."""
    others = sorted(
        thing.name
        for thing in scene.objects
        if may_be_met(thing) and not is_ours(thing) and not thing.get(IGNORED_KEY)
    )
    others += sorted(_named_objects(settings) - set(others))
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


def _named_objects(settings: spec.Settings) -> set[str]:
    """Return what settings name of the scene: objects, layers of them, collections."""
    named: set[str] = set()
    for name, value in vars(settings).items():
        if name in OF_OBJECTS and value:
            named.add(value)
        for inner in value if isinstance(value, tuple) else (value,):
            if isinstance(inner, spec.Settings):
                named |= _named_objects(inner)
    return named


def _with_edited(settings: spec.Scene, edited: Edited, path: Path) -> spec.Scene:
    """Write edited species into a folder beside a scene file; returns the settings that name them so."""
    home = path.with_name(f"{path.stem}-species")
    names = {name: f"{home.name}/{Path(name).name}" for name in edited}
    for name, (species, origin) in edited.items():
        home.mkdir(parents=True, exist_ok=True)
        write_settings(path.parent / names[name], relocated(species, origin, home))
    plantings = (replace(p, species=names.get(p.species, p.species)) for p in settings.plantings)
    return replace(settings, plantings=tuple(plantings))
