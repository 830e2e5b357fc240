"""Labels of points: a number for each point, and a name for each number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

UNKNOWN = -1


@dataclass(frozen=True)
class Labels:
    """number : (P,) int32, ``UNKNOWN`` where there is none. names : of the numbers from 0 on."""

    number: np.ndarray
    names: tuple[str, ...]

    def words(self) -> list[str]:
        """The name of each point; empty where it has none."""
        named = np.array([*self.names, ""], dtype=object)
        found: list[str] = named[self.number].tolist()
        return found
