"""Trees kept as they grew, before leaves fell: another season of a forest grows none of them anew."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from ..growth.measured.wanted import Wanted
from ..growth.own_tree.habit import Habit
from ..growth.own_tree.template import TreeTemplate
from ..growth.tree import Tree
from ..spec import Look, Species

MOST_KEPT = 500_000_000  # bytes
Key = tuple[Any, ...]


class TreesBeforeFall:
    """Trees of the forest that grew last, by all that they grew from, ``MOST_KEPT`` bytes of them."""

    def __init__(self) -> None:
        self._trees: dict[Key, tuple[Tree, object]] = {}
        self._asked: set[Key] = set()
        self._bytes = 0

    def tree(self, key: Key, templates: object, make: Callable[[], Tree]) -> Tree:
        """Return the tree of a key (``key_of``), made where it is not kept.

        templates : what the key was made with; they live as long as the tree.
        """
        self._asked.add(key)
        if key in self._trees:
            return self._trees[key][0]
        tree = make()
        if self._bytes + tree.nbytes <= MOST_KEPT:
            self._trees[key] = tree, templates
            self._bytes += tree.nbytes
        return tree

    def forget_others(self) -> None:
        """Forget trees that nobody asked for since this was called last."""
        self._trees = {key: kept for key, kept in self._trees.items() if key in self._asked}
        self._bytes = sum(tree.nbytes for tree, _ in self._trees.values())
        self._asked = set()


def key_of(
    stream_of: tuple[Any, ...], species: Species, templates: object, wanted: Wanted | None
) -> Key:
    """All that a tree grows from; colours are not among it.

    stream_of : the seed and the words of its random stream.
    """
    # Templates are one object as long as they are the same; a leaf or an allometry is read anew each time.
    shared = isinstance(templates, TreeTemplate | Habit)
    made_of = id(templates) if shared else _content(templates)
    return (stream_of, repr(species.changed(look=Look())), made_of, wanted)


def _content(value: object) -> object:
    """Return what a value says, to compare by: equal for two readings of one file."""
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.str, value.tobytes()
    if is_dataclass(value):
        return type(value), *(_content(getattr(value, field.name)) for field in fields(value))
    if isinstance(value, dict):
        return tuple((_content(key), _content(one)) for key, one in value.items())
    return tuple(_content(one) for one in value) if isinstance(value, list | tuple) else value
