"""Showing and selecting one object, active and alone: what a list, a result or a button chose."""

from __future__ import annotations

import bpy


def select(context: bpy.types.Context, thing: bpy.types.Object) -> None:
    """Make an object visible, active and the only one selected."""
    show(context, thing)
    select_alone(context.view_layer, thing)


def show(context: bpy.types.Context, thing: bpy.types.Object) -> None:
    """Make an object visible."""
    layer = context.view_layer
    _reveal(layer.layer_collection, set(thing.users_collection))
    thing.hide_viewport = False
    if thing.name in layer.objects:
        thing.hide_set(False)


def select_alone(layer: bpy.types.ViewLayer, thing: bpy.types.Object) -> None:
    """Make an object active and the only one selected, where a view layer has it."""
    for other in layer.objects.selected:
        other.select_set(False)
    if thing.name in layer.objects:
        thing.select_set(True)
        layer.objects.active = thing


def _reveal(home: bpy.types.LayerCollection, of: set[bpy.types.Collection]) -> bool:
    """Show a collection if it is one of these or has one of them within; says whether it is or has."""
    inner = [_reveal(child, of) for child in home.children]
    if home.collection not in of and not any(inner):
        return False
    home.exclude = home.hide_viewport = home.collection.hide_viewport = False
    return True
