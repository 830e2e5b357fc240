"""Courses of branches: polylines as lengths and bends, and bends back to polylines, all branches at once.

Along a branch runs a frame whose columns are N, B and T, the heading. From one straight stretch to the
next it takes the smallest turn that brings T over (parallel transport), so nothing twists. That turn is
about an axis across T and is written as the bend (a, b), radians about N and about B: what a turtle
does between two steps. From the frame of its foot, its bends and its lengths a branch is walked again,
and with other bends it is bent.
"""

from __future__ import annotations

import numpy as np

from ...base.vectors import azimuth_of, column, cross_rows, zenith_of

LEVEL = 1e-6  # length of a unit heading's shadow from which it points some way
STEEP = 0.97  # |T_z| from which a branch counts as upright, and no side of it is the upper one


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


def lay(bend: np.ndarray, first: np.ndarray, start: np.ndarray) -> np.ndarray:
    """The frames (S, 3, 3) of lines with these bends (S, 2), from the frames of their feet (C, 3, 3)."""
    frame = np.empty((len(bend), 3, 3))
    frame[first[:-1]] = start
    turn = _turns(bend)
    for at in _step_by_step(first):
        frame[at] = frame[at - 1] @ turn[at]
    return frame


def lay_sloping(
    bend: np.ndarray, first: np.ndarray, start: np.ndarray, slope: np.ndarray
) -> np.ndarray:
    """The same, but with these slopes (S,), radians from the vertical, kept in the world.

    A twig hangs and a shoot rises whatever way its parent points: after each step, which turns the line
    sideways as its bend says, it is turned in its vertical plane until its slope is right.
    """
    frame = np.empty((len(bend), 3, 3))
    frame[first[:-1]] = start
    turn = _turns(bend)
    for at in _step_by_step(first):
        frame[at] = sloped(frame[at - 1] @ turn[at], slope[at])
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


def slopes(frame: np.ndarray) -> np.ndarray:
    """(S,) radians from the vertical."""
    return zenith_of(frame[:, :, 2])


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
    mother: np.ndarray,
    azimuth: np.ndarray,
    angle: np.ndarray,
    roll: np.ndarray,
    carried: np.ndarray,
) -> np.ndarray:
    """(C, 3, 3) frames at the feet of branches that leave parents with these frames (C, 3, 3).

    azimuth : (C,) about the parent's T, from N towards B. angle : (C,) from her T.
    roll : (C,) about the branch's own T, where it counts.
    carried : (C,) whether it counts: whether the branch's N comes from its parent's. Else, and unless the
        branch stands upright, N is its upper side.
    """
    frame = mother @ _about(2, azimuth) @ _about(1, angle) @ _about(2, roll)
    heading = frame[:, :, 2]
    level = np.flatnonzero(~carried & (np.abs(heading[:, 2]) < STEEP))
    frame[level] = upper_frames(heading[level])
    return np.asarray(frame)


def upper_frames(heading: np.ndarray) -> np.ndarray:
    """(N, 3, 3) frames of unit headings that are not upright, N on the upper side."""
    up = -heading[:, 2:] * heading
    up[:, 2] += 1.0
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    return np.stack([up, np.cross(heading, up), heading], axis=2)


def angles_in(mother: np.ndarray, heading: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Azimuth (C,) about a parent's T and angle (C,) from it of headings (C, 3)."""
    own = np.einsum("nij,ni->nj", mother, heading)
    across = np.hypot(own[:, 0], own[:, 1])
    return azimuth_of(own), np.arctan2(across, column(own, 2))


def rolled(frame: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """(C,) radians about T from the N of frames to that of others with the same T."""
    cosine = np.einsum("ni,ni->n", frame[:, :, 0], wanted[:, :, 0])
    sine = np.einsum("ni,ni->n", frame[:, :, 1], wanted[:, :, 0])
    return np.arctan2(sine, cosine)


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
