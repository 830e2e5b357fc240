"""Polygon windows: where trees may stand, with holes.

Corners are checked once (no zero area, no edge that crosses or touches another), then points are judged by
the even-odd rule: points in order of y, so that an edge asks those alone that lie between its ends. For
cells, edges are drawn into a grid of bins: bins without an edge are wholly in or out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .functions import IntensityError, Mask
from .surface import Pyramid

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

    @property
    def area(self) -> float:
        """m², without the holes."""
        areas = [abs(_area(ring)) for ring in self.rings]
        return float(areas[0] - sum(areas[1:]))

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
        count = last - first + 1
        edge = np.repeat(np.arange(len(below)), count)
        row = first[edge] + np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
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
    if len(ring) < 3 or _in_line(ring):
        raise IntensityError(f"{name} has no area; give at least 3 corners that are not in line")
    return ring


def _in_line(ring: np.ndarray) -> bool:
    offset = ring - ring[0]
    longest = offset[np.argmax((offset**2).sum(axis=1))]
    return bool((offset[:, 0] * longest[1] == offset[:, 1] * longest[0]).all())


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
        mine = every[first : first + rows]
        a, b = start[mine, None], end[mine, None]
        meet = _meet(a, b, start[None], end[None])
        # Neighbours share a corner; they may not fold back over each other.
        after = follower[mine, None] == every
        before = follower == mine[:, None]
        other = np.where(after[..., None], end[None], start[None])
        own, shared = np.where(after[..., None], a, b), np.where(after[..., None], b, a)
        folded = (_side(shared, own, other) == 0) & (
            ((own - shared) * (other - shared)).sum(axis=2) > 0
        )
        bad = np.where(after ^ before, folded, meet & ~(after | before))
        bad[np.arange(len(mine)), mine] = False
        if bad.any():
            i, j = np.argwhere(bad)[0]
            edges = [(start[k] + origin).tolist() for k in (mine[i], j)]
            raise IntensityError(
                f"{name}: the edges from {edges[0]} and from {edges[1]} cross or touch; "
                "give the corners in order around the window"
            )


def _side(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    ab, ac = b - a, c - a
    return np.asarray(ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0])


def _meet(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Return whether the closed segments ab and cd have a point in common."""
    boxes = ((np.minimum(a, b) <= np.maximum(c, d)) & (np.minimum(c, d) <= np.maximum(a, b))).all(
        axis=-1
    )
    apart = (_side(a, b, c) * _side(a, b, d) > 0) | (_side(c, d, a) * _side(c, d, b) > 0)
    return np.asarray(boxes & ~apart)


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
    found = np.empty_like(odd)
    found[order] = odd
    return found


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
