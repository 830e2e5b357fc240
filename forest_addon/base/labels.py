"""Labels of points: a number for each point, a name for each number, and scales of colours for measures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

UNKNOWN = -1
# Scales, linear colours evenly apart from the smallest value to the largest: of distances and heights, and of
# levels of sound. On the screen they are matplotlib's viridis and inferno.
MEASURES = ((0.09, 0.0, 0.16), (0.03, 0.20, 0.29), (0.02, 0.45, 0.25), (0.98, 0.80, 0.02))
LEVELS = (
    (0.005, 0.002, 0.03),
    (0.09, 0.005, 0.15),
    (0.50, 0.04, 0.09),
    (0.94, 0.27, 0.003),
    (0.97, 0.98, 0.37),
)


@dataclass(frozen=True)
class Labels:
    """number : (P,) int32, ``UNKNOWN`` where there is none. names : of the numbers from 0 on."""

    number: np.ndarray
    names: tuple[str, ...]

    def words(self) -> list[str]:
        """The name of each point; empty where it has none."""
        named = np.array([*self.names, ""], dtype=object)
        return named[self.number].tolist()
