"""Pulses of a scan by the tile that they belong to, and how far from it they go.

Only the part of a beam between the lowest and the highest leaf of the forest can meet a tree. A pulse belongs
to the tile over which it comes into that layer, and its *excess* is how far the path within, with the width
of the beam, leads beyond the tile's edges. Where that is no more than the buffer, the tile's scene holds
every tree that the pulse can meet. Others are followed: they are traced in the smallest scene about the same
tile, of buffers that double, in which their path ends. So no pulse is ever traced in less than it can meet.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...stand.tiles import TileGrid
from .footprint import reach
from .scanner import LiDAR, Pattern, Pulses

AT_ONCE = 262_144  # pulses
LEVELS = 32  # of buffers; the first is that of the settings
FIRST = 10.0  # metres: the least buffer that is doubled
SPARE = 0.01  # metres about a path, for rounding


@dataclass(frozen=True)
class TiledPulses:
    """A scan's pulses by piece: a tile and a level of its buffer.

    start : (R,) numbers at which runs of pulses of one piece begin. piece : (R,) tile · ``LEVELS`` + level.
    count : of all pulses. furthest : m, largest excess of a pulse. followed : pulses beyond the buffer.
    """

    start: np.ndarray
    piece: np.ndarray
    count: int
    furthest: float
    followed: int

    @property
    def pieces(self) -> np.ndarray:
        """The pieces that have pulses, ascending."""
        return np.unique(self.piece)

    def numbers(self, piece: int, at_once: int) -> Iterator[np.ndarray]:
        """The pulses of a piece, ascending, about so many at a time."""
        runs = np.flatnonzero(self.piece == piece)
        first = self.start[runs]
        stop = np.append(self.start, self.count)[runs + 1]
        total = np.cumsum(stop - first)
        begin = 0
        while begin < len(runs):
            done = total[begin - 1] if begin else 0
            end = max(int(np.searchsorted(total, done + at_once, "right")), begin + 1)
            some = [np.arange(a, b) for a, b in zip(first[begin:end], stop[begin:end], strict=True)]
            together = np.concatenate(some)
            for k in range(0, len(together), at_once):
                yield together[k : k + at_once]
            begin = end


def buffer_of(level: int, buffer: float) -> float:
    """Metres that the scene of a level reaches beyond the tile."""
    return buffer if level == 0 else max(buffer, FIRST) * 2.0**level


def tiled_pulses(
    scanner: LiDAR, pattern: Pattern, grid: TileGrid, heights: tuple[float, float], buffer: float
) -> TiledPulses:
    """Say of every pulse to which piece it belongs; heights : lowest and highest z of all trees, m."""
    starts, pieces, last = [], [], -1
    furthest, followed = 0.0, 0
    for first in range(0, pattern.count, AT_ONCE):
        number = np.arange(first, min(first + AT_ONCE, pattern.count))
        tile, excess = belongs(scanner, pattern.pulses(number), grid, heights)
        with np.errstate(divide="ignore"):
            level = np.ceil(np.log2(excess / max(buffer, FIRST)))
        level = np.where(excess <= buffer, 0, np.clip(level, 1, LEVELS - 1)).astype(np.int64)
        piece = tile * LEVELS + level
        change = np.flatnonzero(np.diff(piece, prepend=last))
        starts.append(number[change])
        pieces.append(piece[change])
        last = int(piece[-1])
        furthest = max(furthest, float(excess.max()))
        followed += int((level > 0).sum())
    return TiledPulses(
        np.concatenate(starts), np.concatenate(pieces), pattern.count, furthest, followed
    )


def belongs(
    scanner: LiDAR, pulses: Pulses, grid: TileGrid, heights: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """(P,) tile of pulses, and (P,) metres that their paths among trees lead beyond it."""
    radius, spread = reach(scanner.beam)
    wide = radius + np.tan(spread) * scanner.max_range + SPARE
    low, high = heights[0] - wide, heights[1] + wide
    up, begin = pulses.direction[:, 2], pulses.origin[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort([(low - begin) / up, (high - begin) / up], axis=0)
    level = up == 0
    inside = (begin >= low) & (begin <= high)
    near = np.where(level, np.where(inside, 0.0, np.inf), np.maximum(ends[0], 0.0))
    far = np.where(level, np.inf, ends[1])
    far = np.minimum(far, scanner.max_range)
    meets = near <= far
    near, far = np.where(meets, near, 0.0), np.where(meets, far, 0.0)
    flat, where = pulses.direction[:, :2], pulses.origin[:, :2]
    enter, leave = where + near[:, None] * flat, where + far[:, None] * flat
    tile = grid.tile_of(enter)
    least, most = grid.corners(tile)
    beyond = np.maximum(least - np.minimum(enter, leave), np.maximum(enter, leave) - most)
    excess = np.maximum(beyond.max(axis=1), 0.0) + wide
    return tile, np.where(meets, excess, 0.0)
