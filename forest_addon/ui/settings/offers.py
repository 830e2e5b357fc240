"""Offers where a setting names something: objects, layers, files, species, scanners.

Lists are made when a field is opened. A field that names several things, parted by commas, offers the last.
A file is chosen in the file browser; Blender's ``//`` becomes a whole path, which scene files understand.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import bpy

from ... import spec
from ...base.places import ASSETS
from ...blender.show.intensity import HANDLE_KEY
from ...spec import Param
from .references import HEARD_TYPES, REFERENCES, layers_of

SPECIES = ASSETS / "species"


def offered(name: str, known: Param) -> dict[str, Any]:
    """Return what the property of a text needs so that something is offered for it; nothing for a free
    text."""
    if name in SEARCHES:
        words = {"search": SEARCHES[name], "search_options": {"SUGGESTION"}}
        return words | ({"update": _take_scanner} if name == "scanner" else {})
    if known.file:
        return {"subtype": "FILE_PATH", "update": lambda group, _: _whole_path(group, name)}
    return {}


def _whole_path(group: Any, name: str) -> None:
    path = getattr(group, name)
    if path.startswith("//"):
        setattr(group, name, bpy.path.abspath(path))


def _species(group: Any, context: Any, typed: str) -> list[str]:
    """Presets and what is edited here; for distances what is planted, as the report names it."""
    props = context.scene.forest_sensing
    if type(group).__name__ == "FOREST_PG_distance":
        return _planted(group, context, typed)
    presets = sorted(path.stem for path in SPECIES.glob("*.toml"))
    return _matching([*(item.name for item in props.edited), *presets], typed)


def _planted(_group: Any, context: Any, typed: str) -> list[str]:
    from ...stand.plan import labels

    return _matching(labels(context.scene.forest_sensing.plantings), typed)


def _scanners(group: Any, _context: Any, typed: str) -> list[str]:
    """Presets that are used on this platform."""
    from ...formats.toml_file import read_scanner, scanner_names

    kind = type(group).__name__.removeprefix("FOREST_PG_")
    return [n for n in _matching(scanner_names(), typed) if kind in read_scanner(n).tables]


def _paths(_group: Any, context: Any, typed: str) -> list[str]:
    """Curves, and objects that are animated."""
    able = [t for t in context.scene.objects if REFERENCES["follow"].fits(None, t)]
    return _matching(sorted(thing.name for thing in able), typed)


def _surfaces(_group: Any, context: Any, typed: str) -> list[str]:
    return _matching(sorted(thing.name for thing in _solid(context)), typed)


def _layers(_group: Any, context: Any, typed: str) -> list[str]:
    """Vertex groups, and attributes of numbers with a fraction or of colours, of every mesh."""
    names = []
    for thing in _solid(context):
        names += [f"{thing.name}:{layer}" for layer in layers_of(thing)]
    return _matching(sorted(names), typed)


def _collections(_group: Any, _context: Any, typed: str) -> list[str]:
    return _matching(sorted(home.name for home in bpy.data.collections), typed)


def _heard(name: str) -> Any:
    def search(_group: Any, context: Any, typed: str) -> list[str]:
        before, comma, last = typed.rpartition(",")
        names = sorted(
            thing.name
            for thing in context.scene.objects
            if thing.type in HEARD_TYPES[name] and HANDLE_KEY not in thing
        )
        chosen = {part.strip() for part in before.split(",")}
        start = f"{before}{comma} " if comma else ""
        return [start + n for n in _matching(names, last.strip()) if n not in chosen]

    return search


def _solid(context: Any) -> list[bpy.types.Object]:
    """Objects with a surface; a forest's own trees are none that one would name."""
    from ...blender.read.depsgraph import SOLID_TYPES, SPECIES_KEY

    solid = (thing for thing in context.scene.objects if thing.type in SOLID_TYPES)
    return [thing for thing in solid if SPECIES_KEY not in thing]


def _matching(names: Iterable[str], typed: str) -> list[str]:
    return [name for name in names if typed.lower() in name.lower()]


def _take_scanner(props: Any, context: Any) -> None:
    """Put the figures of the scanner that was chosen into the settings; they can be changed after."""
    from ...formats.toml_file import settings_of, structure
    from . import exchange

    kind = type(props).__name__.removeprefix("FOREST_PG_")
    folder = Path(bpy.path.abspath(context.scene.forest_sensing.folder))
    try:
        figures = settings_of(props.scanner, kind, folder)
        chosen = structure(figures, spec.SENSORS[kind])
    except (spec.SpecError, ImportError):
        return  # not a whole name yet, or none: what is set stays
    exchange.write(props, chosen, figures)


SEARCHES = {
    "species": _species,
    "other": _planted,
    "scanner": _scanners,
    "follow": _paths,
    "object": _surfaces,
    "painted": _layers,
    "collection": _collections,
    "source_objects": _heard("source_objects"),
    "receiver_objects": _heard("receiver_objects"),
}
