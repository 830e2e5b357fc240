"""Values made the type that their field says, or refused in one sentence.

A whole number is no text, no truth value is a number, a group of settings is no table: nothing is guessed.
What means the same is taken: arrays and lists as tuples, numpy's numbers as Python's own, a whole number
where any number may stand, a path where a file is named.
"""

from __future__ import annotations

import os
import types
import typing
from functools import cache
from typing import Any

from .problem import SpecError

MOST_BITS = 1000  # of a whole number; a float holds some more
MOST_SHOWN = 200  # characters of a value that is wrong
WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a text in quotes"}


@cache
def types_of(cls: Any) -> dict[str, Any]:
    """The type of each field of a dataclass, by its name."""
    return typing.get_type_hints(cls)


def typed(key: str, value: Any, kind: Any) -> Any:
    """A value as the type that it is to have.

    kind : bool, int, float, str, a class of settings, a tuple of them, or a union.

    Raises
    ------
    SpecError : it is of another type; ``key`` says where.
    """
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        return _one_of(key, value, typing.get_args(kind))
    if typing.get_origin(kind) is tuple:
        return _tuple(key, value, typing.get_args(kind))
    if kind not in WORDS:
        if isinstance(value, kind):
            return value
        kinds = [known.__name__ for known in getattr(kind, "KINDS", {}).values()] or [kind.__name__]
        raise SpecError(key, f"{shown(value)} is not settings; give {'(...), '.join(kinds)}(...)")
    plain = value.item() if getattr(value, "shape", None) == () else value  # numpy's own number
    if kind is str and isinstance(plain, os.PathLike):
        plain = os.fspath(plain)
    accepted = (int, float) if kind is float else kind
    if not isinstance(plain, accepted) or (isinstance(plain, bool) and kind is not bool):
        raise SpecError(key, f"{shown(value)} is not {WORDS[kind]}")
    if isinstance(plain, int) and plain.bit_length() > MOST_BITS:
        raise SpecError(key, "is a whole number of more than 300 digits; give a smaller one")
    if isinstance(plain, str) and "\0" in plain:
        raise SpecError(key, "has a null character, which no text and no file name has; remove it")
    return plain if type(plain) is kind else kind(plain)


def shown(value: Any) -> str:
    """A value as a sentence shows it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int) and value.bit_length() > MOST_BITS:
        return "a whole number of more than 300 digits"
    try:
        text = " ".join(str(value).split())
        if isinstance(value, str):
            text = f'"{value}"' if value.isprintable() else ascii(value)
    except Exception:  # tables within tables; digits beyond Python's limit; whatever it is
        text = "a table or list"
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}…"


def _one_of(key: str, value: Any, kinds: tuple[Any, ...]) -> Any:
    """A value of one of several types; None where that is one of them."""
    left = [kind for kind in kinds if kind is not type(None)]
    if value is None and len(left) < len(kinds):
        return None
    if len(left) == 1:
        return typed(key, value, left[0])
    if isinstance(value, tuple(left)):
        return value
    names = ", ".join(f"{kind.__name__}(...)" for kind in left)
    raise SpecError(key, f"{shown(value)} is none of {names}; give one of these")


def _tuple(key: str, value: Any, kinds: tuple[Any, ...]) -> Any:
    """A tuple, a list or an array as a tuple of a length that is known, or of any."""
    many = len(kinds) == 2 and kinds[1] is Ellipsis
    length = "" if many else f" of {len(kinds)} numbers"
    items = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(items, (tuple, list)):
        raise SpecError(key, f"{shown(value)} is not a list{length}")
    if not many and len(items) != len(kinds):
        raise SpecError(key, f"has {len(items)} values; give {len(kinds)}")
    given = (kinds[0],) * len(items) if many else kinds
    return tuple(
        typed(f"{key}[{k}]", item, kind)
        for k, (item, kind) in enumerate(zip(items, given, strict=True))
    )
