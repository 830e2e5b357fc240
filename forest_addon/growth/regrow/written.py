"""The string of a tree of a fitted grammar, in the notation of ABOP, as far as it has been rewritten.

After 0 generations it is the letter of the trunk, A(class, length, diameter). Each generation rewrites
every such letter into the axis that it stands for, with the letters of its children in brackets; the last
sets the leaves. ``\\``, ``&`` and ``\\`` bring the turtle into a child's frame (the angles of Euler, as
z, x, z), ``f`` takes it from the parent's axis to the child's foot.

The turtle's left, up and heading are N, B and T of ``courses``; it starts upright.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .anatomy import GROUND, Anatomy
from .fitted import Habit
from .lines import seats_on
from .relay import feet_of_leaves, hang_leaves
from .sibling import Grown

Hung = tuple[int, float, str]  # stretch of the axis, how far along it, text
LEAST = 1e-7  # metres and degrees that are left out
FULL_TURN = 360.0


def write_string(habit: Habit, grown: Grown, variety: float, generations: int) -> str:
    """The string after so many generations; one more than the deepest order has the leaves too."""
    parts: dict[int, list[Hung]] = {}
    orders = int(grown.order.max(initial=0)) + 1
    if generations > orders:
        for branch, hung in _leaves(habit.anatomy, grown, variety):
            parts.setdefault(branch, []).append(hung)
    seat = _seats(grown)
    for branch in range(len(grown.piece) - 1, -1, -1):  # children come after their parents
        order = int(grown.order[branch])
        if order > generations:
            continue
        own = parts.pop(branch, [])
        text = _axis(grown, branch, own) if order < generations else _letter(habit, grown, branch)
        mother = int(grown.mother[branch])
        way = _way_to(grown, branch, seat)
        opened = f"[{way}{text}]" if mother >= 0 or (grown.mother < 0).sum() > 1 else way + text
        where = int(seat[0][branch]), float(seat[1][branch])
        parts.setdefault(mother, []).append((*where, opened))
    return "".join(text for _, _, text in parts.get(-1, []))


def generations_of(habit: Habit) -> int:
    """Return how often a string is rewritten until the leaves are set."""
    return int(habit.anatomy.order.max(initial=0)) + 2


def _axis(grown: Grown, branch: int, hanging: list[Hung]) -> str:
    """The steps of an axis with what hangs on it."""
    lines = grown.lines
    rows = range(int(lines.first[branch]), int(lines.first[branch + 1]))
    hanging = sorted(hanging, key=lambda hung: hung[:2])
    out, next_one = [], 0
    for number, row in enumerate(rows):
        out.append(_turned(lines.frame[row - 1].T @ lines.frame[row]) if number else "")
        knot = row + branch
        out.append(f"!({lines.radius[knot] + lines.radius[knot + 1]:.6g})")
        at = 0.0
        while next_one < len(hanging) and hanging[next_one][0] == number:
            part = hanging[next_one][1]
            out += [_step("F", (part - at) * lines.length[row]), hanging[next_one][2]]
            at, next_one = part, next_one + 1
        out.append(_step("F", (1.0 - at) * lines.length[row]))
    return "".join(out)


def _letter(habit: Habit, grown: Grown, branch: int) -> str:
    lines = grown.lines
    reach = lines.length[lines.first[branch] : lines.first[branch + 1]].sum()
    letter = chr(ord("A") + min(int(grown.order[branch]), 20))
    diameter = 2 * lines.radius[lines.first[branch] + branch]
    return f"{letter}({habit.kind[grown.piece[branch]]},{reach:.6g},{diameter:.6g})"


def _seats(grown: Grown) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of every branch on its parent: stretch and part, and (B, 3) from her axis to its foot in her frame."""
    lines = grown.lines
    foot = lines.knot[lines.first[:-1] + np.arange(len(grown.piece))]
    borne = np.flatnonzero(grown.mother >= 0)
    found = seats_on(lines, grown.mother[borne], foot[borne])
    stretch, part = np.zeros(len(foot), np.int64), np.zeros(len(foot))
    stretch[borne], part[borne] = found.stretch, found.part
    off = foot.copy()  # on the ground, in its frame
    off[borne] = np.stack(
        [found.away * np.cos(found.aside), found.away * np.sin(found.aside), found.along], axis=1
    )
    return stretch, part, off


