"""Surfaces over the ground plan: images with bilinear meaning, triangle meshes seen from above, ranges.

**Grid**: A pixel's value counts at its centre; between four centres the surface is bilinear, over the outer
half pixels constant. Rows are kept from south to north, with one more node on every side that repeats the
edge, so every place of the image lies in a patch between four nodes.

**Mesh**: Triangles are projected to the ground plan and sorted into a grid of bins; a point asks the
triangles of its bin, by signed areas in float64, and takes the highest of those that hold it. Triangles on
edge have no area from above and are never met.

**Pyramid** of ranges: Every level halves the one below, so a rectangle of any size is covered by at most
three blocks along each axis of the level whose blocks are half its extent or more. What is found is a true
bound; it is exact for rectangles of up to two cells, because those are looked up themselves.

The ground that trees stand on: flat, a heightmap, or a triangulated surface.

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
from ...base.runs import numbered
from ...spec import Forest, SpecError


class IntensityError(SpecError):
    """An intensity that cannot be used: one sentence with what, where and what to do."""

    def __init__(self, sentence: str) -> None:
        super().__init__("", sentence)


class Pyramid:
    """Ranges of a grid of cells (rows, columns), each with its own smallest and largest value; NaN of those
    without any."""

    def __init__(self, lowest: np.ndarray, highest: np.ndarray) -> None:
        lows, highs = [lowest], [highest]
        while max(lows[-1].shape) > 1:
            lows.append(_halve(lows[-1], np.fmin, np.inf))
            highs.append(_halve(highs[-1], np.fmax, -np.inf))
        sizes = np.array([level.size for level in lows])
        self._offset = np.cumsum(sizes) - sizes
        self._width = np.array([level.shape[1] for level in lows])
        self._low = np.concatenate([level.ravel() for level in lows])
        self._high = np.concatenate([level.ravel() for level in highs])

    def over(self, first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(C,) smallest and largest over the cells from ``first`` to ``last``, both included.

        first, last : (C, 2) int64, row and column.
        """
        extent = (last - first + 1).max(axis=1)
        level = np.ceil(np.log2(np.maximum(extent, 2) / 2)).astype(np.int64)
        start, end = first >> level[:, None], last >> level[:, None]
        middle = (start + end) >> 1
        low, high = np.full(len(first), np.inf), np.full(len(first), -np.inf)
        offset, width = self._offset[level], self._width[level]
        for row in (start[:, 0], middle[:, 0], end[:, 0]):
            for column in (start[:, 1], middle[:, 1], end[:, 1]):
                place = offset + row * width + column
                np.fmin(low, self._low[place], out=low)
                np.fmax(high, self._high[place], out=high)
        return low, high


def _halve(level: np.ndarray, pick: np.ufunc, nothing: float) -> np.ndarray:
    rows, columns = level.shape
    even = np.pad(level, ((0, rows % 2), (0, columns % 2)), constant_values=nothing)
    across = pick(even[:, ::2], even[:, 1::2])
    return np.asarray(pick(across[::2], across[1::2]))


