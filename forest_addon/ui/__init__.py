"""The panel and its operators, and how Blender gets to know them: all of them or none."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

Step = tuple[Callable[[], object], Callable[[], object]]


def register() -> None:
    """Register every class, property, menu and handler; what fails takes back what came before it."""
    from . import requirements

    requirements.missing.cache_clear()
    undone: list[Callable[[], object]] = []
    try:
        for do, undo in _steps():
            do()
            undone.append(undo)
    except Exception:
        for undo in reversed(undone):
            undo()
        raise


def unregister() -> None:
    """Take everything back, in reverse order."""
    from ..blender.kept import unwatch

    unwatch()
    for _, undo in reversed(list(_steps())):
        undo()


def _steps() -> Iterator[Step]:
    """What registering does, one by one, and how each is taken back."""
    import bpy

    from . import (
        command,
        hills,
        languages,
        live,
        migration,
        new_file,
        overlay,
        painting,
        running,
        species_pictures,
        start,
        things,
        tree,
    )
    from .properties import FOREST_PG_scene, FOREST_PG_sensor

    for cls in _classes():
        yield partial(bpy.utils.register_class, cls), partial(bpy.utils.unregister_class, cls)
    for owner, name, group in (
        (bpy.types.Scene, "forest_sensing", FOREST_PG_scene),
        (bpy.types.Object, "forest_sensor", FOREST_PG_sensor),
    ):
        pointer = bpy.props.PointerProperty(type=group)
        yield partial(setattr, owner, name, pointer), partial(delattr, owner, name)
    yield species_pictures.refresh, species_pictures.unregister
    of_views = (overlay, hills, painting, live)
    for part in (languages, running, things, tree, start, new_file, *of_views, command, migration):
        yield part.register, part.unregister


def _classes() -> tuple[type, ...]:
    from . import (
        lists,
        live,
        migration,
        new_file,
        operators,
        painting,
        panels,
        preferences,
        properties,
        species_edit,
        species_import,
        species_panel,
        start,
        tree,
    )

    of_species = (species_edit, species_import, species_panel)
    rooms = (
        properties,
        lists,
        operators,
        live,
        painting,
        tree,
        start,
        new_file,
        preferences,
        migration,
        panels,
        *of_species,
    )
    return tuple(cls for room in rooms for cls in room.CLASSES)
