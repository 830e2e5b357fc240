"""Polylines of many branches, places on them, and their courses: lengths and bends, and back.

A place on a branch is a seat: a stretch of its line, how far along that, and what is left to the place
itself, in the frame of the stretch.

Along a branch runs a frame whose columns are N, B and T, the heading. From one straight stretch to the
next it takes the smallest turn that brings T over (parallel transport), so nothing twists. That turn is
about an axis across T and is written as the bend (a, b), radians about N and about B: what a turtle
does between two steps. From the frame of its foot, its bends and its lengths a branch is walked again,
and with other bends it is bent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from ...base.rows import RowTable
from ...base.vectors import azimuth_of, cross_rows, unit

LEVEL = 1e-6  # length of a unit heading's shadow from which it points some way
STEEP = 0.97  # |T_z| from which a branch counts as upright, and no side of it is the upper one


@dataclass(frozen=True)
class Lines(RowTable):
    """C polylines from foot to tip; ``first`` (C + 1,) counts stretches, of which there are S.

    A line has one knot more than stretches, so that stretch s of line c runs from knot s + c on.
    """

    first: np.ndarray
    knot: np.ndarray  # (S + C, 3)
    radius: np.ndarray  # (S + C,)
    length: np.ndarray  # (S,)
    frame: np.ndarray  # (S, 3, 3)

    @classmethod
    def joined(cls, parts: Sequence[Lines]) -> Lines:
        """Several tables of lines, one after the other."""
        ends = np.cumsum([0, *(part.first[-1] for part in parts)])
        first = [part.first[:-1] + at for part, at in zip(parts, ends, strict=False)]
        return replace(super().joined(parts), first=np.concatenate([*first, ends[-1:]]))

    @property
    def line(self) -> np.ndarray:
        """(S,) line of each stretch."""
        size = np.diff(self.first)
        return np.repeat(np.arange(len(size)), size)

    def reach(self) -> np.ndarray:
        """(C,) length of each line."""
        return np.add.reduceat(self.length, self.first[:-1])

    def at(
        self, line: np.ndarray, stretch: np.ndarray, part: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Places (N, 3) and radii (N,) at parts (N,) of stretches (N,) of lines (N,)."""
        knot = self.first[line] + stretch + line
        start, radius = self.knot[knot], self.radius[knot]
        place = start + part[:, None] * (self.knot[knot + 1] - start)
        return place, radius + part * (self.radius[knot + 1] - radius)


@dataclass(frozen=True)
class Seats(RowTable):
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


