"""The panel and its operators, and how Blender gets to know them: all of them or none.

By what a user sees: ``species``, ``forest``, ``sensors``, ``results``. Beside them stands what these share:
settings as properties (``fields``, ``groups``, ``properties``), between those and ``spec`` (``exchange``),
lists, drawing, running, words.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from types import ModuleType

Step = tuple[Callable[[], object], Callable[[], object]]


def register() -> None:
    """Register every class, property, menu and handler; what fails takes back what came before it."""
    from .shell import running

    running.missing.cache_clear()
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


@contextmanager
def registered() -> Iterator[None]:
    """Have Blender know the settings that a file holds, also where no extension is switched on."""
    import bpy

    if hasattr(bpy.types.Scene, "forest_sensing"):
        yield
        return
    register()
    try:
        yield
    finally:
        unregister()


def _steps() -> Iterator[Step]:
    """Steps of registering, one by one, and how each is taken back."""
    import bpy

    for cls in _classes():
        yield partial(bpy.utils.register_class, cls), partial(bpy.utils.unregister_class, cls)
    for room in _rooms():
        for owner, name, prop in getattr(room, "PROPERTIES", ()):
            yield partial(setattr, owner, name, prop), partial(delattr, owner, name)
        of_windows = () if bpy.app.background else getattr(room, "WINDOW_HANDLERS", ())
        for name, handler in (*getattr(room, "HANDLERS", ()), *of_windows):
            handlers = getattr(bpy.app.handlers, name)
            yield partial(handlers.append, handler), partial(_drop, handlers, handler)
        for name, draw in getattr(room, "MENUS", ()):
            menu = getattr(bpy.types, name)
            yield partial(menu.append, draw), partial(menu.remove, draw)
        if hasattr(room, "unregister"):  # some only have something to take back
            yield getattr(room, "register", lambda: None), room.unregister


def _drop(handlers: list, handler: Callable[..., object]) -> None:
    if handler in handlers:
        handlers.remove(handler)


def _classes() -> list[type]:
    """Return the classes of Blender's kinds in every room: those that it made, then those in its text.

    The operator FOREST_OT_NAME is called forest.NAME.
    """
    classes: dict[type, None] = {}
    for room in _rooms():
        own = [c for c in vars(room).values() if isinstance(c, type)]
        classes |= dict.fromkeys([*getattr(room, "CLASSES", ()), *own])
    ours = [cls for cls in classes if cls.__name__.startswith("FOREST_")]
    for cls in ours:
        if cls.__name__.startswith("FOREST_OT_"):
            cls.bl_idname = cls.__name__.replace("FOREST_OT_", "forest.")
    return ours


ROOMS = (
    *("properties", "shell.words", "shell.running", "forest.tree", "forest.start"),
    *("forest.build", "forest.scene_file", "sensors.add", "sensors.run", "sensors.look_through"),
    *("results.keep", "settings.preferences", "settings.presets", "forest.panels"),
    *("sensors.panels", "results.panel", "overlay", "species.edit"),
    *("forest.wind", "shell.views", "settings.hills", "forest.hand", "forest.planting"),
    "settings.references",
)


def _rooms() -> tuple[ModuleType, ...]:
    """Modules with classes, menus or handlers; panels in the order in which they stand.

    Classes FOREST_* and the made ones in ``CLASSES`` are registered, ``PROPERTIES`` given to classes of
    Blender's, ``HANDLERS`` appended to the lists of bpy.app.handlers that they name (``WINDOW_HANDLERS`` not
    in the background), ``MENUS`` to Blender's menus; ``register`` and ``unregister`` do the rest.
    """
    return tuple(importlib.import_module(f".{name}", __name__) for name in ROOMS)
