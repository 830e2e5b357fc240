"""Values kept for the next time they are asked for, so many at most."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")


class LastAsked(Generic[K, V]):
    """The values last asked for, by their keys.

    limit : how many; of more, the one that was asked for longest ago is dropped, and made anew if need be.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._values: OrderedDict[K, V] = OrderedDict()

    def __len__(self) -> int:
        return len(self._values)

    def once(self, key: K, make: Callable[[], V]) -> V:
        """Return the value of ``key``, made where it is not kept."""
        if key in self._values:
            self._values.move_to_end(key)
            return self._values[key]
        value = self._values[key] = make()
        while len(self._values) > self.limit:
            self._values.popitem(last=False)
        return value