@dataclass(frozen=True)
class Grid:
    """nodes : (rows + 2, columns + 2), south first, edges repeated. low, high : (2,) corners, metres."""

    nodes: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def of_image(cls, pixels: np.ndarray, low: np.ndarray, size: np.ndarray) -> Grid:
        """The grid of an image (rows, columns), its first row the north edge."""
        nodes = np.pad(np.asarray(pixels, dtype=np.float64)[::-1], 1, mode="edge")
        low = np.asarray(low, dtype=np.float64)
        return cls(nodes, low, low + np.asarray(size, dtype=np.float64))

    @property
    def step(self) -> np.ndarray:
        """(2,) size of a pixel along x and y."""
        rows, columns = self.nodes.shape
        return (self.high - self.low) / np.array([columns - 2, rows - 2])

    def inside(self, points: np.ndarray) -> np.ndarray:
        """(N,) bool, whether points (N, 2) lie on the image, its edge included."""
        return np.asarray(((points >= self.low) & (points <= self.high)).all(axis=1))

    def at(self, points: np.ndarray) -> np.ndarray:
        """(N,) values at points (N, 2); beyond the image those of its edge."""
        corner, part = self._locate(points)
        a, b, c, d = self._corners(corner)
        south, north = a + (b - a) * part[:, 0], c + (d - c) * part[:, 0]
        return np.asarray(south + (north - south) * part[:, 1])

    def gradient(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) exact derivatives along x and y."""
        corner, part = self._locate(points)
        a, b, c, d = self._corners(corner)
        along_x = (b - a) + ((d - c) - (b - a)) * part[:, 1]
        along_y = (c - a) + ((d - b) - (c - a)) * part[:, 0]
        return np.column_stack([along_x, along_y]) / self.step

    def integral(self, low: np.ndarray, high: np.ndarray) -> float:
        """∫ over a rectangle within the image, closed: each node weighs by its hat function."""
        low, high = np.maximum(low, self.low), np.minimum(high, self.high)
        if (high <= low).any():
            return 0.0
        rows, columns = self.nodes.shape
        (x0, y0), (x1, y1) = self._in_nodes(np.array([low, high]))
        x, y = _hat_integrals(x0, x1, columns), _hat_integrals(y0, y1, rows)
        return float(y @ self.nodes @ x * np.prod(self.step))

    def value_ranges(self) -> Pyramid:
        """Smallest and largest value of every patch."""
        corners = self._patches(self.nodes)
        return Pyramid(np.minimum.reduce(corners), np.maximum.reduce(corners))

    def steepness_ranges(self) -> Pyramid:
        """Smallest and largest |gradient| of every patch, exact: its x part depends on y alone, its y
        part on x alone.
        """
        a, b, c, d = self._patches(self.nodes)
        x, y = np.stack([b - a, d - c]) / self.step[0], np.stack([c - a, d - b]) / self.step[1]
        most = np.hypot(np.abs(x).max(axis=0), np.abs(y).max(axis=0))
        least = np.hypot(
            *(np.where(np.ptp(np.sign(k), axis=0) < 2, np.abs(k).min(axis=0), 0.0) for k in (x, y))
        )
        return Pyramid(least, most)

    def patches_of(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First and last patch, (C, 2) rows and columns, that cells (C, 2) reach."""
        return self._locate(low)[0][:, ::-1], self._locate(high)[0][:, ::-1]

    def exact_range(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest value over cells (C, 2) that reach at most two patches along each axis.

        Bilinear, so the extremes lie where the cell's edges and the lines between patches cross.
        """
        line = self.low + (self._locate(high)[0] - 0.5) * self.step
        middle = np.clip(line, low, high)
        least, most = np.full(len(low), np.inf), np.full(len(low), -np.inf)
        for x in (low[:, 0], middle[:, 0], high[:, 0]):
            for y in (low[:, 1], middle[:, 1], high[:, 1]):
                value = self.at(np.column_stack([x, y]))
                np.minimum(least, value, out=least)
                np.maximum(most, value, out=most)
        return least, most

    def _in_nodes(self, points: np.ndarray) -> np.ndarray:
        counts = np.array(self.nodes.shape[::-1])
        return np.clip((points - self.low) / self.step + 0.5, 0.5, counts - 1.5)

    def _locate(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """South-west node (N, 2) int64 as column and row, and where in its patch, 0 to 1."""
        place = self._in_nodes(points)
        corner = place.astype(np.int64)
        return corner, place - corner

    def _corners(self, corner: np.ndarray) -> tuple[np.ndarray, ...]:
        width = self.nodes.shape[1]
        flat, first = self.nodes.ravel(), corner[:, 1] * width + corner[:, 0]
        return flat[first], flat[first + 1], flat[first + width], flat[first + width + 1]

    @staticmethod
    def _patches(nodes: np.ndarray) -> tuple[np.ndarray, ...]:
        return nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, :-1], nodes[1:, 1:]


def _hat_integrals(low: float, high: float, count: int) -> np.ndarray:
    """(count,) ∫ of the hat function of each node from ``low`` to ``high``, in node spacings."""

    def up_to(x: float) -> np.ndarray:
        t = np.clip(x - np.arange(count), -1, 1)
        return np.where(t < 0, (t + 1) ** 2 / 2, 1 - (1 - t) ** 2 / 2)

    return up_to(high) - up_to(low)


PER_BIN = 2.0  # triangles a bin holds on average, as far as sizes allow
CHUNK = 1 << 18
EDGE = 1e-12  # share of a triangle's area that a point may lie outside: neighbours share their edge


class IntensitySurface:
    """vertices : (V, 3) float64, metres. triangles : (T, 3) int64, those with an area from above."""

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray) -> None:
        """Raises ValueError where no triangle has an area from above, or a vertex is not finite."""
        self.vertices = np.asarray(vertices, dtype=np.float64).reshape(-1, 3)
        self.triangles = np.asarray(triangles, dtype=np.int64).reshape(-1, 3)
        if not np.isfinite(self.vertices).all():
            raise ValueError("a vertex of the surface is not finite; mend the mesh")
        corners = self.vertices[self.triangles]
        self._first = corners[:, 0, :2]
        self._sides = corners[:, 1:, :2] - corners[:, :1, :2]  # (T, 2, 2)
        self.area = _cross(self._sides[:, 0], self._sides[:, 1]) / 2  # signed, from above
        self._seen = self.area != 0
        if not self._seen.any():
            raise ValueError("the surface has no area from above; give one that lies flat")
        self.low, self.high = (
            corners[self._seen, :, :2].min(axis=(0, 1)),
            corners[self._seen, :, :2].max(axis=(0, 1)),
        )
        self._fill_bins(corners[:, :, :2])

    def locate(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Topmost triangle (N,) at points (N, 2), -1 where there is none, and its height (N,), NaN."""
        triangle, height = np.full(len(points), -1), np.full(len(points), np.nan)
        for start in range(0, len(points), CHUNK):
            part = slice(start, start + CHUNK)
            triangle[part], height[part] = self._locate(points[part])
        return triangle, height

    def weights(self, points: np.ndarray, triangle: np.ndarray) -> np.ndarray:
        """(N, 3) barycentric coordinates of points in their triangles."""
        offset, sides = points - self._first[triangle], self._sides[triangle]
        double = 2 * self.area[triangle]
        b = _cross(offset, sides[:, 1]) / double
        c = _cross(sides[:, 0], offset) / double
        return np.column_stack([1 - b - c, b, c])

    def interpolate(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """(N,) values (V,) of the vertices, linear over the topmost triangles; NaN off the surface."""
        triangle, _ = self.locate(points)
        interpolated = (self.weights(points, triangle) * values[self.triangles[triangle]]).sum(
            axis=1
        )
        return np.where(triangle >= 0, interpolated, np.nan)

    def gradients(self, values: np.ndarray) -> np.ndarray:
        """(T, 2) derivatives along x and y of values (V,) over each triangle; 0 for those on edge."""
        corner = values[self.triangles]
        rise = corner[:, 1:] - corner[:, :1]
        (ax, ay), (bx, by) = self._sides[:, 0].T, self._sides[:, 1].T
        double = np.where(self._seen, 2 * self.area, np.inf)
        return np.column_stack(
            [
                (rise[:, 0] * by - rise[:, 1] * ay) / double,
                (rise[:, 1] * ax - rise[:, 0] * bx) / double,
            ]
        )

    def ranges(self, least: np.ndarray, most: np.ndarray) -> Pyramid:
        """Range over bins of what lies between ``least`` and ``most`` (T,) on each triangle."""
        low, high = np.full(self._count, np.inf), np.full(self._count, -np.inf)
        bins = np.repeat(np.arange(self._count), np.diff(self._start))
        np.minimum.at(low, bins, least[self._members])
        np.maximum.at(high, bins, most[self._members])
        return Pyramid(low.reshape(self._shape), high.reshape(self._shape))

    def bins_of(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First and last bin, (C, 2) rows and columns, of cells (C, 2)."""
        return self._bin(low)[:, ::-1], self._bin(high)[:, ::-1]

    def _fill_bins(self, corners: np.ndarray) -> None:
        span = np.maximum(self.high - self.low, 1e-9)
        wanted = max(1.0, len(self.triangles) / PER_BIN)
        columns = int(np.clip(np.sqrt(wanted * span[0] / span[1]), 1, 2048))
        rows = int(np.clip(wanted / columns, 1, 2048))
        self._shape, self._count = (rows, columns), rows * columns
        self._size = span / np.array([columns, rows])
        seen = np.flatnonzero(self._seen)
        first, last = self._bin(corners[seen].min(axis=1)), self._bin(corners[seen].max(axis=1))
        extent = last - first + 1
        owner, number = numbered(extent.prod(axis=1))
        column = first[owner, 0] + number % extent[owner, 0]
        row = first[owner, 1] + number // extent[owner, 0]
        place = row * columns + column
        order = np.argsort(place, kind="stable")
        self._members = seen[owner[order]]
        self._start = np.searchsorted(place[order], np.arange(self._count + 1))

    def _bin(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) column and row of the bin of each point; the nearest for those beyond."""
        last = np.array(self._shape[::-1]) - 1
        return np.clip(np.floor((points - self.low) / self._size), 0, last).astype(np.int64)

    def _locate(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        column, row = self._bin(points).T
        home = row * self._shape[1] + column
        owner, step = numbered(self._start[home + 1] - self._start[home])
        candidate = self._members[self._start[home][owner] + step]
        weights = self.weights(points[owner], candidate)
        holds = (weights >= -EDGE).all(axis=1)
        owner, candidate, weights = owner[holds], candidate[holds], weights[holds]
        corner = self.vertices[self.triangles[candidate], 2]
        rise = corner[:, 1:] - corner[:, :1]  # from the first corner: level ground stays level
        height = corner[:, 0] + (weights[:, 1:] * rise).sum(axis=1)
        order = np.lexsort((height, owner))
        owner, candidate, height = owner[order], candidate[order], height[order]
        last = np.append(owner[1:] != owner[:-1], True) if len(owner) else np.zeros(0, dtype=bool)
        triangle, top = np.full(len(points), -1), np.full(len(points), np.nan)
        triangle[owner[last]], top[owner[last]] = candidate[last], height[last]
        return triangle, top


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


RING = 24  # places around a trunk's foot where the ground is looked up
DEEPEST = 4.0  # foot radii that a tree is sunk at most (a foot over a cliff)


Bounds = tuple[np.ndarray, np.ndarray]  # the lower and the upper, (C,) each


class GroundSurface(Protocol):
    """A height field."""

    def height(self, points: np.ndarray) -> np.ndarray:
        """(N,) height at points (N, 2), metres; NaN where there is no ground."""

    def gradient(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) derivatives of the height along x and y; NaN where there is no ground."""

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[Bounds, Bounds]:
        """True bounds (C,) of the height, -inf and inf where unknown, and of |gradient| over cells (C, 2)."""

    def triangles(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Vertices (V, 3) and triangles (T, 3) to show it by, None where it is flat."""


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

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[Bounds, Bounds]:
        same, level = np.full(len(low), self.base), np.zeros(len(low))
        return (same, same), (level, level)

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

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[Bounds, Bounds]:
        patches = self.grid.patches_of(low, high)
        return self._heights.over(*patches), self._steepness.over(*patches)

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

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[Bounds, Bounds]:
        bins = self.surface.bins_of(low, high)
        return self._heights.over(*bins), self._steepness.over(*bins)

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
    across, along = (
        np.clip(1 - np.maximum(np.maximum(inner_low[k] - at, at - inner_high[k]), 0) / FADE, 0, 1)
        for k, at in enumerate((x, y))
    )
    heights = base + roughness / 4 * bumps * (across * along[:, None])
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
