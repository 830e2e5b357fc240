"""Species to choose from, as pictures: the presets, one's own, those that are edited in the file.

Folders are looked into when species are first drawn, and not again; ``refresh`` takes note of a new file.
Pictures of what is planted are read then, the others one by one afterwards, so that the menu has them when it
is opened: Blender would show a spinner for each that it has not read yet.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import bpy
import bpy.utils.previews

from ...base.places import ASSETS
from ..settings.preferences import species_folder
from ..shell.chosen import chosen_planting
from ..shell.names import title_of
from ..shell.words import label, language

Choice = tuple[str, str, str, int, int]  # what a planting calls it, name, help, icon, number

BETWEEN = 0.02  # s between two pictures that are read

_pictures: Any = None
_unread: list[str] = []  # species whose pictures are not read yet


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
    found = _choices(edited, (), _language)
    ordered = sorted(found, key=lambda choice: choice[0] != first)
    return [
        (name, title, label("Grow a {species}", species=title), icon, number)
        for number, (name, title, _, icon, _) in enumerate(ordered)
    ]


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


def register() -> None:
    """Look into the folders when species are first drawn."""
    refresh()


def unregister() -> None:
    """Free the pictures."""
    global _pictures
    refresh()
    _unread.clear()
    if bpy.app.timers.is_registered(_read_next):
        bpy.app.timers.unregister(_read_next)
    if _pictures is not None:
        bpy.utils.previews.remove(_pictures)
        _pictures = None


@functools.lru_cache(maxsize=16)  # Blender wants the texts kept while it shows them
def _choices(
    edited: tuple[tuple[str, str], ...], planted: tuple[str, ...], _language: str
) -> tuple[Choice, ...]:
    origins = dict(edited)
    names = dict.fromkeys([*_files(), *origins, *filter(None, planted)])
    titles = [
        label("{species} (edited)", species=title_of(name)) if name in origins else title_of(name)
        for name in names
    ]
    return tuple(
        (
            name,
            title,
            label("Plant {species}", species=title),
            _icon(origins.get(name, name), name in planted),
            number,
        )
        for number, (name, title) in enumerate(zip(names, titles, strict=True))
    )


@functools.cache
def _files() -> dict[str, Path | None]:
    """Return what a planting calls each species that is there, and its picture if it has one."""
    presets = sorted(file.stem for file in (ASSETS / "species").glob("*.toml"))
    pictures = {file.stem: file for file in (ASSETS / "species" / "pictures").glob("*.jpg")}
    own = sorted([*species_folder().glob("*.toml"), *species_folder().glob("*/*.toml")])
    mine = {
        file.as_posix(): picture_of(file) if picture_of(file).exists() else None
        for file in own
        if file.name != "scene.toml"
    }
    return {name: pictures.get(name) for name in presets} | mine


def picture_of(species: Path) -> Path:
    """The picture of one's own species, beside its file."""
    return species.with_suffix(".png")


def _icon(species: str, now: bool) -> int:
    """The number of a species' picture; that of a plain icon where it has none. now : it is read at once."""
    global _pictures
    if _pictures is None:
        _pictures = bpy.utils.previews.new()
    picture = _files().get(species)
    if picture is None:
        return int(_plain_icons()["OUTLINER_OB_CURVES"].value)
    if species not in _pictures:
        _pictures.load(species, str(picture), "IMAGE")
        _unread.append(species)
        if not bpy.app.background and not bpy.app.timers.is_registered(_read_next):
            bpy.app.timers.register(_read_next, first_interval=BETWEEN)
    if now and species in _unread:
        _read(species)
    return int(_pictures[species].icon_id)


def _read(species: str) -> None:
    """Have Blender read a picture's file now, as it does when it is asked for the size."""
    _unread.remove(species)
    tuple(_pictures[species].image_size)


def _read_next() -> float | None:
    """Read one more picture; returns the seconds until the next, None after the last."""
    if _unread and _pictures is not None:
        _read(_unread[0])
    return BETWEEN if _unread else None


def _plain_icons() -> Any:
    return bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items
