"""Rows that stand together by owner, and copies of the rows of many owners at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Runs:
    """Rows that stand together: the first row (N,) of each owner and how many it has (N,)."""

    first: np.ndarray
    size: np.ndarray

    @classmethod
    def of(cls, owner: np.ndarray, count: int) -> Runs:
        """The runs of an ascending ``owner``, 0 .. count - 1, of each row."""
        first = np.searchsorted(owner, np.arange(count + 1))
        return cls(first[:-1], np.diff(first))

    @classmethod
    def at(cls, first: np.ndarray) -> Runs:
        """The runs that begin at ``first`` (N + 1,), whose last is the number of rows."""
        return cls(first[:-1], np.diff(first))

    def copy(self, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows of each wanted owner; which wanted one each row is for; how far each one has moved."""
        size = self.size[wanted]
        moved = np.cumsum(size) - size - self.first[wanted]
        which = np.repeat(np.arange(len(wanted)), size)
        return np.arange(len(which)) - moved[which], which, moved


def bounds(size: np.ndarray) -> np.ndarray:
    """(N + 1,) the first row of owners with so many rows each, one after the other, and the end."""
    return np.concatenate([[0], np.cumsum(size)]).astype(np.int64)


def numbered(size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(M,) the owner of each row, of owners with so many rows each (N,), and (M,) its number among them."""
    owner = np.repeat(np.arange(len(size)), size)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(size) - size, size)


def sums(owner: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """(count, K) sums over the rows (N, K) of each owner (N,)."""
    return np.stack([np.bincount(owner, column, count) for column in values.T], axis=1)


def along_lines(point: np.ndarray, first: np.ndarray) -> np.ndarray:
    """(N,) how far along its polyline each point (N, 3) is. first : (C + 1,) where lines begin, and N."""
    step = np.linalg.norm(np.diff(point, axis=0, prepend=point[:1]), axis=1)
    step[first[:-1]] = 0.0
    total = np.cumsum(step)
    return np.asarray(total - np.repeat(total[first[:-1]], np.diff(first)))


def firsts(ranked: np.ndarray, owner: np.ndarray) -> np.ndarray:
    """The first row of each owner, of rows ranked so that those of an owner (N,) stand together."""
    return ranked[np.diff(owner[ranked], prepend=-1) > 0]
