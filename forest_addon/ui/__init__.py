"""The panel and its operators, and how Blender gets to know them: all of them or none.

By what a user sees: ``species``, ``forest``, ``sensors``, ``results``. Beside them stands what these share:
settings as properties (``fields``, ``groups``, ``properties``), between those and ``spec`` (``exchange``),
lists, drawing, running, words.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from types import ModuleType

Step = tuple[Callable[[], object], Callable[[], object]]


def register() -> None:
    """Register every class, property, menu and handler; what fails takes back what came before it."""
    from .shell import requirements

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
    from ..blender.read.depsgraph import unwatch

    unwatch()
    for _, undo in reversed(list(_steps())):
        undo()


def _steps() -> Iterator[Step]:
    """Return what registering does, one by one, and how each is taken back."""
    import bpy

    from .properties import FOREST_PG_scene, FOREST_PG_sensor

    for cls in _classes():
        yield partial(bpy.utils.register_class, cls), partial(bpy.utils.unregister_class, cls)
    for owner, name, group in (
        (bpy.types.Scene, "forest_sensing", FOREST_PG_scene),
        (bpy.types.Object, "forest_sensor", FOREST_PG_sensor),
    ):
        pointer = bpy.props.PointerProperty(type=group)
        yield partial(setattr, owner, name, pointer), partial(delattr, owner, name)
    for room in _rooms():
        if hasattr(room, "unregister"):  # some only have something to take back
            yield getattr(room, "register", lambda: None), room.unregister


def _classes() -> tuple[type, ...]:
    return tuple(cls for room in _rooms() for cls in getattr(room, "CLASSES", ()))


def _rooms() -> tuple[ModuleType, ...]:
    """Return what has classes, menus or handlers; panels in the order in which they stand."""
    from . import overlay, properties
    from .forest import (
        build,
        by_hand,
        dropped,
        gallery,
        hand_edits,
        live,
        new_file,
        painting,
        planting,
        scene_file,
        start,
        tree,
        wind_view,
    )
    from .forest import lists as forest_lists
    from .forest import panels as forest_panels
    from .results import export, frames, names, show, shown, swatches
    from .results import panel as results_panel
    from .sensors import add, flight, instruments, look_through, run, things
    from .sensors import lists as sensors_lists
    from .sensors import panels as sensors_panels
    from .settings import command, hills, manual, preferences, presets, saved
    from .shell import chosen, languages, pace, running
    from .species import edit, import_stl, library, pictures
    from .species import panel as species_panel

    return (
        *(properties, pictures, languages, pace, running, things, tree, gallery, start, new_file),
        *(
            sensors_lists,
            forest_lists,
            build,
            scene_file,
            add,
            instruments,
            run,
            look_through,
            show,
            shown,
            export,
            frames,
            names,
            swatches,
        ),
        preferences,
        presets,
        *(forest_panels, by_hand, sensors_panels, flight, results_panel),
        *(overlay, edit, import_stl, library, species_panel, wind_view),
        *(chosen, hills, painting, hand_edits, dropped, planting, live, command, manual, saved),
    )
