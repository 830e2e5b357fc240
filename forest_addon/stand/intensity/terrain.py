"""The ground that trees stand on: flat, a heightmap, or a triangulated surface.

A ``GroundSurface`` gives the height and the gradient of its topmost surface at any place, exactly
(bilinear on a heightmap, barycentric on triangles), NaN where there is none, and true bounds over cells,
which limits of slope and altitude need. Trunks stay vertical; ``sink`` says how deep one has to go so that
no gap shows below its downhill side.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .functions import IntensityError
from .grid import Grid
from .surface import IntensitySurface

RING = 24  # places around a trunk's foot where the ground is looked up
DEEPEST = 4.0  # foot radii that a tree is sunk at most (a foot over a cliff)


class GroundSurface(Protocol):
    """A height field."""

    def height(self, points: np.ndarray) -> np.ndarray:
        """(N,) height at points (N, 2), metres; NaN where there is no ground."""

    def gradient(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) derivatives of the height along x and y; NaN where there is no ground."""

    def height_bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """True bounds (C,) of the height over cells (C, 2); -inf and inf where unknown."""

    def steepness_bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """True bounds (C,) of |gradient| over cells (C, 2)."""

    def triangles(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Vertices (V, 3) and triangles (T, 3) to show it by, None where it is flat."""


def normals(terrain: GroundSurface, points: np.ndarray) -> np.ndarray:
    """(N, 3) unit normals of the ground, up."""
    gradient = terrain.gradient(points)
    up = np.column_stack([-gradient, np.ones(len(points))])
    return np.asarray(up / np.linalg.norm(up, axis=1, keepdims=True))


def slope(terrain: GroundSurface, points: np.ndarray) -> np.ndarray:
    """(N,) angle between the ground and the horizontal, radians."""
    return np.asarray(np.arctan(np.linalg.norm(terrain.gradient(points), axis=1)))


def sink(terrain: GroundSurface, points: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """(N,) how far a trunk of this foot radius goes below the ground at its axis, metres.

    The lowest ground on a ring around the foot decides. The ring has ``RING`` corners and stands outside
    the foot, so on a plane no gap is left in any direction; places without ground do not count, and a
    foot that reaches over a cliff is sunk by ``DEEPEST`` radii at most.
    """
    if isinstance(terrain, Flat):
        return np.zeros(len(points))
    middle = terrain.height(points)
    lowest = middle.copy()
    for angle in 2 * np.pi * np.arange(RING) / RING:
        reach = radius[:, None] / np.cos(np.pi / RING) * [np.cos(angle), np.sin(angle)]
        lowest = np.fmin(lowest, terrain.height(points + reach))
    return np.asarray(np.minimum(middle - lowest, DEEPEST * radius))


@dataclass(frozen=True)
class Flat:
    """Level ground."""

    base: float = 0.0

    def height(self, points: np.ndarray) -> np.ndarray:
        return np.full(len(points), self.base)

    def gradient(self, points: np.ndarray) -> np.ndarray:
        return np.zeros((len(points), 2))

    def height_bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        same = np.full(len(low), self.base)
        return same, same

    def steepness_bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros(len(low)), np.zeros(len(low))

    def triangles(self) -> None:
        return None


class Heightmap:
    """An image of heights with bilinear meaning; no ground beyond it."""

    def __init__(self, pixels: np.ndarray, low: np.ndarray, size: np.ndarray, name: str) -> None:
        """pixels : (rows, columns) metres, the first row the north edge.

        Raises
        ------
        IntensityError : a pixel is not finite; says which.
        """
        refuse_pixels(~np.isfinite(pixels), pixels, low, size, name, "a height")
        self.grid = Grid.of_image(pixels, low, size)
        self._heights, self._steepness = self.grid.value_ranges(), self.grid.steepness_ranges()

    def height(self, points: np.ndarray) -> np.ndarray:
        return np.where(self.grid.inside(points), self.grid.at(points), np.nan)

    def gradient(self, points: np.ndarray) -> np.ndarray:
        inside = self.grid.inside(points)[:, None]
        return np.where(inside, self.grid.gradient(points), np.nan)

    def height_bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self._heights.over(*self.grid.patches_of(low, high))

    def steepness_bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self._steepness.over(*self.grid.patches_of(low, high))

    def triangles(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners at pixel centres and along the edge; two triangles a patch.

        On the diagonal of a patch they differ from the bilinear surface by a quarter of its twist at most.
        """
        grid = self.grid
        rows, columns = grid.nodes.shape
        x, y = (
            np.clip(grid.low[k] + (np.arange(n) - 0.5) * grid.step[k], grid.low[k], grid.high[k])
            for k, n in ((0, columns), (1, rows))
        )
        vertices = np.column_stack([np.tile(x, rows), np.repeat(y, columns), grid.nodes.ravel()])
        first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
        a, b, c, d = first, first + 1, first + columns, first + columns + 1
        return vertices, np.concatenate([np.column_stack([a, b, d]), np.column_stack([a, d, c])])


class Triangulated:
    """The topmost surface of a triangle mesh; overhangs hide what is below, holes are no ground."""

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray) -> None:
        """vertices : (V, 3) metres. triangles : (T, 3)."""
        self.surface = IntensitySurface(vertices, triangles)
        heights = self.surface.vertices[:, 2]
        self._gradient = self.surface.gradients(heights)
        corners = heights[self.surface.triangles]
        steepness = np.linalg.norm(self._gradient, axis=1)
        self._heights = self.surface.ranges(corners.min(axis=1), corners.max(axis=1))
        self._steepness = self.surface.ranges(steepness, steepness)

    def height(self, points: np.ndarray) -> np.ndarray:
        return self.surface.locate(points)[1]

    def gradient(self, points: np.ndarray) -> np.ndarray:
        triangle, _ = self.surface.locate(points)
        return np.where(triangle[:, None] >= 0, self._gradient[triangle], np.nan)

    def height_bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self._heights.over(*self.surface.bins_of(low, high))

    def steepness_bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self._steepness.over(*self.surface.bins_of(low, high))

    def triangles(self) -> tuple[np.ndarray, np.ndarray]:
        return self.surface.vertices, self.surface.triangles


def refuse_pixels(
    bad: np.ndarray, pixels: np.ndarray, low: np.ndarray, size: np.ndarray, name: str, what: str
) -> None:
    """Raise an ``IntensityError`` that says where the first bad pixel is."""
    if not bad.any():
        return
    row, column = np.unravel_index(int(np.argmax(bad)), bad.shape)
    x = low[0] + (column + 0.5) * size[0] / bad.shape[1]
    y = low[1] + (bad.shape[0] - row - 0.5) * size[1] / bad.shape[0]
    raise IntensityError(
        f"{name}: the pixel in row {row}, column {column} (x = {x:g}, y = {y:g}) is "
        f"{pixels[row, column]:g}, which is not {what}; mend the file "
        f"({int(bad.sum()):,} of {bad.size:,} pixels are like that)"
    )
