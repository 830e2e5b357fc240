"""Tables of arrays of one length: some rows of all columns, and several tables one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np


class RowTable:
    """Base of dataclasses whose fields are arrays with a row each, or tables of as many rows; what is
    neither belongs to the whole table."""

    __match_args__: ClassVar[tuple[str, ...]]  # names of the fields

    def __len__(self) -> int:
        return len(getattr(self, self.__match_args__[0]))

    def select(self, rows: np.ndarray | slice) -> Self:
        """Rows of every column, by number, mask or slice."""
        if isinstance(rows, np.ndarray) and rows.dtype == bool:
            rows = np.flatnonzero(rows)
        kept = {}
        for name in self.__match_args__:
            value = getattr(self, name)
            if isinstance(value, np.ndarray):
                # Taken in half the time of indexing.
                value = value[rows] if isinstance(rows, slice) else value.take(rows, 0)
            elif isinstance(value, RowTable):
                value = value.select(rows)
            kept[name] = value
        return type(self)(**kept)

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Several tables, one or more, one after the other; what is no column is that of the first."""
        if len(parts) == 1:
            return parts[0]
        columns = {}
        for name in cls.__match_args__:
            value = getattr(parts[0], name)
            if isinstance(value, np.ndarray):
                value = np.concatenate([getattr(part, name) for part in parts])
            elif isinstance(value, RowTable):
                value = type(value).joined([getattr(part, name) for part in parts])
            columns[name] = value
        return cls(**columns)


AT_ONCE = 1_000_000


def blocks(count: int) -> Iterator[slice]:
    """Rows of a long table, about a million at a time."""
    for first in range(0, count, AT_ONCE):
        yield slice(first, min(first + AT_ONCE, count))


@dataclass(frozen=True)
class Drawn:
    """A column that is not kept: its rows are made when they are asked for.

    count : of its rows. make : gives those of row numbers (M,), ascending.
    """

    count: int
    make: Callable[[np.ndarray], np.ndarray]

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, rows: np.ndarray | slice) -> np.ndarray:
        if isinstance(rows, slice):
            rows = np.arange(*rows.indices(self.count))
        return self.make(np.flatnonzero(rows) if rows.dtype == bool else rows)


def slots(group: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(M,) place of each thing where those of a group stand side by side, in order.

    free : (G,) the first free place of each group; moved on.
    """
    order, count = np.argsort(group, kind="stable"), np.bincount(group, minlength=len(free))
    place = np.empty(len(group), dtype=np.int64)
    place[order] = np.arange(len(group)) + np.repeat(free - (np.cumsum(count) - count), count)
    free += count
    return place


def lengths(vectors: np.ndarray) -> np.ndarray:
    """(M,) lengths of vectors (M, 3), faster than by numpy's norm along an axis."""
    return np.sqrt(np.einsum("mi,mi->m", vectors, vectors))


def distinct(values: np.ndarray) -> np.ndarray:
    """(U,) different values of an array, ascending: as ``np.unique``, which hashes them in ten times the
    time of a sort."""
    ordered = np.sort(values, axis=None)
    first = np.ones(len(ordered), dtype=bool)
    np.not_equal(ordered[1:], ordered[:-1], out=first[1:])
    return ordered[first]
