"""Values of records, arrays, containers and plain things in an NPZ, for results that are kept.

Arrays stand in it as they are, all else as JSON beside them. There is no pickle: a record (a dataclass) is
named, and made again from its fields by whoever reads, who says which names are records; nothing else is
looked up, and nothing that a file names is called.
"""

from __future__ import annotations

import dataclasses
import functools
import json
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np

from .coordinates import Offset

TREE = "tree"  # the entry that holds the JSON; arrays are called by their number
MANY: dict[str, Callable[[Any], Any]] = {
    kind.__name__: kind for kind in (tuple, list, set, frozenset)
}
MADE: dict[str, Callable[..., Any]] = {
    "complex": complex,
    "range": range,
    "slice": slice,
    "path": Path,
    "offset": Offset,
}
Name = Callable[[type], str]


def write_values(
    stream: IO[bytes],
    values: Sequence[Any],
    name_of: Name = lambda kind: kind.__name__,
    left_out: Collection[str] = (),
    most: float = np.inf,
) -> bool:
    """Write values; returns False, and writes nothing, where their arrays have more than ``most`` bytes.

    name_of : what a record is called. left_out : fields of records that are not kept.

    Raises
    ------
    TypeError : one holds what is none of these.
    """
    arrays: list[np.ndarray] = []
    tree = json.dumps([_packed(value, arrays, name_of, left_out) for value in values])
    if sum(array.nbytes for array in arrays) > most:
        return False
    named = {str(number): array for number, array in enumerate(arrays)}
    np.savez(stream, **{TREE: np.array(tree)}, **named)
    return True


def read_values(stream: IO[bytes], kind_of: Callable[[str], Callable[..., Any]]) -> list[Any]:
    """Read what ``write_values`` wrote. kind_of : what makes a record of a name, by its fields.

    Raises
    ------
    ValueError, KeyError, TypeError : it is no such file, or of another version.
    """
    with np.load(stream, allow_pickle=False) as arrays:
        return [_unpacked(value, arrays, kind_of) for value in json.loads(str(arrays[TREE]))]


def _packed(value: Any, arrays: list[np.ndarray], name_of: Name, left_out: Collection[str]) -> Any:
    """A value as JSON; a list says first what it stands for."""

    def inner(part: Any) -> Any:
        return _packed(part, arrays, name_of, left_out)

    match value:
        case np.ndarray() | np.generic():
            arrays.append(np.asarray(value))
            return ["array" if isinstance(value, np.ndarray) else "number", len(arrays) - 1]
        case None | bool() | int() | float() | str():
            return value
        case Offset():
            return ["offset", list(value), value.crs]
        case dict():
            return ["dict", [[inner(part) for part in pair] for pair in value.items()]]
        case tuple() | list() | set() | frozenset():
            kind = next(name for name, kind in MANY.items() if isinstance(value, kind))
            return [kind, [inner(part) for part in value]]
        case complex():
            return ["complex", value.real, value.imag]
        case range() | slice():
            return [type(value).__name__, value.start, value.stop, value.step]
        case Path():
            return ["path", str(value)]
        case functools.partial():  # work that was left until somebody asks: done now
            return ["later", inner(value())]
    if not dataclasses.is_dataclass(value):
        raise TypeError(f"{type(value).__name__} is of no result")
    names = (f.name for f in dataclasses.fields(value) if f.init and f.name not in left_out)
    return ["record", name_of(type(value)), {name: inner(getattr(value, name)) for name in names}]


def _unpacked(value: Any, arrays: Any, kind_of: Callable[[str], Callable[..., Any]]) -> Any:
    """The value that was packed."""
    if not isinstance(value, list):
        return value

    def inner(part: Any) -> Any:
        return _unpacked(part, arrays, kind_of)

    kind, *rest = value
    match kind:
        case "array":
            return arrays[str(rest[0])]
        case "number":
            return arrays[str(rest[0])][()]
        case "record":
            name, said = rest
            return kind_of(name)(**{key: inner(part) for key, part in said.items()})
        case "dict":
            return {inner(key): inner(part) for key, part in rest[0]}
        case "later":
            return functools.partial(_as_kept, inner(rest[0]))
    return MANY[kind](map(inner, rest[0])) if kind in MANY else MADE[kind](*rest)


def _as_kept(value: Any) -> Any:
    return value
