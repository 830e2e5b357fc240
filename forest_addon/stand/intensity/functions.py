"""Intensity functions: expected trees per square metre.

An ``Intensity`` knows its value at points, true bounds over cells (what exact thinning needs), and its
integral over a rectangle where that is closed. Hills are Tanveer et al.'s formula in its squared form, λ(x,
y) = Σ C·exp(-(x-a)²/h² - (y-b)²/l²). Masks are intensities of 0 and 1: a product of one with anything keeps
it within. Images, painted meshes, polygons and limits of the terrain are in modules of their own.

Cells of a quadtree have true bounds of an intensity and are small where it varies. The field is cut into
nearly square cells; a cell is quartered while the room between its bounds, times its area, is more than it
may be. Exact thinning and integration both stand on these cells.

Polygon windows: where trees may stand, with holes.

Corners are checked once (no zero area, no edge that crosses or touches another), then points are judged by
the even-odd rule: points in order of y, so that an edge asks those alone that lie between its ends. For
cells, edges are drawn into a grid of bins: bins without an edge are wholly in or out.

Intensities from what lies on the ground: images, painted meshes, and limits of the terrain.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from ...base.rows import RowTable
from ...base.runs import numbered
from .surface import Grid, GroundSurface, IntensityError, IntensitySurface, Pyramid, refuse_pixels


class Intensity(ABC):
    """Expected trees per square metre over the plane; never negative."""

    @abstractmethod
    def at(self, points: np.ndarray) -> np.ndarray:
        """λ (N,) at points (N, 2), metres."""

    @abstractmethod
    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """True lower and upper bounds (C,) of λ over the closed cells ``low`` to ``high`` (C, 2)."""

    def closed_integral(self, low: np.ndarray, high: np.ndarray) -> float | None:
        """∫λ over the rectangle ``low`` to ``high`` (2,) in closed form, None where there is none."""
        return None


@dataclass(frozen=True)
class Constant(Intensity):
    """The same everywhere."""

    value: float

    def at(self, points: np.ndarray) -> np.ndarray:
        return np.full(len(points), self.value)

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        same = np.full(len(low), self.value)
        return same, same

    def closed_integral(self, low: np.ndarray, high: np.ndarray) -> float:
        return self.value * float(np.prod(high - low))


@dataclass(frozen=True)
class Mixture(Intensity):
    """Gaussian hills. peak : (G,) trees/m². centre, width : (G, 2) metres; σ is width/√2."""

    peak: np.ndarray
    centre: np.ndarray
    width: np.ndarray

    def at(self, points: np.ndarray) -> np.ndarray:
        value = np.zeros(len(points))
        for peak, centre, width in zip(self.peak, self.centre, self.width, strict=True):
            value += peak * np.exp(-(((points - centre) / width) ** 2).sum(axis=1))
        return value

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        lower, upper = np.zeros(len(low)), np.zeros(len(low))
        for peak, centre, width in zip(self.peak, self.centre, self.width, strict=True):
            nearest = np.clip(centre, low, high)
            farthest = np.where(centre - low > high - centre, low, high)
            upper += peak * np.exp(-(((nearest - centre) / width) ** 2).sum(axis=1))
            lower += peak * np.exp(-(((farthest - centre) / width) ** 2).sum(axis=1))
        return lower, upper

    def closed_integral(self, low: np.ndarray, high: np.ndarray) -> float:
        a, b = (low - self.centre) / self.width, (high - self.centre) / self.width
        right, left = a > 0, b < 0  # in a tail by erfc, where erf has no digits left
        near, far = np.where(left, -b, a), np.where(left, -a, b)
        spans = np.where(
            right | left,
            scipy.special.erfc(near) - scipy.special.erfc(far),
            scipy.special.erf(b) - scipy.special.erf(a),
        )
        return float(self.peak @ np.prod(self.width * np.sqrt(np.pi) / 2 * spans, axis=1))

    def whole(self) -> np.ndarray:
        """(G,) ∫ of each hill over the plane, C·π·h·l."""
        return np.asarray(self.peak * np.pi * self.width.prod(axis=1))


@dataclass(frozen=True)
class Sum(Intensity):
    """Several intensities added."""

    parts: tuple[Intensity, ...]

    def at(self, points: np.ndarray) -> np.ndarray:
        return np.asarray(sum((part.at(points) for part in self.parts), np.zeros(len(points))))

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        lower, upper = np.zeros(len(low)), np.zeros(len(low))
        for part in self.parts:
            least, most = part.bounds(low, high)
            lower, upper = lower + least, upper + most
        return lower, upper

    def closed_integral(self, low: np.ndarray, high: np.ndarray) -> float | None:
        closed = [part.closed_integral(low, high) for part in self.parts]
        return None if None in closed else float(sum(c for c in closed if c is not None))


@dataclass(frozen=True)
class Product(Intensity):
    """Several intensities multiplied; a mask is a factor of 0 and 1."""

    parts: tuple[Intensity, ...]
    factor: float = field(default=1.0)

    def at(self, points: np.ndarray) -> np.ndarray:
        value = np.full(len(points), self.factor)
        for part in self.parts:
            value *= part.at(points)
        return value

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        lower, upper = np.full(len(low), self.factor), np.full(len(low), self.factor)
        for part in self.parts:
            least, most = part.bounds(low, high)
            lower, upper = lower * least, upper * most
        return lower, upper

    def closed_integral(self, low: np.ndarray, high: np.ndarray) -> float | None:
        """Closed where all factors but one are constant."""
        constants = [part.value for part in self.parts if isinstance(part, Constant)]
        others = [part for part in self.parts if not isinstance(part, Constant)]
        factor = self.factor * float(np.prod(constants))
        if len(others) > 1:
            return None
        closed = (others[0] if others else Constant(1.0)).closed_integral(low, high)
        return None if closed is None else factor * closed


class Mask(Intensity):
    """An intensity of 0 and 1: where trees may stand."""


MAX_CELLS = 1 << 22
MAX_ASPECT = 1024  # cells along the longer side of the first cut


@dataclass(frozen=True)
class QuadtreeCells(RowTable):
    """low, high : (C, 2) corners, metres. lower, upper : (C,) bounds of λ over the closed cells."""

    low: np.ndarray
    high: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    def __len__(self) -> int:
        return len(self.lower)

    @property
    def area(self) -> np.ndarray:
        """(C,) m²."""
        return np.asarray((self.high - self.low).prod(axis=1))

    @property
    def gap(self) -> np.ndarray:
        """(C,) trees between what the bounds allow."""
        return np.asarray((self.upper - self.lower) * self.area)


def refine(
    intensity: Intensity, low: np.ndarray, high: np.ndarray, spare: float, share: float = 0.0
) -> QuadtreeCells:
    """Cells that cover the rectangle ``low`` to ``high`` and leave little room between their bounds.

    spare : gap of a cell, in trees, below which it is not cut any more.
    share : the same as a share of the sum of all gaps; the larger of the two counts.

    Raises
    ------
    IntensityError : a bound is not finite.
    """
    done: list[QuadtreeCells] = []
    kept, settled = 0, 0.0
    active = _bounded(intensity, *_first_cut(low, high))
    while len(active):
        gap = active.gap
        middle = (active.low + active.high) / 2
        cut = (gap > max(spare, share * (gap.sum() + settled))) & (
            (middle > active.low) & (middle < active.high)
        ).all(axis=1)
        if kept + len(active) + 3 * int(cut.sum()) > MAX_CELLS:
            cut[:] = False
        done.append(active.select(~cut))
        kept, settled = kept + len(done[-1]), settled + float(gap[~cut].sum())
        active = _bounded(intensity, *_quarters(active.low[cut], middle[cut], active.high[cut]))
    return QuadtreeCells.joined(done)


def _bounded(intensity: Intensity, low: np.ndarray, high: np.ndarray) -> QuadtreeCells:
    lower, upper = intensity.bounds(low, high)
    bad = ~np.isfinite(upper)
    if bad.any():
        k = int(np.argmax(bad))
        raise IntensityError(
            f"the intensity has no finite bound between {low[k].tolist()} and {high[k].tolist()}; "
            "lower it there"
        )
    return QuadtreeCells(low, high, lower, upper)


def _first_cut(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    size = high - low
    counts = np.clip(np.rint(size / size.min()), 1, MAX_ASPECT).astype(int)
    x, y = (np.linspace(low[k], high[k], counts[k] + 1) for k in (0, 1))

    def corners(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)

    return corners(x[:-1], y[:-1]), corners(x[1:], y[1:])


def _quarters(
    low: np.ndarray, middle: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    lows, highs = [], []
    for right in (0, 1):
        for top in (0, 1):
            lows.append(np.column_stack([(low, middle)[right][:, 0], (low, middle)[top][:, 1]]))
            highs.append(np.column_stack([(middle, high)[right][:, 0], (middle, high)[top][:, 1]]))
    return np.concatenate(lows), np.concatenate(highs)


BINS = 256  # along each side of the polygon's box
CHUNK = 1 << 22  # pairs of edges checked at a time


class Polygon(Mask):
    """1 within a ring of corners and outside of its holes."""

    def __init__(
        self,
        corners: Sequence[Sequence[float]] | np.ndarray,
        holes: Sequence[Sequence[Sequence[float]] | np.ndarray] = (),
        name: str = "polygon",
    ) -> None:
        """corners : (V, 2) metres, in order; the last is joined to the first. holes : the same each.

        Raises
        ------
        IntensityError : a ring has no area, an edge crosses or touches another, a hole lies outside.
        """
        rings = [_ring(ring, f"{name}, ring {k}") for k, ring in enumerate([corners, *holes])]
        self.origin = rings[0][0]
        self.rings = [ring - self.origin for ring in rings]  # far from 0 (UTM), digits stay
        start = np.concatenate(self.rings)
        end = np.concatenate([np.roll(ring, -1, axis=0) for ring in self.rings])
        sizes = np.array([len(ring) for ring in self.rings])
        first = np.cumsum(sizes) - sizes
        follower = np.concatenate(
            [f + np.roll(np.arange(n), -1) for f, n in zip(first, sizes, strict=True)]
        )
        _refuse_crossings(start, end, follower, self.origin, name)
        self._edges = start, end
        for k, hole in enumerate(self.rings[1:], 1):
            outline = self.rings[0], np.roll(self.rings[0], -1, axis=0)
            if not _odd(*outline, hole[:1])[0]:
                raise IntensityError(f"{name}: hole {k} does not lie within the outline; move it")
        self._fill_bins(start, end)

    def at(self, points: np.ndarray) -> np.ndarray:
        places = points - self.origin
        column, row = self._bin(places).T
        state = self._states[row, column]  # 0 outside, 1 inside, 2 crossed by an edge
        state[((places < self._low) | (places > self._high)).any(axis=1)] = 0
        near = np.flatnonzero(state == 2)
        state[near] = _odd(*self._edges, places[near])
        return state.astype(float)

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        low, high = low - self.origin, high - self.origin
        first, last = self._bin(low), self._bin(high)
        lower, upper = self._ranges.over(first[:, ::-1], last[:, ::-1])
        lower[((low < self._low) | (high > self._high)).any(axis=1)] = 0.0
        upper[((high < self._low) | (low > self._high)).any(axis=1)] = 0.0
        return lower, upper

    def closed_integral(self, low: np.ndarray, high: np.ndarray) -> float:
        clipped = [_clip(ring, low - self.origin, high - self.origin) for ring in self.rings]
        areas = [abs(_area(ring)) if len(ring) else 0.0 for ring in clipped]
        return float(areas[0] - sum(areas[1:]))

    def _fill_bins(self, start: np.ndarray, end: np.ndarray) -> None:
        self._low, self._high = start.min(axis=0), start.max(axis=0)
        self._bin_size = (self._high - self._low) / BINS
        touched = np.zeros((BINS, BINS + 1), dtype=np.int64)
        up = start[:, 1] <= end[:, 1]
        below, above = np.where(up[:, None], start, end), np.where(up[:, None], end, start)
        first, last = self._bin(below)[:, 1], self._bin(above)[:, 1]
        edge, number = numbered(last - first + 1)
        row = first[edge] + number
        a, b = below[edge], above[edge]
        # The piece of each edge within a row, one part in 1e9 longer on either side: rounding.
        rise = np.maximum(b[:, 1] - a[:, 1], 1e-300)
        floor = self._low[1] + row * self._bin_size[1]
        t0 = np.clip((floor - a[:, 1]) / rise - 1e-9, 0, 1)
        t1 = np.clip((floor + self._bin_size[1] - a[:, 1]) / rise + 1e-9, 0, 1)
        x0, x1 = a[:, 0] + t0 * (b - a)[:, 0], a[:, 0] + t1 * (b - a)[:, 0]
        room = 1e-9 * (self._high - self._low)[0]
        left, right = (
            self._bin(np.column_stack([x, floor]))[:, 0]
            for x in (np.minimum(x0, x1) - room, np.maximum(x0, x1) + room)
        )
        np.add.at(touched, (row, left), 1)
        np.add.at(touched, (row, right + 1), -1)
        edged = np.cumsum(touched, axis=1)[:, :BINS] > 0
        middle = (
            self._low + (np.indices((BINS, BINS))[::-1].reshape(2, -1).T + 0.5) * self._bin_size
        )
        inside = _odd(start, end, middle).reshape(BINS, BINS)
        self._states = np.where(edged, 2, inside).astype(np.int8)
        self._ranges = Pyramid(np.where(edged, 0.0, inside), np.where(edged, 1.0, inside))

    def _bin(self, places: np.ndarray) -> np.ndarray:
        """(N, 2) column and row."""
        number = np.floor((places - self._low) / self._bin_size)
        return np.clip(number, 0, BINS - 1).astype(np.int64)


def _ring(corners: Sequence[Sequence[float]] | np.ndarray, name: str) -> np.ndarray:
    ring = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
    if len(ring) > 1 and (ring[0] == ring[-1]).all():  # closed by hand, as GeoJSON is
        ring = ring[:-1]
    if not np.isfinite(ring).all():
        raise IntensityError(f"{name}: a corner is not finite; mend it")
    offset = ring - ring[:1]
    longest = offset[np.argmax((offset**2).sum(axis=1))] if len(ring) else (0.0, 0.0)
    if len(ring) < 3 or (offset[:, 0] * longest[1] == offset[:, 1] * longest[0]).all():  # in line
        raise IntensityError(f"{name} has no area; give at least 3 corners that are not in line")
    return ring


def _area(ring: np.ndarray) -> float:
    """Signed, by the shoelace formula about the first corner."""
    x, y = (ring - ring[0]).T
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2)


def _refuse_crossings(
    start: np.ndarray, end: np.ndarray, follower: np.ndarray, origin: np.ndarray, name: str
) -> None:
    """An edge and its follower (E,) meet in a corner; no others may meet."""
    every = np.arange(len(start))
    rows = max(1, CHUNK // len(start))
    for first in range(0, len(start), rows):
        some_edges = every[first : first + rows]
        a, b = start[some_edges, None], end[some_edges, None]
        c, d = start[None], end[None]  # closed segments ab and cd have a point in common:
        meet = (
            (np.minimum(a, b) <= np.maximum(c, d)) & (np.minimum(c, d) <= np.maximum(a, b))
        ).all(-1)
        meet &= (_side(a, b, c) * _side(a, b, d) <= 0) & (_side(c, d, a) * _side(c, d, b) <= 0)
        # Neighbours share a corner; they may not fold back over each other.
        after = follower[some_edges, None] == every
        before = follower == some_edges[:, None]
        other = np.where(after[..., None], end[None], start[None])
        own, shared = np.where(after[..., None], a, b), np.where(after[..., None], b, a)
        folded = (_side(shared, own, other) == 0) & (
            ((own - shared) * (other - shared)).sum(axis=2) > 0
        )
        bad = np.where(after ^ before, folded, meet & ~(after | before))
        bad[np.arange(len(some_edges)), some_edges] = False
        if bad.any():
            i, j = np.argwhere(bad)[0]
            edges = [(start[k] + origin).tolist() for k in (some_edges[i], j)]
            raise IntensityError(
                f"{name}: the edges from {edges[0]} and from {edges[1]} cross or touch; "
                "give the corners in order around the window"
            )


def _side(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    ab, ac = b - a, c - a
    return np.asarray(ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0])


def _odd(start: np.ndarray, end: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(N,) bool, whether an odd number of edges (E, 2) lies to the left of places (N, 2)."""
    up = (start[:, 1] < end[:, 1])[:, None]
    below, above = np.where(up, start, end), np.where(up, end, start)
    order = np.argsort(places[:, 1], kind="stable")
    x, y = places[order].T
    first, last = (np.searchsorted(y, ends[:, 1], "left") for ends in (below, above))
    odd = np.zeros(len(places), dtype=bool)
    for edge in np.flatnonzero(first < last).tolist():  # level edges cross no line of sight along x
        row = slice(first[edge], last[edge])
        along, rise = above[edge] - below[edge]
        odd[row] ^= below[edge, 0] + (y[row] - below[edge, 1]) * (along / rise) < x[row]
    unsorted = np.empty_like(odd)
    unsorted[order] = odd
    return unsorted


