"""Blender loads an extension from its root folder: this shim hands on to ``forest_addon``.

Nothing is imported at load, so that tools which walk the repository need no Blender.
"""


def register() -> None:
    from .forest_addon import register

    register()


def unregister() -> None:
    from .forest_addon import unregister

    unregister()
