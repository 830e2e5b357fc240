"""Forest Sensing: grows L-system forests and runs biosonar, LiDAR and forest reverb in them."""

from __future__ import annotations


def register() -> None:
    """Register the panel and its operators with Blender."""
    from . import ui

    ui.register()


def unregister() -> None:
    """Take everything back that ``register`` registered."""
    from . import ui

    ui.unregister()
