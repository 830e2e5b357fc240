"""Values kept for the next time they are asked for, so many or so large at most."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

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