def _clip(ring: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """A ring cut to a rectangle (Sutherland and Hodgman 1974); its signed area is right."""
    for axis in (0, 1):
        for limit, sign in ((low[axis], 1.0), (high[axis], -1.0)):
            if not len(ring):
                return ring
            after = np.roll(ring, -1, axis=0)
            here, there = sign * (ring[:, axis] - limit), sign * (after[:, axis] - limit)
            cut = (here < 0) != (there < 0)
            t = np.where(cut, here / np.where(cut, here - there, 1.0), 0.0)
            crossing = ring + t[:, None] * (after - ring)
            crossing[:, axis] = limit
            both = np.stack([ring, crossing], axis=1).reshape(-1, 2)
            ring = both[np.column_stack([here >= 0, cut]).ravel()]
    return ring


@dataclass(frozen=True)
class Painted:
    """Weights on a mesh, in world coordinates.

    vertices : (V, 3) metres. triangles : (T, 3). weight : (V,), 0 or larger.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    weight: np.ndarray


class RasterIntensity(Intensity):
    """An image with bilinear meaning, zero beyond it.

    Bounds come from a pyramid of its patches, and are exact for cells of up to two patches a side; its
    integral is closed.
    """

    def __init__(
        self, pixels: np.ndarray, low: np.ndarray, size: np.ndarray, name: str = "raster"
    ) -> None:
        """pixels : (rows, columns) trees/m², the first row the north edge.

        Raises
        ------
        IntensityError : a pixel is negative or not finite; says where.
        """
        refuse_pixels(
            ~(np.isfinite(pixels) & (pixels >= 0)), pixels, low, size, name, "0 or larger"
        )
        self.grid = Grid.of_image(pixels, low, size)
        self._ranges = self.grid.value_ranges()

    def at(self, points: np.ndarray) -> np.ndarray:
        return np.where(self.grid.inside(points), self.grid.at(points), 0.0)

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        first, last = self.grid.patches_of(low, high)
        lower, upper = self._ranges.over(first, last)
        small = ((last - first) <= 1).all(axis=1)
        lower[small], upper[small] = self.grid.exact_range(low[small], high[small])
        lower[((low < self.grid.low) | (high > self.grid.high)).any(axis=1)] = 0.0
        upper[((high < self.grid.low) | (low > self.grid.high)).any(axis=1)] = 0.0
        return lower, upper

    def closed_integral(self, low: np.ndarray, high: np.ndarray) -> float:
        return self.grid.integral(low, high)


class RasterMask(Mask):
    """1 where an image reaches a threshold, 0 elsewhere and beyond it."""

    def __init__(self, raster: RasterIntensity, threshold: float) -> None:
        self.raster, self.threshold = raster, threshold

    def at(self, points: np.ndarray) -> np.ndarray:
        inside = self.raster.grid.inside(points)
        return (inside & (self.raster.at(points) >= self.threshold)).astype(float)

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        lower, upper = self.raster.bounds(low, high)
        grid = self.raster.grid
        within = ((low >= grid.low) & (high <= grid.high)).all(axis=1)
        beyond = ((high < grid.low) | (low > grid.high)).any(axis=1)
        # A hair's breadth of the threshold is left undecided: bounds and values round differently.
        room = 1e-9 * max(self.threshold, upper.max(initial=0.0))
        sure = within & (lower >= self.threshold + room)
        maybe = ~beyond & (upper >= self.threshold - room)
        return sure.astype(float), maybe.astype(float)


class PixelMask(Mask):
    """1 on some pixels of a raster, to their edges, 0 on others and beyond."""

    def __init__(self, chosen: np.ndarray, low: np.ndarray, size: np.ndarray) -> None:
        """chosen : (rows, columns) bool, the first row the north edge."""
        self.low, self.step = low, size / chosen.shape[::-1]
        self._chosen = np.pad(chosen[::-1], 1).astype(float)
        self._ranges = Pyramid(self._chosen, self._chosen)

    def _pixel(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) row and column of points (N, 2), in the grid with an edge of zeros."""
        place = np.floor((points - self.low) / self.step + 1)[:, ::-1]
        return np.clip(place, 0, np.array(self._chosen.shape) - 1).astype(np.int64)

    def at(self, points: np.ndarray) -> np.ndarray:
        return np.asarray(self._chosen[tuple(self._pixel(points).T)])

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        inner = np.maximum(high - 1e-9 * self.step, low)  # an edge belongs to the pixel behind it
        return self._ranges.over(self._pixel(low), self._pixel(inner))


class PaintedMesh(Intensity):
    """Weights on a mesh, linear over its triangles as seen from above, zero beside it."""

    def __init__(self, painted: Painted, value: float, name: str = "painted mesh") -> None:
        """value : trees/m² of the ground plan where the weight is 1.

        Raises
        ------
        IntensityError : a weight is negative or not finite, the mesh has no area; says where.
        """
        bad = ~(np.isfinite(painted.weight) & (painted.weight >= 0))
        if bad.any():
            k = int(np.argmax(bad))
            raise IntensityError(
                f"{name}: the weight of vertex {k} at {painted.vertices[k].tolist()} is "
                f"{painted.weight[k]:g}; it must be 0 or larger"
            )
        try:
            self.surface = IntensitySurface(painted.vertices, painted.triangles)
        except ValueError as problem:
            raise IntensityError(f"{name}: {problem}") from None
        self.weight = value * np.asarray(painted.weight, dtype=np.float64)
        corners = self.weight[self.surface.triangles]
        self._ranges = self.surface.ranges(np.zeros(len(corners)), corners.max(axis=1))

    def at(self, points: np.ndarray) -> np.ndarray:
        return np.maximum(np.nan_to_num(self.surface.interpolate(points, self.weight)), 0.0)

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        upper = self._ranges.over(*self.surface.bins_of(low, high))[1]
        beyond = ((high < self.surface.low) | (low > self.surface.high)).any(axis=1)
        return np.zeros(len(low)), np.where(beyond, 0.0, np.maximum(upper, 0.0))


class TerrainLimits(Mask):
    """1 where slope and altitude of the ground are within limits, 0 elsewhere and where there is none."""

    def __init__(
        self, terrain: GroundSurface, slope: tuple[float, float], altitude: tuple[float, float]
    ) -> None:
        """slope : radians, lowest and highest. altitude : metres, the same."""
        self.terrain, self.altitude = terrain, altitude
        self.steepness = (np.tan(slope[0]), np.tan(slope[1]) if slope[1] < np.pi / 2 else np.inf)

    def at(self, points: np.ndarray) -> np.ndarray:
        height = self.terrain.height(points)
        steepness = np.linalg.norm(self.terrain.gradient(points), axis=1)
        good = (height >= self.altitude[0]) & (height <= self.altitude[1])
        good &= (steepness >= self.steepness[0]) & (steepness <= self.steepness[1])
        return good.astype(float)

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        upper = np.ones(len(low))
        both = self.altitude, self.steepness
        for limits, (least, most) in zip(both, self.terrain.bounds(low, high), strict=True):
            room = 1e-9 * max(1.0, *(abs(limit) for limit in limits if np.isfinite(limit)))
            upper[(most < limits[0] - room) | (least > limits[1] + room)] = 0.0
        return np.zeros(len(low)), upper
