"""Showing and selecting one object, active and alone: what a list, a result or a button chose."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

Way = tuple[bpy.types.LayerCollection, ...]  # from a view layer's own collection down to one


def select(context: bpy.types.Context, thing: bpy.types.Object) -> None:
    """Make an object visible, active and the only one selected."""
    show(context, thing)
    select_alone(context.view_layer, thing)


def show(context: bpy.types.Context, thing: bpy.types.Object) -> None:
    """Make an object visible. Of collections only those that hide it are shown: others stay excluded."""
    layer = context.view_layer
    way = min(_ways(layer.layer_collection, thing), key=_hidden, default=())
    for home in way:
        for hides in (home, home.collection):
            if hides.hide_viewport:
                hides.hide_viewport = False
    if way and way[-1].exclude:
        _include(way[-1])
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


def _ways(home: bpy.types.LayerCollection, thing: bpy.types.Object) -> Iterator[Way]:
    """The ways from a collection down to each that holds an object."""
    if home.collection.objects.get(thing.name) == thing:
        yield (home,)
    for child in home.children:
        for way in _ways(child, thing):
            yield (home, *way)


def _hidden(way: Way) -> int:
    """Return how many switches along a way hide what the last collection holds."""
    return way[-1].exclude + sum(h.hide_viewport + h.collection.hide_viewport for h in way)


def _include(home: bpy.types.LayerCollection) -> None:
    """Include a collection in its view layer, and none of those within, which Blender includes with it."""
    within = list(_below(home))
    excluded = [child.exclude for child in within]
    home.exclude = False
    for child, was in zip(within, excluded, strict=True):
        child.exclude = was


def _below(home: bpy.types.LayerCollection) -> Iterator[bpy.types.LayerCollection]:
    """The collections within another, each before those within it."""
    for child in home.children:
        yield child
        yield from _below(child)
