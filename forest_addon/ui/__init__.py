"""The panel and its operators, and how Blender gets to know them: all of them or none."""

from __future__ import annotations


def register() -> None:
    """Register every class and the scene's property; what fails takes back what came before it."""
    import bpy

    from . import requirements
    from .properties import FOREST_PG_scene

    requirements.missing.cache_clear()
    done: list[type] = []
    try:
        for cls in _classes():
            bpy.utils.register_class(cls)
            done.append(cls)
        bpy.types.Scene.forest_sensing = bpy.props.PointerProperty(type=FOREST_PG_scene)
    except Exception:
        for cls in reversed(done):
            bpy.utils.unregister_class(cls)
        raise


def unregister() -> None:
    """Take everything back, in reverse order."""
    import bpy

    from ..blender.kept import unwatch

    unwatch()
    del bpy.types.Scene.forest_sensing
    for cls in reversed(_classes()):
        bpy.utils.unregister_class(cls)


def _classes() -> tuple[type, ...]:
    from . import lists, operators, panels, properties

    return (*properties.CLASSES, *lists.CLASSES, *operators.CLASSES, *panels.CLASSES)
