"""The ground that trees stand on: flat, a heightmap, or a triangulated surface.

A ``GroundSurface`` gives the height and the gradient of its topmost surface at any place, exactly (bilinear
on a heightmap, barycentric on triangles), NaN where there is none, and true bounds over cells, which limits
of slope and altitude need. Trunks stay vertical; ``sink`` says how deep one has to go so that no gap shows
below its downhill side.

Rough ground has bumps and hollows of a few decimetres to metres on whatever the ground is otherwise.
Heights are a sum of cosine waves of 0.6 to 4.8 m in all directions, each octave with the amplitude that its
length has in a surface of Hurst exponent 0.7, of which the standard deviation is a quarter of the
roughness: what lies within two of them is 95 % of the ground. Beyond the field it fades, so that its edge
is level.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...base.rng import stream
from ...spec import Forest, SpecError
from .surface import Grid, IntensityError, IntensitySurface

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
    """An image of heights with bilinear meaning; no ground beyond it, nor between four middles of pixels of
    which one is NaN."""

    def __init__(self, pixels: np.ndarray, low: np.ndarray, size: np.ndarray, name: str) -> None:
        """pixels : (rows, columns) metres, the first row the north edge.

        Raises
        ------
        IntensityError : a pixel is infinite; says which.
        """
        refuse_pixels(np.isinf(pixels), pixels, low, size, name, "a height")
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
        faces = np.concatenate([np.column_stack([a, b, d]), np.column_stack([a, d, c])])
        whole = ~np.isnan(vertices[np.concatenate([np.column_stack([a, b, c, d])] * 2), 2]).any(
            axis=1
        )
        used, faces = np.unique(faces[whole], return_inverse=True)
        return vertices[used], faces.reshape(-1, 3)


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


STEP, MOST = (
    0.2,
    600,
)  # metres between heights; heights along a side at most, then the step is larger
LONGEST, OCTAVES, WAVES = 4.8, 4, 16
HURST = 0.7
BEYOND, FADE = 6.0, 4.0  # metres beyond the field that are rough, the last of them ever less


def roughened(ground: GroundSurface, forest: Forest, roughness: float, seed: int) -> GroundSurface:
    """The ground with bumps; of 0, as it is.

    roughness : metres between the lower and the higher ground, four standard deviations.

    Raises
    ------
    SpecError : the ground is a surface of triangles.
    """
    if roughness <= 0:
        return ground
    if isinstance(ground, Heightmap):
        low, high = ground.grid.low, ground.grid.high
    elif isinstance(ground, Flat):
        beyond = min(BEYOND, forest.margin)
        low = np.array(forest.origin, dtype=float) - beyond
        high = np.array(forest.origin, dtype=float) + np.array(forest.size) + beyond
    else:
        raise SpecError(
            "forest.terrain.roughness",
            "needs level ground or a heightmap; model the roughness of a surface in its triangles, or give 0",
        )
    span = high - low
    count = np.clip(np.ceil(span / STEP).astype(int), 2, MOST)
    x, y = (low[k] + (np.arange(count[k]) + 0.5) * span[k] / count[k] for k in range(2))
    y = y[::-1]
    place = np.column_stack([np.tile(x, len(y)), np.repeat(y, len(x))])
    base = ground.height(place).reshape(len(y), len(x))
    bumps = _bumps(x, y, seed)
    inner_low, inner_high = np.array(forest.origin), np.array(forest.origin) + np.array(forest.size)
    fade = np.ones_like(bumps)
    for axis, along in ((1, x), (0, y)):
        k = 1 - axis
        away = np.maximum(np.maximum(inner_low[k] - along, along - inner_high[k]), 0)
        fall = np.clip(1 - away / FADE, 0, 1)
        fade *= fall[None, :] if axis == 1 else fall[:, None]
    heights = base + roughness / 4 * bumps * fade
    return Heightmap(heights, low, span, "rough ground")


def _bumps(x: np.ndarray, y: np.ndarray, seed: int) -> np.ndarray:
    """(Y, X) heights of standard deviation 1 at places x (X,) and y (Y,)."""
    rng = stream(seed, "rough ground")
    total = np.zeros((len(y), len(x)))
    for octave in range(OCTAVES):
        length = LONGEST / 2**octave
        turn, phase = 2 * np.pi * rng.random((2, WAVES))
        wide = length * (0.7 + 0.6 * rng.random(WAVES))
        for a, p, w in zip(turn, phase, wide, strict=True):
            kx, ky = 2 * np.pi / w * np.cos(a), 2 * np.pi / w * np.sin(a)
            wave = np.exp(1j * (kx * x + p))[None, :] * np.exp(1j * ky * y)[:, None]
            total += (0.5**octave) ** HURST * wave.real
    power = sum(0.5 ** (2 * HURST * octave) for octave in range(OCTAVES)) * WAVES / 2
    return np.asarray(total / np.sqrt(power))
