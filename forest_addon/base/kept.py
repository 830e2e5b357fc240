"""Values kept for the next time they are asked for, so many or so large at most, and digests by which what is
made of the same is known again."""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable
from hashlib import blake2b
from typing import Any, Generic, TypeVar

import numpy as np

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")


class LastAsked(Generic[K, V]):
    """The values last asked for, by their keys.

    limit : how many, or how large in all by ``size_of``; of more, those that were asked for longest ago are
    dropped, but for the last, and made anew if need be.
    """

    def __init__(self, limit: int, size_of: Callable[[V], int] = lambda _: 1) -> None:
        self.limit, self._size_of = limit, size_of
        self._values: OrderedDict[K, V] = OrderedDict()
        self._size = 0

    def __len__(self) -> int:
        return len(self._values)

    def once(self, key: K, make: Callable[[], V]) -> V:
        """Return the value of ``key``, made where it is not kept."""
        if key in self._values:
            self._values.move_to_end(key)
            return self._values[key]
        value = self._values[key] = make()
        self._size += self._size_of(value)
        while self._size > self.limit and len(self._values) > 1:
            self._size -= self._size_of(self._values.popitem(last=False)[1])
        return value


def digest(parts: Iterable[Any]) -> str:
    """Hexadecimal BLAKE2b of parts, one after the other: bytes and arrays as they are, all else as JSON, with
    arrays whole and what JSON has no word for as text."""
    total = blake2b(digest_size=16)
    for part in parts:
        if isinstance(part, np.ndarray):
            part = np.ascontiguousarray(part)
        elif not isinstance(part, bytes):
            part = json.dumps(
                part,
                sort_keys=True,
                default=lambda value: value.tolist() if hasattr(value, "tolist") else str(value),
            ).encode()
        total.update(part)
    return total.hexdigest()
