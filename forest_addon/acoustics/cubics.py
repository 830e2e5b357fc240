"""Complex functions of one variable as cubics over even cells, which take no time to look up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from . import chebyshev


@dataclass(frozen=True)
class Cubics:
    """A function from ``first`` on, in cells a ``step`` wide; table : (cells, 4) complex128, coefficients of
    a cubic in parts of each, lowest power first."""

    first: float
    step: float
    table: np.ndarray

    @classmethod
    def of(
        cls, function: Callable[[np.ndarray], np.ndarray], first: float, last: float, cells: int
    ) -> Cubics:
        """The cubics through a function's values at four Chebyshev points of each cell."""
        points, step = 0.5 + 0.5 * chebyshev.points(4), (last - first) / cells
        values = function(first + step * (np.arange(cells)[:, None] + points))
        powers = np.linalg.inv(np.vander(points, increasing=True))
        return cls(first, step, np.ascontiguousarray(values @ powers.T, np.complex128))

    @property
    def given(self) -> tuple[float, float, int, np.ndarray]:
        """Arguments of the kernels."""
        return self.first, self.step, len(self.table), self.table

    def at(self, x: np.ndarray) -> np.ndarray:
        """Values at places of any shape; beyond either end, that of the end."""
        place = np.clip((x - self.first) / self.step, 0.0, len(self.table))
        cell = np.minimum(np.nan_to_num(place).astype(np.int64), len(self.table) - 1)
        value: np.ndarray = np.polyval(np.moveaxis(self.table[cell], -1, 0)[::-1], place - cell)
        return value
