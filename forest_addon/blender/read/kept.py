"""Products of an evaluated scene, kept until Blender reports any change.

Blender tells handlers of every update of a depsgraph (a move, an edit, a setting of a modifier), every
change of frame, undo and redo; each of them drops all that is kept. Loading a file empties the lists of
handlers: whoever finds ours missing keeps nothing either. So what is kept is never older than the depsgraph.
"""

from __future__ import annotations

import atexit
from collections.abc import Callable, Hashable, Iterable
from typing import Any, TypeVar

import bpy

T = TypeVar("T")

_kept: dict[Hashable, Any] = {}


def kept(depsgraph: bpy.types.Depsgraph, make: Callable[..., T], *settings: Hashable) -> T:
    """``make(depsgraph, *settings)``, or what it made of this scene before if nothing changed since."""
    if not all(forget in handlers for handlers in _reports()):
        unwatch()
        for handlers in _reports():
            handlers.append(forget)
    view = (depsgraph.scene.session_uid, depsgraph.view_layer.name, depsgraph.mode)
    key = (*view, make, *settings)
    if key not in _kept:
        _kept[key] = make(depsgraph, *settings)
    return _kept[key]


def forget(*_: Any) -> None:
    """Drop all that is kept; the handler of every change."""
    _kept.clear()


def unwatch() -> None:
    """Forget, and take the handlers back."""
    forget()
    for handlers in _reports():
        if forget in handlers:
            handlers.remove(forget)


atexit.register(unwatch)  # with a handler of ours left, bpy 4.5 does not end


def _reports() -> Iterable[list]:
    """Blender's lists of whom to tell of a change."""
    known = bpy.app.handlers
    return (known.depsgraph_update_post, known.frame_change_post, known.undo_post, known.redo_post)