def stand_on(
    lines: Lines, line: np.ndarray, seat: Seats
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Place on the axis (N, 3), frame (N, 3, 3) and radius (N,) of seats on lines (N,)."""
    place, radius = lines.at(line, seat.stretch, seat.part)
    return place, lines.frame[lines.first[line] + seat.stretch], radius


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
    tree = scipy.spatial.cKDTree(np.column_stack([start + way / 2, apart * lines.line]))
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


def unbend(
    direction: np.ndarray, first: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The frames (S, 3, 3) and bends (S, 2) of lines whose S stretches have these unit directions.

    first : (C + 1,) first stretch of each line. start : (C, 3, 3) frames at the feet.
    The bend of a stretch is that from the one before it; 0 for the first.
    """
    frame, bend = np.empty((len(direction), 3, 3)), np.zeros((len(direction), 2))
    frame[first[:-1]] = start
    for at in _step_by_step(first):
        before = frame[at - 1]
        axis = np.cross(before[:, :, 2], direction[at])
        sine = np.linalg.norm(axis, axis=1)
        angle = np.arctan2(sine, np.einsum("ni,ni->n", before[:, :, 2], direction[at]))
        turn = axis * (angle / np.maximum(sine, np.finfo(float).tiny))[:, None]
        bend[at] = np.einsum("nij,ni->nj", before[:, :, :2], turn)
        frame[at] = before @ _turns(bend[at])
    return frame, bend


def lay(
    bend: np.ndarray, first: np.ndarray, start: np.ndarray, slope: np.ndarray | None = None
) -> np.ndarray:
    """The frames (S, 3, 3) of lines with these bends (S, 2), from the frames of their feet (C, 3, 3).

    slope : (S,) radians from the vertical, kept in the world. A twig hangs and a shoot rises whatever way its
    parent points: after each step, which turns the line sideways as its bend says, it is turned in its
    vertical plane until its slope is right.
    """
    frame = np.empty((len(bend), 3, 3))
    frame[first[:-1]] = start
    turn = _turns(bend)
    for at in _step_by_step(first):
        frame[at] = frame[at - 1] @ turn[at]
        if slope is not None:
            frame[at] = sloped(frame[at], slope[at])
    return frame


def sloped(frame: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Frames turned by the least turn to this slope; one that is upright falls towards its N."""
    x, y = frame[:, :2, 2].T
    flat = np.hypot(x, y)
    upright = flat <= LEVEL
    if upright.any():
        x, y = np.where(upright, frame[:, 0, 0], x), np.where(upright, frame[:, 1, 0], y)
        flat = np.maximum(np.hypot(x, y), np.finfo(float).tiny)
    shadow = np.sin(slope) / flat
    to = np.stack([x * shadow, y * shadow, np.cos(slope)], axis=1)
    between = frame[:, :, 2] + to
    normal = frame[:, :, 0]
    share = np.einsum("ni,ni->n", normal, to) / np.maximum(
        np.einsum("ni,ni->n", between, to), 1e-12
    )
    normal = normal - share[:, None] * between
    return np.stack([normal, cross_rows(to, normal), to], axis=2)


def walk(frame: np.ndarray, length: np.ndarray, first: np.ndarray, foot: np.ndarray) -> np.ndarray:
    """The knots (S + C, 3) of lines of these stretches, line by line, from their feet (C, 3)."""
    lines = len(first) - 1
    way = np.zeros((len(length) + lines, 3))
    knot = np.arange(len(length)) + np.repeat(np.arange(lines), np.diff(first)) + 1
    way[knot] = frame[:, :, 2] * length[:, None]
    gone = np.cumsum(way, axis=0)
    at = first[:-1] + np.arange(lines)
    here = np.repeat(np.arange(lines), np.diff(first) + 1)
    return np.asarray(foot[here] + gone - gone[at][here])


def foot_frames(
    parent: np.ndarray,
    azimuth: np.ndarray,
    angle: np.ndarray,
    roll: np.ndarray,
    carried: np.ndarray,
) -> np.ndarray:
    """(C, 3, 3) frames at the feet of branches that leave parents with these frames (C, 3, 3).

    azimuth : (C,) about the parent's T, from N towards B. angle : (C,) from it.
    roll : (C,) about the branch's own T, where it counts.
    carried : (C,) whether it counts: whether the branch's N comes from its parent's. Else, and unless the
        branch stands upright, N is its upper side.
    """
    frame = parent @ _about(2, azimuth) @ _about(1, angle) @ _about(2, roll)
    heading = frame[:, :, 2]
    level = np.flatnonzero(~carried & (np.abs(heading[:, 2]) < STEEP))
    frame[level] = upper_frames(heading[level])
    return np.asarray(frame)


def upper_frames(heading: np.ndarray) -> np.ndarray:
    """(N, 3, 3) frames of unit headings that are not upright, N on the upper side."""
    up = -heading[:, 2:] * heading
    up[:, 2] += 1.0
    up = unit(up)
    return np.stack([up, np.cross(heading, up), heading], axis=2)


def _about(axis: int, angle: np.ndarray) -> np.ndarray:
    """(N, 3, 3) turns about a frame's own B (1) or T (2)."""
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.zeros((len(angle), 3, 3))
    turn[:, axis, axis] = 1.0
    one, other = (axis + 1) % 3, (axis + 2) % 3
    turn[:, one, one] = turn[:, other, other] = cos
    turn[:, one, other], turn[:, other, one] = -sin, sin
    return turn


def _turns(bend: np.ndarray) -> np.ndarray:
    """(N, 3, 3) turns about N and B by bends (N, 2): Rodrigues in the frame itself."""
    a, b = bend.T
    angle = np.hypot(a, b)
    sinc = np.sinc(angle / np.pi)  # sin x / x
    versine = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2  # (1 - cos x) / x²
    turn = np.empty((len(bend), 3, 3))
    turn[:, 0, 0], turn[:, 1, 1] = 1 - versine * b * b, 1 - versine * a * a
    turn[:, 0, 1] = turn[:, 1, 0] = versine * a * b
    turn[:, 0, 2], turn[:, 2, 0] = sinc * b, -sinc * b
    turn[:, 1, 2], turn[:, 2, 1] = -sinc * a, sinc * a
    turn[:, 2, 2] = 1 - versine * (a * a + b * b)
    return turn


def _step_by_step(first: np.ndarray) -> list[np.ndarray]:
    """The second stretch of every line that has one, then the third, and so on."""
    size = np.diff(first)
    longest = np.argsort(-size, kind="stable")
    ordered = -size[longest]
    return [
        first[longest[: int(np.searchsorted(ordered, -step, side="left"))]] + step
        for step in range(1, int(size.max(initial=0)))
    ]
