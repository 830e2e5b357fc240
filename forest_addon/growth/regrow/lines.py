"""Polylines of many branches, and places on them.

A place on a branch is a seat: a stretch of its line, how far along that, and what is left to the place
itself, in the frame of the stretch.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from scipy.spatial import cKDTree

from ...base.vectors import azimuth_of


@dataclass(frozen=True)
class Lines:
    """C polylines from foot to tip; ``first`` (C + 1,) counts stretches, of which there are S.

    A line has one knot more than stretches, so that stretch s of line c runs from knot s + c on.
    """

    first: np.ndarray
    knot: np.ndarray  # (S + C, 3)
    radius: np.ndarray  # (S + C,)
    length: np.ndarray  # (S,)
    frame: np.ndarray  # (S, 3, 3)

    @property
    def line(self) -> np.ndarray:
        """(S,) line of each stretch."""
        size = np.diff(self.first)
        return np.repeat(np.arange(len(size)), size)

    def reach(self) -> np.ndarray:
        """(C,) length of each line."""
        return np.add.reduceat(self.length, self.first[:-1])


@dataclass(frozen=True)
class Seats:
    """Seats of N things on a line.

    stretch : (N,) of their line, from 0. part : (N,) how far along it, 0 .. 1.
    away : (N,) how far off the axis. aside : (N,) radians about T, from N, where that is.
    along : (N,) beyond the end of the line, along T.
    """

    stretch: np.ndarray
    part: np.ndarray
    away: np.ndarray
    aside: np.ndarray
    along: np.ndarray

    def take(self, rows: np.ndarray) -> Seats:
        """Those of some rows."""
        return Seats(**{f.name: getattr(self, f.name)[rows] for f in fields(Seats)})


def stand_on(
    lines: Lines, line: np.ndarray, seat: Seats
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of seats on lines (N,): the place on the axis (N, 3), the frame (N, 3, 3), the radius (N,)."""
    stretch = lines.first[line] + seat.stretch
    knot = stretch + line
    start, end = lines.knot[knot], lines.knot[knot + 1]
    radius = lines.radius[knot] + seat.part * (lines.radius[knot + 1] - lines.radius[knot])
    return start + seat.part[:, None] * (end - start), lines.frame[stretch], radius


def seats_on(
    lines: Lines, line: np.ndarray, point: np.ndarray, frame: np.ndarray | None = None
) -> Seats:
    """The seats of points (N, 3) on the lines (N,) that they belong to.

    frame : (S, 3, 3) where those of ``lines`` are not known yet.
    """
    frame = lines.frame if frame is None else frame
    stretch, part = nearest(lines, line, point)
    part = np.clip(part, 0.0, 1.0)
    row = lines.first[line] + stretch
    start, end = lines.knot[row + line], lines.knot[row + line + 1]
    own = np.einsum("nij,ni->nj", frame[row], point - start - part[:, None] * (end - start))
    return Seats(stretch, part, np.hypot(own[:, 0], own[:, 1]), azimuth_of(own), own[:, 2])


def nearest(lines: Lines, line: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) stretch of their line that is nearest to points (N, 3), and (N,) how far along it.

    The nearest middle of a stretch is looked up with the line as a fourth coordinate; it and the
    stretches beside it are then tried exactly. A line goes straight on beyond its ends.
    """
    if not len(point):
        return np.empty(0, np.int64), np.empty(0)
    start = lines.knot[np.arange(len(lines.length)) + lines.line]
    way = lines.knot[np.arange(len(lines.length)) + lines.line + 1] - start
    apart = 4.0 * float(np.ptp(lines.knot, axis=0).max() + np.ptp(point, axis=0).max())
    tree = cKDTree(np.column_stack([start + way / 2, apart * lines.line]))
    guess = tree.query(np.column_stack([point, apart * line]), workers=-1)[1]
    low, high = lines.first[line], lines.first[line + 1] - 1
    squared = np.maximum(np.einsum("si,si->s", way, way), np.finfo(float).tiny)
    best = np.full(len(point), np.inf)
    stretch, share = np.zeros(len(point), np.int64), np.zeros(len(point))
    for offset in (-1, 0, 1):
        row = np.clip(guess + offset, low, high)
        from_start = point - start[row]
        part = np.einsum("ni,ni->n", from_start, way[row]) / squared[row]
        held = np.clip(part, 0.0, 1.0)
        gap = from_start - held[:, None] * way[row]
        distance = np.einsum("ni,ni->n", gap, gap)
        nearer = distance < best
        best = np.where(nearer, distance, best)
        stretch, share = np.where(nearer, row - low, stretch), np.where(nearer, part, share)
    return stretch, share


def share_of(lines: Lines, line: np.ndarray, seat: Seats) -> np.ndarray:
    """(N,) seats as a share of the length of the lines (N,) that they are on; 0 where there is none."""
    on = np.maximum(line, 0)
    before = np.cumsum(lines.length) - lines.length
    stretch = lines.first[on] + seat.stretch
    place = before[stretch] - before[lines.first[on]] + seat.part * lines.length[stretch]
    return np.where(line < 0, 0.0, place / lines.reach()[on])


def seat_at(lines: Lines, line: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stretch (N,) and part (N,) at a share (N,) of the length of lines (N,)."""
    before = np.cumsum(lines.length) - lines.length  # over all lines: rises throughout
    place = before[lines.first[line]] + share * lines.reach()[line]
    stretch = np.searchsorted(before, place, side="right") - 1
    stretch = np.clip(stretch, lines.first[line], lines.first[line + 1] - 1)
    length = np.maximum(lines.length[stretch], np.finfo(float).tiny)
    part = np.clip((place - before[stretch]) / length, 0.0, 1.0)
    return stretch - lines.first[line], part