def _way_to(grown: Grown, branch: int, seat: tuple[np.ndarray, np.ndarray, np.ndarray]) -> str:
    """Return how the turtle gets from her parent's axis into a branch's frame."""
    mother = int(grown.mother[branch])
    stretch, off = seat[0][branch], seat[2][branch]
    frame = GROUND if mother < 0 else grown.lines.frame[grown.lines.first[mother] + stretch]
    start = grown.lines.frame[grown.lines.first[branch]]
    return _moved(off) + _turned(frame.T @ start)


def _leaves(anatomy: Anatomy, grown: Grown, variety: float) -> Iterator[tuple[int, Hung]]:
    """The branch of every leaf, and how it hangs there."""
    hung = hang_leaves(anatomy, grown, variety)
    foot, matrix = feet_of_leaves(anatomy, grown, hung, variety > 0)
    own = anatomy.foliage.truth
    heading = np.einsum("nij,nj->ni", matrix, own.axis[hung.source])
    outward = np.einsum("nij,nj->ni", matrix, (own.centre - anatomy.foliage.foot)[hung.source])
    heading *= np.where(np.einsum("ni,ni->n", heading, outward) < 0, -1.0, 1.0)[:, None]
    up = np.einsum("nij,nj->ni", matrix, own.normal[hung.source])
    frame = np.stack([np.cross(up, heading), up, heading], axis=2)
    line = hung.branch
    bearer = grown.lines.frame[grown.lines.first[line] + hung.seat.stretch]
    knot = grown.lines.first[line] + hung.seat.stretch + line
    start, end = grown.lines.knot[knot], grown.lines.knot[knot + 1]
    off = foot - start - hung.seat.part[:, None] * (end - start)
    off = np.einsum("nij,ni->nj", bearer, off)
    for row in range(len(line)):
        size = f"~({own.length[hung.source[row]] * hung.size[row]:.6g},"
        size += f"{own.width[hung.source[row]] * hung.size[row]:.6g})"
        text = f"[{_moved(off[row])}{_turned(bearer[row].T @ frame[row])}{size}]"
        yield int(line[row]), (int(hung.seat.stretch[row]), float(hung.seat.part[row]), text)


def _moved(off: np.ndarray) -> str:
    """From where the turtle is to a place (3,) in its frame, its frame as before."""
    away = float(np.hypot(off[0], off[1]))
    text = _step("f", float(off[2]))
    if away > LEAST:
        around = float(np.rad2deg(np.arctan2(off[1], off[0]))) + 90.0
        text += f"{_turn(chr(92), around)}&(90)f({away:.6g})&(-90){_turn(chr(92), -around)}"
    return text


def _turned(matrix: np.ndarray) -> str:
    """Into a frame given in the turtle's own (3, 3)."""
    angle = float(np.arctan2(np.hypot(matrix[0, 2], matrix[1, 2]), matrix[2, 2]))
    if np.rad2deg(angle) < LEAST:
        return _turn("\\", float(np.rad2deg(np.arctan2(matrix[1, 0], matrix[0, 0]))))
    before = float(np.rad2deg(np.arctan2(matrix[0, 2], -matrix[1, 2])))
    after = float(np.rad2deg(np.arctan2(matrix[2, 0], matrix[2, 1])))
    return _turn("\\", before) + _turn("&", float(np.rad2deg(angle))) + _turn("\\", after)


def _turn(symbol: str, degrees: float) -> str:
    degrees = (degrees + FULL_TURN / 2) % FULL_TURN - FULL_TURN / 2
    return f"{symbol}({degrees:.9g})" if abs(degrees) > LEAST else ""


def _step(symbol: str, length: float) -> str:
    return f"{symbol}({length:.9g})" if abs(length) > LEAST else ""
